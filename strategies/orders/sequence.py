"""The order in which one tractor takes its tracks.

Tracks are grouped into cells, runs of neighbouring lines with one piece each, so that a hole or a notch is worked
around rather than jumped over line by line; tracks of two cells of the layout, with bearings of their own, are never
in one. In a cell the tracks are taken one after another, or in a pattern that
skips lines and comes back so that turns are wide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

from fields.layout import Layout, Track
from strategies.job import Job, Pass
from strategies.orders.table import TurnTable
from strategies.orders.tours import Tour, sharpened

CORNERS = [(last, way) for last in (False, True) for way in (1, -1)]
NEAR = 1.03  # orders whose estimates are this close are compared by the ways they would really drive
Cell = list[Track]
Order = list[Pass]


def cells_in(layout: Layout, tracks: list[Track]) -> list[Cell]:
    """Group tracks of a layout into cells, each within one cell of the layout, in the order of their first tracks."""
    return [
        cell
        for part in layout.cells
        for cell in cells_of([track for track in tracks if track.cell == part.number], part.bearing_rad)
    ]


def cells_of(tracks: list[Track], bearing_rad: float) -> list[Cell]:
    """Group tracks of one bearing: a piece joins the cell of the one before if each overlaps only the other."""
    by_line: dict[int, list[Track]] = {}
    for track in tracks:
        by_line.setdefault(track.line, []).append(track)
    lines = sorted(by_line)
    cells: list[Cell] = []
    last: dict[Track, Cell] = {}
    for number, line in enumerate(lines):
        before = by_line[lines[number - 1]] if number else []
        for track in by_line[line]:
            touching = [t for t in before if _overlap(t, track, bearing_rad)]
            alone = len(touching) == 1 and sum(_overlap(touching[0], t, bearing_rad) for t in by_line[line]) == 1
            cell = last[touching[0]] if alone else []
            if not alone:
                cells.append(cell)
            cell.append(track)
            last[track] = cell
    return cells


def _overlap(a: Track, b: Track, bearing_rad: float) -> bool:
    cosine, sine = math.cos(bearing_rad), math.sin(bearing_rad)

    def along(point: tuple[float, float]) -> float:
        return point[0] * cosine + point[1] * sine

    return along(a.start) < along(b.end) and along(b.start) < along(a.end)


def skip_pattern(count: int, jump: int) -> list[int]:
    """Indices 0..count-1 in an order that jumps `jump` ahead and `jump` - 1 back, block by block of 2 `jump`."""
    order: list[int] = []
    first = 0
    while first < count:
        size = min(2 * jump, count - first)
        half = (size + 1) // 2
        for index in range(half):
            order.append(first + index)
            if index + half < size:
                order.append(first + index + half)
        first += size
    return order


def jumps(job: Job) -> list[int]:
    """Patterns worth trying: one after another, and the two smallest jumps that leave room for a U-turn."""
    fitting = math.ceil(2.0 * job.manner.radius_m / job.layout.width_m)
    return [1] if fitting <= 1 else [1, fitting, fitting + 1]


def order_tracks(
    tracks: list[Track], job: Job, jump: int, corner: tuple[bool, int], last_piece: bool = False,
    cells: Sequence[Cell] | None = None,
) -> Order:  # fmt: skip
    """One order through all tracks, starting at a corner (from the last line?, first direction).

    Where the line of that corner is interrupted, it starts with its first piece or its last. `cells` are those of the
    tracks where they are known already.
    """
    cells = list(cells_in(job.layout, tracks) if cells is None else cells)
    start = _start(cells, job.layout, corner, last_piece)
    cells.remove(start)
    order = _through(start, jump, *corner)
    while cells:
        cell, option = _nearest(order[-1], cells, job)
        cells.remove(cell)
        order += _through(cell, jump, *option)
    return order


def _start(cells: Sequence[Cell], layout: Layout, corner: tuple[bool, int], last_piece: bool) -> Cell:
    """The cell that an order begins with."""
    from_last, _ = corner
    outer = -1 if from_last else 0
    first = _first_cells(list(cells), layout)
    edge = (max if from_last else min)(cell[outer].line for cell in first)
    pieces = (cell for cell in first if cell[outer].line == edge)
    return (max if last_piece else min)(pieces, key=lambda cell: cell[outer].piece)


def _first_cells(cells: list[Cell], layout: Layout) -> list[Cell]:
    """Those that an order may begin with: all, or with an entrance those of the layout's cell that is nearest to it."""
    entrance = layout.field.entrance
    if entrance is None or len(layout.cells) == 1:
        return cells
    ends = (
        (round(math.dist(entrance, end), 6), track.cell)
        for cell in cells for track in cell for end in (track.start, track.end)
    )  # fmt: skip
    home = min(ends)[1]
    return [cell for cell in cells if cell[0].cell == home]


