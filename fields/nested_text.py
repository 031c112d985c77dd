"""TOML and JSON from outside, refused in plain words.

Nesting is counted before parsing, because parsing deeply nested text may take minutes. The time of the TOML parser
grows with the square of the number of parts of one key.
"""

from __future__ import annotations

import json
import re
import tomllib
from typing import Any

import numpy as np

from fields.errors import shorten_value

MAX_TOML_LEVELS = 20
MAX_SHOWN_CHARS = 36  # of a line with a fault
MAX_JSON_LEVELS = 50  # GeoJSON itself needs 12; properties of a feature may need a few more
# An unclosed string matches up to the end of its line or text, so that no part of the text is scanned twice.
_TOML_STRING_OR_COMMENT = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+(?:"""+)?|' r"'''(?:[^']|'(?!''))*+(?:'''+)?|"
    r'"(?:[^"\\\n]|\\.)*+"?|' r"'[^'\n]*+'?|#[^\n]*",
    re.DOTALL,
)  # fmt: skip
_JSON_STRING = re.compile(r'"(?:[^"\\]|\\.)*+"?', re.DOTALL)
_BETWEEN_KEYS = re.compile(r"[=,\[\]{}\n]")
_NON_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
_BRACKET_STEPS = np.zeros(256, dtype=np.int8)
_BRACKET_STEPS[list(b"[{")], _BRACKET_STEPS[list(b"]}")] = 1, -1
_PARSER_PLACE = re.compile(r"line (\d+), column (\d+)")
_FAULTS = (
    (("Expected '=", "Expecting ':"), "a key is not followed by = or : and its value"),
    (("Expected newline",), "a value goes on after its end: write texts in quotes, and decimals with a point"),
    (("Invalid value", "Expecting value"), "a value is missing or is no number, true, false, list or text in quotes"),
    (("Invalid statement",), "there is no key and no [heading]"),
    (("Cannot",), "there is a key or [heading] a second time"),
    (("Unescaped", "Invalid \\"), "a text has a backslash: write / instead"),
    (("Illegal character", "Invalid control", "Unterminated", 'Expected "'), "a text has no closing quote"),
    (("Expecting property",), "there is no name in double quotes"),
    (("Illegal trailing",), "there is a comma before a closing bracket"),
    (("Unclosed", "Expecting ',", "Expected"), "a comma or a closing bracket is missing"),
    (("Extra data",), "there is more after the end"),
    (("",), "something is not written as it should be"),
)
"""How complaints of the parsers begin, as these give no code, and what they mean to people; the last is for others."""


def parse_toml(text: str) -> dict[str, Any]:
    """The content of a TOML text; raises ValueError, in a few words, for what is not TOML or nested too deeply."""
    bare = _TOML_STRING_OR_COMMENT.sub("", text)
    parts = 1 + max(piece.count(".") for piece in _BETWEEN_KEYS.split(bare))
    if parts > MAX_TOML_LEVELS:
        raise ValueError(f"a key in it has {parts} parts between dots; at most {MAX_TOML_LEVELS} are allowed")
    _check_levels(bare, MAX_TOML_LEVELS)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        place = _PARSER_PLACE.search(str(error))
        raise ValueError(_explain_parse_error(error, text, *map(int, place.groups() if place else ()))) from None


def parse_json(text: str) -> Any:
    """The content of a JSON text; raises as `parse_toml`."""
    # Brackets inside strings are excluded only when it matters: files are often large but rarely deep.
    if _count_levels(text) > MAX_JSON_LEVELS:
        _check_levels(_JSON_STRING.sub("", text), MAX_JSON_LEVELS)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        is_at_end = error.pos >= len(text.rstrip())
        place = () if is_at_end else (error.lineno, error.colno)
        raise ValueError(_explain_parse_error(error, text, *place)) from None
    except (ValueError, RecursionError) as error:
        raise ValueError(_explain_parse_error(error, text)) from None


def _explain_parse_error(error: BaseException, text: str, line: int = 0, column: int = 0) -> str:
    """Why a text is not JSON or TOML, in plain words; `line` and `column` count from 1, 0 is the end of the text."""
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if "string conversion" in str(error):
        return "it contains an integer with thousands of digits"
    fault = next(words for beginnings, words in _FAULTS if str(error).startswith(beginnings))
    if not line:
        return f"{fault}, at its end"
    shown = text.split("\n")[line - 1]
    shown = shown if len(shown) <= MAX_SHOWN_CHARS else shown[max(0, column - MAX_SHOWN_CHARS // 2) :]
    return f"{fault}, in line {line}: {shorten_value(shown.strip())}"


def _check_levels(text: str, max_levels: int) -> None:
    levels = _count_levels(text)
    if levels > max_levels:
        raise ValueError(f"it is nested {levels} levels deep; at most {max_levels} are allowed")


def _count_levels(text: str) -> int:
    """The largest number of brackets open at once."""
    brackets = text.encode("utf-8", "replace").translate(None, _NON_BRACKETS)
    steps = _BRACKET_STEPS[np.frombuffer(brackets, dtype=np.uint8)]
    return int(np.cumsum(steps, dtype=np.int64).max(initial=0))
