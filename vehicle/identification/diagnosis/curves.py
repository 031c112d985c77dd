"""The plot that shows a cause: the remaining error against what it depends on, before and after.

The mean of each bin is a least-squares estimate in the noise of the channel: how large the error of, say, the turning
rate has to be in the cells of a bin for the residuals of the whole windows. So a slow heading, or none, serves as well.
"""

from __future__ import annotations

import math

import numpy as np

from fields.arrays import Flags, Floats
from vehicle.identification.diagnosis.drive_data import POSE_CELL_S, POSE_CELLS, SENSOR_CELLS, STRIDE
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.noise import build_yaw_response, cut_motion, integrate_cells
from vehicle.identification.diagnosis.results import ResidualPlot
from vehicle.identification.diagnosis.verdicts import compute_values
from vehicle.identification.logs.thresholds import ALIKE_SHARE, FEWEST_ROWS, FEWEST_TIMES, WINDOW_S
from vehicle.model import effects
from vehicle.records import GRAVITY_MPS2

CURVE_BINS = 12  # enough to see a curve
CHANNEL_BY_QUANTITY = {effects.TURN: "pose", effects.CRAB: "pose", effects.WHEEL: "wheel", effects.PACE: "speed"}
QUANTITIES = {
    effects.TURN: "remaining turning rate, deg/s",
    effects.CRAB: "remaining angle between heading and course, deg",
    effects.WHEEL: "remaining wheel angle, deg",
    effects.PACE: "remaining speed, m/s",
}
REGRESSORS = {
    effects.ANGLE: "wheel angle, deg",
    effects.STEERING_SPEED: "steering speed, deg/s",
    effects.COMMAND_RATE: "change of the command, deg/s",
    effects.SIDE_FORCE: "lateral acceleration, m/s2",
    effects.DIRECTION: "direction of travel, deg from north",
    effects.TOOL: "implement working (0 or 1)",
    effects.TARGET: "commanded speed, m/s",
    effects.TARGET_RATE: "change of the commanded speed, m/s2",
    effects.TURNING: "turning rate, deg/s",
    effects.TIME: "time since the start, s",
    effects.SPEED: "speed, m/s",
}
RATES = frozenset({effects.STEERING_SPEED, effects.COMMAND_RATE, effects.TARGET_RATE})
REGRESSOR_BY_LAW = {
    "by_speed": effects.SPEED, "by_angle": effects.ANGLE, "by_side:left": effects.ANGLE,
    "by_side:right": effects.ANGLE, "by_implement": effects.TOOL, "over_minutes": effects.TIME,
    "by_direction": effects.DIRECTION,
}  # fmt: skip
LIMIT_UNITS = {"side_slip": ("limit_g", GRAVITY_MPS2), "steering_rate": ("rate_deg_per_s", 1.0)}
"""Effects that are limits of their regressor: the parameter, and its unit in that of the regressor."""
OUTSIDE_PLOTS = {"push": (effects.CRAB, effects.DIRECTION)}
"""Plots of what is not in the catalogue; of all else the turning rate over the wheel angle."""


def build_residual_plot(problem: Problem, base: Fit, fit: Fit, name: str) -> ResidualPlot | None:
    """The curve of an effect, or of a hypothesis with its law as its text names it; None where too little is measured.

    `base` is the fit of the nuisances alone, `fit` that with everything found, both weighed by the noise as it is now.
    """
    quantity, regressor = select_axes(name)
    channel = CHANNEL_BY_QUANTITY[quantity]
    responses = build_responses(problem, quantity)
    values = read_regressor(problem, base, regressor, responses[0].shape[2])
    data = problem.data
    speed = np.abs(data.cut(data.path["speed"], values.shape[1]))
    moving = speed > ALIKE_SHARE * float(np.median(speed))
    by_channel = {"pose": data.east, "wheel": data.wheel, "speed": data.speed}
    measured = data.heading if quantity == effects.CRAB else by_channel[CHANNEL_BY_QUANTITY[quantity]]
    used = np.asarray(moving & measured.observed)
    if used.sum() < FEWEST_ROWS:
        return None
    bins = number_bins(values, used)
    kept = [number for number in range(CURVE_BINS) if (bins == number).sum() >= FEWEST_TIMES]
    columns = [(one * (bins == number)[:, None, :]).sum(axis=2) for one in responses for number in kept]
    design, count = np.stack(columns, axis=2), len(kept)
    before, after = (estimate_bins(problem, channel, design, one.residuals[channel]) for one in (base, fit))
    centres = np.array([values[bins == number].mean() for number in kept])
    found, limit = next((one for one in fit.model if str(one) == name and name in LIMIT_UNITS), None), None
    if found is not None:
        parameter, unit = LIMIT_UNITS[name]
        value = compute_values(problem, found, fit.get_amounts(found))[parameter]
        limit = value * unit if math.isfinite(value) else None
    (mean, error), (mean_after, error_after) = ([part[:count] for part in one] for one in (before, after))
    return ResidualPlot(
        REGRESSORS[regressor], QUANTITIES[quantity], centres, mean, error, mean_after, error_after, limit
    )


