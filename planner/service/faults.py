"""What is wrong with values that were sent, as one sentence that names the value, its rule and the fix."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

DOCS = "/api/v1/docs shows what there is"
RULES = {
    "greater_than": "above {gt}", "greater_than_equal": "at least {ge}", "less_than": "below {lt}",
    "less_than_equal": "at most {le}", "multiple_of": "a multiple of {multiple_of}", "finite_number": "a finite number",
    "literal_error": "{expected}", "enum": "{expected}",
}  # fmt: skip
KINDS = {
    "float": "a number", "int": "a whole number", "bool": "true or false", "string": "text in quotes",
    "list": "a list", "tuple": "a list", "dict": "an object in braces", "model": "an object in braces",
    "datetime": "a time with its zone, such as 2026-05-04T08:00:00Z",
    "timezone": "a time with its zone, such as 2026-05-04T08:00:00Z",
}  # fmt: skip
COUNTED = {"string_too_short": "letters", "string_too_long": "letters", "too_short": "entries", "too_long": "entries"}
KIND, SHOWN = "kind", 40


def told_of(fault: Mapping[str, Any], place: str) -> str:
    """One fault that pydantic found, as a sentence; `place` is where, in the names that the sender knows.

    The value itself is told shortened, and never that of a key which is too long or has too many entries.
    """
    kind, context = str(fault["type"]), fault.get("ctx", {})
    if kind == "json_invalid":
        return f"{place} is not JSON: {context.get('error', 'it cannot be read')}."
    if kind == "missing":
        return f"{place} is missing; give it."
    if kind == "extra_forbidden":
        return f"{place} is unknown; {DOCS}."
    if kind == "union_tag_not_found":
        return f"{KIND} is missing; say with it what this is."
    if kind == "union_tag_invalid":
        return f"{KIND} is {_shown(context['tag'])}; use {_either(context['expected_tags'])}."
    if kind in COUNTED:
        return _counted(fault, place, COUNTED[kind])
    if kind == "string_pattern_mismatch":
        return f"{place} is {_shown(fault['input'])}, which has letters that it may not have; leave them out."
    if kind == "value_error":
        return f"{place} is {_shown(fault['input'])}: {str(context['error']).rstrip('.')}."
    return f"{place} is {_shown(fault['input'])}; {_rule(fault, kind, context)}."


def place_of(parts: Sequence[Any]) -> str:
    """Where a fault is: keys and numbers of entries with points between, keys of others shortened and printable."""
    return ".".join(json.dumps(str(part))[1:-1][:SHOWN] for part in parts)


def _rule(fault: Mapping[str, Any], kind: str, context: Mapping[str, Any]) -> str:
    if kind in RULES:
        return f"use {RULES[kind].format(**{name: _plain(value) for name, value in context.items()})}"
    wanted = KINDS.get(kind.partition("_")[0])
    words = " ".join(str(fault["msg"]).split()).rstrip(".")
    return f"give {wanted}" if wanted else words[:1].lower() + words[1:]


def _counted(fault: Mapping[str, Any], place: str, what: str) -> str:
    """Too few or too many letters or entries; how many there are is told where the value can be counted."""
    context = fault["ctx"]
    rule = f"at least {context['min_length']}" if "min_length" in context else f"at most {context['max_length']}"
    given = fault["input"]
    count = len(given) if isinstance(given, str | list | tuple | dict) else "other"
    return f"{place} has {count} {what}; give {rule}."


def _either(tags: str) -> str:
    """'a', 'b', 'c' as 'a', 'b' or 'c'."""
    *first, last = tags.split(", ")
    return f"{', '.join(first)} or {last}" if first else last


def _plain(value: Any) -> Any:
    """A limit without a decimal point that says nothing."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _shown(value: Any) -> str:
    """A value as it is sent, shortened."""
    try:
        text = json.dumps(value, default=str)
    except (RecursionError, ValueError):  # nested too deep, or a whole number of more digits than Python writes
        return "too large to show"
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 3]}..."
