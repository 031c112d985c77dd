"""Who goes first where two tractors come by the same place: in every draw whoever did in the simulation.

A plan says who waits for whom where that was needed at the times it was simulated with. With other times others meet,
and one has to give way. Kept in the planned order none can block another for ever, however late they are (as in
action dependency graphs: Hönig et al. 2019, IEEE Robotics and Automation Letters 4(2):1125).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely

from planner.chance.cutting import Cut, cut_legs
from vehicle.compile import outline
from vehicle.layout import REC_ANGLE, REC_POSE, REC_SPEED
from vehicle.missions import THROUGH_M, Gate, Plan
from vehicle.run import Run
from vehicle.tractor import Implement, Tractor

EVERY = 5  # rows of the 10 Hz record between outlines: under a metre of driving
PIECE_M = 6.0
PIECE_RAD = math.radians(25.0)
ROOM_M = 0.05  # kept around either machine
Array = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Ground that a machine covers on a short piece of a leg: (n,) of tractor, leg, row of the record at its
    beginning, metres along the leg and times; `leg_s` is when the leg began."""

    ground: npt.NDArray[np.object_]
    tractor: Whole
    leg: Whole
    row: Whole
    start_m: Array
    end_m: Array
    start_s: Array
    end_s: Array
    leg_s: Array


def in_planned_order(run: Run, tractor: Tractor, implement: Implement) -> Run:
    """The run of a plan with gates that keep the order in which its tractors came by every place two of them use.

    Legs are cut where a tractor has to wait on the way along one. None of the gates was closed in the run when its
    tractor came, so the run is that of the new plan too, but for braking before a gate that opens at the last moment.
    """
    if run.plan.tractors < 2:
        return run
    whole = _pieces(run, tractor, implement)
    cut = cut_legs(run, _cuts(whole))
    pieces = whole if cut is run else _pieces(cut, tractor, implement)
    plan = cut.plan
    for (waiter, leg), gates in _gates(pieces, plan).items():
        for gate in gates:
            plan = plan.with_gate(waiter, leg, gate)
    return replace(cut, plan=plan)


def _pairs(pieces: _Pieces) -> tuple[Whole, Whole]:
    """Numbers of pieces that share ground, of two tractors: the one that was done with it first, and the other."""
    first, second = shapely.STRtree(pieces.ground).query(pieces.ground, predicate="intersects")
    before = (pieces.tractor[first] != pieces.tractor[second]) & (pieces.end_s[first] <= pieces.start_s[second])
    return first[before], second[before]


def _cuts(pieces: _Pieces) -> dict[tuple[int, int], list[Cut]]:
    """As few places as will do at which the second of two can wait on its leg until the first is through."""
    first, second = _pairs(pieces)
    late = pieces.end_s[first] > pieces.leg_s[second]
    first, second = first[late], second[late]
    cuts: dict[tuple[int, int], list[Cut]] = {}
    last: dict[tuple[int, int], float] = {}
    for index in np.lexsort((first, pieces.start_s[second])).tolist():
        one, other = int(first[index]), int(second[index])
        key = int(pieces.tractor[other]), int(pieces.leg[other])
        if pieces.end_s[one] > last.get(key, -1.0):
            last[key] = float(pieces.start_s[other])
            cuts.setdefault(key, []).append(Cut(int(pieces.row[other]), float(pieces.start_m[other])))
    return cuts


def _gates(pieces: _Pieces, plan: Plan) -> dict[tuple[int, int], list[Gate]]:
    """Per tractor and leg the gates to be added: for every other tractor how far that must have come."""
    first, second = _pairs(pieces)
    open_then = pieces.end_s[first] <= pieces.leg_s[second]
    first, second = first[open_then], second[open_then]
    farthest: dict[tuple[int, int, int], tuple[int, float]] = {}
    for one, other in zip(first.tolist(), second.tolist(), strict=True):
        key = int(pieces.tractor[other]), int(pieces.tractor[one]), int(pieces.leg[other])
        place = int(pieces.leg[one]), float(pieces.end_m[one])
        farthest[key] = max(place, farthest.get(key, place))
    found: dict[tuple[int, int], list[Gate]] = {}
    reached: dict[tuple[int, int], tuple[int, float]] = {}
    for waiter, leader, leg in sorted(farthest):
        place = farthest[waiter, leader, leg]
        if place <= reached.get((waiter, leader), (-1, 0.0)):
            continue  # it has waited for as much before an earlier leg
        reached[waiter, leader] = place
        length = plan.missions[leader].legs[place[0]].length_m
        gate = Gate(leader, place[0], max(0.0, min(place[1], length - THROUGH_M)))
        found.setdefault((waiter, leg), []).append(gate)
    return found


