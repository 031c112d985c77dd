"""The tractor with what a diagnosis adds: terms with their values, intervals and the logs they came from."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from vehicle.kinds import Interval
from vehicle.measured.mend.extension import Extension
from vehicle.measured.mend.levels import driven_seconds, main_terms
from vehicle.measured.replay.course import Course
from vehicle.rest import BY_NAME
from vehicle.tractor import EffectSetting, Rest, Tractor

DIGITS = 6  # significant ones of a value in a file: far below what any interval tells


@dataclass(frozen=True)
class Alike:
    """What a tractor file says of an effect that the logs cannot tell from others: its interval and the others."""

    interval: Mapping[str, Interval] | None
    equivalent_to: tuple[str, ...]


def extended_tractor(
    course: Course, tractor: Tractor, ground: str, extension: Extension, named: Collection[str],
    alike: Mapping[str, Alike], kept: Collection[str],
) -> Tractor:  # fmt: skip
    """The tractor with the terms of an extension, their intervals and the logs they came from.

    `named` are the effects that carry a name, `alike` those that the logs cannot tell from others: their intervals
    reach to neutral. Effects that the file had and these logs say nothing of (`kept`) stay as they are.
    """
    effects = {name: setting for name, setting in tractor.effects.items() if name in kept}
    amounts: dict[str, float] = {}
    spread: dict[str, Interval] = {}
    for term in main_terms(extension.terms, driven_seconds(course)):
        name, value, interval = term.knobs.id, term.value, dict(extension.intervals[term.knobs.id])
        if name in BY_NAME:
            amounts, spread = amounts | value, spread | interval
            continue
        if not all(math.isfinite(one) for one in value.values()):
            continue  # a limit that is never reached: one of two grounds, on which nothing slides
        same: tuple[str, ...] = ()
        if name in alike:
            interval, same = dict(alike[name].interval or interval), alike[name].equivalent_to
        runs = range(len(course.names)) if term.runs is None else sorted(term.runs)
        effects[name] = EffectSetting(
            value={key: _short(one) for key, one in value.items()},
            interval={key: (_short(low), _short(high)) for key, (low, high) in interval.items()},
            named=name in named, equivalent_to=same, ground=ground,
            logs=tuple(course.names[run] for run in runs),
        )  # fmt: skip
    rest = _rest(course, amounts, spread) if amounts else None
    return tractor.model_copy(update={"effects": effects, "rest": rest})


def _short(value: float) -> float:
    """A value with as many digits as a file needs."""
    return float(f"{value:.{DIGITS}g}")


def _rest(course: Course, amounts: dict[str, float], spread: dict[str, Interval]) -> Rest:
    """The rest, to be trusted where nearly all of the driving was."""
    speeds = np.concatenate([one.pace for one in course.stretches])
    angles = [one.wheel if one.wheel is not None else one.command for one in course.stretches]
    degrees = np.degrees(np.concatenate([one for one in angles if one is not None]))
    fast, low, high = float(np.quantile(speeds, 0.995)), *(float(np.quantile(degrees, q)) for q in (0.005, 0.995))
    slow = min(float(np.quantile(speeds, 0.005)), 0.9 * fast)
    if high - low < 1.0:
        low, high = low - 0.5, high + 0.5
    return Rest(
        amounts={name: _short(amount) for name, amount in amounts.items()},
        speed_mps=(_short(max(slow, 0.0)), _short(max(fast, 0.01))), angle_deg=(_short(low), _short(high)),
        interval={name: (_short(one), _short(two)) for name, (one, two) in spread.items()}, logs=course.names,
    )  # fmt: skip
