"""Headland first or last, round by round, furrow by furrow: the stage of every line, and what leaving that order is
charged; tractors that begin one after the other; and gates by which a fleet keeps to that order, where one tractor
drives over another's ground.

Where finished ground must not be driven over, nobody works a piece of what comes last before all others have passed
it for what comes first. Where a crop stands, nobody drives over a piece of what comes first, for what comes last,
before it is worked. Tractors on ground of their own wait for nobody.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Flags, Floats, Integers
from fields.geometry.overlays import intersect
from strategies.lines.deal_apart import list_rings
from strategies.lines.work_line import HOLE_PASS, WorkLine, build_tool_strip
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.programmes.order_tours import SUM_SHARE
from strategies.site.site import ORDER_S, Site
from vehicle.missions.plan import HEADLAND_PASS, SWATH, LegGate, LegTask, Mission, Plan


def find_first_tasks(site: Site, lines: Sequence[WorkLine], order: str) -> frozenset[LegTask]:
    """What the lines are for that come before all others in an order: those of the headland, or the others.

    Where a machine works its way into a crop that stands, only passes round the field are its headland.
    """
    works_way_in = _works_way_in(site, order)
    headland = {
        line.task
        for line in lines
        if line.task.kind == HEADLAND_PASS and (line.group[0] == HEADLAND_PASS or not works_way_in)
    }
    return frozenset(headland if order == HEADLAND_FIRST else {line.task for line in lines} - headland)


def list_stages(site: Site, lines: Sequence[WorkLine], order: str) -> list[int]:
    """The stage of every line; with no order everything comes at any time.

    Into a crop that stands a machine works its way, headland first: passes round the field from the outside, tracks,
    passes round holes that it reaches over worked ground then, and last the pieces that begin or end there and what all
    others leave.
    """
    first = find_first_tasks(site, lines, order)
    if not _works_way_in(site, order):
        return [int(bool(order) and line.task not in first) for line in lines]
    passes = max((line.task.number or 0 for line in lines if line.task.kind == HEADLAND_PASS), default=0)
    round_holes = shapely.MultiLineString([line.paths[0] for line in lines if line.group[0] == HOLE_PASS])

    def find_stage(line: WorkLine) -> int:
        number = line.task.number or 0
        if line.task in first:
            return number - 1
        if line.group[0] == HOLE_PASS:
            return 2 * passes + 1 - number
        return passes if line.group[0] == SWATH and not ends_there(line) else 2 * passes + 1

    def ends_there(line: WorkLine) -> bool:
        ends = shapely.points(line.tool_path[[0, -1]])
        return bool((shapely.distance(ends, round_holes) < site.width_m).any())

    return [find_stage(line) for line in lines]


def _works_way_in(site: Site, order: str) -> bool:
    return site.crop_stands and order == HEADLAND_FIRST


def charge_order(site: Site, lines: Sequence[WorkLine], order: str, allowed: Flags, *, goes_on: bool) -> Floats:
    """Seconds (2 n + 1, 2 n + 1) that moves between nodes are charged that leave the order of passes or of furrows.

    Of a fleet whoever leaves it pays in full, not only who finishes last; where work goes on, where tractors stand
    decides what they go on with.
    """
    charged_s = charge_rounds(site, lines, order, allowed) + charge_furrows(site, lines, allowed)
    return charged_s / SUM_SHARE if len(allowed) > 1 and not goes_on else charged_s


def charge_rounds(site: Site, lines: Sequence[WorkLine], order: str, allowed: Flags) -> Floats:
    """Seconds (2 n + 1, 2 n + 1) that moves between nodes are charged: ORDER_S where they leave the order of passes.

    Passes round the field, or round a hole, are worked from the outside in where the headland comes first, so that the
    machine is at the tracks when they begin, else from the inside out; what they leave comes with the last beside it.
    Those round one thing follow on those round another with the first. What is one tractor's alone, of those `allowed`
    (tractors, n), has an order of its own, follows on tracks with the first too, and is done before another thing is
    gone round. Into a crop that stands, stages see to the order.
    """
    charged_s = np.zeros((2 * len(lines) + 1, 2 * len(lines) + 1))
    if _works_way_in(site, order):
        return charged_s
    owners = np.where(allowed.sum(axis=0) == 1, allowed.argmax(axis=0), -1)
    nests, places, is_last = np.full(len(lines), -1), np.zeros(len(lines), np.int64), np.ones(len(lines), bool)
    rings = ([number for side in ring for number in side] for ring in list_rings(lines))
    shares = ([n for n in ring if owners[n] == owner] for ring in rings for owner in np.unique(owners[ring]))
    for nest, numbers in enumerate(shares):
        sides = [number for number in numbers if lines[number].is_side]
        if sides:
            nests[numbers] = nest
            places[numbers] = _place_passes(site, lines, numbers, sides, order)
            is_last[numbers] = places[numbers] == places[numbers].max()
    goes_back = (nests[:, None] == nests) & (places[:, None] > places)
    is_track = np.array([line.group[0] == SWATH for line in lines], bool)
    follows = (nests >= 0)[:, None] | np.logical_and.outer(is_track, owners >= 0)
    begins_late = follows & (places > 0)
    leaves_early = (~is_last & (owners >= 0))[:, None]
    is_charged = (nests >= 0) & (goes_back | ((nests[:, None] != nests) & (begins_late | leaves_early)))
    charged_s[:-1, :-1] = ORDER_S * np.kron(is_charged, np.ones((2, 2)))
    return charged_s


def _place_passes(
    site: Site, lines: Sequence[WorkLine], numbers: Sequence[int], sides: Sequence[int], order: str
) -> list[int]:
    """The place of lines of the headland in the order of its passes: that of the last side beside what these leave."""
    passes = sorted({lines[number].task.number or 0 for number in sides}, reverse=order != HEADLAND_FIRST)
    places = {number: passes.index(lines[number].task.number or 0) for number in sides}
    paths = [shapely.LineString(lines[number].paths[0]) for number in sides]

    def find_place(number: int) -> int:
        if number in places:
            return places[number]
        gaps_m = shapely.distance(shapely.LineString(lines[number].paths[0]), paths)
        return int(np.array(list(places.values()))[gaps_m <= max(site.width_m, gaps_m.min())].max())

    return [find_place(number) for number in numbers]


def charge_furrows(site: Site, lines: Sequence[WorkLine], allowed: Flags) -> Floats:
    """Seconds (2 n + 1, 2 n + 1) that moves between nodes are charged from a track to one that is not beside it, and to
    and from ground that passes leave, where no furrow leads.

    Beside it is the next that a tractor may work, of the `allowed` (tractors, n), and another piece of the same track.
    """
    charged_s = np.zeros((2 * len(lines) + 1, 2 * len(lines) + 1))
    if site.furrow_s == 0.0:
        return charged_s
    is_track = np.array([line.task.kind == SWATH for line in lines], bool)
    numbers = np.array([line.task.number or 0 for line in lines])
    is_beside = np.zeros((len(lines), len(lines)), bool)
    for own in allowed & is_track:
        places = np.searchsorted(np.unique(numbers[own]), numbers)
        is_beside |= np.logical_and.outer(own, own) & (abs(np.subtract.outer(places, places)) <= 1)
    is_left = np.array([line.task.kind == HEADLAND_PASS and not line.is_side for line in lines], bool)
    is_charged = np.logical_or.outer(is_track | is_left, is_track | is_left) & ~is_beside
    charged_s[:-1, :-1] = site.furrow_s * np.kron(is_charged, np.ones((2, 2)))
    return charged_s


def stagger_starts(plan: Plan, distance_m: float) -> Plan:
    """A plan in which each tractor begins when the one before has driven a distance of its first working leg.

    Nobody waits for a tractor that waits itself before it begins.
    """
    for number in range(1, plan.tractors):
        before: Mission = plan.missions[number - 1]
        first = next(place for place, leg in enumerate(before.legs) if leg.implement)
        waits = any(gate.tractor >= number for gate in before.legs[0].gates)
        if not waits:
            gate = LegGate.place(number - 1, first, before.legs[first].length_m, distance_m)
            plan = plan.copy_with_gate(number, 0, gate)
    return plan


Shapes = npt.NDArray[np.object_]

_NOTHING = np.array(None, object)


def add_order_gates(plan: Plan, site: Site, first: Collection[LegTask], body_width_m: float, *, is_kept: bool) -> Plan:
    """The plan with the gates that the `first` tasks before all others ask for.

    `is_kept` is whether finished ground must not be driven over, else a crop stands that must not. A body is
    `body_width_m` wide. No gate comes before another that opens it, so they never bar each other. Who rests has none.
    """
    orders = [_MissionOrder.trace(mission, site, first, body_width_m) for mission in plan.missions]
    works = [number for number, mission in enumerate(plan.missions) if mission.works]
    for waiting, awaited in permutations(works, 2):
        gates = dict(sorted(_iter_waits(orders[waiting], orders[awaited], is_kept=is_kept)))
        reached = -1
        for hold, leg in gates.items():
            if leg > reached:
                gate = LegGate.place(awaited, leg, plan.missions[awaited].legs[leg].length_m)
                plan, reached = plan.copy_with_gate(waiting, hold, gate), leg
    return plan


@dataclass(frozen=True, eq=False)
class _MissionOrder:
    """What a mission drives over and works, and where it may wait between what comes first and the rest.

    Attributes:
        driven: (legs,) the ground that its body drives over.
        worked: (legs,) the ground that it works, None for a leg without work.
        stages: (legs,) 0 up to the last of what comes first, 1 from there on.
        is_first: (legs,) whether a leg works what comes first.
        holds: (legs,) where it waits for others before a leg of the second stage: as late as it may, but no sooner than
            before the last part of its first stage, where it may stand in any case.
        end: the last leg that others wait for, -1 for none: what it drives before it may wait itself.
    """

    driven: Shapes
    worked: Shapes
    stages: Integers
    is_first: Flags
    holds: Integers
    end: int

    @classmethod
    def trace(cls, mission: Mission, site: Site, first: Collection[LegTask], body_width_m: float) -> _MissionOrder:
        """The order of a mission on a site."""
        legs = mission.legs
        is_first = np.array([leg.implement and leg.task in first for leg in legs])
        last = int(np.flatnonzero(is_first)[-1]) if is_first.any() else -1
        may_wait = [number for number, leg in enumerate(legs) if leg.may_wait]
        border = max((number for number in may_wait if number <= last), default=0)
        holds = np.full(len(legs), border)
        for number in (number for number in may_wait if number > border):
            holds[number:] = number
        owner = np.repeat(np.arange(len(legs)), [len(leg.points) for leg in legs])
        paths = shapely.linestrings(np.concatenate([leg.points for leg in legs]), indices=owner)
        driven = shapely.buffer(paths, 0.5 * body_width_m, cap_style="flat")
        strips = [
            build_tool_strip(leg.points, site.rules.tool_m, site.width_m) if leg.implement else None for leg in legs
        ]
        stages = (np.arange(len(legs)) > last).astype(np.int64)
        return cls(driven, np.array(strips, object), stages, is_first, holds, border - 1 if last >= 0 else -1)


def _iter_waits(waiting: _MissionOrder, awaited: _MissionOrder, *, is_kept: bool) -> Iterator[tuple[int, int]]:
    """Where one mission waits and the leg of another that it waits for, wherever the ground asks for it."""
    if awaited.end < 0:
        return
    own, others = (waiting.worked, awaited.driven) if is_kept else (waiting.driven, awaited.worked)
    comes_first = awaited.stages == 0 if is_kept else awaited.is_first
    own, others = np.where(waiting.stages == 1, own, _NOTHING), np.where(comes_first, others, _NOTHING)
    pairs = shapely.STRtree(others).query(own, predicate="intersects")
    is_over = shapely.area(intersect(own[pairs[0]], others[pairs[1]])) > 0.0
    for leg, other in pairs[:, is_over].T.tolist():
        yield int(waiting.holds[leg]), min(other, awaited.end)
