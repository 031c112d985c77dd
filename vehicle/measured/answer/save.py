"""A tractor as TOML text, effects and their origin included."""

from __future__ import annotations

import math
from typing import Any

from vehicle.tractor import Tractor


def tractor_toml(tractor: Tractor) -> str:
    """The file that `load_tractor` reads back as the same tractor."""
    values = tractor.model_dump(mode="python")
    plain = {key: value for key, value in values.items() if value is not None and not isinstance(value, dict)}
    lines = [f"{key} = {_value(value)}" for key, value in plain.items()]
    for name in ("steering", "guidance", "speed"):
        lines += _table(name, values[name])
    for ground, law in values["radius"].items():
        lines += _table(f"radius.{ground}", law)
    for effect, setting in values["effects"].items():
        lines += _table(f"effects.{effect}", setting)
    lines += _table("rest", values["rest"] or {})
    lines += _table("source", values["source"])
    return "\n".join(lines) + "\n"


def _table(name: str, values: dict[str, Any]) -> list[str]:
    if not values:
        return []
    return ["", f"[{name}]", *[f"{_key(key)} = {_value(value)}" for key, value in values.items()]]


def _key(key: str) -> str:
    return key if key.replace("_", "").isalnum() else _text(key)


def _text(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    # TOML allows no control characters in a string but as escapes.
    plain = "".join(one if one.isprintable() or ord(one) > 0x9F else f"\\u{ord(one):04x}" for one in escaped)
    return f'"{plain}"'


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_value(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(one) for one in value) + "]"
    number = float(value)
    if math.isinf(number):
        return "inf" if number > 0 else "-inf"
    return repr(number)
