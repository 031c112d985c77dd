"""Set values in the text of a TOML file; every other byte is kept."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

from planner.errors import RequestError

_HEADER = re.compile(r"^\s*\[")


def set_value(text: str, section: str, number: int | None, key: str, value: str, comment: str) -> str:
    """The text with `key = value  # comment` in a section: [section], or the [[section]] with a number from 0.

    An existing line with the key is replaced; otherwise the line is added at the end of its section, and a missing
    [section] at the end of the file. Raises RequestError if the section is an inline table.
    """
    lines = text.splitlines(keepends=True)
    end = "\r\n" if "\r\n" in text else "\n"
    start, stop = _find_section_lines(lines, section, number)
    line = f"{key} = {value}  # {comment}{end}"
    if start is None:
        if section in tomllib.loads(text):
            raise RequestError(
                f"The farm file has {section} in one line; write it as a table under [{section}], one key per line."
            )
        newline_before = "" if not lines or lines[-1].endswith(("\n", "\r")) else end
        return f"{text}{newline_before}{end}[{section}]{end}{line}"
    key_pattern = re.compile(rf"^\s*[\"']?{re.escape(key)}[\"']?\s*=")
    for place in range(start + 1, stop):
        if key_pattern.match(lines[place]):
            lines[place] = line
            return "".join(lines)
    place = stop
    while place > start + 1 and not lines[place - 1].split("#")[0].strip():
        place -= 1
    if not lines[place - 1].endswith(("\n", "\r")):
        lines[place - 1] += end
    return "".join([*lines[:place], line, *lines[place:]])


def _find_section_lines(lines: list[str], section: str, number: int | None) -> tuple[int | None, int]:
    """The line of a section's heading (None if missing) and the line of the next heading."""
    heading = re.compile(rf"^\s*\[{re.escape(section)}\]" if number is None else rf"^\s*\[\[{re.escape(section)}\]\]")
    places = [place for place, line in enumerate(lines) if heading.match(line)]
    index = 0 if number is None else number
    if index >= len(places):
        return None, len(lines)
    start = places[index]
    next_headings = (place for place in range(start + 1, len(lines)) if _HEADER.match(lines[place]))
    return start, next(next_headings, len(lines))


def remove_blocks(text: str, section: str, keys: set[str]) -> str:
    """The text without the [[section]] blocks, written by `append_block`, whose `key` is one of `keys`."""
    lines = text.splitlines(keepends=True)
    output_lines: list[str] = []
    position = 0
    heading = re.compile(rf"^\[\[{re.escape(section)}\]\]\s*$")
    while position < len(lines):
        if heading.match(lines[position]):
            stop = next((n for n in range(position + 1, len(lines)) if _HEADER.match(lines[n])), len(lines))
            block = tomllib.loads("".join(lines[position:stop]))[section][0]
            if block.get("key") in keys:
                while output_lines and not output_lines[-1].strip() and stop == len(lines):
                    output_lines.pop()
                position = stop
                continue
        output_lines.append(lines[position])
        position += 1
    return "".join(output_lines)


def append_block(text: str, section: str, entries: Mapping[str, Any]) -> str:
    """The text with a [[section]] of these entries at its end."""
    end = "\r\n" if "\r\n" in text else "\n"
    newline_before = "" if not text or text.endswith(("\n", "\r")) else end
    body = "".join(f"{key} = {format_toml_value(value)}{end}" for key, value in entries.items())
    return f"{text}{newline_before}{end}[[{section}]]{end}{body}"


def format_toml_value(value: Any) -> str:
    """A number, a text, or a list of these, in TOML syntax."""
    if isinstance(value, str):
        inside = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(letter if letter.isprintable() else f"\\u{ord(letter):04x}" for letter in inside) + '"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(format_toml_value, value)) + "]"
    return repr(float(value)) if isinstance(value, float) else str(value)
