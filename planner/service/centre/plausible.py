"""Whether a tractor can be where it says on its legs, as others are released by that."""

from __future__ import annotations

from planner.service.centre.course import Course
from planner.service.centre.tractors import Report, TractorState

TOLERANCE_M = 2.0  # of a place on a leg


def fault_of(report: Report, state: TractorState, course: Course) -> str | None:
    """Why a reported place cannot be, as the end of a sentence; None for one that can."""
    at_m = course.before_m[report.leg] + report.leg_m
    if report.leg_m > course.lengths_m[report.leg] + TOLERANCE_M:
        return f"{report.leg_m:.1f} m along leg {report.leg}, which is {course.lengths_m[report.leg]:.1f} m long"
    if at_m > course.before_m[min(state.released, len(course.legs))] + TOLERANCE_M:
        return f"on leg {report.leg}, and {state.released} legs are released"
    known = min(state.leg, len(course.legs))
    if report.leg < known and at_m < course.before_m[known] + state.leg_m - TOLERANCE_M:
        return f"on leg {report.leg}, and was on leg {state.leg} already"
    return None
