"""How many numbers of the thesis the simulation meets, how nearly, and which it has none for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from reports.wording import listed
from vehicle.trials.sheets.sheet import Comparison, Sheet

NEAR_PCT, FAR_PCT = 5.0, 15.0


@dataclass(frozen=True)
class Agreement:
    """The verdict: one sentence, more of them, and a row per experiment under `header`."""

    headline: str
    sentences: tuple[str, ...]
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class _Count:
    """Numbers of the thesis by how far ours is off, and those that have none of ours to compare."""

    title: str
    near: int
    fair: int
    far: int
    alone: int

    @property
    def all(self) -> int:
        return self.near + self.fair + self.far + self.alone


def agreement(sheets: Sequence[Sheet]) -> Agreement | None:
    """Counts over the comparisons of some experiments; None when the thesis prints no number for any of them."""
    counts = [_count(sheet.title, sheet.comparisons) for sheet in sheets]
    whole = _count("All", [row for sheet in sheets for row in sheet.comparisons])
    if not whole.all:
        return None
    compared = whole.all - whole.alone
    headline = (
        f"Of {whole.all} numbers of the thesis {compared} have one of ours: {whole.near} agree within {NEAR_PCT:g} %, "
        f"{whole.fair} more within {FAR_PCT:g} %, {whole.far} differ by more."
    )
    header = ("Experiment", "Numbers", f"Within {NEAR_PCT:g} %", f"Within {FAR_PCT:g} %", "Farther", "None of ours")
    told = [one for one in counts if one.all]
    rows = tuple(_row(one) for one in (*told, *([whole] if len(told) > 1 else [])))
    return Agreement(headline, tuple(_sentences(counts, whole, sheets)), header, rows)


def off_pct(row: Comparison) -> float | None:
    """How far ours is off the printed number, in percent to the decimal that tables show."""
    return None if row.difference_pct is None else round(abs(row.difference_pct), 1)


def _count(title: str, rows: Iterable[Comparison]) -> _Count:
    printed = [row for row in rows if row.thesis is not None]
    off = [value for row in printed if (value := off_pct(row)) is not None]
    near, fair = sum(value <= NEAR_PCT for value in off), sum(NEAR_PCT < value <= FAR_PCT for value in off)
    return _Count(title, near, fair, len(off) - near - fair, len(printed) - len(off))


def _row(one: _Count) -> tuple[str, ...]:
    return one.title, *map(str, (one.all, one.near, one.fair, one.far, one.alone))


def _sentences(counts: Sequence[_Count], whole: _Count, sheets: Sequence[Sheet]) -> list[str]:
    sentences = []
    if whole.far and len(counts) > 1:
        named = listed(f"{one.title} ({one.far})" for one in counts if one.far)
        sentences.append(f"Differ by more than {FAR_PCT:g} %: {named}.")
    if whole.alone:
        sentences.append(f"{whole.alone} cannot be compared here; each is listed with its reason.")
    ours = sum(row.thesis is None and row.ours is not None for sheet in sheets for row in sheet.comparisons)
    if ours:
        sentences.append(f"{ours} further numbers of ours have no printed one beside them.")
    return sentences
