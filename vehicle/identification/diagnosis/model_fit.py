"""Fitting a model, a list of hypotheses, to the logs: residuals, evidence, the most likely amounts, the scan.

A fit is linear least squares about where it stands, weighted as the likelihood weighs the windows: that says what a
further hypothesis would gain.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fields.arrays import Flags, Floats
from vehicle.identification.diagnosis.drive_data import DriveData
from vehicle.identification.diagnosis.grammar import (
    BY_RUN,
    Bases,
    Hypothesis,
    collect_widths,
    split_amounts,
    sum_fields,
)
from vehicle.identification.diagnosis.noise import SENSOR_PARTS, ChannelNoise, build_pose_noise, build_sensor_noise
from vehicle.identification.replay.drive_segments import ReplayRig
from vehicle.identification.replay.simulation import CHAINS, SENSOR_FIELDS, Simulator

CHANNELS = ("pose", "wheel", "speed")
SCAN_STEP, FIT_STEP = 0.5, 0.04  # widths: the secant of an untried hypothesis, and that of a fit
SETTLED_NATS = 0.05
NEAR_WIDTHS, MOST_STORED = 0.15, 3  # a change of the prediction is used again within so many widths of its amounts
MOST_DAMPINGS = 6
SEARCH_WIDTHS = (-1.0, -0.5, -0.25, -0.1, 0.1, 0.25, 0.5, 1.0)
NOISE_ITERATIONS = 40
Residuals = dict[str, Floats]
Model = tuple[Hypothesis, ...]

# Effects of the steering system act by thresholds: their cost has many minima, and both signs are tried.
RUGGED_CHAINS = frozenset({"steering"})


@dataclass(frozen=True, eq=False)
class Fit:
    """A model with its most likely amounts: cost (nats), residuals, and the curvature of the cost per width (k, k)."""

    model: Model
    amounts: Floats
    cost: float
    residuals: Residuals
    curvature: Floats

    @property
    def evidence(self) -> float:
        """Log evidence by Laplace's method, up to a constant: the noise is part of the cost."""
        sign, log_size = np.linalg.slogdet(self.curvature)
        penalty = sum(hypothesis.penalty for hypothesis in self.model)
        return -self.cost - 0.5 * float(log_size if sign > 0 else 0.0) - penalty

    @property
    def causes(self) -> frozenset[str]:
        """What the model holds beside the nuisances."""
        return frozenset(str(one) for one in self.model if not one.is_nuisance)

    def get_amounts(self, hypothesis: Hypothesis) -> Floats:
        """The amounts of one of its hypotheses."""
        return self.amounts[self.locate(hypothesis)]

    def locate(self, hypothesis: Hypothesis) -> slice:
        """The place of a hypothesis among the amounts."""
        start = 0
        for one in self.model:
            if one == hypothesis:
                return slice(start, start + one.size)
            start += one.size
        raise KeyError(str(hypothesis))


