"""What a small change of a field would add to the poses of all windows, by geometry alone: many laws at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vehicle.identification.diagnosis.drive_data import POSE_CELLS
from vehicle.identification.diagnosis.grammar import Hypothesis
from vehicle.identification.diagnosis.linearisation import Gain
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.noise import build_yaw_response, cut_motion, integrate_cells
from vehicle.identification.logs.schema import Array


class PoseResponse:
    """The response of the poses beside a fit, and what laws would gain by it."""

    def __init__(self, problem: Problem, fit: Fit) -> None:
        self.problem, self.fit = problem, fit
        tractor = problem.rig.tractor
        self.by_yaw = build_yaw_response(problem.data, tractor.antenna_forward_m)
        self.speed, heading, self.yaw = cut_motion(problem.data)
        self.cosine, self.sine = np.cos(heading), np.sin(heading)
        data = problem.data
        east, north = data.cut(data.path["east"], POSE_CELLS), data.cut(data.path["north"], POSE_CELLS)
        self.east, self.north = (values - values.mean(axis=1, keepdims=True) for values in (east, north))
        wheel = problem.data.cut(problem.data.path["steady"], POSE_CELLS)
        self.per_angle = -self.speed / (tractor.wheelbase_m * np.cos(wheel) ** 2)

    def compute(self, field: str, values: Array) -> Array:
        """The change (w, 3 n) of east, north and heading where a field changes by values in the cells (w, n)."""
        none = np.zeros_like(values)
        match field:
            case "offset":
                return self._turn(self.per_angle * values)
            case "bend":
                return self._turn(self.yaw * values)
            case "heading_bias":
                return np.concatenate([none, none, values], axis=1)
            case "shift_forward":
                return np.concatenate([self.cosine * values, self.sine * values, none], axis=1)
            case "shift_right":
                return np.concatenate([self.sine * values, -self.cosine * values, none], axis=1)
            case "speed_scale":
                total, less = integrate_cells().T, -self.speed * values
                return np.concatenate([(self.cosine * less) @ total, (self.sine * less) @ total, none], axis=1)
        raise ValueError(f"The response to {field!r} is not known.")

    def _turn(self, rate: Array) -> Array:
        return np.asarray((self.by_yaw @ rate[:, :, None])[:, :, 0])

    def scan(self, hypotheses: Sequence[Hypothesis]) -> list[Gain]:
        """What hypotheses of one coordinate and one field would gain beside the fit, the best first."""
        problem, fit = self.problem, self.fit
        linear = problem.linearise(fit.model, fit.amounts, fit.residuals)
        shown = np.stack([self._respond(one) for one in hypotheses], axis=2)
        columns = linear.stack({
            channel: problem.noise[channel].whiten(shown) if channel == "pose"
            else np.zeros((*residuals.shape, len(hypotheses)))
            for channel, residuals in fit.residuals.items()
        })  # fmt: skip
        gains = (linear.predict_gain(one, columns[:, [number]], 1.0) for number, one in enumerate(hypotheses))
        return sorted((gain for gain in gains if gain is not None), key=lambda gain: -gain.nats)

    def align(self, change: Array) -> Array:
        """A change (w, 3 n) after each window is laid on what was measured, as residuals are."""
        east, north, heading = np.split(change, 3, axis=1)
        turn = heading.mean(axis=1, keepdims=True)
        moved = (east + turn * self.north, north - turn * self.east, heading)
        return np.concatenate([values - values.mean(axis=1, keepdims=True) for values in moved], axis=1)

    def _respond(self, hypothesis: Hypothesis) -> Array:
        """The change (w, 3 n) per width."""
        coordinate = hypothesis.coordinates[0]
        field, slope = coordinate.slopes[0]
        basis = self.problem.data.cut(self.problem.bases.get(coordinate.basis), POSE_CELLS)
        values = coordinate.width * slope * basis
        return self.align(self.compute(field, values))
