"""The rest of the work when tractors have failed: their tracks for the others, simulated from where everybody is.

`replanned` works on what planner.service.centre.remaining takes out of a centre, for seconds, in a process of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
import shapely.ops

from fields.errors import HeadlandError
from planner.candidates.evaluate import beside_clearance_m
from planner.candidates.refills import crowded
from planner.service.centre.course import Course
from planner.service.centre.errors import CentreError
from planner.service.centre.fleet_plan import FleetPlan, timed
from planner.service.centre.handing_over import Hand, Piece, hand_over, pieces_left, pose_at
from planner.service.centre.releasing import passed
from planner.service.centre.remaining import LEAST_M, MOVED_M, Rest
from planner.service.centre.waiting import waiting_where_it_can
from planner.site import Site, prepare
from planner.yielding.deconflict import without_conflicts
from planner.yielding.giving_way import Rules as WayRules
from planner.yielding.giving_way import Scheduled, giving_way
from strategies.entrance import way_out
from strategies.job import Job
from strategies.refilling.onward import berths_of, served_in_turn, supply_of, taken_up
from strategies.supply import HEADLAND, TENDER, Supply
from strategies.ways.connect import Connector
from strategies.ways.paths import Pose
from vehicle.missions import ENTER, LEAVE, Follow, Gate, Leg, Mission, Plan, Task
from vehicle.rehearsal import Rehearsal
from vehicle.run import DONE, Run
from vehicle.world import World

STUB_M = 0.02  # a tractor that has failed is one that drives so far: it stands in the way of the others
OBSTACLE_M = 0.5
ROAD_M = 1e4
MOST_SINGLE = 5
OPEN = 0.02  # of the work: where no more is left, no other attempt is made


@dataclass(frozen=True, eq=False)
class Proposal:
    """The plan of the rest: legs before `kept` (by tractor) are as they were. `eta_s` counts from when it was asked.

    `moved_m` of work are driven by others or otherwise than planned. Open stay `left_m` that nobody can reach, and
    `blocked_m` where somebody or something stands; `sentence` says so.
    """

    plan: FleetPlan
    kept: tuple[int, ...]
    eta_s: float
    moved_m: float
    left_m: float
    blocked_m: float = 0.0
    sentence: str | None = None


def replanned(rest: Rest) -> Proposal:
    """The tracks of those who drive no more, given to the others. Raises CentreError where no such plan works."""
    asked = replace(
        rest.plan.scenario, rain=None, draws=None, before_s=None, refill=None, gnss=False, gnss_table=None
    )
    site = prepare(asked, rest.plan.field, rest.plan.tractor, rest.plan.implement)
    helpers = [number for number in range(rest.plan.tractors) if _can_help(rest, number)]
    if not helpers:
        raise CentreError("Every other tractor is on its way home already; nobody can take over.")
    best: Proposal | None = None
    first: CentreError | None = None
    for keep_m, who in _attempts(site, helpers):
        try:
            made = _attempt(rest, site, _blocked(rest, site, keep_m), who)
        except HeadlandError as refusal:
            first = first or (refusal if isinstance(refusal, CentreError) else CentreError(str(refusal)))
            continue
        if best is None or made.left_m < best.left_m:
            best = made
        if best.left_m <= OPEN * (best.moved_m + best.left_m):
            break
    if best is None:
        assert first is not None
        raise first
    return best


def _attempts(site: Site, helpers: list[int]) -> list[tuple[float, list[int]]]:
    """How far to keep from what stands in the way, and who helps: all and well clear, then less of either."""
    clear_m = _ends_m(site)
    single = [[number] for number in helpers] if len(helpers) > 1 else []
    return [(clear_m, helpers), (0.0, helpers), *((clear_m, who) for who in single[:MOST_SINGLE])]


def _attempt(rest: Rest, site: Site, blocked: shapely.Geometry, helpers: Sequence[int]) -> Proposal:
    plan, job = rest.plan, _job(site, blocked)
    wide = shapely.buffer(blocked, 0.5)
    ends = [_own_end(rest, number, wide, number in helpers) for number in range(plan.tractors)]
    shares = [_pieces(rest, number, end, job, wide) for number, end in enumerate(ends)]
    pieces = [piece for share, _ in shares for piece in share]
    hands = [_hand(rest, number, ends[number]) for number in helpers]
    unreached = hand_over(pieces, hands, job)
    supply = _supply(plan)
    missions = _missions(rest, job, hands, ends, supply)
    here = _from_here(rest, missions)
    run = _without_meetings(rest, site, here if supply is None else served_in_turn(here, supply))
    why = crowded(run, replace(job, supply=supply))
    if why is not None:
        raise CentreError(f"The rest cannot be planned: {why}.")
    moved = sum(piece.work_m for piece in pieces) - sum(piece.work_m for piece in unreached)
    left = sum(piece.work_m for piece in unreached)
    blocked_m = sum(metres for _, metres in shares)
    others = [n for n in range(plan.tractors) if n not in rest.without]
    eta_s = float(max(run.finish_s[n] for n in others)) / rest.times
    told = " ".join(filter(None, (_told(rest, left, blocked_m), _unknown_load(plan, supply)))) or None
    return Proposal(_whole_plan(rest, missions, run), tuple(ends), eta_s, moved, left, blocked_m, told)


def _told(rest: Rest, left_m: float, blocked_m: float) -> str | None:
    """What stays open, and why, in a sentence or two; None where nothing does."""
    here = [f"tractor {number + 1}" for number in rest.without if not _outside(rest, number)]
    here += ["an obstacle"] if rest.obstacles else []
    near = f"{blocked_m:.0f} m of track lie too near to {' and '.join(here)} and stay open."
    far = f"{left_m:.0f} m of track cannot be reached and stay open."
    return " ".join(words for words, metres in ((near, blocked_m), (far, left_m)) if metres >= 0.5) or None


def _unknown_load(plan: FleetPlan, supply: Supply | None) -> str | None:
    """A sentence where tractors carry something and the plan does not tell how much, as a load lasted for each."""
    if supply is not None or "refills" not in plan.plan.notes:
        return None
    return "How much a load is the plan does not tell, as nobody stops for one in it: look to the tanks."


def _blocked(rest: Rest, site: Site, keep_m: float) -> shapely.Geometry:
    """Where the guided point of nobody may be: round tractors that have failed, and obstacles, and `keep_m` more."""
    half_m = 0.5 * max(site.implement.contact_width_m, site.tractor.width_m)
    reach_m = half_m + site.scenario.clearance_m
    shapes = [shapely.buffer(shape, half_m + OBSTACLE_M) for shape in rest.obstacles]
    for number in rest.without:
        if not _outside(rest, number):
            x, y, heading = _pose(rest, number)
            ahead, place = np.array([math.cos(heading), math.sin(heading)]), np.array([x, y])
            long_m = site.tractor.length_m
            line = shapely.LineString([place - (long_m + site.implement.hitch_m) * ahead, place + 0.5 * long_m * ahead])
            shapes.append(shapely.buffer(line, half_m + reach_m))
    return shapely.buffer(shapely.union_all(shapes), keep_m)


def _outside(rest: Rest, number: int) -> bool:
    """Whether a tractor stands on the road: not in by the entrance yet, or out by it again."""
    state, mission = rest.states[number], rest.plan.plan.missions[number]
    return (mission.enters and not rest.begun(number)) or (mission.leaves and state.done)


def _pose(rest: Rest, number: int) -> Pose:
    """Where a tractor says it is, or should be by what it has driven."""
    state, course = rest.states[number], rest.plan.courses[number]
    if state.report is not None:
        return state.report.x_m, state.report.y_m, state.report.heading_rad
    x, y, heading = course.along(min(state.leg, len(course.legs) - 1), state.leg_m, [0.0], len(course.legs))[0]
    return float(x), float(y), float(heading)


def _job(site: Site, blocked: shapely.Geometry) -> Job:
    """A job whose ways keep off what is blocked."""

    def finder(region: shapely.Geometry) -> Connector:
        return Connector(shapely.difference(region, blocked), site.manner.radius_m, site.costs, site.kinds)

    headland, rim = (None if region.is_empty else finder(region) for region in (site.beside, site.rim))
    return replace(
        site.job(1), connector=finder(site.free), headland=headland, rim=rim, careful=(), ways={}, tables={}
    )


def _ends_m(site: Site) -> float:
    """How far a machine reaches ahead of or behind the guided point."""
    boxes = site.manner.boxes
    return max(max(abs(rear), abs(front)) for rear, front, _ in boxes)


def _can_help(rest: Rest, number: int) -> bool:
    """Whether a tractor drives on, and is not on its way home already."""
    state, legs = rest.states[number], rest.plan.courses[number].legs
    if number in rest.without:
        return False
    return not any(leg.task.kind == LEAVE for leg in legs[: max(state.released, state.leg + 1)])


def _own_end(rest: Rest, number: int, wide: shapely.Geometry, helps: bool) -> int:
    """How many legs of a tractor stay as they are: up to what leads home, or to what is blocked now."""
    state, legs = rest.states[number], rest.plan.courses[number].legs
    if number in rest.without:
        return min(state.leg + 1, len(legs))
    fixed = max(state.released, state.leg + 1)
    for k in range(fixed, len(legs)):
        if legs[k].task.kind == LEAVE and helps:
            return k
        if helps and shapely.intersects(shapely.LineString(legs[k].points), wide):
            return k
    return len(legs)


def _pieces(rest: Rest, number: int, end: int, job: Job, wide: shapely.Geometry) -> tuple[list[Piece], float]:
    """What a tractor will not work: all that is left of one that is gone, what is blocked of another.

    The second value is the metres of it where something stands.
    """
    state, course = rest.states[number], rest.plan.courses[number]
    if number in rest.without:
        return pieces_left(course, state.leg, state.leg_m, job, wide)
    return pieces_left(course, end, 0.0, job, wide)


def _hand(rest: Rest, number: int, end: int) -> Hand:
    course, state = rest.plan.courses[number], rest.states[number]
    left_s = 0.0 if state.done else course.before_s[end] - course.driven_s(state.leg, state.leg_m)
    return Hand(number, left_s, pose_at(course.legs[end - 1], -1), [])


def _supply(plan: FleetPlan) -> Supply | None:
    """What tractors of a plan carry, by what they do with it; None where they do not stop for it."""
    asked = (plan.scenario.refill or "").strip().lower()
    where = TENDER if asked == TENDER else HEADLAND
    return supply_of([course.legs for course in plan.courses], plan.implement.width_m, where)


def _missions(
    rest: Rest, job: Job, hands: Sequence[Hand], ends: Sequence[int], supply: Supply | None
) -> list[tuple[Leg, ...]]:
    """All legs of every tractor, gates of the gone left out; those before `ends` are as they were.

    What is taken over has stops where the load that a tractor has left then asks for them.
    """
    taken = {hand.number: hand.legs for hand in hands}
    known = berths_of([course.legs for course in rest.plan.courses])
    several = replace(job, tractors=rest.plan.tractors)
    missions = []
    for number, course in enumerate(rest.plan.courses):
        end = ends[number]
        legs = [_heeding(leg, rest) for leg in course.legs[:end]]
        if (number not in rest.without and end < len(course.legs)) or taken.get(number):
            legs += taken[number]
            if supply is not None:
                legs = taken_up(several, supply, legs, end, known)
            if course.legs[-1].task.kind == LEAVE and job.gate is not None:
                legs += way_out(job, job.gate, Mission(tuple(legs)))
        missions.append(tuple(legs))
    return _existing(missions, ends)


def _existing(missions: Sequence[tuple[Leg, ...]], ends: Sequence[int]) -> list[tuple[Leg, ...]]:
    """Legs without gates on, or following, legs that are gone: what was waited for there is driven otherwise now."""

    def kept(leg: Leg) -> Leg:
        gates = tuple(gate for gate in leg.gates if gate.leg < ends[gate.tractor])
        follow = leg.follow if leg.follow and leg.follow.leg < ends[leg.follow.tractor] else None
        return replace(leg, gates=gates, follow=follow)

    return [tuple(kept(leg) for leg in legs) for legs in missions]


def _heeding(leg: Leg, rest: Rest) -> Leg:
    """A leg without gates that are passed or of those who drive no more, and follows nobody of them."""
    gates = tuple(g for g in _gates(leg, rest) if not passed(g, rest.states))
    follow = leg.follow
    if follow is not None and (follow.tractor in rest.without or rest.states[follow.tractor].leg > follow.leg):
        follow = None
    return replace(leg, gates=gates, follow=follow)


def _gates(leg: Leg, rest: Rest) -> list[Gate]:
    """What a leg waits for, but not for those who drive no more: at the entrance whoever came before them instead."""
    gates = []
    for gate in leg.gates:
        if gate.tractor not in rest.without:
            gates.append(gate)
        elif leg.task.kind == ENTER and not rest.begun(gate.tractor):
            gates += _gates(rest.plan.courses[gate.tractor].legs[0], rest)
    return gates


def _from_here(rest: Rest, missions: Sequence[tuple[Leg, ...]]) -> Plan:
    """A plan of what is left from where everybody is; its leg k is leg k more than the present one."""
    heres = []
    for number, (legs, state) in enumerate(zip(missions, rest.states, strict=True)):
        if number in rest.without or (state.done and state.leg >= len(legs) - 1):
            heres.append(Mission((_stub(rest, number, legs),)))
            continue
        here = _cut(legs[state.leg], state.leg_m) if rest.begun(number) else legs[0]
        rows = [here, *legs[state.leg + 1 :]]
        heres.append(Mission(tuple(_shifted(leg, rest, -1) for leg in rows)))
    return Plan(tuple(heres), {"strategy": "rest"})


def _stub(rest: Rest, number: int, legs: tuple[Leg, ...]) -> Leg:
    """A tractor that stands where it is; one on the road far from where the others drive."""
    x, y, heading = _pose(rest, number)
    if _outside(rest, number):
        x -= ROAD_M * (number + 1)
    ahead = np.array([math.cos(heading), math.sin(heading)])
    return Leg(np.array([(x, y), (x, y) + STUB_M * ahead]), 1.0, ground=legs[0].ground, task=Task())


def _cut(leg: Leg, driven_m: float) -> Leg:
    """What is left of a leg."""
    line = shapely.LineString(leg.points)
    rest = shapely.ops.substring(line, min(max(driven_m, 0.0), line.length - LEAST_M), line.length)
    stand_s = leg.stand_s if driven_m <= MOVED_M else 0.0  # for how long it stands already nobody knows
    return replace(leg, points=np.asarray(rest.coords), gates=(), stand_s=stand_s)


def _shifted(leg: Leg, rest: Rest, sign: int) -> Leg:
    """A leg whose gates name legs counted from the present ones (`sign` -1), or from the start again (1).

    Who drives no more is waited for by nobody: that a simulated one has driven its stub says nothing of the real one.
    """

    def moved(tractor: int, number: int, metres: float) -> tuple[int, float]:
        state = rest.states[tractor]
        first = number == (state.leg if sign < 0 else 0)
        return number + sign * state.leg, max(metres + (sign * state.leg_m if first else 0.0), 0.0)

    waited = (gate for gate in leg.gates if gate.tractor not in rest.without)
    gates = tuple(Gate(g.tractor, *moved(g.tractor, g.leg, g.after_m)) for g in waited)
    follow = leg.follow
    if follow is not None:
        follow = Follow(follow.tractor, moved(follow.tractor, follow.leg, 0.0)[0], follow.gap_m)
    return replace(leg, gates=gates, follow=follow)


def _without_meetings(rest: Rest, site: Site, plan: Plan) -> Run:
    """The plan simulated, with tractors giving way; raises CentreError where they meet all the same."""
    clearance_m, beside_m = site.scenario.clearance_m, beside_clearance_m(site)
    rehearsal = Rehearsal(
        site.tractor, site.implement, stop_clearance_m=clearance_m, beside_clearance_m=beside_m, seed=site.scenario.seed
    )

    def patience_s(what: Plan) -> float:
        legs = [leg for mission in what.missions for leg in mission.legs]
        return 600.0 + sum(leg.stand_s + 2.0 * leg.length_m / leg.speed_mps for leg in legs)

    def alone(mission: Mission) -> Run:
        single = Plan((mission,))
        return World(single, site.tractor, site.implement).run(max_time_s=patience_s(single))

    def give_way(what: Plan, slack: float) -> Scheduled | None:
        return giving_way(what, WayRules(site.tractor, site.implement, clearance_m, beside_m, alone), slack)

    try:
        run, why = without_conflicts(plan, lambda p: rehearsal.simulate(p, patience_s(p)), give_way=give_way)
    except HeadlandError as refusal:
        raise CentreError(f"The rest cannot be planned: {refusal}") from None
    if why is not None or run.outcome != DONE:
        raise CentreError(f"The rest cannot be planned: {why or run.outcome}.")
    return waiting_where_it_can(rest, run, lambda what: rehearsal.simulate(what, patience_s(what)))


def _whole_plan(rest: Rest, missions: Sequence[tuple[Leg, ...]], run: Run) -> FleetPlan:
    """Legs driven so far, and those of the run, as one plan."""
    plan, times, wholes, courses = rest.plan, timed(run.plan, run), [], []
    for number, legs in enumerate(missions):
        at, old = rest.states[number].leg, plan.courses[number]
        still = number in rest.without or (rest.states[number].done and at >= len(legs) - 1)
        first = 1 if rest.begun(number) else 0
        driven = tuple(replace(leg, gates=(), follow=None) for leg in legs[: len(legs) if still else at + first])
        if first and not still:  # who stands may have to wait where it is
            here_gates = _shifted(run.plan.missions[number].legs[0], rest, 1).gates
            driven = (*driven[:-1], replace(driven[-1], gates=here_gates))
        ahead = () if still else tuple(_shifted(leg, rest, 1) for leg in run.plan.missions[number].legs[first:])
        whole = Mission((*driven, *ahead))
        wholes.append(whole)
        seconds = (*old.seconds[: len(driven)], *times[number].seconds[first : first + len(ahead)])
        courses.append(Course(whole, seconds))
    notes = {**plan.plan.notes, "replanned": True}
    if "refills" in notes:
        told = notes["refills"] if isinstance(notes["refills"], list) else []
        notes["refills"] = [stop for stop in told if _still_there(stop, wholes)]
    saved = replace(plan.saved, plan=Plan(tuple(wholes), notes))
    finish = tuple(rest.driven_s + float(seconds) for seconds in run.finish_s)
    return replace(plan, saved=saved, courses=tuple(courses), finish_s=finish,
                   near_m=min(plan.near_m, run.min_clearance_m))  # fmt: skip


def _still_there(stop: Any, wholes: Sequence[Mission]) -> bool:
    """Whether what is noted of a stop, in a plan that anybody may have written, is true of the new legs."""
    try:
        number, k, place = stop["tractor"] - 1, stop["leg"], (stop["x_m"], stop["y_m"])
        leg = wholes[number].legs[k]
        return number >= 0 and k >= 0 and leg.stand_s > 0.0 and math.dist(leg.points[0], place) < LEAST_M
    except (TypeError, KeyError, IndexError, OverflowError):
        return False
