"""When the sun is up: rise and set of its upper edge, refraction included, to a minute or two between 65 degrees."""

from __future__ import annotations

import math
from datetime import date

from planner.scenario import DAY_S

ZENITH_DEG = 90.833  # of the sun's centre at rise and set: half its width and refraction
MINUTES = 1440


def sun_hours(day: date, lon: float, lat: float, utc_offset_h: float) -> tuple[int, int] | None:
    """Sunrise and sunset as seconds of the day on the clock of that offset, to the minute; None where it does not set.

    Declination and equation of time by the Fourier series of Spencer (1971). A day on which the sun does not rise has
    its sunset at its sunrise, at noon.
    """
    turn = 2.0 * math.pi * (day.timetuple().tm_yday - 1 + 0.5) / 365.0
    one, two, three = (number * turn for number in (1, 2, 3))
    declination = (
        0.006918 - 0.399912 * math.cos(one) + 0.070257 * math.sin(one) - 0.006758 * math.cos(two)
        + 0.000907 * math.sin(two) - 0.002697 * math.cos(three) + 0.00148 * math.sin(three)
    )  # fmt: skip
    equation_min = 229.18 * (
        0.000075 + 0.001868 * math.cos(one) - 0.032077 * math.sin(one) - 0.014615 * math.cos(two)
        - 0.040849 * math.sin(two)
    )  # fmt: skip
    north = math.radians(lat)
    height = math.cos(math.radians(ZENITH_DEG)) - math.sin(north) * math.sin(declination)
    reach = height / max(math.cos(north) * math.cos(declination), 1e-9)
    if reach <= -1.0:
        return None
    half_min = 4.0 * math.degrees(math.acos(min(reach, 1.0)))
    noon_min = MINUTES / 2 - 4.0 * lon - equation_min + 60.0 * utc_offset_h
    rise, sets = (60 * round(noon_min + sign * half_min) % DAY_S for sign in (-1.0, 1.0))
    return rise, sets
