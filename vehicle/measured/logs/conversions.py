"""Columns in other units, signs and axes, converted on request to those of the contract."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from vehicle.measured.errors import LogError
from vehicle.measured.logs.record import STEERING, Array, Fix, Log

Columns = dict[str, Array]
Place = tuple[float, float]

_EARTH_M, _FLATTENING = 6378137.0, 1.0 / 298.257223563  # WGS 84


def apply_fixes(columns: Columns, fixes: frozenset[Fix], reference: Place | None = None) -> Columns:
    """Columns in the contract's units and signs.

    Fixes are applied in the order of Fix. `reference` is the longitude and latitude (deg), in this order whatever the
    order of the columns, that become the origin of positions given in degrees; without it the first position is.
    """
    out = dict(columns)
    for fix in Fix:
        if fix not in fixes:
            continue
        if fix is Fix.EAST_NORTH_SWAPPED:
            out |= {"easting_m": out["northing_m"], "northing_m": out["easting_m"]}
            continue
        if fix is Fix.POSITION_DEGREES:
            out |= _local_metres(out, reference or first_place(out))
            continue
        names, convert = _CONVERSIONS[fix]
        out |= {name: convert(out[name]) for name in names if name in out}
    return out


def _ccw_from(zero_deg: float) -> Callable[[Array], Array]:
    return lambda heading: np.mod(zero_deg - heading, 360.0)


def _from_kmh(values: Array) -> Array:
    return values / 3.6


_CONVERSIONS: dict[Fix, tuple[tuple[str, ...], Callable[[Array], Array]]] = {
    Fix.TIME_MS: (("time_s",), lambda values: values / 1000.0),
    Fix.POSITION_KM: (("easting_m", "northing_m"), lambda values: values * 1000.0),
    Fix.SPEED_KMH: (("speed_mps", "speed_command_mps"), _from_kmh),
    Fix.SPEED_MEASURED_KMH: (("speed_mps",), _from_kmh),
    Fix.SPEED_COMMAND_KMH: (("speed_command_mps",), _from_kmh),
    Fix.HEADING_RADIANS: (("heading_deg",), np.degrees),
    Fix.HEADING_CCW_EAST: (("heading_deg",), _ccw_from(90.0)),
    Fix.HEADING_CCW_NORTH: (("heading_deg",), _ccw_from(0.0)),
    Fix.HEADING_REVERSED: (("heading_deg",), lambda values: np.mod(values + 180.0, 360.0)),
    Fix.STEERING_RADIANS: (STEERING, np.degrees),
    Fix.STEERING_LEFT: (STEERING, np.negative),
    Fix.IMPLEMENT_REVERSED: (("implement",), lambda values: 1.0 - values),
    Fix.ROLL_LEFT: (("roll_deg",), np.negative),
}


def first_place(columns: Columns) -> Place:
    """First position of the columns, as they are."""
    good = np.flatnonzero(np.isfinite(columns["easting_m"]) & np.isfinite(columns["northing_m"]))
    return float(columns["easting_m"][good[0]]), float(columns["northing_m"][good[0]])


def _local_metres(columns: Columns, reference: Place) -> Columns:
    """East and north of the reference, by the radii of curvature of the ellipsoid there: true north stays north."""
    longitude, latitude = reference
    if abs(latitude) > 90.0 or abs(longitude) > 360.0:
        raise LogError(
            f"easting_m {longitude:g} and northing_m {latitude:g} are no longitude and latitude; "
            f"leave the fix {Fix.POSITION_DEGREES} out."
        )
    squared = _FLATTENING * (2.0 - _FLATTENING)
    bulge = 1.0 - squared * math.sin(math.radians(latitude)) ** 2
    meridian, parallel = _EARTH_M * (1.0 - squared) / bulge**1.5, _EARTH_M / math.sqrt(bulge)
    east = np.radians(columns["easting_m"] - longitude) * parallel * math.cos(math.radians(latitude))
    return {"easting_m": east, "northing_m": np.radians(columns["northing_m"] - latitude) * meridian}


def fixed(log: Log, fix: Fix) -> Log:
    """The log with one fix applied to all its columns."""
    names = ("time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "speed_command_mps", *STEERING,
             "implement")  # fmt: skip
    columns = {name: getattr(log, name) for name in names if getattr(log, name) is not None}
    first = int(np.flatnonzero(log.used)[0])
    reference = (float(log.easting_m[first]), float(log.northing_m[first]))
    changed: dict[str, Any] = dict(apply_fixes(columns, frozenset([fix]), reference))
    return replace(log, **changed)