def select_axes(name: str) -> tuple[str, str]:
    """The quantity and the regressor of an effect or of a hypothesis with its law."""
    effect_id, _, basis = name.partition("@")
    effect = effects.EFFECTS_BY_ID.get(effect_id)
    outside = OUTSIDE_PLOTS.get(effect_id, (effects.TURN, effects.ANGLE))
    quantity, regressor = outside if effect is None else effect.plot
    return quantity, REGRESSOR_BY_LAW.get(basis, regressor)


def read_regressor(problem: Problem, base: Fit, regressor: str, cells: int) -> Floats:
    """A regressor in the cells of the windows (w, cells)."""
    data, path = problem.data, problem.data.path
    # The turning rate to the right (m,) for which the tractor steers, scaled to that of the base model: sorted by the
    # measured one, its own noise would look like an error.
    steered = path["speed"] * np.tan(path["steady"]) / problem.rig.tractor.wheelbase_m
    whole = np.asarray(data.heading.observed.all(axis=1))
    heading = np.asarray(problem.measured[:, :, 2]) - base.residuals["pose"].reshape(data.windows, 3, -1)[:, 2]
    rates, turned = np.gradient(heading[whole], POSE_CELL_S, axis=1), data.cut(steered, POSE_CELLS)[whole]
    size = float((turned * turned).sum())
    turning = steered * (-float((rates * turned).sum()) / size if size > 0.0 else 1.0)
    series = {
        effects.ANGLE: np.degrees(path["steady"]),
        effects.STEERING_SPEED: np.degrees(path["steady"]),
        effects.COMMAND_RATE: np.degrees(data.command[::STRIDE]),
        effects.SIDE_FORCE: path["speed"] * turning,
        effects.DIRECTION: 90.0 - np.degrees(path["heading"]),
        effects.TOOL: path["working"],
        effects.TARGET: np.abs(data.target[::STRIDE]),
        effects.TARGET_RATE: np.abs(data.target[::STRIDE]),
        effects.TURNING: np.degrees(turning),
        effects.TIME: path["seconds"],
        effects.SPEED: np.abs(path["speed"]),
    }
    means = data.cut(series[regressor], cells)
    if regressor in RATES:
        return np.asarray(np.gradient(means, WINDOW_S / cells, axis=1))
    return np.mod(means, 360.0) if regressor == effects.DIRECTION else means


def build_responses(problem: Problem, quantity: str) -> list[Floats]:
    """Change of the residuals of a channel (w, n, cells) per unit of the quantity in each cell.

    Others may follow that are estimated beside it: where headings tell a turning rate from an angle to the course.
    """
    data = problem.data
    if CHANNEL_BY_QUANTITY[quantity] == "pose":
        turn = -math.radians(1.0) * build_yaw_response(data, problem.rig.tractor.antenna_forward_m)  # to the right
        if not data.heading.observed.any():
            return [turn]
        speed, heading, _ = cut_motion(data)
        aside = integrate_cells() * (math.radians(1.0) * speed)[:, None, :]
        east, north = aside * np.sin(heading)[:, None, :], -aside * np.cos(heading)[:, None, :]
        crab = np.concatenate([east, north, np.zeros_like(east)], axis=1)
        return [turn, crab] if quantity == effects.TURN else [crab, turn]
    cells = np.broadcast_to(np.eye(SENSOR_CELLS), (data.windows, SENSOR_CELLS, SENSOR_CELLS))
    if quantity == effects.WHEEL:
        return [math.radians(1.0) * cells]
    return [cells * np.sign(data.cut(data.path["speed"], SENSOR_CELLS))[:, :, None]]


def number_bins(values: Floats, used: Flags) -> Floats:
    """The bin of every cell, -1 where unused: half by rank, so that bins are filled, and half by size, so that a limit
    that few cells reach is shown."""
    inside = np.sort(values[used])
    low, spread = inside[0], max(float(inside[-1] - inside[0]), 1e-12)
    by_rank = np.searchsorted(inside, values, side="right") / len(inside)
    share = 0.5 * by_rank + 0.5 * np.clip((values - low) / spread, 0.0, 1.0)
    return np.where(used, np.minimum((CURVE_BINS * share).astype(np.int64), CURVE_BINS - 1), -1)


def estimate_bins(problem: Problem, channel: str, design: Floats, residuals: Floats) -> tuple[Floats, Floats]:
    """Means of bins and their standard errors, from columns (w, n, bins) and residuals (w, n).

    An error is the larger one of what the noise gives and of what windows differ by.
    """
    noise = problem.noise[channel]
    white = noise.whiten(residuals)
    roots = np.sqrt(noise.compute_weights(white))
    columns, rest = noise.whiten(design) * roots[:, None, None], white * roots[:, None]
    flat = columns.reshape(-1, columns.shape[2])
    covariance = np.linalg.pinv(flat.T @ flat, hermitian=True)
    means = covariance @ (flat.T @ rest.ravel())
    scores = np.einsum("wnb,wn->wb", columns, rest - columns @ means) @ covariance
    return means, np.sqrt(np.maximum(np.diag(covariance), (scores * scores).sum(axis=0)))