def _through(cell: Cell, jump: int, from_last: bool, direction: int) -> Order:
    tracks = cell[::-1] if from_last else cell
    return [
        Pass(tracks[index], direction if turn % 2 == 0 else -direction)
        for turn, index in enumerate(skip_pattern(len(tracks), jump) if jump > 1 else range(len(tracks)))
    ]


def _nearest(here: Pass, cells: list[Cell], job: Job) -> tuple[Cell, tuple[bool, int]]:
    """The cell and the corner of it that is reached soonest from the end of a pass."""
    seconds = job.turns_from(here)
    options = [
        (seconds(Pass(cell[-1] if from_last else cell[0], direction)), index, from_last, direction)
        for index, cell in enumerate(cells)
        for from_last in (False, True)
        for direction in (-here.direction, here.direction)
    ]
    _, index, from_last, direction = min(options, key=lambda option: (round(option[0], 6), *option[1:]))
    return cells[index], (from_last, direction)


def _interrupted(cells: Sequence[Cell], layout: Layout, corner: tuple[bool, int]) -> bool:
    """Whether the line of a corner has a first piece and another last."""
    return _start(cells, layout, corner, True) is not _start(cells, layout, corner, False)


def order_time(order: Order, job: Job) -> float:
    """Estimated seconds for an order, turns and work."""
    work = sum(this.track.length for this in order) / job.manner.work_speed_mps
    return work + sum(job.turn_time(a, b) for a, b in pairwise(order))


def patterned(shares: list[list[Track]], job: Job, jump: int) -> list[Order]:
    """Orders in one pattern for several tractors at once, from the corner from which the slowest is quickest.

    Estimates settle it; close ones are compared by the ways really driven, so that the choice depends on the shape of
    the field and not on how it lies.
    """
    corners = [job.corner] if job.corner else CORNERS
    parts = [cells_in(job.layout, share) for share in shares]
    options = [
        [order_tracks(share, job, jump, corner, last_piece, part) for share, part in zip(shares, parts, strict=True)]
        for corner, last_piece in product(corners, (False, True))
        if not last_piece or any(_interrupted(part, job.layout, corner) for part in parts)
    ]
    gates = [[job.gate_time(order[0], order[-1]) for order in orders] for orders in options]
    times = [
        max(order_time(order, job) + way for order, way in zip(orders, ways, strict=True))
        for orders, ways in zip(options, gates, strict=True)
    ]
    near = [orders for orders, time in zip(options, times, strict=True) if time <= NEAR * min(times)]
    distinct = [orders for index, orders in enumerate(near) if orders not in near[:index]]
    if len(distinct) == 1:
        return distinct[0]

    def slowest(orders: list[Order]) -> float:
        return round(max(driven_time(order, job) + job.gate_time(order[0], order[-1]) for order in orders), 2)

    return min(distinct, key=slowest)


@dataclass(frozen=True, eq=False)
class Searched:
    """An order of passes, its seconds with the work, and the tour that it was found as."""

    order: Order
    seconds: float
    found: Tour

    @cached_property
    def gap_pct(self) -> float:
        """How much less the ways of another order could take at most, percent; worked out where it is asked for."""
        return sharpened(self.found).gap_pct


def searched(
    share: list[Track], job: Job, table: TurnTable, *, roughly: bool = False, proven: bool = True
) -> Searched:
    """The quickest order through some tracks by the ways that would be driven.

    `table` is that of all tracks of the layout. The search begins with the patterns in use and improves them
    (strategies.orders.tours). `roughly` is for comparing layouts: long ways are estimated, and the search ends early.
    Without `proven` the best of few tracks is not worked out.
    """
    place = {track: index for index, track in enumerate(job.layout.tracks)}
    cells = cells_in(job.layout, share)
    starts = [
        [place[one.track] for one in order_tracks(share, job, jump, corner, cells=cells)]
        for jump, corner in product(jumps(job), CORNERS)
    ]
    distinct = [start for index, start in enumerate(starts) if start not in starts[:index]]
    best = table.best([place[track] for track in share], distinct, roughly=roughly, proven=proven)
    work = sum(track.length for track in share) / job.manner.work_speed_mps
    return Searched([table.passes[p] for p in best.passes.tolist()], work + best.seconds, best)


def driven_time(order: Order, job: Job) -> float:
    """Seconds for an order with the ways that would really be driven; infinite where there is none."""
    ways = [job.way(job.exit(a), job.entry(b)) for a, b in pairwise(order)]
    turns = (math.inf if way is None else job.connector.cost(way) for way in ways)
    return sum(this.track.length for this in order) / job.manner.work_speed_mps + sum(turns)
