"""A field in figures: what it is, how tracks lie on it, what turns fit."""

from __future__ import annotations

from typing import Any

import numpy as np

from planner.site import Site
from reports.results import Drive
from strategies.turns import turn_depth


def describe(site: Site) -> dict[str, Any]:
    """Facts in the order a person would ask for them, units in the keys."""
    layout, field, manner = site.layout, site.layout.field, site.manner
    lengths = [track.length for track in layout.tracks]
    room = layout.headland_m - manner.tool_m - 0.5 * max(layout.width_m, site.tractor.width_m)
    return {
        "name": field.name,
        "source": field.source,
        "area_ha": round(field.area_ha, 4),
        "holes": len(field.boundary.interiors),
        "crs": field.crs or "local metres",
        "bearing_deg": round(layout.bearing_deg, 2),
        "headland_m": layout.headland_m,
        "tracks": len(lengths),
        "interrupted_tracks": len(lengths) - len({track.line for track in layout.tracks}),
        "longest_track_m": round(max(lengths), 1),
        "shortest_track_m": round(min(lengths), 1),
        "track_length_m": round(sum(lengths), 1),
        "turning_radius_m": round(manner.radius_m, 2),
        "most_tractors": min(50, len({track.line for track in layout.tracks})),
        "turns": _turns(site, room),
    }


def _turns(site: Site, room_m: float) -> dict[str, Any]:
    """Whether an omega between neighbours fits; and per number of tracks a turn leads over, its simulated seconds.

    Where no turn fits the headland there is nothing to simulate; the estimate that orders of tracks are compared by
    stands apart.
    """
    radius, width = site.manner.radius_m, site.layout.width_m
    omega_fits = width >= 2 * radius or turn_depth("omega", width, radius) <= room_m
    return {
        "omega_fits": bool(omega_fits),
        "seconds_over_tracks": _seconds(site, fits=True),
        "estimated_seconds_where_no_turn_fits": _seconds(site, fits=False),
    }


def _seconds(site: Site, *, fits: bool) -> dict[str, float]:
    return {
        str(lines): round(seconds, 1)
        for lines, (seconds, fitting) in enumerate(zip(site.manner.turn_s, site.turn_fits, strict=True))
        if lines and fitting is fits
    }


def outline_picture(site: Site) -> Drive:
    """The field with its tracks and no tractor."""
    boundary, layout = site.layout.field.boundary, site.layout
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
