"""A field in figures for `headland field`, and the plain arrays that pictures of a field or a run need."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from fields.arrays import Floats
from fields.geometry.field import MIN_REPORTED_M2, Field
from fields.geometry.obstacles import LINE, POINT, Obstacle
from fields.geometry.overlays import intersect_on_grid
from fields.layout.cells import Cell
from fields.layout.swaths import Layout
from fields.terrain.elevation_grid import ElevationGrid
from fields.terrain.slopes import (
    choose_contour_interval_m,
    compute_gradients,
    compute_hill_shade,
    summarise_slopes,
    trace_contours,
)
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import compute_guided_path, measure_coverage
from planner.evaluation.ground.unworked_area import UnworkedArea, find_unworked_areas
from planner.evaluation.site import get_site_moves
from planner.pipeline.outputs.driving_steps import delay_steps, list_steps
from planner.pipeline.outputs.step_measures import measure_steps
from planner.request.option_texts import MAX_TRACTORS
from reports.common.plan_records import CellOutline, HeadlandPassLine, PlanDrive, Relief, UnworkedPiece
from reports.common.plan_results import PlanRanking, PlanResult
from reports.plan.drive_geometry import FOLDING_STATE, FOLDING_STATUS, SERVICE_STATE
from strategies.lines.lay_lines import LEFTOVER
from strategies.lines.line_wishes import name_line
from strategies.lines.work_line import WorkLine
from strategies.moves.move_finder import MoveFinder
from vehicle.missions.plan import HEADLAND_PASS, SWATH
from vehicle.missions.run import SimulationRun

USUAL_SHARE, SHADED_SLOPE, MIN_SHADED_SLOPE = 0.9, 0.5, 0.005
"""Heights are exaggerated so that nine tenths of the slopes look no steeper than this; below the last they are flat."""
MAX_SHADE_PIXELS = 300
CUT_OFF_TOLERANCE_M = 0.5  # the place of a piece may lie this far beside the cut-off ground it is part of
MAX_ENDS = 60


def build_field_picture(context: PlanningContext, title: str, lines: Sequence[WorkLine]) -> PlanDrive:
    """The field with its headland passes, cells and the swaths among work lines, without tractors."""
    layout = context.layout
    swaths = [line for line in lines if line.task.kind == SWATH]
    boundary = layout.field.whole_boundary
    return PlanDrive(
        title=title,
        boundary=np.asarray(boundary.exterior.coords)[:, :2],
        holes=tuple(np.asarray(hole.coords)[:, :2] for hole in boundary.interiors),
        swaths=[line.tool_path for line in swaths],
        width_m=layout.width_m,
        step_s=0.1,
        xy=(),
        status=(),
        finish_s=(),
        seconds={"working": (), "turning": (), "waiting": (), "reversing": ()},
        entrance=layout.field.entrance,
        swath_names=tuple(name_line(line.task) for line in swaths),
        headland_passes=(
            *(
                HeadlandPassLine(
                    one.number, np.concatenate([side.points[min(at, 1) :] for at, side in enumerate(one.sides)])
                )
                for one in context.headland_passes
            ),
            *(HeadlandPassLine(0, line.tool_path) for line in lines if line.group[0] == LEFTOVER),  # of no pass
        ),
        headland_sides=tuple(
            HeadlandPassLine(line.task.number or 0, line.tool_path, name_line(line.task))
            for line in lines
            if line.task.kind == HEADLAND_PASS
        ),
        cells=tuple(_build_cell_outline(cell) for cell in layout.cells) if len(layout.cells) > 1 else (),
        obstacles=_outline_obstacles(layout.field),
        fences=tuple(np.asarray(fence.coords)[:, :2] for fence in layout.field.fences),
        cut_off=tuple(_build_piece(part) for part in layout.field.cut_off_parts),
        crs=layout.field.crs,
        origin_m=layout.field.origin_m,
        relief=_build_relief(context),
        done=() if layout.field.done is None else list_simplified_rings(tuple(shapely.get_parts(layout.field.done))),
    )


def _build_relief(context: PlanningContext) -> Relief | None:
    """Shading and contours of the heights of a field; None for level ground."""
    grid = context.physics.elevation
    if grid is None:
        return None
    slopes = np.hypot(*np.moveaxis(compute_gradients(grid), -1, 0))
    usual = max(float(np.quantile(slopes, USUAL_SHARE)), MIN_SHADED_SLOPE)
    shade = compute_hill_shade(grid, max(1.0, SHADED_SLOPE / usual))
    step = math.ceil(max(shade.shape) / MAX_SHADE_PIXELS)
    shade = shade[::step, ::step]
    interval_m = choose_contour_interval_m(grid, context.layout.field.boundary)
    west, south, half_m = grid.west_m, grid.south_m, 0.5 * step * grid.spacing_m
    rows, columns = shade.shape
    east, north = west + (columns - 1) * step * grid.spacing_m, south + (rows - 1) * step * grid.spacing_m
    bounds = west - half_m, south - half_m, east + half_m, north + half_m
    return Relief(shade, bounds, tuple(trace_contours(grid, interval_m)), interval_m)


def build_run_picture(context: PlanningContext, run: SimulationRun, result: PlanResult) -> PlanDrive:
    """The run of a plan on its field, as plain arrays."""
    title = f"{result.strategy}, {result.tractors} tractor{'s' if result.tractors > 1 else ''}, turns: {result.turn}"
    worked = {leg.task for mission in run.plan.missions for leg in mission.legs if leg.task.is_work}
    measures = measure_steps(run, context.tractor, context.physics)
    steps = list_steps(run, context.layout.width_m, measures, operation=context.request.operation)
    seconds = run.sum_seconds_by_status() | ({} if context.supply is None else {SERVICE_STATE: run.standing_s})
    if run.folding_s.any():
        seconds |= {"turning": seconds["turning"] - run.folding_s, FOLDING_STATE: run.folding_s}
    return replace(
        build_field_picture(context, title, [line for line in get_site_moves(context).lines if line.task in worked]),
        step_s=float(run.time_s[1] - run.time_s[0]),
        xy=tuple(compute_guided_path(run, context, tractor) for tractor in range(run.plan.tractors)),
        status=tuple(
            np.where(run.find_folding_rows(tractor), FOLDING_STATUS, run.get_statuses(tractor))
            for tractor in range(run.plan.tractors)
        ),
        finish_s=tuple(float(t) for t in run.finish_s),
        seconds={name: tuple(float(v) for v in values) for name, values in seconds.items()},
        unworked=list_simplified_rings(measure_coverage(run, context).unworked_pieces),
        largest_missed=exclude_cut_off_piece(result.largest_missed, context.layout.field),
        missed_m2=result.due_missed_m2,
        steps=delay_steps(steps, context.workday),
        worked_pct=result.worked_pct,
        stated_end_s=result.stated_end_s,
        has_delays=result.p50_s is not None,
        headland_order=result.headland_order,
        start=context.request.format_clock_after(0.0) or None,
        service="unload" if run.plan.notes.collects else run.plan.notes.service,
    )


def build_refused_picture(context: PlanningContext, ranking: PlanRanking) -> PlanDrive:
    """The field with its layout, where no plan works: the places where plans fail are marked."""
    places = {(round(one.x_m, 1), round(one.y_m, 1)) for plan in ranking.plans for one in plan.faults}
    picture = build_field_picture(context, f"{context.layout.field.name}: no plan works", get_site_moves(context).lines)
    return replace(picture, fault_places=tuple(sorted(places)))


def _build_piece(part: shapely.Polygon) -> UnworkedPiece:
    """A piece of ground with a place in it."""
    place = shapely.point_on_surface(part)
    return UnworkedPiece(float(part.area), float(place.x), float(place.y))


def exclude_cut_off_piece(largest_piece: UnworkedPiece | None, field: Field) -> UnworkedPiece | None:
    """The largest missed piece; None if most of it is ground cut off by obstacles, which is reported separately.

    The place of the piece may lie beside that ground, on the margin to the obstacles.
    """
    if largest_piece is None:
        return None
    place = shapely.Point(largest_piece.x_m, largest_piece.y_m)
    aside_m = max(CUT_OFF_TOLERANCE_M, float(shapely.distance(field.workable_region, place)))
    cut_off_m2 = sum(part.area for part in field.cut_off_parts if shapely.dwithin(part, place, aside_m))
    return None if cut_off_m2 >= 0.5 * largest_piece.m2 else largest_piece


def _outline_obstacles(field: Field) -> tuple[Floats, ...]:
    """Outlines of obstacles, clipped to the map of the field."""
    page = field.whole_boundary.bounds
    parts = shapely.get_parts([shapely.clip_by_rect(one.shape, *page) for one in field.obstacles])
    return tuple(np.asarray(part.exterior.coords)[:-1, :2] for part in parts if part.area > 0.0)


def _build_cell_outline(cell: Cell) -> CellOutline:
    place = shapely.point_on_surface(cell.region)
    parts = shapely.get_parts(cell.region)
    return CellOutline(
        cell.number, cell.bearing_deg, list_simplified_rings(tuple(parts)), float(place.x), float(place.y)
    )


def list_simplified_rings(pieces: tuple[shapely.Polygon, ...]) -> tuple[Floats, ...]:
    """Outlines and holes of pieces of ground, simplified for drawing."""
    plain = (orient(piece.simplify(0.1), 1.0) for piece in pieces)  # a picture needs no finer
    return tuple(np.asarray(ring.coords)[:-1, :2] for one in plain for ring in (one.exterior, *one.interiors))


def describe_field(context: PlanningContext) -> dict[str, Any]:
    """Facts of a field in the order a person would ask for them, units in the keys.

    Lists hold mappings with the same keys: ``obstacles``, ``lines``, ``headlands``, ``cells``, ``headland_passes`` and
    ``unworked``.
    """
    layout, field, driving_rules = context.layout, context.layout.field, context.driving_rules
    lengths, ground = [swath.length_m for swath in layout.swaths], field.region_without_obstacles
    covered = intersect_on_grid(get_site_moves(context).covered_ground, ground)
    return {
        "name": field.name,
        "source": field.source,
        "area_ha": round(field.area_ha, 4),
        "holes": len(field.workable_region.interiors),
        "obstacles": [_describe_obstacle(one, context) for one in field.obstacles],
        "bypassed": len(field.small_obstacles),
        "cut_off_m2": round(field.cut_off_m2, 1),
        "fence_m": round(sum(fence.length for fence in field.fences), 1),
        "lines": [
            {"name": one.name, "bearing_deg": round(one.bearing_deg, 2), "length_m": round(float(one.line.length), 1)}
            for one in field.guidance_lines
        ],
        "headlands": [  # of the field file: distances of their inner edges from the boundary, and their lengths
            {
                "typical_width_m": round(one.median_width_m, 2),
                "min_width_m": round(one.min_width_m, 2),
                "max_width_m": round(one.max_width_m, 2),
                "edge_m": round(float(one.line.length), 1),
            }
            for one in field.headland_edges
        ],
        "crs": field.crs or "local metres",
        "bearing_deg": round(layout.bearing_deg, 2),
        "cells": describe_cells(layout),
        "headland_m": layout.headland_m,
        "headland_passes": _describe_headland_passes(context),
        "swaths": len(lengths),
        "interrupted_swaths": len(lengths) - layout.track_count,
        "longest_swath_m": round(max(lengths, default=0.0), 1),
        "shortest_swath_m": round(min(lengths, default=0.0), 1),
        "swath_length_m": round(sum(lengths), 1),
        "turning_radius_m": round(driving_rules.radius_m, 2),
        "max_tractors": min(MAX_TRACTORS, layout.track_count or len(get_site_moves(context).lines)),
        "covered_pct": round(100.0 * float(covered.area / ground.area), 2),
        "unworked": [_describe_unworked(context, one) for one in find_unworked_areas(context)],
        **describe_slopes(context.physics.elevation, field),
        "turns": _describe_turns(context),
    }


def describe_cells(layout: Layout) -> list[dict[str, float]]:
    """The cells of a layout in order of their numbers."""
    return [
        {
            "number": cell.number,
            "bearing_deg": round(cell.bearing_deg, 2),
            "area_m2": round(cell.area_m2, 1),
            "swaths": sum(swath.cell_number == cell.number for swath in layout.swaths),
        }
        for cell in layout.cells
    ]


def _describe_obstacle(obstacle: Obstacle, context: PlanningContext) -> dict[str, Any]:
    """An obstacle: number in its file, kind, name, size, place and the margin kept to it."""
    form = obstacle.geometry.geom_type
    place = shapely.point_on_surface(obstacle.geometry)
    return {
        "number": obstacle.number,
        "kind": obstacle.kind,
        "name": obstacle.name or None,
        "radius_m": round(obstacle.half_width_m, 3) if form == POINT else None,
        "width_m": round(2.0 * obstacle.half_width_m, 3) if form == LINE else None,
        "area_m2": round(obstacle.shape.area, 2),
        "margin_m": context.request.margin_m,
        "bypassed": any(shapely.intersects(place, small) for small in context.layout.field.small_obstacles),
        **_describe_place(context, place.x, place.y),
    }


def _describe_place(context: PlanningContext, x: float, y: float) -> dict[str, float | None]:
    """A place in metres of the field and, if the field has a coordinate system, in degrees."""
    field = context.layout.field
    lon, lat = (None, None) if field.crs is None else field.to_wgs84([(x, y)])[0].tolist()
    return {"lon": lon, "lat": lat, "x_m": round(x, 2), "y_m": round(y, 2)}


def _describe_headland_passes(context: PlanningContext) -> list[dict[str, Any]]:
    """The headland passes by number: rings, open lines, total length and corners."""
    return [
        {
            "number": number,
            "rings": sum(one.is_closed for one in same_number),
            "lines": sum(not one.is_closed for one in same_number),
            "length_m": round(math.fsum(one.length_m for one in same_number), 1),
            "corners": sum(abs(side.start_turn_rad) > 0.0 for one in same_number for side in one.sides),
        }
        for number in sorted({one.number for one in context.headland_passes})
        if (same_number := [one for one in context.headland_passes if one.number == number])
    ]


def _describe_unworked(context: PlanningContext, area: UnworkedArea) -> dict[str, Any]:
    """Ground unworked for one reason, and where its largest piece is."""
    place = shapely.point_on_surface(area.pieces[0]) if area.pieces else None
    return {
        "area_m2": round(area.area_m2, 1),
        "pieces": len(area.pieces) or None,
        "largest_m2": round(area.pieces[0].area, 1) if area.pieces else None,
        **(
            dict.fromkeys(("lon", "lat", "x_m", "y_m")) if place is None else _describe_place(context, place.x, place.y)
        ),
        "reason": area.reason,
    }


def _describe_turns(context: PlanningContext) -> dict[str, Any]:
    """Which turns fit and how long they take, by the number of swaths they lead over.

    A kind of turn fits at the end of a swath if the machine has room for it; the share is of up to MAX_ENDS ends spread
    over the field. Seconds are simulated for a headland at right angles to the swaths. Where no turn fits there, the
    estimate used for comparing orders of swaths is given separately.
    """
    most = min(len(context.driving_rules.turn_s), context.layout.track_count)
    fitting = {str(lines): _compute_fitting_pct(context, lines) for lines in range(1, most)}
    return {
        "omega_fits": any("omega" in kinds for kinds in fitting.values()),
        "fitting_pct_by_swaths": fitting,
        "turn_s_by_swaths": _list_turn_seconds(context, fits=True),
        "estimated_turn_s_by_swaths": _list_turn_seconds(context, fits=False),
    }


def _compute_fitting_pct(context: PlanningContext, lines: int) -> dict[str, float]:
    """Percent of swath ends, to either side, where a turn of each kind over this many lines fits; only kinds that fit
    somewhere."""
    moves = get_site_moves(context)
    tasks = [line.task for line in moves.lines]
    by_place = {(task.number or 0, task.piece): k for k, task in enumerate(tasks) if task.kind == SWATH}
    ends = [
        (moves.ends[2 * number + way], moves.begins[2 * target + 1 - way])
        for (swath, piece), number in by_place.items()
        for step in (lines, -lines)
        for way in (0, 1)
        if (target := by_place.get((swath + step, piece))) is not None
    ]
    ends, shares = ends[:: max(1, math.ceil(len(ends) / MAX_ENDS))], {}
    for kind in context.turn_kinds:
        finder = MoveFinder(replace(moves.site, turn_kinds=(kind,)), moves.finder.settling)
        fitting = sum(any(move.kind == kind for move in finder.list_moves(a, b)) for a, b in ends)
        shares[kind] = 100.0 * fitting / max(len(ends), 1)
    return {kind: round(share, 1) for kind, share in shares.items() if share}


def _list_turn_seconds(context: PlanningContext, *, fits: bool) -> dict[str, float]:
    return {
        str(lines): round(seconds, 1)
        for lines, (seconds, fitting) in enumerate(
            zip(context.driving_rules.turn_s, context.fitting_turns, strict=True)
        )
        if 0 < lines < context.layout.track_count and fitting is fits
    }


def build_outline_picture(context: PlanningContext) -> PlanDrive:
    """The field with its layout, without tractors; ground that the layout leaves unworked is shown as missed."""
    layout = context.layout
    unworked = [piece for one in find_unworked_areas(context) for piece in one.pieces if piece.area >= MIN_REPORTED_M2]
    unworked.sort(key=lambda piece: -round(piece.area, 3))
    largest = _build_piece(unworked[0]) if unworked else None
    bearing = f"{layout.bearing_deg:.0f} degrees" if len(layout.cells) == 1 else f"{len(layout.cells)} bearings"
    title = f"{layout.field.name}: {f'tracks at {bearing}' if layout.cells else 'headland passes'}"
    return replace(
        build_field_picture(context, title, get_site_moves(context).lines),
        unworked=list_simplified_rings(tuple(unworked)),
        largest_missed=exclude_cut_off_piece(largest, layout.field),
    )


def describe_slopes(elevation: ElevationGrid | None, field: Field) -> dict[str, Any]:
    """Facts on the slopes of the ground outside of obstacles, units in the keys; empty without heights.

    `steepest_at` is longitude and latitude, or x and y of a field in local metres; `aspect_deg` is the bearing in which
    the field falls as a whole, with the share of its slopes that this explains.
    """
    summary = None if elevation is None else summarise_slopes(elevation, field.region_without_obstacles)
    if elevation is None or summary is None:
        return {}
    x, y = summary.steepest_place_m
    place = (
        [round(x, 1), round(y, 1)] if field.crs is None else [round(v, 6) for v in field.to_wgs84([[x, y]])[0].tolist()]
    )
    return {
        "heights": elevation.source,
        "lowest_m": round(summary.lowest_m, 2),
        "highest_m": round(summary.highest_m, 2),
        "median_slope_pct": round(100.0 * summary.median, 2),
        "p90_slope_pct": round(100.0 * summary.p90, 2),
        "steepest_slope_pct": round(100.0 * summary.steepest, 2),
        "steepest_at": place,
        "aspect_deg": None if summary.aspect_deg is None else round(summary.aspect_deg, 1),
        "aspect_share_pct": round(100.0 * summary.aspect_share, 1),
    }
