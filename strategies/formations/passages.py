"""How the tractors of a formation pass the headland on their way to a round, measured in a run."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from strategies.formations.abreast import Slot
from strategies.formations.formation import Formation
from strategies.job import Job
from vehicle.compile import outline
from vehicle.layout import REC_ANGLE, REC_PLACE, REC_X, REC_Y
from vehicle.run import Run
from vehicle.tractor import Implement, Tractor

STRETCH_M = 1.5
BEFORE_LINE_M = 1.0  # a tractor is on the headland when any part of it is less than this short of the line
IN_PLACE_M = 0.3
TICKS_PER_S = 10
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Passage:
    """One tractor's way through a headland after its release, measured in a run.

    `taken` maps a stretch to (first, last) seconds on it; `metres` (t,) is the distance at 10 Hz; `placed_s` when it
    is in place.
    """

    tractor: int
    taken: dict[int, tuple[float, float]]
    metres: Floats
    placed_s: float


def passages(
    job: Job, formation: Formation, run: Run, number: int, tractor: Tractor, implement: Implement
) -> list[Passage]:
    """The passages of all tractors of a round, in the order of its slots."""
    return [_passage(job, formation, run, number, slot, tractor, implement) for slot in formation.rounds[number]]


def _passage(
    job: Job, formation: Formation, run: Run, number: int, slot: Slot, tractor: Tractor, implement: Implement
) -> Passage:
    """Cut one tractor's passage out of the record and note which stretches its outline covers when."""
    marks = formation.marks[number, slot.tractor]
    legs = run.leg(slot.tractor)
    first, last = int(np.argmax(legs >= marks.release)), int(np.argmax(legs >= marks.work))
    poses = run.poses(slot.tractor)[first : max(last, first + 2)]
    along, across = outline_extents(job, slot, poses, tractor, implement)
    line = _line(job, slot)
    taken: dict[int, tuple[float, float]] = {}
    for index in np.flatnonzero(along > line - BEFORE_LINE_M):
        low, high = across[index]
        for stretch in range(math.floor(low / STRETCH_M), math.floor(high / STRETCH_M) + 1):
            start = taken.get(stretch, (index / TICKS_PER_S, 0.0))[0]
            taken[stretch] = start, (index + 1) / TICKS_PER_S
    metres = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, REC_PLACE], axis=0).T))))
    placed = int(np.argmax(metres > metres[-1] - IN_PLACE_M))
    return Passage(slot.tractor, taken, metres, placed / TICKS_PER_S)


def outline_extents(
    job: Job, slot: Slot, poses: Floats, tractor: Tractor, implement: Implement
) -> tuple[Floats, Floats]:
    """How far the outline reaches out of the track (t,), and its extent along the headland (t, 2)."""
    heading = job.heading(slot.this) + math.pi  # out of the track just worked is against the coming pass
    out = np.array([math.cos(heading), math.sin(heading)])
    side = np.array([-out[1], out[0]]) * (1 if slot.this.direction > 0 else -1)
    corners = _corners(outline(tractor, implement))
    cosine, sine = np.cos(poses[:, REC_ANGLE]), np.sin(poses[:, REC_ANGLE])
    x = poses[:, REC_X, None] + corners[:, 0] * cosine[:, None] - corners[:, 1] * sine[:, None]
    y = poses[:, REC_Y, None] + corners[:, 0] * sine[:, None] + corners[:, 1] * cosine[:, None]
    along = (x * out[0] + y * out[1]).max(axis=1)
    across = x * side[0] + y * side[1]
    return along, np.column_stack([across.min(axis=1), across.max(axis=1)])


def _corners(boxes: dict[str, float]) -> Floats:
    """Corners of the boxes of tractor and implement (8, 2), forward and to the left of the centre of mass."""
    ends = {"nose": "half_width", "tail": "half_width", "tool_front": "tool_half_width", "tool_tail": "tool_half_width"}
    return np.array([[boxes[end], sign * boxes[half]] for end, half in ends.items() for sign in (1, -1)])


def _line(job: Job, slot: Slot) -> float:
    """The headland line of the coming pass, measured out of the field."""
    x, y, heading = job.entry(slot.this)
    return -(x * math.cos(heading) + y * math.sin(heading))
