"""Faults that pydantic finds in values, as one sentence that names the value, its rule and the fix."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

DOCS_HINT = "the API is documented at /api/v1/docs"
RULE_TEXTS = {
    "greater_than": "above {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "below {lt}",
    "less_than_equal": "at most {le}",
    "multiple_of": "a multiple of {multiple_of}",
    "finite_number": "a finite number",
    "literal_error": "{expected}",
    "enum": "{expected}",
}
TYPE_TEXTS = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "string": "text in quotes",
    "list": "a list",
    "tuple": "a list",
    "dict": "an object in braces",
    "model": "an object in braces",
    "datetime": "a time with its zone, such as 2026-05-04T08:00:00Z",
    "timezone": "a time with its zone, such as 2026-05-04T08:00:00Z",
}
COUNTED_UNITS = {
    "string_too_short": "letters",
    "string_too_long": "letters",
    "too_short": "entries",
    "too_long": "entries",
}
TAG_KEY, LONGEST_SHOWN_CHARS = "kind", 40


def describe_fault(fault: Mapping[str, Any], location: str) -> str:
    """One fault that pydantic found, as a sentence; `location` is in the names that the sender knows.

    The value is shortened, and left out where it is too long or has too many entries.
    """
    kind, context = str(fault["type"]), fault.get("ctx", {})
    if kind == "json_invalid":
        return f"{location} is not JSON: {context.get('error', 'it cannot be read')}."
    if kind == "missing":
        return f"{location} is missing; give it."
    if kind == "extra_forbidden":
        return f"{location} is unknown; {DOCS_HINT}."
    if kind == "union_tag_not_found":
        return f"{TAG_KEY} is missing; give the kind of this object."
    if kind == "union_tag_invalid":
        return f"{TAG_KEY} is {_shorten_value(context['tag'])}; use {_join_alternatives(context['expected_tags'])}."
    if kind in COUNTED_UNITS:
        return _describe_count(fault, location, COUNTED_UNITS[kind])
    if kind == "string_pattern_mismatch":
        return f"{location} is {_shorten_value(fault['input'])}, with characters that are not allowed; leave them out."
    if kind == "value_error":
        return f"{location} is {_shorten_value(fault['input'])}: {str(context['error']).rstrip('.')}."
    return f"{location} is {_shorten_value(fault['input'])}; {_describe_broken_rule(fault, kind, context)}."


def format_location(parts: Sequence[Any]) -> str:
    """Where a fault is: keys and numbers of entries, joined by dots; keys are shortened and made printable."""
    return ".".join(json.dumps(str(part))[1:-1][:LONGEST_SHOWN_CHARS] for part in parts)


def _describe_broken_rule(fault: Mapping[str, Any], kind: str, context: Mapping[str, Any]) -> str:
    if kind in RULE_TEXTS:
        return f"use {RULE_TEXTS[kind].format(**{name: _drop_zero_decimals(value) for name, value in context.items()})}"
    expected_type = TYPE_TEXTS.get(kind.partition("_")[0])
    words = " ".join(str(fault["msg"]).split()).rstrip(".")
    return f"give {expected_type}" if expected_type else words[:1].lower() + words[1:]


def _describe_count(fault: Mapping[str, Any], location: str, unit: str) -> str:
    """Too few or too many letters or entries, with their number where it can be counted."""
    context = fault["ctx"]
    rule = f"at least {context['min_length']}" if "min_length" in context else f"at most {context['max_length']}"
    value = fault["input"]
    count = len(value) if isinstance(value, str | list | tuple | dict) else "other"
    return f"{location} has {count} {unit}; give {rule}."


def _join_alternatives(tags: str) -> str:
    """'a', 'b', 'c' as 'a', 'b' or 'c'."""
    *first, last = tags.split(", ")
    return f"{', '.join(first)} or {last}" if first else last


def _drop_zero_decimals(value: Any) -> Any:
    """A limit without a needless decimal point."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _shorten_value(value: Any) -> str:
    """A value as it was sent, shortened."""
    text = ""
    try:
        for part in json.JSONEncoder(default=str).iterencode(_cut_text(value)):  # only as much as is shown
            text += part
            if len(text) > LONGEST_SHOWN_CHARS:
                return f"{text[: LONGEST_SHOWN_CHARS - 3]}..."
    except (RecursionError, ValueError):  # nested too deep, or a whole number of more digits than Python writes
        return "too large to show"
    return text


def _cut_text(value: Any) -> Any:
    """A text cut to what is shown of it."""
    return value[: LONGEST_SHOWN_CHARS + 1] if isinstance(value, str) else value
