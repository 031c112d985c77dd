"""A field in figures for a terminal, and the list of fields in a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from fields.documents.reader import FieldSummary
from fields.errors import escape_controls
from reports.common.language import mark_text, translate, translate_sentence
from reports.common.rendering import format_json
from reports.common.text_tables import FittedTable, TableColumn, build_plain_table, build_table, format_title
from reports.common.wording import NO_VALUE, capitalize_first, format_number, format_yes_no

_UNITS = {"m": "m", "m2": "m2", "ha": "ha", "s": "s", "deg": "degrees", "pct": "%", "kmh": "km/h", "mps": "m/s"}
_HEADINGS = {
    "unworked": "Ground that tracks and headland passes do not cover",
    "headland_passes": "Headland passes",
    "lines": "Guidance lines of the file (for --guidance-line)",
    "headlands": "Headlands of the file (for --headland)",
}
_DEGREE_KEYS, _METRE_KEYS = {"lon", "lat"}, {"x_m", "y_m"}
_PRINTED_KEYS = {"reason", "kind", "crs"}  # whose values are words of Headland, not names


def build_field_report(facts: Mapping[str, Any]) -> RenderableType:
    """All facts of a field: single values, then a table for each list of mappings that is not empty, then turns."""
    turns = facts.get("turns", {})
    lists = {key: value for key, value in facts.items() if isinstance(value, list | tuple)}
    tables = {key: rows for key, rows in lists.items() if rows and isinstance(rows[0], Mapping)}
    single = {key: value for key, value in facts.items() if key not in tables and key != "turns"}
    parts: list[RenderableType] = [build_field_table(single)]
    for key, rows in tables.items():
        parts += [
            Text(""),
            format_title(_HEADINGS.get(key, _format_fact_label(key)), style="bold"),
            _build_facts_table(rows),
        ]
    fitting, seconds, estimated_s = (
        turns.get(f"{name}_by_swaths", {}) for name in ("fitting_pct", "turn_s", "estimated_turn_s")
    )
    kinds = dict.fromkeys(kind for shares in fitting.values() for kind in shares)
    rows = [  # one per number of tracks that turns lead over: percent of track ends by kind of turn, and seconds
        {
            "over_swaths": swaths_over,
            **{f"{kind}_pct": fitting.get(swaths_over, {}).get(kind) for kind in kinds},
            "takes_s": seconds.get(swaths_over),
            "estimated_s": estimated_s.get(swaths_over),
        }
        for swaths_over in dict.fromkeys([*fitting, *seconds, *estimated_s])
    ]
    if rows:
        notes = [mark_text("Percent of track ends where such a turn fits.")]
        notes += [mark_text("Estimated: two full circles, where no turn fits.")] if estimated_s else []
        parts += [Text(""), format_title("Turns", style="bold"), _build_facts_table(rows, notes)]
    return Group(*parts)


def build_field_table(info: Mapping[str, Any]) -> RenderableType:
    """Label and value pairs, one per line: ``area_ha`` reads ``Area (ha)``; a mapping has a line per entry."""
    rows = ((_format_fact_label(label), _format_fact_cell(label, value)) for label, value in info.items())
    return build_plain_table(("", ""), rows, (0, 1), has_lines=True)


def _build_facts_table(rows: Sequence[Mapping[str, Any]], notes: Sequence[str] = ()) -> FittedTable:
    """Rows of mappings under the labels of their keys; keys without any value are left out.

    Places are in degrees where they are known, else in metres.
    """
    keys = [key for key in dict.fromkeys(key for row in rows for key in row)
            if any(row.get(key) is not None for row in rows)]  # fmt: skip
    keys = [key for key in keys if key not in _METRE_KEYS or not set(keys) >= _DEGREE_KEYS]
    text_keys = [key for key in keys if any(isinstance(row.get(key), str) for row in rows) and key != "over_swaths"]
    columns = tuple(
        TableColumn(
            _format_fact_label(key), is_text=key in text_keys, drop_order=0 if key in text_keys or place < 2 else place
        )
        for place, key in enumerate(keys)
    )
    return FittedTable(
        columns,
        tuple(tuple(_format_fact_cell(key, row.get(key)) for key in keys) for row in rows),
        more_hint="--json shows all",
        has_lines=True,
        notes=tuple(notes),
    )


def _format_fact_cell(key: str, value: Any) -> str:
    if key in _PRINTED_KEYS and isinstance(value, str):
        return escape_controls(translate_sentence(value))
    return f"{value:.5f}" if key in _DEGREE_KEYS and value is not None else _format_fact(value)


def _format_fact_label(key: object) -> str:
    """A key as a heading, with its unit in brackets: ``Area (ha)``."""
    parts = str(key).split("_")
    unit = f" ({translate(_UNITS[parts.pop()])})" if len(parts) > 1 and parts[-1] in _UNITS else ""
    return translate_sentence(capitalize_first(" ".join(parts))) + unit


def _format_fact(value: Any, separator: str = "\n") -> str:
    """A value as text: six significant digits, lists with commas, entries of a mapping parted by `separator`."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if value is None or isinstance(value, bool):
        return format_yes_no(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return (
            separator.join(f"{_format_fact_label(label)}: {_format_fact(item, ', ')}" for label, item in value.items())
            or NO_VALUE
        )
    if isinstance(value, list | tuple):
        return ", ".join(_format_fact(item) for item in value) or NO_VALUE
    return escape_controls(str(value))


def build_parcels_table(parcels: Sequence[FieldSummary]) -> RenderableType:
    """Position, id, area in hectares and holes of every field, what it lies inside, and why it cannot be used."""
    figures: list[tuple[TableColumn, Callable[[FieldSummary], str]]] = [
        (TableColumn("#"), lambda one: str(one.position)),
        (TableColumn("ID", is_text=True), lambda one: one.key),
        (TableColumn("Area (ha)"), lambda one: format_number(one.area_ha, 2)),
        (TableColumn("Holes"), lambda one: NO_VALUE if one.holes is None else str(one.holes)),
    ]
    if any(one.inside for one in parcels):
        figures.append((TableColumn("Inside", is_text=True), lambda one: one.inside or ""))
    if any(one.fault for one in parcels):
        figures.append((TableColumn("Not usable", is_text=True), lambda one: one.fault))
    return build_table(parcels, figures)


def format_parcels_json(parcels: Sequence[FieldSummary]) -> str:
    """A list of objects: position, id, area_ha and holes (null if not usable), fault and inside (null or text)."""
    rows = [
        {
            "position": parcel.position,
            "id": parcel.key,
            "area_ha": None if parcel.area_ha is None else round(parcel.area_ha, 4),
            "holes": parcel.holes,
            "fault": parcel.fault or None,
            "inside": parcel.inside,
        }
        for parcel in parcels
    ]
    return format_json(rows)
