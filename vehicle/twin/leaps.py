"""Leaps of the fix: a position that is suddenly elsewhere, by a reflection or another solution of the receiver.

A leap says nothing of the tractor. It differs from what an effect does by its next fix: an effect goes on showing at
every fix, a leap is over at once, or goes back. So a surprise too large for noise is told as a leap only when the next
fix agrees with it, or is back where it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vehicle.jit import compiled
from vehicle.twin.motion import Array

RARE = 1e-4  # of fixes leap: once in 2.8 hours at 1 Hz
SPREAD = 50.0  # standard deviations of a fix, over which leaps are spread
ANEW_M = 100.0  # how unsure a place is on which a leap is believed
BACK = 0.5  # of a leap: what is left of it at most, when the next one goes back
KEPT = 1000
_FLAT = math.log(RARE) - 2.0 * math.log(SPREAD)


@dataclass(frozen=True)
class Leap:
    """At `time_s` the fix was elsewhere than the one before lets expect: metres ahead and to the right."""

    time_s: float
    ahead_m: float
    right_m: float

    @property
    def metres(self) -> float:
        """How far."""
        return math.hypot(self.ahead_m, self.right_m)


@compiled
def log_density(east: float, north: float, turned: float, size: float) -> float:
    """Log of the density, up to a constant, of surprises in place and heading, noise being `size` times as large: all
    is noise, or the place has leapt."""
    place, heading = 0.5 * (east * east + north * north), 0.5 * turned * turned
    square = size * size
    noise = math.log(1.0 - RARE) - (place + heading) / square - 3.0 * math.log(size)
    leap = _FLAT - place / (SPREAD * SPREAD) - heading / square - math.log(size)
    high, low = max(noise, leap), min(noise, leap)
    return high + math.log1p(math.exp(low - high))


@compiled
def noise_share(east: float, north: float) -> float:
    """The probability that a place with such surprises is noise and no leap."""
    place = 0.5 * (east * east + north * north)
    apart = _FLAT - place / (SPREAD * SPREAD) - math.log(1.0 - RARE) + place
    return 0.0 if apart > 700.0 else 1.0 / (1.0 + math.exp(apart))


def leapt(whitened: Array) -> bool:
    """Whether surprises (4,) in east, north, heading and speed are a leap rather than noise."""
    return bool(noise_share(float(whitened[0]), float(whitened[1])) < 0.5)


class Leaps:
    """Those told so far, and one that may be."""

    def __init__(self) -> None:
        self.told: list[Leap] = []
        self._first: Leap | None = None
        self._in_a_row = 0

    def take(self, time_s: float, off: Array, sudden: bool) -> tuple[bool, bool]:
        """A fix, `off` (3,) from what is foretold, ahead and right (m): whether the one before is known by it to have
        been a leap, and whether this one may be one, or goes back."""
        leap = Leap(time_s, float(off[0]), float(off[1]))
        first, alone = self._first, self._in_a_row == 1
        self._first, self._in_a_row = (leap, self._in_a_row + 1) if sudden else (None, 0)
        if first is None or not alone:
            return False, self._in_a_row == 1
        left_m = float(np.hypot(first.ahead_m + leap.ahead_m, first.right_m + leap.right_m))
        if sudden and left_m > BACK * first.metres:
            return False, False
        self._tell(first)
        self._first, self._in_a_row = None, 0  # the way back is no other one
        return True, sudden

    def absurd(self, time_s: float, off: Array) -> None:
        """The first of fixes so far off that they are left out, or believed when several are."""
        self._tell(Leap(time_s, float(off[0]), float(off[1])))
        self._first, self._in_a_row = None, 0

    def _tell(self, leap: Leap) -> None:
        self.told.append(leap)
        del self.told[:-KEPT]
