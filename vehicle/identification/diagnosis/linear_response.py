"""What hypotheses would add to the poses of all windows by geometry alone, so that many are scored at once: laws of a
field of the model, and circles of the ground in which the tractor turns otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.diagnosis.drive_data import PATH_STEP_S, POSE_CELL_S, POSE_CELLS, DriveData
from vehicle.identification.diagnosis.grammar import PATCH_RADII_M, PENALTIES, WIDTH_PER_TYPICAL, Coordinate, Hypothesis
from vehicle.identification.diagnosis.linearisation import Gain
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.noise import build_yaw_response, cut_motion, integrate_cells
from vehicle.identification.logs.schema import Array
from vehicle.identification.logs.thresholds import LASTING_S
from vehicle.model.effects import get_effect

SPACING = 0.7  # of the radius between the centres that are tried
FINEST_MOVE_M, FIRST_MOVE_M, SMALLEST_RADIUS_M = 0.5, 4.0, 3.0
MOVES = ((1, 0, 0.0), (-1, 0, 0.0), (0, 1, 0.0), (0, -1, 0.0), (0, 0, 0.5), (0, 0, -0.5))
LARGEST_PATCH_SHARE = 0.7  # of the driving: a circle that holds more is no place
MIDDLE_SHARE = 0.25  # of the spread of the driving: the circle by which it is told how small a patch would show
Circle = tuple[float, float, float]


def build_patch(circle: Circle) -> Hypothesis:
    """A change of grip inside a circle."""
    size = get_effect("grip_patch").size
    width, key = WIDTH_PER_TYPICAL * size.typical, ":".join(["by_place", *(f"{one:.2f}" for one in circle)])
    coordinate = Coordinate((("bend", 1.0),), width, size.low - 1.0, size.high - 1.0, key)
    return Hypothesis("grip_patch", key, (coordinate,), PENALTIES["place"], size.finest, place=circle)


def find_middle_circle(data: DriveData) -> Circle:
    """A circle about the middle of the driving, with a quarter of its spread."""
    east, north = data.path["east"], data.path["north"]
    radius = MIDDLE_SHARE * float(max(np.ptp(east), np.ptp(north)))
    return float(np.median(east)), float(np.median(north)), radius


@dataclass(eq=False)
class CircleSearch:
    """Scores circles beside a fit by what they add to the yaw rate, all at once."""

    problem: Problem
    fit: Fit

    def __post_init__(self) -> None:
        problem, fit = self.problem, self.fit
        self.noise = problem.noise["pose"]
        response = build_yaw_response(problem.data, problem.rig.tractor.antenna_forward_m)
        # The turning of the fit, not that which was measured: a circle changes only what the wheels turn.
        heading = cut_motion(problem.data)[1] - fit.residuals["pose"][:, 2 * POSE_CELLS :]
        yaw = np.gradient(heading, POSE_CELL_S, axis=1)
        linear = problem.linearise(fit.model, fit.amounts, fit.residuals)
        root = linear.roots["pose"][:, None, None]
        self.response = root * self.noise.whiten(response * yaw[:, None, :])
        self.rest = (root[:, :, 0] * linear.residuals["pose"]).ravel()
        self.inverse = linear.inverse
        self.known = (root * linear.changes["pose"]).reshape(len(self.rest), -1)
        # Directions that the model explains already, also by other channels, take their part of the rest.
        self.slope = linear.matrix.T @ linear.target

    def find_best(self) -> Gain | None:
        """The best circle, moved and resized until nothing is gained."""
        path = self.problem.data.path
        low = (float(path["east"].min()), float(path["north"].min()))
        high = (float(path["east"].max()), float(path["north"].max()))
        circles = [
            (float(east), float(north), radius)
            for radius in PATCH_RADII_M
            for east in np.arange(low[0], high[0] + 1.0, SPACING * radius)
            for north in np.arange(low[1], high[1] + 1.0, SPACING * radius)
        ]
        best, move = self._choose(circles), FIRST_MOVE_M
        while best is not None and move >= FINEST_MOVE_M:
            east, north, radius = best[1]
            near = [(east + i * move, north + j * move, max(radius + k * move, SMALLEST_RADIUS_M))
                    for i, j, k in MOVES]  # fmt: skip
            other = self._choose(near)
            if other is not None and other[0] > best[0] + 0.1:
                best = other
            else:
                move *= 0.5
        if best is None:
            return None
        patch = build_patch(best[1])
        return Gain(best[0] - patch.penalty, patch, np.array([best[2] * patch.coordinates[0].width]))

    def _choose(self, circles: Sequence[Circle]) -> tuple[float, Circle, float] | None:
        """The best of some circles: nats, the circle, and its amount in widths."""
        kept, columns = [], []
        for circle in circles:
            inside = self.problem.bases.find_circle(*circle)
            if inside.sum() >= round(LASTING_S / PATH_STEP_S) and inside.mean() <= LARGEST_PATCH_SHARE:
                kept.append(circle)
                columns.append(self.problem.data.cut(inside.astype(np.float64), POSE_CELLS))
        if not kept:
            return None
        width = WIDTH_PER_TYPICAL * get_effect("grip_patch").size.typical
        own = np.stack(columns, axis=2)
        values = width * (self.response @ own).reshape(len(self.rest), -1)
        crossed = self.known.T @ values
        curvature = (values * values).sum(axis=0) - (crossed * (self.inverse @ crossed)).sum(axis=0) + 1.0
        slope = values.T @ self.rest - crossed.T @ (self.inverse @ self.slope)
        nats = 0.5 * slope * slope / curvature - 0.5 * np.log(curvature)
        place = int(np.argmax(nats))
        return float(nats[place]), kept[place], float(slope[place] / curvature[place])


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
