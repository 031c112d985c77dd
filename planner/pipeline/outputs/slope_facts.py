"""Heights and slopes of a field in figures for `headland field`."""

from __future__ import annotations

from typing import Any

from fields.geometry.field import Field
from fields.terrain.elevation_grid import ElevationGrid
from fields.terrain.slopes import summarise_slopes


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
