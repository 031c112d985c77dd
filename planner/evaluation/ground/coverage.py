"""Figures of merit of a run: coverage, excursions of the antenna, reversals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely

from fields.arrays import Floats, build_directions
from fields.geometry.arithmetic import EDGE_M, MITRE_LIMIT
from fields.geometry.overlays import (
    Areas,
    clip_area,
    drop_slivers,
    extract_polygons,
    subtract_area,
    subtract_on_grid,
    unite,
    unite_areas,
)
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.swept_area import SweptArea, compute_swept_area
from planner.evaluation.site import get_site_moves
from reports.common.plan_records import UnworkedPiece
from strategies.lines.lay_lines import unite_strips
from vehicle.missions.plan import ENTER, LEAVE
from vehicle.missions.run import SimulationRun

MIN_PIECE_WIDTH_M = 0.2  # narrower missed ground counts, but is no piece that anybody would go back for


@dataclass(frozen=True, eq=False)
class Coverage:
    """Areas in m2: field without obstacles, worked, worked more than once, unworked; worked + unworked = field.

    `largest_piece` is the largest piece of `unworked_ground` that an implement could work in one go (necks up to half a
    working width separate pieces), and `largest_ground` its ground without thin ends; None without any. `left_out_m2`
    of the unworked ground are to be left out, and `spared_m2` of the rest are cut off by obstacles: no plan is charged
    for them. `spoilt_m2` of the worked ground are a seedbed that was driven over when finished, or a crop before it was
    cut, and are charged like unworked ground.
    """

    field_m2: float
    worked_m2: float
    overlap_m2: float
    unworked_m2: float
    unworked_ground: shapely.Geometry
    largest_piece: UnworkedPiece | None
    largest_ground: shapely.Polygon | None
    spared_m2: float = 0.0
    left_out_m2: float = 0.0
    spoilt_m2: float = 0.0

    @cached_property
    def unworked_pieces(self) -> tuple[shapely.Polygon, ...]:
        """The pieces of unworked ground wider than MIN_PIECE_WIDTH_M, the largest first."""
        return tuple(_find_wide_pieces(self.unworked_ground, MIN_PIECE_WIDTH_M))

    @property
    def missed_m2(self) -> float:
        """The unworked ground that was not to be left out."""
        return self.unworked_m2 - self.left_out_m2

    @property
    def worked_pct(self) -> float:
        """Share of the field that was worked, percent."""
        return 100.0 * self.worked_m2 / self.field_m2

    @property
    def overlap_pct(self) -> float:
        """Ground worked more than once, percent of the field."""
        return 100.0 * self.overlap_m2 / self.field_m2

    def extrapolate_to_field(self, spent: float) -> float:
        """Time or hourly cost for all reachable ground, with unworked and spoilt ground at the plan's own rate."""
        charged_m2 = self.missed_m2 - self.spared_m2 + self.spoilt_m2
        return spent * (1.0 + charged_m2 / self.worked_m2) if self.worked_m2 > 0.0 else math.inf


def compute_guided_path(run: SimulationRun, context: PlanningContext, tractor: int) -> Floats:
    """Path of the antenna, (t, 2)."""
    return locate_antenna(run.get_poses(tractor), context.tractor.guide_m)


def locate_antenna(poses: Floats, guide_m: float) -> Floats:
    """Places (t, 2) of the antenna, `guide_m` ahead of the centre of mass, which is at poses (t, 3)."""
    return poses[:, :2] + guide_m * build_directions(poses[:, 2])


def measure_coverage(run: SimulationRun, context: PlanningContext, swept: SweptArea | None = None) -> Coverage:
    """How much of the ground that is due was worked, worked more than once (or done before), and not worked.

    `swept` is the swept ground of the run, if known already.
    """
    field = context.layout.field
    boundary = field.due_region
    clipped = _clip_areas((swept or compute_swept_area(run, context)).ground, field.region_without_obstacles)
    worked = unite_areas(clipped) if field.done is None else clip_area(unite_areas(clipped), boundary)
    unworked = subtract_area(boundary, worked)
    area, total = float(worked.area), float(shapely.area(clipped).sum())
    left_out = find_left_out_ground(context)
    missed = unworked if left_out.is_empty else subtract_area(unworked, left_out)
    due = subtract_area(missed, unite_areas(np.array([one for one in field.cut_off_parts if not one.is_empty])))
    largest, largest_ground = _find_largest_piece(due, 0.5 * context.implement.width_m)
    return Coverage(
        boundary.area,
        area,
        max(total - area, 0.0),
        float(unworked.area),
        unworked,
        largest,
        largest_ground,
        max(0.0, float(missed.area - due.area)),
        max(0.0, float(unworked.area - missed.area)),
    )


