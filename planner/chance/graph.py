"""Legs and gates of a run as a graph: how long every leg takes by itself, and who waits for whom.

A leg begins when the one before it is driven and every gate before it is open; then a tractor stands for as long as the
leg says, which does not vary, and drives for its own seconds. Waiting is
taken out of those, and with it what a tractor loses by braking for a closed gate and by moving off again: the first
is part of the waiting, the second comes back as `Link.delay_s` wherever a gate does hold it. Where a gate opened just
before a tractor came, the delay is what the run shows.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from vehicle.layout import REC_SPEED, STANDING, WAITING
from vehicle.missions import LEAVE, TRACK, Follow, Leg, Mission
from vehicle.run import DONE, Run

PASS, TURN_ONE, TURN_MORE = 0, 1, 2
CRUISING = 0.97  # of the speed of a leg: from here on a tractor is neither braking nor moving off
MOVING_OFF_S = 1.0  # lost at standstill at 5 km/h and 0.7 m/s2, where a run does not show it
LONGEST_MOVE_S = 15.0
Array = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Link:
    """Node `after` waits for node `source`: for `offset_s` of its own seconds, and `delay_s` that do not vary.

    A gate holds back the beginning of `after`, a follow order (`at_end`) its end.
    """

    source: int
    after: int
    offset_s: float
    delay_s: float
    at_end: bool = False


@dataclass(frozen=True, eq=False)
class Graph:
    """All legs of a plan, numbered tractor after tractor; arrays (n,) unless said otherwise.

    `driven_s` are seconds of driving without waiting and standing, `stand_s` those of standing before it. `group`
    numbers passes and turns within each tractor: legs of one share their luck; `kind` is PASS, TURN_ONE (over one
    track) or TURN_MORE. `worked_m` are metres with the implement down. `leaving` marks legs back to the entrance, None
    where there are none. `order` are all nodes, each after those its beginning waits for; one whose end waits as well
    stands there twice, for its beginning and for its end, so that others may wait for the beginning of a leg before it
    is known when it ends. `links` are sorted by `after`.
    """

    tractors: int
    first: tuple[int, ...]
    tractor: Whole
    driven_s: Array
    group: Whole
    kind: Whole
    worked_m: Array
    order: tuple[int, ...]
    links: tuple[Link, ...]
    stand_s: Array
    leaving: npt.NDArray[np.bool_] | None = None

    @property
    def nodes(self) -> int:
        """Number of legs."""
        return len(self.driven_s)

    def of(self, tractor: int) -> slice:
        """The nodes of a tractor."""
        end = self.first[tractor + 1] if tractor + 1 < self.tractors else self.nodes
        return slice(self.first[tractor], end)


@dataclass(frozen=True, eq=False)
class _Rows:
    """What the record of one tractor says per row: leg, seconds spent, and of them waiting, braking and moving off."""

    begin: Whole
    time: Array
    seconds: Array
    metres: Array
    waiting: Array
    braking: Array
    starting: Array
    standing: Array
    restart_s: dict[int, float]

    def begun_s(self, leg: int) -> float:
        """When a leg was begun at full speed, in effect."""
        return float(self.time[self.begin[leg]]) + self.stood_s(leg) + self.restart_s.get(leg, 0.0)

    def done_s(self, leg: int) -> float:
        """When a leg was driven, with all that held it up."""
        return float(self.time[self.begin[leg + 1] if leg + 1 < len(self.begin) else -1])

    def stood_s(self, leg: int) -> float:
        """For how long the tractor stood before a leg, its gates open."""
        end = self.begin[leg + 1] if leg + 1 < len(self.begin) else len(self.standing)
        return float(self.standing[self.begin[leg] : end].sum())


def graph_of(run: Run) -> Graph:
    """The graph of a run that was driven to its end; raises ValueError for another."""
    if run.outcome != DONE:
        raise ValueError(f"a run that ended in {run.outcome!r} has no finish")
    missions = run.plan.missions
    counts = [len(mission.legs) for mission in missions]
    first = tuple(int(count) for count in np.cumsum([0, *counts[:-1]]))
    rows = [_rows(run, tractor) for tractor in range(len(missions))]
    driven = [_driven(one) for one in rows]
    groups, kinds = zip(*(_groups(mission) for mission in missions), strict=True)
    links = _links(run, first, rows)
    leaving = np.array([leg.task.kind == LEAVE for mission in missions for leg in mission.legs])
    begun = np.concatenate([one.time[one.begin] for one in rows])
    return Graph(
        tractors=len(missions),
        first=first,
        tractor=np.repeat(np.arange(len(missions)), counts),
        driven_s=np.concatenate(driven),
        group=np.concatenate(groups),
        kind=np.concatenate(kinds),
        worked_m=np.array([leg.length_m * leg.implement for mission in missions for leg in mission.legs]),
        order=_order(first, sum(counts), links, begun),
        links=tuple(links),
        stand_s=np.array([one.stood_s(leg) for one, count in zip(rows, counts, strict=True) for leg in range(count)]),
        leaving=leaving if leaving.any() else None,
    )


def _rows(run: Run, tractor: int) -> _Rows:
    """Rows of the record up to the end of the tractor, the last one as long as it was driven."""
    legs = run.plan.missions[tractor].legs
    step = float(run.time_s[1] - run.time_s[0]) if len(run.time_s) > 1 else 0.0
    finish = float(run.finish_s[tractor])
    count = max(1, int(np.searchsorted(run.time_s, finish - 1e-9)))
    on = run.leg(tractor)[:count]
    seconds = np.full(count, step)
    seconds[-1] = finish - float(run.time_s[count - 1])
    speed = np.abs(run.record[:count, tractor, REC_SPEED])
    wanted = np.array([leg.speed_mps for leg in legs])[on]
    waits = run.status(tractor)[:count] == WAITING
    lost = seconds * np.clip(1.0 - speed / wanted, 0.0, 1.0)
    braking, starting = np.zeros(count), np.zeros(count)
    restart: dict[int, float] = {}
    gears = np.array([leg.gear for leg in legs])[on]
    slow = (speed < CRUISING * wanted) & ~waits & (run.status(tractor)[:count] != STANDING)
    most = round(LONGEST_MOVE_S / step) if step else 0
    for start, end in _runs_of(waits):
        if start and gears[start] == gears[start - 1]:
            back = _back(slow & (gears == gears[start]), start, most)
            braking[back:start] = lost[back:start]
        if end < count and start and gears[end] == gears[end - 1]:
            on_way = _ahead(slow & (gears == gears[end]), end, most)
            fresh = braking[end:on_way] == 0.0
            starting[end:on_way] = lost[end:on_way] * fresh
            restart[int(on[end])] = float(starting[end:on_way].sum())
    begin = np.minimum(np.searchsorted(on, np.arange(len(legs))), count)
    time = np.append(run.time_s[:count], finish)
    stands = seconds * (run.status(tractor)[:count] == STANDING)
    return _Rows(begin, time, seconds, speed * seconds, seconds * waits, braking, starting, stands, restart)


def _runs_of(flags: npt.NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """First row and the row after the last of every stretch of rows that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0])))).tolist()
    return zip(edges[::2], edges[1::2], strict=True)


