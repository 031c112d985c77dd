"""Keeps tractors safe: the fence, the distances between them, and the limits of remote commands."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from fields.arrays import Flags, Floats
from fields.geometry.overlays import intersect
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetRules
from planner.fleet.model.tractor_state import AUTOMATIC, BY_HAND, MOVING_MPS, Hold, TractorState
from planner.fleet.safety.motion_prediction import (
    PREDICTION_ERROR_M,
    ROUNDING_M,
    STEP_S,
    NearPair,
    NeighbourTractor,
    PossibleArea,
    SafetyDanger,
    TractorKey,
    TwinPredictions,
    WatchedTractor,
    build_standing_path,
    build_time_steps,
    compute_centre_poses,
    compute_stopping_time_s,
    get_wheel_angle_rad,
    is_leading_away,
    list_boxes,
    place_outlines,
    predict_arc,
    predict_path,
    sort_pair,
)
from vehicle.missions.plan import ENTER, LEAVE
from vehicle.sim.clearance import CONTACT_M
from vehicle.sim.compile import build_model_record
from vehicle.sim.path_conflicts import compute_outline_distances, find_close_approaches, find_close_approaches_between

RELEASE_SHARE = 0.9  # of the plan's least distance: asking for more would keep tractors standing for ever


class SafetyGuard:
    """Watches the tractors of one plan; for tractors driven by hand it uses the predictions of `twins`.

    `neighbours` are tractors of other fleets. No plan keeps these apart, so the distances of the rules apply to them
    unreduced, and to all that have reported: machines that queue at an entrance are real for other fleets. Tractors may
    drive away from one that stands at its entrance even if their outlines overlap, as fleets may start at one place.
    """

    def __init__(self, plan: FleetPlan, rules: FleetRules, twins: TwinPredictions | None = None) -> None:
        self.tractor, self.rules, self.twins = plan.tractor, rules, twins or TwinPredictions()
        self.model = np.array([build_model_record(plan.tractor, plan.implement)])
        self.box_table = np.array(list_boxes(self.model[0]))
        self.reach_m = float(self.model[0]["reach"])
        clearance_m, beside_m = min(rules.clearance_m, plan.clearance_m), min(rules.beside_m, rules.clearance_m)
        more_m = max(min(rules.release_m, RELEASE_SHARE * plan.min_clearance_m - clearance_m), 0.0)
        self.clearances_m = clearance_m, min(rules.beside_m, clearance_m)  # ahead, and beside each other
        self.release_clearances_m = self.clearances_m[0] + more_m, self.clearances_m[1] + more_m
        self.neighbour_clearances_m = rules.clearance_m, beside_m
        self.neighbour_release_m = rules.clearance_m + rules.release_m, beside_m + rules.release_m
        self._path_cache: dict[tuple[int, float], tuple[tuple[Any, ...], Floats]] = {}
        self.fence = shapely.buffer(plan.ground, rules.fence_margin_m, quad_segs=4)
        shapely.prepare(self.fence)

    def find_tractors_on_field(self, states: Sequence[TractorState]) -> Flags:
        """Which tractors (n,) are on the field: have reported, have entered, and have not left."""
        return np.array([_is_present(state) for state in states], dtype=np.bool_)

    def is_queueing(self, state: TractorState) -> bool:
        """Whether a tractor stands at its entrance, before it enters or after it left, and is not about to start."""
        report, first, last = state.report, state.mission.legs[0], state.mission.legs[-1]
        if report is None or abs(report.speed_mps) >= MOVING_MPS:
            return False
        if state.done:
            place = last.points[-1] if last.task.kind == LEAVE else None
        else:
            place = first.points[0] if first.task.kind == ENTER and state.leg == 0 else None
        if place is None or math.dist(place, (report.x_m, report.y_m)) > self.reach_m:
            return False  # driven by hand it is elsewhere, though it has driven none of its legs
        waits_at_base_end = state.mode == AUTOMATIC and state.base_end_m - state.position_m <= ROUNDING_M
        return state.done or abs(report.speed_command_mps) < MOVING_MPS or waits_at_base_end

    def predict_paths(
        self, states: Sequence[TractorState], numbers: Iterable[int] | None = None, pace: float = 1.0
    ) -> Floats:
        """Predicted antenna poses (n, steps, 3) of all tractors, or of some; zeros for those that have never reported.

        `pace` is seconds of this fleet per second of the observing one.
        """
        chosen = range(len(states)) if numbers is None else numbers
        times_s = pace * build_time_steps(self.rules)
        return np.array([self._predict_path(number, states[number], pace, times_s) for number in chosen])

    def _predict_path(self, number: int, state: TractorState, pace: float, times_s: Floats) -> Floats:
        if state.report is None:
            return np.zeros((len(times_s), 3))
        if state.done or state.failed:
            if not state.is_moving:
                return build_standing_path(state.report, self.rules)
            report, steering_rad = state.report, get_wheel_angle_rad(state.report)
            return predict_arc(report, self.tractor, report.velocity_mps, steering_rad, self.rules, times_s)
        if state.mode != AUTOMATIC:
            twin_path = self.twins.predict_path(number, times_s)
            return predict_path(state, self.tractor, self.rules, twin_path=twin_path, times_s=times_s)
        cache_key = (
            state.report,
            state.leg,
            state.leg_m,
            state.base_end,
            bool(state.holds),
            state.doubt,
            state.mission,
        )
        cached = self._path_cache.get((number, pace))
        if cached is None or cached[0] != cache_key:
            cached = cache_key, predict_path(state, self.tractor, self.rules, times_s=times_s)
            self._path_cache[number, pace] = cached
        return cached[1]

    def find_dangers(
        self, states: Sequence[TractorState], neighbours: Sequence[NeighbourTractor] = ()
    ) -> list[SafetyDanger]:
        """All dangers within the predicted time if nothing changes."""
        present, paths = self.find_tractors_on_field(states), self.predict_paths(states)
        speeds_mps = [0.0 if s.report is None else abs(s.report.speed_mps) for s in states]
        stopping_s = [compute_stopping_time_s(speed_mps, self.rules) for speed_mps in speeds_mps]
        poses = compute_centre_poses(paths, self.tractor)
        dangers = []

        def add_danger(pair: NearPair, k: int, stop_s: float, distance_m: float, distances_m: Floats) -> None:
            in_s, least_distance_m = k * STEP_S, float(distances_m.min())
            dangers.append(SafetyDanger(*pair, in_s, distance_m, in_s <= stop_s + STEP_S, least_distance_m))

        least_m = max(self.clearances_m[0] - PREDICTION_ERROR_M, CONTACT_M)
        limits_m = (least_m, min(self.clearances_m[1], least_m)), self.clearances_m
        for i, j, k, distance_m in self._find_own_approaches(poses, present, states, *limits_m):
            if max(speeds_mps[i], speeds_mps[j]) < MOVING_MPS and k == 0:
                continue
            distances_m = compute_outline_distances(poses[i], poses[j], self.model)
            add_danger((i, j), k, max(stopping_s[i], stopping_s[j]), distance_m, distances_m)
        for i, neighbour, k, distance_m in self._find_approaches(
            poses, states, neighbours, self.neighbour_clearances_m
        ):
            if k == 0 and (
                max(speeds_mps[i], neighbour.speed_mps) < MOVING_MPS
                or self._is_leaving_entrance(poses[i], self.is_queueing(states[i]), neighbour)
            ):
                continue
            distances_m = compute_outline_distances(poses[i], neighbour.path, self.model, neighbour.model[None])
            add_danger((i, neighbour.key), k, max(stopping_s[i], neighbour.braking_s), distance_m, distances_m)
        for i, area, k, distances_m in self._find_area_approaches(poses, states, self.list_areas(states, neighbours)):
            if k > 0 or speeds_mps[i] >= MOVING_MPS:
                add_danger(sort_pair(i, area.key), k, stopping_s[i], float(distances_m[k]), distances_m)
        inside = shapely.contains_xy(self.fence, paths[:, :, 0], paths[:, :, 1])
        for i in np.flatnonzero(present & ~inside.all(axis=1)).tolist():
            in_s = float(np.argmin(inside[i])) * STEP_S
            distance_m = float(shapely.distance(self.fence, shapely.Point(paths[i, -1, :2])))
            dangers.append(SafetyDanger(i, None, in_s, distance_m, in_s <= stopping_s[i] + STEP_S))
        return dangers

    def _is_leaving_entrance(self, path: Floats, is_queueing: bool, neighbour: NeighbourTractor) -> bool:
        """Whether one of two near tractors stands at its entrance and the other drives away from it."""
        least_m, models = self.neighbour_clearances_m[0], (self.model, neighbour.model[None])
        own_start, neighbour_start = _repeat_first_pose(path), _repeat_first_pose(neighbour.path)
        if neighbour.is_queueing and is_leading_away(
            path, neighbour_start[0], compute_outline_distances(path, neighbour_start, *models), least_m
        ):
            return True
        return is_queueing and is_leading_away(
            neighbour.path, own_start[0], compute_outline_distances(own_start, neighbour.path, *models), least_m
        )

    def build_area(self, number: int, state: TractorState, pace: float = 1.0) -> PossibleArea | None:
        """Where a tractor in doubt may be, as seen by its own fleet; None for any other. `pace` as in predict_paths."""
        doubt = state.doubt
        if doubt is None:
            return None
        centre = compute_centre_poses(np.array(doubt.pose), self.tractor)[:2]
        grown_m = doubt.radius_m + doubt.speed_mps * pace * build_time_steps(self.rules)
        return PossibleArea(number, centre, grown_m + self.reach_m, self.clearances_m[0], self.release_clearances_m[0])

    def list_areas(self, states: Sequence[TractorState], neighbours: Sequence[NeighbourTractor]) -> list[PossibleArea]:
        """Where the tractors in doubt may be, those of this fleet and those near it."""
        own_areas = (self.build_area(number, state) for number, state in enumerate(states))
        return [area for area in (*own_areas, *(each.area for each in neighbours)) if area is not None]

    def _find_area_approaches(
        self, poses: Floats, states: Sequence[TractorState], areas: Sequence[PossibleArea], *, to_release: bool = False
    ) -> list[tuple[int, PossibleArea, int, Floats]]:
        """Who comes too near to where another may be: number, area, first step, distances (steps,)."""
        found = []
        for area in areas:
            least_m = area.release_m if to_release else area.clearance_m
            for number, distances_m in enumerate(area.measure_distances_m(poses, self.box_table)):
                if number != area.key and states[number].report is not None and distances_m.min() < least_m:
                    found.append((number, area, int(np.argmax(distances_m < least_m)), distances_m))
        return found

    def _find_approaches(
        self,
        poses: Floats,
        states: Sequence[TractorState],
        neighbours: Sequence[NeighbourTractor],
        clearances_m: tuple[float, float],
    ) -> list[tuple[int, NeighbourTractor, int, float]]:
        """Pairs across fleets that come nearer than the clearances: number, neighbour, first step, distance (m)."""
        numbers = np.flatnonzero([state.report is not None for state in states])
        if not neighbours or not len(numbers):
            return []
        neighbour_paths = np.array([neighbour.path for neighbour in neighbours])
        models = np.empty(len(neighbours), dtype=self.model.dtype)  # to stack records is slow
        for j, neighbour in enumerate(neighbours):
            models[j] = neighbour.model
        approaches_found = find_close_approaches_between(
            poses[numbers], self.model, neighbour_paths, models, *clearances_m
        )
        return [(int(numbers[i]), neighbours[j], k, distance_m) for i, j, k, distance_m in approaches_found]

    def _find_own_approaches(
        self,
        poses: Floats,
        present: Flags,
        states: Sequence[TractorState],
        planned_limits_m: tuple[float, float],
        limits_m: tuple[float, float],
    ) -> list[tuple[int, int, int, float]]:
        """Pairs that come too near: first, second, step, distance (m).

        Limits are ahead and beside. Those of two that both follow the plan (`planned_limits_m`) are lower by the error
        of predictions: their gates keep them apart.
        """
        planned = find_close_approaches(poses, present, self.model, *planned_limits_m)
        free = find_close_approaches(poses, present, self.model, *limits_m)
        is_planned = [state.mode == AUTOMATIC for state in states]
        return planned + [meeting for meeting in free if not (is_planned[meeting[0]] and is_planned[meeting[1]])]

    def find_close_pairs(
        self, states: Sequence[TractorState], neighbours: Sequence[NeighbourTractor] = ()
    ) -> dict[NearPair, float]:
        """Pairs that are or will be nearer than the release distance, with the metres between them now.

        That distance is larger than the one that stops them, by `release_m` or by the error of predictions.
        """
        present = self.find_tractors_on_field(states)
        poses = compute_centre_poses(self.predict_paths(states), self.tractor)
        limits_m = self.clearances_m, self.release_clearances_m
        distances_m: dict[NearPair, float] = {
            (i, j): float(compute_outline_distances(poses[i, :1], poses[j, :1], self.model)[0])
            for i, j, _, _ in self._find_own_approaches(poses, present, states, *limits_m)
        }
        for i, neighbour, _, _ in self._find_approaches(poses, states, neighbours, self.neighbour_release_m):
            now = poses[i, :1], neighbour.path[:1], self.model, neighbour.model[None]
            distances_m[i, neighbour.key] = float(compute_outline_distances(*now)[0])
        areas = self.list_areas(states, neighbours)
        for i, area, _, to_area_m in self._find_area_approaches(poses, states, areas, to_release=True):
            distances_m[sort_pair(i, area.key)] = float(to_area_m[0])
        return distances_m

    def is_inside_fence(self, state: TractorState) -> bool:
        """Whether a tractor is within the fence now."""
        report = state.report
        return report is None or bool(shapely.contains_xy(self.fence, report.x_m, report.y_m))

    def measure_distance_m(self, first: TractorState, second: TractorState | NeighbourTractor) -> float:
        """Metres between a tractor and another one, of its fleet or not, now; infinite where one has not reported."""
        own = [first] if isinstance(second, NeighbourTractor) else [first, second]
        places = [[one.report.x_m, one.report.y_m, one.report.heading_rad] for one in own if one.report is not None]
        if len(places) < len(own):
            return math.inf
        poses = compute_centre_poses(np.array(places), self.tractor)
        if isinstance(second, NeighbourTractor):
            other = second.path[:1], self.model, second.model[None]
        else:
            other = poses[1:], self.model, self.model
        return float(compute_outline_distances(poses[:1], *other)[0])

    def find_clear_to_go(
        self,
        numbers: Iterable[int],
        states: Sequence[TractorState],
        neighbours: Sequence[NeighbourTractor] = (),
    ) -> dict[int, bool]:
        """Which of these tractors, which stand because another is near, could resume past all others as those move now.

        A tractor must keep the release distance to each other one, or move away from one that is nearer. One that
        touches or overlaps another never resumes by itself, as the way out is unknown; except that it may drive away
        from a tractor of another fleet that stands at its entrance.
        """
        paths, areas = self._build_paths(states, neighbours), self.list_areas(states, neighbours)
        return {number: self._is_clear_to_go(number, states[number], paths, areas) for number in numbers}

    def _is_clear_to_go(
        self,
        number: int,
        state: TractorState,
        paths: Mapping[int | TractorKey, WatchedTractor],
        areas: Sequence[PossibleArea],
    ) -> bool:
        if state.report is None:
            return False
        place = state.report.x_m, state.report.y_m
        if state.mission.compute_distance_to_leg_m(state.leg, place) > self.rules.rejoin_m:
            return False  # an operator led it there and has to lead it back
        own_poses = compute_centre_poses(predict_path(state, self.tractor, self.rules, goes_on=True), self.tractor)
        for area in areas:
            if area.key != number and area.measure_distances_m(own_poses, self.box_table).min() < area.release_m:
                return False
        return all(self._is_clear_of_path(own_poses, other) for key, other in paths.items() if key != number)

    def _is_clear_of_path(self, own_poses: Floats, other: WatchedTractor) -> bool:
        """Whether a path (steps, 3) keeps the release distance to another one, or leads away to that distance."""
        is_foreign, other_model = isinstance(other, NeighbourTractor), other.model[None]
        release_m = self.neighbour_release_m if is_foreign else self.release_clearances_m
        approaches_found = find_close_approaches_between(
            own_poses[None], self.model, other.path[None], other_model, *release_m
        )
        if not approaches_found:
            return True
        distances_m = compute_outline_distances(own_poses, other.path, self.model, other_model)
        if (
            other.is_queueing
            and approaches_found[0][2] == 0
            and is_leading_away(own_poses, other.path[0], distances_m, release_m[0])
        ):
            return True
        if approaches_found[0][2] > 0 or distances_m[0] <= CONTACT_M or distances_m.min() < distances_m[0] - ROUNDING_M:
            return False
        last_step = own_poses[-1:][None], self.model, other.path[-1:][None], other_model
        return not find_close_approaches_between(*last_step, *release_m)

    def _build_paths(
        self, states: Sequence[TractorState], neighbours: Sequence[NeighbourTractor]
    ) -> dict[int | TractorKey, WatchedTractor]:
        """Predicted paths of all tractors on the field and near it. Tractors that stand because another is near keep
        standing, unless they are driven by hand."""
        paths = self.predict_paths(states)
        for number, state in enumerate(states):
            if state.report is not None and Hold.TOO_NEAR in state.holds and state.mode not in BY_HAND:
                paths[number] = build_standing_path(state.report, self.rules)
        present_numbers = np.flatnonzero(self.find_tractors_on_field(states))
        poses = compute_centre_poses(paths[present_numbers], self.tractor)
        own = zip(present_numbers.tolist(), poses, strict=True)
        return {number: WatchedTractor(path, self.model[0]) for number, path in own} | {
            one.key: replace(one, path=_repeat_first_pose(one.path)) if one.is_waiting else one for one in neighbours
        }

    def find_command_harm(
        self,
        number: int,
        velocity_mps: float,
        steering_rad: float,
        states: Sequence[TractorState],
        obstacles: Sequence[shapely.Geometry] = (),
        neighbours: Sequence[NeighbourTractor] = (),
    ) -> str | None:
        """Why a remote command would do harm; None if it does not, or leads away from harm."""
        report = states[number].report
        if report is None or abs(velocity_mps) < MOVING_MPS:
            return None
        path = predict_arc(report, self.tractor, velocity_mps, steering_rad, self.rules)
        steps = 1 + int(np.ceil(compute_stopping_time_s(velocity_mps, self.rules) / STEP_S))
        path = path[: max(steps, 2)]
        outside_m = shapely.distance(self.fence, shapely.points(path[:, :2]))
        if outside_m.max() > 0.0 and outside_m[-1] >= max(outside_m[0] - ROUNDING_M, 0.0):
            return "it would leave the fence"
        areas = self.list_areas(states, neighbours)
        conflict = self._find_conflict(number, path, self._build_paths(states, neighbours), areas)
        if conflict is not None:
            names = {neighbour.key: neighbour.name for neighbour in neighbours}
            return f"it would come too near {'another tractor' if isinstance(conflict, int) else names[conflict]}"
        if self._is_at_obstacle(compute_centre_poses(path, self.tractor), obstacles):
            return "it would come too near an obstacle"
        return None

    def _is_at_obstacle(self, poses: Floats, obstacles: Iterable[shapely.Geometry]) -> bool:
        """Whether a machine (`poses` of its centre of mass) comes too near to an obstacle, or deeper into one."""
        machines = place_outlines(self.model[0], poses)
        for shape in obstacles:
            distances_m = shapely.distance(machines, shape) - shapely.area(intersect(machines, shape))
            if distances_m[1:].min(initial=np.inf) < min(self.rules.obstacle_margin_m, distances_m[0] - ROUNDING_M):
                return True
        return False

    def _find_conflict(
        self,
        number: int,
        path: Floats,
        paths: Mapping[int | TractorKey, WatchedTractor],
        areas: Sequence[PossibleArea],
    ) -> int | TractorKey | None:
        """The tractor that a path comes too near to; None if it keeps clear of all, or leads away."""
        own_poses = compute_centre_poses(path, self.tractor)
        for area in areas:
            distances_m = area.measure_distances_m(own_poses, self.box_table)
            least_m = min(area.clearance_m, distances_m[0] - ROUNDING_M)
            if area.key != number and distances_m[1:].min(initial=np.inf) < least_m:
                return area.key
        for other_key, other in paths.items():
            if other_key == number:
                continue
            other_poses = other.path[: len(own_poses)]
            distances_m = compute_outline_distances(own_poses, other_poses, self.model, other.model[None])
            is_foreign = isinstance(other, NeighbourTractor)
            ahead_m, beside_m = self.neighbour_clearances_m if is_foreign else self.clearances_m
            least_m = beside_m if distances_m[0] < ahead_m else ahead_m
            if distances_m[1:].min(initial=np.inf) < min(least_m, distances_m[0] - ROUNDING_M):
                return other_key
            if distances_m[0] <= 0.0 and self._is_at_obstacle(own_poses, place_outlines(other.model, other_poses[:1])):
                return other_key
        return None


def _repeat_first_pose(path: Floats) -> Floats:
    return np.repeat(path[:1], len(path), axis=0)


def _is_present(state: TractorState) -> bool:
    if state.report is None:
        return False
    legs = state.mission.legs
    if legs[0].task.kind == ENTER and state.leg == 0 and state.leg_m <= 0.0 and not state.done:
        return False
    return not (state.done and legs[-1].task.kind == LEAVE)
