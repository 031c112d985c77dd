"""The parts of a tour between which a tractor may be served: lines, pieces of long ones, and where a tractor stands.

A tractor that stands on the field and has used of its load may be served there, before the line that it begins with.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from strategies.programmes.move_table import MoveTable
from strategies.programmes.waiting_places import WAIT_STEP_M
from strategies.rules.supply import Supply
from vehicle.missions.plan import HEADLAND_PASS

PIECES_OF_LOAD = 2  # a load lasts for so many pieces of a line that takes more, or most of each load would stay unused


@dataclass(frozen=True)
class TourPart:
    """One of the equal `pieces` of a line, the line of `line_m` metres driven as its node says.

    One that `is_stand` is the place from which the line begins, and no piece of it.
    """

    node: int
    piece: int
    pieces: int
    line_m: float
    is_stand: bool = False

    @property
    def first_m(self) -> float:
        """Where it begins along its line (m)."""
        return self.line_m * self.piece / self.pieces

    @property
    def last_m(self) -> float:
        """Where it ends along its line (m)."""
        return 0.0 if self.is_stand else self.line_m * (self.piece + 1) / self.pieces

    @property
    def is_first(self) -> bool:
        """Whether its line begins with it."""
        return self.piece == 0

    @property
    def is_last(self) -> bool:
        """Whether its line ends with it."""
        return self.piece == self.pieces - 1 and not self.is_stand

    def leads_to(self, other: TourPart) -> bool:
        """Whether another part of the same line follows without a move."""
        if other.is_stand or self.node != other.node:
            return False
        if self.is_stand:
            return other.is_first
        return (self.piece + 1, self.pieces) == (other.piece, other.pieces)

    def reverse(self, table: MoveTable) -> TourPart:
        """The same piece driven the other way."""
        turned = build_part(table, self.node ^ 1, self.pieces - 1 - self.piece, self.pieces)
        return replace(turned, is_stand=self.is_stand)


def build_part(table: MoveTable, node: int, piece: int = 0, pieces: int = 1) -> TourPart:
    """A piece of a line of a table; the whole line by default."""
    return TourPart(node, piece, pieces, table.lines[node // 2].measure_path_m(node % 2))


def measure_line_need(table: MoveTable, supply: Supply, node: int) -> float:
    """What a whole line takes of a load."""
    return supply.compute_legs_need([table.moves.build_work_leg(node, 0.0)], table.site.width_m)


def cut_to_loads(table: MoveTable, supply: Supply, tour: Sequence[int]) -> tuple[TourPart, ...]:
    """The lines of a tour, those that take more than a load in pieces; first where its tractor stands with less."""
    parts = list[TourPart]()
    for node in tour:
        if table.moves.get_used(node) > 0.0:
            parts.append(replace(build_part(table, node), is_stand=True))
        loads = measure_line_need(table, supply, node) / supply.include_trips().capacity
        count = 1 if loads <= 1.0 else math.ceil(PIECES_OF_LOAD * loads)
        parts += [build_part(table, node, piece, count) for piece in range(count)]
    return tuple(parts)


def cut_at_wait_points(table: MoveTable, parts: Iterable[TourPart]) -> list[TourPart]:
    """The parts of a tour, those of headland sides about as long as from one place to wait to the next."""
    cut = []
    for part in parts:
        is_side = table.lines[part.node // 2].task.kind == HEADLAND_PASS and not part.is_stand
        count = max(1, round((part.last_m - part.first_m) / WAIT_STEP_M)) if is_side else 1
        cut += [replace(part, piece=part.piece * count + number, pieces=part.pieces * count) for number in range(count)]
    return cut
