"""The missions of a plan with stops at which the tank is made good, whatever strategy wrote it.

Between two pieces of work (tracks, sides of rounds or parts of a long one) a tractor may go for its next load: to a
place and from there to the next piece, or it is served where it stands. Which stops are the cheapest is settled exactly
for the order of the plan (`cuts`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

from strategies.errors import StrategyError
from strategies.headland.laps import link
from strategies.job import Job
from strategies.legs import driven_legs, with_stops
from strategies.refilling.berths import berths
from strategies.refilling.cuts import cheapest_known
from strategies.supply import PLACE, Supply
from strategies.ways.paths import Path, Pose
from vehicle.missions import DRIVE_IN, REFILL, ROUND, TURN, WAY, Leg, Mission, Task

Span = tuple[float, float]
CLEAR_M = 20.0  # a place is free when the one before has driven so far from it
STOPS_M = 20.0  # a tractor of several may be kept waiting so often on its way to a place and back
FAR_S = 1e6  # what a stop is charged that no way leads to


@dataclass(frozen=True)
class Piece:
    """Legs `first` to `last` - 1 of a mission, worked in one go, and what they take of a load."""

    first: int
    last: int
    need: float


@dataclass(frozen=True)
class Stop:
    """Before leg `leg` the tank is made good, `amount` of it; the tractor may wait for that before leg `hold`."""

    leg: int
    hold: int
    amount: float


@dataclass(frozen=True)
class Filled:
    """A mission with its stops; `moved[k]` is the number that leg k now has, or the next one that is still there.

    `served` are the times from when to when it is expected to take whoever serves one at a time (s).
    """

    legs: tuple[Leg, ...]
    stops: tuple[Stop, ...]
    moved: tuple[int, ...]
    served: tuple[Span, ...] = ()


def pieces_of(job: Job, supply: Supply, mission: Mission) -> list[Piece]:
    """The work of a mission in pieces between which a tractor may go for its next load: tracks, and legs of rounds."""
    found: list[list[int]] = []
    for number, leg in enumerate(mission.legs):
        if not (leg.task.works or leg.task.kind == DRIVE_IN):
            continue
        goes_on = bool(found) and found[-1][1] == number
        if goes_on and not mission.legs[number - 1].task.kind == leg.task.kind == ROUND:
            found[-1][1] = number + 1
        else:
            found.append([number, number + 1])
    return [Piece(first, last, _need(job, supply, mission.legs[first:last])) for first, last in found]


def _need(job: Job, supply: Supply, legs: Sequence[Leg]) -> float:
    return supply.need(math.fsum(leg.length_m for leg in legs if leg.implement), job.layout.width_m)


@dataclass
class Gaps:
    """What it costs to go for a load between the pieces of a mission."""

    job: Job
    supply: Supply
    mission: Mission
    pieces: list[Piece]
    busy: Sequence[Span] = ()

    @cached_property
    def done_s(self) -> list[float]:
        """When each leg is driven at the speed it asks for, without any stop."""
        return list(accumulate(leg.stand_s + leg.length_m / leg.speed_mps for leg in self.mission.legs))

    def served(self, gap: int, later_s: float) -> Span:
        """From when to when a tractor takes whoever serves, in a gap to which stops before have made it come later."""
        lasts_s, begin = self._lasts_s(gap), self.done_s[self.pieces[gap - 1].last - 1] + later_s
        for first, last in sorted(self.busy):
            if first < begin + lasts_s and begin < last:
                begin = last
        return begin, begin + lasts_s

    def wait_s(self, gap: int, later_s: float) -> float:
        """For how long a tractor waits for its turn in a gap."""
        if not self.busy:
            return 0.0
        return self.served(gap, later_s)[0] - self.done_s[self.pieces[gap - 1].last - 1] - later_s

    def _lasts_s(self, gap: int) -> float:
        """How long a tractor takes whoever serves: at a place from where it waits until it is clear of it."""
        if self.supply.where != PLACE:
            return self.supply.refill_s
        x, y, _ = self.ends(gap)[0]
        flight = min(math.dist((x, y), spot[:2]) for spot in self.berths)
        return self.supply.refill_s + (flight + CLEAR_M) / self.job.manner.turn_speed_mps

    @cached_property
    def berths(self) -> tuple[Pose, ...]:
        """Where a tractor stands at a fixed place."""
        if self.supply.where != PLACE:
            return ()
        found = berths(self.job)
        if not found:
            raise StrategyError(f"{_where(self.supply)} has no room beside it for a tractor to stand; use another.")
        return found

    def ends(self, gap: int) -> tuple[Pose, Pose]:
        """Poses at the end of the piece before a gap and at the beginning of the piece after it."""
        before, after = self.pieces[gap - 1], self.pieces[gap]
        return _pose(self.mission.legs[before.last - 1], -1), _pose(self.mission.legs[after.first], 0)

    def between(self, gap: int) -> tuple[Leg, ...]:
        """The legs that lead from piece to piece where no stop is made."""
        return self.mission.legs[self.pieces[gap - 1].last : self.pieces[gap].first]

    def _plain_s(self, gap: int) -> float:
        """Seconds from piece to piece without a stop."""
        legs = self.between(gap)
        changes = sum(a.gear != b.gear for a, b in pairwise(legs))
        return sum(leg.length_m / leg.speed_mps for leg in legs) + changes * self.job.connector.costs.cusp_s

    def least_s(self, gap: int) -> float:
        """Seconds below which no stop in a gap costs more than none: as the crow flies to the place and back."""
        if gap == 0 or self.supply.where != PLACE:
            return self.supply.refill_s
        (ax, ay, _), (bx, by, _) = self.ends(gap)
        flight = min(math.dist((ax, ay), spot[:2]) + math.dist(spot[:2], (bx, by)) for spot in self.berths)
        return flight / self.job.manner.turn_speed_mps + self.supply.refill_s - self._plain_s(gap)

    def more_s(self, gap: int) -> float:
        """Seconds by which a stop in a gap costs more than none."""
        if self.supply.where != PLACE:
            return self.supply.refill_s
        ways = self.ways(gap)
        if ways is None:
            return FAR_S
        driven = sum(self.job.connector.costs.time_s(way) for way in ways)
        return driven + self.supply.refill_s - self._plain_s(gap)

    def ways(self, gap: int) -> tuple[Path, Path] | None:
        """The quickest way to the place and on from there; None where there is none."""
        a, b = self.ends(gap)
        pairs = [(way_to(self.job, a, spot), way_to(self.job, spot, b)) for spot in self.berths]
        found = [(to, on) for to, on in pairs if to is not None and on is not None]
        cost = self.job.connector.cost
        return min(found, key=lambda pair: round(cost(pair[0]) + cost(pair[1]), 3), default=None)


def way_to(job: Job, a: Pose, b: Pose) -> Path | None:
    """A way to or from a berth, worked out once."""
    return job.way(a, b) or link(job, a, b, anyhow=True)


def filled(job: Job, supply: Supply, mission: Mission, busy: Sequence[Span] = ()) -> Filled:
    """The mission with its cheapest stops, where others are served at `busy` times and one waits until they are.

    Raises StrategyError where none are enough or no way leads there."""
    return filled_between(Gaps(job, supply, mission, pieces_of(job, supply, mission), busy))


def filled_between(gaps: Gaps) -> Filled:
    """The mission of these gaps with its cheapest stops in them; raises StrategyError as `filled` does."""
    job, supply, mission, pieces = gaps.job, gaps.supply, gaps.mission, gaps.pieces
    needs = [piece.need for piece in pieces]
    if sum(needs) <= supply.capacity:
        return Filled(mission.legs, (), tuple(range(len(mission.legs))))
    if max(needs) > supply.capacity:
        raise StrategyError(
            f"A side of a round takes {max(needs):.0f} l or kg in one go and a load is {supply.capacity:g}; use a "
            "larger tank, a lower rate, or square corners."
        )
    least = [gaps.least_s(gap) for gap in range(len(pieces))]
    found = cheapest_known(needs, least, gaps.more_s, supply.capacity, gaps.wait_s)
    if found is None or any(gaps.more_s(gap) >= FAR_S for gap in found):
        raise StrategyError(
            f"No way of turning radius {job.manner.radius_m:.1f} m leads to {_where(supply)[0].lower()}"
            f"{_where(supply)[1:]} and back before a load is used up; use another place, or refill on the headland."
        )
    return _written(gaps, found)


def _where(supply: Supply) -> str:
    if supply.place is None:
        return "The place to refill"
    x, y = supply.place
    return f"The place to refill at ({x:.0f}, {y:.0f} m)"


def _written(gaps: Gaps, cuts: Sequence[int]) -> Filled:
    """The legs with a stop before every piece of `cuts`."""
    old, pieces = gaps.mission.legs, gaps.pieces
    legs: list[Leg] = []
    stops: list[Stop] = []
    moved: list[int] = []
    done = 0  # old legs that are written
    for number, cut in enumerate(cuts):
        before, after = pieces[cut - 1], pieces[cut]
        moved += range(len(legs), len(legs) + before.last - done)
        legs += old[done : before.last]
        to, on = _detour(gaps, cut)
        begun = cuts[number - 1] if number else 0
        amount = math.fsum(piece.need for piece in pieces[begun:cut])
        stop_at = len(legs) + len(to)
        least = stops[-1].leg + 1 if stops else 0
        stops.append(Stop(stop_at, hold_of(legs, least), amount))
        legs += [*to, *on]
        done = after.first
        moved += _still(gaps.supply, len(legs), after.first - before.last)
        if not on:
            legs.append(replace(old[done], stand_s=gaps.supply.refill_s))
            moved.append(len(legs) - 1)
            done += 1
    moved += range(len(legs), len(legs) + len(old) - done)
    legs += old[done:]
    return Filled(tuple(legs), tuple(stops), tuple(moved), tuple(_spans(gaps, cuts)))


def _spans(gaps: Gaps, cuts: Sequence[int]) -> Iterator[Span]:
    """When the stops of a tractor are expected."""
    later_s = 0.0
    for cut in cuts:
        yield gaps.served(cut, later_s)
        later_s += gaps.wait_s(cut, later_s) + gaps.more_s(cut)


def _still(supply: Supply, count: int, between: int) -> list[int]:
    """Numbers of the legs between two pieces: none of them is driven on the way to a place and back."""
    return [count] * between if supply.where == PLACE else list(range(count - between, count))


def hold_of(legs: Sequence[Leg], least: int) -> int:
    """The last leg of the work before a stop at which a tractor may be kept waiting; the way there without one."""
    work = (number for number in range(len(legs) - 1, least - 1, -1) if legs[number].may_wait)
    return next(work, len(legs))


def _detour(gaps: Gaps, cut: int) -> tuple[list[Leg], list[Leg]]:
    """The legs to the stop before a piece, and on from there; the first of these stands until the tank is made good."""
    job, supply, goal = gaps.job, gaps.supply, gaps.mission.legs[gaps.pieces[cut].first].task
    if supply.where == PLACE:
        ways = gaps.ways(cut)
        assert ways is not None  # asked before
        task = replace(goal, kind=WAY if ways[1].kind == "route" else TURN)
        to, on = driven_legs(job, ways[0], Task(REFILL)), driven_legs(job, ways[1], task)
    else:
        to, on = [], list(gaps.between(cut))
    if job.tractors > 1 and supply.where == PLACE:
        to, on = with_stops(to, STOPS_M), with_stops(on, STOPS_M)
    if on:
        on[0] = replace(on[0], stand_s=supply.refill_s)
    return to, on


def _pose(leg: Leg, end: int) -> Pose:
    """Pose of a tractor that drives forwards at the first (0) or the last (-1) point of a leg."""
    a, b = (leg.points[0], leg.points[1]) if end == 0 else (leg.points[-2], leg.points[-1])
    x, y = leg.points[end]
    return float(x), float(y), math.atan2(leg.gear * (b[1] - a[1]), leg.gear * (b[0] - a[0]))
