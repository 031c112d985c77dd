"""Mirrored, turned and reversed columns: heading, steering and shuttle compared with the course of the path.

A mirrored path (easting and northing swapped) is the only thing that mirrors heading and steering at once.

Headings also flip: they turn by half a circle from one row to the next, as of a receiver at a standstill. No tractor
turns so fast, and a wrong gear leaves the heading as it is. Between two flips the heading points backwards in every row
or in none, and the course over ground tells which, with the gear. Where it does not, nothing is left out.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.logs.motion import (
    PathChords,
    RawMotion,
    build_raw_motion,
    compute_path_chords,
    is_steering_mirrored,
    select_clear_bends,
)
from vehicle.identification.logs.readings import LogConvention, Suspicion, format_fix_option
from vehicle.identification.logs.schema import Columns, Log, find_file_line
from vehicle.identification.logs.series import select_timed_rows, wrap_degrees
from vehicle.identification.logs.thresholds import (
    ALMOST_ALL_SHARE,
    BEND_PER_M,
    CLEAR_CORRELATION,
    FEW_SHARE,
    FEWEST_BEND_CHORDS,
    FEWEST_ROWS,
    MAJORITY,
    MOMENT_S,
    MOST_SHARE,
    NEARLY_SHARE,
    PART_S,
    READING_S,
    TURNED_DEG,
)
from vehicle.model.effects import get_effect

COURSE_HEADING = (
    "heading_deg is the course over ground of the antenna, not where a tractor with steered front wheels points; it is "
    "not used"
)
_OR_COURSE = ", or leave heading_deg out if it is the course over ground"
_FOLLOWING_SHARE = 0.65  # chosen: short legs between changes of gear misjudge a quarter of the bends
# Mean cosines between heading and course. An effect may turn the heading by 20 degrees and slip turns the course; a
# convention is wrong when another one fits better than any effect could explain.
HEADING_FITS, HEADING_MATCHES = math.cos(math.radians(30.0)), math.cos(math.radians(18.0))
MOST_LEVER_M = 3.0  # largest distance of an antenna from the rear axle
# From the angle of a convention: the largest heading_bias of the catalogue.
_NEAR_DEG = get_effect("heading_bias").size.high
# Ranges of UTM: eastings have a false origin of 500 km; northings of fields, 900 km and more from the equator.
_UTM_EAST_M, _UTM_NORTH_M = (1.0e5, 9.0e5), (9.0e5, 1.0e7)

HEADING_FLIPPED = "heading flipped: heading_deg points backwards until it turns by 180 degrees between two rows"


def find_wrong_gear(log: Log) -> tuple[Suspicion, Log | None] | None:
    """Return a gear that the path contradicts, and the corrected log (None when only some rows are wrong)."""
    chords = compute_path_chords(log)
    if chords is None:
        return None
    forward = replace(log, shuttle=np.abs(log.shuttle))
    if log.heading_deg is None:
        # The path turns away from the steering in reverse only.
        is_wrong, is_mirrored = (is_steering_mirrored(*select_clear_bends([log], gear)) for gear in (-1.0, 1.0))
        if not is_wrong or is_mirrored:
            return None
        rows = np.flatnonzero(log.used & (log.shuttle < 0.0))
        return _build_reverse_rows_suspicion(rows, "in those rows the path turns as it does forward"), forward
    gear = np.sign(log.shuttle[chords.row])
    heading = np.radians(log.heading_deg[chords.row])
    agrees = np.cos(heading - chords.course) * gear
    if np.mean(np.abs(agrees) > CLEAR_CORRELATION) < MOST_SHARE:
        return None
    wrong = agrees < -CLEAR_CORRELATION
    reverse_share, forward_share = _compute_wrong_share(wrong[gear < 0.0]), _compute_wrong_share(wrong[gear > 0.0])
    if max(reverse_share or 0.0, forward_share or 0.0) < FEW_SHARE:
        return None
    if all(share is None or share >= MOST_SHARE for share in (reverse_share, forward_share)):
        # Along one line a mirrored path looks the same; the check of the heading decides.
        one_line = abs(np.mean(np.exp(1j * (heading + chords.course)))) >= ALMOST_ALL_SHARE
        return None if reverse_share is None and one_line else _check_shuttle_by_heading(log, reverse_share)
    rows = chords.row[wrong & (gear != 0.0)]
    flipped = _describe_flipped_heading(log)
    if reverse_share is not None and reverse_share >= MOST_SHARE:
        why = f"heading and course agree in {100.0 * reverse_share:.0f} % of those rows"
        return _build_reverse_rows_suspicion(rows, why, flipped or _OR_COURSE), forward
    return _build_forward_rows_suspicion(rows, flipped), None


def drop_course_heading(log: Log) -> Log:
    """Return the log without a heading that is the course over ground: in reverse it points where the tractor goes.

    The bends say that the tractor does reverse there: with the steering to the right its front swings to the right,
    in either gear.
    """
    chords = compute_path_chords(log) if log.heading_deg is not None else None
    if chords is None or log.heading_deg is None:
        return log
    backwards = log.shuttle[chords.row] < 0.0
    agreement = np.cos(np.radians(log.heading_deg[chords.row]) - chords.course)
    for own, gear in ((agreement[backwards], -1.0), (agreement[~backwards], 1.0)):
        if len(own) < FEWEST_BEND_CHORDS or float(np.mean(own > CLEAR_CORRELATION)) < MOST_SHARE:
            return log
        # The path bends to the side of the steering in most clear bends; in a wrong gear hardly any do.
        angle, curvature = select_clear_bends([log], gear)
        if len(angle) < FEWEST_BEND_CHORDS or float(np.mean(angle * curvature > 0.0)) < _FOLLOWING_SHARE:
            return log
    return log.correct_columns(COURSE_HEADING, heading_deg=None)


def _compute_wrong_share(wrong: Flags) -> float | None:
    """Return the share of wrong chords; None when there are too few chords, 0 when too few are wrong."""
    if len(wrong) < FEWEST_BEND_CHORDS:
        return None
    return float(np.mean(wrong)) if np.count_nonzero(wrong) >= FEWEST_BEND_CHORDS else 0.0


def _check_shuttle_by_heading(log: Log, reverse_share: float | None) -> tuple[Suspicion, Log] | None:
    """Check a heading against the course in every row: with a mirrored steering the gear is wrong, else the heading."""
    mirrored = is_steering_mirrored(*select_clear_bends([log]))
    rows = np.flatnonzero(log.used)
    if (log.shuttle[rows] < 0.0).all() and mirrored is not False:
        corrected = replace(log, shuttle=np.abs(log.shuttle))
        return _build_reverse_rows_suspicion(rows, "heading and course agree in every row"), corrected
    if not mirrored:
        return None
    corrected = replace(log, shuttle=-log.shuttle)
    if reverse_share is None:
        return _build_forward_rows_suspicion(rows), corrected
    why = "heading and course agree in its reverse rows and are opposite in its forward rows"
    return Suspicion(None, why, "shuttle has the wrong sign", "write 1 for forward and -1 for reverse"), corrected


def _build_reverse_rows_suspicion(rows: Integers, why: str, other_reading: str = "") -> Suspicion:
    suspected = "shuttle is -1 where the tractor drives forward"
    advice = f"write 1 in those rows{other_reading}"
    return Suspicion(None, f"{why}, first in line {find_file_line(rows)}", suspected, advice)


def _describe_flipped_heading(log: Log) -> str:
    """Return what else than the gear may be wrong where the heading turns round between rows, "" where it does not."""
    if log.heading_deg is None:
        return ""
    rows = np.flatnonzero(log.used)
    changes, _ = find_flips(log.time_s[rows], log.heading_deg[rows])
    if not len(changes):
        return ""
    times = "once" if len(changes) == 1 else f"{len(changes)} times"
    return (
        ", or leave heading_deg out if it is the heading that is wrong: it turns by 180 degrees between two rows "
        f"{times}, first in line {find_file_line(rows[changes])}"
    )


def _build_forward_rows_suspicion(rows: Integers, other_reading: str = "") -> Suspicion:
    suspected = "shuttle is 1 (the default without that column) where the tractor drives in reverse"
    why = f"heading and course are opposite, first near line {find_file_line(rows)}"
    return Suspicion(None, why, suspected, f"write -1 in those rows{other_reading}")


def find_direction_errors(log: Log, other_logs: Sequence[Log] = ()) -> list[Suspicion]:
    """Return what seems mirrored, turned or reversed in shuttle, heading and steering."""
    gear = find_wrong_gear(log)
    if gear is not None and gear[1] is None:
        return [gear[0]]
    log = log if gear is None or gear[1] is None else gear[1]
    angle, curvature = select_clear_bends([log])
    steering = None
    if is_steering_mirrored(angle, curvature):
        opposite = 100.0 * float(np.mean(angle * curvature < 0.0))
        steering = Suspicion(
            LogConvention.STEERING_LEFT,
            f"in {opposite:.0f} % of the clear bends the path turns away from the steering",
            advice="rear wheels that steer are turned to the other side too",
        )
    suspicions = _combine_suspicions(log, other_logs, _check_heading(log, other_logs), steering)
    return suspicions if gear is None else [gear[0], *suspicions]


def _combine_suspicions(
    log: Log, other_logs: Sequence[Log], heading: Suspicion | None, steering: Suspicion | None
) -> list[Suspicion]:
    """Combine a mirrored heading and a mirrored steering into one mirrored path."""
    suspicions = [suspicion for suspicion in (heading, steering) if suspicion is not None]
    # Whether only UTM has such positions, and in which order; empty when they do not show it.
    east, north = (float(abs(np.median(axis[log.used]))) for axis in (log.easting_m, log.northing_m))
    axes = (("plain", east, north), ("swapped", north, east))
    (least, most), limit = _UTM_EAST_M, _UTM_NORTH_M[1]
    frame = next((name for name, x, y in axes if least <= x <= most < y <= limit), "")
    if frame == "plain":
        return suspicions
    if heading is not None and heading.fix is LogConvention.HEADING_CCW_EAST:
        mirrored = steering is not None or is_steering_mirrored(*select_clear_bends([log, *other_logs]))
        if mirrored is None:
            swap_advice = (
                f"easting and northing may be swapped instead: {format_fix_option(LogConvention.EAST_NORTH_SWAPPED)}"
            )
            return [replace(heading, advice="; ".join(filter(None, (heading.advice, swap_advice))))]
        return [_build_swapped_axes_suspicion(frame, heading.why)] if mirrored else suspicions
    if log.heading_deg is None and steering is not None:
        if frame == "swapped":
            return [_build_swapped_axes_suspicion(frame, steering.why)]
        return [replace(steering, advice="without heading_deg a swap of easting and northing looks the same")]
    return suspicions


def _build_swapped_axes_suspicion(frame: str, why: str) -> Suspicion:
    if frame == "swapped":
        return Suspicion(LogConvention.EAST_NORTH_SWAPPED, f"the path is mirrored, and easting_m is too large: {why}")
    return Suspicion(
        LogConvention.EAST_NORTH_SWAPPED,
        f"heading and steering are both mirrored against the path: {why}",
        advice="or, if the axes are right, heading runs counter-clockwise from east and steering is positive to the "
        f"left: {format_fix_option(LogConvention.HEADING_CCW_EAST)} {format_fix_option(LogConvention.STEERING_LEFT)}",
    )


# --- heading -----------------------------------------------------------------------------------------------------


def _compute_travel_direction(log: Log, chords: PathChords) -> Floats:
    """Return where the front should point (rad, clockwise from north), by course and gear."""
    return np.asarray(np.where(log.shuttle[chords.row] < 0.0, math.pi, 0.0) + chords.course)


def compute_heading_agreements(log: Log, chords: PathChords, heading_deg: Floats) -> dict[LogConvention | None, float]:
    """Return the mean cosine between the course and each reading of the heading; key None is the contract's reading."""
    sums = _sum_heading(_compute_travel_direction(log, chords), np.radians(heading_deg[chords.row]))
    return {
        None: (sums.turned / sums.chords).real,
        LogConvention.HEADING_CCW_EAST: (sums.mirrored / sums.chords).imag,
        LogConvention.HEADING_CCW_NORTH: (sums.mirrored / sums.chords).real,
    }


