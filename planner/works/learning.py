"""What a farm's own logs teach, and the farm file with it: every value with its interval and the runs it is from."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fields.reading import read_text, shown, some
from planner.errors import ScenarioError
from planner.farm.file import FarmFile, farm_from, load_farm
from planner.farm.machines import FarmImplement
from planner.scenario import FASTEST_KMH, KMH, SLOWEST_KMH
from planner.works.estimates import Estimate
from planner.works.files import read_runs
from planner.works.observing import Observed
from planner.works.record import Driven
from planner.works.toml_edit import with_block, with_value, without_blocks, written
from planner.works.turning import TurnSpeed
from reports.work_results import Taught

SAME_WIDTH = 0.1
"""Logs and an implement whose widths differ by no larger share are taken for one."""
MOST_NAMED = 40
CERTAIN = 2.0 / 3.0
"""From this share of the runs on the order of the headland is taken for a habit."""
SECTION = "learned"
AS_TABLES = "write each section of it as a table, one key a line"


@dataclass(frozen=True)
class Lesson:
    """The farm file as text with what logs taught, every value that they did, and sentences on what they did not."""

    text: str
    taught: tuple[Taught, ...]
    notes: tuple[str, ...]


def learn(
    paths: Sequence[str | Path], farm: str | Path, implement: str | None = None, replace_given: bool = False
) -> Lesson:
    """Speeds, turns, stops and the order of the headland of imported runs, put into the text of a farm file.

    Values that the file gives already stay, but for those that were learnt before, unless `replace_given`. All other
    text stays byte for byte. Raises LogError, ScenarioError, VehicleError.
    """
    if not os.path.exists(farm):
        raise ScenarioError(
            f"There is no farm file {shown(farm)} to put it in; check its name, or begin one with headland farm new."
        )
    own = load_farm(farm)
    text = read_text(farm, "a farm file (TOML)", ScenarioError)
    runs = read_runs(paths)
    mounted, used, notes = _implement(own, runs, implement)
    observed = Observed(used, mounted.width_m)
    if not observed.runs:
        raise ScenarioError("No run says when its implement worked, so nothing can be learnt; give logs that do.")
    if len(observed.runs) < len(runs):
        notes.append(
            f"{some(len(runs) - len(observed.runs), 'run')} of another width or without a work state left out."
        )
    taught = list(_lessons(own, mounted, observed, notes))
    if not taught:
        raise ScenarioError(
            "The runs are too short to learn from; give some with at least five turns, stops or passes."
        )
    edited, told = _edited(text, own, taught, replace_given)
    _check(edited, str(farm), Path(farm).parent, own, told)
    return Lesson(edited, tuple(told), tuple(notes))


def _implement(
    own: FarmFile, runs: Sequence[Driven], name: str | None
) -> tuple[FarmImplement, list[Driven], list[str]]:
    """The implement that the runs are of, the runs of its width, and remarks."""
    if "implements" not in own.model_fields_set:
        raise ScenarioError("The farm file names no implement; add the one that the logs are of under [[implements]].")
    widths = [run.width_m for run in runs if run.width_m]
    if name is None:
        if not widths:
            raise ScenarioError("The logs do not say their working width; name the implement with --implement.")
        width = float(np.median(widths))
        fitting = [one for one in own.implements if _alike(one.width_m, width)]
        if len(fitting) != 1:
            known = ", ".join(f"{one.name} ({one.width_m:g} m)" for one in own.implements)
            count = "no implement" if not fitting else "several implements"
            raise ScenarioError(
                f"The logs are {width:g} m wide and the farm has {count} like that; name one with --implement: {known}."
            )
        found = fitting[0]
    else:
        found = own.implement(name)
    used = [run for run in runs if run.width_m is None or _alike(found.width_m, run.width_m)]
    if not used:
        raise ScenarioError(f"No run is {found.width_m:g} m wide as the implement {found.name!r} is; give those of it.")
    return found, used, []


def _alike(one_m: float, other_m: float) -> bool:
    return abs(other_m / one_m - 1.0) <= SAME_WIDTH


def _lessons(own: FarmFile, mounted: FarmImplement, seen: Observed, notes: list[str]) -> Iterator[Taught]:
    """Every value that there is enough to learn from; what there is not is a remark."""
    name = f"implements.{mounted.name}"
    speed = seen.speed_mps()
    if speed is not None and SLOWEST_KMH <= speed.value / KMH <= FASTEST_KMH:
        yield _of(f"{name}.speed_kmh", speed, "median of {events} passes in {runs}", 1.0 / KMH, 2)
        yield from _turn_speed(own, mounted, seen, speed, notes)
    yield from _headland(name, seen, notes)
    for key, found, words, decimals in (
        ("speed_cv", seen.pass_cv(), "speed of {events} passes in {runs}", 3),
        ("turn_cv", seen.turn_cv(), "time of {events} turns over one track in {runs}", 3),
        ("turn_more_cv", seen.turn_more_cv(), "time of {events} turns over more tracks in {runs}", 3),
        ("stops_per_hour", seen.stops_per_hour(), "{events} stops in {runs}, per hour driven", 2),
        ("stop_s", seen.stop_s(), "mean of {events} stops in {runs}", 1),
        ("stop_cv", seen.stop_cv(), "length of {events} stops in {runs}", 2),
    ):
        if found is None:
            notes.append(f"Too few events to learn {key}.")
        else:
            yield _of(f"chances.{key}", found, words, 1.0, decimals)


def _of(key: str, found: Estimate, words: str, factor: float, decimals: int) -> Taught:
    value, low, high = (round(factor * each, decimals) for each in (found.value, found.low, found.high))
    told = words.format(events=found.events, runs=some(len(found.runs), "run"))
    return Taught(key, value, low, high, told, "", found.runs)


def _turn_speed(
    own: FarmFile, mounted: FarmImplement, seen: Observed, speed: Estimate, notes: list[str]
) -> Iterator[Taught]:
    """The turn speed at which a simulated turn takes as long as measured."""
    measured = seen.turn_s()
    if measured is None:
        notes.append("Too few turns back without a stop to learn turn_speed_kmh.")
        return
    over, turn = measured
    kind = next(each for each in own.tractors if own.fits(each, mounted))
    simulated = TurnSpeed(kind.machine(), mounted.mounted, speed.value, over)
    found = [simulated.for_seconds(seconds) for seconds in (turn.value, turn.high, turn.low)]
    words = (
        f"{turn.value:.1f} s a turn over {some(over, 'track')} (95 %: {turn.low:.1f} to {turn.high:.1f}), median of "
        f"{turn.events} in {some(len(turn.runs), 'run')}; at this speed {kind.name} is simulated to take as long"
    )
    if found[0] is None:
        notes.append(f"Measured were {words.split(';', 1)[0]}; no turn speed makes {kind.name} take as long.")
        return
    kmh = [None if each is None else round(each / KMH, 2) for each in found]
    yield Taught(f"implements.{mounted.name}.turn_speed_kmh", kmh[0] or 0.0, kmh[1], kmh[2], words, "", turn.runs)


def _headland(name: str, seen: Observed, notes: list[str]) -> Iterator[Taught]:
    found = seen.headland_first()
    if found is None:
        notes.append("No run shows whether the headland is worked first: that needs the outline of its field.")
        return
    first = round(found.value * found.events)
    if 1.0 - CERTAIN < found.value < CERTAIN:
        notes.append(f"The headland was worked first in {first} of {found.events} runs: no habit to learn.")
        return
    order = "first" if found.value >= CERTAIN else "last"
    count = first if order == "first" else found.events - first
    words = f"worked {order} in {count} of {some(found.events, 'run')}"
    yield Taught(f"{name}.headland", order, None, None, words, "", found.runs)


def _edited(text: str, own: FarmFile, taught: Sequence[Taught], replace_given: bool) -> tuple[str, list[Taught]]:
    """The text with every value that may go in, and what was done with each."""
    before = {one.key: one.value for one in own.learned}
    told, taken = [], []
    for one in taught:
        section, number, key = _place(own, one.key)
        holder = own.implements[number] if number is not None else own.chances
        given = key in holder.model_fields_set
        old = getattr(holder, key)
        if given and not replace_given and (one.key not in before or before[one.key] != old):
            told.append(replace(one, done=f"kept {_shown(old)}"))
            continue
        interval = "" if one.low is None else f", 95 % {one.low:g} to {one.high:g}"
        comment = f"own logs: {one.measured}{interval}"
        text = with_value(text, section, number, key, written(one.value), comment)
        told.append(replace(one, done=f"was {_shown(old)}" if given else "added"))
        taken.append(one)
    text = without_blocks(text, SECTION, {one.key for one in taken})
    for one in taken:
        text = with_block(text, SECTION, _block(one))
    return text, told


def _block(one: Taught) -> dict[str, Any]:
    entries: dict[str, Any] = {"key": one.key, "value": one.value}
    if one.low is not None and one.high is not None:
        entries |= {"low": one.low, "high": one.high}
    names = list(one.runs[:MOST_NAMED])
    more = len(one.runs) - len(names)
    told = one.measured + (f" (and {more} runs that are not named here)" if more else "")
    return {**entries, "told": told, "runs": names}


def _place(own: FarmFile, key: str) -> tuple[str, int | None, str]:
    """Section, number in it and key of the file for a key such as implements.drill.speed_kmh."""
    section, _, rest = key.partition(".")
    if section != "implements":
        return section, None, rest
    name, _, last = rest.rpartition(".")
    return section, [one.name for one in own.implements].index(name), last


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _check(text: str, called: str, folder: Path, own: FarmFile, told: Sequence[Taught]) -> None:
    """Raise ScenarioError unless the edited text is a farm with just these values changed."""
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"Values cannot be put into the farm file {called} ({error}); {AS_TABLES}.") from None
    after = farm_from(text, called, folder)
    expected = own.model_dump()
    for one in told:
        if one.done.startswith("kept"):
            continue
        _, number, key = _place(own, one.key)
        holder = expected["chances"] if number is None else expected["implements"][number]
        holder[key] = one.value
    found = after.model_dump()
    del expected[SECTION], found[SECTION]
    if found != expected:
        raise ScenarioError(f"Values cannot be put into the farm file {called}; {AS_TABLES}.")
