"""Farm values learned from a farm's own logs, each with its interval and its runs, and put into the text of its farm
file, of which every other byte is kept."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from fields.text_files import count_noun, quote_path, read_text
from fields.units import MPS_PER_KMH
from planner.errors import RequestError
from planner.evaluation.preparation import MAX_REVERSE_SPEED_MPS
from planner.farm.inventory import FarmFile, load_farm, parse_farm
from planner.farm.machines import FarmImplement
from planner.farm.value_sources import format_value
from planner.request.plan_request import MAX_SPEED_KMH, MIN_SPEED_KMH
from planner.task_logs.observations import (
    MIN_EVENTS,
    IntervalEstimate,
    RunObservations,
    estimate_cv,
    estimate_statistic,
)
from planner.task_logs.runs.run_files import load_imported_runs
from planner.task_logs.runs.run_records import ProjectedRun
from reports.task_logs.run_results import LearnedOutcome
from strategies.path_planning.turns import list_allowed_kinds
from strategies.rules.driving_rules import DrivingRules
from strategies.rules.turn_timing import TurnTimer
from vehicle.model.tractor import RADIUS_FACTOR, Implement, Tractor

_HEADER = re.compile(r"^\s*\[")
SLOWEST_MPS, FASTEST_MPS = 0.3, 5.5
HALVINGS = 8  # of the speed range: accurate to 0.02 m/s
HEADLAND_DEPTH_M = 1e3
SOIL_GROUND = "soil"
WIDTH_TOLERANCE = 0.1
"""Largest relative difference between the width of logs and of their implement."""
MAX_RUN_NAMES = 40
HABIT_SHARE = 2.0 / 3.0
"""Share of runs with the same order of the headland from which it is learned."""
LEARNED_SECTION = "learned"
TABLES_HINT = "write each section as a table with one key per line"


def set_value(text: str, section: str, number: int | None, key: str, value: str, comment: str) -> str:
    """The text with `key = value  # comment` in a section: [section], or the [[section]] with a number from 0.

    An existing line with the key is replaced; otherwise the line is added at the end of its section, and a missing
    [section] at the end of the file. Raises RequestError if the section is an inline table.
    """
    lines = text.splitlines(keepends=True)
    end = "\r\n" if "\r\n" in text else "\n"
    start, stop = _find_section_lines(lines, section, number)
    line = f"{key} = {value}  # {comment}{end}"
    if start is None:
        if section in tomllib.loads(text):
            raise RequestError(
                f"The farm file has {section} in one line; write it as a table under [{section}], one key per line."
            )
        newline_before = "" if not lines or lines[-1].endswith(("\n", "\r")) else end
        return f"{text}{newline_before}{end}[{section}]{end}{line}"
    key_pattern = re.compile(rf"^\s*[\"']?{re.escape(key)}[\"']?\s*=")
    for place in range(start + 1, stop):
        if key_pattern.match(lines[place]):
            lines[place] = line
            return "".join(lines)
    place = stop
    while place > start + 1 and not lines[place - 1].split("#")[0].strip():
        place -= 1
    if not lines[place - 1].endswith(("\n", "\r")):
        lines[place - 1] += end
    return "".join([*lines[:place], line, *lines[place:]])


def _find_section_lines(lines: list[str], section: str, number: int | None) -> tuple[int | None, int]:
    """The line of a section's heading (None if missing) and the line of the next heading."""
    name = rf"\s*[\"']?{re.escape(section)}[\"']?\s*"
    heading = re.compile(rf"^\s*\[{name}\]" if number is None else rf"^\s*\[\[{name}\]\]")
    places = [place for place, line in enumerate(lines) if heading.match(line)]
    index = 0 if number is None else number
    if index >= len(places):
        return None, len(lines)
    start = places[index]
    next_headings = (place for place in range(start + 1, len(lines)) if _HEADER.match(lines[place]))
    return start, next(next_headings, len(lines))


def remove_blocks(text: str, section: str, keys: set[str]) -> str:
    """The text without the [[section]] blocks, written by `append_block`, whose `key` is one of `keys`."""
    lines = text.splitlines(keepends=True)
    output_lines: list[str] = []
    position = 0
    heading = re.compile(rf"^\[\[{re.escape(section)}\]\]\s*$")
    while position < len(lines):
        if heading.match(lines[position]):
            stop = next((n for n in range(position + 1, len(lines)) if _HEADER.match(lines[n])), len(lines))
            block = tomllib.loads("".join(lines[position:stop]))[section][0]
            if block.get("key") in keys:
                while output_lines and not output_lines[-1].strip() and stop == len(lines):
                    output_lines.pop()
                position = stop
                continue
        output_lines.append(lines[position])
        position += 1
    return "".join(output_lines)


