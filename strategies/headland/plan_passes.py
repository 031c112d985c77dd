"""Headland passes added to a plan, before its swaths or after them, whatever strategy wrote it.

All tractors drive their shares of the passes at once. Nobody works a swath before all others have finished their
passes, or a pass before all others are on their last swath.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strategies.headland.pass_legs import HeadlandLegs, get_headland_legs
from strategies.headland.pass_shares import HeadlandSegment, share_headland
from strategies.headland.raised_paths import find_raised_path
from strategies.path_planning.errors import NoPathFromError
from strategies.path_planning.paths import Pose
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.program.field_job import FieldJob
from strategies.program.legs import add_wait_points, build_path_legs, make_mission
from vehicle.missions.plan import GATE_MARGIN_M, ROUTE, SWATH, TURN, Leg, LegGate, Mission, Plan

ORIGIN_COUNT = 12  # places tried for the first border of the sectors
UNWORKED_TOLERANCE_M = 20.0  # borders that leave out more of the passes than this are not used for a shorter path
WAIT_POINT_STEP_M = 10.0  # between places to wait on the path between passes and swaths


@dataclass(frozen=True)
class _JoinedLegs:
    """All legs of a tractor: its headland passes and its swaths.

    Others may start on the second of these when it is at leg `border_leg`; it does so itself from leg `begin_leg` on.
    `legs_before` legs were put before those of the strategy.
    """

    legs: tuple[Leg, ...]
    border_leg: int
    begin_leg: int
    legs_before: int


@dataclass(frozen=True)
class HeadlandTransition:
    """How a fleet changes from the first of headland and swaths to the second.

    With `keeps_to_headland` nobody drives across swaths. With `single_tractor` one tractor drives all passes, only
    after the swaths, and the others wait for it before the last part of theirs.
    """

    keeps_to_headland: bool = False
    single_tractor: bool = False


HEADLAND_TRANSITIONS = (
    HeadlandTransition(),
    HeadlandTransition(keeps_to_headland=True),
    HeadlandTransition(True, single_tractor=True),
)
"""The quickest first, then those that keep tractors apart better."""


def add_headland_passes(
    job: FieldJob, plan: Plan, order: str, transition: HeadlandTransition = HEADLAND_TRANSITIONS[0]
) -> Plan:
    """The plan with the headland passes of the job driven "first", from the outside in, or "last", from the inside out.

    Raises StrategyError if no path leads from the passes to the swaths or back.
    """
    if not job.headland_passes:
        return plan
    first = order == HEADLAND_FIRST
    ends = [mission.start if first else mission.end for mission in plan.missions]
    share_legs = [get_headland_legs(job, share) for share in _get_shares(job, ends, first, transition)]
    meeting_points = [
        None if headland_legs is None else (headland_legs.end if first else headland_legs.start)[:2]
        for headland_legs in share_legs
    ]
    own_shares = [share_legs[share] for share in _assign_shares(meeting_points, ends)]
    parts = zip(plan.missions, own_shares, ends, strict=True)
    joined_legs = [_join_headland(job, *part, first=first, transition=transition) for part in parts]
    leg_offsets = [joined.legs_before for joined in joined_legs]
    legs = [renumber_gates(joined.legs, leg_offsets) for joined in joined_legs]
    for tractor, joined in enumerate(joined_legs):
        if joined.begin_leg < len(joined.legs):
            leg = legs[tractor][joined.begin_leg].copy_with(may_wait=True)
            legs[tractor][joined.begin_leg] = leg.copy_with_gates(
                _build_gates(joined_legs, own_shares, tractor, first, transition)
            )
    unworked_m = math.fsum(headland_legs.unworked_m for headland_legs in share_legs if headland_legs)
    notes = {
        **plan.notes,
        "headland": order,
        "headland_passes": max(headland_pass.number for headland_pass in job.headland_passes),
        "unworked_m": round(unworked_m, 1),
    }
    return Plan(tuple(make_mission(tractor_legs) for tractor_legs in legs), notes)


def _build_gates(
    joined_legs: list[_JoinedLegs],
    own_shares: list[HeadlandLegs | None],
    tractor: int,
    first: bool,
    transition: HeadlandTransition,
) -> list[LegGate]:
    """The gates of a tractor before it changes from the first to the second."""
    if transition.single_tractor and own_shares[tractor] is None:
        worker = next(index for index, headland_legs in enumerate(own_shares) if headland_legs is not None)
        last = len(joined_legs[worker].legs) - 1
        return [LegGate(worker, last, max(0.0, joined_legs[worker].legs[last].length_m - GATE_MARGIN_M))]
    return _build_all_finished_gates(joined_legs, tractor)


def _get_shares(
    job: FieldJob, ends: list[Pose], first: bool, transition: HeadlandTransition
) -> list[list[HeadlandSegment]]:
    """The passes shared out so that the longest path between a tractor's share and its swaths is short; cached."""
    pass_key = tuple(
        (headland_pass.number, headland_pass.ring, len(headland_pass.sides)) for headland_pass in job.headland_passes
    )
    key = pass_key, job.tractors, first, transition.single_tractor, tuple(ends)
    if key not in job.share_cache:
        job.share_cache[key] = _find_nearest_shares(job, ends, first, transition)
    return job.share_cache[key]  # type: ignore[no-any-return]


