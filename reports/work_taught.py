"""What logs taught, for the terminal and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict

from rich.console import Group, RenderableType

from reports.fitting import Column, FittedTable, sentence
from reports.wording import NOTHING
from reports.work_results import Taught

_COLUMNS = (
    Column("Value of the farm file", "Value", words=True),
    Column("Learnt", whole=True),
    Column("95 %", whole=True),
    Column("In the file", words=True, whole=True),
)


def taught_table(taught: Sequence[Taught], notes: Sequence[str]) -> RenderableType:
    """A value to a line, then where each is from, then the remarks."""
    rows = tuple((one.key, _text(one.value), _interval(one), one.done) for one in taught)
    origins = (f"{one.key.rpartition('.')[2]}: {one.measured}." for one in taught)
    return Group(FittedTable(_COLUMNS, rows), *map(sentence, (*origins, *notes)))


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def _interval(one: Taught) -> str:
    return NOTHING if one.low is None or one.high is None else f"{one.low:g} to {one.high:g}"


def taught_json(taught: Sequence[Taught], notes: Sequence[str]) -> str:
    """An object: `learned`, a list of values with interval, origin and what was done, and `notes`."""
    told = {"learned": [asdict(one) for one in taught], "notes": list(notes)}
    return json.dumps(told, indent=2, allow_nan=False) + "\n"
