"""TOML and JSON from outside: nesting is counted before parsing, because parsing deeply nested text may take minutes.

The time of the TOML parser grows with the square of the number of parts of one key.
"""

from __future__ import annotations

import json
import re
import tomllib
from typing import Any

import numpy as np

MAX_TOML_LEVELS = 20
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


def parse_toml(text: str) -> dict[str, Any]:
    """The content of a TOML text.

    Raises:
        ValueError: the text is not TOML or nested too deeply.
        RecursionError: the parser ran out of stack.
    """
    bare = _TOML_STRING_OR_COMMENT.sub("", text)
    parts = 1 + max(piece.count(".") for piece in _BETWEEN_KEYS.split(bare))
    if parts > MAX_TOML_LEVELS:
        raise ValueError(f"a key in it has {parts} parts between dots; at most {MAX_TOML_LEVELS} are allowed")
    _check_levels(bare, MAX_TOML_LEVELS)
    return tomllib.loads(text)


def parse_json(text: str) -> Any:
    """The content of a JSON text; raises as `parse_toml`."""
    # Brackets inside strings are excluded only when it matters: files are often large but rarely deep.
    if _count_levels(text) > MAX_JSON_LEVELS:
        _check_levels(_JSON_STRING.sub("", text), MAX_JSON_LEVELS)
    return json.loads(text)


def _check_levels(text: str, max_levels: int) -> None:
    levels = _count_levels(text)
    if levels > max_levels:
        raise ValueError(f"it is nested {levels} levels deep; at most {max_levels} are allowed")


def _count_levels(text: str) -> int:
    """The largest number of brackets open at once."""
    brackets = text.encode("utf-8", "replace").translate(None, _NON_BRACKETS)
    steps = _BRACKET_STEPS[np.frombuffer(brackets, dtype=np.uint8)]
    return int(np.cumsum(steps, dtype=np.int64).max(initial=0))
