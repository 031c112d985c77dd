"""Stops at which tanks are refilled or emptied in the legs of a tractor whose plan changes while it is driven.

Between two pieces of work (swaths, sides of headland passes or parts of a long one) a tractor may fetch its next load:
at a place in which tractors of its plan stand, or it is served where it stands.

Which stops are cheapest is settled exactly for the order of the legs. The cost of a stop in a gap between pieces need
not be known for every gap: it is bounded from below first, and computed when the cheapest stops would use it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

from strategies.moves.drives import build_path_legs
from strategies.moves.move import Move
from strategies.path_planning.errors import StrategyError
from strategies.path_planning.paths import Pose
from strategies.program.legs import add_wait_points
from strategies.program.supply import PLACE, Supply
from strategies.programmes.ways import Ways
from vehicle.missions.plan import DRIVE_IN, HEADLAND_PASS, REFILL, ROUTE, TURN, Leg, LegTask, Mission

LOAD_TOLERANCE = 1e-9  # of a load: rounding of sums
COST_TOLERANCE_S = 1e-6


def find_cheapest_stops(
    needs: Sequence[float], costs: Sequence[float], capacity: float
) -> tuple[float, tuple[int, ...]] | None:
    """The least sum of costs, and the pieces before which the tank is refilled; None if no stops are enough.

    `costs[k]` is for a stop before piece k; the first load is whole. Of equal sums the one with later stops is taken.
    """
    max_load, count = capacity * (1.0 + LOAD_TOLERANCE), len(needs)
    stop_s = list[float]()  # with a stop before each piece, when that piece is begun
    best: list[tuple[float, int]] = [(0.0, 0)] + [(math.inf, 0)] * count
    for end in range(1, count + 1):
        begun_s = best[end - 1][0]
        stop_s.append(begun_s + costs[end - 1] if end > 1 else begun_s)
        load = 0.0
        for start in range(end - 1, -1, -1):
            load += needs[start]
            if load > max_load:
                break
            if stop_s[start] < best[end][0] - COST_TOLERANCE_S:
                best[end] = stop_s[start], start
    if math.isinf(best[count][0]):
        return None
    cuts, piece = [], count
    while best[piece][1]:
        piece = best[piece][1]
        cuts.append(piece)
    return best[count][0], tuple(reversed(cuts))


def find_cheapest_exact_stops(
    needs: Sequence[float],
    least_costs_s: Sequence[float],
    compute_cost_s: Callable[[int], float],
    capacity: float,
) -> tuple[int, ...] | None:
    """As `find_cheapest_stops`, with costs computed only where their lower bounds do not rule a stop out."""
    costs_s, is_exact = list(least_costs_s), [False] * len(needs)
    while True:
        cheapest_stops = find_cheapest_stops(needs, costs_s, capacity)
        if cheapest_stops is None:
            return None
        estimated_cuts = [cut for cut in cheapest_stops[1] if not is_exact[cut]]
        if not estimated_cuts:
            return cheapest_stops[1]
        for cut in estimated_cuts:
            costs_s[cut], is_exact[cut] = compute_cost_s(cut), True


SERVICE_CLEAR_M = 20.0  # a place is free when the tractor before has driven this far from it
WAIT_POINT_STEP_M = 20.0  # between places to wait on the path to a place and back, with several tractors
NO_PATH_COST_S = 1e6  # cost of a stop that no path leads to


@dataclass(frozen=True)
class LoadPiece:
    """Legs `first_leg` to `end_leg` - 1 of a mission, worked without a break, and the part of a load they need."""

    first_leg: int
    end_leg: int
    need: float


@dataclass(frozen=True)
class ServiceStop:
    """Before leg `leg` the tank is refilled by `amount`; the tractor may wait for its turn before leg `hold_leg`."""

    leg: int
    hold_leg: int
    amount: float


@dataclass(frozen=True)
class MissionWithStops:
    """The legs of a mission with its stops."""

    legs: tuple[Leg, ...]
    stops: tuple[ServiceStop, ...]


def split_into_pieces(ways: Ways, supply: Supply, mission: Mission) -> list[LoadPiece]:
    """The work of a mission in pieces between which a tractor may stop: swaths, and legs of headland passes."""
    leg_ranges: list[list[int]] = []
    for number, leg in enumerate(mission.legs):
        if not (leg.task.is_work or leg.task.kind == DRIVE_IN):
            continue
        is_continued = bool(leg_ranges) and leg_ranges[-1][1] == number
        if is_continued and not mission.legs[number - 1].task.kind == leg.task.kind == HEADLAND_PASS:
            leg_ranges[-1][1] = number + 1
        else:
            leg_ranges.append([number, number + 1])
    starts = [0, *(last for _, last in leg_ranges)]  # the legs that lead to a piece count for it
    ends = [*(last for _, last in leg_ranges[:-1]), len(mission.legs)]
    return [
        LoadPiece(first, last, supply.compute_legs_need(mission.legs[start:end], ways.site.width_m))
        for (first, last), start, end in zip(leg_ranges, starts, ends, strict=False)
    ]


@dataclass
class LoadGaps:
    """What a stop costs in the gaps between the pieces of a mission; at a place tractors stand in `service_points`."""

    ways: Ways
    supply: Supply
    mission: Mission
    pieces: list[LoadPiece]
    service_points: tuple[Pose, ...]

    @cached_property
    def stop_s(self) -> float:
        """How long a stop takes in the mean (s)."""
        return self.supply.estimate_stop_s(math.fsum(piece.need for piece in self.pieces))

    def get_end_poses(self, gap: int) -> tuple[Pose, Pose]:
        """Poses at the end of the piece before a gap and at the beginning of the piece after it."""
        before, after = self.pieces[gap - 1], self.pieces[gap]
        return _get_leg_pose(self.mission.legs[before.end_leg - 1], -1), _get_leg_pose(
            self.mission.legs[after.first_leg], 0
        )

    def get_legs_between(self, gap: int) -> tuple[Leg, ...]:
        """The legs from piece to piece if no stop is made."""
        return self.mission.legs[self.pieces[gap - 1].end_leg : self.pieces[gap].first_leg]

    def _estimate_direct_s(self, gap: int) -> float:
        """Seconds from piece to piece without a stop."""
        legs = self.get_legs_between(gap)
        gear_changes = sum(a.gear != b.gear for a, b in pairwise(legs))
        return sum(leg.length_m / leg.speed_mps for leg in legs) + gear_changes * self.ways.site.costs.cusp_s

    def bound_stop_cost_s(self, gap: int) -> float:
        """Lower bound on the extra seconds of a stop in a gap: a straight line to the place and back."""
        if gap == 0 or self.supply.served_at != PLACE:
            return self.stop_s
        (ax, ay, _), (bx, by, _) = self.get_end_poses(gap)
        flight_m = min(math.dist((ax, ay), spot[:2]) + math.dist(spot[:2], (bx, by)) for spot in self.service_points)
        return flight_m / self.ways.site.rules.turn_speed_mps + self.stop_s - self._estimate_direct_s(gap)

    def compute_stop_cost_s(self, gap: int) -> float:
        """Extra seconds of a stop in a gap."""
        if self.supply.served_at != PLACE:
            return self.stop_s
        paths = self.find_paths(gap)
        if paths is None:
            return NO_PATH_COST_S
        driven_s = sum(path.drive_s for path in paths)
        return driven_s + self.stop_s - self._estimate_direct_s(gap)

    def find_paths(self, gap: int) -> tuple[Move, Move] | None:
        """The quickest path to the place and on from there; None if there is none."""
        a, b = self.get_end_poses(gap)
        path_pairs = [(self.ways.find(a, spot), self.ways.find(spot, b)) for spot in self.service_points]
        options = [(path_to, path_on) for path_to, path_on in path_pairs if path_to is not None and path_on is not None]
        return min(options, key=lambda pair: round(pair[0].cost_s + pair[1].cost_s, 3), default=None)


def add_stops_in_gaps(gaps: LoadGaps) -> MissionWithStops:
    """The mission with its cheapest stops; raises StrategyError if none are enough or no path leads there."""
    ways, supply, mission, pieces = gaps.ways, gaps.supply, gaps.mission, gaps.pieces
    needs = [piece.need for piece in pieces]
    if supply.is_enough(sum(needs)):
        return MissionWithStops(mission.legs, ())
    if max(needs) > supply.capacity:
        raise StrategyError(supply.explain_small_load(max(needs)))
    least_costs_s = [gaps.bound_stop_cost_s(gap) for gap in range(len(pieces))]
    stop_gaps = find_cheapest_exact_stops(needs, least_costs_s, gaps.compute_stop_cost_s, supply.capacity)
    if stop_gaps is None or any(gaps.compute_stop_cost_s(gap) >= NO_PATH_COST_S for gap in stop_gaps):
        raise StrategyError(
            f"No path with a turning radius of {ways.site.rules.radius_m:.1f} m leads to "
            f"{_describe_place(supply)[0].lower()}{_describe_place(supply)[1:]} and back before a load is used up; "
            "use another place, or refill on the headland."
        )
    return _insert_stop_legs(gaps, stop_gaps)


def _describe_place(supply: Supply) -> str:
    if supply.place is None:
        return "The place to refill"
    x, y = supply.place
    return f"The place to refill at ({x:.0f}, {y:.0f} m)"


def _insert_stop_legs(gaps: LoadGaps, cuts: Sequence[int]) -> MissionWithStops:
    """The legs with a stop before every piece of `cuts`."""
    old_legs, pieces = gaps.mission.legs, gaps.pieces
    legs: list[Leg] = []
    stops: list[ServiceStop] = []
    legs_done = 0  # old legs that are written
    amounts = gaps.supply.list_amounts(
        [math.fsum(piece.need for piece in pieces[first:end]) for first, end in pairwise([0, *cuts, len(pieces)])]
    )
    for cut, amount in zip(cuts, amounts, strict=True):
        legs += old_legs[legs_done : pieces[cut - 1].end_leg]
        stop_s = gaps.supply.compute_stop_s(amount)
        legs_to, legs_on = _build_detour(gaps, cut, stop_s)
        least = stops[-1].leg + 1 if stops else 0
        stops.append(ServiceStop(len(legs) + len(legs_to), find_waiting_leg(legs, least), amount))
        legs += [*legs_to, *legs_on]
        legs_done = pieces[cut].first_leg
        if not legs_on:
            legs.append(replace(old_legs[legs_done], stand_s=stop_s))
            legs_done += 1
    return MissionWithStops((*legs, *old_legs[legs_done:]), tuple(stops))


def find_waiting_leg(legs: Sequence[Leg], least: int) -> int:
    """The last leg before a stop, from `least` on, before which a tractor may wait; else the path to the stop."""
    work_legs = (number for number in range(len(legs) - 1, least - 1, -1) if legs[number].may_wait)
    return next(work_legs, len(legs))


def _build_detour(gaps: LoadGaps, cut: int, stop_s: float) -> tuple[list[Leg], list[Leg]]:
    """The legs to the stop before a piece, and on from there; the first of these stands until the tank is refilled."""
    supply, goal_task = gaps.supply, gaps.mission.legs[gaps.pieces[cut].first_leg].task
    if supply.served_at == PLACE:
        paths = gaps.find_paths(cut)
        assert paths is not None  # its cost was below NO_PATH_COST_S
        task = replace(goal_task, kind=ROUTE if paths[1].kind == "route" else TURN)
        legs_to, legs_on = (
            add_wait_points(build_path_legs(gaps.ways.site, path.path, each), WAIT_POINT_STEP_M)
            for path, each in zip(paths, (LegTask(REFILL), task), strict=True)
        )
    else:
        legs_to, legs_on = [], list(gaps.get_legs_between(cut))
    if legs_on:
        legs_on[0] = replace(legs_on[0], stand_s=stop_s)
    return legs_to, legs_on


def _get_leg_pose(leg: Leg, end: int) -> Pose:
    """Pose of a tractor that drives forwards at the first (0) or the last (-1) point of a leg."""
    a, b = (leg.points[0], leg.points[1]) if end == 0 else (leg.points[-2], leg.points[-1])
    x, y = leg.points[end]
    return float(x), float(y), math.atan2(leg.gear * (b[1] - a[1]), leg.gear * (b[0] - a[0]))