def append_block(text: str, section: str, entries: Mapping[str, Any]) -> str:
    """The text with a [[section]] of these entries at its end."""
    end = "\r\n" if "\r\n" in text else "\n"
    newline_before = "" if not text or text.endswith(("\n", "\r")) else end
    body = "".join(f"{key} = {tomlkit.item(value).as_string()}{end}" for key, value in entries.items())
    return f"{text}{newline_before}{end}[[{section}]]{end}{body}"


class TurnSpeedFit:
    """The turn speed at which a simulated turn over `swaths_over` swaths takes as long as measured."""

    def __init__(self, tractor: Tractor, implement: Implement, work_mps: float, swaths_over: int) -> None:
        """Store the machines and the working speed; nothing is simulated yet."""
        self.tractor, self.implement, self.work_mps, self.swaths_over = tractor, implement, work_mps, swaths_over

    def simulate_turn_seconds(self, turn_mps: float) -> float | None:
        """Simulated seconds of the quickest turn on a headland without limits; None without a turn."""
        driving_rules = DrivingRules(
            work_speed_mps=self.work_mps,
            turn_speed_mps=turn_mps,
            reverse_speed_mps=min(turn_mps, MAX_REVERSE_SPEED_MPS),
            radius_m=RADIUS_FACTOR * self.tractor.compute_smallest_radius_m(SOIL_GROUND),
            tool_m=self.implement.hitch_m,
        )
        clock = TurnTimer(self.tractor, self.implement, driving_rules, SOIL_GROUND)
        times = clock.measure_best_times(self.implement.width_m, HEADLAND_DEPTH_M, list_allowed_kinds("auto"))
        last_index = min(self.swaths_over, len(times) - 1)
        turn_s = times[last_index]
        # Over more tracks than that it drives straight across.
        across_m = (self.swaths_over - last_index) * self.implement.width_m
        return None if turn_s is None else turn_s + across_m / turn_mps

    def find_turn_speed_mps(self, seconds: float) -> float | None:
        """The speed (m/s) at which a turn takes this long, by bisection; None if no speed from 0.3 to 5.5 m/s does."""
        low, high = SLOWEST_MPS, FASTEST_MPS
        slowest, quickest = self.simulate_turn_seconds(low), self.simulate_turn_seconds(high)
        if slowest is None or quickest is None or not quickest <= seconds <= slowest:
            return None
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            middle_s = self.simulate_turn_seconds(middle)
            if middle_s is None:
                return None
            low, high = (low, middle) if middle_s < seconds else (middle, high)
        return 0.5 * (low + high)


@dataclass(frozen=True)
class LearnedFarm:
    """The farm file as text with the learned values, these values, and sentences on values that were not learned."""

    text: str
    values: tuple[LearnedOutcome, ...]
    notes: tuple[str, ...]


def learn_farm_values(
    paths: Sequence[str | Path], farm: str | Path, implement: str | None = None, replace_given: bool = False
) -> LearnedFarm:
    """Learn speeds, turns, stops and the order of the headland from imported runs, and put them into a farm file.

    Values given in the file are kept, except those learned earlier, unless `replace_given`. All other text is kept
    byte for byte. Raises LogError, RequestError, VehicleError.
    """
    if not os.path.exists(farm):
        raise RequestError(
            f"There is no farm file {quote_path(farm)}; check its name, or create one with headland farm new."
        )
    farm_file = load_farm(farm)
    text = read_text(farm, "a farm file (TOML)", RequestError)
    runs = load_imported_runs(paths)
    farm_implement, matching_runs = _choose_implement(farm_file, runs, implement)
    observations = RunObservations(matching_runs, farm_implement.width_m)
    notes: list[str] = []
    if not observations.runs:
        raise RequestError("No run has the work state of its implement, so nothing can be learned; give logs with it.")
    if len(observations.runs) < len(runs):
        notes.append(
            f"{count_noun(len(runs) - len(observations.runs), 'run')} skipped: another width or no work state."
        )
    learned_values = list(_learn_values(farm_file, farm_implement, observations, notes))
    if not learned_values:
        raise RequestError("The runs are too short to learn from; give runs with at least five turns, stops or passes.")
    edited_text, outcomes = _insert_learned_values(text, farm_file, learned_values, replace_given)
    _check_edit(edited_text, str(farm), Path(farm).parent, farm_file, outcomes)
    return LearnedFarm(edited_text, tuple(outcomes), tuple(notes))


