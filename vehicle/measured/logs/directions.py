"""Mirrored, turned and reversed columns: heading, steering and shuttle held against the course of the path.

A mirrored path, that is easting and northing exchanged, is the one thing that mirrors heading and steering at once.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.effects import effect
from vehicle.measured.logs.bends import clear_bends, is_mirrored
from vehicle.measured.logs.gears import wrong_gear
from vehicle.measured.logs.motion import Motion, motion
from vehicle.measured.logs.record import Array, Fix, Log, Suspicion, asking

# Mean cosines between heading and course. An effect may turn the heading by 20 degrees and slip turns the course; a
# wrong convention is told by a reading that comes nearer than any effect needs.
HEADING_FITS, HEADING_MATCHES = math.cos(math.radians(30.0)), math.cos(math.radians(18.0))
STRAIGHT_PER_M, LEVER_M = 0.06, 3.0  # curvature of what is straight; antennas stand less far from the rear axle
_NEAR_DEG = 20.0  # of a convention's own angle: the largest heading_bias of the catalogue
_FEWEST = 5
# Ranges of UTM: eastings have a false origin of 500 km; northings of fields, 900 km and more from the equator.
_UTM_EAST, _UTM_NORTH = (1.0e5, 9.0e5), (9.0e5, 1.0e7)


def directions(log: Log, others: Sequence[Log] = ()) -> list[Suspicion]:
    """What shuttle, heading and steering seem to have mirrored, turned or reversed."""
    gear = wrong_gear(log)
    if gear is not None and gear[1] is None:
        return [gear[0]]
    log = log if gear is None or gear[1] is None else gear[1]
    suspicions = _together(log, others, _heading(log, others), _steering_sense(log))
    return suspicions if gear is None else [gear[0], *suspicions]


def _together(
    log: Log, others: Sequence[Log], heading: Suspicion | None, steering: Suspicion | None
) -> list[Suspicion]:
    """Heading and steering mirrored at once are one mirrored path."""
    suspicions = [one for one in (heading, steering) if one is not None]
    frame = _frame(log)
    if frame == "plain":
        return suspicions
    if heading is not None and heading.fix is Fix.HEADING_CCW_EAST:
        mirrored = steering is not None or is_mirrored(*clear_bends([log, *others]))
        if mirrored is None:
            other = f"easting and northing may be swapped instead: {asking(Fix.EAST_NORTH_SWAPPED)}"
            return [replace(heading, advice="; ".join(filter(None, (heading.advice, other))))]
        return [_swapped(frame, heading.why)] if mirrored else suspicions
    if log.heading_deg is None and steering is not None:
        if frame == "swapped":
            return [_swapped(frame, steering.why)]
        return [replace(steering, advice="without heading_deg a swap of easting and northing looks the same")]
    return suspicions


def _swapped(frame: str, why: str) -> Suspicion:
    if frame == "swapped":
        return Suspicion(Fix.EAST_NORTH_SWAPPED, f"the path is mirrored, and easting_m is too large: {why}")
    return Suspicion(
        Fix.EAST_NORTH_SWAPPED, f"heading and steering are both mirrored against the path: {why}",
        advice="or, if the axes are right, heading runs counter-clockwise from east and steering is positive to the "
        f"left: {asking(Fix.HEADING_CCW_EAST)} {asking(Fix.STEERING_LEFT)}",
    )  # fmt: skip


def _frame(log: Log) -> str:
    """Whether the positions are such as only UTM has, in the right order or swapped; empty when they do not say."""
    east, north = (float(abs(np.median(axis[log.used]))) for axis in (log.easting_m, log.northing_m))
    for name, one, two in (("plain", east, north), ("swapped", north, east)):
        if _UTM_EAST[0] <= one <= _UTM_EAST[1] < two <= _UTM_NORTH[1]:
            return name
    return ""


# --- heading -----------------------------------------------------------------------------------------------------


def _travel(log: Log, chords: Motion) -> Array:
    """Where the front should point (rad, clockwise from north), by course and gear."""
    travel: Array = np.where(log.shuttle[chords.row] < 0.0, math.pi, 0.0) + chords.course
    return travel


def heading_fits(log: Log, chords: Motion, heading_deg: Array) -> dict[Fix | None, float]:
    """Mean cosine between the course and each reading of the heading; None is the contract's reading."""
    sums = _sums(_travel(log, chords), np.radians(heading_deg[chords.row]))
    return {
        None: (sums.turned / sums.count).real,
        Fix.HEADING_CCW_EAST: (sums.mirrored / sums.count).imag,
        Fix.HEADING_CCW_NORTH: (sums.mirrored / sums.count).real,
    }


@dataclass(frozen=True)
class _Sums:
    """Sums over chords of unit numbers whose angle is heading minus, or plus, the direction of travel."""

    count: int
    turned: complex
    mirrored: complex

    def __add__(self, other: _Sums) -> _Sums:
        return _Sums(self.count + other.count, self.turned + other.turned, self.mirrored + other.mirrored)

    def is_turned(self) -> bool:
        """The heading keeps one angle to the travel."""
        return abs(self.turned) >= HEADING_MATCHES * self.count

    def is_mirrored(self) -> bool:
        """The heading turns against the travel, degree by degree."""
        return abs(self.mirrored) >= HEADING_MATCHES * self.count