def _pieces(run: Run, tractor: Tractor, implement: Implement) -> _Pieces:
    boxes = outline(tractor, implement)
    bodies = (
        _corners(boxes["nose"], boxes["tail"], boxes["half_width"]),
        _corners(boxes["tool_front"], boxes["tool_tail"], boxes["tool_half_width"]),
    )
    marks = np.concatenate([_marks(run, number) for number in range(run.plan.tractors)])
    ground = _hulls(run, marks, bodies)
    tractors, leg, row, _, *rest = np.repeat(marks, len(bodies), axis=0).T
    whole = (column.astype(np.int64) for column in (tractors, leg, row))
    return _Pieces(ground, *whole, *rest)


def _marks(run: Run, tractor: int) -> Array:
    """Tractor, leg, first and last row, start and end in metres of the leg and in s, and start of the leg in s."""
    finish = float(run.finish_s[tractor])
    count = max(2, int(np.searchsorted(run.time_s, finish - 1e-9)))
    on, record = run.leg(tractor)[:count], run.record[:count, tractor]
    step = np.diff(run.time_s[:count], append=run.time_s[count - 1])
    along = np.concatenate(([0.0], np.cumsum(np.abs(record[:, REC_SPEED]) * step)))
    angle = np.unwrap(record[:, REC_ANGLE])
    turned = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(angle)))))
    marks = []
    begins = np.flatnonzero(np.diff(on, prepend=-1))
    for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), count - 1], strict=True):
        leg = run.plan.missions[tractor].legs[int(on[begin])]
        scale = leg.length_m / max(along[end] - along[begin], 1e-6)
        first = begin
        while first < end:
            last = _piece_end(along, turned, first, end)
            near, far = ((along[row] - along[begin]) * scale for row in (first, last))
            times = run.time_s[first], run.time_s[last], run.time_s[begin]
            marks.append((tractor, on[begin], first, last, near, far, *times))
            first = last
    return np.array(marks, dtype=np.float64)


def _piece_end(along: Array, turned: Array, first: int, end: int) -> int:
    """Last row of a piece that begins at a row: so far, so much turned, or the end of the leg."""
    far = int(np.searchsorted(along, along[first] + PIECE_M))
    bent = int(np.searchsorted(turned, turned[first] + PIECE_RAD))
    return min(max(first + 1, min(far, bent)), end)


def _rows(first: int, last: int) -> Whole:
    return np.append(np.arange(first, last, EVERY), last)


def _corners(front: float, back: float, half: float) -> Array:
    """Corners of a box with room around it, forward and to the left of the centre of mass, (4, 2)."""
    front, back, half = front + ROOM_M, back - ROOM_M, half + ROOM_M
    return np.array([[front, half], [front, -half], [back, -half], [back, half]])


def _hulls(run: Run, marks: Array, bodies: tuple[Array, ...]) -> npt.NDArray[np.object_]:
    """What every body covers on each piece, bodies of a piece one after another; on a piece its poses differ little."""
    rows = [_rows(first, last) for first, last in marks[:, 2:4].astype(np.int64).tolist()]
    sizes = np.array([len(each) for each in rows])
    owner = np.repeat(np.arange(len(rows)), sizes)
    poses = run.record[np.concatenate(rows), marks[owner, 0].astype(np.int64), REC_POSE]
    cosine, sine = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    hulls = []
    for corners in bodies:
        x = poses[:, 0, None] + cosine * corners[:, 0] - sine * corners[:, 1]
        y = poses[:, 1, None] + sine * corners[:, 0] + cosine * corners[:, 1]
        places = np.column_stack([x.ravel(), y.ravel()])
        hulls.append(shapely.convex_hull(shapely.linestrings(places, indices=np.repeat(owner, len(corners)))))
    return np.column_stack(hulls).ravel()
