"""How references draw their cases: rows of tables in a drawn order, and what may be said of each row."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from tests.truth.cases import KINDS, ColumnClock, Fault, Law, TruthCase
from tests.truth.effects import NEUTRAL, Effects, scaled

Rng = np.random.Generator
Row = TypeVar("Row")
Drawers = Mapping[str, Callable[[Rng, int], list[TruthCase]]]
Cause = tuple[dict[str, tuple[float, float]], tuple[str, ...], tuple[str, ...]]
"""Of a cause outside the catalogue: ranges of its numbers, words of which one should be in a hint, ids as right."""
EITHER_WAY = ("steering_offset", "steering_gain", "steering_asymmetry", "implement_side_draft", "antenna_forward",
              "antenna_right", "heading_bias", "grip_drift")  # fmt: skip
LAW_WORDS = {
    "over_minutes": ("time", "minute"), "over_day": ("day", "time", "run"), "by_place": ("place", "east", "north"),
    "by_side": ("side", "left", "right"), "by_angle": ("angle",), "by_speed": ("speed",),
    "by_implement": ("implement", "work"),
}  # fmt: skip


def build_case(
    kind: str, seed: int, effects: Effects | None = None, *, columns: Mapping[str, ColumnClock] | None = None,
    laws: Sequence[Law] = (), faults: Sequence[Fault] = (), also: Iterable[str] = (),
    wanted: Iterable[str] | None = None, words: tuple[str, ...] = (), **fields: Any,
) -> TruthCase:  # fmt: skip
    """A case in which all that it hides may be named and is wanted, unless `wanted` says what is, and `also` may be."""
    clocks, alike = judge_clocks(columns or {})
    ids = {*(effects or {}), *(law.effect for law in laws), *(fault.id for fault in faults), *clocks}
    return TruthCase(
        kind, seed, effects or {}, columns or {}, tuple(laws), tuple(faults), hint_words=words,
        allowed=frozenset({*ids, *alike, *also}), wanted=frozenset(ids if wanted is None else wanted), **fields,
    )  # fmt: skip


def judge_clocks(columns: Mapping[str, ColumnClock]) -> tuple[set[str], set[str]]:
    """Ids that name the clocks of columns, and ids that would be as right."""
    ids: set[str] = set()
    alike: set[str] = set()
    for name, clock in columns.items():
        if clock.delay_s:
            alike.add(f"clock_offset_{name}")
            ids |= {f"{name}_delay"} & {"position_delay", "heading_delay"}
        if clock.filter_s:
            ids, alike = ids | {"heading_filter"}, alike | {"heading_delay"}
        if clock.scale != 1.0 and name == "speed":
            ids.add("speed_scale")
        if clock.offset_s or clock.drift_s_per_min:
            ids.add(f"clock_offset_{name}")
    return ids, alike


def pick(table: Iterable[Row], count: int, rng: Rng) -> list[Row]:
    """Rows of a table in a drawn order."""
    rows = list(table)
    return [rows[place] for place in rng.permutation(len(rows))[:count]]


def pick_names(names: Iterable[str], count: int, rng: Rng) -> list[str]:
    """Names in a drawn order."""
    return [str(name) for name in rng.permutation(list(names))[:count]]


def draw_ranges(ranges: Mapping[str, tuple[float, float]], rng: Rng) -> dict[str, float]:
    """A number of each range; runs have whole ones."""
    values = {key: float(rng.uniform(low, high)) for key, (low, high) in ranges.items()}
    return {key: float(int(value)) if key == "run" else value for key, value in values.items()}


def draw_effect(name: str, rng: Rng) -> dict[str, float]:
    """An effect of 1 to 1.35 times its clear size, to either side where it has two, somewhere in the field."""
    values = scaled(name, float(rng.uniform(1.0, 1.35)))
    if name in EITHER_WAY and rng.random() < 0.5:
        values = {key: 2.0 * NEUTRAL[name][key] - value for key, value in values.items()}
    places = {"bearing_deg": (0.0, 360.0), "east_m": (-12.0, 12.0), "north_m": (-12.0, 12.0), "radius_m": (9.0, 16.0)}
    return {key: float(rng.uniform(*places[key])) if key in places else value for key, value in values.items()}


def draw_one(names: Sequence[str], rng: Rng) -> Effects:
    """One of some effects."""
    name = str(rng.choice(names))
    return {name: draw_effect(name, rng)}


def check_kinds(kinds: Iterable[str] | None) -> Collection[str]:
    """The kinds asked for: all without any. Raises ValueError for an unknown one."""
    wanted = KINDS if kinds is None else tuple(kinds)
    unknown = sorted(set(wanted) - set(KINDS))
    if unknown:
        raise ValueError(f"The kind {unknown[0]!r} is unknown; use one of: {', '.join(KINDS)}.")
    return wanted


def draw_kinds(seed: int, kinds: Iterable[str] | None, drawers: Drawers, stream: int) -> list[TruthCase]:
    """The cases of a seed by the drawers of a reference, each kind with draws and seeds of its own."""
    wanted = check_kinds(kinds)
    cases = []
    for number, kind in enumerate(KINDS):
        if kind in wanted and kind in drawers:
            cases += drawers[kind](np.random.default_rng([seed, stream, number]), seed * 1000 + number * 50)
    return cases
