"""Checks of reports: whether a tractor obeys an order to stop, and whether its reported place is possible."""

from __future__ import annotations

import math

from planner.fleet.model.rules import FleetRules
from planner.fleet.model.tractor_state import (
    MANUAL,
    MOVING_MPS,
    POSITIONS,
    PROGRESS,
    REMOTE,
    SPEED,
    STOPPED,
    DisobeyingMotion,
    Hold,
    MotionDoubt,
    TractorReport,
    TractorState,
)
from planner.fleet.safety.credible_motion import FARTHEST_M
from planner.fleet.safety.motion_prediction import compute_stopping_time_s

REPEAT_STOP_S = 1.0  # between two orders to stand
ORDER_DELAY_S = 0.5  # from the order to a report of one that has heard it, over a quick link
REPORT_GAP_S = 0.25  # between two reports of a tractor that reports without a break
NOT_BY_HAND = frozenset({Hold.HALTED, Hold.TOO_NEAR, Hold.FENCE, Hold.OBSTACLE})
"""Holds under which a driver in the seat must stop too."""
PLACE_TOLERANCE_M = 2.0  # of a place on a leg


def note_standing(state: TractorState, now: float, rules: FleetRules) -> None:
    """Note where a tractor stands that was ordered to, by its own words: it may not be far from there later.

    That counts from what it reports once the order has had time to arrive. That it tells a speed now and then changes
    nothing, unless somebody may drive it.
    """
    report = state.report
    if report is None or not state.standing_ordered:
        state.stood_at = state.ordered_since_s = None
        return
    state.ordered_since_s = now if state.ordered_since_s is None else state.ordered_since_s
    if report.speed_mps < MOVING_MPS:
        has_heard = state.last_contact_s > state.ordered_since_s + _allow_order_s(state, rules)
        state.stood_at = state.stood_at or ((report.x_m, report.y_m) if has_heard else None)
    elif _may_be_driven(state, report):
        state.stood_at = None


def _allow_order_s(state: TractorState, rules: FleetRules) -> float:
    """Seconds for an order to arrive and a report to return, by the age of its reports."""
    return ORDER_DELAY_S + 2.0 * min(state.delay_s, rules.silence_s)


def is_driving_on(state: TractorState) -> bool:
    """Whether a tractor moves although it has to stand: by its speed, by its positions against its speed, or by how far
    it is from where it stood, however slowly it went there."""
    report = state.report
    if report is None or not state.standing_ordered:
        return False
    has_crept = state.stood_at is not None and math.dist(state.stood_at, (report.x_m, report.y_m)) > FARTHEST_M
    if report.speed_mps < MOVING_MPS and not state.is_moving_unreported and not has_crept:
        return False
    return not _may_be_driven(state, report)


def _may_be_driven(state: TractorState, report: TractorReport) -> bool:
    """Whether a driver in the seat or by remote control may drive a tractor that has to stand by itself."""
    if report.mode == MANUAL:
        return not state.holds & NOT_BY_HAND
    return report.mode == REMOTE and state.remote_command[1] != 0.0


def is_disobeying(state: TractorState, now: float, rules: FleetRules) -> bool:
    """Whether a tractor still drives after it had time to stop; to be called at every tick.

    It has the time for the order to arrive and a report to return, judged by the age of its reports, and while it
    brakes twice what its brake needs; one whose positions belie its speed is not believed to brake. Only time with
    reports counts: after a pause of the service or the tractor it is unknown what the tractor had received.
    """
    report = state.report
    note_standing(state, now, rules)
    if report is None or not is_driving_on(state):
        state.disobeying_motion = None
        return False
    if state.disobeying_motion is None:
        state.disobeying_motion = DisobeyingMotion(report.speed_mps, now)
    motion = state.disobeying_motion
    if state.last_contact_s > motion.last_report_s:
        motion.observed_s += min(state.last_contact_s - motion.last_report_s, REPORT_GAP_S)
        motion.last_report_s = state.last_contact_s
    allowed_s = _allow_order_s(state, rules)
    if motion.observed_s <= allowed_s:  # the order may still be under way: it brakes from the speed at which it hears
        motion.speed_mps = max(motion.speed_mps, report.speed_mps)
    lost_mps = 0.25 * rules.deceleration_mps2 * rules.times * motion.observed_s  # a quarter of what its brake can
    is_slower = motion.observed_s > 0.0 and report.speed_mps <= motion.speed_mps - lost_mps
    is_braking = report.mode == STOPPED or report.speed_command_mps == 0.0 or is_slower
    if is_braking and not state.is_moving_unreported:
        allowed_s += 2.0 * compute_stopping_time_s(motion.speed_mps, rules) / rules.times
    is_noticed = motion.observed_s >= allowed_s
    if is_noticed and report.speed_mps >= MOVING_MPS:
        state.stood_at = None  # once it stands again, it is judged from there
    return is_noticed


def find_impossible_place_reason(report: TractorReport, state: TractorState) -> str | None:
    """Why a reported place is impossible, as the end of a sentence; None if it is possible."""
    length_m = state.mission.lengths_m[report.leg]
    place_m = state.mission.leg_starts_m[report.leg] + report.leg_m
    if report.leg_m > length_m + PLACE_TOLERANCE_M:
        return f"{report.leg_m:.1f} m along leg {report.leg}, which is {length_m:.1f} m long"
    if place_m > state.base_end_m + PLACE_TOLERANCE_M:
        return f"on leg {report.leg}, beyond the {state.base_end} legs that it may drive"
    if report.leg < min(state.leg, len(state.mission.legs)) and place_m < state.position_m - PLACE_TOLERANCE_M:
        return f"on leg {report.leg}, but it was already on leg {state.leg}"
    return None


def build_area_doubt(report: TractorReport, speed_mps: float) -> MotionDoubt:
    """The doubt of a tractor that is at the place of its report, and may go anywhere from there."""
    return MotionDoubt(POSITIONS, 0.0, {}, (report.x_m, report.y_m, report.heading_rad), speed_mps)


def describe_doubt(number: int, doubt: MotionDoubt) -> str:
    """The sentence of the alarm of a tractor in doubt."""
    moved_m = doubt.moved_m
    if not moved_m:
        return (
            f"Tractor {number + 1} moves though it must stand. It is held, and others keep away from where it may be: "
            "look where it is, then resume it, or acknowledge this if it is not to drive."
        )
    if PROGRESS in moved_m:
        return (
            f"Tractor {number + 1} contradicts itself: in {doubt.over_s:.1f} s it moved {moved_m[POSITIONS]:.1f} m by "
            f"its positions, {moved_m[SPEED]:.1f} m by its speed and {moved_m[PROGRESS]:.1f} m by its progress. It is "
            "held, and others keep away from where it may be: look where it is, then resume it, or acknowledge this if "
            "it is not to drive."
        )
    return (
        f"Tractor {number + 1} contradicts itself: in {doubt.over_s:.1f} s it moved {moved_m[POSITIONS]:.1f} m by its "
        f"positions and {moved_m[SPEED]:.1f} m by its speed. It is held, and others keep away from where it may be: "
        "look where it is, then resume it, or acknowledge this if it is not to drive."
    )
