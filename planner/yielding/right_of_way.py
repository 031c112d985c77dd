"""Who goes first: paths are given, and every tractor may stand at its hold points.

Tractors are moved from hold point to hold point in the order of time. One enters a stretch when nothing of it is taken
by others meanwhile, nobody stands in its way, and all could still get home one after another if everybody then stood
still; no two can wait for each other for ever where that holds at the start. What makes a tractor wait, or only just
not, becomes a gate; other gates of the plan are heeded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain

from planner.yielding.crossings import Crossings, Stretch
from planner.yielding.homeward import Homeward, State
from vehicle.missions import Gate, Plan

BEHIND_S = 3.0  # who follows leaves so much time behind the one before
AHEAD_S = 6.0  # who goes before one that is on its way already keeps so much ahead
START_S = 1.5  # lost by a tractor that had to stand
GUARDED_S = 120.0  # an order with less time between is guarded by a gate though none is predicted to be needed
CHAIN = 4  # stretches entered in one go where there is no room to stand between
STOOD_S = 0.5  # who has stood for less has passed by
MOVED_S = 2.0  # a tractor that has been on a stretch for so long has left its hold point
NEVER = math.inf


@dataclass(frozen=True)
class Manner:
    """How turns are taken: by when one can go on or, the more `eager`, by when it has come to its hold point.

    With `on` one that must not stop at the next hold point may go on beyond it in one go.
    """

    eager: float
    on: bool


SMALL_FLEET = 4  # tractors; larger ones are scheduled in one manner, as that takes long enough
MANNERS = (Manner(0.0, False), Manner(0.0, True), Manner(0.5, False), Manner(0.5, True), Manner(1.0, True))


@dataclass(frozen=True)
class Entry:
    """Stretches entered in one go by a tractor, from `first` on: when it begins each, and when it stands again."""

    tractor: int
    first: int
    begins_s: tuple[float, ...]
    until_s: float


@dataclass
class Timetable:
    """What has been decided: when each tractor begins each of its stretches, where it stands from when on."""

    begins_s: list[list[float]]
    free_s: list[float]
    gates: list[tuple[int, int, Gate]] = field(default_factory=list)
    refused: dict[int, set[int]] = field(default_factory=dict)

    @property
    def state(self) -> State:
        """The hold point each tractor stands at, or will next."""
        return tuple(len(begins) for begins in self.begins_s)

    @property
    def duration_s(self) -> float:
        """When the last one is done."""
        return max(self.free_s)


class RightOfWay:
    """Finds a timetable for the courses of a plan."""

    def __init__(self, plan: Plan, crossings: Crossings, slack: float = 1.0) -> None:
        """For a plan whose tractors keep `slack` times the usual time between each other."""
        self.plan, self.crossings, self.courses = plan, crossings, crossings.courses
        self.behind_s, self.ahead_s = BEHIND_S * slack, AHEAD_S * slack
        self.homeward = Homeward(plan, crossings)

    def timetable(self) -> Timetable | None:
        """The quickest timetable; None where tractors stand so that they could not even get home one after another.

        Gates of the plan that would keep them from that are left out (`homeward.loosened`).
        """
        if not self.homeward.safe((0,) * len(self.courses)) and not self.homeward.loosen():
            return None
        manners = MANNERS if len(self.courses) <= SMALL_FLEET else MANNERS[:1]
        tables = [self._filled(manner) for manner in manners]
        found = [table for table in tables if table is not None]
        return min(found, key=lambda table: (round(table.duration_s), round(sum(table.free_s)))) if found else None

    def _filled(self, manner: Manner) -> Timetable | None:
        """A timetable in which the entry comes next that can be soonest."""
        count = len(self.courses)
        table, ready = Timetable([[] for _ in range(count)], [0.0] * count), dict[int, Entry | None]()
        while any(at < course.stretches for at, course in zip(table.state, self.courses, strict=True)):
            for one, course in enumerate(self.courses):
                if one not in ready and table.state[one] < course.stretches:
                    ready[one] = self._earliest(table, one)
            entry = self._chosen(table, ready, manner)
            if entry is None:
                return None
            self._enter(table, entry)
            ready = {one: each for one, each in ready.items() if not self._concerned(table, one, entry.tractor)}
        return table

    def _concerned(self, table: Timetable, one: int, other: int) -> bool:
        """Whether what one may do can depend on what another has just done."""
        if one == other or one in table.refused:
            return True
        return other in self.crossings.near[one] or other in self.homeward.others[one]

    def _chosen(self, table: Timetable, ready: dict[int, Entry | None], manner: Manner) -> Entry | None:
        """The entry that can be first and leaves everybody a way home."""
        entries = [entry for entry in ready.values() if entry is not None]

        def turn(entry: Entry) -> tuple[float, float, int]:
            ahead_s = manner.eager * (entry.begins_s[0] - table.free_s[entry.tractor])
            return round(entry.begins_s[0] - ahead_s, 1), self._to_go_s(entry), entry.tractor

        for first in sorted(entries, key=turn):
            for entry in chain((first,), self._longer(table, first) if manner.on else ()):
                state = list(table.state)
                state[entry.tractor] += len(entry.begins_s)
                if self.homeward.harmless(entry.tractor, tuple(state)) or self.homeward.safe(tuple(state)):
                    return entry
            table.refused.setdefault(first.tractor, set())
        return None

    def _longer(self, table: Timetable, entry: Entry) -> Iterator[Entry]:
        """The same entry with more stretches in one go, where that need not begin much later."""
        one, at = entry.tractor, table.state[entry.tractor]
        for length in range(len(entry.begins_s) + 1, min(CHAIN, self.courses[one].stretches - at) + 1):
            begin = self._begin(table, one, length, entry.begins_s[0])
            if begin <= entry.begins_s[0] + START_S:
                yield self._entry(table, one, length, begin)

    def _to_go_s(self, entry: Entry) -> float:
        """Minus the time to go: among equals the one with most to do goes first."""
        course = self.courses[entry.tractor]
        return -round(float(course.time_s[-1]) - course.begins_s(entry.first), 1)

    def _earliest(self, table: Timetable, one: int) -> Entry | None:
        """When a tractor can enter its next stretch, or the next few in one go if that is sooner."""
        best: Entry | None = None
        cleared = [table.begins_s[other][-1] + MOVED_S for other in table.refused.get(one, ())]
        soonest = max(table.free_s[one], *cleared) if cleared else table.free_s[one]
        at = table.state[one]
        for length in range(1, min(CHAIN, self.courses[one].stretches - at) + 1):
            begin = self._begin(table, one, length, soonest)
            if begin < NEVER and (best is None or begin < best.begins_s[0] - 0.05):
                best = self._entry(table, one, length, begin)
            if begin <= soonest + 0.05:
                break
        return best

    def _entry(self, table: Timetable, one: int, length: int, begin: float) -> Entry:
        course, at = self.courses[one], table.state[one]
        late = START_S if begin > table.free_s[one] + 0.05 or at == 0 else 0.0
        offset = course.begins_s(at)
        begins = tuple(begin + late + course.begins_s(at + n) - offset for n in range(length))
        return Entry(one, at, (begin, *begins[1:]), begin + late + course.begins_s(at + length) - offset)

    def _begin(self, table: Timetable, one: int, length: int, soonest: float) -> float:
        """The earliest time from `soonest` on at which a tractor can begin so many stretches in one go."""
        course, at = self.courses[one], table.state[one]
        taken: list[tuple[float, float]] = []
        for number in range(at, at + length):
            shift = course.begins_s(number) - course.begins_s(at)
            for wait in self.homeward.waits.get((one, number), ()):
                if wait.stretch >= len(table.begins_s[wait.tractor]):
                    return NEVER
                soonest = max(soonest, table.begins_s[wait.tractor][wait.stretch] + wait.after_s - shift)
            for other in sorted(self.crossings.near[one]):
                spans = self._taken(table, (one, number), other, soonest)
                taken += [(low - shift, high - shift) for low, high in spans]
        stand_s = course.begins_s(at + length) - course.begins_s(at)
        taken += self._stood_in_way(table, one, at + length, stand_s, soonest)
        for low, high in sorted(taken):
            if low <= soonest < high:
                soonest = high
        return soonest if soonest < NEVER else NEVER

    def _taken(self, table: Timetable, mine: Stretch, other: int, soonest: float) -> list[tuple[float, float]]:
        """Spans of time in which a stretch must not be begun because of what another does, or where it stands."""
        spans: list[tuple[float, float]] = []
        apart, blockers = self.crossings.apart.get(mine, {}), self.crossings.blockers.get(mine, {})
        begins = table.begins_s[other]
        for number in range(len(begins) - 1, -1, -1):
            if begins[number] + self.courses[other].lasts_s(number) + 2.0 * self.behind_s + START_S < soonest:
                break
            for low, high in apart.get((other, number), ()):
                spans.append((begins[number] + low - self.ahead_s, begins[number] + high + self.behind_s))
            came = self._came_s(table, other, number)
            if begins[number] - came > STOOD_S and (times := blockers.get((other, number))) is not None:
                left_s = begins[number] + max(MOVED_S, self.behind_s - times[0])
                spans.append((came - times[1] - self.ahead_s, left_s))
        if len(begins) < len(self.courses[other].holds):
            times = blockers.get((other, len(begins)))
            if times is not None:
                spans.append((table.free_s[other] - times[1] - self.ahead_s if begins else -NEVER, NEVER))
        return spans

    def _came_s(self, table: Timetable, one: int, number: int) -> float:
        """When a tractor came to the hold point before a stretch that it has begun."""
        if number == 0:
            return -NEVER
        return table.begins_s[one][number - 1] + self.courses[one].lasts_s(number - 1)

    def _stood_in_way(
        self, table: Timetable, one: int, hold: int, stand_s: float, soonest: float
    ) -> list[tuple[float, float]]:
        """Spans in which a tractor must not begin because others still come by where it will then stand."""
        spans = []
        for (other, number), (_, last) in self.crossings.stands.get((one, hold), {}).items():
            begins = table.begins_s[other]
            if number < len(begins):
                spans.append((-NEVER, begins[number] + last + self.behind_s - stand_s))
        return [span for span in spans if span[1] > soonest]

    def _enter(self, table: Timetable, entry: Entry) -> None:
        """Write an entry into the timetable, with the gates that make it so."""
        one, at = entry.tractor, table.state[entry.tractor]
        for number, begin in enumerate(entry.begins_s):
            hold_leg = self.courses[one].hold_legs[at + number]
            for other in sorted(self.crossings.near[one]):
                gate = self._guard(table, (one, at + number), other, begin)
                if gate is not None:
                    table.gates.append((one, hold_leg, gate))
        for gate in self._cleared(table, entry):
            table.gates.append((one, self.courses[one].hold_legs[at], gate))
        table.begins_s[one] += entry.begins_s
        table.free_s[one] = entry.until_s
        self._guard_later(table, entry)
        table.refused.pop(one, None)
        for others in table.refused.values():
            others.add(one)

    def _guard_later(self, table: Timetable, entry: Entry) -> None:
        """Keep others behind this one where what they do later has been decided before."""
        for other in sorted(self.crossings.near[entry.tractor]):
            begins = table.begins_s[other]
            for number in range(len(begins) - 1, -1, -1):
                if begins[number] <= entry.begins_s[0]:
                    break
                gate = self._guard(table, (other, number), entry.tractor, begins[number])
                if gate is not None:
                    table.gates.append((other, self.courses[other].hold_legs[number], gate))

    def _guard(self, table: Timetable, mine: Stretch, other: int, begin: float) -> Gate | None:
        """The gate that keeps a tractor behind another which it is predicted to follow closely."""
        apart, begins = self.crossings.apart.get(mine, {}), table.begins_s[other]
        for number in range(len(begins) - 1, -1, -1):
            if begins[number] + self.courses[other].lasts_s(number) < begin - GUARDED_S:
                break
            highs = [high + self.behind_s for _, high in apart.get((other, number), ())]
            passed = [high for high in highs if begin - GUARDED_S < begins[number] + high <= begin + 0.05]
            after_s = max(*passed, MOVED_S) if passed else NEVER
            if begins[number] + after_s <= begin + 0.05:
                return self.courses[other].gate(other, number, after_s, self.plan.missions[other])
        return None

    def _cleared(self, table: Timetable, entry: Entry) -> list[Gate]:
        """Gates on those that had to get on first, lest not all get home, or to come by where this one will stand."""
        one, at = entry.tractor, table.state[entry.tractor]
        gates = []
        for other in sorted(table.refused.get(one, ())):
            number = len(table.begins_s[other]) - 1
            gates.append(self.courses[other].gate(other, number, MOVED_S, self.plan.missions[other]))
        stand_s = entry.until_s - entry.begins_s[0]
        hold = at + len(entry.begins_s)
        for (other, number), (_, last) in sorted(self.crossings.stands.get((one, hold), {}).items()):
            if number < len(table.begins_s[other]):
                after = last + self.behind_s - stand_s
                due = table.begins_s[other][number] + max(after, MOVED_S)
                if after > 0.0 and entry.begins_s[0] - GUARDED_S < due <= entry.begins_s[0] + 0.05:
                    gates.append(self.courses[other].gate(other, number, after, self.plan.missions[other]))
        return gates
