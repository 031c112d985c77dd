"""The places of one round: who works which swath, where each stands in formation and in the queue, and clear of whom.

Rows lead from the middle, a gap apart (thesis, section 6.3). At the end of a round they queue inside their swaths. The
outline of tractor and implement sweeps ground along a path; a tractor must not wait where that reaches its swath.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
import numpy.typing as npt

from strategies.path_planning.paths import DrivePath
from strategies.program.field_job import FieldJob, SwathPass

Floats = npt.NDArray[np.float64]

POSE_STEP_M = 0.5
WAIT_CLEARANCE_M = 0.75  # between a tractor that waits and one that passes
SIDE_CLEARANCE_M = 0.5  # to the side, unless they are on lines as far apart as neighbouring swaths
SETTLED_M, SWAY_M = 4.0, 1.0  # length behind a bend on which a tractor is off its line, and by how much
BESIDE_WIDTHS = 0.98  # working widths between such lines
PARALLEL_RAD = math.radians(10.0)


@dataclass(frozen=True, eq=False)
class BlockedSpans:
    """Open intervals (n, 2) along a swath, in metres from its beginning, where nobody may stand."""

    low_m: Floats
    high_m: Floats

    def find_clear_place_before(self, place_m: float) -> float:
        """The last clear place up to `place_m`."""
        while (inside := (self.low_m < place_m) & (place_m < self.high_m)).any():
            place_m = float(self.low_m[inside].min())
        return place_m

    def find_clear_place_after(self, place_m: float) -> float:
        """The first clear place from `place_m` on."""
        while (inside := (self.low_m < place_m) & (place_m < self.high_m)).any():
            place_m = float(self.high_m[inside].max())
        return place_m


def sample_poses(path: DrivePath) -> Floats:
    """Poses along a path, and beyond its end until the tractor has settled, at most POSE_STEP_M apart (n, 4).

    Columns are x, y (m), heading (rad) and 1 where a tractor is still settling behind a bend.
    """
    segments = [*path.segments, replace(path.segments[-1], length_m=SETTLED_M, curvature=0.0)]
    counts, since_bend_m, bent_m = [], [], math.inf
    for segment in segments:
        counts.append(max(1, math.ceil(segment.length_m / POSE_STEP_M)))
        since_bend_m.append(bent_m)
        bent_m = 0.0 if segment.curvature != 0.0 else bent_m + segment.length_m
    owner = np.repeat(np.arange(len(segments)), counts)
    length, curvature, gear = np.array(
        [(path_segment.length_m, path_segment.curvature, path_segment.gear) for path_segment in segments]
    )[owner].T
    step = np.arange(1, len(owner) + 1) - (np.cumsum(counts) - counts)[owner]
    driven_m = length * step / np.array(counts)[owner]
    settling = (np.array(since_bend_m)[owner] + driven_m <= SETTLED_M) & (curvature == 0.0)
    is_kept = settling | (owner < len(path.segments))
    begin_poses = np.array([*path.list_segment_starts(), path.end])[owner]
    bend = 0.5 * curvature * gear * driven_m
    angle = begin_poses[:, 2] + bend
    run = gear * driven_m * np.sinc(bend / math.pi)
    x, y = begin_poses[:, 0] + run * np.cos(angle), begin_poses[:, 1] + run * np.sin(angle)
    poses = np.column_stack([x, y, angle + bend, settling])[is_kept]
    return np.concatenate([[[*path.start, 0.0]], poses])


def find_blocked_spans(job: FieldJob, swath_pass: SwathPass, pose_rows: Iterable[Floats]) -> BlockedSpans:
    """Where a tractor on a pass would stand in the way of others, whose paths are poses as from `sample_poses`."""
    sampled_paths = list(pose_rows)
    if not sampled_paths:
        return BlockedSpans(np.empty(0), np.empty(0))
    x0, y0, heading = job.get_entry_pose(swath_pass)
    x, y, angle, settling = np.concatenate(sampled_paths).T
    angle = angle - heading
    along = (x - x0) * math.cos(heading) + (y - y0) * math.sin(heading)
    across = (y - y0) * math.cos(heading) - (x - x0) * math.sin(heading)
    cosine, sine = np.cos(angle), np.sin(angle)
    beside = (np.abs(sine) < math.sin(PARALLEL_RAD)) & (np.abs(across) > BESIDE_WIDTHS * job.layout.width_m)
    room_m = np.where(settling > 0.0, SWAY_M, np.where(beside, 0.0, SIDE_CLEARANCE_M))
    lows, highs = [], []
    for rear, front, half in job.driving_rules.boxes:
        end, side = np.array([(end, side) for end in (rear, front) for side in (-half, half)]).T[:, :, None]
        ahead = along + end * cosine - side * sine
        aside = across + end * sine + side * cosine
        (first, last), (right_m, left_m) = ((reach.min(axis=0), reach.max(axis=0)) for reach in (ahead, aside))
        for my_rear, my_front, my_half in job.driving_rules.boxes:
            over = (right_m < my_half + room_m) & (left_m > -my_half - room_m)
            lows.append(first[over] - my_front - WAIT_CLEARANCE_M)
            highs.append(last[over] - my_rear + WAIT_CLEARANCE_M)
    return BlockedSpans(np.concatenate(lows), np.concatenate(highs))


SHORTEST_M = 0.1


@dataclass(frozen=True)
class FormationSlot:
    """One tractor in one round: its row (1 leads), the neighbour it follows, its pass.

    Distances from the beginning of the swath: `place_m` of its place in formation, `hold_m` where it first waits in the
    queue, `up_m` where it waits after moving up, `queue_m` where the queue begins.
    """

    tractor: int
    row: int
    neighbour: int | None
    swath_pass: SwathPass
    place_m: float
    hold_m: float
    queue_m: float
    up_m: tuple[float, ...] = ()


@dataclass(frozen=True)
class PassingClearance:
    """Where on its swath a tractor would stand in the way of others that come to the round or leave it.

    It takes its place `ahead_m` farther on and waits `back_m` farther back than it otherwise would.
    """

    arrival_blocks: BlockedSpans
    departure_blocks: BlockedSpans
    ahead_m: float = 0.0
    back_m: float = 0.0

    def find_formation_place(self, place_m: float) -> float:
        """The first clear place in formation from `place_m` on."""
        return self.arrival_blocks.find_clear_place_after(place_m + self.ahead_m)

    def find_waiting_place(self, hold_m: float) -> float:
        """The last clear place to wait up to `hold_m`."""
        return self.departure_blocks.find_clear_place_before(hold_m - self.back_m)


def build_slots(
    job: FieldJob, passes: Sequence[SwathPass], clearances: Sequence[PassingClearance] | None = None
) -> list[FormationSlot]:
    """Slots of one round on neighbouring swaths, at most one per tractor; tractors without one are those at the sides.

    Places are set from the last row forwards, each a gap ahead of the row behind it, and clear of passing tractors.
    """
    offset = (job.tractors - len(passes)) // 2
    leader = (job.tractors - 1) // 2 - offset
    rows = [abs(index - leader) + 1 for index in range(len(passes))]
    begins_m = [project_begin_m(job, swath_pass) for swath_pass in passes]
    own_begins_m = [start + job.driving_rules.tool_m for start in begins_m]
    places_m = list(own_begins_m)
    row_members: list[list[int]] = [[] for _ in range(max(rows) + 2)]
    for index, row in enumerate(rows):
        row_members[row].append(index)
    for row in range(max(rows), 0, -1):
        behind = [places_m[i] + job.driving_rules.gap_m for i in row_members[row + 1]]
        for index in row_members[row]:
            places_m[index] = max([own_begins_m[index], *behind])
            if clearances:
                places_m[index] = begins_m[index] + clearances[index].find_formation_place(
                    places_m[index] - begins_m[index]
                )
    ends = [start + swath_pass.swath.length_m for start, swath_pass in zip(own_begins_m, passes, strict=True)]
    before_row = list(accumulate((min((ends[i] for i in row), default=math.inf) for row in row_members), min))
    slots = []
    for index, swath_pass in enumerate(passes):
        front = min(ends[index], before_row[rows[index] - 1])
        queue_m, place_m = front - begins_m[index], places_m[index] - begins_m[index]
        hold_m = queue_m - max((rows[index] - 1) * job.driving_rules.gap_m, job.driving_rules.hold_back_m)
        ups = [queue_m - row * job.driving_rules.gap_m for row in range(rows[index] - 2, 0, -1)]
        if clearances:
            hold_m, ups = (
                clearances[index].find_waiting_place(hold_m),
                [clearances[index].find_waiting_place(up) for up in ups],
            )
        before = [hold_m, *ups]
        up_m = tuple(up for up, last in zip(ups, before, strict=False) if up > last + SHORTEST_M)
        neighbour = None if rows[index] == 1 else offset + index + (1 if index < leader else -1)
        slots.append(FormationSlot(offset + index, rows[index], neighbour, swath_pass, place_m, hold_m, queue_m, up_m))
    return slots


def compute_missing_length_m(slots: Sequence[FormationSlot]) -> float:
    """Metres a round lacks between the places in formation and those in the queue; 0 or less if it has room."""
    return max(slot.place_m + SHORTEST_M - slot.hold_m for slot in slots)


def compute_needed_length_m(job: FieldJob, rows: int) -> float:
    """Length of the shortest swath with room for so many rows, where swaths end side by side."""
    gap, hold = job.driving_rules.gap_m, job.driving_rules.hold_back_m
    return SHORTEST_M + max((rows - row) * gap + max((row - 1) * gap, hold) for row in range(1, rows + 1))


def project_begin_m(job: FieldJob, swath_pass: SwathPass) -> float:
    """Where a pass begins, measured in its direction of travel (m)."""
    x, y, heading = job.get_entry_pose(swath_pass)
    return x * math.cos(heading) + y * math.sin(heading)
