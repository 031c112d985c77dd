"""Values put into the text of a TOML file; every other byte stays as it is."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

from planner.errors import ScenarioError

_HEADER = re.compile(r"^\s*\[")


def with_value(text: str, section: str, number: int | None, key: str, value: str, comment: str) -> str:
    """The text with `key = value  # comment` in a section: [section], or the [[section]] of a number from 0.

    A line that has the key keeps its place; without one it goes to the end of its section, and a [section] that is not
    there to the end of the file. Raises ScenarioError where the section is written in another way.
    """
    lines = text.splitlines(keepends=True)
    end = "\r\n" if "\r\n" in text else "\n"
    start, stop = _block(lines, section, number)
    line = f"{key} = {value}  # {comment}{end}"
    if start is None:
        if section in tomllib.loads(text):
            raise ScenarioError(
                f"The farm file has {section} in one line; write it as a table under [{section}], one key a line."
            )
        gap = "" if not lines or lines[-1].endswith(("\n", "\r")) else end
        return f"{text}{gap}{end}[{section}]{end}{line}"
    own = re.compile(rf"^\s*[\"']?{re.escape(key)}[\"']?\s*=")
    for place in range(start + 1, stop):
        if own.match(lines[place]):
            lines[place] = line
            return "".join(lines)
    place = stop
    while place > start + 1 and not lines[place - 1].split("#")[0].strip():
        place -= 1
    if not lines[place - 1].endswith(("\n", "\r")):
        lines[place - 1] += end
    return "".join([*lines[:place], line, *lines[place:]])


def _block(lines: list[str], section: str, number: int | None) -> tuple[int | None, int]:
    """The line of a section's heading, None without one, and the line of the next heading."""
    mark = re.compile(rf"^\s*\[{re.escape(section)}\]" if number is None else rf"^\s*\[\[{re.escape(section)}\]\]")
    places = [place for place, line in enumerate(lines) if mark.match(line)]
    wanted = 0 if number is None else number
    if wanted >= len(places):
        return None, len(lines)
    start = places[wanted]
    after = (place for place in range(start + 1, len(lines)) if _HEADER.match(lines[place]))
    return start, next(after, len(lines))


def without_blocks(text: str, section: str, keys: set[str]) -> str:
    """The text without those [[section]] blocks whose `key` is one of `keys`, as `with_block` wrote them."""
    lines = text.splitlines(keepends=True)
    kept: list[str] = []
    place = 0
    heading = re.compile(rf"^\[\[{re.escape(section)}\]\]\s*$")
    while place < len(lines):
        if heading.match(lines[place]):
            stop = next((n for n in range(place + 1, len(lines)) if _HEADER.match(lines[n])), len(lines))
            block = tomllib.loads("".join(lines[place:stop]))[section][0]
            if block.get("key") in keys:
                while kept and not kept[-1].strip() and stop == len(lines):
                    kept.pop()
                place = stop
                continue
        kept.append(lines[place])
        place += 1
    return "".join(kept)


def with_block(text: str, section: str, entries: Mapping[str, Any]) -> str:
    """The text with a [[section]] of these entries at its end."""
    end = "\r\n" if "\r\n" in text else "\n"
    gap = "" if not text or text.endswith(("\n", "\r")) else end
    body = "".join(f"{key} = {written(value)}{end}" for key, value in entries.items())
    return f"{text}{gap}{end}[[{section}]]{end}{body}"


def written(value: Any) -> str:
    """A number, a text, or a list of those, as TOML has it."""
    if isinstance(value, str):
        inside = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(letter if letter.isprintable() else f"\\u{ord(letter):04x}" for letter in inside) + '"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(written, value)) + "]"
    return repr(float(value)) if isinstance(value, float) else str(value)
