"""What a grade takes of the speed, from pitch that was measured: uphill slower, downhill faster than commanded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.measured.logs.levelling import SURE, Level, levelled, per_row
from vehicle.measured.logs.record import Array, Log, Mask

STEADY_S = 4.0  # after a change of the command: longer than any speed takes to follow but for its last percent
_SLOWEST_MPS = 0.3
_FEWEST_BLOCKS = 6
_LEAST = 0.1  # of the speed per slope: less is a centimetre a second on one of 10 %
_FACTORS = (0.5, 1.5)  # of the speed: what a grade can do, so that no wild row stops a tractor


@dataclass(frozen=True, eq=False)
class Grade:
    """Share of the commanded speed that is left on the grade, per row of each log; empty where it does not count."""

    share: tuple[Array, ...] = ()
    remarks: tuple[str, ...] = ()


def grade(logs: Sequence[Log]) -> Grade:
    """What pitch explains of the speeds of all logs; nothing where none has it or speeds were not both logged."""
    if all(log.pitch_deg is None for log in logs):
        return Grade()
    if any(log.speed_mps is None or log.speed_command_mps is None for log in logs):
        return _unused("measured and commanded speed are needed beside it")
    level = levelled(logs, "pitch_deg")
    if isinstance(level, str):
        return _unused(level)
    # Backwards the way goes down where the ground rises ahead.
    fall_on = level.fall * np.concatenate([np.where(log.shuttle[log.used] < 0.0, -1.0, 1.0) for log in logs])
    gain, error = _gain(logs, level, fall_on)
    if gain < -max(_LEAST, SURE * error):
        return _unused("the tractor is quicker where it says uphill; it seems to count up with the nose down")
    if gain < max(_LEAST, SURE * error):
        return _unused("no speed that depends on it is seen")
    told = (
        f"pitch_deg explains speed: on a slope of 10 % the tractor drives {10.0 * gain:.1f} % slower uphill and faster "
        f"downhill than commanded. Commands are taken for that much; the mounting of the sensor "
        f"({level.mounting_deg:+.1f} degrees) was taken off."
    )
    return Grade(per_row(logs, level, np.clip(1.0 + gain * fall_on, *_FACTORS)), (told,))


def _unused(why: str) -> Grade:
    return Grade(remarks=(f"pitch_deg is not used: {why}.",))


def _gain(logs: Sequence[Log], level: Level, fall_on: Array) -> tuple[float, float]:
    """Share of the speed gained per fall that way, and its standard error, from rows under a command that stands.

    Slip, of all driving and of the implement, is set apart.
    """
    ratios, falls, blocks, tools = [], [], [], []
    for number, log in enumerate(logs):
        assert log.speed_mps is not None and log.speed_command_mps is not None
        mine, used = level.log == number, log.used
        use = _steady(log.time_s[used], log.speed_command_mps[used]) & (log.speed_command_mps[used] > _SLOWEST_MPS)
        ratios.append(log.speed_mps[used][use] / log.speed_command_mps[used][use])
        falls.append(fall_on[mine][use])
        blocks.append(level.block[mine][use])
        tools.append(log.implement[used][use])
    ratio, fall, block, tool = (np.concatenate(one) for one in (ratios, falls, blocks, tools))
    numbers = np.unique(block)
    columns = np.stack([fall, np.ones(len(fall)), tool], axis=1)
    if tool.size and np.ptp(tool) == 0.0:
        columns = columns[:, :2]
    if len(numbers) < _FEWEST_BLOCKS or np.ptp(fall) == 0.0:
        return 0.0, np.inf
    at = np.linalg.lstsq(columns, ratio, rcond=None)[0]
    inverse = np.linalg.pinv(columns.T @ columns)
    scores = columns * (ratio - columns @ at)[:, None]
    sums = np.stack([scores[block == one].sum(axis=0) for one in numbers])
    covariance = inverse @ (sums.T @ sums) @ inverse
    return float(at[0]), float(np.sqrt(covariance[0, 0]))


def _steady(time: Array, command: Array) -> Mask:
    """Rows before which the command has stood for STEADY_S."""
    changed = np.concatenate([[True], np.diff(command) != 0.0])
    last = time[np.maximum.accumulate(np.where(changed, np.arange(len(time)), 0))]
    steady: Mask = time - last >= STEADY_S
    return steady