def _sums(travel: Array, heading: Array) -> _Sums:
    turned, mirrored = np.exp(1j * (heading - travel)).sum(), np.exp(1j * (heading + travel)).sum()
    return _Sums(len(travel), complex(turned), complex(mirrored))


@dataclass(frozen=True)
class _Heading:
    """A heading that does not fit: its sums, and its angle (deg, clockwise) to the travel where that is straight."""

    sums: _Sums
    offset_deg: float


def _misfit(log: Log) -> _Heading | None:
    """None where the heading is as the contract wants it, up to a bias that an effect can be."""
    chords = motion(log)
    if log.heading_deg is None or chords is None:
        return None
    travel, heading = _travel(log, chords), np.radians(log.heading_deg[chords.row])
    sums = _sums(travel, heading)
    offset, slack = _offset(heading - travel, chords.curvature)
    fits = sums.turned.real >= HEADING_FITS * sums.count or sums.is_turned()
    return None if fits and abs(offset) <= _largest_bias() + slack else _Heading(sums, offset)


def _largest_bias() -> float:
    return next(param.high for param in effect("heading_bias").params if param.name == "angle_deg")


def _offset(turned: Array, curvature: Array) -> tuple[float, float]:
    """Angle (deg) of the least bent chords, and what the lever of an antenna may add to it there."""
    bent = np.abs(curvature)
    straight = np.flatnonzero(bent < STRAIGHT_PER_M)
    if len(straight) < _FEWEST:
        straight = np.argsort(bent, kind="stable")[: max(_FEWEST, len(bent) // 4)]
    offset = math.degrees(cmath.phase(complex(np.exp(1j * turned[straight]).sum())))
    # Bends to both sides cancel each other.
    return offset, math.degrees(math.atan(LEVER_M * abs(float(np.mean(curvature[straight])))))


def _heading(log: Log, others: Sequence[Log]) -> Suspicion | None:
    """Which reading of the heading the course speaks for. Logs that are wrong too help to decide."""
    own = _misfit(log)
    if own is None:
        return None
    wrong = [one.sums for one in map(_misfit, others) if one is not None]
    whole = sum(wrong, own.sums)
    sums = whole if whole.is_turned() or whole.is_mirrored() else own.sums
    if not sums.is_turned() and not sums.is_mirrored():
        return None
    turned = _turned(own) if sums.is_turned() else None
    mirrored = _mirror(own, sums) if sums.is_mirrored() else None
    if turned is None or mirrored is None:
        return turned or mirrored
    if mirrored.fix is None:
        return turned
    other = f"{asking(turned.fix)}, or reverse without -1 in shuttle" if turned.fix else turned.what
    return replace(mirrored, advice=f"driven along one line only, the other reading is: {other}")


def _turned(own: _Heading) -> Suspicion:
    offset = own.offset_deg
    if abs(offset) >= 180.0 - _NEAR_DEG:
        return Suspicion(Fix.HEADING_REVERSED, f"it stands {abs(offset):.0f} degrees from the course")
    side, sign = ("clockwise", "subtract") if offset > 0.0 else ("counter-clockwise", "add")
    agreement = abs(own.sums.turned) / own.sums.count
    return Suspicion(
        None, f"turned back it agrees with the course to {agreement:.2f}",
        f"heading_deg stands {abs(offset):.0f} degrees {side} of the course",
        f"mend the column: {sign} {abs(offset):.0f}",
    )  # fmt: skip


def _mirror(own: _Heading, sums: _Sums) -> Suspicion:
    """Counter-clockwise from east or north; `own` is judged by its own numbers, `sums` says from where it counts."""
    zero = math.degrees(cmath.phase(sums.mirrored))
    now = own.sums.turned.real / own.sums.count
    for fix, at in ((Fix.HEADING_CCW_EAST, 90.0), (Fix.HEADING_CCW_NORTH, 0.0)):
        if abs(zero - at) <= _NEAR_DEG:
            then = (own.sums.mirrored * cmath.exp(-1j * math.radians(at))).real / own.sums.count
            return Suspicion(fix, f"agreement with the course over ground is {now:.2f} as it is and {then:.2f} read so")
    return Suspicion(
        None, f"agreement with the course over ground is {now:.2f} as it is",
        f"heading_deg runs counter-clockwise from {zero % 360.0:.0f} degrees", "write it clockwise from north",
    )  # fmt: skip


# --- steering ----------------------------------------------------------------------------------------------------


def _steering_sense(log: Log) -> Suspicion | None:
    angle, curvature = clear_bends([log])
    if not is_mirrored(angle, curvature):
        return None
    opposite = 100.0 * float(np.mean(angle * curvature < 0.0))
    return Suspicion(Fix.STEERING_LEFT, f"in {opposite:.0f} % of the clear bends the path turns away from the steering")
