"""Writes a tractor as TOML, with its effects and their origin."""

from __future__ import annotations

import math
from typing import Any

from vehicle.model.tractor import Tractor


def format_tractor_toml(tractor: Tractor) -> str:
    """The file that `load_tractor` reads back as the same tractor."""
    values = tractor.model_dump(mode="python")
    plain_values = {key: value for key, value in values.items() if value is not None and not isinstance(value, dict)}
    lines = [f"{key} = {_format_value(value)}" for key, value in plain_values.items()]
    for name in ("steering", "guidance", "speed", "engine", "battery", "tyres", "stability"):
        lines += _format_table(name, values[name] or {})
    for ground, law in values["radius"].items():
        lines += _format_table(f"radius.{ground}", law)
    for effect, setting in values["effects"].items():
        lines += _format_table(f"effects.{effect}", setting)
    lines += _format_table("discrepancy_model", values["discrepancy_model"] or {})
    lines += _format_table("source", values["source"])
    return "\n".join(lines) + "\n"


def _format_table(name: str, values: dict[str, Any]) -> list[str]:
    if not values:
        return []
    known = {key: value for key, value in values.items() if value is not None}
    return ["", f"[{name}]", *[f"{_format_key(key)} = {_format_value(value)}" for key, value in known.items()]]


def _format_key(key: str) -> str:
    return key if key.replace("_", "").isalnum() else _quote_text(key)


def _quote_text(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    # TOML allows control characters in a string only as escapes.
    printable = "".join(
        character if character.isprintable() or ord(character) > 0x9F else f"\\u{ord(character):04x}"
        for character in escaped
    )
    return f'"{printable}"'


def _format_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quote_text(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_format_key(key)} = {_format_value(element)}" for key, element in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_format_value(element) for element in value) + "]"
    number = float(value)
    if math.isinf(number):
        return "inf" if number > 0 else "-inf"
    return repr(number)
