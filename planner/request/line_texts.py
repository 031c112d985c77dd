"""Wishes for single tracks and headland passes, read from the texts of a request."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache

from planner.errors import HeadlandError, mark_parameter, shorten_value
from strategies.lines.line_wishes import LineName, LineWishes
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from vehicle.missions.plan import HEADLAND_PASS, SWATH

MOST_NAMED = 10_000
MOST_KEPT = 8  # wishes that are read: one request asks for its own many times
_NAMES = re.compile(
    r"(?P<ring>R)?(?P<first>\d{1,5})(?:-(?(ring)R?)(?P<last>\d{1,5})|(?P<piece>[a-z]{1,2})|\.(?P<side>\d{1,4}))?"
)


@lru_cache(maxsize=MOST_KEPT)
def read_line_wishes(leave_out: str | None, work_first: str | None, give: tuple[str, ...]) -> LineWishes:
    """The wishes of `leave_out` ("3,7-9"), `work_first` ("12,11") and `give` ("2=5-8"); raises HeadlandError."""
    out, first = (
        () if text is None else parse_line_names(text, parameter)
        for text, parameter in ((leave_out, "leave_out"), (work_first, "work_first"))
    )
    given, named = list[tuple[int, tuple[LineName, ...]]](), list[LineName]()
    for text in give:
        # "2=5-8" is a tractor and its lines.
        tractor, is_given, names = text.partition("=")
        number = int(tractor) if tractor.strip().isdecimal() and len(tractor.strip()) < 4 else 0
        if not is_given or number < 1:
            raise HeadlandError(
                f"{mark_parameter('give')} {shorten_value(text)} is not a tractor with its tracks; write for "
                "instance 2=5-8.",
                parameter="give",
            )
        given.append((number, parse_line_names(names, "give")))
        named += given[-1][1]
        _check_number(named, "give")
    left_out = frozenset(out)
    taken = set(left_out)
    for twice in sorted(named, key=lambda one: one.piece is not None):  # a piece after its whole
        if not taken.isdisjoint((twice, twice.whole)):
            raise HeadlandError(
                f"{twice} is named twice in {mark_parameter('leave_out')} and {mark_parameter('give')}; name it once.",
                parameter="give",
            )
        taken.add(twice)
    idle = next((name for name in first if not left_out.isdisjoint((name, name.whole))), None)
    if idle is not None:
        raise HeadlandError(
            f"{idle} is left out and worked first; take it from {mark_parameter('leave_out')} or "
            f"{mark_parameter('work_first')}.",
            parameter="leave_out",
        )
    return LineWishes(out, first, tuple(given))


def check_first_lines(wishes: LineWishes, headland_orders: Sequence[str]) -> None:
    """Raise HeadlandError for a line that is to come first where the only order of the headland needs the other."""
    if len(headland_orders) != 1:
        return
    is_headland_first = headland_orders[0] == HEADLAND_FIRST
    late = next((name for name in wishes.first if (name.kind == HEADLAND_PASS) != is_headland_first), None)
    if late is not None:
        before = "headland" if is_headland_first else "tracks"
        raise HeadlandError(
            f"{mark_parameter('work_first')} names {late}, and this operation has to work the {before} first; "
            f"leave out {late}, or change {mark_parameter('operation')}.",
            parameter="work_first",
        )


def parse_line_names(text: str, parameter: str) -> tuple[LineName, ...]:
    """Names of tracks, a range of them, a piece, a headland pass, one of its sides: "3,7-9,5b,R1,R2.4".

    Raises HeadlandError, also for more than any layout has.
    """
    names = list[LineName]()
    for part in text.split(","):
        found = _NAMES.fullmatch(part.strip())
        last = found and int(found["last"] or found["first"])
        # Tracks have pieces and headland passes sides, both counted from 1.
        is_wrong = found and (found["piece" if found["ring"] else "side"] or found["side"] == "0")
        if found is None or last is None or is_wrong or not 1 <= int(found["first"]) <= last <= MOST_NAMED:
            raise HeadlandError(
                f"{mark_parameter(parameter)} holds {shorten_value(part)}, which names no track; write tracks and "
                "headland passes as the map does, for instance 3,7-9,5b,R1.",
                parameter=parameter,
            )
        kind = HEADLAND_PASS if found["ring"] else SWATH
        piece = int(found["side"]) - 1 if found["side"] else None
        for letter in found["piece"] or "":
            piece = 26 * (0 if piece is None else piece + 1) + ord(letter) - ord("a")
        first = int(found["first"])
        names += [LineName(kind, number, piece, first < number < last) for number in range(first, last + 1)]
        _check_number(names, parameter)
    return tuple(dict.fromkeys(names))


def _check_number(names: Sequence[LineName], parameter: str) -> None:
    """Raise HeadlandError for more names than any layout has lines."""
    if len(names) > MOST_NAMED:
        raise HeadlandError(
            f"{mark_parameter(parameter)} names more than {MOST_NAMED:,} tracks; name those of the map only.",
            parameter=parameter,
        )
