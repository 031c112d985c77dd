"""What keeps tractors from harm: the fence, the distance between them, and what a remote command may do."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
import shapely.affinity

from planner.service.centre.course import Course
from planner.service.centre.fleet_plan import FleetPlan
from planner.service.centre.foresight import (
    STEP_S,
    NoTwins,
    Virtual,
    arc,
    braking_s,
    centres,
    foreseen,
    moments,
    standing,
)
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import AUTOMATIC, BY_HAND, NEAR, TractorState
from vehicle.approach import approaches, distances
from vehicle.compile import compile_model, outline
from vehicle.missions import ENTER, LEAVE
from vehicle.tractor import Implement, Tractor

Array = npt.NDArray[np.float64]
AWAY_M = 0.01  # rounding, of distances that must not become smaller
MOVING_MPS = 0.05
FORESEEN_M, CONTACT_M = 0.15, 0.05  # error of poses foreseen along legs; as good as touching
KEPT = 0.9  # of how near two come by the plan: no more is asked of those that go on, as they would stand for ever
BOTH = np.ones(2, dtype=np.bool_)


@dataclass(frozen=True)
class Danger:
    """Two tractors that will be too near, or one that leaves the fence (`second` is None): in how many seconds.

    `urgent` where no more time is left than it takes to stand. Of two, `metres` is how near they come first that is too
    near, and `least_m` the nearest of all that is foreseen.
    """

    first: int
    second: int | None
    in_s: float
    metres: float
    urgent: bool
    least_m: float = 0.0


class Guard:
    """Watches the tractors of one plan; what `twins` foretell is heeded of those that are driven by hand."""

    def __init__(self, plan: FleetPlan, rules: Rules, twins: Virtual | None = None) -> None:
        self.tractor, self.rules, self.twins = plan.tractor, rules, twins or NoTwins()
        self.model = np.array([compile_model(plan.tractor, plan.implement)])
        self.boxes = footprint(plan.tractor, plan.implement)
        self.clearance_m = min(rules.clearance_m, plan.clearance_m)
        self.beside_m = min(rules.beside_m, self.clearance_m)
        more_m = max(min(rules.release_m, KEPT * plan.near_m - self.clearance_m), 0.0)
        self.release = self.clearance_m + more_m, self.beside_m + more_m
        self.fence = shapely.buffer(plan.ground, rules.fence_margin_m, quad_segs=4)
        shapely.prepare(self.fence)

    def there(self, states: Sequence[TractorState], courses: Sequence[Course]) -> npt.NDArray[np.bool_]:
        """Who is on the field (n,): known, come in through the entrance, and not gone again."""
        return np.array([_there(state, course) for state, course in zip(states, courses, strict=True)], dtype=np.bool_)

    def paths(self, states: Sequence[TractorState], courses: Sequence[Course]) -> Array:
        """Foreseen antenna poses (n, steps, 3); zeros for who has never been heard of."""
        times = moments(self.rules)
        nowhere = np.zeros((len(times), 3))
        return np.array([
            nowhere if state.report is None
            else standing(state.report, self.rules) if state.done or state.failed
            else foreseen(state, course, self.tractor, self.rules,
                          twin=None if state.mode == AUTOMATIC else self.twins.path(number, times))
            for number, (state, course) in enumerate(zip(states, courses, strict=True))
        ])  # fmt: skip

    def dangers(self, states: Sequence[TractorState], courses: Sequence[Course]) -> list[Danger]:
        """Everything that would go wrong within the time foreseen if nobody did anything."""
        there, paths = self.there(states, courses), self.paths(states, courses)
        speeds = [0.0 if s.report is None else abs(s.report.speed_mps) for s in states]
        poses = centres(paths, self.tractor)
        found = self._meetings(poses, there, states)
        dangers = []
        for i, j, k, metres in found:
            if max(speeds[i], speeds[j]) < MOVING_MPS and k == 0:
                continue
            in_s = k * STEP_S
            urgent = in_s <= braking_s(max(speeds[i], speeds[j]), self.rules) + STEP_S
            least_m = float(distances(poses[i], poses[j], self.model).min())
            dangers.append(Danger(i, j, in_s, metres, urgent, least_m))
        return dangers + self._outside(there, paths, speeds)

    def _meetings(
        self, poses: Array, there: npt.NDArray[np.bool_], states: Sequence[TractorState]
    ) -> list[tuple[int, int, int, float]]:
        """Pairs that come too near.

        For two that both drive by the plan that is nearer than the plan itself comes, by as much as what is foreseen
        of them may be wrong: their gates keep them apart.
        """
        least_m = max(self.clearance_m - FORESEEN_M, CONTACT_M)
        planned = approaches(poses, there, self.model, least_m, min(self.beside_m, least_m))
        free = approaches(poses, there, self.model, self.clearance_m, self.beside_m)
        return planned + [found for found in free if not _by_plan(found, states)]

    def close(self, states: Sequence[TractorState], courses: Sequence[Course]) -> dict[tuple[int, int], float]:
        """Pairs that are or will be nearer than those that are out of danger: the metres between them now.

        That is farther than what stops them, by `release_m` or by what two that drive by the plan may be wrong.
        """
        there, poses = self.there(states, courses), centres(self.paths(states, courses), self.tractor)
        planned = approaches(poses, there, self.model, self.clearance_m, self.beside_m)
        free = approaches(poses, there, self.model, *self.release)
        found = planned + [found for found in free if not _by_plan(found, states)]
        return {(i, j): float(distances(poses[i, :1], poses[j, :1], self.model)[0]) for i, j, _, _ in found}

    def _outside(self, there: npt.NDArray[np.bool_], paths: Array, speeds: list[float]) -> list[Danger]:
        inside = shapely.contains_xy(self.fence, paths[:, :, 0], paths[:, :, 1])
        dangers = []
        for i in np.flatnonzero(there & ~inside.all(axis=1)).tolist():
            in_s = float(np.argmin(inside[i])) * STEP_S
            metres = float(shapely.distance(self.fence, shapely.Point(paths[i, -1, :2])))
            dangers.append(Danger(i, None, in_s, metres, in_s <= braking_s(speeds[i], self.rules) + STEP_S))
        return dangers

    def inside(self, state: TractorState) -> bool:
        """Whether a tractor is within the fence now."""
        report = state.report
        return report is None or bool(shapely.contains_xy(self.fence, report.x_m, report.y_m))

    def apart_m(self, one: int, other: int, states: Sequence[TractorState]) -> float:
        """Metres between two that have reported, now; infinite where one has not."""
        reports = [states[number].report for number in (one, other)]
        poses = [[[each.x_m, each.y_m, each.heading_rad]] for each in reports if each is not None]
        if len(poses) < 2:
            return math.inf
        placed = centres(np.array(poses), self.tractor)
        return float(distances(placed[0], placed[1], self.model)[0])

    def may_go(
        self, numbers: Iterable[int], states: Sequence[TractorState], courses: Sequence[Course]
    ) -> dict[int, bool]:
        """Which of these, who stand because another is near, could drive on past all others as these go, or stand, now.

        Such a one keeps the release distance to each, or parts from one that is nearer. One that touches another, or
        overlaps it by what they report, never goes on by itself: nobody knows which way is out.
        """
        others = self._ways(states, courses)
        return {number: self._may_go(number, states[number], courses[number], others) for number in numbers}

    def _may_go(self, number: int, state: TractorState, course: Course, others: Mapping[int, Array]) -> bool:
        report = state.report
        if report is None or course.off_m(state.leg, (report.x_m, report.y_m)) > self.rules.rejoin_m:
            return False  # whoever put it there takes it away
        own = centres(foreseen(state, course, self.tractor, self.rules, going=True), self.tractor)
        return all(self._free_of(own, theirs) for other, theirs in others.items() if other != number)

    def _free_of(self, own: Array, theirs: Array) -> bool:
        """Whether a way (steps, 3) keeps the release distance to another one, or leads away to that from where it is
        nearer."""
        found = approaches(np.array([own, theirs]), BOTH, self.model, *self.release)
        if not found:
            return True
        metres = distances(own, theirs, self.model)
        if found[0][2] > 0 or metres[0] <= CONTACT_M or metres.min() < metres[0] - AWAY_M:
            return False
        return not approaches(np.array([own[-1:], theirs[-1:]]), BOTH, self.model, *self.release)

    def _ways(self, states: Sequence[TractorState], courses: Sequence[Course]) -> dict[int, Array]:
        """Ways (steps, 3) of the centres of all on the field; who stands for one near it goes on standing, but for one
        that is driven by hand, of which nobody knows."""
        paths = self.paths(states, courses)
        for number, state in enumerate(states):
            if state.report is not None and NEAR in state.holds and state.mode not in BY_HAND:
                paths[number] = standing(state.report, self.rules)
        there = np.flatnonzero(self.there(states, courses))
        return dict(zip(there.tolist(), centres(paths[there], self.tractor), strict=True))

    def allows(
        self,
        number: int,
        velocity_mps: float,
        steering_rad: float,
        states: Sequence[TractorState],
        courses: Sequence[Course],
        obstacles: Sequence[shapely.Geometry] = (),
    ) -> str | None:
        """Why a remote command would do harm; None when it does not, or leads away from it."""
        report = states[number].report
        if report is None or abs(velocity_mps) < MOVING_MPS:
            return None
        path = arc(report, self.tractor, velocity_mps, steering_rad, self.rules)
        steps = 1 + int(np.ceil(braking_s(velocity_mps, self.rules) / STEP_S))
        path = path[: max(steps, 2)]
        out = shapely.distance(self.fence, shapely.points(path[:, :2]))
        if out.max() > 0.0 and out[-1] >= max(out[0] - AWAY_M, 0.0):
            return "it would leave the fence"
        if not self._clear(number, path, states, courses):
            return "it would come too near another tractor"
        if self._at_obstacle(centres(path, self.tractor), obstacles):
            return "it would come too near an obstacle"
        return None

    def _at_obstacle(self, poses: Array, obstacles: Sequence[shapely.Geometry]) -> bool:
        """Whether a machine comes nearer to an obstacle than the margin, or deeper into one; `poses` of its centre."""
        machines = np.array([_placed(self.boxes, pose) for pose in poses])
        for shape in obstacles:
            apart = shapely.distance(machines, shape) - shapely.area(shapely.intersection(machines, shape))
            if apart[1:].min(initial=np.inf) < min(self.rules.obstacle_margin_m, apart[0] - AWAY_M):
                return True
        return False

    def _clear(self, number: int, path: Array, states: Sequence[TractorState], courses: Sequence[Course]) -> bool:
        """Whether a way keeps clear of all others, or leads away from one that is nearer, out of one it overlaps."""
        own = centres(path, self.tractor)
        for other, theirs in self._ways(states, courses).items():
            if other == number:
                continue
            theirs = theirs[: len(own)]
            metres = distances(own, theirs, self.model)
            least = self.beside_m if metres[0] < self.clearance_m else self.clearance_m
            if metres[1:].min(initial=np.inf) < min(least, metres[0] - AWAY_M):
                return False
            if metres[0] <= 0.0 and self._at_obstacle(own, [_placed(self.boxes, theirs[0])]):
                return False
        return True


def footprint(tractor: Tractor, implement: Implement) -> shapely.MultiPolygon:
    """Outlines of tractor and implement, the centre of mass at the origin, forward along x."""
    box = outline(tractor, implement)
    half, tool = box["half_width"], box["tool_half_width"]
    return shapely.MultiPolygon([
        shapely.box(box["tail"], -half, box["nose"], half),
        shapely.box(box["tool_tail"], -tool, box["tool_front"], tool),
    ])  # fmt: skip


def _by_plan(found: tuple[int, int, int, float], states: Sequence[TractorState]) -> bool:
    """Whether both of a pair drive by the plan."""
    return all(states[number].mode == AUTOMATIC for number in found[:2])


def _placed(boxes: shapely.MultiPolygon, pose: Array) -> shapely.Geometry:
    x, y, heading = pose.tolist()
    cos, sin = math.cos(heading), math.sin(heading)
    return shapely.unary_union(shapely.affinity.affine_transform(boxes, [cos, -sin, sin, cos, x, y]))


def _there(state: TractorState, course: Course) -> bool:
    if state.report is None:
        return False
    legs = course.legs
    if legs[0].task.kind == ENTER and state.leg == 0 and state.leg_m <= 0.0 and not state.done:
        return False
    return not (state.done and legs[-1].task.kind == LEAVE)
