"""Figures with their units as the reader wants them: metric, or as in the United States (ft, ac, mph, gal).

Values are metric everywhere; only screens and pages show others. JSON, CSV and inputs are always metric.
"""

from __future__ import annotations

import math

from reports.common.language import US, get_units

FOOT_M = 0.3048
ACRE_M2 = 4046.8564224
MILE_PER_HOUR_MPS = 0.44704
GALLON_L = 3.785411784  # of the United States
NO_VALUE = "-"
_LEAST_ACRES = 0.1  # less is in square feet
_LEAST_HA_M2 = 1000.0  # less is in square metres


def format_width(metres: float) -> str:
    """A working width, without decimals that say nothing: ``3 m`` or ``9.8 ft``."""
    return f"{metres / FOOT_M:.1f} ft" if is_us() else f"{metres:g} m"


def format_area(m2: float) -> str:
    """An area in hectares, or in square metres where it is small; in acres or square feet."""
    if not is_us():
        return f"{m2 / 10_000.0:.2f} ha" if m2 >= _LEAST_HA_M2 else f"{m2:.0f} m2"
    return f"{m2 / ACRE_M2:.2f} ac" if m2 >= _LEAST_ACRES * ACRE_M2 else f"{m2 / FOOT_M**2:.0f} ft2"


def format_hectares(hectares: float | None, decimals: int = 2) -> str:
    """The size of a field: ``1.89 ha`` or ``4.67 ac``."""
    return _join(convert_hectares(hectares), decimals, get_area_unit())


def format_square_metres(m2: float) -> str:
    """A small area: ``141 m2`` or ``1518 ft2``."""
    return _join(_divide(m2, FOOT_M**2), 0, get_small_area_unit())


def format_volume(litres: float, decimals: int = 0) -> str:
    """Fuel or what is carried: ``31 l`` or ``8 gal``."""
    return _join(_divide(litres, GALLON_L), decimals, get_volume_unit())


def format_speed(speed_mps: float, decimals: int = 1) -> str:
    """A speed: ``6.0 km/h`` or ``3.7 mph``."""
    value = speed_mps / MILE_PER_HOUR_MPS if is_us() else 3.6 * speed_mps
    return _join(value, decimals, "mph" if is_us() else "km/h")


def convert_hectares(hectares: float | None) -> float | None:
    """Hectares, or acres."""
    return _divide(hectares, ACRE_M2 / 10_000.0)


def convert_rate_per_hectare(rate: float | None) -> float | None:
    """What is counted per hectare, or per acre."""
    return None if rate is None else rate * ACRE_M2 / 10_000.0 if is_us() else rate


def convert_square_metres(m2: float | None) -> float | None:
    """Square metres, or square feet."""
    return _divide(m2, FOOT_M**2)


def convert_litres(litres: float | None) -> float | None:
    """Litres, or gallons."""
    return _divide(litres, GALLON_L)


def get_area_unit() -> str:
    """``ha`` or ``ac``."""
    return "ac" if is_us() else "ha"


def get_small_area_unit() -> str:
    """``m2`` or ``ft2``."""
    return "ft2" if is_us() else "m2"


def get_volume_unit() -> str:
    """``l`` or ``gal``."""
    return "gal" if is_us() else "l"


def get_length_unit() -> str:
    """``m`` or ``ft``."""
    return "ft" if is_us() else "m"


def is_us() -> bool:
    """Whether the reader wants units of the United States."""
    return get_units() == US


def _divide(value: float | None, unit: float) -> float | None:
    return value if value is None or not is_us() else value / unit


def _join(value: float | None, decimals: int, unit: str) -> str:
    if value is None or not math.isfinite(value):
        return NO_VALUE
    return f"{value:.{decimals}f} {unit}"
