"""Whether a tractor with its implement stays clear of fences and obstacles on a path of its guided point.

The guided point leads the rear axle, which trails it: driven forwards, nose and implement swing out of a bend. Paths
are found for the guided point alone; here the rest of the machine is followed step by step in compiled code, because
thousands of turns beside obstacles are checked before an order of swaths is searched.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from strategies.path_planning.paths import DrivePath, Pose
from vehicle.jit import compile_function
from vehicle.sim.clearance import compute_point_distance

Floats = npt.NDArray[np.float64]
STEPS_AT_ONCE = 32  # steps of a path checked against the same segments


def list_segments(lines: shapely.Geometry) -> Floats:
    """The straight segments of lines, (n, 4): x and y of both ends."""
    points, owner = shapely.get_coordinates(shapely.get_parts(lines), return_index=True)
    joined = np.flatnonzero(owner[1:] == owner[:-1])
    return np.ascontiguousarray(np.column_stack([points[joined], points[joined + 1]]))


@compile_function
def measure_segment_to_box(ax, ay, bx, by, low, high, half) -> float:  # type: ignore[no-untyped-def]
    """Distance from the segment between two points to the box [low, high] x [-half, half]; 0 where they meet."""
    best = min(compute_point_distance(ax, ay, low, high, half), compute_point_distance(bx, by, low, high, half))
    dx, dy = bx - ax, by - ay
    first, last = 0.0, 1.0  # the part of the segment between both pairs of sides
    for place, step, least, most in ((ax, dx, low, high), (ay, dy, -half, half)):
        if step == 0.0:
            if place < least or place > most:
                first = 2.0
            continue
        share_at_least, share_at_most = (least - place) / step, (most - place) / step
        first, last = max(first, min(share_at_least, share_at_most)), min(last, max(share_at_least, share_at_most))
    if first <= last:
        return 0.0
    square = dx * dx + dy * dy
    for corner in range(4):
        x, y = (low if corner % 2 == 0 else high), (-half if corner < 2 else half)
        share = 0.0
        if square > 0.0:
            share = min(max(((x - ax) * dx + (y - ay) * dy) / square, 0.0), 1.0)
        best = min(best, math.hypot(x - ax - share * dx, y - ay - share * dy))
    return best


@compile_function
def has_box_within_distance(x, y, heading, boxes, segments, near_numbers, count, far_m, spare_m):  # type: ignore[no-untyped-def]
    """Whether a box of a machine with its axle at a pose is within `spare_m` of one of the segments `near_numbers`.

    No part of its boxes is `far_m` or farther from the axle, less `spare_m`.
    """
    cosine, sine = math.cos(heading), math.sin(heading)
    for k in range(count):
        ax, ay = segments[near_numbers[k], 0] - x, segments[near_numbers[k], 1] - y
        bx, by = segments[near_numbers[k], 2] - x, segments[near_numbers[k], 3] - y
        if (ax > far_m and bx > far_m) or (ax < -far_m and bx < -far_m):
            continue
        if (ay > far_m and by > far_m) or (ay < -far_m and by < -far_m):
            continue
        a, aside = ax * cosine + ay * sine, ay * cosine - ax * sine
        b, bside = bx * cosine + by * sine, by * cosine - bx * sine
        for box in range(len(boxes)):
            low, high, half = boxes[box, 0], boxes[box, 1], boxes[box, 2]
            if max(a, b) < low - spare_m or min(a, b) > high + spare_m:
                continue
            if max(aside, bside) < -half - spare_m or min(aside, bside) > half + spare_m:
                continue
            if measure_segment_to_box(a, aside, b, bside, low, high, half) <= spare_m:
                return True
    return False


@compile_function
def _find_segments_within(segments, x, y, reach_m, near_numbers):  # type: ignore[no-untyped-def]
    """Number of the segments whose bounds are within reach of a place; writes which they are to `near_numbers`."""
    return _filter_segments_within(segments, np.arange(len(segments)), len(segments), x, y, reach_m, near_numbers)


@compile_function
def _filter_segments_within(segments, near_numbers, near_count, x, y, reach_m, close_numbers):  # type: ignore[no-untyped-def]
    """Number of the first `near_count` of `near_numbers` within reach of a place; writes them to `close_numbers`."""
    count = 0
    for place in range(near_count):
        k = near_numbers[place]
        west, east = min(segments[k, 0], segments[k, 2]), max(segments[k, 0], segments[k, 2])
        south, north = min(segments[k, 1], segments[k, 3]), max(segments[k, 1], segments[k, 3])
        if west <= x + reach_m and east >= x - reach_m and south <= y + reach_m and north >= y - reach_m:
            close_numbers[count] = k
            count += 1
    return count


@compile_function
def has_contact(ends, pieces, boxes, segments, guide_m, reach_m, spare_m, step_m):  # type: ignore[no-untyped-def]
    """Whether the machine comes within `spare_m` of a segment (n, 4) anywhere on a path.

    The path leads from the first of the poses `ends` (2, 3) to the second in pieces (k, 3) of length, curvature and
    gear. It is checked every `step_m` and where pieces end: forwards the rear axle trails the guided point, `guide_m`
    ahead of it, in reverse it keeps to the path. `boxes` (m, 3) are rear and front end ahead of the axle, and half the
    width; no part of them is farther than `reach_m` from the guided point.
    """
    px, py, heading = ends[0, 0], ends[0, 1], ends[0, 2]
    length = 0.0
    for k in range(len(pieces)):
        length += pieces[k, 0]
    near_numbers, close_numbers = np.empty(len(segments), dtype=np.int64), np.empty(len(segments), dtype=np.int64)
    # No point of a path is farther from the middle of its ends than half its length.
    far_m = reach_m + guide_m + spare_m
    count = _find_segments_within(
        segments, 0.5 * (px + ends[1, 0]), 0.5 * (py + ends[1, 1]), 0.5 * length + far_m, near_numbers
    )
    if count == 0:
        return False
    x, y = px - guide_m * math.cos(heading), py - guide_m * math.sin(heading)
    if has_box_within_distance(x, y, heading, boxes, segments, near_numbers, count, far_m, spare_m):
        return True
    for k in range(len(pieces)):
        bend, gear = pieces[k, 1], pieces[k, 2]
        steps = max(1, math.ceil(pieces[k, 0] / step_m - 1e-9))
        fx, fy, qx, qy = px, py, px, py
        for number in range(1, steps + 1):
            if number % STEPS_AT_ONCE == 1:  # the next STEPS_AT_ONCE steps lead no farther than this
                close_count = _filter_segments_within(
                    segments, near_numbers, count, qx, qy, far_m + guide_m + (STEPS_AT_ONCE + 1) * step_m, close_numbers
                )
            run = gear * pieces[k, 0] * number / steps
            half = 0.5 * bend * run
            chord = run * (math.sin(half) / half if half != 0.0 else 1.0)
            nx, ny = fx + chord * math.cos(heading + half), fy + chord * math.sin(heading + half)
            if gear < 0.0:
                angle = math.atan2(qy - ny, qx - nx)
                x, y = nx - guide_m * math.cos(angle), ny - guide_m * math.sin(angle)
            else:
                dx, dy = nx - x, ny - y
                angle, apart = math.atan2(dy, dx), math.hypot(dx, dy)
                x, y = nx - guide_m * dx / apart, ny - guide_m * dy / apart
            if close_count and has_box_within_distance(
                x, y, angle, boxes, segments, close_numbers, close_count, far_m, spare_m
            ):
                return True
            qx, qy = nx, ny
        px, py, heading = qx, qy, heading + bend * gear * pieces[k, 0]
    return False


Points = npt.NDArray[np.float64]
MachineBox = tuple[float, float, float]
"""Rear and front end ahead of the rear axle, and half the width (m)."""

CHECK_STEP_M = 0.5
SLACK_M = 1e-6


@dataclass(frozen=True)
class MachineBody:
    """A tractor with its implement: its boxes, and how far ahead of the rear axle the guided point is (m)."""

    boxes: tuple[MachineBox, ...]
    guide_m: float

    @property
    def reach_m(self) -> float:
        """The farthest distance of any part from the guided point (m)."""
        return max(math.hypot(max(abs(a), abs(b)), half) for a, b, half in self.boxes) + self.guide_m

    def compute_swing_m(self, radius_m: float) -> float:
        """How far the machine reaches out of a circle that the guided point drives (m)."""
        axle_radius_m = math.sqrt(max(radius_m**2 - self.guide_m**2, 0.0))
        return max(math.hypot(axle_radius_m + half, max(abs(a), abs(b))) for a, b, half in self.boxes) - radius_m

    def place_boxes(self, poses: Points) -> npt.NDArray[np.object_]:
        """The boxes at poses (n, 3) of the rear axle, as polygons."""
        corners = np.array([[(a, -half), (b, -half), (b, half), (a, half)] for a, b, half in self.boxes])
        ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
        sideways = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        turned = corners[None, ..., :1] * ahead[:, None, None] + corners[None, ..., 1:] * sideways[:, None, None]
        return np.asarray(shapely.polygons((turned + poses[:, None, None, :2]).reshape(-1, 4, 2)))


class FenceChecker:
    """Fences, and outlines of obstacles, from which every part of a body should stay `spare_m` away as planned.

    Guidance is never exact. A plan may touch an obstacle if there is no other path, but never crosses a fence.
    """

    def __init__(
        self, fences: shapely.Geometry, obstacles: shapely.Geometry, body: MachineBody, spare_m: float
    ) -> None:
        self.body, self.spare_m = body, spare_m
        self._fences, self._lines = fences, shapely.union(fences, obstacles)
        self._crossing_cache: dict[tuple[DrivePath, bool], bool] = {}  # strategies check the same paths
        self._distance_cache: dict[tuple[float, float, bool], float] = {}
        self._segments = {True: list_segments(fences), False: list_segments(self._lines)}
        shapely.prepare([self._fences, self._lines])

    def has_path_contact(self, path: DrivePath, *, fences_only: bool = False) -> bool:
        """Whether any part of the machine touches a fence, or an obstacle, on a path."""
        if (path, fences_only) not in self._crossing_cache:
            self._crossing_cache[path, fences_only] = self._compute_path_contact(path, fences_only)
        return self._crossing_cache[path, fences_only]

    def _compute_path_contact(self, path: DrivePath, fences_only: bool) -> bool:
        near_m = self.body.reach_m + self.spare_m
        # No point is nearer than half of (the distances of both ends, less the length of the path).
        if (
            self._get_distance_to_lines_m(path.start, fences_only)
            + self._get_distance_to_lines_m(path.end, fences_only)
            - path.length_m
            > 2.0 * near_m
        ):
            return False
        ends, boxes = np.array([path.start, path.end]), np.array(self.body.boxes, dtype=np.float64)
        segments, sizes = self._segments[fences_only], (self.body.guide_m, self.body.reach_m, self.spare_m)
        return bool(has_contact(ends, path.to_rows(), boxes, segments, *sizes, CHECK_STEP_M))

    def _get_distance_to_lines_m(self, pose: Pose, fences_only: bool) -> float:
        """Distance of the lines from a pose (m); infinite if there are none."""
        key = pose[0], pose[1], fences_only
        if key not in self._distance_cache:
            lines = self._fences if fences_only else self._lines
            distance_m = math.inf if lines.is_empty else float(shapely.distance(lines, shapely.Point(pose[:2])))
            self._distance_cache[key] = distance_m
        return self._distance_cache[key]

    def has_pose_contact(self, pose: Pose) -> bool:
        """Whether any part of a machine that stands straight, its guided point in a pose, touches one of them."""
        x, y, heading = pose
        back = self.body.guide_m
        return self._is_near_lines(
            np.array([[x - back * math.cos(heading), y - back * math.sin(heading), heading]]), self._lines
        )

    def _is_near_lines(self, poses: Points, lines: shapely.Geometry) -> bool:
        reach_m = self.body.reach_m - self.body.guide_m + self.spare_m
        is_near = shapely.dwithin(lines, shapely.points(poses[:, :2]), reach_m + SLACK_M)
        return bool(shapely.dwithin(lines, self.body.place_boxes(poses[is_near]), self.spare_m).any())


def pick_quickest_inside(
    fence: FenceChecker | None, paths: list[DrivePath | None], compute_cost: Callable[[DrivePath], float]
) -> DrivePath | None:
    """The quickest path that does not cross a fence; None if all do."""
    clear_paths = [path for path in paths if path is not None and not (fence and fence.has_path_contact(path))]
    return min(clear_paths, key=lambda path: round(compute_cost(path), 6), default=None)
