"""A field in figures: what it is, how tracks lie on it, what turns fit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fields.layout import Layout
from planner.site import Site
from reports.results import Drive
from strategies.connect import Connector
from strategies.job import Pass
from strategies.paths import Pose

MOST_ENDS = 60


def describe(site: Site) -> dict[str, Any]:
    """Facts in the order a person would ask for them, units in the keys."""
    layout, field, manner = site.layout, site.layout.field, site.manner
    lengths = [track.length for track in layout.tracks]
    return {
        "name": field.name,
        "source": field.source,
        "area_ha": round(field.area_ha, 4),
        "holes": len(field.ground.interiors),
        "obstacles": [f"{one.name or one.kind}: {one.shape.area:.3g} m2" for one in field.obstacles],
        "crs": field.crs or "local metres",
        "bearing_deg": round(layout.bearing_deg, 2),
        "cells": cells(layout),
        "headland_m": layout.headland_m,
        "rounds": layout.rounds,
        "tracks": len(lengths),
        "interrupted_tracks": len(lengths) - len({track.line for track in layout.tracks}),
        "longest_track_m": round(max(lengths), 1),
        "shortest_track_m": round(min(lengths), 1),
        "track_length_m": round(sum(lengths), 1),
        "turning_radius_m": round(manner.radius_m, 2),
        "most_tractors": min(50, len({track.line for track in layout.tracks})),
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
    """The field with its tracks and no tractor."""
    boundary, layout = site.layout.field.ground, site.layout
    return Drive(
        title=f"{layout.field.name}: {len(layout.tracks)} tracks at {layout.bearing_deg:.0f} degrees",
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
    )
