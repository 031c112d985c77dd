"""Conflicts between paths: where two tractors would be too close, at any times or at common times.

For any times, enclosing circles of blocks of poses, and of blocks of blocks, decide which poses are compared. Of those
the boxes round whole tractors come first, and distances are computed only where these are not clear of each other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from fields.arrays import Flags, Floats, Integers, Records, build_directions
from vehicle.jit import compile_function, drop_owner
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.clearance import (
    PARALLEL_SINE,
    ROUNDING_M,
    compute_box_gap_m,
    compute_corner_distance,
    compute_distance_below,
    compute_outline_distance,
    compute_relative_pose,
    compute_start_limit,
    get_boxes,
    is_beside,
)
from vehicle.sim.compile import build_model_record

EXTRA_CLEARANCE_M = 0.3  # added to the clearance, because poses of a path are some way apart
BLOCK_SIZE = 16  # poses under one enclosing circle, and circles under one larger one
POSE = np.dtype([("x", "f8"), ("y", "f8"), ("angle", "f8"), ("model", "i8")])

Approach = tuple[int, int, int, float]


def build_poses(rows: Records) -> Records:
    """POSE records (...,) of x, y (m) and angle (rad), shape (..., 3)."""
    poses = np.zeros(rows.shape[:-1], dtype=POSE)
    for column, name in enumerate(("x", "y", "angle")):
        poses[name] = rows[..., column]
    return poses


class PosePath:
    """The poses of a path (POSE records), with all that does not depend on the other path.

    `directions` (n, 2) are cosine and sine of the angles; `block_circles` and `outer_circles` (m, 3) are centres and
    radii of circles round blocks of poses, and round blocks of those circles.
    """

    def __init__(self, poses: Records) -> None:
        self.poses = poses
        self.directions = build_directions(poses["angle"])
        self.block_circles = _compute_enclosing_circles(np.column_stack([poses["x"], poses["y"], np.zeros(len(poses))]))
        self.outer_circles = _compute_enclosing_circles(self.block_circles)


def find_conflicting_poses(
    a: PosePath, b: PosePath, models: Records, clearance_m: float, beside_clearance_m: float
) -> Records:
    """Poses that two tractors cannot take at once: rows (k, 3) of a pose in `a` and a range (first, last) in `b`.

    Rows are sorted by the pose in `a`, then by those in `b`. As in vehicle.sim.clearance, two are in conflict within
    `clearance_m`, or within `beside_clearance_m` if they are beside each other. `models` (1,) is their MODEL record.
    """
    rows = np.empty((1024, 3), dtype=np.int64)
    while True:
        directions, blocks = (a.directions, b.directions), (a.block_circles, b.block_circles, b.outer_circles)
        count = _scan_conflicts(a.poses, b.poses, *directions, *blocks, models, clearance_m, beside_clearance_m, rows)
        if count <= len(rows):
            return rows[:count]
        rows = np.empty((count, 3), dtype=np.int64)


def _compute_enclosing_circles(circles: Records) -> Records:
    """Centre and radius of a circle round each block of circles (m, 3)."""
    starts = np.arange(0, len(circles), BLOCK_SIZE)
    sizes = np.diff(np.append(starts, len(circles)))
    x, y = (np.add.reduceat(circles[:, column], starts) / sizes for column in (0, 1))
    away = np.hypot(circles[:, 0] - np.repeat(x, sizes), circles[:, 1] - np.repeat(y, sizes)) + circles[:, 2]
    return np.column_stack([x, y, np.maximum.reduceat(away, starts)])


@compile_function
def _is_close(circle, other_circle, reach):  # type: ignore[no-untyped-def]
    """Whether two circles are nearer to each other than `reach`."""
    dx, dy, limit = circle[0] - other_circle[0], circle[1] - other_circle[1], reach + circle[2] + other_circle[2]
    return dx * dx + dy * dy < limit * limit


@compile_function
def _is_box_near(a, b, ahead_a, ahead_b, relative_pose, box, other_box, limit):  # type: ignore[no-untyped-def]
    """Whether a box of one tractor is nearer than `limit` to one of another, at a compute_relative_pose."""
    gap = compute_box_gap_m(relative_pose, box, other_box)
    if gap < -ROUNDING_M or gap >= limit + ROUNDING_M:
        return gap < 0.0
    return (
        compute_corner_distance(a, ahead_a, box, b, ahead_b, other_box) < limit
        or compute_corner_distance(b, ahead_b, other_box, a, ahead_a, box) < limit
    )


@compile_function
def _is_pose_pair_too_close(a, b, ahead_a, ahead_b, boxes, model, clearance, beside_clearance):  # type: ignore[no-untyped-def]
    """Whether two poses cannot be taken at once; distances are computed only where needed."""
    relative_pose = compute_relative_pose(a, b, ahead_a, ahead_b)
    whole, body, tool = boxes
    gap = compute_box_gap_m(relative_pose, whole, whole)
    limit = clearance
    if (
        gap < limit + ROUNDING_M
        and abs(relative_pose[5]) <= PARALLEL_SINE + ROUNDING_M
        and is_beside(a, model, b, model)
    ):
        limit = min(clearance, beside_clearance)
    if gap >= limit + ROUNDING_M:
        return False
    return (
        _is_box_near(a, b, ahead_a, ahead_b, relative_pose, tool, tool, limit)
        or _is_box_near(a, b, ahead_a, ahead_b, relative_pose, body, body, limit)
        or _is_box_near(a, b, ahead_a, ahead_b, relative_pose, tool, body, limit)
        or _is_box_near(a, b, ahead_a, ahead_b, relative_pose, body, tool, limit)
    )


@compile_function
def _scan_conflicts(  # type: ignore[no-untyped-def]
    a, b, ahead_a, ahead_b, blocks_a, blocks_b, outer_b, models, clearance, beside_clearance, rows
):
    """Number of conflict rows; as many as fit are written to `rows`."""
    a, b, ahead_a, ahead_b = drop_owner(a), drop_owner(b), drop_owner(ahead_a), drop_owner(ahead_b)
    blocks_a, blocks_b, outer_b = drop_owner(blocks_a), drop_owner(blocks_b), drop_owner(outer_b)
    model, boxes, close_blocks = models[0], get_boxes(models[0]), np.empty(len(blocks_b), dtype=np.int64)
    reach, count = 2.0 * model.reach + max(clearance, beside_clearance), 0
    for p in range(len(blocks_a)):
        block_count = 0
        for outer in range(len(outer_b)):
            if _is_close(blocks_a[p], outer_b[outer], reach):
                for q in range(outer * BLOCK_SIZE, min((outer + 1) * BLOCK_SIZE, len(blocks_b))):
                    if _is_close(blocks_a[p], blocks_b[q], reach):
                        close_blocks[block_count] = q
                        block_count += 1
        for i in range(p * BLOCK_SIZE, min((p + 1) * BLOCK_SIZE, len(a)) if block_count > 0 else 0):
            last = -2
            for k in range(block_count):
                q = close_blocks[k]
                for j in range(q * BLOCK_SIZE, min((q + 1) * BLOCK_SIZE, len(b))):
                    dx, dy = a[i].x - b[j].x, a[i].y - b[j].y
                    if dx * dx + dy * dy >= reach * reach:
                        continue
                    first, second = (ahead_a[i, 0], ahead_a[i, 1]), (ahead_b[j, 0], ahead_b[j, 1])
                    if not _is_pose_pair_too_close(
                        a[i], b[j], first, second, boxes, model, clearance, beside_clearance
                    ):
                        continue
                    if last != j - 1:
                        count += 1
                        if count <= len(rows):
                            rows[count - 1, 0], rows[count - 1, 1] = i, j
                    if count <= len(rows):
                        rows[count - 1, 2] = j
                    last = j
    return count


@compile_function
def _count_parting_poses(path, place, model, least, clearance):  # type: ignore[no-untyped-def]
    """How many first poses of a path lead apart to `clearance` from a tractor that stands at a place; 0 if one of them
    comes nearer than compute_start_limit allows where tractors may come as near as `least`."""
    limit = compute_start_limit(compute_outline_distance(path[0], model[0], place[0], model[0]), least)
    for k in range(len(path)):
        distance = compute_distance_below(path[k], model[0], place[0], model[0], clearance)
        if distance >= clearance:
            return k
        if distance < limit:
            return 0
    return len(path)


def find_close_approaches(
    poses: Floats, on_field: Flags, model: Records, clearance_m: float, beside_m: float
) -> list[Approach]:
    """Pairs (i, j, k, metres) of tractors i < j that are too close at step k, the first such step of each pair.

    `poses` (n, steps, 3) are x, y (m) and angle (rad) of the centres of mass at common times, `on_field` (n,) marks the
    tractors on the field, `model` (1,) is their MODEL record. Too close is as in vehicle.sim.clearance.
    """
    pairs = np.argwhere(np.triu(np.outer(on_field, on_field), 1))
    return _list_approaches(poses, model, poses, np.repeat(model, len(poses)), pairs, (clearance_m, beside_m))


def find_close_approaches_between(
    own_poses: Floats,
    own_model: Records,
    other_poses: Floats,
    other_models: Records,
    clearance_m: float,
    beside_m: float,
) -> list[Approach]:
    """As find_close_approaches, for pairs (i, j) of a tractor i of one group and j of another.

    Both groups are poses (n, steps, 3); `own_model` (1,) is the record of the whole first group, `other_models` (m,)
    those of the second.
    """
    pairs = np.argwhere(np.ones((len(own_poses), len(other_poses)), dtype=np.bool_))
    return _list_approaches(own_poses, own_model, other_poses, other_models, pairs, (clearance_m, beside_m))


def _list_approaches(
    own_poses: Floats,
    own_model: Records,
    other_poses: Floats,
    other_models: Records,
    pairs: Integers,
    limits_m: tuple[float, float],
) -> list[Approach]:
    rows, pairs = np.empty((len(pairs), 4)), np.ascontiguousarray(pairs)
    own, others = build_poses(own_poses), build_poses(other_poses)
    count = _scan_approaches(own, own_model, others, other_models, pairs, *limits_m, rows)
    return [(int(i), int(j), int(k), float(metres)) for i, j, k, metres in rows[:count]]


def compute_outline_distances(
    poses: Floats, other_poses: Floats, model: Records, other_model: Records | None = None
) -> Floats:
    """Metres (steps,) between the outlines of two tractors at poses (steps, 3) of common times.

    Both are of `model` unless `other_model` is given for the second.
    """
    out = np.empty(len(poses))
    second = model if other_model is None else other_model
    _fill_distances(build_poses(poses), build_poses(other_poses), model, second, out)
    return out


@compile_function
def _scan_approaches(  # type: ignore[no-untyped-def]
    own_poses, own_model, other_poses, other_models, pairs, clearance, beside_clearance, rows
):
    """Number of `pairs` (n, 2) that come too close; of each, pair, first step and metres are written to `rows`."""
    count, kind = 0, own_model[0]
    for pair in range(len(pairs)):
        i, j = pairs[pair, 0], pairs[pair, 1]
        other_model = other_models[j]
        reach = kind.reach + other_model.reach + clearance
        for k in range(own_poses.shape[1]):
            a, b = own_poses[i, k], other_poses[j, k]
            dx, dy = a.x - b.x, a.y - b.y
            if dx * dx + dy * dy >= reach * reach:
                continue
            metres = compute_outline_distance(a, kind, b, other_model)
            if metres >= clearance or (metres >= beside_clearance and is_beside(a, kind, b, other_model)):
                continue
            rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = i, j, k, metres
            count += 1
            break
    return count


@compile_function
def _fill_distances(poses, other_poses, model, other_model, out):  # type: ignore[no-untyped-def]
    for k in range(len(poses)):
        out[k] = compute_outline_distance(poses[k], model[0], other_poses[k], other_model[0])


@dataclass(frozen=True)
class ClearanceCheck:
    """How near tractors may come to one another, on paths known by poses; all have the same machine.

    Attributes:
        models: (1,) their MODEL record.
        clearance_m, beside_clearance_m: how near they may come, and how near beside each other.
    """

    models: Records = field(compare=False)
    clearance_m: float
    beside_clearance_m: float

    @classmethod
    def for_machine(
        cls, tractor: Tractor, implement: Implement, clearance_m: float, beside_clearance_m: float
    ) -> ClearanceCheck:
        """That of tractors which keep a clearance; poses of a path are some way apart."""
        models = np.array([build_model_record(tractor, implement)])
        return cls(models, clearance_m + EXTRA_CLEARANCE_M, beside_clearance_m)

    @property
    def reach_m(self) -> float:
        """How far apart two are never in each other's way (m)."""
        return float(2.0 * self.models["reach"][0] + max(self.clearance_m, self.beside_clearance_m))

    def find_blocked(self, places: Floats, driving: Iterable[PosePath]) -> Flags:
        """At which of the poses (n, 3) one would stand in the way of any of others on their paths."""
        standing, blocked = PosePath(build_poses(places)), np.zeros(len(places), bool)
        for other in driving:
            blocked[self.find_blocked_parts(standing, other)[:, 0]] = True
        return blocked

    def find_blocked_parts(self, standing: PosePath, driving: PosePath) -> Integers:
        """Rows (k, 3): one of some poses, to stand at or driven too, and the first and last pose of a path that one
        there bars."""
        return find_conflicting_poses(standing, driving, self.models, self.clearance_m, self.beside_clearance_m)

    def find_meetings(self, a: PosePath, b: PosePath) -> Integers:
        """As find_blocked_parts, for two that begin with the first poses of their paths: each may drive apart from the
        other where that stands yet, as in vehicle.sim.clearance."""
        rows, limits_m = self.find_blocked_parts(a, b), (self.clearance_m - EXTRA_CLEARANCE_M, self.clearance_m)
        parting_a, parting_b = (
            _count_parting_poses(path.poses, other.poses[:1], self.models, *limits_m)
            for path, other in ((a, b), (b, a))
        )
        place, first, last = rows.T
        free = np.maximum(place < parting_a, np.where(place == 0, parting_b, 0))
        begin = np.maximum(first, free)
        meetings: Integers = np.column_stack([place, begin, last])[begin <= last]
        return meetings
