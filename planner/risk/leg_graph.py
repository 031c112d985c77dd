"""Legs and gates of a run as a graph: how long every leg takes without waiting, and who waits for whom.

A leg begins when the previous one is driven and its gates are open; the tractor then stands for the leg's planned time
and drives. Waiting is not part of the driving time, nor is the time lost by braking for a closed gate and starting
again: braking counts as waiting, starting becomes `WaitLink.delay_s` wherever the gate does hold the tractor. If a gate
opened just before the tractor arrived, the delay is taken from the run.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fields.arrays import Flags, Floats, Integers, find_true_spans
from vehicle.energy.fuel import build_power_source
from vehicle.energy.run_energy import compute_run_energy
from vehicle.missions.plan import LEAVE, SWATH, Leg, Mission
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import REC_SPEED, STANDING, WAITING

WORK_PASS, TURN_OVER_ONE, TURN_OVER_MORE = range(3)
CRUISE_SHARE = 0.97  # of the planned speed: above it a tractor is neither braking nor starting
DEFAULT_RESTART_S = 1.0  # lost by starting to 5 km/h at 0.7 m/s2, if a run does not show it
MAX_ACCELERATION_S = 15.0


@dataclass(frozen=True)
class WaitLink:
    """Node `after` waits until `offset_s` of node `source` are driven, plus a constant `delay_s`.

    A gate holds back the start of `after`, a follow order (`at_end`) its end.
    """

    source: int
    after: int
    offset_s: float
    delay_s: float
    at_end: bool = False


@dataclass(frozen=True, eq=False)
class LegConsumption:
    """Litres or kWh of driving the legs of a graph (n,), and of a tractor that waits or stands for a second."""

    driving: Floats
    idle_per_s: float


@dataclass(frozen=True, eq=False)
class LegGraph:
    """All legs of a plan, numbered tractor by tractor; arrays are (n,).

    `driven_s` is driving time without waiting and standing, `stand_s` planned standing before a leg. `group` numbers
    passes and turns within each tractor; legs of a group share their random factor. `kind` is WORK_PASS, TURN_OVER_ONE
    (swath) or TURN_OVER_MORE. `worked_m` are metres with the implement down. `leaving` marks legs back to the entrance,
    None without any. `resting` are numbers, from 0, of tractors with nothing to do. `order` lists nodes after the nodes
    their start waits for; a node whose end also waits appears twice, for its start and its end. `links` are sorted by
    `after`. `fuel` is None where it is not known.
    """

    tractors: int
    first_nodes: tuple[int, ...]
    tractor: Integers
    driven_s: Floats
    group: Integers
    kind: Integers
    worked_m: Floats
    order: tuple[int, ...]
    links: tuple[WaitLink, ...]
    stand_s: Floats
    leaving: Flags | None = None
    fuel: LegConsumption | None = None
    resting: tuple[int, ...] = ()

    @property
    def node_count(self) -> int:
        """Number of legs."""
        return len(self.driven_s)

    def get_nodes(self, tractor: int) -> slice:
        """The nodes of a tractor."""
        end = self.first_nodes[tractor + 1] if tractor + 1 < self.tractors else self.node_count
        return slice(self.first_nodes[tractor], end)


@dataclass(frozen=True, eq=False)
class _LegRecord:
    """The record of one tractor up to its finish.

    `edges` (legs + 1,) are the rows where its legs begin, and the end of the last; `times_s` are those of the rows and
    of the finish. Per row: metres, seconds of standing, and of driving without starting after a wait (`driving_s`) and
    without braking for one either (`unhindered_s`). `restart_s` are seconds lost by starting, by leg.
    """

    edges: Integers
    times_s: Floats
    row_m: Floats
    standing_s: Floats
    driving_s: Floats
    unhindered_s: Floats
    restart_s: dict[int, float]

    def get_rows(self, leg: int) -> slice:
        """The rows of a leg."""
        return slice(int(self.edges[leg]), int(self.edges[leg + 1]))

    def get_begin_s(self, leg: int) -> float:
        """The start of a leg."""
        return float(self.times_s[self.edges[leg]])

    def get_driving_begin_s(self, leg: int) -> float:
        """The effective start of a leg: without standing and starting."""
        return self.get_begin_s(leg) + self.sum_standing_s(leg) + self.restart_s.get(leg, 0.0)

    def sum_standing_s(self, leg: int) -> float:
        """Seconds that the tractor stood before a leg with open gates."""
        return float(self.standing_s[self.get_rows(leg)].sum())

    def compute_driven_s(self) -> Floats:
        """Driving seconds per leg, without waiting, braking for it and starting after it."""
        cumulative_s = np.concatenate(([0.0], np.cumsum(self.unhindered_s)))
        return np.asarray(cumulative_s[self.edges[1:]] - cumulative_s[self.edges[:-1]])

    def compute_offset_s(self, leg: int, metres: float, length_m: float) -> float:
        """Driving seconds from the start of a leg until `metres` of it are driven, without waiting and starting."""
        rows = self.get_rows(leg)
        if rows.stop <= rows.start or metres <= 0.0:
            return 0.0
        driven_m, driven_s = (np.concatenate(([0.0], np.cumsum(each[rows]))) for each in (self.row_m, self.driving_s))
        return float(np.interp(min(1.0, metres / length_m) * driven_m[-1], driven_m, driven_s))


def measure_leg_consumption(
    run: SimulationRun, tractor: Tractor, load: WorkLoad | None, terrain: Terrain | None
) -> LegConsumption | None:
    """The fuel or electricity of a run by leg; None without the load, whose engine must be known."""
    if load is None:
        return None
    source = build_power_source(tractor, load.engine_power_w)
    energy = compute_run_energy(run, tractor, load, terrain, source=source)
    return LegConsumption(np.concatenate([one.consumption - one.idle for one in energy.tractors]), source.idle_rate)


def build_leg_graph(run: SimulationRun, fuel: LegConsumption | None = None) -> LegGraph:
    """The graph of a finished run with its fuel; raises ValueError for another."""
    if run.outcome != DONE:
        raise ValueError(f"a run that ended in {run.outcome!r} has no finish")
    missions = run.plan.missions
    counts = [len(mission.legs) for mission in missions]
    first_nodes = tuple(int(count) for count in np.cumsum([0, *counts[:-1]]))
    records = [_read_leg_record(run, tractor) for tractor in range(len(missions))]
    groups, kinds = zip(*(_group_legs(mission) for mission in missions), strict=True)
    links = _build_links(run, first_nodes, records)
    leaving = np.array([leg.task.kind == LEAVE for mission in missions for leg in mission.legs])
    begin_s = np.concatenate([one.times_s[one.edges[:-1]] for one in records])
    return LegGraph(
        tractors=len(missions),
        first_nodes=first_nodes,
        tractor=np.repeat(np.arange(len(missions)), counts),
        driven_s=np.concatenate([one.compute_driven_s() for one in records]),
        group=np.concatenate(groups),
        kind=np.concatenate(kinds),
        worked_m=np.array([leg.length_m * leg.implement for mission in missions for leg in mission.legs]),
        order=_sort_graph_nodes(first_nodes, sum(counts), links, begin_s),
        links=tuple(links),
        stand_s=np.array(
            [one.sum_standing_s(leg) for one, count in zip(records, counts, strict=True) for leg in range(count)]
        ),
        leaving=leaving if leaving.any() else None,
        fuel=fuel,
        resting=tuple(number - 1 for number in run.plan.resting),
    )


def _read_leg_record(run: SimulationRun, tractor: int) -> _LegRecord:
    """The record of a tractor up to its finish, with the last row shortened to it."""
    legs, step_s, finish = run.plan.missions[tractor].legs, run.step_s, float(run.finish_s[tractor])
    count = max(1, int(np.searchsorted(run.time_s, finish - 1e-9)))
    leg_of_row, statuses = run.get_leg_numbers(tractor)[:count], run.get_statuses(tractor)[:count]
    seconds = np.full(count, step_s)
    seconds[-1] = finish - float(run.time_s[count - 1])
    speed = np.abs(run.record[:count, tractor, REC_SPEED])
    planned_speed = np.array([leg.speed_mps for leg in legs])[leg_of_row]
    is_waiting, is_standing = statuses == WAITING, statuses == STANDING
    lost_s = seconds * np.clip(1.0 - speed / planned_speed, 0.0, 1.0)
    braking_s, starting_s = np.zeros(count), np.zeros(count)
    restart_s: dict[int, float] = {}
    gears = np.array([leg.gear for leg in legs])[leg_of_row]
    is_slow = (speed < CRUISE_SHARE * planned_speed) & ~is_waiting & ~is_standing
    max_rows = round(MAX_ACCELERATION_S / step_s) if step_s else 0
    for start, end in find_true_spans(is_waiting).tolist():
        if start and gears[start] == gears[start - 1]:
            is_braking = is_slow & (gears == gears[start])
            before = slice(start - _count_leading(is_braking[:start][::-1][:max_rows]), start)
            braking_s[before] = lost_s[before]
        if end < count and start and gears[end] == gears[end - 1]:
            is_starting = is_slow & (gears == gears[end])
            after = slice(end, end + _count_leading(is_starting[end:][:max_rows]))
            starting_s[after] = lost_s[after] * (braking_s[after] == 0.0)
            restart_s[int(leg_of_row[end])] = float(starting_s[after].sum())
    edges = np.append(np.minimum(np.searchsorted(leg_of_row, np.arange(len(legs))), count), count)
    standing_s, moving_s = seconds * is_standing, seconds - seconds * is_waiting
    return _LegRecord(
        edges=edges,
        times_s=np.append(run.time_s[:count], finish),
        row_m=speed * seconds,
        standing_s=standing_s,
        driving_s=moving_s - starting_s - standing_s,
        unhindered_s=moving_s - braking_s - starting_s - standing_s,
        restart_s=restart_s,
    )


def _count_leading(flags: Flags) -> int:
    """How many flags are true before the first that is not."""
    return int(np.argmin(np.append(flags, False)))


def _group_legs(mission: Mission) -> tuple[Integers, Integers]:
    """The group number and kind of each leg."""
    legs = mission.legs
    group = np.zeros(len(legs), dtype=np.int64)
    for index, (before, leg) in enumerate(pairwise(legs), start=1):
        group[index] = group[index - 1] + (not _is_same_group(before, leg))
    kind = np.full(len(legs), TURN_OVER_MORE, dtype=np.int64)
    for index, leg in enumerate(legs):
        if leg.task.is_work:
            kind[index] = WORK_PASS
        elif _is_neighbour_swath_turn(legs, index):
            kind[index] = TURN_OVER_ONE
    return group, kind


def _is_same_group(before: Leg, leg: Leg) -> bool:
    """Whether two consecutive legs belong to one pass or one turn."""
    if before.task.is_work != leg.task.is_work:
        return False
    return not leg.task.is_work or (before.task.kind == leg.task.kind and before.task.has_same_goal(leg.task))


def _is_neighbour_swath_turn(legs: tuple[Leg, ...], index: int) -> bool:
    """Whether a leg is part of a turn between two neighbouring swaths."""
    before = next((leg.task for leg in reversed(legs[:index]) if leg.task.is_work), None)
    after = next((leg.task for leg in legs[index:] if leg.task.is_work), None)
    if before is None or after is None or before.kind != SWATH or after.kind != SWATH:
        return False
    return before.number is not None and after.number is not None and abs(before.number - after.number) == 1


def _build_links(run: SimulationRun, first: tuple[int, ...], records: list[_LegRecord]) -> list[WaitLink]:
    """Every gate and effective follow order as a link, sorted by the waiting node."""
    links = []
    restarts_s = sorted(seconds for one in records for seconds in one.restart_s.values())
    typical_restart_s = restarts_s[len(restarts_s) // 2] if restarts_s else DEFAULT_RESTART_S
    for tractor, mission in enumerate(run.plan.missions):
        for index, leg in enumerate(mission.legs):
            after = first[tractor] + index
            starts_standing = index == 0 or mission.legs[index - 1].gear != leg.gear or leg.standing_s > 0.0
            for gate in leg.gates:
                length_m = run.plan.missions[gate.tractor].legs[gate.leg].length_m
                offset_s = records[gate.tractor].compute_offset_s(gate.leg, gate.after_m, length_m)
                opened_s = records[gate.tractor].get_driving_begin_s(gate.leg) + offset_s
                passed_s = min(max(records[tractor].get_driving_begin_s(index) - opened_s, 0.0), typical_restart_s)
                delay_s = 0.0 if starts_standing else records[tractor].restart_s.get(index, passed_s)
                links.append(WaitLink(first[gate.tractor] + gate.leg, after, offset_s, delay_s))
            links += _list_follow_links(run, first, records, tractor, index)
    return links


def _list_follow_links(
    run: SimulationRun, first: tuple[int, ...], records: list[_LegRecord], tractor: int, index: int
) -> list[WaitLink]:
    """The link by which a follower ends its leg no sooner after its leader than in the run.

    None without an order to follow, or if the leader began its leg only after that: it held nobody.
    """
    leg, end_s = run.plan.missions[tractor].legs[index], records[tractor].get_begin_s(index + 1)
    follow = leg.follow
    if follow is None or records[follow.tractor].get_begin_s(follow.leg) >= end_s:
        return []
    leader, length_m = records[follow.tractor], run.plan.missions[follow.tractor].legs[follow.leg].length_m
    offset_s = leader.compute_offset_s(follow.leg, min(leg.length_m, length_m), length_m)
    delay_s = end_s - (leader.get_driving_begin_s(follow.leg) + offset_s)
    offset_s = max(0.0, offset_s + min(delay_s, 0.0))  # the leader was not there yet: use where it was
    source = first[follow.tractor] + follow.leg
    return [WaitLink(source, first[tractor] + index, offset_s, max(delay_s, 0.0), at_end=True)]


def _sort_graph_nodes(first: tuple[int, ...], nodes: int, links: list[WaitLink], begin_s: Floats) -> tuple[int, ...]:
    """All nodes in the order of `LegGraph.order`, ties by time; an end that waits is an event of its own.

    Raises ValueError if tractors wait for each other in a circle.
    """
    end_events = {link.after: nodes + number for number, link in enumerate(links) if link.at_end}
    node_of_event = {number: node for node, number in end_events.items()}
    successors: dict[int, list[int]] = {}
    open_predecessors: dict[int, int] = dict.fromkeys([*range(nodes), *node_of_event], 0)
    first_set = set(first)
    pairs = [(end_events.get(node - 1, node - 1), node) for node in range(nodes) if node not in first_set]
    wait_pairs = [(link.source, end_events[link.after] if link.at_end else link.after) for link in links]
    for source, waiting_node in [*pairs, *end_events.items(), *wait_pairs]:
        successors.setdefault(source, []).append(waiting_node)
        open_predecessors[waiting_node] += 1

    def sort_key(number: int) -> tuple[float, int]:
        return round(float(begin_s[node_of_event.get(number, number)]), 3), number

    ready = [sort_key(number) for number, count in open_predecessors.items() if count == 0]
    heapq.heapify(ready)
    order = []
    while ready:
        _, number = heapq.heappop(ready)
        order.append(number)
        for successor in successors.get(number, ()):
            open_predecessors[successor] -= 1
            if open_predecessors[successor] == 0:
                heapq.heappush(ready, sort_key(successor))
    if len(order) < len(open_predecessors):
        raise ValueError("tractors of this plan wait for each other in a circle")
    return tuple(node_of_event.get(number, number) for number in order)
