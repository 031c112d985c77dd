"""Counting what diagnoses made of sets with known causes: named, wrong, inside their intervals, likely and right."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from tests.diagnosis.sets import inside, size_of
from vehicle.identification.diagnosis.results import LIKELY, NAMED, REFUTED

NAMED_WANTED, LIKELY_WANTED, INSIDE_WANTED, SETS_PER_WRONG_NAME = 0.97, 0.80, (0.93, 0.97), 300
LEAST_INSIDE = 0.90  # of the values of every parameter
Record = dict[str, Any]


@dataclass
class Count:
    """So many of so many."""

    right: int = 0
    of: int = 0

    def add(self, right: bool) -> None:
        """One more."""
        self.right, self.of = self.right + bool(right), self.of + 1

    @property
    def share(self) -> float:
        """From 0 to 1; 0 of none is 0."""
        return self.right / self.of if self.of else 0.0

    def __str__(self) -> str:
        return f"{self.right}/{self.of}" if self.of else "-"


@dataclass
class Tally:
    """Counts by effect. `alone` and `told` (named or likely) have a count per size, `together` those in company."""

    alone: dict[str, Count] = field(default_factory=dict)
    told: dict[str, Count] = field(default_factory=dict)
    together: Count = field(default_factory=Count)
    covered: Count = field(default_factory=Count)
    likely: Count = field(default_factory=Count)
    wrong: int = 0
    refuted: int = 0

    def add(self, record: Record, name: str) -> None:
        """What a set with or without this effect adds."""
        said = next((one for one in record["said"] if one["id"] == name), None)
        status = said["status"] if said else ""
        hidden = name in record["hidden"]
        if status == LIKELY:
            self.likely.add(hidden)
        self.wrong += status == NAMED and not hidden
        if not hidden:
            return
        if len(record["hidden"]) == 1:
            for counts, right in ((self.alone, status == NAMED), (self.told, status in (NAMED, LIKELY))):
                counts.setdefault(record["size"], Count()).add(right)
        else:
            self.together.add(status == NAMED)
        self.refuted += status == REFUTED
        covered = inside(said["interval"], record["hidden"][name]) if said and status in (NAMED, LIKELY) else None
        if covered is not None:
            self.covered.add(covered)


def tallied(records: Iterable[Record], names: Sequence[str]) -> dict[str, Tally]:
    """A tally for every effect; sets that ended in an error count as sets that said nothing."""
    tallies = {name: Tally() for name in names}
    for record in records:
        answered = {"said": [], **record}
        for name, tally in tallies.items():
            tally.add(answered, name)
    return tallies


def total(counts: Iterable[Count]) -> Count:
    """All counts as one."""
    listed = list(counts)
    return Count(sum(one.right for one in listed), sum(one.of for one in listed))


def verdicts(records: Sequence[Record], tallies: dict[str, Tally]) -> list[tuple[str, str, bool | None]]:
    """What is asked of a diagnosis: in words, the figure, and whether it holds (None where nothing was counted)."""
    every = tallies.values()
    named = total([*(one.alone.get("clear", Count()) for one in every), *(one.together for one in every)])
    wrong = Count(sum(bool(set(record.get("named", ())) - set(record["hidden"])) for record in records), len(records))
    covered, likely = total(one.covered for one in every), total(one.likely for one in every)
    low, high = INSIDE_WANTED
    asked = (
        (f"clear effects named, at least {NAMED_WANTED:.0%}", named, named.share >= NAMED_WANTED),
        (f"sets with a wrong name, at most 1 in {SETS_PER_WRONG_NAME}", wrong,
         wrong.right * SETS_PER_WRONG_NAME <= wrong.of),
        (f"values in their 95 % intervals, {low:.0%} to {high:.0%}", covered, low <= covered.share <= high),
        (f"likely ones right, at least {LIKELY_WANTED:.0%}", likely, likely.share >= LIKELY_WANTED),
    )  # fmt: skip
    return [(words, f"{count} = {count.share:.1%}", holds if count.of else None) for words, count, holds in asked]


def table(tallies: dict[str, Tally]) -> list[str]:
    """A line per effect: named alone at three sizes (with likely ones), in company, values, likely right, wrong."""
    heads = ("clear", "half (told)", "third (told)", "together", "inside", "likely", "refuted", "wrong")
    lines = [f"{'':22s}" + "".join(f"{head:>14s}" for head in heads)]
    for name, one in tallies.items():
        sizes = [str(one.alone.get("clear", Count()))]
        for size in ("half", "third"):
            sizes.append(f"{one.alone.get(size, Count())} ({one.told.get(size, Count()).right})")
        cells = (*sizes, one.together, one.covered, one.likely, one.refuted, one.wrong)
        lines.append(f"{name:22s}" + "".join(f"{cell!s:>14s}" for cell in cells))
    return lines


def coverage_by_parameter(tallies: dict[str, Tally]) -> str:
    """In words: the parameters whose values are in their intervals less often than LEAST_INSIDE, with their counts."""
    told = {name: one.covered for name, one in tallies.items() if one.covered.of}
    low = [f"{name} {count}" for name, count in told.items() if count.share < LEAST_INSIDE]
    return (
        f"values in their intervals by parameter, at least {LEAST_INSIDE:.0%}: {len(told) - len(low)} of {len(told)}"
        + (f"; not {', '.join(low)}" if low else "")
    )


def faults(records: Sequence[Record]) -> list[str]:
    """Every set in which a diagnosis was wrong, missed a clear effect or gave an interval without the truth."""
    lines = []
    for record in records:
        if "error" in record:
            lines.append(f"{record['key']}: ended in {record['error']}")
            continue
        wrong = [name for name in record["named"] if name not in record["hidden"]]
        parts = [f"wrong name {_worded(record, name)}" for name in wrong]
        for one in record["said"]:
            truth = record["hidden"].get(one["id"])
            if truth is None:
                if one["status"] == LIKELY:
                    parts.append(f"likely, not hidden: {_worded(record, one['id'])}")
                continue
            if one["status"] != NAMED and record["size"] == "clear":
                parts.append(f"{one['id']} {truth[size_of(truth)]:.3g} {one['status']} {_worded(record, one['id'])}")
            elif one["status"] in (NAMED, LIKELY) and inside(one["interval"], truth) is False:
                parts.append(f"{one['id']} {truth[size_of(truth)]:.3g} outside {_worded(record, one['id'])}")
        if parts:
            lines.append(f"{record['key']}: " + "; ".join(parts))
    return lines


def _worded(record: Record, name: str) -> str:
    """An effect as it was said: value and interval of its size."""
    said = next(one for one in record["said"] if one["id"] == name)
    if not said["value"]:
        return f"(shown from {said['visible']:.3g})" if said["visible"] is not None else "(no size would show)"
    key = size_of(said["value"])
    low, high = (said["interval"] or {}).get(key, (float("nan"), float("nan")))
    return f"{name} = {said['value'][key]:.3g} ({low:.3g} to {high:.3g})"