def _find_nearest_shares(
    job: FieldJob, ends: list[Pose], first: bool, transition: HeadlandTransition
) -> list[list[HeadlandSegment]]:
    if job.tractors == 1 or transition.single_tractor:
        begin = job.layout.field.entrance if first else ends[0][:2]
        whole_share = share_headland(replace(job, tractors=1), outside_in=first, begin=begin)
        return whole_share + [[] for _ in range(job.tractors - 1)]
    options = [_get_shares_from_origin(job, first, place / ORIGIN_COUNT) for place in range(ORIGIN_COUNT)]
    driven_m = [sum(segment.length_m for share in shares for segment in share) for shares in options]
    options = [
        shares
        for shares, length_m in zip(options, driven_m, strict=True)
        if length_m > max(driven_m) - UNWORKED_TOLERANCE_M
    ]

    def measure_farthest_m(shares: list[list[HeadlandSegment]]) -> float:
        meeting_points = [(share[-1].end if first else share[0].start) if share else None for share in shares]
        entrance_distances_m = [_measure_entrance_distance_m(job, share, first) for share in shares]
        pairs = zip(_assign_shares(meeting_points, ends), ends, strict=True)
        distances_m = (
            math.dist(place, end[:2]) + entrance_distances_m[n]
            for n, end in pairs
            if (place := meeting_points[n]) is not None
        )
        return round(max(distances_m), 2)

    return min(options, key=measure_farthest_m)


def _measure_entrance_distance_m(job: FieldJob, share: list[HeadlandSegment], first: bool) -> float:
    """Distance between the entrance and a share of the passes (m); 0 without an entrance."""
    if job.entrance_lane is None or not share:
        return 0.0
    return math.dist(job.entrance_lane.edge_pose[:2], share[0].start if first else share[-1].end)


def _get_shares_from_origin(job: FieldJob, outside_in: bool, origin: float) -> list[list[HeadlandSegment]]:
    """The passes shared out with borders counted from a place; cached."""
    key = job.tractors, outside_in, origin
    if key not in job.share_cache:
        begin = job.layout.field.entrance
        job.share_cache[key] = share_headland(job, outside_in=outside_in, begin=begin, origin=origin)
    return job.share_cache[key]  # type: ignore[no-any-return]


def _assign_shares(places: Sequence[tuple[float, ...] | None], ends: list[Pose]) -> list[int]:
    """Which share each tractor drives: the nearest pairs first, to the millimetre."""
    share_points = np.array([(math.inf, math.inf) if place is None else place for place in places])
    east, north = (np.array([end[:2] for end in ends])[:, None] - share_points).transpose(2, 0, 1)
    own_shares: dict[int, int] = {}
    is_free = [True] * len(places)
    for pair in np.argsort(np.rint(1000.0 * np.hypot(east, north)), axis=None, kind="stable").tolist():
        tractor, share = divmod(pair, len(places))
        if tractor not in own_shares and is_free[share]:
            own_shares[tractor], is_free[share] = share, False
    return [own_shares[tractor] for tractor in range(len(ends))]


