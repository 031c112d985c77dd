"""The plot that shows a cause: remaining error against its regressor, before and after."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from vehicle.identification.cause_selection.covariates import ErrorCovariate
from vehicle.identification.diagnosis.results import ResidualPlot
from vehicle.identification.logs.schema import Array, Mask
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.rig import replay_segment, simulate_logged_values
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.model.effects import (
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
    get_effect,
)
from vehicle.model.tractor import Settings
from vehicle.records import GRAVITY_MPS2

RATE_SPAN_S = 1.0  # span of the rates: a receiver resolves a degree of course over about a metre
CURVE_BINS = 12  # enough to see a curve
FEWEST_BIN_ROWS = 4  # rows: fewer give no standard error worth drawing
LEAST_CURVE_ROWS = 50  # of all: about four per bin
MeasureQuantity = Callable[[ResidualModel, DriveSegment, Settings], Array]


def _compute_turning_rate(residual_model: ResidualModel, segment: DriveSegment, settings: Settings) -> Array:
    """Measured minus simulated turning rate to the right, deg/s."""
    heading = simulate_logged_values(
        residual_model.rig, segment, replay_segment(residual_model.rig, segment, settings, True, True), settings
    )[1]
    return -np.degrees(_compute_rate_of_change(segment, segment.heading - heading))


def _compute_crab_angle(residual_model: ResidualModel, segment: DriveSegment, settings: Settings) -> Array:
    """Measured minus simulated angle from heading to course, deg to the right."""
    antenna, heading, _, _ = simulate_logged_values(
        residual_model.rig, segment, replay_segment(residual_model.rig, segment, settings, True, True), settings
    )
    measured = _compute_course_angle(segment, segment.east, segment.north) - segment.heading
    simulated = _compute_course_angle(segment, antenna[:, 0], antenna[:, 1]) - heading
    return np.asarray(-np.degrees(np.angle(np.exp(1j * (measured - simulated)))))


def _compute_wheel_error(residual_model: ResidualModel, segment: DriveSegment, settings: Settings) -> Array:
    """Measured minus simulated wheel angle, deg."""
    _, _, wheel, _ = simulate_logged_values(
        residual_model.rig, segment, replay_segment(residual_model.rig, segment, settings, False, False), settings
    )
    return np.degrees((wheel if segment.wheel is None else segment.wheel) - wheel)


def _compute_speed_error(residual_model: ResidualModel, segment: DriveSegment, settings: Settings) -> Array:
    """Measured minus simulated speed, m/s."""
    _, _, _, speed = simulate_logged_values(
        residual_model.rig, segment, replay_segment(residual_model.rig, segment, settings, False, False), settings
    )
    return segment.gear * (segment.speed - speed)


def _compute_rate_of_change(segment: DriveSegment, values: Array) -> Array:
    after, before = (np.interp(segment.time + s * 0.5 * RATE_SPAN_S, segment.time, values) for s in (1.0, -1.0))
    rate: Array = (after - before) / RATE_SPAN_S
    return rate


def _compute_course_angle(segment: DriveSegment, east: Array, north: Array) -> Array:
    angle: Array = np.arctan2(_compute_rate_of_change(segment, north), _compute_rate_of_change(segment, east))
    return angle


def _get_steering_deg(segment: DriveSegment) -> Array:
    angle = segment.wheel if segment.wheel is not None else segment.command
    assert angle is not None
    return np.degrees(angle)


def _compute_direction_deg(segment: DriveSegment) -> Array:
    out: Array = np.mod(90.0 - np.degrees(segment.heading), 360.0)
    return out


def _compute_turn_rate(segment: DriveSegment) -> Array:
    return -np.degrees(_compute_rate_of_change(segment, segment.heading))


def _compute_command_rate(segment: DriveSegment) -> Array:
    command = segment.command if segment.command is not None else segment.wheel
    assert command is not None
    return np.degrees(_compute_rate_of_change(segment, command))


def _get_commanded_speed(segment: DriveSegment) -> Array:
    return segment.speed_in_gear if segment.target is None else segment.gear * segment.target


_QUANTITIES: dict[str, tuple[str, MeasureQuantity]] = {
    TURN: ("remaining turning rate, deg/s", _compute_turning_rate),
    CRAB: ("remaining angle between heading and course, deg", _compute_crab_angle),
    WHEEL: ("remaining wheel angle, deg", _compute_wheel_error),
    PACE: ("remaining speed, m/s", _compute_speed_error),
}
_REGRESSORS: dict[str, tuple[str, Callable[[DriveSegment], Array]]] = {
    ANGLE: ("wheel angle, deg", _get_steering_deg),
    STEERING_SPEED: ("steering speed, deg/s", lambda s: _compute_rate_of_change(s, _get_steering_deg(s))),
    COMMAND_RATE: ("change of the command, deg/s", _compute_command_rate),
    SIDE_FORCE: ("lateral acceleration, m/s2", lambda s: -s.speed * _compute_rate_of_change(s, s.heading)),
    DIRECTION: ("direction of travel, deg from north", _compute_direction_deg),
    TOOL: ("implement working (0 or 1)", lambda s: s.working),
    TARGET: ("commanded speed, m/s", _get_commanded_speed),
    TARGET_RATE: ("change of the commanded speed, m/s2", lambda s: _compute_rate_of_change(s, _get_commanded_speed(s))),
    TURNING: ("turning rate, deg/s", _compute_turn_rate),
    TIME: ("time since the start, s", lambda s: s.start_s + s.time),
    SPEED: ("speed, m/s", lambda s: s.speed_in_gear),
}
_LIMIT_UNITS = {"side_slip": ("limit_g", GRAVITY_MPS2), "steering_rate": ("rate_deg_per_s", 1.0)}
"""Effects that are limits of their regressor: the parameter, and its unit in that of the regressor."""
_COVARIATE_REGRESSORS = {"speed": SPEED, "square": SPEED, "direction": DIRECTION, "time": TIME}


def build_residual_plot(
    residual_model: ResidualModel,
    settings: Mapping[int, Settings],
    names: Sequence[str],
    unnamed: Sequence[ErrorCovariate],
) -> ResidualPlot | None:
    """Return the curve of the first name, or of the first covariate; None when there is neither.

    `settings` are those of every run with everything found.
    """
    if names:
        quantity_id, regressor_id = get_effect(names[0]).plot
    elif unnamed:
        quantity_id = CRAB if "push" in unnamed[0].changed_quantity else TURN
        regressor_id = next(
            (value for key, value in _COVARIATE_REGRESSORS.items() if key in unnamed[0].regressor), ANGLE
        )
    else:
        return None
    (quantity, measure), (regressor, get_regressor) = _QUANTITIES[quantity_id], _REGRESSORS[regressor_id]
    regressor_values = np.concatenate(
        [get_regressor(segment)[_select_inner_rows(segment)] for segment in residual_model.dataset.segments]
    )
    before = np.concatenate(
        [
            measure(residual_model, segment, {})[_select_inner_rows(segment)]
            for segment in residual_model.dataset.segments
        ]
    )
    after = np.concatenate(
        [
            measure(residual_model, segment, settings[segment.run])[_select_inner_rows(segment)]
            for segment in residual_model.dataset.segments
        ]
    )
    limit = _find_limit(names, settings)
    return _bin_residuals(regressor, quantity, regressor_values, before, after, residual_model, limit)


def _find_limit(names: Sequence[str], settings: Mapping[int, Settings]) -> float | None:
    """Return the lowest found limit in the unit of its regressor; None where the first name is no limit."""
    if not names or names[0] not in _LIMIT_UNITS:
        return None
    parameter, unit = _LIMIT_UNITS[names[0]]
    found = [float(one[names[0]][parameter]) * unit for one in settings.values() if names[0] in one]
    return min((value for value in found if math.isfinite(value)), default=None)


def _select_inner_rows(segment: DriveSegment) -> Mask:
    """Select rows in motion and away from the ends."""
    moving = segment.speed_in_gear > 0.3 * max(float(np.median(segment.speed_in_gear)), 0.05)
    return np.asarray(moving & (segment.time > RATE_SPAN_S) & (segment.time < segment.time[-1] - RATE_SPAN_S))


def _bin_residuals(
    regressor: str,
    quantity: str,
    regressor_values: Array,
    before: Array,
    after: Array,
    residual_model: ResidualModel,
    limit: float | None = None,
) -> ResidualPlot | None:
    if len(regressor_values) < LEAST_CURVE_ROWS:
        return None
    edges = np.unique(np.quantile(regressor_values, np.linspace(0.0, 1.0, CURVE_BINS + 1)))
    if limit is not None and len(edges) > 2:
        # Few rows are at a limit: bins of equal width show them, and reach as far as the tractor came.
        edges = np.linspace(float(regressor_values.min()), float(regressor_values.max()), CURVE_BINS + 1)
    elif 2 < len(edges) < CURVE_BINS // 2:
        # Most rows may have the same value, as with a constant command: bins of equal width show the others.
        edges = np.linspace(
            float(np.quantile(regressor_values, 0.01)), float(np.quantile(regressor_values, 0.99)), CURVE_BINS + 1
        )
    if len(edges) == 1:
        edges = np.array([edges[0] - 0.5, edges[0] + 0.5])
    elif len(edges) == 2:
        edges = np.array([edges[0], 0.5 * (edges[0] + edges[1]), edges[1]])
    edges[-1] += 1e-9
    number = np.clip(np.searchsorted(edges, regressor_values, side="right") - 1, 0, len(edges) - 2)
    rows_per_second = residual_model.dataset.rows / max(residual_model.dataset.seconds, 1.0)
    parts = []
    for bin_number in range(len(edges) - 1):
        is_in_bin = number == bin_number
        count = int(is_in_bin.sum())
        if count < FEWEST_BIN_ROWS:
            continue
        independent = math.sqrt(max(count / rows_per_second, 1.0))
        parts.append(
            (
                regressor_values[is_in_bin].mean(),
                before[is_in_bin].mean(),
                before[is_in_bin].std() / independent,
                after[is_in_bin].mean(),
                after[is_in_bin].std() / independent,
            )
        )
    columns = np.array(parts).T
    at, before_mean, before_error, after_mean, after_error = columns
    return ResidualPlot(regressor, quantity, at, before_mean, before_error, after_mean, after_error, limit)