def _back(flags: npt.NDArray[np.bool_], row: int, most: int) -> int:
    """First of the true rows that lead to a row, at most so many."""
    while row > 0 and most > 0 and flags[row - 1]:
        row, most = row - 1, most - 1
    return row


def _ahead(flags: npt.NDArray[np.bool_], row: int, most: int) -> int:
    """The row after the true ones that begin at a row, at most so many."""
    while row < len(flags) and most > 0 and flags[row]:
        row, most = row + 1, most - 1
    return row


def _driven(rows: _Rows) -> Array:
    """Seconds of driving per leg, without waiting and what waiting costs before and after."""
    own = rows.seconds - rows.waiting - rows.braking - rows.starting - rows.standing
    total = np.concatenate(([0.0], np.cumsum(own)))
    ends = np.append(rows.begin[1:], len(own))
    return np.asarray(total[ends] - total[rows.begin])


def _groups(mission: Mission) -> tuple[Whole, Whole]:
    """Per leg the number of its pass or turn, and the kind of that."""
    legs = mission.legs
    group = np.zeros(len(legs), dtype=np.int64)
    for index, (before, leg) in enumerate(pairwise(legs), start=1):
        group[index] = group[index - 1] + (not _one(before, leg))
    kind = np.full(len(legs), TURN_MORE, dtype=np.int64)
    for index, leg in enumerate(legs):
        kind[index] = PASS if leg.task.works else TURN_ONE if _over_one(legs, index) else TURN_MORE
    return group, kind


def _one(before: Leg, leg: Leg) -> bool:
    """Whether two legs one after another belong to one pass or to one turn."""
    if before.task.works != leg.task.works:
        return False
    return not leg.task.works or (before.task.kind == leg.task.kind and before.task.same_goal(leg.task))


def _over_one(legs: tuple[Leg, ...], index: int) -> bool:
    """Whether a leg between two tracks is part of a turn from one to its neighbour."""
    before = next((leg.task for leg in reversed(legs[:index]) if leg.task.works), None)
    after = next((leg.task for leg in legs[index:] if leg.task.works), None)
    if before is None or after is None or before.kind != TRACK or after.kind != TRACK:
        return False
    return before.number is not None and after.number is not None and abs(before.number - after.number) == 1


