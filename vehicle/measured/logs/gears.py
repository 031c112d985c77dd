"""The gear held against the course of the path: rows that say reverse where the tractor drives forward, and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vehicle.measured.logs.bends import clear_bends, is_mirrored
from vehicle.measured.logs.gating import FIRST_ROW_LINE
from vehicle.measured.logs.motion import motion
from vehicle.measured.logs.record import Log, Mask, Rows, Suspicion

_FEWEST = 5  # chords: fewer may be one change of gear
_AGREES = 0.7  # cosine between heading and course from which they point the same way
_MOST, _SOME = 0.8, 0.1  # shares of the chords for all of them, and for too many to be the moments of a change
_ONE_LINE = 0.95  # mean resultant of course and heading doubled: driven along one line only


def wrong_gear(log: Log) -> tuple[Suspicion, Log | None] | None:
    """A gear that the path contradicts, and the log with it mended (None when only parts of the rows are wrong)."""
    chords = motion(log)
    if chords is None:
        return None
    if log.heading_deg is None:
        return _shuttle_by_steering(log)
    gear = np.sign(log.shuttle[chords.row])
    heading = np.radians(log.heading_deg[chords.row])
    agrees = np.cos(heading - chords.course) * gear
    if np.mean(np.abs(agrees) > _AGREES) < _MOST:
        return None
    wrong = agrees < -_AGREES
    back, ahead = _share(wrong[gear < 0.0]), _share(wrong[gear > 0.0])
    if max(back or 0.0, ahead or 0.0) < _SOME:
        return None
    if all(one is None or one >= _MOST for one in (back, ahead)):
        # Along one line a mirrored path looks the same; that is for the check of the heading to say.
        one_line = abs(np.mean(np.exp(1j * (heading + chords.course)))) >= _ONE_LINE
        return None if back is None and one_line else _shuttle_everywhere(log, back)
    rows = chords.row[wrong & (gear != 0.0)]
    if back is not None and back >= _MOST:
        return _says_reverse(rows, f"heading and course agree in {100.0 * back:.0f} % of those rows"), _forward(log)
    return _says_forward(rows), None


def _share(wrong: Mask) -> float | None:
    """Share of wrong chords; None when there are too few, 0 when too few of them are wrong."""
    if len(wrong) < _FEWEST:
        return None
    return float(np.mean(wrong)) if np.count_nonzero(wrong) >= _FEWEST else 0.0


def _shuttle_everywhere(log: Log, back: float | None) -> tuple[Suspicion, Log] | None:
    """Heading against course in every row: the gear is wrong if the steering is mirrored as well, else the heading."""
    mirrored = is_mirrored(*clear_bends([log]))
    rows = np.flatnonzero(log.used)
    if (log.shuttle[rows] < 0.0).all() and mirrored is not False:
        return _says_reverse(rows, "heading and course agree in every row"), _forward(log)
    if not mirrored:
        return None
    turned = replace(log, shuttle=-log.shuttle)
    if back is None:
        return _says_forward(rows), turned
    why = "heading and course agree where it says reverse, and point apart where it says forward"
    return Suspicion(None, why, "shuttle has the wrong sign", "write 1 for forward and -1 for reverse"), turned


def _shuttle_by_steering(log: Log) -> tuple[Suspicion, Log] | None:
    """Without a heading: the path turns away from the steering in reverse only."""
    back, ahead = is_mirrored(*clear_bends([log], -1.0)), is_mirrored(*clear_bends([log], 1.0))
    if not back or ahead:
        return None
    rows = np.flatnonzero(log.used & (log.shuttle < 0.0))
    return _says_reverse(rows, "there the path turns as it does forward"), _forward(log)


def _forward(log: Log) -> Log:
    return replace(log, shuttle=np.abs(log.shuttle))


def _says_reverse(rows: Rows, why: str) -> Suspicion:
    what = "shuttle is -1 where the tractor drives forward"
    return Suspicion(None, f"{why}, first in line {_line(rows)}", what, "write 1 in those rows")


def _says_forward(rows: Rows) -> Suspicion:
    what = "shuttle says forward, as it does without that column, where the tractor drives in reverse"
    return Suspicion(
        None, f"heading and course point apart, first about line {_line(rows)}", what, "write -1 in those rows"
    )


def _line(rows: Rows) -> int:
    return int(rows[0]) + FIRST_ROW_LINE