def _join_headland(
    job: FieldJob,
    mission: Mission,
    headland_legs: HeadlandLegs | None,
    end: Pose,
    *,
    first: bool,
    transition: HeadlandTransition,
) -> _JoinedLegs:
    """The legs of a tractor with its share of the passes.

    Before the swaths it waits inside its own, clear of the headland, if there is room to get there; after them it waits
    before the last part of its last one.
    """
    if headland_legs is None:
        hold_leg = _find_last_hold_leg(mission.legs) if transition.single_tractor else len(mission.legs)
        return (
            _JoinedLegs(mission.legs, 0, 0, 0)
            if first
            else _JoinedLegs(mission.legs, _find_last_swath_leg(mission.legs), hold_leg, 0)
        )
    a, b = (headland_legs.end, end) if first else (end, headland_legs.start)
    path = find_raised_path(job, a, b, allow_rim=True, keep_to_headland=transition.keeps_to_headland)
    if path is None:
        origin_name, goal_name = ("headland", "tracks") if first else ("tracks", "headland")
        raise NoPathFromError(
            f"No path with a turning radius of {job.driving_rules.radius_m:.1f} m leads from the {origin_name} to the "
            f"{goal_name} (at {a[0]:.0f}, {a[1]:.0f} m) inside the field.",
            a[:2],
        )
    task = (mission if first else headland_legs).legs[0].task
    path_legs = add_wait_points(
        build_path_legs(job, path, replace(task, kind=ROUTE if path.kind == "route" else TURN)), WAIT_POINT_STEP_M
    )
    if not first:
        legs = (*mission.legs, *path_legs, *headland_legs.legs)
        return _JoinedLegs(legs, _find_last_swath_leg(mission.legs), _find_last_hold_leg(mission.legs), 0)
    legs_before = len(headland_legs.legs) + len(path_legs)
    swath_legs = (mission.legs[0].copy_with(gates=()), *mission.legs[1:])  # whoever arrives first may go first
    begin_leg = next((n for n, leg in enumerate(swath_legs) if leg.task.kind == SWATH), 0)
    return _JoinedLegs(
        (*headland_legs.legs, *path_legs, *swath_legs), len(headland_legs.legs), legs_before + begin_leg, legs_before
    )


def _find_last_swath_leg(legs: Sequence[Leg]) -> int:
    """The first leg that works the last swath."""
    return 1 + max((number for number, leg in enumerate(legs) if leg.task.kind != SWATH), default=-1)


def _find_last_hold_leg(legs: Sequence[Leg]) -> int:
    """The last leg before which a tractor may wait; the number of legs if there is none."""
    return next((leg for leg in range(len(legs) - 1, 0, -1) if legs[leg].may_wait), len(legs))


def renumber_gates(legs: Sequence[Leg], leg_offsets: list[int]) -> list[Leg]:
    """Legs whose gates and follow orders are renumbered for the legs put before those they name."""
    return [
        leg.copy_with(
            gates=tuple(
                LegGate(gate.tractor, gate.leg + leg_offsets[gate.tractor], gate.after_m) for gate in leg.gates
            ),
            follow=leg.follow and replace(leg.follow, leg=leg.follow.leg + leg_offsets[leg.follow.tractor]),
        )
        if leg.gates or leg.follow
        else leg
        for leg in legs
    ]


def _build_all_finished_gates(joined_legs: list[_JoinedLegs], tractor: int) -> list[LegGate]:
    """Gates that open when all others have finished what comes first, or are on their last swath."""
    return [
        LegGate(
            other_tractor, joined.border_leg - 1, max(0.0, joined.legs[joined.border_leg - 1].length_m - GATE_MARGIN_M)
        )
        for other_tractor, joined in enumerate(joined_legs)
        if other_tractor != tractor and joined.border_leg > 0
    ]
