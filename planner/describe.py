"""A field in figures: what it is, how tracks lie on it, what turns fit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import shapely

from fields.guidance import GuidanceLine
from fields.headlands import HeadlandEdge
from fields.layout import Layout
from fields.obstacles import LINE, POINT, Obstacle
from planner.drive import besides_cut_off, rings_of, still
from planner.ground.overlays import GRID_M
from planner.ground.unworked import LEAST_M2, Unworked, laid, unworked
from planner.site import Site
from reports.results import Drive, MissedPiece
from strategies.job import Pass
from strategies.ways.connect import Connector
from strategies.ways.paths import Pose

MOST_ENDS = 60


def describe(site: Site) -> dict[str, Any]:
    """Facts in the order a person would ask for them, units in the keys.

    Lists hold mappings with the same keys: ``obstacles``, ``lines``, ``headlands``, ``cells``, ``rounds`` and
    ``not_worked``.
    """
    layout, field, manner = site.layout, site.layout.field, site.manner
    lengths = [track.length for track in layout.tracks]
    return {
        "name": field.name,
        "source": field.source,
        "area_ha": round(field.area_ha, 4),
        "holes": len(field.ground.interiors),
        "obstacles": [_obstacle(one, site) for one in field.obstacles],
        "driven_round": len(field.small),
        "cut_off_m2": round(field.cut_off_m2, 1),
        "fence_m": round(sum(fence.length for fence in field.fences), 1),
        "lines": [_line(one) for one in field.lines],
        "headlands": [_headland(one) for one in field.headlands],
        "crs": field.crs or "local metres",
        "bearing_deg": round(layout.bearing_deg, 2),
        "cells": cells(layout),
        "headland_m": layout.headland_m,
        "rounds": _rounds(site),
        "tracks": len(lengths),
        "interrupted_tracks": len(lengths) - len({track.line for track in layout.tracks}),
        "longest_track_m": round(max(lengths), 1),
        "shortest_track_m": round(min(lengths), 1),
        "track_length_m": round(sum(lengths), 1),
        "turning_radius_m": round(manner.radius_m, 2),
        "most_tractors": min(50, len({track.line for track in layout.tracks})),
        "covered_pct": round(100.0 * _covered(site), 2),
        "not_worked": [_not_worked(site, one) for one in unworked(site)],
        "turns": _turns(site),
    }


def cells(layout: Layout) -> list[dict[str, float]]:
    """The cells of a layout in order of their numbers."""
    return [
        {
            "number": cell.number,
            "bearing_deg": round(cell.bearing_deg, 2),
            "area_m2": round(cell.area_m2, 1),
            "tracks": sum(track.cell == cell.number for track in layout.tracks),
        }
        for cell in layout.cells
    ]


def _line(one: GuidanceLine) -> dict[str, Any]:
    """A guidance line that came with the field."""
    return {"name": one.name, "bearing_deg": round(one.bearing_deg, 2), "length_m": round(float(one.line.length), 1)}


def _headland(one: HeadlandEdge) -> dict[str, Any]:
    """A headland that came with the field: how far its inner edge is from the boundary, and how long it is."""
    return {
        "usual_width_m": round(one.usual_m, 2),
        "least_width_m": round(one.least_m, 2),
        "most_width_m": round(one.most_m, 2),
        "edge_m": round(float(one.line.length), 1),
    }


def _obstacle(one: Obstacle, site: Site) -> dict[str, Any]:
    """What stands where: kind, name, size and the margin that is kept to it."""
    form = one.geometry.geom_type
    place = shapely.point_on_surface(one.geometry)
    return {
        "kind": one.kind,
        "name": one.name or None,
        "radius_m": round(one.half_m, 3) if form == POINT else None,
        "width_m": round(2.0 * one.half_m, 3) if form == LINE else None,
        "area_m2": round(one.shape.area, 2),
        "margin_m": site.scenario.margin_m,
        "driven_round": any(shapely.intersects(place, small) for small in site.layout.field.small),
        **_place(site, place.x, place.y),
    }


def _place(site: Site, x: float, y: float) -> dict[str, float | None]:
    """A place in metres of the field and, where it has one, on the earth."""
    field = site.layout.field
    lon, lat = (None, None) if field.crs is None else field.to_wgs84([(x, y)])[0].tolist()
    return {"lon": lon, "lat": lat, "x_m": round(x, 2), "y_m": round(y, 2)}


def _rounds(site: Site) -> list[dict[str, Any]]:
    """The rounds of the headland, by number: how many rings and lines, how long together, how many corners."""
    return [
        {
            "number": number,
            "rings": sum(one.closed for one in alike),
            "lines": sum(not one.closed for one in alike),
            "length_m": round(math.fsum(one.length_m for one in alike), 1),
            "corners": sum(abs(side.before_rad) > 0.0 for one in alike for side in one.sides),
        }
        for number in sorted({one.number for one in site.rounds})
        if (alike := [one for one in site.rounds if one.number == number])
    ]


def _covered(site: Site) -> float:
    """Share of the field under tracks and rounds as they are laid."""
    whole = site.layout.field.whole
    return float(shapely.intersection(laid(site), whole, grid_size=GRID_M).area / whole.area)


def _not_worked(site: Site, one: Unworked) -> dict[str, Any]:
    """Ground that stays open for one reason, and where the largest piece of it is."""
    place = shapely.point_on_surface(one.pieces[0]) if one.pieces else None
    return {
        "area_m2": round(one.m2, 1),
        "pieces": len(one.pieces) or None,
        "largest_m2": round(one.pieces[0].area, 1) if one.pieces else None,
        **(dict.fromkeys(("lon", "lat", "x_m", "y_m")) if place is None else _place(site, place.x, place.y)),
        "why": one.why,
    }


def _turns(site: Site) -> dict[str, Any]:
    """Which turns fit and how long they take, per number of tracks they lead over.

    A kind fits where it can be driven between the ends of tracks of this field without leaving it; given is the share
    of the ends, up to `MOST_ENDS` spread over the field. The seconds are simulated in a headland met squarely. Where
    no turn fits that, there is nothing to simulate; the estimate that orders of tracks are compared by stands apart.
    """
    fitting = {str(lines): _fitting(site, lines) for lines in range(1, len(site.manner.turn_s))}
    return {
        "omega_fits": any("omega" in kinds for kinds in fitting.values()),
        "fits_percent_of_ends_over_tracks": fitting,
        "seconds_over_tracks": _seconds(site, fits=True),
        "estimated_seconds_where_no_turn_fits": _seconds(site, fits=False),
    }


def _fitting(site: Site, lines: int) -> dict[str, float]:
    """Percent of the ends of tracks from which a turn of a kind leads over so many lines; only kinds that ever do."""
    ends = _ends(site, lines)
    shares = {}
    for kind in site.kinds:
        connector = Connector(site.free, site.manner.radius_m, site.costs, (kind,))
        ways = [connector.direct(a, b) for a, b in ends]
        shares[kind] = 100.0 * sum(way is not None and way.kind == kind for way in ways) / max(len(ends), 1)
    return {kind: round(share, 1) for kind, share in shares.items() if share}


def _ends(site: Site, lines: int) -> list[tuple[Pose, Pose]]:
    """From where to where a turn leads over so many lines, to either side at both ends of every piece."""
    job = site.job(1)
    by_place = {(track.cell, track.line, track.piece): track for track in site.layout.tracks}
    ends = [
        (job.exit(Pass(track, way)), job.entry(Pass(other, -way)))
        for track in site.layout.tracks
        for step in (lines, -lines)
        for way in (1, -1)
        if (other := by_place.get((track.cell, track.line + step, track.piece)))
    ]
    return ends[:: max(1, math.ceil(len(ends) / MOST_ENDS))]


def _seconds(site: Site, *, fits: bool) -> dict[str, float]:
    return {
        str(lines): round(seconds, 1)
        for lines, (seconds, fitting) in enumerate(zip(site.manner.turn_s, site.turn_fits, strict=True))
        if lines and fitting is fits
    }


def outline_picture(site: Site) -> Drive:
    """The field with its rounds, cells and tracks and no tractor; what they leave open is missed ground."""
    layout = site.layout
    open_ground = [piece for one in unworked(site) for piece in one.pieces if piece.area >= LEAST_M2]
    open_ground.sort(key=lambda piece: -round(piece.area, 3))
    place = shapely.point_on_surface(open_ground[0]) if open_ground else None
    bearing = f"{layout.bearing_deg:.0f} degrees" if len(layout.cells) == 1 else f"{len(layout.cells)} bearings"
    largest = place and MissedPiece(float(open_ground[0].area), float(place.x), float(place.y))
    return replace(
        still(site, f"{layout.field.name}: {len(layout.tracks)} tracks at {bearing}"),
        missed=rings_of(tuple(open_ground)),
        largest_missed=besides_cut_off(largest, layout.field),
    )
