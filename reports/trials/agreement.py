"""How many numbers of the thesis the simulation reproduces, how closely, and which it cannot."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from reports.common.wording import join_list
from vehicle.trials.sheets.sheet import ExperimentSheet, ThesisComparison

NEAR_PCT, FAR_PCT = 5.0, 15.0


@dataclass(frozen=True)
class ThesisAgreement:
    """The agreement: a headline, further sentences, and a row per experiment under `header`."""

    headline: str
    sentences: tuple[str, ...]
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class _AgreementCount:
    """Numbers of the thesis by their deviation here, and those that cannot be compared."""

    title: str
    near_count: int
    fair_count: int
    far_count: int
    uncompared_count: int

    @property
    def total(self) -> int:
        return self.near_count + self.fair_count + self.far_count + self.uncompared_count


def measure_thesis_agreement(sheets: Sequence[ExperimentSheet]) -> ThesisAgreement | None:
    """The agreement over some experiments; None when the thesis prints no number for any of them."""
    counts = [_count_agreement(sheet.title, sheet.comparisons) for sheet in sheets]
    total = _count_agreement("All", [row for sheet in sheets for row in sheet.comparisons])
    if not total.total:
        return None
    compared = total.total - total.uncompared_count
    headline = (
        f"{compared} of {total.total} numbers of the thesis are reproduced: {total.near_count} within {NEAR_PCT:g} %, "
        f"{total.fair_count} more within {FAR_PCT:g} %; {total.far_count} differ by more."
    )
    header = ("Experiment", "Numbers", f"Within {NEAR_PCT:g} %", f"Within {FAR_PCT:g} %", "Farther", "Not compared")
    counted = [one for one in counts if one.total]
    rows = tuple(_build_agreement_row(one) for one in (*counted, *([total] if len(counted) > 1 else [])))
    return ThesisAgreement(headline, tuple(_describe_agreement(counts, total, sheets)), header, rows)


def compute_deviation_pct(row: ThesisComparison) -> float | None:
    """Deviation from the printed number in percent, rounded to the decimal that tables show."""
    return None if row.difference_pct is None else round(abs(row.difference_pct), 1)


def _count_agreement(title: str, rows: Iterable[ThesisComparison]) -> _AgreementCount:
    printed = [row for row in rows if row.thesis is not None]
    off = [value for row in printed if (value := compute_deviation_pct(row)) is not None]
    near, fair = sum(value <= NEAR_PCT for value in off), sum(NEAR_PCT < value <= FAR_PCT for value in off)
    return _AgreementCount(title, near, fair, len(off) - near - fair, len(printed) - len(off))


def _build_agreement_row(count: _AgreementCount) -> tuple[str, ...]:
    return count.title, *map(
        str, (count.total, count.near_count, count.fair_count, count.far_count, count.uncompared_count)
    )


def _describe_agreement(
    counts: Sequence[_AgreementCount], total: _AgreementCount, sheets: Sequence[ExperimentSheet]
) -> list[str]:
    sentences = []
    if total.far_count and len(counts) > 1:
        named = join_list(f"{one.title} ({one.far_count})" for one in counts if one.far_count)
        sentences.append(f"Differ by more than {FAR_PCT:g} %: {named}.")
    if total.uncompared_count:
        sentences.append(f"{total.uncompared_count} cannot be compared; each is listed with the reason.")
    ours = sum(row.thesis is None and row.ours is not None for sheet in sheets for row in sheet.comparisons)
    if ours:
        sentences.append(f"{ours} further simulated numbers are not in the thesis.")
    return sentences