def _choose_implement(
    farm_file: FarmFile, runs: Sequence[ProjectedRun], name: str | None
) -> tuple[FarmImplement, list[ProjectedRun]]:
    """The implement of the runs, and the runs with its width."""
    if "implements" not in farm_file.model_fields_set:
        raise RequestError("The farm file has no implement; add the implement of the logs under [[implements]].")
    widths = [run.width_m for run in runs if run.width_m]
    if name is None:
        if not widths:
            raise RequestError("The logs do not give their working width; name the implement with --implement.")
        width = float(np.median(widths))
        fitting = [one for one in farm_file.implements if _is_same_width(one.width_m, width)]
        if len(fitting) != 1:
            implement_names = ", ".join(f"{one.name} ({one.width_m:g} m)" for one in farm_file.implements)
            count = "no implement" if not fitting else "several implements"
            raise RequestError(
                f"The working width of the logs is {width:g} m, and the farm has {count} of this width; name one with "
                f"--implement: {implement_names}."
            )
        chosen = fitting[0]
    else:
        chosen = farm_file.get_implement(name)
    matching_runs = [run for run in runs if run.width_m is None or _is_same_width(chosen.width_m, run.width_m)]
    if not matching_runs:
        raise RequestError(
            f"No run was logged with the width of the implement {chosen.name!r}, {chosen.width_m:g} m; give logs of it."
        )
    return chosen, matching_runs


def _is_same_width(first_m: float, second_m: float) -> bool:
    return abs(second_m / first_m - 1.0) <= WIDTH_TOLERANCE


def _learn_values(
    farm_file: FarmFile, farm_implement: FarmImplement, observations: RunObservations, notes: list[str]
) -> Iterator[LearnedOutcome]:
    """Every value with enough events; too few events are noted."""
    name = f"implements.{farm_implement.name}"
    speed = estimate_statistic(observations.pass_speeds, np.median, MIN_EVENTS)
    if speed is not None and MIN_SPEED_KMH <= speed.value / MPS_PER_KMH <= MAX_SPEED_KMH:
        yield _build_learned_value(
            f"{name}.speed_kmh", speed, "median of {events} passes in {runs}", 1.0 / MPS_PER_KMH, 2
        )
        yield from _learn_turn_speed(farm_file, farm_implement, observations, speed.value, notes)
    yield from _learn_headland_order(name, observations, notes)
    for key, estimate, template, decimals in (
        ("speed_cv", observations.estimate_pass_cv(), "speed of {events} passes in {runs}", 3),
        (
            "turn_cv",
            estimate_cv(observations.list_u_turn_seconds(1)),
            "time of {events} turns to the next track in {runs}",
            3,
        ),
        ("turn_more_cv", observations.estimate_long_turn_cv(), "time of {events} turns over more tracks in {runs}", 3),
        ("stops_per_hour", observations.estimate_stops_per_hour(), "{events} stops in {runs}, per hour of driving", 2),
        (
            "stop_s",
            estimate_statistic(observations.stops_s, np.mean, MIN_EVENTS),
            "mean of {events} stops in {runs}",
            1,
        ),
        ("stop_cv", estimate_cv(observations.stops_s), "length of {events} stops in {runs}", 2),
    ):
        if estimate is None:
            notes.append(f"Too few events to learn {key}.")
        else:
            yield _build_learned_value(f"uncertainty.{key}", estimate, template, 1.0, decimals)


def _build_learned_value(
    key: str, estimate: IntervalEstimate, template: str, factor: float, decimals: int
) -> LearnedOutcome:
    value, low, high = (round(factor * bound, decimals) for bound in (estimate.value, estimate.low, estimate.high))
    origin = template.format(events=estimate.events, runs=count_noun(len(estimate.runs), "run"))
    return LearnedOutcome(key, value, low, high, origin, "", estimate.runs)


def _learn_turn_speed(
    farm_file: FarmFile, farm_implement: FarmImplement, observations: RunObservations, work_mps: float, notes: list[str]
) -> Iterator[LearnedOutcome]:
    """The turn speed at which a simulated turn takes as long as measured."""
    measured = observations.estimate_frequent_turn_s()
    if measured is None:
        notes.append("Too few U-turns without a stop to learn turn_speed_kmh.")
        return
    swaths_over, turn = measured
    tractor = next(tractor for tractor in farm_file.tractors if farm_file.is_compatible(tractor, farm_implement))
    simulated = TurnSpeedFit(tractor.build_tractor(), farm_implement.simulated_implement, work_mps, swaths_over)
    speeds_mps = [simulated.find_turn_speed_mps(seconds) for seconds in (turn.value, turn.high, turn.low)]
    origin = (
        f"{turn.value:.1f} s per turn over {count_noun(swaths_over, 'track')} (95 %: {turn.low:.1f} to "
        f"{turn.high:.1f}), median of {turn.events} in {count_noun(len(turn.runs), 'run')}; at this speed the "
        f"simulated {tractor.name} takes as long"
    )
    if speeds_mps[0] is None:
        notes.append(f"Measured: {origin.split(';', 1)[0]}; at no turn speed does {tractor.name} take as long.")
        return
    speeds_kmh = [None if speed_mps is None else round(speed_mps / MPS_PER_KMH, 2) for speed_mps in speeds_mps]
    value, low, high = speeds_kmh
    key = f"implements.{farm_implement.name}.turn_speed_kmh"
    yield LearnedOutcome(key, value or 0.0, low, high, origin, "", turn.runs)


