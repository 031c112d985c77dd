"""Watches for tractors that come too near each other or leave the fence: stops them, and chooses who resumes."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from planner.fleet.manager.fleet_state import FLEET_MANAGER, FleetState, join_fleet_names
from planner.fleet.model.alarms import CRITICAL, WARNING
from planner.fleet.model.tractor_state import BY_HAND, MOVING_MPS, Hold
from planner.fleet.safety.motion_prediction import NearPair, NeighbourTractor, SafetyDanger, TractorKey
from vehicle.sim.clearance import CONTACT_M

NEAR, NEAR_FLEET, UNKNOWN_GROUND = "near", "near fleet", "unknown ground"
PARTING_SLACK_M = 0.05  # noise of positions of two that move apart
STUCK_AFTER_S = 10.0  # after which operators are warned that no standing tractor can resume


def build_proximity_alarm_code(other_tractor: int | TractorKey) -> str:
    """The alarm code of a tractor that comes too near another one, of its own fleet or of another."""
    if isinstance(other_tractor, int):
        return f"{NEAR} {other_tractor + 1}"
    fleet, number = other_tractor
    return f"{NEAR_FLEET}/{fleet} {number + 1}"


class SeparationMonitor:
    """Since when pairs and paths are clear, and which pairs move apart; seconds of the fleet manager's clock.

    Its hysteresis lets nobody be stopped and resumed again and again. Stopping and resuming differ by a distance
    (`SafetyGuard.release_clearances_m`) and a time (`release_s`): the alarm of a pair ends when the two have been
    farther apart than that for so long, and a standing tractor resumes when its path has been clear for so long, one
    after the other. Two that stand nearer than the stopping distance may move apart: as long as they come no nearer
    than they were, they are not stopped again.
    """

    def __init__(self, release_s: float, stuck_s: float) -> None:
        self.release_s, self.stuck_s = release_s, stuck_s
        self._clear_since: dict[NearPair, float] = {}
        self._free_since: dict[int, float] = {}
        self._stands_since: dict[int, float] = {}
        self.parting: dict[NearPair, float] = {}

    def is_parting(self, danger: SafetyDanger) -> bool:
        """Whether a pair in danger is moving apart and comes no nearer than it was."""
        if danger.second is None:
            return False
        distance_m = self.parting.get((danger.first, danger.second))
        return distance_m is not None and danger.least_distance_m >= max(distance_m - PARTING_SLACK_M, CONTACT_M)

    def mark_endangered(self, first: int, second: int | TractorKey) -> None:
        """A pair has to stop, now or soon: it is neither clear nor moving apart."""
        self._clear_since.pop((first, second), None)
        self.parting.pop((first, second), None)

    def find_cleared_pairs(
        self,
        pairs: Collection[NearPair],
        close_pairs: Mapping[NearPair, float],
        standing: Collection[int | TractorKey],
        now: float,
    ) -> list[NearPair]:
        """Which of these pairs have been apart for `release_s`. `close_pairs` are not apart; pairs with a `standing`
        tractor do not count as apart, as it would come near if it resumed."""
        for pair in list(self.parting):
            if pair not in close_pairs:
                del self.parting[pair]
        clear = [pair for pair in pairs if pair not in close_pairs and not any(number in standing for number in pair)]
        self._clear_since = {pair: self._clear_since.get(pair, now) for pair in clear}
        return [pair for pair, since in self._clear_since.items() if now - since >= self.release_s]

    def find_tractors_free_to_resume(self, is_path_clear: Mapping[int, bool], now: float) -> list[int]:
        """Standing tractors whose path has been clear for `release_s`; `is_path_clear` by tractor for now."""
        self._free_since = {
            number: self._free_since.get(number, now) for number, is_free in is_path_clear.items() if is_free
        }
        self._stands_since = {number: self._stands_since.get(number, now) for number in is_path_clear}
        return [number for number, since in self._free_since.items() if now - since >= self.release_s]

    def is_stuck(self, number: int, now: float) -> bool:
        """Whether a tractor has stood for `stuck_s` without a clear path, so that an operator must help."""
        since = self._stands_since.get(number)
        return since is not None and number not in self._free_since and now - since >= self.stuck_s

    def start_parting(self, number: int, close_pairs: Mapping[NearPair, float]) -> None:
        """A tractor resumes; all other standing ones start their waiting time again."""
        self.parting |= {pair: distance_m for pair, distance_m in close_pairs.items() if number in pair}
        self.restart_waiting_times()

    def is_free(self, number: int) -> bool:
        """Whether the path of a standing tractor was clear at the last check."""
        return number in self._free_since

    def restart_waiting_times(self) -> None:
        """A tractor resumes: all standing ones start their waiting time again."""
        self._free_since.clear()
        self._stands_since.clear()


class DangerWatch:
    """Keeps the distances of a fleet's tractors, also to those of the fleets near by."""

    def __init__(self, fleet: FleetState) -> None:
        self.fleet = fleet
        rules = fleet.rules
        self.separation = SeparationMonitor(rules.release_s / rules.times, STUCK_AFTER_S / rules.times)
        self._neighbour_names: tuple[str, ...] = ()
        self._unplaced_beside: tuple[str, ...] = ()

    def set_neighbours(
        self, names: Sequence[str], unknown_names: Sequence[str], unplaced_beside: Sequence[str], now: float
    ) -> None:
        """Set the names of the fleets near by, of those at an unknown distance, and of those among them beside which
        it is this fleet that cannot be placed."""
        self._unplaced_beside = tuple(unplaced_beside)
        if tuple(names) != self._neighbour_names:
            self._neighbour_names = tuple(names)
            self.fleet.log_event(FLEET_MANAGER, "neighbours", fleets=list(names))
        if not unknown_names:
            self.fleet.alarms.end_alarm(UNKNOWN_GROUND, None)
            return
        names = join_fleet_names(unknown_names)
        if unplaced_beside:
            sentence = (
                f"The distance from this fleet to {names} cannot be known: their plans have no common coordinate "
                "system. This fleet does not move until an operator answers for that distance by this alarm."
            )
        else:
            sentence = (
                f"The distance from this fleet to {names} cannot be known: their plans have no common coordinate "
                "system. No distance is kept between them."
            )
        self.fleet.raise_alarm(UNKNOWN_GROUND, None, CRITICAL if unplaced_beside else WARNING, sentence, now)

    def is_answered_by(self, alarm: int) -> bool:
        """Whether acknowledging this alarm lets this fleet move, though it cannot be placed."""
        on = self.fleet.alarms.find_alarm_on(UNKNOWN_GROUND, None)
        return bool(self._unplaced_beside) and on is not None and on.id == alarm and on.acknowledged is None

    def hold_unplaced_fleet(self) -> None:
        """Hold all tractors while nobody answers for the distance from fleets that cannot be known."""
        alarm = self.fleet.alarms.find_alarm_on(UNKNOWN_GROUND, None)
        if self._unplaced_beside and alarm is not None and alarm.acknowledged is None:
            for number in range(len(self.fleet.states)):
                self.fleet.hold_tractor(number, Hold.UNPLACED)
            return
        held_states = [state for state in self.fleet.states if Hold.UNPLACED in state.holds]
        for state in held_states:
            state.holds.discard(Hold.UNPLACED)
        if held_states and alarm is not None and alarm.acknowledged is not None:
            self.fleet.log_event(alarm.acknowledged, "answered for the distance", fleets=list(self._unplaced_beside))

    def stop_or_resume_by_danger(self, now: float) -> None:
        """Stop tractors in danger, and resume those out of it."""
        fleet, neighbours = self.fleet, self.fleet.neighbours.find_nearby_tractors()
        all_dangers = fleet.guard.find_dangers(fleet.states, neighbours)
        dangers = [danger for danger in all_dangers if not self.separation.is_parting(danger)]
        for danger in dangers:
            self._warn_of_danger(danger, {neighbour.key: neighbour.name for neighbour in neighbours}, now)
        leaving = {danger.first for danger in dangers if danger.second is None}
        for number, state in enumerate(fleet.states):
            if number not in leaving:
                fleet.alarms.end_alarm("fence", number)
                if Hold.FENCE in state.holds and fleet.guard.is_inside_fence(state):
                    state.holds.discard(Hold.FENCE)
        pairs = self.find_alarmed_pairs()
        if pairs or self.separation.parting or any(Hold.TOO_NEAR in state.holds for state in fleet.states):
            self._resolve_near_pairs(pairs, neighbours, now)

    def find_alarmed_pairs(self) -> list[NearPair]:
        """Pairs whose alarm is on: of this fleet first, then with tractors of other fleets."""
        own_pairs, pairs = list[tuple[int, int]](), list[NearPair]()
        for alarm in self.fleet.alarms.list_alarms():
            kind, _, number = alarm.code.rpartition(" ")
            if alarm.over or alarm.tractor is None:
                continue
            if kind == NEAR:
                own_pairs.append((alarm.tractor, int(number) - 1))
            elif kind.startswith(NEAR_FLEET + "/"):
                pairs.append((alarm.tractor, (kind.removeprefix(NEAR_FLEET + "/"), int(number) - 1)))
        return [*sorted(own_pairs), *pairs]

    def _warn_of_danger(self, danger: SafetyDanger, names: Mapping[TractorKey, str], now: float) -> None:
        first, second = danger.first, danger.second
        if second is None:
            sentence = f"Tractor {first + 1} will leave the fence in {danger.in_s:.1f} s."
            hold, code = Hold.FENCE, "fence"
        else:
            self.separation.mark_endangered(first, second)
            pair_text = (
                f"s {first + 1} and {second + 1}" if isinstance(second, int) else f" {first + 1} and {names[second]}"
            )
            sentence = f"Tractor{pair_text} will come within {danger.distance_m:.2f} m in {danger.in_s:.1f} s."
            if danger.distance_m < 0.0:  # from where one in doubt may be
                sentence = f"Tractor{pair_text} may be too near in {danger.in_s:.1f} s: the place of one is in doubt."
            hold, code = Hold.TOO_NEAR, build_proximity_alarm_code(second)
        self.fleet.raise_alarm(code, first, CRITICAL if danger.is_urgent else WARNING, sentence, now)
        if danger.is_urgent:
            for number in (first, second):  # a tractor of another fleet is held by its own fleet manager
                if isinstance(number, int) and not self.fleet.states[number].done:
                    self.fleet.hold_tractor(number, hold, is_logged=True)

    def _resolve_near_pairs(self, pairs: list[NearPair], neighbours: list[NeighbourTractor], now: float) -> None:
        """Of tractors that are or were too near: end alarms, and choose who resumes."""
        fleet = self.fleet
        close_pairs = fleet.guard.find_close_pairs(fleet.states, neighbours)
        near_states = {n: state for n, state in enumerate(fleet.states) if Hold.TOO_NEAR in state.holds}
        waiting = [n for n, state in near_states.items() if Hold.REMOTE_CONTROL not in state.holds]
        unattended = [n for n in waiting if fleet.states[n].mode not in BY_HAND]
        waiting_neighbours = [neighbour for neighbour in neighbours if neighbour.is_waiting]
        standing: list[int | TractorKey] = [*unattended, *(neighbour.key for neighbour in waiting_neighbours)]
        for pair in self.separation.find_cleared_pairs(pairs, close_pairs, standing, now):
            fleet.alarms.end_alarm(build_proximity_alarm_code(pair[1]), pair[0])
        for number in near_states.keys() - waiting:
            codes = [(build_proximity_alarm_code(pair[1]), pair[0]) for pair in pairs if number in pair]
            if not any(fleet.alarms.is_alarm_on(*code) for code in codes):
                near_states[number].holds.discard(Hold.TOO_NEAR)  # every remote command is checked
        movers_heard = [  # of those that still move, whether they are heard
            *(fleet.is_report_current(n) for n in unattended if near_states[n].is_moving),
            *(neighbour.is_linked for neighbour in waiting_neighbours if neighbour.speed_mps > MOVING_MPS),
        ]
        is_path_clear = dict.fromkeys(waiting, False)
        if not movers_heard:  # to resume, the places of the others must be known
            is_path_clear |= fleet.guard.find_clear_to_go(waiting, fleet.states, neighbours)
        free_numbers = self.separation.find_tractors_free_to_resume(is_path_clear, now)
        neighbour_has_priority = any(neighbour.has_priority and neighbour.is_free for neighbour in waiting_neighbours)
        if free_numbers and not neighbour_has_priority:
            next_number = min(free_numbers, key=lambda n: (-self._compute_metres_until_wait(n, waiting), n))
            fleet.states[next_number].holds.discard(Hold.TOO_NEAR)
            self.separation.start_parting(next_number, close_pairs)
            fleet.neighbours.restart_waiting_times()
            fleet.log_event(FLEET_MANAGER, "goes on", tractor=next_number + 1)
        elif not any(movers_heard) and not neighbour_has_priority:  # a silent one may be braking still
            self._alarm_stuck_pairs({*pairs, *close_pairs}, waiting, neighbours, now)

    def _alarm_stuck_pairs(
        self, pairs: Collection[NearPair], waiting: list[int], neighbours: list[NeighbourTractor], now: float
    ) -> None:
        """Raise alarms for standing pairs that cannot resume by themselves."""
        states, guard = self.fleet.states, self.fleet.guard
        neighbours_by_key = {neighbour.key: neighbour for neighbour in neighbours}
        stuck = [number for number in waiting if self.separation.is_stuck(number, now)]
        for first, key in sorted((first, second) for first, second in pairs if second in neighbours_by_key):
            if first in stuck:
                neighbour = neighbours_by_key[key]
                distance_m = guard.measure_distance_m(states[first], neighbour)
                sentence = (
                    f"Tractor {first + 1} and {neighbour.name} stand {distance_m:.2f} m apart and cannot resume by "
                    "themselves: look there, and drive one away by remote control"
                )
                sentence += (
                    "." if neighbour.is_linked else f", or delete fleet {neighbour.fleet!r} if it is no longer there."
                )
                self.fleet.raise_alarm(build_proximity_alarm_code(key), first, CRITICAL, sentence, now)
        for first, second in sorted((first, second) for first, second in pairs if isinstance(second, int)):
            waiting_pair = [number for number in (first, second) if number in waiting]
            if waiting_pair and all(number in stuck for number in waiting_pair):
                distance_m = guard.measure_distance_m(states[first], states[second])
                sentence = (
                    f"Tractors {first + 1} and {second + 1} stand {distance_m:.2f} m apart and cannot resume by "
                    "themselves: look there, and drive one away by remote control."
                )
                self.fleet.raise_alarm(build_proximity_alarm_code(second), first, CRITICAL, sentence, now)

    def _compute_metres_until_wait(self, number: int, waiting: list[int]) -> float:
        """Metres that a tractor can drive before it waits for one of `waiting`; infinite if it never does."""
        state = self.fleet.states[number]
        for leg in range(state.base_end, len(state.mission.legs)):
            if any(gate.tractor in waiting for gate in state.find_closed_gates(leg, self.fleet.states)):
                return state.mission.leg_starts_m[leg] - state.position_m
        return math.inf
