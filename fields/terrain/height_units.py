"""Units of heights, as files name them."""

from __future__ import annotations

from fields.geometry.geodesy import is_wgs84_longitude_latitude
from fields.units import FOOT_M

SURVEY_FOOT_M = 1200.0 / 3937.0
UNIT_NAMES_M = {
    "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0, "cm": 0.01, "centimetre": 0.01,
    "centimetres": 0.01, "centimeter": 0.01, "centimeters": 0.01, "dm": 0.1, "mm": 0.001, "ft": FOOT_M, "foot": FOOT_M,
    "feet": FOOT_M, "international foot": FOOT_M, "us survey foot": SURVEY_FOOT_M, "us survey feet": SURVEY_FOOT_M,
    "us-ft": SURVEY_FOOT_M, "us_ft": SURVEY_FOOT_M, "sfoot": SURVEY_FOOT_M, "ftus": SURVEY_FOOT_M,
    "foot_us": SURVEY_FOOT_M,
}  # fmt: skip
"""Metres of units by their names in lower case."""


def find_unit_m(name: str) -> float | None:
    """Metres of a unit by its name; None for "" or an unknown one."""
    return UNIT_NAMES_M.get(name.strip().strip("[]()").lower())


def _name_unit(unit_m: float) -> str:
    """What sentences call a unit."""
    if abs(unit_m - FOOT_M) < 1e-5:
        return "feet"
    return {0.01: "centimetres", 0.1: "decimetres", 0.001: "millimetres"}.get(unit_m, f"units of {unit_m:g} m")


def describe_unit(unit_m: float, label: str) -> tuple[str, ...]:
    """A remark on heights of a file that are not in metres."""
    return () if unit_m == 1.0 else (f"Heights of {label} are in {_name_unit(unit_m)}; converted.",)


def find_axis_units_m(crs: str) -> tuple[float | None, float | None]:
    """Metres of the unit of a system along the ground (None for degrees) and of its height (None without one).

    Raises FieldError for a system that PROJ does not know.
    """
    from pyproj import CRS

    is_wgs84_longitude_latitude(crs)  # refuses unknown systems, and those that name files
    axes = CRS.from_user_input(crs).axis_info
    upright = [axis.unit_conversion_factor for axis in axes if axis.direction in ("up", "down")]
    level = [axis.unit_conversion_factor for axis in axes if axis.direction in ("east", "north", "west", "south")]
    is_degrees = any("degree" in axis.unit_name for axis in axes)
    return None if is_degrees or not level else level[0], upright[0] if upright else None