def _links(run: Run, first: tuple[int, ...], rows: list[_Rows]) -> list[Link]:
    """Every gate and follow order as a link, sorted by who waits."""
    links = []
    seen = sorted(seconds for one in rows for seconds in one.restart_s.values())
    typical = seen[len(seen) // 2] if seen else MOVING_OFF_S
    for tractor, mission in enumerate(run.plan.missions):
        for index, leg in enumerate(mission.legs):
            after = first[tractor] + index
            stands = index == 0 or mission.legs[index - 1].gear != leg.gear or leg.stand_s > 0.0
            for gate in leg.gates:
                ahead = rows[gate.tractor]
                offset = _offset(ahead, gate.leg, gate.after_m, run.plan.missions[gate.tractor])
                opened = ahead.begun_s(gate.leg) + offset
                passed = min(max(rows[tractor].begun_s(index) - opened, 0.0), typical)
                delay = 0.0 if stands else rows[tractor].restart_s.get(index, passed)
                links.append(Link(first[gate.tractor] + gate.leg, after, offset, delay))
            if leg.follow is not None and _was_behind(rows, leg.follow, tractor, index):
                links.append(_follow(run, first, rows, tractor, index))
    return links


def _offset(rows: _Rows, leg: int, metres: float, mission: Mission) -> float:
    """Seconds from the beginning of a leg until so many metres of it are driven, without waiting and moving off."""
    start = int(rows.begin[leg])
    end = int(rows.begin[leg + 1]) if leg + 1 < len(rows.begin) else len(rows.seconds)
    if end <= start or metres <= 0.0:
        return 0.0
    own = (rows.seconds - rows.waiting - rows.starting - rows.standing)[start:end]
    driven = np.concatenate(([0.0], np.cumsum(rows.metres[start:end])))
    share = min(1.0, metres / mission.legs[leg].length_m)
    return float(np.interp(share * driven[-1], driven, np.concatenate(([0.0], np.cumsum(own)))))


def _was_behind(rows: list[_Rows], order: Follow, tractor: int, index: int) -> bool:
    """Whether the leader began its leg before the follower was done with its own: else it held nobody."""
    ahead = rows[order.tractor]
    return float(ahead.time[ahead.begin[order.leg]]) < rows[tractor].done_s(index)


def _follow(run: Run, first: tuple[int, ...], rows: list[_Rows], tractor: int, index: int) -> Link:
    """A follower is done with its leg no sooner after its leader has driven as far as it was in the run."""
    legs = run.plan.missions[tractor].legs
    order = legs[index].follow
    assert order is not None
    leader, ahead = run.plan.missions[order.tractor], rows[order.tractor]
    metres = min(legs[index].length_m, leader.legs[order.leg].length_m)
    offset = _offset(ahead, order.leg, metres, leader)
    passed = ahead.begun_s(order.leg) + offset
    behind = rows[tractor].done_s(index) - passed
    offset = max(0.0, offset + min(behind, 0.0))  # the leader was not there yet: where it was then
    return Link(first[order.tractor] + order.leg, first[tractor] + index, offset, max(behind, 0.0), at_end=True)


def _order(first: tuple[int, ...], nodes: int, links: list[Link], begun: Array) -> tuple[int, ...]:
    """All nodes, as `Graph.order` has them, by time where that is open; an end is an event of its own where it waits.

    Raises ValueError where tractors wait for each other in a circle.
    """
    own_end = {link.after: nodes + number for number, link in enumerate(links) if link.at_end}
    event = {number: node for node, number in own_end.items()}
    after: dict[int, list[int]] = {}
    missing: dict[int, int] = dict.fromkeys([*range(nodes), *event], 0)
    begins = set(first)
    pairs = [(own_end.get(node - 1, node - 1), node) for node in range(nodes) if node not in begins]
    waits = [(link.source, own_end[link.after] if link.at_end else link.after) for link in links]
    for source, late in [*pairs, *own_end.items(), *waits]:
        after.setdefault(source, []).append(late)
        missing[late] += 1

    def at(number: int) -> tuple[float, int]:
        return round(float(begun[event.get(number, number)]), 3), number

    ready = [at(number) for number, count in missing.items() if count == 0]
    heapq.heapify(ready)
    order = []
    while ready:
        _, number = heapq.heappop(ready)
        order.append(number)
        for other in after.get(number, ()):
            missing[other] -= 1
            if missing[other] == 0:
                heapq.heappush(ready, at(other))
    if len(order) < len(missing):
        raise ValueError("tractors of this plan wait for each other in a circle")
    return tuple(event.get(number, number) for number in order)
