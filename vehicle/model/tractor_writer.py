"""Writes a tractor as TOML, with its effects and their origin."""

from __future__ import annotations

from typing import Any

import tomlkit

from vehicle.model.tractor import Tractor


def format_tractor_toml(tractor: Tractor) -> str:
    """The file that `load_tractor` reads back as the same tractor."""
    values = tractor.model_dump(mode="python")
    lines = _format_entries({key: value for key, value in values.items() if not isinstance(value, dict)})
    for name in ("steering", "guidance", "speed", "engine", "battery", "tyres", "stability"):
        lines += _format_table(name, values[name] or {})
    for group in ("radius", "effects"):
        for name, entries in values[group].items():
            lines += _format_table(f"{group}.{name}", entries)
    lines += _format_table("discrepancy_model", values["discrepancy_model"] or {})
    lines += _format_table("source", values["source"])
    return "\n".join(lines) + "\n"


def _format_table(name: str, values: dict[str, Any]) -> list[str]:
    return ["", f"[{name}]", *_format_entries(values)] if values else []


def _format_entries(values: dict[str, Any]) -> list[str]:
    """A line for every value that is known, tables in braces."""
    known = {key: value for key, value in values.items() if value is not None}
    return [f"{tomlkit.key(key).as_string()} = {_format_value(value)}" for key, value in known.items()]


def _format_value(value: Any) -> str:
    if isinstance(value, dict):
        table = tomlkit.inline_table()
        table.update(value)
        return table.as_string()
    text: str = tomlkit.item(value).as_string()
    return text
