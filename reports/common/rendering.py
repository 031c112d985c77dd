"""Pages from templates, plain values for JSON and CSV, and the error of all reports."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib.resources import files
from typing import Any

from fields.errors import HeadlandError
from reports.common import palette

EXPORT_DECIMALS = 6


class ReportError(HeadlandError):
    """A result that cannot be drawn or written.

    The message is one sentence: the value, the rule it breaks, and the fix.
    """


def make_json_safe(value: Any, decimals: int | None = None) -> Any:
    """Plain Python values: dataclasses by their fields, numpy values unpacked, tuples as lists, keys as text, floats
    that are not finite as None.

    With `decimals` floats are rounded, and -0.0 becomes 0.0.
    """
    if is_dataclass(value):
        value = pick_values(value, [field.name for field in fields(value)])
    if isinstance(value, Mapping):
        items = ((f"{key:g}" if isinstance(key, float) else str(key), item) for key, item in value.items())
        return {key: make_json_safe(item, decimals) for key, item in items}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [make_json_safe(item, decimals) for item in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if decimals is None else round(value, decimals) + 0.0
    return value


def pick_values(one: Any, keys: Iterable[str]) -> dict[str, Any]:
    """Attributes of a result by their names, as files have them."""
    return {key: getattr(one, key) for key in keys}


def format_json(data: Any, decimals: int | None = None, *, is_ascii: bool = True) -> str:
    """Values as JSON text with a trailing newline, made safe by `make_json_safe`."""
    return json.dumps(make_json_safe(data, decimals), indent=2, ensure_ascii=is_ascii, allow_nan=False) + "\n"


def format_csv(rows: Iterable[Sequence[Any]]) -> str:
    """Rows as CSV text."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def format_entries_csv(columns: Sequence[str], entries: Iterable[Any]) -> str:
    """A header and a row per entry (a mapping or a result), made safe by `make_json_safe`; empty cells where it lacks
    a column."""
    rows = make_json_safe(list(entries), EXPORT_DECIMALS)
    return format_csv([columns, *([format_csv_cell(row.get(name)) for name in columns] for row in rows)])


def format_csv_cell(value: Any) -> Any:
    """Nothing for None, and truth values as ``true`` and ``false``."""
    return "" if value is None else str(value).lower() if isinstance(value, bool) else value


def render_template(name: str, content: Mapping[str, Any]) -> str:
    """A page as HTML text: the template `name` of the package reports filled with `content`, values escaped."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    package_files = files("reports")
    environment = Environment(
        loader=FunctionLoader(lambda part: package_files.joinpath(part).read_text(encoding="utf-8")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    colours = {
        "states": list(palette.STATE_COLOURS),
        "state_colours": palette.STATE_COLOURS,
        "tractor_colours": list(zip(palette.TRACTOR_COLOURS, palette.DARK_TRACTOR_COLOURS, strict=True)),
    }
    return environment.get_template(name).render({**colours, **content}).rstrip() + "\n"
