"""Whether a tractor that was told to stand does: by what it reports, not by what was sent."""

from __future__ import annotations

from planner.service.centre.foresight import braking_s
from planner.service.centre.guard import MOVING_MPS
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import FENCE, HALTED, MANUAL, NEAR, OBSTACLE, REMOTE, STOPPED, TractorState

AGAIN_S = 1.0  # between two orders to stand
HEARD_S = 0.5  # from the order to a report of one that has heard it
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
    """Whether it has had the time to stand, and reports since then that it drives; to be asked at every tick."""
    report = state.report
    if report is None or not drives_on(state):
        state.drives_on_since = None
        return False
    if state.drives_on_since is None:
        state.drives_on_since = now, report.speed_mps
    since_s, speed_mps = state.drives_on_since
    brakes = report.mode == STOPPED or report.speed_command_mps == 0.0
    return state.heard_s - since_s >= HEARD_S + (2.0 * braking_s(speed_mps, rules) / rules.times if brakes else 0.0)
