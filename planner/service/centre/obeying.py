"""Whether a tractor that was told to stand does: by what it reports, not by what was sent."""

from __future__ import annotations

from planner.service.centre.foresight import braking_s
from planner.service.centre.guard import MOVING_MPS
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import (
    FENCE,
    HALTED,
    MANUAL,
    NEAR,
    OBSTACLE,
    REMOTE,
    STOPPED,
    DrivingOn,
    Report,
    TractorState,
)

AGAIN_S = 1.0  # between two orders to stand
HEARD_S = 0.5  # from the order to a report of one that has heard it, over a quick link
GAP_S = 0.25  # between two reports of a tractor that reports without a break
NOT_BY_HAND = frozenset({HALTED, NEAR, FENCE, OBSTACLE})
"""Holds under which a driver in the seat is to stand too."""


def drives_on(state: TractorState) -> bool:
    """Whether a tractor moves that has to stand, or moves otherwise than it may."""
    report = state.report
    if report is None or not state.standing_ordered or state.doubtful or report.speed_mps < MOVING_MPS:
        return False
    if report.mode == MANUAL:
        return bool(state.holds & NOT_BY_HAND)
    return not (report.mode == REMOTE and state.remote_command[1] != 0.0)


def disobeys(state: TractorState, now: float, rules: Rules) -> bool:
    """Whether it has had the time to stand, and reports since then that it drives; to be asked at every tick.

    It has the time in which the order reaches it and its report comes back, by how old its reports are, and while it
    brakes twice what its brake needs. Only time with reports counts: where the service or the tractor was held up for a
    while, nobody knows what the tractor had heard by then.
    """
    report = state.report
    if report is None or not drives_on(state):
        state.driving_on = None
        return False
    if state.driving_on is None:
        state.driving_on = DrivingOn(report.speed_mps, now)
    seen = state.driving_on
    if state.heard_s > seen.heard_s:
        seen.seen_s += min(state.heard_s - seen.heard_s, GAP_S)
        seen.heard_s = state.heard_s
    allowed_s = HEARD_S + 2.0 * min(state.delay_s, rules.silence_s)
    if _brakes(report, seen, rules):
        allowed_s += 2.0 * braking_s(seen.speed_mps, rules) / rules.times
    return seen.seen_s >= allowed_s


def _brakes(report: Report, seen: DrivingOn, rules: Rules) -> bool:
    """Whether it says that it brakes, or becomes slower at least a quarter as fast as its brake can."""
    lost_mps = 0.25 * rules.deceleration_mps2 * rules.times * seen.seen_s
    slower = seen.seen_s > 0.0 and report.speed_mps <= seen.speed_mps - lost_mps
    return report.mode == STOPPED or report.speed_command_mps == 0.0 or slower
