"""The parts of a tour between which a tractor may be served: lines, and pieces of long ones."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from strategies.program.supply import Supply
from strategies.programmes.move_table import MoveTable
from strategies.programmes.waiting_places import HEADLAND_WAIT_M
from vehicle.missions.plan import HEADLAND_PASS

PIECES_OF_LOAD = 2  # a load lasts for so many pieces of a line that takes more, or most of each load would stay unused


@dataclass(frozen=True)
class TourPart:
    """One of the equal `pieces` of a line, the line of `line_m` metres driven as its node says."""

    node: int
    piece: int
    pieces: int
    line_m: float

    @property
    def first_m(self) -> float:
        """Where it begins along its line (m)."""
        return self.line_m * self.piece / self.pieces

    @property
    def last_m(self) -> float:
        """Where it ends along its line (m)."""
        return self.line_m * (self.piece + 1) / self.pieces

    @property
    def is_first(self) -> bool:
        """Whether its line begins with it."""
        return self.piece == 0

    @property
    def is_last(self) -> bool:
        """Whether its line ends with it."""
        return self.piece == self.pieces - 1

    def leads_to(self, other: TourPart) -> bool:
        """Whether another part of the same line follows without a move."""
        return (self.node, self.piece + 1, self.pieces) == (other.node, other.piece, other.pieces)

    def reverse(self, table: MoveTable) -> TourPart:
        """The same piece driven the other way."""
        return build_part(table, self.node ^ 1, self.pieces - 1 - self.piece, self.pieces)


def build_part(table: MoveTable, node: int, piece: int = 0, pieces: int = 1) -> TourPart:
    """A piece of a line of a table; the whole line by default."""
    return TourPart(node, piece, pieces, table.lines[node // 2].measure_path_m(node % 2))


def measure_line_need(table: MoveTable, supply: Supply, node: int) -> float:
    """What a whole line takes of a load."""
    return supply.compute_legs_need([table.moves.build_work_leg(node, 0.0)], table.site.width_m)


def cut_to_loads(table: MoveTable, supply: Supply, tour: Sequence[int]) -> tuple[TourPart, ...]:
    """The lines of a tour, those that take more than a load in pieces."""
    parts = []
    for node in tour:
        loads = measure_line_need(table, supply, node) / supply.include_trips().capacity
        count = 1 if loads <= 1.0 else math.ceil(PIECES_OF_LOAD * loads)
        parts += [build_part(table, node, piece, count) for piece in range(count)]
    return tuple(parts)


def cut_at_wait_points(table: MoveTable, parts: Iterable[TourPart]) -> list[TourPart]:
    """The parts of a tour, those of headland sides about as long as from one place to wait to the next."""
    cut = []
    for part in parts:
        is_side = table.lines[part.node // 2].task.kind == HEADLAND_PASS
        count = max(1, round((part.last_m - part.first_m) / HEADLAND_WAIT_M)) if is_side else 1
        cut += [
            TourPart(part.node, part.piece * count + number, part.pieces * count, part.line_m)
            for number in range(count)
        ]
    return cut
