"""A field in figures for a terminal: labels and values, and a small table for everything that there are several of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.fitting import Column, FittedTable, sentence
from reports.wording import NOTHING, yes_no

_UNITS = {"m": "m", "m2": "m2", "ha": "ha", "s": "s", "deg": "degrees", "pct": "%", "kmh": "km/h", "mps": "m/s"}
_HEADINGS = {
    "not_worked": "Not worked by tracks and rounds as they lie",
    "rounds": "Rounds of the headland",
    "lines": "Guidance lines of the file (for --along)",
    "headlands": "Headlands of the file (for --headland)",
}
_DEGREES, _METRES = {"lon", "lat"}, {"x_m", "y_m"}
_FITS, _TAKES, _ESTIMATED = (
    "fits_percent_of_ends_over_tracks", "seconds_over_tracks", "estimated_seconds_where_no_turn_fits"
)  # fmt: skip


def field_report(facts: Mapping[str, Any]) -> RenderableType:
    """All facts of a field: single ones first, then a table for each list of mappings that is not empty, then turns."""
    turns = facts.get("turns", {})
    tables = {key: value for key, value in facts.items() if _is_table(value)}
    single = {key: value for key, value in facts.items() if key not in tables and key != "turns"}
    parts: list[RenderableType] = [field_table(single)]
    for key, rows in tables.items():
        parts += [Text(""), Text(_HEADINGS.get(key, _label(key)), style="bold"), _table(rows)]
    if turns:
        parts += [Text(""), Text("Turns", style="bold"), _table(turn_rows(turns))]
        parts.append(sentence("In % of the ends of tracks where such a turn fits.", style="dim"))
        if turns[_ESTIMATED]:
            parts.append(sentence("Estimated are ways where no turn fits: two full circles.", style="dim"))
    return Group(*parts)


def turn_rows(turns: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A row per number of tracks that turns lead over: percent of ends by kind, seconds."""
    kinds = list(dict.fromkeys(kind for shares in turns[_FITS].values() for kind in shares))
    counts = dict.fromkeys([*turns[_FITS], *turns[_TAKES], *turns[_ESTIMATED]])
    return [
        {
            "over_tracks": over,
            **{f"{kind}_pct": turns[_FITS].get(over, {}).get(kind) for kind in kinds},
            "takes_s": turns[_TAKES].get(over),
            "estimated_s": turns[_ESTIMATED].get(over),
        }
        for over in counts
    ]


def field_table(info: Mapping[str, Any]) -> RenderableType:
    """Label and value pairs, one per line: ``area_ha`` reads ``Area (ha)``; a mapping has a line per entry."""
    columns = (Column("Label", words=True), Column("Value", words=True))
    rows = tuple((_label(label), _plain(value)) for label, value in info.items())
    return FittedTable(columns, rows, header=False)


def _is_table(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and isinstance(value[0], Mapping)


def _table(rows: Sequence[Mapping[str, Any]]) -> FittedTable:
    """Rows of mappings under the labels of their keys; keys without any value are left out.

    Places are told on the earth where they are there, else in metres.
    """
    keys = [key for key in dict.fromkeys(key for row in rows for key in row)
            if any(row.get(key) is not None for row in rows)]  # fmt: skip
    keys = [key for key in keys if key not in _METRES or not set(keys) >= _DEGREES]
    words = [key for key in keys if any(isinstance(row.get(key), str) for row in rows) and key != "over_tracks"]
    columns = tuple(
        Column(_label(key), words=key in words, drop=0 if key in words or place < 2 else place)
        for place, key in enumerate(keys)
    )
    return FittedTable(
        columns, tuple(tuple(_cell(key, row.get(key)) for key in keys) for row in rows), elsewhere="--json shows all"
    )


def _cell(key: str, value: Any) -> str:
    return f"{value:.5f}" if key in _DEGREES and value is not None else _plain(value)


def _label(key: object) -> str:
    """A key in words, its unit in brackets."""
    words = str(key).split("_")
    unit = f" ({_UNITS[words.pop()]})" if len(words) > 1 and words[-1] in _UNITS else ""
    text = " ".join(words)
    return text[:1].upper() + text[1:] + unit


def _plain(value: Any, inner: str = "\n") -> str:
    """A value in words: six significant digits, lists with commas (of mappings, in lines), pairs parted by `inner`."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if value is None or isinstance(value, bool):
        return yes_no(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return inner.join(f"{_label(label)}: {_plain(item, ', ')}" for label, item in value.items()) or NOTHING
    if isinstance(value, list | tuple):
        return ", ".join(_plain(item) for item in value) or NOTHING
    return str(value)
