"""Ground that no work line covers, and why, before a plan is driven; whether plans work enough."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely

from fields.geometry.arithmetic import MITRE_LIMIT, SHARP_MITRE_LIMIT
from fields.geometry.field import MIN_FENCE_MARGIN_M, MIN_REPORTED_M2
from fields.geometry.overlays import (
    extract_polygons,
    intersect,
    intersect_on_grid,
    subtract,
    subtract_on_grid,
    unite,
    unite_on_grid,
)
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import Coverage, find_left_out_ground, measure_left_out_m2
from planner.evaluation.machine_outlines import measure_passage_m
from planner.evaluation.site import get_site_moves, recall
from reports.common.language import mark_text
from reports.common.plan_records import UnworkedPiece
from reports.common.plan_results import PlanResult

MIN_WORKED_PCT = 90.0  # of the ground asked for: nobody takes a plan that leaves more for finished work
SLIVER_M = 0.1  # narrower unworked ground is rounding of outlines
EDGE_M = 0.05  # ground this near the outline touches it
BEND_ZONE_WIDTHS = 2.0  # working widths around a small obstacle that lines are interrupted by
KEPT_HEADLAND = "headland, kept free for turning"
LEFT_OUT = "left out as asked"


@dataclass(frozen=True, eq=False)
class UnworkedArea:
    """Ground unworked for one reason: the reason, its area (m2), and its pieces, the largest first."""

    reason: str
    area_m2: float
    pieces: tuple[shapely.Polygon, ...]


def find_unworked_areas(context: PlanningContext) -> tuple[UnworkedArea, ...]:
    """The ground that is due and stays unworked, by reason; what guidance misses is unknown before a plan is driven."""
    return recall(context, UnworkedArea, lambda: _find_unworked_areas(context))


def _find_unworked_areas(context: PlanningContext) -> tuple[UnworkedArea, ...]:
    boundary = context.layout.field.workable_region
    parts_by_reason = (
        []
        if context.layout.field.original_boundary is None
        else list(_find_obstacle_losses(context, context.layout.field.original_boundary))
    )
    remainder = extract_polygons(subtract_on_grid(boundary, get_site_moves(context).covered_ground))
    # Wide enough for the machines but without a passage to it: all rooms but the largest.
    cut_off = extract_polygons(intersect(unite(context.rooms[1:]), boundary))
    parts_by_reason.append((_describe_cut_off(context), cut_off))
    remainder = extract_polygons(subtract_on_grid(remainder, cut_off))
    for why, zone in _iter_zones(context):
        part = extract_polygons(intersect_on_grid(remainder, zone))
        parts_by_reason.append((why, part))
        remainder = extract_polygons(subtract_on_grid(remainder, part))
    parts_by_reason += _find_unexplained_ground(context, remainder)
    parts_by_reason.append((LEFT_OUT, find_left_out_ground(context)))
    done = context.layout.field.done
    if done is not None:
        due = ((why, subtract_on_grid(part, done)) for why, part in parts_by_reason)
        parts_by_reason = [(why, extract_polygons(part)) for why, part in due]
    areas = [UnworkedArea(why, float(part.area), _sort_pieces(part)) for why, part in parts_by_reason]
    return tuple(one for one in areas if one.area_m2 >= MIN_REPORTED_M2)


def explain_largest_piece(context: PlanningContext, coverage: Coverage) -> UnworkedPiece | None:
    """The largest piece that a plan leaves with the main reason for it; None without any."""
    piece, ground = coverage.largest_piece, coverage.largest_ground
    if piece is None or ground is None:
        return None
    areas = [one for one in find_unworked_areas(context) if one.reason != LEFT_OUT]
    shares_m2 = [float(intersect(shapely.multipolygons(one.pieces), ground).area) for one in areas]
    largest = int(np.argmax([ground.area - sum(shares_m2), *shares_m2]))
    if largest:
        return replace(piece, reason=areas[largest - 1].reason)
    place = shapely.Point(piece.x_m, piece.y_m)  # a plan may work another room than the largest, and leave that
    is_left_whole = any(one.intersects(place) and 2.0 * piece.m2 > one.area for one in context.rooms)
    return replace(piece, reason=_describe_cut_off(context) if is_left_whole else "reached by no pass of this plan")


def _find_obstacle_losses(context: PlanningContext, outline: shapely.Polygon) -> Iterator[tuple[str, shapely.Geometry]]:
    """Ground lost to the margin, and ground behind obstacles, by reason."""
    field = context.layout.field
    margin_m = max(context.request.margin_m, MIN_FENCE_MARGIN_M if field.fences else 0.0)
    obstacles = unite_on_grid([one.shape for one in field.obstacles])
    lost = subtract_on_grid(subtract_on_grid(outline, obstacles), field.workable_region)
    solid = unite_on_grid([obstacles, *map(shapely.Polygon, outline.interiors), *field.fences])
    near_obstacles = solid.buffer(2.0 * margin_m + EDGE_M)
    obstacle_kinds = "obstacles and fences" if field.fences else "obstacles"
    yield (
        mark_text(f"cut off by {obstacle_kinds}"),
        extract_polygons(subtract_on_grid(lost, near_obstacles)),
    )
    yield (
        mark_text(f"margin of {margin_m:g} m to {obstacle_kinds}"),
        extract_polygons(intersect_on_grid(lost, near_obstacles)),
    )


def _describe_cut_off(context: PlanningContext) -> str:
    passage_m = measure_passage_m(context.tractor, context.implement)
    return f"cut off: no passage as wide as the machines ({passage_m:g} m)"


def _iter_zones(context: PlanningContext) -> Iterator[tuple[str, shapely.Geometry]]:
    """Reasons and their zones, the strongest first."""
    layout, boundary = context.layout, context.layout.field.workable_region
    half = 0.5 * layout.width_m
    if layout.field.margin_boundary is not None:
        band = subtract_on_grid(layout.field.margin_boundary, layout.field.boundary)
        obstacle_kinds = "obstacles and fences" if layout.field.fences else "obstacles"
        yield (
            f"beside {obstacle_kinds}: room beyond the margin for machines swinging out in turns",
            extract_polygons(band),
        )
    wide = boundary.buffer(-half + EDGE_M, join_style="mitre", mitre_limit=MITRE_LIMIT)
    wide = wide.buffer(half - EDGE_M, join_style="mitre", mitre_limit=SHARP_MITRE_LIMIT)
    yield f"narrower than the implement ({layout.width_m:g} m)", extract_polygons(subtract(boundary, wide))
    small = unite(layout.field.small_obstacles).buffer(BEND_ZONE_WIDTHS * layout.width_m)
    yield "beside obstacles that are driven round", small
    if not layout.headland_passes:
        lines = np.array([shapely.LineString(swath.points_m) for swath in layout.swaths])
        strips = unite_on_grid(shapely.buffer(lines, half, cap_style="flat"))
        yield "on tracks that the machine has no room to work", strips
        headland_zone = unite_on_grid(shapely.buffer(lines, layout.headland_m + layout.width_m))
        yield KEPT_HEADLAND, headland_zone
        yield "too short for a track between its headlands", boundary


def _find_unexplained_ground(
    context: PlanningContext, remainder: shapely.Geometry
) -> Iterator[tuple[str, shapely.Geometry]]:
    """Ground without another reason: at the outline or inside."""
    core = remainder.buffer(-0.5 * SLIVER_M, join_style="mitre").buffer(0.5 * SLIVER_M, join_style="mitre")
    parts = shapely.get_parts(extract_polygons(core))
    outline = context.layout.field.workable_region.boundary
    touches = shapely.dwithin(parts, outline, EDGE_M)
    yield "tips and bays of the outline that no headland pass reaches", shapely.multipolygons(parts[touches])
    yield "between headland passes and tracks", shapely.multipolygons(parts[~touches])


def _sort_pieces(ground: shapely.Geometry) -> tuple[shapely.Polygon, ...]:
    parts = [part for part in shapely.get_parts(ground) if part.area > 0.0]
    return tuple(sorted(parts, key=lambda part: (-round(part.area, 3), part.bounds)))


def mark_worked_shares(results: Iterable[PlanResult], context: PlanningContext) -> list[PlanResult]:
    """The results, each with whether it works enough of the ground asked for."""
    listed = list(results)
    if all(_is_enough(result, 1.0, 1.0) for result in listed):
        return listed
    field, requested_share = context.layout.field, measure_requested_share(context)
    due_share = field.due_region.area / field.region_without_obstacles.area
    return [replace(result, works_enough=_is_enough(result, requested_share, due_share)) for result in listed]


def measure_requested_share(context: PlanningContext) -> float:
    """The share of the field that is to be worked: all but what is to be left, headland or tracks."""
    kept_m2 = sum(one.area_m2 for one in find_unworked_areas(context) if one.reason == KEPT_HEADLAND)
    kept_m2 += measure_left_out_m2(context)
    return 1.0 - kept_m2 / float(context.layout.field.due_region.area)


def _is_enough(result: PlanResult, requested_share: float, due_share: float) -> bool:
    """Whether a plan works enough of the ground asked for, what was done before included."""
    if result.worked_pct is None:
        return True
    return (100.0 * requested_share - result.worked_pct) * due_share <= (100.0 - MIN_WORKED_PCT) * requested_share