class _HeadingSums(NamedTuple):
    """Of so many chords, sums of unit complex numbers with the angle heading minus, or plus, direction of travel; and
    the angle (deg, clockwise) of the heading to the travel on straights."""

    chords: int
    turned: complex
    mirrored: complex
    offset_deg: float

    def is_constantly_offset(self) -> bool:
        """Whether the heading keeps one angle to the travel."""
        return abs(self.turned) >= HEADING_MATCHES * self.chords

    def is_mirrored(self) -> bool:
        """Whether the heading turns against the travel, degree by degree."""
        return abs(self.mirrored) >= HEADING_MATCHES * self.chords


def _sum_heading(travel: Floats, heading: Floats, offset_deg: float = 0.0) -> _HeadingSums:
    turned, mirrored = np.exp(1j * (heading - travel)).sum(), np.exp(1j * (heading + travel)).sum()
    return _HeadingSums(len(travel), complex(turned), complex(mirrored), offset_deg)


def _find_heading_misfit(log: Log) -> _HeadingSums | None:
    """Return the sums of a heading; None where it follows the contract, up to the largest heading_bias."""
    chords = compute_path_chords(log)
    if log.heading_deg is None or chords is None:
        return None
    travel, heading = _compute_travel_direction(log, chords), np.radians(log.heading_deg[chords.row])
    # The angle (deg) on the least bent chords, and what the lever of an antenna may add to it there.
    abs_curvature = np.abs(chords.curvature)
    straight = np.flatnonzero(abs_curvature < BEND_PER_M)
    if len(straight) < FEWEST_BEND_CHORDS:
        straight = np.argsort(abs_curvature, kind="stable")[: max(FEWEST_BEND_CHORDS, len(abs_curvature) // 4)]
    offset = math.degrees(cmath.phase(complex(np.exp(1j * (heading - travel)[straight]).sum())))
    # Bends to both sides cancel each other.
    slack = math.degrees(math.atan(MOST_LEVER_M * abs(float(np.mean(chords.curvature[straight])))))
    sums = _sum_heading(travel, heading, offset)
    fits = sums.turned.real >= HEADING_FITS * sums.chords or sums.is_constantly_offset()
    return None if fits and abs(offset) <= _NEAR_DEG + slack else sums


def _check_heading(log: Log, other_logs: Sequence[Log]) -> Suspicion | None:
    """Return the convention that the heading seems to follow instead. Other logs that are wrong too help to decide."""
    own = _find_heading_misfit(log)
    if own is None:
        return None
    wrong = [own, *(misfit for misfit in map(_find_heading_misfit, other_logs) if misfit is not None)]
    count, turned, mirrored_sum = (sum(column) for column in zip(*(one[:3] for one in wrong), strict=True))
    total = own._replace(chords=count, turned=turned, mirrored=mirrored_sum)
    sums = total if total.is_constantly_offset() or total.is_mirrored() else own
    turned_back = mirrored = None
    if sums.is_constantly_offset():
        side, sign = ("clockwise", "subtract") if own.offset_deg > 0.0 else ("counter-clockwise", "add")
        size = abs(own.offset_deg)
        turned_back = Suspicion(
            None,
            f"turned back its agreement with the course is {abs(own.turned) / own.chords:.2f}",
            f"heading_deg points {size:.0f} degrees {side} of the course",
            f"correct the column: {sign} {size:.0f}",
        )
        if size >= 180.0 - _NEAR_DEG:
            turned_back = Suspicion(LogConvention.HEADING_REVERSED, f"it differs from the course by {size:.0f} degrees")
    if sums.is_mirrored():
        mirrored = _build_mirrored_heading_suspicion(own, sums)
    if turned_back is None or mirrored is None:
        return turned_back or mirrored
    if mirrored.fix is None:
        return turned_back
    fix = turned_back.fix
    reading = f"{format_fix_option(fix)}, or reverse without -1 in shuttle" if fix else turned_back.what
    return replace(mirrored, advice=f"the log is driven along one line only, so it may also be: {reading}")


def _build_mirrored_heading_suspicion(own: _HeadingSums, sums: _HeadingSums) -> Suspicion:
    """Return counter-clockwise from east or north; `own` judges this log, `sums` shows where the angle counts from."""
    measured_zero_deg = math.degrees(cmath.phase(sums.mirrored))
    agreement = own.turned.real / own.chords
    for fix, zero_deg in ((LogConvention.HEADING_CCW_EAST, 90.0), (LogConvention.HEADING_CCW_NORTH, 0.0)):
        if abs(measured_zero_deg - zero_deg) <= _NEAR_DEG:
            corrected_agreement = (own.mirrored * cmath.exp(-1j * math.radians(zero_deg))).real / own.chords
            return Suspicion(
                fix,
                f"agreement with the course over ground is {agreement:.2f} as it is and {corrected_agreement:.2f} "
                "when converted",
            )
    return Suspicion(
        None,
        f"agreement with the course over ground is {agreement:.2f} as it is",
        f"heading_deg runs counter-clockwise from {measured_zero_deg % 360.0:.0f} degrees",
        "write it clockwise from north",
    )


def find_flipped_headings(columns: Columns) -> Integers:
    """Return the rows of the file whose heading points backwards between flips, where path and gear say so clearly."""
    if "heading_deg" not in columns:
        return np.empty(0, dtype=np.int64)
    rows = select_timed_rows(columns, "heading_deg")
    if len(rows) < FEWEST_ROWS:
        return rows[:0]
    time, heading = columns["time_s"][rows], columns["heading_deg"][rows]
    changes, between = find_flips(time, heading)
    if not len(changes):
        return rows[:0]
    is_second = np.cumsum(np.isin(np.arange(len(rows)), changes)) % 2 == 1
    gear = np.sign(columns["shuttle"][rows]) if "shuttle" in columns else np.ones(len(rows))
    flipped = _choose_flipped(build_raw_motion(columns, rows), heading, gear, is_second)
    if flipped is None:
        return rows[:0]
    flipped[between] = True
    for change in changes:  # rows that hold the value before a flip: what lies between it and the next is interpolated
        row = change - 1
        while row > 0 and heading[row - 1] == heading[row] and time[change] - time[row - 1] <= READING_S:
            flipped[row] = True
            row -= 1
    return rows[flipped]


def find_flips(time: Floats, heading: Floats) -> tuple[Integers, Integers]:
    """Return the first rows after flips of a heading (deg), and rows between the two sides of a flip."""
    changes: list[int] = []
    between: list[int] = []
    is_flip = [
        (np.abs(wrap_degrees(heading[lag:] - heading[:-lag])) > 180.0 - TURNED_DEG)
        & (time[lag:] - time[:-lag] <= MOMENT_S)
        for lag in (1, 2)
    ]
    near = np.abs(wrap_degrees(np.diff(heading))) <= TURNED_DEG
    for row in range(len(heading) - 1):
        if is_flip[0][row]:
            changes.append(row + 1)
        elif row < len(is_flip[1]) and is_flip[1][row] and not (near[row] or near[row + 1] or is_flip[0][row + 1]):
            changes.append(row + 2)
            between.append(row + 1)
    return np.array(changes, dtype=np.int64), np.array(between, dtype=np.int64)


def _choose_flipped(motion: RawMotion, heading: Floats, gear: Floats, is_second: Flags) -> Flags | None:
    """Return which rows (k,) are flipped: those of one side of the flips, `is_second` or not; None where neither is
    clear, and where they are those in reverse, as of a course over ground."""
    clear = np.isfinite(motion.course) & (gear != 0.0)
    agreement = np.where(clear, np.cos(np.radians(heading) - motion.course) * gear, 0.0)
    for flipped in (is_second, ~is_second):
        if motion.count_rows(PART_S) > np.count_nonzero(clear & ~flipped):
            continue
        if _is_clear(agreement[clear & ~flipped]) and _is_clear(-agreement[clear & flipped]):
            is_course = _is_all(flipped[clear & (gear < 0.0)]) and _is_all(~flipped[clear & (gear > 0.0)])
            return flipped if np.mean(flipped) <= MAJORITY and not is_course else None
    return None


def _is_clear(agreement: Floats) -> bool:
    return not len(agreement) or float(np.mean(agreement > CLEAR_CORRELATION)) >= NEARLY_SHARE


def _is_all(mask: Flags) -> bool:
    return len(mask) > 0 and float(np.mean(mask)) >= NEARLY_SHARE
