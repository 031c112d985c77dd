"""What somebody wants of single work lines: left out, worked before all others, or worked by one tractor."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from fields.arrays import Flags
from fields.errors import HeadlandError
from strategies.lines.work_line import WorkLine
from strategies.path_planning.errors import StrategyError
from vehicle.missions.plan import HEADLAND_PASS, SWATH, LegTask


@dataclass(frozen=True)
class LineName:
    """A track as maps number it, or a headland pass (R2); None as the piece means all pieces or sides.

    One inside a range of names need not be there: layouts leave numbers out.
    """

    kind: str
    number: int
    piece: int | None = None
    is_in_range: bool = field(default=False, compare=False)

    @property
    def whole(self) -> LineName:
        """The track or headland pass of which it is all or a piece."""
        return LineName(self.kind, self.number)

    def __str__(self) -> str:
        if self.kind == HEADLAND_PASS:
            return f"R{self.number}" if self.piece is None else f"R{self.number}.{self.piece + 1}"
        return f"{self.number}" if self.piece is None else f"{self.number}{format_piece_letter(self.piece)}"


def format_piece_letter(piece: int) -> str:
    """a to z, then aa, ab, ... for pieces counted from 0."""
    return (format_piece_letter(piece // 26 - 1) if piece >= 26 else "") + chr(ord("a") + piece % 26)


def name_line(task: LegTask) -> str:
    """The name of the line of a task, as wishes have it: 14, 14b, R1, R1.2."""
    return str(LineName(task.kind, get_line_number(task), task.piece if task.is_piece else None))


def get_line_number(task: LegTask) -> int:
    """The number of the swath or headland pass of a line, from 1."""
    return (task.number or 0) + (task.kind == SWATH)


def _list_names_of(task: LegTask) -> tuple[LineName, ...]:
    """What may name the line of a task: all of its track or headland pass, or its piece or side."""
    if task.number is None:
        return ()
    name = LineName(task.kind, get_line_number(task), task.piece)
    return name.whole, name


@dataclass(frozen=True)
class LineWishes:
    """What somebody wants of lines; empty by default.

    Attributes:
        left_out: lines that nobody works.
        first: lines that come before all others, in this order.
        given: pairs of a tractor, counted from 1, and the lines that it alone works.
    """

    left_out: tuple[LineName, ...] = ()
    first: tuple[LineName, ...] = ()
    given: tuple[tuple[int, tuple[LineName, ...]], ...] = ()

    def __bool__(self) -> bool:
        return bool(self.left_out or self.first or self.given)

    def check(self, lines: Sequence[WorkLine], tractors: int, most_tractors: int) -> None:
        """Raise HeadlandError for a line that is not there and a tractor that no plan has.

        Raises StrategyError for one that plans of `most_tractors` have, and this one has not.
        """
        tasks = [line.task for line in lines if line.task.is_work]
        there = {name for task in tasks for name in _list_names_of(task)}
        named = (*self.left_out, *self.first, *(name for _, names in self.given for name in names))
        unknown = next((name for name in named if not name.is_in_range and name not in there), None)
        if unknown is not None:
            raise HeadlandError(f"{unknown} names no work of this layout, which has {_describe_lines(tasks)}.")
        beyond = next((tractor for tractor, _ in self.given if tractor > tractors), None)
        if beyond is not None:
            have = "there is only 1 tractor" if tractors == 1 else f"there are only {tractors} tractors"
            error = HeadlandError if beyond > most_tractors else StrategyError
            raise error(f"Tracks are given to tractor {beyond}, and {have}.")

    def find_left_out(self, lines: Sequence[WorkLine]) -> list[int]:
        """The numbers of lines that nobody is to work."""
        return _find_lines(self.left_out, lines)

    def limit(self, lines: Sequence[WorkLine], allowed: Flags) -> Flags:
        """Which lines (tractors, n) tractors may work of those `allowed`; a line that is given is its tractor's."""
        allowed = allowed.copy()
        for tractor, names in self.given:
            given = _find_lines(names, lines)
            allowed[:, given], allowed[tractor - 1, given] = False, True
        allowed[:, self.find_left_out(lines)] = False
        return allowed

    def rank(self, lines: Sequence[WorkLine], stages: Sequence[int]) -> list[int]:
        """Stages of lines in which those that come first have each one of its own before all others."""
        places = {name: place for place, name in enumerate(self.first)}
        later = len(self.first)
        return [
            min((places[name] for name in _list_names_of(line.task) if name in places), default=stage + later)
            for line, stage in zip(lines, stages, strict=True)
        ]


def _find_lines(names: Iterable[LineName], lines: Sequence[WorkLine]) -> list[int]:
    named = frozenset(names)
    return [number for number, line in enumerate(lines) if not named.isdisjoint(_list_names_of(line.task))]


def _describe_lines(tasks: Sequence[LegTask]) -> str:
    """ "1-24, R1-R2": the numbers of tracks and headland passes."""
    tracks = sorted({(task.number or 0) + 1 for task in tasks if task.kind == SWATH})
    passes = sorted({task.number or 0 for task in tasks if task.kind == HEADLAND_PASS})
    spans = ((letter, {some[0], some[-1]}) for letter, some in (("", tracks), ("R", passes)) if some)
    return ", ".join("-".join(f"{letter}{one}" for one in sorted(ends)) for letter, ends in spans)