def _clip_areas(areas: Areas, boundary: shapely.Geometry) -> Areas:
    """The areas clipped to the field."""
    shapely.prepare(boundary)
    across = ~shapely.contains_properly(boundary, areas)
    inside = areas.copy()
    inside[across] = [clip_area(one, boundary) for one in areas[across]]
    return inside


def _find_largest_piece(
    unworked: shapely.Geometry, neck_m: float
) -> tuple[UnworkedPiece, shapely.Polygon] | tuple[None, None]:
    """The largest piece of unworked ground with a place in it, and its ground without thin ends.

    Pieces are split where the ground is narrower than `neck_m`; a thin end belongs to its piece, a thin link between
    two pieces is a piece of its own.
    """
    unworked = shapely.multipolygons(drop_slivers(shapely.get_parts(unworked), min(neck_m, MIN_PIECE_WIDTH_M)))
    pieces = _find_wide_pieces(unworked, neck_m)
    thin = _find_wide_pieces(subtract_area(unworked, shapely.multipolygons(pieces)), MIN_PIECE_WIDTH_M)
    if not len(pieces) + len(thin):
        return None, None
    areas = np.concatenate([shapely.area(pieces), np.zeros(len(thin))])
    link, piece = shapely.STRtree(pieces).query(thin, predicate="dwithin", distance=EDGE_M)
    for number, part in enumerate(thin):
        adjacent = piece[link == number]
        areas[adjacent[0] if len(adjacent) == 1 else len(pieces) + number] += part.area
    best = int(np.argmax(areas))
    ground = (*pieces, *thin)[best]
    place = shapely.point_on_surface(ground)
    return UnworkedPiece(float(areas[best]), float(place.x), float(place.y)), ground


def _find_wide_pieces(unworked: shapely.Geometry, min_width_m: float) -> Areas:
    """Pieces of unworked ground without parts narrower than `min_width_m`, the largest first."""
    half, parts = 0.5 * min_width_m, drop_slivers(shapely.get_parts(extract_polygons(unworked)), min_width_m)
    unworked = shapely.multipolygons(parts)
    core = unworked.buffer(-half, join_style="mitre", mitre_limit=MITRE_LIMIT)
    wide = core.buffer(half, join_style="mitre", mitre_limit=MITRE_LIMIT)
    parts = shapely.get_parts(clip_area(unworked, wide))
    return np.array(sorted(parts, key=lambda piece: (-piece.area, piece.bounds)), dtype=np.object_)


def measure_outside_m(run: SimulationRun, tractor: int, context: PlanningContext) -> Floats:
    """How far (t,) the guided point of a tractor is outside the field; 0 inside.

    On the way in and out the gate of the entrance counts as ground of the field.
    """
    boundary, poses = context.layout.field.region_without_obstacles, run.get_poses(tractor)
    shapely.prepare(boundary)
    outside_m, path = np.zeros(len(poses)), locate_antenna(poses, context.tractor.guide_m)
    is_out = ~shapely.contains_xy(boundary, path[:, 0], path[:, 1])
    outside_m[is_out] = shapely.distance(shapely.points(path[is_out]), boundary)
    at_gate, with_gate = is_out & run.find_task_rows(tractor, (ENTER, LEAVE)), unite([boundary, context.gate_area])
    outside_m[at_gate] = shapely.distance(shapely.points(path[at_gate]), with_gate)
    return outside_m


def count_reversals(run: SimulationRun) -> int:
    """Number of changes of direction in the plan of a run."""
    return sum(a.gear != b.gear for mission in run.plan.missions for a, b in pairwise(mission.legs))


def find_left_out_ground(context: PlanningContext) -> shapely.Geometry:
    """The ground of lines that were to be left out, as far as no other line covers it."""
    wishes = context.request.line_wishes
    if not wishes.left_out:
        return shapely.Polygon()
    moves = get_site_moves(context)
    out = set(wishes.find_left_out(moves.lines))
    sides = [[line for number, line in enumerate(moves.lines) if (number in out) == is_out] for is_out in (True, False)]
    left, worked = (unite_strips(moves.site, lines) for lines in sides)
    return extract_polygons(subtract_on_grid(left, worked))


def measure_left_out_m2(context: PlanningContext) -> float:
    """The ground that was to be left out; 0 without such a wish."""
    wishes = context.request.line_wishes
    if not wishes.left_out:
        return 0.0
    lines = get_site_moves(context).lines
    return math.fsum(lines[number].own_m2 for number in wishes.find_left_out(lines))
