"""What a picture of a field or a run needs, as plain arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from fields.cells import Cell
from fields.field import Field
from fields.rounds import Round
from planner.ground.measure import coverage, guided_point
from planner.site import Site
from planner.steps import steps_of, track_names
from reports.results import CellOutline, Drive, MissedPiece, PlanResult, Points, RoundLine
from vehicle.run import Run

MISSED_TO_M = 0.1  # of what is left open, a picture needs no more
ASIDE_M = 0.5  # so far beside ground that is cut off a place on it may be told


def still(site: Site, title: str) -> Drive:
    """The field with its rounds, cells and tracks, and no tractor."""
    layout = site.layout
    boundary = layout.field.outline or layout.field.boundary
    return Drive(
        title=title,
        boundary=np.asarray(boundary.exterior.coords)[:, :2],
        holes=tuple(np.asarray(hole.coords)[:, :2] for hole in boundary.interiors),
        tracks=np.array([[track.start, track.end] for track in layout.tracks]),
        width_m=layout.width_m,
        step_s=0.1,
        xy=(),
        status=(),
        finish_s=(),
        seconds={"working": (), "turning": (), "waiting": (), "reversing": ()},
        entrance=layout.field.entrance,
        track_names=track_names((track.line, track.piece) for track in layout.tracks),
        rounds=tuple(_round_line(one) for one in site.rounds),
        cells=tuple(_outline(cell) for cell in layout.cells) if len(layout.cells) > 1 else (),
        obstacles=_obstacles(layout.field),
        fences=tuple(np.asarray(fence.coords)[:, :2] for fence in layout.field.fences),
        cut_off=tuple(_cut_off(part) for part in layout.field.cut_off),
    )


def picture(site: Site, run: Run, result: PlanResult) -> Drive:
    """Plain arrays of the run of a plan on its field."""
    plural = "s" if result.tractors > 1 else ""
    shares = run.time_shares()
    return replace(
        still(site, f"{result.strategy}, {result.tractors} tractor{plural}, turns: {result.turn}"),
        step_s=float(run.time_s[1] - run.time_s[0]),
        xy=tuple(guided_point(run, site, tractor) for tractor in range(run.plan.tractors)),
        status=tuple(run.status(tractor) for tractor in range(run.plan.tractors)),
        finish_s=tuple(float(t) for t in run.finish_s),
        seconds={name: tuple(float(v) for v in values) for name, values in shares.items()} | _refilling(site, run),
        missed=rings_of(coverage(run, site).missed),
        largest_missed=besides_cut_off(result.largest_missed, site.layout.field),
        steps=steps_of(run, site.layout.width_m),
        worked_pct=result.worked_pct,
    )


def _refilling(site: Site, run: Run) -> dict[str, tuple[float, ...]]:
    """Seconds of every tractor at which its tank was filled or emptied; nothing where nothing is carried."""
    return {} if site.supply is None else {"refilling": tuple(float(seconds) for seconds in run.standing_s)}


def _cut_off(part: shapely.Polygon) -> MissedPiece:
    place = shapely.point_on_surface(part)
    return MissedPiece(float(part.area), float(place.x), float(place.y))


def besides_cut_off(largest: MissedPiece | None, field: Field) -> MissedPiece | None:
    """The largest missed piece; None where most of that is ground that obstacles cut off, which is named for itself.

    Its place may lie beside that ground, on the margin to the obstacles.
    """
    if largest is None:
        return None
    place = shapely.Point(largest.x_m, largest.y_m)
    aside_m = max(ASIDE_M, float(shapely.distance(field.ground, place)))
    cut_off_m2 = sum(part.area for part in field.cut_off if shapely.dwithin(part, place, aside_m))
    return None if cut_off_m2 >= 0.5 * largest.m2 else largest


def _obstacles(field: Field) -> tuple[Points, ...]:
    """Outlines of obstacles as far as they lie on the map of the field."""
    page = shapely.box(*(field.outline or field.boundary).bounds)
    parts = shapely.get_parts([shapely.intersection(one.shape, page) for one in field.obstacles])
    return tuple(np.asarray(part.exterior.coords)[:-1, :2] for part in parts if part.area > 0.0)


def _round_line(one: Round) -> RoundLine:
    sides = [side.points if not index else side.points[1:] for index, side in enumerate(one.sides)]
    return RoundLine(one.number, np.concatenate(sides))


def _outline(cell: Cell) -> CellOutline:
    place = shapely.point_on_surface(cell.region)
    parts = shapely.get_parts(cell.region)
    return CellOutline(cell.number, cell.bearing_deg, rings_of(tuple(parts)), float(place.x), float(place.y))


def rings_of(pieces: tuple[shapely.Polygon, ...]) -> tuple[Points, ...]:
    """Outlines and holes of pieces of ground, plain enough to be drawn."""
    plain = (orient(piece.simplify(MISSED_TO_M), 1.0) for piece in pieces)
    return tuple(np.asarray(ring.coords)[:-1, :2] for one in plain for ring in (one.exterior, *one.interiors))