@dataclass(eq=False)
class Problem:
    """Data, simulator and noise of a diagnosis."""

    data: DriveData
    rig: ReplayRig
    noise: dict[str, ChannelNoise] = field(init=False)
    changes: dict[tuple[str, int, float], list[tuple[dict[tuple[str, int], float], Residuals]]] = field(
        default_factory=dict
    )

    def __post_init__(self) -> None:
        self.simulator, self.bases = Simulator(self.data, self.rig), Bases(self.data)
        tractor = self.rig.tractor
        self.noise = {
            "pose": build_pose_noise(self.data, tractor.antenna_forward_m, tractor.wheelbase_m),
            **{channel: build_sensor_noise(self.data, channel) for channel in SENSOR_PARTS},
        }
        data = self.data
        self.measured = np.stack([data.east.values, data.north.values, data.heading.values], axis=2)
        self.seen = np.stack([one.observed for one in (data.east, data.north, data.heading)], axis=2).astype(np.float64)

    def compute_residuals(self, model: Sequence[Hypothesis], amounts: Floats) -> Residuals:
        """Residuals (w, n) per channel; a pose is first laid on the measurement, as the start of a window is free."""
        fields = sum_fields(model, amounts, self.bases, self.simulator.base)
        own = [(one, tuple(part)) for one, part in split_amounts(model, amounts) if np.any(part)]
        keys = {chain: tuple((str(one), part) for one, part in own if chain in one.chains) for chain in CHAINS}
        shown = self.simulator.simulate(fields, keys)
        predicted = np.stack([shown["east"], shown["north"], shown["heading"]], axis=2)
        data = self.data
        return {
            "pose": self._align(predicted),
            "wheel": (data.wheel.values - shown["wheel"]) * data.wheel.observed,
            "speed": (data.speed.values - shown["speed"]) * data.speed.observed,
        }

    def _align(self, predicted: Floats) -> Floats:
        seen, measured = self.seen, self.measured
        counts = np.maximum(seen.sum(axis=1), 1.0)
        m = measured[:, :, :2] - ((measured * seen).sum(axis=1) / counts)[:, None, :2]
        p = predicted[:, :, :2] - ((predicted * seen).sum(axis=1) / counts)[:, None, :2]
        off = ((measured[:, :, 2] - predicted[:, :, 2]) * seen[:, :, 2]).sum(axis=1) / counts[:, 2]
        cross = ((p[:, :, 0] * m[:, :, 1] - p[:, :, 1] * m[:, :, 0]) * seen[:, :, 0]).sum(axis=1)
        dot = ((p * m).sum(axis=2) * seen[:, :, 0]).sum(axis=1)
        turn = np.where(seen[:, :, 2].sum(axis=1) > 2, off, np.arctan2(cross, dot))
        cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
        east = m[:, :, 0] - p[:, :, 0] * cosine + p[:, :, 1] * sine
        north = m[:, :, 1] - p[:, :, 0] * sine - p[:, :, 1] * cosine
        heading = measured[:, :, 2] - predicted[:, :, 2] - turn[:, None]
        out = np.stack([east, north, heading], axis=1) * seen.transpose(0, 2, 1)
        return np.asarray(out.reshape(len(out), -1))

    def compute_cost(self, model: Sequence[Hypothesis], amounts: Floats, residuals: Residuals) -> float:
        """Minus the log posterior of amounts (nats)."""
        scaled = amounts / collect_widths(model)
        likelihood = sum(
            float(noise.compute_log_density(noise.whiten(residuals[channel])).sum())
            for channel, noise in self.noise.items()
        )
        return -likelihood + 0.5 * float(scaled @ scaled)

    def compute_secants(
        self, model: Model, amounts: Floats, residuals: Residuals, places: Iterable[int], step: float,
        is_fresh: bool = False,
    ) -> dict[str, Floats]:  # fmt: skip
        """Whitened change of the prediction per width of coordinates (w, n, k); `is_fresh` uses no stored ones."""
        names = [(str(one), number) for one in model for number in range(one.size)]
        columns = [
            self._get_change(model, amounts, residuals, place, names[place], step, NEAR_WIDTHS * (not is_fresh))
            for place in places
        ]
        return {
            channel: self.noise[channel].whiten(np.stack([column[channel] for column in columns], axis=2))
            for channel in CHANNELS
        }

    def _get_change(
        self, model: Model, amounts: Floats, residuals: Residuals, place: int, name: tuple[str, int], step: float,
        near: float,
    ) -> Residuals:  # fmt: skip
        """The change of the prediction per width of one coordinate, there or within `near` widths. Runs do not know
        each other: what an effect of one run changes is what the same effect changes in that run."""
        own = next(one for one in model if str(one) == name[0])
        if own.basis == BY_RUN:
            constant = own.make_constant()
            starts = np.cumsum([0, *(one.size for one in model)])
            known = [int(start) for one, start in zip(model, starts, strict=False) if str(one) == str(constant)]
            if not known:
                model, amounts, known = (*model, constant), np.append(amounts, 0.0), [len(amounts)]
            change = self._get_change(model, amounts, residuals, known[0], (str(constant), 0), step, near)
            inside = (self.data.window_runs == name[1])[:, None]
            return {channel: values * inside for channel, values in change.items()}
        widths = collect_widths(model)
        chains = own.chains
        point = {
            (str(one), number): part[number] / coordinate.width
            for one, part in split_amounts(model, amounts)
            for number, coordinate in enumerate(one.coordinates)
            if one.chains & chains
        }
        stored = self.changes.setdefault((*name, step if abs(step) > 2.0 * FIT_STEP else 0.0), [])
        for other, change in stored:
            if all(abs(point.get(key, 0.0) - other.get(key, 0.0)) <= near for key in point.keys() | other.keys()):
                return change
        moved = amounts.copy()
        moved[place] += step * widths[place]
        shown = self.compute_residuals(model, moved)
        change = {channel: (residuals[channel] - shown[channel]) / step for channel in CHANNELS}
        stored.insert(0, (point, change))
        del stored[MOST_STORED:]
        return change

    def weigh(self, residuals: Residuals) -> tuple[Residuals, dict[str, Floats]]:
        """Whitened residuals and the roots of the weights of windows."""
        white = {channel: noise.whiten(residuals[channel]) for channel, noise in self.noise.items()}
        return white, {channel: np.sqrt(self.noise[channel].compute_weights(own)) for channel, own in white.items()}

    def refit(self, model: Model, amounts: Floats, iterations: int = 10) -> Fit:
        """The most likely amounts from a start, by damped Gauss-Newton steps inside the limits, at this noise.

        Where the iterations end before the amounts settle, the curvature is that of where the last step began.
        """
        widths, bounds = collect_widths(model), collect_bounds(model)
        amounts = np.clip(amounts, *bounds)
        residuals = self.compute_residuals(model, amounts)
        cost, damping = self.compute_cost(model, amounts, residuals), 1e-3
        curvature, is_fresh = np.eye(len(amounts)), False
        for _ in range(iterations):
            linear = self.linearise(model, amounts, residuals, is_fresh=is_fresh)
            curvature, slope = linear.curvature, linear.matrix.T @ linear.target - amounts / widths
            for _ in range(MOST_DAMPINGS):
                step = _solve_inside(curvature, slope, damping, amounts, widths, bounds)
                tried = np.clip(amounts + widths * step, *bounds)
                tried_residuals = self.compute_residuals(model, tried)
                tried_cost = self.compute_cost(model, tried, tried_residuals)
                if tried_cost < cost - 1e-6:
                    gained, damping = cost - tried_cost, 0.3 * damping
                    amounts, residuals, cost = tried, tried_residuals, tried_cost
                    break
                damping = max(8.0 * damping, 1e-2)
            else:
                gained, damping = 0.0, 1e-3
            if gained < SETTLED_NATS:
                if is_fresh:
                    break
                is_fresh = True
        return Fit(model, amounts, cost, residuals, curvature)

    def linearise(
        self, model: Model, amounts: Floats, residuals: Residuals, step: float = FIT_STEP, is_fresh: bool = False
    ) -> Linearisation:
        """The linear problem at these amounts; `is_fresh` computes all changes here."""
        white, roots = self.weigh(residuals)
        places = range(len(amounts))
        return Linearisation(self.compute_secants(model, amounts, residuals, places, step, is_fresh), white, roots)

    def linearise_inside(self, fit: Fit) -> Linearisation:
        """The linear problem at a fit without nuisances at a limit, which can take up no more of an effect."""
        linear, (low, high) = self.linearise(fit.model, fit.amounts, fit.residuals), collect_bounds(fit.model)
        is_cause = np.repeat([not one.is_nuisance for one in fit.model], [one.size for one in fit.model])
        inside = is_cause | ((fit.amounts > low) & (fit.amounts < high))
        return replace(linear, changes={channel: values[:, :, inside] for channel, values in linear.changes.items()})

    def fit(self, model: Model, amounts: Floats, rounds: int = 3, iterations: int = 12) -> Fit:
        """Amounts and noise in turn, and the amounts once more; rugged effects by a line of sizes first."""
        fit = self.refit(model, self.search_lines(model, amounts), iterations)
        for _ in range(rounds):
            self.fit_noise(fit.residuals)
            before = self.compute_cost(model, fit.amounts, fit.residuals)
            fit = self.refit(model, fit.amounts, iterations)
            if before - fit.cost < 1.0:
                break
        return fit

    def search_lines(self, model: Model, amounts: Floats) -> Floats:
        """Try sizes along every rugged effect and keep the best."""
        widths, bounds = collect_widths(model), collect_bounds(model)
        best = np.clip(amounts, *bounds)
        cost = self.compute_cost(model, best, self.compute_residuals(model, best))
        place = 0
        for hypothesis in model:
            if not hypothesis.is_nuisance and (hypothesis.starts or hypothesis.chains & RUGGED_CHAINS):
                start = best.copy()
                for step in hypothesis.starts or SEARCH_WIDTHS:
                    tried = start.copy()
                    tried[place] = step * widths[place] + start[place] * (not hypothesis.starts)
                    tried = np.clip(tried, *bounds)
                    tried_cost = self.compute_cost(model, tried, self.compute_residuals(model, tried))
                    if tried_cost < cost:
                        best, cost = tried, tried_cost
            place += hypothesis.size
        return best

    def fit_noise(self, residuals: Residuals, channels: Collection[str] = CHANNELS) -> None:
        """Fit the noise of channels to residuals."""
        for channel in channels:
            self.noise[channel].fit(residuals[channel], NOISE_ITERATIONS)

    def list_channels(self, hypothesis: Hypothesis) -> frozenset[str]:
        """Channels whose prediction a hypothesis can change."""
        names = {name for coordinate in hypothesis.coordinates for name, _ in coordinate.slopes}
        channels = {"pose"} if hypothesis.chains & {"path", "instruments"} else set()
        if hypothesis.chains & {"steering"}:
            channels |= {"wheel"} if self.data.has_wheel.all() else {"wheel", "pose"}
        channels |= {"speed"} if hypothesis.chains & {"speed"} else set()
        return frozenset(channels | {channel for channel, own in SENSOR_FIELDS.items() if names & set(own)})

    def get_noise(self) -> dict[str, Floats]:
        """The amounts of the noise, to return to."""
        return {channel: noise.amounts.copy() for channel, noise in self.noise.items()}

    def set_noise(self, amounts: dict[str, Floats]) -> None:
        """Return to earlier amounts of the noise."""
        for channel, noise in self.noise.items():
            if not np.array_equal(noise.amounts, amounts[channel]):
                noise.set_amounts(amounts[channel])

    def scan(self, fit: Fit, hypotheses: Iterable[Hypothesis]) -> list[Gain]:
        """What every hypothesis would gain on top of a fit, the best first, by secants at half a width."""
        linear, gains = self.linearise_inside(fit), list[Gain]()
        for hypothesis in hypotheses:
            amounts, found = np.append(fit.amounts, np.zeros(hypothesis.size)), list[Gain]()
            places = range(len(fit.amounts), len(amounts))
            for step in hypothesis.starts or [SCAN_STEP * sign for sign in list_signs(hypothesis)]:
                secants = self.compute_secants((*fit.model, hypothesis), amounts, fit.residuals, places, step)
                gain = linear.predict_gain(hypothesis, linear.stack(secants), math.copysign(1.0, step))
                if gain is not None and hypothesis.starts:
                    gain = replace(gain, amounts=step * collect_widths((hypothesis,)))
                found += [] if gain is None else [gain]
            gains += [max(found, key=lambda one: one.nats)] if found else []
        return sorted(gains, key=lambda one: -one.nats)


