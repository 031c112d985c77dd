"""Steering that moves otherwise to the left than to the right: a rate or a dead band for each side.

The wheel angle is simulated with several values. Rows in which the wheels are to move to one side choose the value of
that side, given the other parameters of the steering.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vehicle.identification.laws.bases import get_angle_deg
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.identification.replay.horizon_errors import simulate_instruments
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import LAW_SPREAD_FACTOR, LEAST_HELPED_SHARE, LEAST_STRENGTH, MATERIAL_SHARE
from vehicle.model.effects import get_effect, get_neutral_values
from vehicle.model.tractor import Settings

SIDED_EFFECTS = ("steering_rate", "steering_deadband")
VALUE_SHARES = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0, 1.15, 1.35, 1.6, 1.9, 2.3)  # of the value of both sides: chosen
NOISE_GAP_DEG = 0.15  # chosen: a smaller gap between command and wheel may be noise
LEAST_SIDE_INFORMATION = 0.01  # of that on the other side: chosen, a tenth of its precision still tells sides apart
RIGHT, LEFT = 1, -1


@dataclass(frozen=True, eq=False)
class SideLaw:
    """The values of an effect of the steering to the right and to the left, in its unit.

    `worth_pct` is how much of the error of the wheel angle they remove in runs that had no part in them (percent).
    """

    effect_id: str
    right: float
    left: float
    gain: float
    worth_pct: float = 0.0


def find_side_laws(residual_model: ResidualModel, settings: Settings) -> list[SideLaw]:
    """Return the effects of these settings whose sides differ beyond chance and tolerance, in most of the runs."""
    if not residual_model.has_measured_wheel_angle or any(s.command is None for s in residual_model.dataset.segments):
        return []
    laws = (_compare_sides(residual_model, settings, name) for name in SIDED_EFFECTS if name in settings)
    return [law for law in laws if law is not None]


def find_sides(segment: DriveSegment) -> Array:
    """Return the side (1 right, -1 left, 0 not yet known) to which the wheels are to move in every row (k,)."""
    assert segment.command is not None and segment.wheel is not None
    gap = np.degrees(segment.command - segment.wheel)
    known = np.abs(gap) > NOISE_GAP_DEG
    last = np.maximum.accumulate(np.where(known, np.arange(len(gap)), -1))
    return np.where(last >= 0, np.sign(gap[np.maximum(last, 0)]), 0.0)


def find_only_side(dataset: DriveDataset) -> int | None:
    """Return the side (1 right, -1 left) to which nearly all bends are; None where both sides are known.

    What is known of a factor on the wheel angle grows with the square of the angle: small corrections show no side.
    """
    angles = np.concatenate([get_angle_deg(segment) for segment in dataset.segments])
    right, left = (float(np.sum(np.clip(side * angles, 0.0, None) ** 2)) for side in (RIGHT, LEFT))
    if min(right, left) >= LEAST_SIDE_INFORMATION * max(right, left):
        return None
    return RIGHT if right > left else LEFT


def _compare_sides(residual_model: ResidualModel, settings: Settings, name: str) -> SideLaw | None:
    size = get_effect(name).size
    value = settings[name][size.name]
    neutral = get_neutral_values(name, residual_model.rig.tractor.steering)[size.name]
    values = np.unique(np.clip([*(share * value for share in VALUE_SHARES), neutral], size.low, size.high))
    sides = np.concatenate([find_sides(segment) for segment in residual_model.dataset.segments])
    runs = np.concatenate([np.full(segment.rows, segment.run) for segment in residual_model.dataset.segments])
    count = len(residual_model.dataset.names)
    losses = np.zeros((len(values), 2, count))
    for number, trial in enumerate(values):
        squares = residual_model.compute_wheel_residuals({**settings, name: {size.name: float(trial)}}) ** 2
        for place, side in enumerate((RIGHT, LEFT)):
            losses[number, place] = np.bincount(runs, squares * (sides == side), count)
    totals = losses.sum(axis=2)
    right, left = (int(place) for place in np.argmin(totals, axis=0))
    both = int(np.argmin(totals.sum(axis=1)))
    by_run = losses[both].sum(axis=0) - losses[right, 0] - losses[left, 1]
    gain = float(by_run.sum())
    least = max(LEAST_STRENGTH, MATERIAL_SHARE * residual_model.dataset.rows)
    concerned = np.abs(by_run) > 1.0
    if (
        gain < least
        or abs(values[right] - values[left]) < LAW_SPREAD_FACTOR * size.finest
        or np.count_nonzero(by_run[concerned] > 0.0) < LEAST_HELPED_SHARE * np.count_nonzero(concerned)
    ):
        return None
    worth = _measure_worth(residual_model, settings, name, values, losses)
    return SideLaw(name, _refine(values, totals[:, 0], right), _refine(values, totals[:, 1], left), gain, worth)


def _measure_worth(residual_model: ResidualModel, settings: Settings, name: str, values: Array, losses: Array) -> float:
    """Return the percentage of the root mean square error of the wheel angle that a value for each side removes.

    Every run is simulated with the values that suit the other runs best, by the `losses` (v, 2, r) of values, sides and
    runs; the error before is that without the effect.
    """
    size, others = get_effect(name).size.name, losses.sum(axis=2, keepdims=True) - losses
    best = np.argmin(others, axis=0)
    bare = {effect_id: setting for effect_id, setting in settings.items() if effect_id != name}
    before = after = 0.0
    for segment in residual_model.dataset.segments:
        assert segment.wheel is not None
        sides = find_sides(segment)
        trials = [bare, *({**bare, name: {size: float(values[place])}} for place in best[:, segment.run])]
        squares, right, left = (
            (segment.wheel - simulate_instruments(residual_model.rig, segment, one)[2]) ** 2 for one in trials
        )
        before += float(squares.sum())
        after += float(np.where(sides == RIGHT, right, np.where(sides == LEFT, left, squares)).sum())
    return 100.0 * (1.0 - math.sqrt(after / max(before, 1e-12)))


def _refine(values: Array, losses: Array, best: int) -> float:
    """Return the lowest point of the parabola through a minimum and its neighbours; the minimum itself at an end."""
    if not 0 < best < len(values) - 1:
        return float(values[best])
    near = slice(best - 1, best + 2)
    curve = np.polyfit(values[near], losses[near], 2)
    return float(np.clip(-0.5 * curve[1] / curve[0], values[best - 1], values[best + 1]))
