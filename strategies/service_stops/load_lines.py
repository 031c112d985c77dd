"""Work lines cut where one load does not last for a whole line, so that a tractor may leave for the next in between."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from strategies.lines.work_line import WorkLine, cut_line
from strategies.program.supply import Supply
from strategies.site.site import Site
from vehicle.missions.plan import Leg

PIECES_OF_LOAD = 2  # a load lasts for so many pieces of a line that is cut, or most of each load would stay unused


def cut_to_loads(lines: Sequence[WorkLine], supply: Supply, site: Site) -> list[WorkLine]:
    """The lines, those that take more than a load in equal pieces; all pieces of a line are numbered anew."""
    return _number_pieces([piece for line in lines for piece in _cut_line(line, supply, site)])


def _cut_line(line: WorkLine, supply: Supply, site: Site) -> Iterator[WorkLine]:
    legs = [Leg(path, site.rules.work_speed_mps, 1, True, task=line.task) for path in line.paths]
    loads = max(supply.compute_legs_need([leg], site.width_m) for leg in legs) / supply.capacity
    count = 1 if loads <= 1.0 else math.ceil(PIECES_OF_LOAD * loads)
    for number in range(count):
        there, back = (
            cut_line(path, length_m * first / count, length_m * (first + 1) / count)
            for path, length_m, first in (
                (line.paths[0], line.measure_path_m(0), number),
                (line.paths[1], line.measure_path_m(1), count - 1 - number),
            )
        )
        yield line if count == 1 else replace(line, paths=(there, back), own_m2=line.own_m2 / count)


def _number_pieces(lines: Sequence[WorkLine]) -> list[WorkLine]:
    """The lines with the pieces of every swath or side numbered in order."""
    counts: dict[tuple[str, int | None], int] = {}
    numbered = []
    for line in lines:
        key = line.task.kind, line.task.number
        numbered.append(replace(line, task=replace(line.task, piece=counts.get(key, 0))))
        counts[key] = counts.get(key, 0) + 1
    return numbered
