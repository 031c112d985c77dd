"""Cutting and simplifying paths."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from reports.common.plan_records import PlanDrive
from reports.plan.drive_geometry import (
    REVERSING,
    WAITING,
    WORKING,
    build_hatching,
    build_swath_outline,
    choose_round_length_m,
    compute_extent,
    find_stops,
    split_by_status,
)


def test_pieces_by_hand() -> None:
    xy = np.array([[0, 0], [1, 0], [2, 0], [2, 0], [2, 1], [1, 1]], dtype=float)
    parts = split_by_status(xy, np.array([1, 1, 1, 3, 4, 1]))
    assert [status for status, _ in parts] == [WORKING, REVERSING, WORKING], "standing still leaves no piece"
    assert parts[0][1].tolist() == [[0, 0], [2, 0]], "the middle point is on the line"
    assert [points[-1].tolist() for _, points in parts] == [[2, 0], [2, 1], [1, 1]]


@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.sampled_from([0.0, 0.05, 0.5]))
def test_pieces_join_and_stay_near(seed: int, count: int, tolerance_m: float) -> None:
    rng = np.random.default_rng(seed)
    xy = np.cumsum(rng.uniform(0.1, 1.0, (count, 2)), axis=0)
    parts = split_by_status(xy, rng.integers(0, 5, count), tolerance_m)
    assert parts[0][1][0].tolist() == xy[0].tolist()
    assert parts[-1][1][-1].tolist() == xy[-1].tolist()
    for (status, points), (next_status, next_points) in pairwise(parts):
        assert points[-1].tolist() == next_points[0].tolist()
        assert status != next_status
    drawn = shapely.LineString(np.vstack([points for _, points in parts]))
    assert shapely.hausdorff_distance(shapely.LineString(xy), drawn) <= tolerance_m + 1e-9


def test_waits_by_hand_add_up(drive: PlanDrive) -> None:
    xy = np.array([[0, 0], [0, 0], [1, 0], [5, 2], [5, 2]], dtype=float)
    status = np.array([WAITING, WAITING, 1, WAITING, WAITING])
    assert find_stops(xy, status, 0.5) == [(0.0, 0.0, 1.0), (5.0, 2.0, 1.0)]
    for driven, manner, seconds in zip(drive.xy, drive.status, drive.seconds["waiting"], strict=True):
        assert sum(stop[2] for stop in find_stops(driven, manner, drive.step_s)) == pytest.approx(seconds)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(1.0, 500.0), st.floats(0.5, 12.0), st.floats(0.0, 6.2))
def test_swath_is_a_rectangle_of_the_working_width(
    x: float, y: float, length: float, width: float, angle: float
) -> None:
    track = np.array([[x, y], [x + length * np.cos(angle), y + length * np.sin(angle)]])
    strip = shapely.Polygon(build_swath_outline(track, width))
    assert strip.area == pytest.approx(length * width, rel=1e-6)
    assert strip.exterior.length == pytest.approx(2 * (length + width), rel=1e-6)
    assert strip.centroid.distance(shapely.LineString(track).centroid) < 1e-6
    assert build_swath_outline(track[[0, 0]], width).tolist() == [[x, y]] * 4, "a track without length is a point"


def test_hatching_of_a_square_by_hand() -> None:
    lines = build_hatching([np.array([[1.0, 1.0], [3.0, 1.0], [3.0, 3.0], [1.0, 3.0]])], np.sqrt(2) * 0.5)
    assert lines.reshape(-1, 4) == pytest.approx(np.array([
        [2, 1, 3, 2], [1, 1, 3, 3], [1, 2, 2, 3],
    ]))  # fmt: skip
    assert build_hatching([], 1.0).shape == (0, 2, 2)


@given(st.integers(0, 2**32 - 1), st.integers(3, 12), st.floats(0.0, 6.3))
def test_hatching_lies_in_its_ground_and_is_as_dense_as_asked(seed: int, corners: int, turn: float) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, corners)) + turn
    star = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(30, 60, (corners, 1))
    rings, apart = [star + 100.0, 0.4 * star[::-1] + 100.0, star - 500.0], 0.25
    ground = shapely.union_all([
        shapely.make_valid(shapely.Polygon(rings[0])) - shapely.make_valid(shapely.Polygon(rings[1])),
        shapely.make_valid(shapely.Polygon(rings[2])),
    ]).buffer(1e-6)  # fmt: skip
    lines = build_hatching(rings, apart)
    length = float(np.hypot(*(lines[:, 1] - lines[:, 0]).T).sum())
    around = sum(shapely.LinearRing(ring).length for ring in rings)
    if not shapely.Polygon(rings[0]).is_valid or not shapely.Polygon(rings[0]).contains(shapely.Polygon(rings[1])):
        return
    assert length * apart == pytest.approx(ground.area, abs=apart * around)
    assert shapely.covers(ground, shapely.linestrings(lines)).all()


@pytest.mark.parametrize(("length", "bar"), [(1.0, 1), (68.0, 50), (49.9, 20), (20.0, 20), (0.3, 0.2), (1000.0, 1000)])
def test_round_lengths(length: float, bar: float) -> None:
    assert choose_round_length_m(length) == pytest.approx(bar)


def test_extent_holds_field_paths_and_entrance(drive: PlanDrive) -> None:
    box = compute_extent(replace(drive, entrance=(-20.0, 90.0)))
    assert (box.west, box.south, box.east, box.north) == (-20.0, -1.0, 272.0, 90.0)
    assert (box.width, box.height, box.size) == (292.0, 91.0, 292.0)