def _learn_headland_order(name: str, observations: RunObservations, notes: list[str]) -> Iterator[LearnedOutcome]:
    estimate = observations.estimate_headland_first_share()
    if estimate is None:
        notes.append("No run shows whether the headland is worked first; this needs the outline of the field.")
        return
    first_count = round(estimate.value * estimate.events)
    if 1.0 - HABIT_SHARE < estimate.value < HABIT_SHARE:
        notes.append(
            f"The headland was worked first in {first_count} of {estimate.events} runs, so no order is learned."
        )
        return
    order = "first" if estimate.value >= HABIT_SHARE else "last"
    count = first_count if order == "first" else estimate.events - first_count
    origin = f"worked {order} in {count} of {count_noun(estimate.events, 'run')}"
    yield LearnedOutcome(f"{name}.headland", order, None, None, origin, "", estimate.runs)


def _insert_learned_values(
    text: str, farm_file: FarmFile, learned_values: Sequence[LearnedOutcome], replace_given: bool
) -> tuple[str, list[LearnedOutcome]]:
    """The text with every value that may be set, and the outcome for each."""
    earlier_values = {learned.key: learned.value for learned in farm_file.learned}
    outcomes, accepted = [], []
    for learned in learned_values:
        section, number, key = _locate_toml_value(farm_file, learned.key)
        holder = farm_file.implements[number] if number is not None else farm_file.uncertainty
        is_given = key in holder.model_fields_set
        old_value = getattr(holder, key)
        is_own = learned.key not in earlier_values or earlier_values[learned.key] != old_value
        if is_given and is_own and not replace_given:
            outcomes.append(replace(learned, done=f"kept {format_value(old_value)}"))
            continue
        interval = "" if learned.low is None else f", 95 % {learned.low:g} to {learned.high:g}"
        comment = f"own logs: {learned.measured}{interval}"
        text = set_value(text, section, number, key, tomlkit.item(learned.value).as_string(), comment)
        outcomes.append(replace(learned, done=f"was {format_value(old_value)}" if is_given else "added"))
        accepted.append(learned)
    text = remove_blocks(text, LEARNED_SECTION, {learned.key for learned in accepted})
    for learned in accepted:
        entries: dict[str, Any] = {"key": learned.key, "value": learned.value}
        if learned.low is not None and learned.high is not None:
            entries |= {"low": learned.low, "high": learned.high}
        names = list(learned.runs[:MAX_RUN_NAMES])
        unnamed_count = len(learned.runs) - len(names)
        origin = learned.measured + (f" (and {unnamed_count} more runs)" if unnamed_count else "")
        text = append_block(text, LEARNED_SECTION, {**entries, "origin": origin, "runs": names})
    return text, outcomes


def _locate_toml_value(farm_file: FarmFile, key: str) -> tuple[str, int | None, str]:
    """Section, number within it and key in the file for a key such as implements.drill.speed_kmh."""
    section, _, rest = key.partition(".")
    if section != "implements":
        return section, None, rest
    name, _, last = rest.rpartition(".")
    return section, [implement.name for implement in farm_file.implements].index(name), last


def _check_edit(text: str, label: str, folder: Path, farm_file: FarmFile, outcomes: Sequence[LearnedOutcome]) -> None:
    """Raise RequestError unless the edited text is a farm with only these values changed."""
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise RequestError(f"The farm file {label} cannot be edited ({error}); {TABLES_HINT}.") from None
    edited_farm = parse_farm(text, label, folder)
    expected = farm_file.model_dump()
    for outcome in outcomes:
        if outcome.done.startswith("kept"):
            continue
        _, number, key = _locate_toml_value(farm_file, outcome.key)
        holder = expected["uncertainty"] if number is None else expected["implements"][number]
        holder[key] = outcome.value
    actual = edited_farm.model_dump()
    del expected[LEARNED_SECTION], actual[LEARNED_SECTION]
    if actual != expected:
        raise RequestError(f"The farm file {label} cannot be edited; {TABLES_HINT}.")
