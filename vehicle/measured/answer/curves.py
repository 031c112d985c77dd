"""The plot that shows a cause: what is left of the turning, against what the cause depends on, before and after."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from vehicle.effects import (
    ANGLE,
    COMMAND_RATE,
    CRAB,
    DIRECTION,
    PACE,
    SIDE_FORCE,
    SPEED,
    STEERING_SPEED,
    TARGET,
    TARGET_RATE,
    TIME,
    TOOL,
    TURN,
    TURNING,
    WHEEL,
    effect,
)
from vehicle.learnt import Settings
from vehicle.measured.answer.verdict import ResidualPlot
from vehicle.measured.causes.dependence import Dependence
from vehicle.measured.logs.record import Array, Mask
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.replaying import replay, seen
from vehicle.measured.surprise.bench import Bench

SPAN_S = 1.0  # over which rates are taken: a receiver tells a degree of course over a metre or so
BINS = 12  # enough to see a line bend
FEWEST = 4  # rows: fewer give no standard error worth drawing
LEAST_ROWS = 50  # of all: about four a bin
Quantity = Callable[[Bench, Stretch, Settings], Array]


def _turning(bench: Bench, stretch: Stretch, settings: Settings) -> Array:
    """Measured minus simulated turning rate to the right, deg/s."""
    heading = seen(bench.rig, stretch, replay(bench.rig, stretch, settings, True, True), settings)[1]
    return -np.degrees(_rate(stretch, stretch.heading - heading))


def _crab(bench: Bench, stretch: Stretch, settings: Settings) -> Array:
    """Measured minus simulated angle from heading to course, deg to the right."""
    antenna, heading, _, _ = seen(bench.rig, stretch, replay(bench.rig, stretch, settings, True, True), settings)
    measured = _angle(stretch, stretch.east, stretch.north) - stretch.heading
    simulated = _angle(stretch, antenna[:, 0], antenna[:, 1]) - heading
    return np.asarray(-np.degrees(np.angle(np.exp(1j * (measured - simulated)))))


def _wheel(bench: Bench, stretch: Stretch, settings: Settings) -> Array:
    """Measured minus simulated wheel angle, deg."""
    _, _, wheel, _ = seen(bench.rig, stretch, replay(bench.rig, stretch, settings, False, False), settings)
    return np.degrees((wheel if stretch.wheel is None else stretch.wheel) - wheel)


def _pace(bench: Bench, stretch: Stretch, settings: Settings) -> Array:
    """Measured minus simulated speed, m/s."""
    _, _, _, speed = seen(bench.rig, stretch, replay(bench.rig, stretch, settings, False, False), settings)
    return stretch.gear * (stretch.speed - speed)


def _rate(stretch: Stretch, values: Array) -> Array:
    after, before = (np.interp(stretch.time + s * 0.5 * SPAN_S, stretch.time, values) for s in (1.0, -1.0))
    rate: Array = (after - before) / SPAN_S
    return rate


def _angle(stretch: Stretch, east: Array, north: Array) -> Array:
    angle: Array = np.arctan2(_rate(stretch, north), _rate(stretch, east))
    return angle


def _steering(stretch: Stretch) -> Array:
    angle = stretch.wheel if stretch.wheel is not None else stretch.command
    assert angle is not None
    return np.degrees(angle)


def _direction(stretch: Stretch) -> Array:
    out: Array = np.mod(90.0 - np.degrees(stretch.heading), 360.0)
    return out


def _curvature_rate(stretch: Stretch) -> Array:
    return -np.degrees(_rate(stretch, stretch.heading))


def _command_rate(stretch: Stretch) -> Array:
    command = stretch.command if stretch.command is not None else stretch.wheel
    assert command is not None
    return np.degrees(_rate(stretch, command))


def _target(stretch: Stretch) -> Array:
    return stretch.pace if stretch.target is None else stretch.gear * stretch.target


_QUANTITIES: dict[str, tuple[str, Quantity]] = {
    TURN: ("turning rate left over, deg/s", _turning),
    CRAB: ("angle between heading and course left over, deg", _crab),
    WHEEL: ("wheel angle left over, deg", _wheel),
    PACE: ("speed left over, m/s", _pace),
}
_REGRESSORS: dict[str, tuple[str, Callable[[Stretch], Array]]] = {
    ANGLE: ("wheel angle, deg", _steering),
    STEERING_SPEED: ("steering speed, deg/s", lambda s: _rate(s, _steering(s))),
    COMMAND_RATE: ("change of the command, deg/s", _command_rate),
    SIDE_FORCE: ("lateral acceleration, m/s2", lambda s: -s.speed * _rate(s, s.heading)),
    DIRECTION: ("direction of travel, deg from north", _direction),
    TOOL: ("implement working (0 or 1)", lambda s: s.working),
    TARGET: ("commanded speed, m/s", _target),
    TARGET_RATE: ("change of the commanded speed, m/s2", lambda s: _rate(s, _target(s))),
    TURNING: ("turning rate, deg/s", _curvature_rate),
    TIME: ("time since the start, s", lambda s: s.start_s + s.time),
    SPEED: ("speed, m/s", lambda s: s.pace),
}
_UNNAMED = {"speed": SPEED, "square": SPEED, "direction": DIRECTION, "time": TIME}


def best_curve(
    bench: Bench, settings: Mapping[int, Settings], names: Sequence[str], unnamed: Sequence[Dependence]
) -> ResidualPlot | None:
    """The curve of the first name, or of the first unnamed dependence; None when there is neither.

    `settings` are those of every run with what was found.
    """
    if names:
        left, against = effect(names[0]).plot
    elif unnamed:
        left = CRAB if "push" in unnamed[0].changes else TURN
        against = next((value for key, value in _UNNAMED.items() if key in unnamed[0].on), ANGLE)
    else:
        return None
    (quantity, measure), (regressor, of) = _QUANTITIES[left], _REGRESSORS[against]
    at = np.concatenate([of(one)[_inner(one)] for one in bench.course.stretches])
    before = np.concatenate([measure(bench, one, {})[_inner(one)] for one in bench.course.stretches])
    after = np.concatenate([measure(bench, one, settings[one.run])[_inner(one)] for one in bench.course.stretches])
    return _binned(regressor, quantity, at, before, after, bench)


def _inner(stretch: Stretch) -> Mask:
    """Rows away from the ends and in motion."""
    moving = stretch.pace > 0.3 * max(float(np.median(stretch.pace)), 0.05)
    return np.asarray(moving & (stretch.time > SPAN_S) & (stretch.time < stretch.time[-1] - SPAN_S))


def _binned(regressor: str, quantity: str, at: Array, before: Array, after: Array, bench: Bench) -> ResidualPlot | None:
    if len(at) < LEAST_ROWS:
        return None
    edges = np.unique(np.quantile(at, np.linspace(0.0, 1.0, BINS + 1)))
    if 2 < len(edges) < BINS // 2:
        # Most rows have one and the same value, as a command that rests: bins of even width show the others.
        edges = np.linspace(float(np.quantile(at, 0.01)), float(np.quantile(at, 0.99)), BINS + 1)
    if len(edges) == 1:
        edges = np.array([edges[0] - 0.5, edges[0] + 0.5])
    elif len(edges) == 2:
        edges = np.array([edges[0], 0.5 * (edges[0] + edges[1]), edges[1]])
    edges[-1] += 1e-9
    number = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, len(edges) - 2)
    rows_per_second = bench.course.rows / max(bench.course.seconds, 1.0)
    parts = []
    for one in range(len(edges) - 1):
        mine = number == one
        count = int(mine.sum())
        if count < FEWEST:
            continue
        independent = math.sqrt(max(count / rows_per_second, 1.0))
        parts.append((
            at[mine].mean(), before[mine].mean(), before[mine].std() / independent, after[mine].mean(),
            after[mine].std() / independent,
        ))  # fmt: skip
    columns = np.array(parts).T
    return ResidualPlot(regressor, quantity, *columns)