def collect_bounds(model: Sequence[Hypothesis]) -> tuple[Floats, Floats]:
    """Limits of all coordinates of a model."""
    coordinates = [one for hypothesis in model for one in hypothesis.coordinates]
    return np.array([one.low for one in coordinates]), np.array([one.high for one in coordinates])


def _solve_inside(
    curvature: Floats, slope: Floats, damping: float, amounts: Floats, widths: Floats, bounds: tuple[Floats, Floats]
) -> Floats:
    """A damped step in widths; what would leave its limits stays there, and the others are solved without it."""
    low, high = (bounds[0] - amounts) / widths, (bounds[1] - amounts) / widths
    free, step = np.ones(len(slope), dtype=np.bool_), np.zeros(len(slope))
    damped = curvature + damping * np.diag(np.diag(curvature))
    for _ in range(len(slope)):
        right = slope - damped[:, ~free] @ step[~free]
        step[free] = np.linalg.solve(damped[np.ix_(free, free)], right[free])
        out = free & ((step < low - 1e-12) | (step > high + 1e-12))
        if not out.any():
            break
        step[out] = np.clip(step[out], low[out], high[out])
        free &= ~out
        if not free.any():
            break
    return step


@dataclass(frozen=True)
class Gain:
    """What a hypothesis would gain on top of a fit (nats, less its penalty), by linear prediction, and its amounts."""

    nats: float
    hypothesis: Hypothesis
    amounts: Floats


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Per channel the whitened change of the prediction per width of each amount (w, n, k), the whitened residuals
    (w, n), and the roots of the weights of the windows (w,)."""

    changes: Mapping[str, Floats]
    residuals: Mapping[str, Floats]
    roots: Mapping[str, Floats]

    @cached_property
    def matrix(self) -> Floats:
        """Weighted changes of all channels (rows, k)."""
        return self.stack(self.changes)

    @cached_property
    def target(self) -> Floats:
        """Weighted residuals of all channels (rows,)."""
        return self.stack({channel: values[:, :, None] for channel, values in self.residuals.items()})[:, 0]

    @cached_property
    def curvature(self) -> Floats:
        """Curvature (k, k) of the cost per width, with the prior."""
        return np.asarray(np.eye(self.matrix.shape[1]) + self.matrix.T @ self.matrix)

    @cached_property
    def inverse(self) -> Floats:
        """The inverse of the curvature."""
        return np.asarray(np.linalg.inv(self.curvature), dtype=np.float64)

    def stack(self, changes: Mapping[str, Floats]) -> Floats:
        """Whitened changes per channel (w, n, j) as one weighted matrix (rows, j)."""
        parts = [(changes[c] * root[:, None, None]).reshape(-1, changes[c].shape[2]) for c, root in self.roots.items()]
        return np.concatenate(parts)

    def sum_windows(self, inside: Flags) -> tuple[Floats, Floats]:
        """What some windows (w,) add to the curvature (k, k), and to the slope of the likelihood per width (k,)."""
        size = self.matrix.shape[1]
        information, slope = np.zeros((size, size)), np.zeros(size)
        for channel, root in self.roots.items():
            weights = root[inside][:, None]
            columns = (self.changes[channel][inside] * weights[:, :, None]).reshape(-1, size)
            information += columns.T @ columns
            slope += columns.T @ (self.residuals[channel][inside] * weights).ravel()
        return information, slope

    def step_without(self, inside: Flags) -> tuple[Floats, Floats]:
        """The step in widths (k,) to the amounts that the other windows give, and the curvature (k, k) these leave."""
        information, slope = self.sum_windows(inside)
        curvature = self.curvature - information
        return np.asarray(-np.linalg.solve(curvature, slope), dtype=np.float64), curvature

    def reduce(self, columns: Floats) -> Floats:
        """Weighted columns (rows, j) without what the amounts of the fit would take up of them."""
        return np.asarray(columns - self.matrix @ (self.inverse @ (self.matrix.T @ columns)))

    def predict_gain(self, hypothesis: Hypothesis, columns: Floats, sign: float) -> Gain | None:
        """The gain beside the fit by columns (rows, k) that were computed with this sign; None on the wrong side."""
        own = self.reduce(columns)
        curvature = columns.T @ own + np.eye(hypothesis.size)
        slope = own.T @ self.target
        amounts = np.linalg.solve(curvature, slope)
        if hypothesis.size == 1:
            coordinate = hypothesis.coordinates[0]
            if (amounts[0] < 0.0 and coordinate.low >= 0.0) or (amounts[0] > 0.0 and coordinate.high <= 0.0):
                return None
            if len(list_signs(hypothesis)) > 1 and amounts[0] * sign < 0.0:
                return None
        nats = 0.5 * float(slope @ amounts) - 0.5 * float(np.linalg.slogdet(curvature)[1]) - hypothesis.penalty
        widths = np.array([one.width for one in hypothesis.coordinates])
        return Gain(nats, hypothesis, amounts * widths)


def list_signs(hypothesis: Hypothesis) -> tuple[float, ...]:
    """Directions to try: of effects of the steering system, and of limits, both sides act differently."""
    low, high = hypothesis.coordinates[0].low, hypothesis.coordinates[0].high
    if low >= 0.0:
        return (1.0,)
    if high <= 0.0:
        return (-1.0,)
    return (1.0, -1.0) if hypothesis.chains & RUGGED_CHAINS else (1.0,)
