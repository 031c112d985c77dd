"""Figures with their units as the reader wants them: metric, or as in the United States (ft, ac, mph, gal).

Values are metric everywhere; only screens and pages show others. JSON, CSV and inputs are always metric.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fields.units import FOOT_M
from reports.common.language import US, get_units

ACRE_M2 = 4046.8564224
NO_VALUE = "-"
_LEAST_ACRES = 0.1  # less is in square feet
_LEAST_HA_M2 = 1000.0  # less is in square metres


@dataclass(frozen=True)
class Quantity:
    """What is measured: its metric unit, that of the United States, and the size of the latter in the former."""

    metric_unit: str
    us_unit: str
    us_size: float

    @property
    def unit(self) -> str:
        """The unit of the reader."""
        return self.us_unit if is_us() else self.metric_unit

    def convert(self, value: float | None) -> float | None:
        """A metric value in the unit of the reader."""
        return value / self.us_size if value is not None and is_us() else value

    def convert_rate(self, rate: float | None) -> float | None:
        """What is counted per metric unit, per unit of the reader."""
        return rate * self.us_size if rate is not None and is_us() else rate

    def format(self, value: float | None, decimals: int = 0) -> str:
        """A metric value with the unit of the reader; a dash where it is missing or not finite."""
        shown = self.convert(value)
        return NO_VALUE if shown is None or not math.isfinite(shown) else f"{shown:.{decimals}f} {self.unit}"


FIELD_AREA = Quantity("ha", "ac", ACRE_M2 / 10_000.0)
SMALL_AREA = Quantity("m2", "ft2", FOOT_M**2)
VOLUME = Quantity("l", "gal", 3.785411784)  # gallons of the United States
LENGTH = Quantity("m", "ft", FOOT_M)
SPEED = Quantity("km/h", "mph", 1.609344)


def format_width(metres: float) -> str:
    """A working width, without decimals that say nothing: ``3 m`` or ``9.8 ft``."""
    return LENGTH.format(metres, 1) if is_us() else f"{metres:g} m"


def format_area(m2: float) -> str:
    """An area in hectares, or in square metres where it is small; in acres or square feet."""
    least_m2 = _LEAST_ACRES * ACRE_M2 if is_us() else _LEAST_HA_M2
    return FIELD_AREA.format(m2 / 10_000.0, 2) if m2 >= least_m2 else SMALL_AREA.format(m2)


def is_us() -> bool:
    """Whether the reader wants units of the United States."""
    return get_units() == US
