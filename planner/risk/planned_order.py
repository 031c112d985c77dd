"""Gates that keep the planned order of tractors wherever two use the same ground, in every sample.

A plan has gates only where they were needed at its simulated times. With other times other tractors meet, and one must
give way. In the planned order none can block another for ever, however late they are (action dependency graphs: Hönig
et al. 2019, IEEE Robotics and Automation Letters 4(2):1125). Legs are cut so that a tractor can wait along one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Floats, Integers
from vehicle.missions.plan import Leg, LegGate, Mission, Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Implement, Tractor
from vehicle.records import REC_ANGLE, REC_LEG, REC_POSE, REC_SPEED
from vehicle.sim.compile import list_contact_boxes

MIN_PART_M = 0.5  # on either side of a cut
OUTLINE_ROW_STEP = 5  # rows of the 10 Hz record between outlines: under a metre of driving
SEGMENT_M = 6.0
SEGMENT_RAD = math.radians(25.0)
BODY_MARGIN_M = 0.05  # around either machine


@dataclass(frozen=True, order=True)
class LegCut:
    """A place on a leg: the row of the record there, and metres from the start of the leg."""

    row: int
    along_m: float


LegCuts = Mapping[tuple[int, int], Sequence[LegCut]]
"""Cuts by (tractor, leg)."""


def cut_legs(run: SimulationRun, cuts: LegCuts) -> SimulationRun:
    """The same run with these legs cut; every part is a leg of its own, in the plan and in the record.

    Legs that follow or are followed stay whole, and no part is shorter than MIN_PART_M.
    """
    places = _select_allowed(run.plan, cuts)
    if not places:
        return run
    first_parts = [
        np.cumsum([0, *(1 + len(places.get((number, leg), ())) for leg in range(len(mission.legs)))])
        for number, mission in enumerate(run.plan.missions)
    ]
    record = run.record.copy()
    for tractor, first_part in enumerate(first_parts):
        leg_of_row = run.get_leg_numbers(tractor)
        new_leg_of_row = first_part[leg_of_row]
        for (cut_tractor, _), leg_cuts in places.items():
            if cut_tractor == tractor:
                for place in leg_cuts:
                    leg_ends = int(np.searchsorted(leg_of_row, leg_of_row[place.row], side="right"))
                    new_leg_of_row[place.row : leg_ends] += 1
        record[:, tractor, REC_LEG] = new_leg_of_row
    return replace(run, plan=_cut_plan(run.plan, places, first_parts), record=record)


def _select_allowed(plan: Plan, cuts: LegCuts) -> dict[tuple[int, int], list[LegCut]]:
    """The cuts on legs that may be cut, with at least MIN_PART_M on either side."""
    uncut_legs = {
        pair
        for number, mission in enumerate(plan.missions)
        for index, leg in enumerate(mission.legs)
        if leg.follow is not None
        for pair in ((number, index), (leg.follow.tractor, leg.follow.leg))
    }
    allowed: dict[tuple[int, int], list[LegCut]] = {}
    for key in sorted(set(cuts) - uncut_legs):
        length, last_m = plan.missions[key[0]].legs[key[1]].length_m, 0.0
        for place in sorted(cuts[key]):
            if last_m + MIN_PART_M <= place.along_m <= length - MIN_PART_M:
                allowed.setdefault(key, []).append(place)
                last_m = place.along_m
    return allowed


def _cut_plan(plan: Plan, cuts: dict[tuple[int, int], list[LegCut]], first_parts: Sequence[Integers]) -> Plan:
    """The plan with these cuts; `first_parts` are the numbers of the first part of each leg, by tractor (legs + 1,)."""
    cuts_m = {key: [place.along_m for place in own] for key, own in cuts.items()}

    def move_gate(previous: LegGate) -> LegGate:
        ends, first_part = cuts_m.get((previous.tractor, previous.leg), []), first_parts[previous.tractor][previous.leg]
        part = int(np.searchsorted(ends, previous.after_m, side="left"))
        return LegGate(previous.tractor, int(first_part) + part, previous.after_m - (ends[part - 1] if part else 0.0))

    def move_links(leg: Leg) -> Leg:
        follow = leg.follow and replace(leg.follow, leg=int(first_parts[leg.follow.tractor][leg.follow.leg]))
        return replace(leg, gates=tuple(move_gate(each) for each in leg.gates), follow=follow)

    missions = []
    for number, mission in enumerate(plan.missions):
        legs = list[Leg]()
        for index, leg in enumerate(map(move_links, mission.legs)):
            legs += [leg.cut(*span) for span in pairwise([0.0, *cuts_m.get((number, index), []), leg.length_m])]
        missions.append(Mission(tuple(legs)))
    return replace(plan, missions=tuple(missions))


@dataclass(frozen=True, eq=False)
class _GroundSegments:
    """Ground that machines cover on short segments of legs, arrays (n,): tractor, leg, first row of the record, metres
    along the leg and times; `leg_s` is the start of the leg."""

    ground: npt.NDArray[np.object_]
    tractor: Integers
    leg: Integers
    row: Integers
    start_m: Floats
    end_m: Floats
    start_s: Floats
    end_s: Floats
    leg_s: Floats


def enforce_planned_order(run: SimulationRun, tractor: Tractor, implement: Implement) -> SimulationRun:
    """The run with gates that keep the order of its tractors at every place that two of them use.

    Legs are cut where a tractor must wait along one. All gates were open when their tractors came, so the run is also
    that of the new plan, except for braking before a gate that opens at the last moment.
    """
    if run.plan.tractors < 2:
        return run
    segments = _build_segments(run, tractor, implement)
    cut_run = cut_legs(run, _find_waiting_cuts(segments))
    cut_segments = segments if cut_run is run else _build_segments(cut_run, tractor, implement)
    plan = cut_run.plan
    for (waiter, leg), gates in _find_order_gates(cut_segments, plan).items():
        for gate in gates:
            plan = plan.copy_with_gate(waiter, leg, gate)
    return replace(cut_run, plan=plan)


def _find_shared_ground(segments: _GroundSegments) -> tuple[Integers, Integers]:
    """Pairs of segments of two tractors that share ground: indices of the earlier and of the later ones."""
    first, second = shapely.STRtree(segments.ground).query(segments.ground)
    is_before = (segments.tractor[first] != segments.tractor[second]) & (
        segments.end_s[first] <= segments.start_s[second]
    )
    first, second = first[is_before], second[is_before]
    share = shapely.intersects(segments.ground[first], segments.ground[second])
    return first[share], second[share]


def _find_waiting_cuts(segments: _GroundSegments) -> dict[tuple[int, int], list[LegCut]]:
    """The fewest cuts at which the later tractor can wait on its leg until the earlier one is through."""
    first, second = _find_shared_ground(segments)
    is_too_late = segments.end_s[first] > segments.leg_s[second]
    first, second = first[is_too_late], second[is_too_late]
    cuts: dict[tuple[int, int], list[LegCut]] = {}
    covered_until_s: dict[tuple[int, int], float] = {}
    for index in np.lexsort((first, segments.start_s[second])).tolist():
        leading, waiting = int(first[index]), int(second[index])
        key = int(segments.tractor[waiting]), int(segments.leg[waiting])
        if segments.end_s[leading] > covered_until_s.get(key, -1.0):
            covered_until_s[key] = float(segments.start_s[waiting])
            cuts.setdefault(key, []).append(LegCut(int(segments.row[waiting]), float(segments.start_m[waiting])))
    return cuts


def _find_order_gates(segments: _GroundSegments, plan: Plan) -> dict[tuple[int, int], list[LegGate]]:
    """The gates to add by (tractor, leg): how far every other tractor must have come."""
    first, second = _find_shared_ground(segments)
    is_open = segments.end_s[first] <= segments.leg_s[second]
    first, second = first[is_open], second[is_open]
    farthest: dict[tuple[int, int, int], tuple[int, float]] = {}
    for leading, waiting in zip(first.tolist(), second.tolist(), strict=True):
        key = int(segments.tractor[waiting]), int(segments.tractor[leading]), int(segments.leg[waiting])
        place = int(segments.leg[leading]), float(segments.end_m[leading])
        farthest[key] = max(place, farthest.get(key, place))
    gates: dict[tuple[int, int], list[LegGate]] = {}
    awaited: dict[tuple[int, int], tuple[int, float]] = {}
    for waiter, leader, leg in sorted(farthest):
        place = farthest[waiter, leader, leg]
        if place <= awaited.get((waiter, leader), (-1, 0.0)):
            continue  # an earlier leg already waits for this
        awaited[waiter, leader] = place
        length = plan.missions[leader].legs[place[0]].length_m
        gate = LegGate.place(leader, place[0], length, place[1])
        gates.setdefault((waiter, leg), []).append(gate)
    return gates


def _build_segments(run: SimulationRun, tractor: Tractor, implement: Implement) -> _GroundSegments:
    bodies = [_build_corners(*box) for box in list_contact_boxes(tractor, implement)]
    rows = np.concatenate([_mark_segments(run, number) for number in range(run.plan.tractors)])
    ground = _build_hulls(run, rows, bodies)
    tractors, leg, row, _, *metric_columns = np.repeat(rows, len(bodies), axis=0).T
    index_columns = (column.astype(np.int64) for column in (tractors, leg, row))
    return _GroundSegments(ground, *index_columns, *metric_columns)


def _mark_segments(run: SimulationRun, tractor: int) -> Floats:
    """Segments (n, 9): tractor, leg, first and last row, start and end on the leg (m), start, end and leg start (s)."""
    finish = float(run.finish_s[tractor])
    row_count = max(2, int(np.searchsorted(run.time_s, finish - 1e-9)))
    leg_of_row, record = run.get_leg_numbers(tractor)[:row_count], run.record[:row_count, tractor]
    step_s = np.diff(run.time_s[:row_count], append=run.time_s[row_count - 1])
    along = np.concatenate(([0.0], np.cumsum(np.abs(record[:, REC_SPEED]) * step_s)))
    angle = np.unwrap(record[:, REC_ANGLE])
    turned = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(angle)))))
    marks = []
    begins = np.flatnonzero(np.diff(leg_of_row, prepend=-1))
    for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), row_count - 1], strict=True):
        leg = run.plan.missions[tractor].legs[int(leg_of_row[begin])]
        scale = leg.length_m / max(along[end] - along[begin], 1e-6)
        first = begin
        while first < end:
            distance_row = int(np.searchsorted(along, along[first] + SEGMENT_M))
            turned_row = int(np.searchsorted(turned, turned[first] + SEGMENT_RAD))
            last = min(max(first + 1, min(distance_row, turned_row)), end)
            start_m, end_m = ((along[row] - along[begin]) * scale for row in (first, last))
            times = run.time_s[first], run.time_s[last], run.time_s[begin]
            marks.append((tractor, leg_of_row[begin], first, last, start_m, end_m, *times))
            first = last
    return np.array(marks, dtype=np.float64)


def _build_corners(back_m: float, front_m: float, half_width_m: float) -> Floats:
    """Corners (4, 2) of a box with BODY_MARGIN_M around it, forward and left of the centre of mass."""
    front_m, back_m, half_width_m = front_m + BODY_MARGIN_M, back_m - BODY_MARGIN_M, half_width_m + BODY_MARGIN_M
    return np.array(
        [[front_m, half_width_m], [front_m, -half_width_m], [back_m, -half_width_m], [back_m, half_width_m]]
    )


def _build_hulls(run: SimulationRun, marks: Floats, bodies: list[Floats]) -> npt.NDArray[np.object_]:
    """Convex hulls of every body on each segment, the bodies of a segment one after another."""
    spans = marks[:, 2:4].astype(np.int64).tolist()
    rows = [np.append(np.arange(first, last, OUTLINE_ROW_STEP), last) for first, last in spans]
    sizes = np.array([len(each) for each in rows])
    owner = np.repeat(np.arange(len(rows)), sizes)
    poses = run.record[np.concatenate(rows), marks[owner, 0].astype(np.int64), REC_POSE]
    cosine, sine = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    hulls = []
    for corners in bodies:
        x = poses[:, 0, None] + cosine * corners[:, 0] - sine * corners[:, 1]
        y = poses[:, 1, None] + sine * corners[:, 0] + cosine * corners[:, 1]
        places = np.column_stack([x.ravel(), y.ravel()])
        hulls.append(shapely.convex_hull(shapely.linestrings(places, indices=np.repeat(owner, len(corners)))))
    return np.column_stack(hulls).ravel()
