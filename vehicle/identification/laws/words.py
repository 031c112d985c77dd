"""Sentences and numbers of laws."""

from __future__ import annotations

import math
from datetime import UTC, datetime

import numpy as np

from vehicle.identification.laws.bases import (
    BY_ANGLE,
    BY_IMPLEMENT,
    BY_PLACE,
    BY_RUN,
    BY_SIDE,
    BY_SPEED,
    OVER_DAY,
    OVER_MINUTES,
    WIDEST_ANGLE_DEG,
    RunClock,
)
from vehicle.identification.laws.selection import FoundLaw
from vehicle.identification.laws.settle import SettledLaw
from vehicle.model.effects import get_effect

FIRST_EPOCH_S = 1e9  # a `time_s` above is taken as seconds since 1970, UTC
KIND_WORDS = {
    OVER_MINUTES: "the minutes since the start of a run",
    OVER_DAY: "the time of day",
    BY_PLACE: "the place",
    BY_RUN: "the run",
    BY_IMPLEMENT: "the implement",
    BY_SIDE: "the side",
    BY_ANGLE: "the size of the wheel angle",
    BY_SPEED: "the speed",
}
DECIDING_DRIVES = {
    frozenset({OVER_MINUTES, BY_ANGLE}): "the same angles driven in another order decide",
    frozenset({OVER_MINUTES, BY_SPEED}): "the same speeds driven in another order decide",
    frozenset({OVER_MINUTES, BY_PLACE}): "the same places driven again later decide",
    frozenset({OVER_DAY, BY_PLACE}): "the same places driven again later decide",
    frozenset({OVER_DAY, BY_RUN}): "the first run driven again at the end of the day decides",
    frozenset({BY_ANGLE, BY_SPEED}): "the same angles driven at another speed decide",
    frozenset({BY_PLACE, BY_ANGLE}): "the same bends driven elsewhere in the field decide",
    frozenset({BY_PLACE, BY_RUN}): "runs of both groups driven at the same place decide",
}
LawNumbers = dict[str, float]


def compute_law_values(law: SettledLaw, clock: RunClock) -> LawNumbers:
    """Return the numbers of a law, named as in LOGS.md, in the unit of the effect."""
    found, amounts, at = law.found, law.amounts, law.constant
    match found.kind:
        case "over_minutes":
            return {"start": at, "per_minute": float(amounts[0])}
        case "over_day":
            return _compute_day_values(law, clock)
        case "by_angle":
            return {"at_0": at, "at_27": at + WIDEST_ANGLE_DEG * float(amounts[0])}
        case "by_speed":
            return {"at_0": at, "per_mps": float(amounts[0])}
        case "by_implement":
            return {"lifted": at, "working": at + float(amounts[0])}
        case "by_side":
            return {"right": at, "left": at + float(amounts[0])}
        case "by_run":
            return {"value": at + float(amounts[0]), "other": at}
        case _ if "radius_m" in found.score.basis.detail:
            return {"inside": at + float(amounts[0]), "outside": at, **found.score.basis.detail}
        case _:
            return {"at_origin": at, "per_m_east": float(amounts[0]), "per_m_north": float(amounts[1])}


def _compute_day_values(law: SettledLaw, clock: RunClock) -> LawNumbers:
    """Return the swing over the day; `lowest_s` is the `time_s` of the lowest value."""
    period = law.found.score.basis.detail["period_s"]
    sine, cosine = (float(amount) for amount in law.amounts)
    phase = math.degrees(math.atan2(cosine, sine)) - 360.0 * clock.epoch_s / period
    lowest = clock.epoch_s + (-0.25 - math.atan2(cosine, sine) / (2.0 * math.pi)) % 1.0 * period
    return {
        "mean": law.constant,
        "amplitude": math.hypot(sine, cosine),
        "period_s": period,
        "phase_deg": phase % 360.0,
        "lowest_s": lowest,
    }


def describe_law(law: SettledLaw, values: LawNumbers, names: tuple[str, ...], clock: RunClock) -> str:
    """Return a sentence on how the parameter of a law changes.

    When a swing is lowest is said only of a time that the logs reach.
    """
    effect = get_effect(law.found.effect_id)
    subject, unit = f"The {effect.label}", f" {effect.size.unit}" if effect.size.unit else ""

    def show(value: float) -> str:
        return f"{value:.2f}{unit}"

    match law.found.kind:
        case "over_minutes":
            return f"{subject} is {show(values['start'])} at the start of a run and changes by " + (
                f"{values['per_minute']:+.3f}{unit} per minute."
            )
        case "over_day":
            is_reached = values["lowest_s"] <= clock.epoch_s + float(np.max(clock.starts_s))
            lowest = f"; it is lowest {_describe_time(values['lowest_s'])}" if is_reached else ""
            return f"{subject} swings between {show(law.low)} and {show(law.high)} over the day{lowest}."
        case "by_angle":
            return f"{subject} is {show(values['at_0'])} at 0 degrees and {show(values['at_27'])} at 27 degrees."
        case "by_speed":
            per_mps = values["per_mps"] or math.inf
            ends = sorted(((end - values["at_0"]) / per_mps, end) for end in (law.low, law.high))
            slow, fast = (f"{show(end)} at {speed_mps:.1f} m/s" for speed_mps, end in ends)
            return f"{subject} is {slow} and {fast}."
        case "by_implement":
            return (
                f"{subject} is {show(values['lifted'])} with the implement lifted "
                f"and {show(values['working'])} with it working."
            )
        case "by_side":
            return f"{subject} is {show(values['right'])} to the right and {show(values['left'])} to the left."
        case "by_run":
            groups = law.found.score.basis.groups
            of_value = ", ".join(name for name, group in zip(names, groups, strict=True) if group)
            return f"{subject} is {show(values['value'])} in {of_value} and {show(values['other'])} in the other runs."
        case _ if "radius_m" in values:
            return (
                f"{subject} is {show(values['inside'])} within {values['radius_m']:.0f} m of "
                f"east {values['east_m']:.0f}, north {values['north_m']:.0f} and {show(values['outside'])} elsewhere."
            )
        case _:
            return _describe_gradient(law, values, subject, unit)


def _describe_gradient(law: SettledLaw, values: LawNumbers, subject: str, unit: str) -> str:
    east, north = values["per_m_east"], values["per_m_north"]
    bearing = math.degrees(math.atan2(east, north)) % 360.0
    names = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
    return (
        f"{subject} grows by {math.hypot(east, north):.4f}{unit} per m towards the {names[round(bearing / 45.0) % 8]}, "
        f"from {law.low:.2f} to {law.high:.2f}{unit} over these logs."
    )


def _describe_time(time_s: float) -> str:
    if time_s > FIRST_EPOCH_S:
        return f"at {datetime.fromtimestamp(time_s, UTC):%H:%M} UTC"
    return f"at {time_s:.0f} s of the logs' clock"


def describe_alternatives(found: FoundLaw, other_kinds: tuple[str, ...]) -> str:
    """Return what the logs cannot tell apart, and which drive would; empty without alternatives."""
    if not other_kinds:
        return ""
    other = other_kinds[0]
    decides = DECIDING_DRIVES.get(
        frozenset({found.kind, other}),
        f"a drive in which {KIND_WORDS[found.kind]} changes without {KIND_WORDS[other]} decides",
    )
    return f"These logs cannot tell {KIND_WORDS[found.kind]} from {KIND_WORDS[other]}: {decides}."
