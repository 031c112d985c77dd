"""The slope of the ground across the way, from roll that was measured; where that cannot be had, a sentence why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.measured.logs.levelling import Level, levelled, per_row
from vehicle.measured.logs.motion import motion
from vehicle.measured.logs.record import Array, Fix, Log, asking

_FEWEST_BLOCKS = 6
_UPHILL = 3.0  # standard errors: a wrong alarm costs no more than a slope that is not used
_STRAIGHT_PER_M = 0.03
_COMPASS_RAD = 0.004  # a quarter of a degree, which a heading drifts by from run to run
_LEAST_DRIFT = 0.03  # m/m per slope; tyres give way by about a tenth of the slope, soil by more


@dataclass(frozen=True, eq=False)
class Tilt:
    """Slope of the ground to the right (m/m, right side lower is positive) per row of each log, in the logs' order.

    `east`, `north` are the fall of the ground per metre that way in the mean of the drives, `usual` the root mean
    square of the slope across the way. `remarks` are sentences.
    """

    across: tuple[Array, ...] = ()
    east: float = 0.0
    north: float = 0.0
    usual: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def plane(self) -> tuple[float, float, float]:
        """The mean fall (m/m), the bearing it falls to (deg, clockwise from north) and the usual slope across."""
        bearing = float(np.degrees(np.arctan2(self.east, self.north))) % 360.0
        return float(np.hypot(self.east, self.north)), bearing, self.usual

    @property
    def known(self) -> bool:
        """Whether the slope can be used."""
        return bool(self.across)


def tilt(logs: Sequence[Log]) -> Tilt:
    """The slope across the way of all logs, or only a remark where roll was logged and cannot be used."""
    if all(log.roll_deg is None for log in logs):
        return Tilt()
    level = levelled(logs, "roll_deg")
    if isinstance(level, str):
        return _unused(level)
    drift, error = _drift(logs, level)
    if drift < -max(_LEAST_DRIFT, _UPHILL * error):
        return _unused(
            "it grows where the tractor drifts to the left, and none drifts uphill; where it counts up with the left "
            f"side lower, give {asking(Fix.ROLL_LEFT)}"
        )
    told = (
        f"roll_deg gives the slope across the way, {100.0 * level.usual:.1f} % in the root mean square, after its "
        f"mounting ({level.mounting_deg:+.1f} degrees) and the lean in bends were taken off."
    )
    sides = np.stack([np.cos(level.heading), -np.sin(level.heading)], axis=1)
    east, north = np.linalg.lstsq(sides, level.fall, rcond=None)[0]
    return Tilt(per_row(logs, level, level.fall), float(east), float(north), level.usual, (told,))


def _unused(why: str) -> Tilt:
    return Tilt(remarks=(f"roll_deg is not used: {why}. A plane stands in for the slope of the ground.",))


def _drift(logs: Sequence[Log], level: Level) -> tuple[float, float]:
    """Drift to the right per metre and slope, and its standard error, from course and heading on straight chords."""
    columns = [per_row(logs, level, values) for values in (level.fall, level.heading, level.block)]
    slopes, crabs, blocks = [], [], []
    for number, log in enumerate(logs):
        chords = motion(log)
        if chords is None:
            continue
        across, heading, block = (one[number] for one in columns)
        use = (np.abs(chords.curvature) < _STRAIGHT_PER_M) & (log.shuttle[chords.row] > 0.0) & (chords.speed > 0.3)
        crab = chords.course - heading[chords.row]
        slopes.append(across[chords.row][use])
        crabs.append(np.arctan2(np.sin(crab), np.cos(crab))[use])
        blocks.append(block[chords.row][use])
    x, y, block = (np.concatenate(one) if one else np.zeros(0) for one in (slopes, crabs, blocks))
    x, y = x - (x.mean() if len(x) else 0.0), y - (np.median(y) if len(y) else 0.0)
    spread = float(x @ x)
    if len(np.unique(block)) < _FEWEST_BLOCKS or spread == 0.0:
        return 0.0, np.inf
    drift = float(x @ y) / spread
    left = x * (y - y.mean() - drift * x)
    sums = np.array([left[block == one].sum() for one in np.unique(block)])
    compass = _COMPASS_RAD / (np.sqrt(len(slopes)) * float(np.std(x)))
    return drift, float(np.hypot(np.sqrt(sums @ sums) / spread, compass))
