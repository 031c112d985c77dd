"""Delays that are one: positions and headings as late as each other come late from one receiver, and an age that all
columns share is that of no instrument, but of the clock of the log. Delays that make up for each other are none."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vehicle.identification.fit.effect_parameters import build_parameters, collect_settings, find_finest_size
from vehicle.identification.fit.residual_fit import EffectFit, FitPart, add_linear_terms, refine_fit
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import LEAST_GAIN

PARTS, WHOLE, FILTER = ("position_delay", "heading_delay"), "gnss_latency", "heading_filter"
DEAD_TIME, WHEEL_CLOCK, COMMAND_CLOCK = "steering_dead_time", "clock_offset_steering", "clock_offset_steering_command"
_COLUMNS = ("position", "heading", "speed", "steering", "steering_command")
SAME_CLOCK_FACTOR = 3.0  # chosen, times what may be claimed: errors of delays that are fitted together
SMALLEST_AGE_S = 0.01  # chosen: less is no age in logs of any rate
ONE_CLOCK_SHARE = 0.1  # chosen, of the gain of several clocks: clocks alike by chance are rarer than one that is off
# Columns by effect: what is older by its size.
_AGED_COLUMNS = {
    WHOLE: ("position", "heading"),
    "position_delay": ("position",),
    "heading_delay": ("heading",),
    **{f"clock_offset_{column}": (column,) for column in _COLUMNS},
}


def simplify_delays(residual_model: ResidualModel, fit: EffectFit) -> EffectFit:
    """Return the fit with the simplest common explanation of its delays."""
    for simplify in (merge_delays, drop_shared_filter, remove_common_age, choose_reference_clock, share_out_delays):
        fit = simplify(residual_model, fit)
    return fit


def drop_shared_filter(residual_model: ResidualModel, fit: EffectFit) -> EffectFit:
    """Return the fit without the low pass of the heading, where all other columns are as late as it makes the heading.

    A heading stamped early and smoothed by as much is in time; with the common age removed it shows as one that is
    smoothed beside others that are late.
    """
    sizes, ages = _collect_ages(residual_model, fit)
    smoothed_s = float(fit.settings.get(FILTER, {}).get("time_s", 0.0))
    others = [age for column, age in ages.items() if column != "heading"]
    if min(smoothed_s, *others) <= 0.0:
        return fit
    kept = {name: size - min(others) for name, size in sizes.items()}
    parts = tuple(
        (parameters, np.array([kept[parameters.id]]) if parameters.id in kept else coordinates)
        for parameters, coordinates in fit.parts
        if parameters.id != FILTER and abs(kept.get(parameters.id, 1.0)) >= SMALLEST_AGE_S
    )
    fewer = len(fit.parts) - len(parts)
    gain = _refit_parts(residual_model, fit, tuple(p for p in parts if p[0].id not in kept)).loss - fit.loss
    simpler = _refit_parts(residual_model, fit, parts)
    return simpler if simpler.loss < fit.loss + max(fewer * LEAST_GAIN, ONE_CLOCK_SHARE * gain) else fit


def remove_common_age(residual_model: ResidualModel, fit: EffectFit) -> EffectFit:
    """Return the fit without the age that all columns of a log share: only the commanded speeds would show it.

    Those are no clock, as drive lines of any make are late by as much.
    """
    sizes, ages = _collect_ages(residual_model, fit)
    common = min(ages.values())
    tractor = residual_model.rig.tractor
    if common < find_finest_size(tractor, WHOLE):
        return fit
    reduced = {name: np.array([size - common]) for name, size in sizes.items()}
    parts = tuple(
        (parameters, reduced.get(parameters.id, coordinates))
        for parameters, coordinates in fit.parts
        if parameters.id not in reduced or abs(reduced[parameters.id][0]) >= find_finest_size(tractor, parameters.id)
    )
    return _refit_parts(residual_model, fit, parts)


def _collect_ages(residual_model: ResidualModel, fit: EffectFit) -> tuple[dict[str, float], dict[str, float]]:
    """Return the sizes of the delays in a fit by effect, and the age (s) of every column of the logs by them."""
    sizes = {
        parameters.id: float(coordinates[0]) for parameters, coordinates in fit.parts if parameters.id in _AGED_COLUMNS
    }
    ages = dict.fromkeys(_list_logged_columns(residual_model), 0.0)
    for name, size in sizes.items():
        for column in ages.keys() & set(_AGED_COLUMNS[name]):
            ages[column] += size
    return sizes, ages


def _list_logged_columns(residual_model: ResidualModel) -> list[str]:
    """Return the columns that any segment has: one that nobody logged is not in time either."""
    segments = residual_model.dataset.segments
    is_logged = {
        "heading": any(segment.heading_measured for segment in segments),
        "speed": any(segment.speed_measured for segment in segments),
        "steering": any(segment.wheel is not None for segment in segments),
        "steering_command": any(segment.command is not None for segment in segments),
    }
    return [column for column in _COLUMNS if is_logged.get(column, True)]


def choose_reference_clock(residual_model: ResidualModel, fit: EffectFit) -> EffectFit:
    """Return the fit in which the clock that most columns share is the right one, where fewer delays explain as much.

    Only differences between clocks show: four columns that are late by as much are one that is early. What is left of
    their differences, each too small to mean anything, is kept where the fit is worse without it.
    """
    sizes, ages = _collect_ages(residual_model, fit)
    if len(sizes) < 2:
        return fit
    tractor, common = residual_model.rig.tractor, float(np.median(list(ages.values())))
    finest = {column: find_finest_size(tractor, f"clock_offset_{column}") for column in ages}
    apart = {column: age - common for column, age in ages.items()}
    clear = {column: age for column, age in apart.items() if abs(age) >= SAME_CLOCK_FACTOR * finest[column]}
    fewer = len(sizes) - len(clear)
    if abs(common) < min(finest.values()) or fewer < 1:
        return fit
    others = tuple(part for part in fit.parts if part[0].id not in sizes)
    gain = _refit_parts(residual_model, fit, others).loss - fit.loss
    for kept in (clear, {column: age for column, age in apart.items() if abs(age) >= SMALLEST_AGE_S}):
        clocks = [
            (build_parameters(tractor, f"clock_offset_{column}"), np.array([age])) for column, age in kept.items()
        ]
        simpler = _refit_parts(residual_model, fit, (*others, *clocks))
        if simpler.loss < fit.loss + max(fewer * LEAST_GAIN, ONE_CLOCK_SHARE * gain):
            return simpler
    return fit


def _refit_parts(residual_model: ResidualModel, fit: EffectFit, parts: tuple[FitPart, ...]) -> EffectFit:
    residuals = residual_model.compute_residuals(collect_settings(list(parts)))
    return refine_fit(
        residual_model,
        EffectFit(
            parts, add_linear_terms(residuals, fit.linear_terms), np.zeros((len(residuals), 0)), fit.linear_terms
        ),
    )


def share_out_delays(residual_model: ResidualModel, fit: EffectFit) -> EffectFit:
    """Return the fit with the fewest delays that explain as much: those that make up for each other are one.

    Wheel angles stamped early beside a dead time that is longer by as much are measured and commanded in time, and
    the receiver is late; the dead time and the clock of the commands are seen together alone.
    """
    sizes = {parameters.id: float(coordinates[0]) for parameters, coordinates in fit.parts}
    wheel, command = sizes.get(WHEEL_CLOCK, 0.0), sizes.get(COMMAND_CLOCK, 0.0)
    if (wheel == 0.0 and command == 0.0) or DEAD_TIME not in sizes:
        return fit
    late_s = sizes[DEAD_TIME] - command
    by_commands = {DEAD_TIME: max(late_s, 0.0), COMMAND_CLOCK: max(-late_s, 0.0)}
    by_wheels = {DEAD_TIME: late_s + wheel, COMMAND_CLOCK: 0.0, WHEEL_CLOCK: 0.0, WHOLE: sizes.get(WHOLE, 0.0) - wheel}
    simpler = _share_out(residual_model, fit, by_wheels)
    if simpler is None and command:
        simpler = _share_out(residual_model, fit, by_commands) or _share_out(
            residual_model, fit, by_commands, SMALLEST_AGE_S, _measure_shared_gain(residual_model, fit)
        )
    return fit if simpler is None else simpler


def _measure_shared_gain(residual_model: ResidualModel, fit: EffectFit) -> float:
    """Return the loss that a dead time and the clock of the commands remove together: only their difference shows."""
    others = tuple(part for part in fit.parts if part[0].id not in (DEAD_TIME, COMMAND_CLOCK))
    return _refit_parts(residual_model, fit, others).loss - fit.loss


def _share_out(
    residual_model: ResidualModel,
    fit: EffectFit,
    shared: Mapping[str, float],
    least_s: float | None = None,
    gain: float = 0.0,
) -> EffectFit | None:
    """Return the fit with these sizes (s) of delays where they are fewer, possible, and explain as much; else None.

    Those below `least_s`, or below what may be claimed, are left out: commands are known to half a row, and a fit may
    need the rest of it. A share of a `gain` may be lost.
    """
    tractor = residual_model.rig.tractor
    replaced = [
        (build_parameters(tractor, name), np.array([size]))
        for name, size in shared.items()
        if size >= (find_finest_size(tractor, name) if least_s is None else least_s)
    ]
    parts = (*(part for part in fit.parts if part[0].id not in shared), *replaced)
    fewer = len(fit.parts) - len(parts)
    if fewer < 1 or min(shared.values()) < -find_finest_size(tractor, WHOLE):
        return None
    simpler = _refit_parts(residual_model, fit, parts)
    return simpler if simpler.loss < fit.loss + max(fewer * LEAST_GAIN, ONE_CLOCK_SHARE * gain) else None


def merge_delays(residual_model: ResidualModel, fit: EffectFit) -> EffectFit:
    """Return the fit with one late receiver in place of late positions and late headings, where they are as late.

    So they are where they differ by less than may be claimed, or where one delay explains as much.
    """
    delays = {parameters.id: float(coordinates[0]) for parameters, coordinates in fit.parts if parameters.id in PARTS}
    if len(delays) < len(PARTS) or WHOLE in fit.settings:
        return fit
    tractor = residual_model.rig.tractor
    whole = build_parameters(tractor, WHOLE), np.array([sum(delays.values()) / len(PARTS)])
    parts = (*(part for part in fit.parts if part[0].id not in PARTS), whole)
    merged = _refit_parts(residual_model, fit, parts)
    apart_s = abs(delays[PARTS[0]] - delays[PARTS[1]])
    is_one = apart_s < find_finest_size(tractor, WHOLE) or merged.loss < fit.loss + LEAST_GAIN
    return merged if is_one else fit
