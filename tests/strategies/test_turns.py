"""Turns between two parallel tracks against their closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies.path_planning.paths import DrivePath, TurnError
from strategies.path_planning.turns import (
    build_fishtail,
    build_omega_turn,
    build_switch_back,
    build_u_turn,
    compute_turn_depth_m,
)
from tests.strategies.primitive_paths import find_backing_paths, find_dubins_paths, find_three_arc_paths

R = 4.0
A = (0.0, 0.0, 0.0)
TURNS = (build_u_turn, build_omega_turn, build_switch_back, build_fishtail)
RADII = st.floats(1.0, 12.0)
SHARES = st.floats(0.01, 1.99)


def level(spacing: float, on: float = 0.0) -> tuple[float, float, float]:
    return on, spacing, math.pi


def reach(path: DrivePath) -> float:
    return max(float(points[:, 0].max()) for _, points in path.sample(0.002))


def assert_ends(path: DrivePath, pose: tuple[float, float, float]) -> None:
    assert math.dist(path.end[:2], pose[:2]) <= 1e-9
    assert abs(math.remainder(path.end[2] - pose[2], 2 * math.pi)) <= 1e-9


def test_u_turn_over_nine_metres() -> None:
    turn = build_u_turn(A, level(9.0), R)
    assert turn.kind == "u" and turn.reversals == 0
    assert turn.length_m == pytest.approx(math.pi * R + 9 - 2 * R, abs=1e-12)
    assert turn.length_m == pytest.approx(13.566, abs=1e-3)


def test_omega_over_three_metres() -> None:
    turn = build_omega_turn(A, level(3.0), R)
    assert turn.kind == "omega" and turn.reversals == 0
    assert turn.length_m == pytest.approx(R * (math.pi + 4 * math.acos((1.5 + R) / (2 * R))), abs=1e-12)
    assert turn.length_m == pytest.approx(25.5705, abs=1e-4)
    assert compute_turn_depth_m("omega", 3.0, R) == pytest.approx(9.809, abs=1e-3)
    assert reach(turn) == pytest.approx(compute_turn_depth_m("omega", 3.0, R), abs=1e-6)


def test_switch_back_over_three_metres() -> None:
    turn = build_switch_back(A, level(3.0), R)
    assert turn.kind == "switch-back" and turn.reversals == 2
    assert turn.length_m == pytest.approx(12.566370614359172, abs=1e-9)
    assert reach(turn) == pytest.approx(compute_turn_depth_m("switch-back", 3.0, R), abs=1e-6)


def test_fishtail_over_three_metres() -> None:
    turn = build_fishtail(A, level(3.0), R)
    assert turn.kind == "switch-back" and turn.reversals == 2
    assert turn.length_m == pytest.approx(math.pi * R + 2 * R - 3, abs=1e-12)
    assert reach(turn) == pytest.approx(R, abs=1e-6)


@given(RADII, SHARES, st.floats(-15.0, 15.0))
def test_every_turn_ends_on_the_next_track(radius: float, share: float, on: float) -> None:
    for spacing in (share * radius, -share * radius, (2 + share) * radius):
        goal = level(spacing, on)
        turns = [turn for make in TURNS if (turn := make(A, goal, radius))]
        assert len(turns) == (3 if abs(spacing) < 2 * radius else 1)
        for turn in turns:
            assert_ends(turn, goal)


@given(RADII, SHARES, st.floats(0.1, 15.0), st.sampled_from(TURNS))
def test_skewed_ends_add_just_the_straight(radius: float, share: float, on: float, make) -> None:
    spacing = (share + (2.0 if make is build_u_turn else 0.0)) * radius
    aligned = make(A, level(spacing), radius).length_m
    for shift in (on, -on):
        assert make(A, level(spacing, shift), radius).length_m == pytest.approx(aligned + on, abs=1e-9)


@given(RADII, SHARES, st.sampled_from(TURNS))
def test_left_and_right_are_mirror_images(radius: float, share: float, make) -> None:
    spacing = (share + (2.0 if make is build_u_turn else 0.0)) * radius
    left, right = make(A, level(spacing), radius), make(A, level(-spacing), radius)
    assert [s.curvature for s in left.segments] == [-s.curvature for s in right.segments]
    assert [s.length_m for s in left.segments] == [s.length_m for s in right.segments]


@given(RADII, SHARES)
def test_turns_are_the_shortest_primitives_of_their_family(radius: float, share: float) -> None:
    near, far = level(share * radius), level((2 + share) * radius)
    assert build_omega_turn(A, near, radius).length_m == pytest.approx(
        find_dubins_paths(A, near, radius)[0].length_m, abs=1e-9
    )
    assert build_u_turn(A, far, radius).length_m == pytest.approx(
        find_dubins_paths(A, far, radius)[0].length_m, abs=1e-9
    )
    assert build_switch_back(A, near, radius).length_m == pytest.approx(
        find_three_arc_paths(A, near, radius)[0].length_m, abs=1e-9
    )
    assert build_fishtail(A, near, radius).length_m == pytest.approx(
        find_backing_paths(A, near, radius)[0].length_m, abs=1e-9
    )


@given(RADII, SHARES)
def test_depth_is_what_the_path_reaches(radius: float, share: float) -> None:
    spacing = share * radius
    for make, kind in ((build_omega_turn, "omega"), (build_switch_back, "switch-back")):
        assert reach(make(A, level(spacing), radius)) == pytest.approx(
            compute_turn_depth_m(kind, spacing, radius), abs=2e-5
        )
    assert reach(build_u_turn(A, level(2 * radius + spacing), radius)) == pytest.approx(
        compute_turn_depth_m("u", 2 * radius + spacing, radius), abs=2e-5
    )


def test_all_turns_meet_at_two_radii() -> None:
    near = level(2 * R - 1e-12)
    lengths = [
        make(A, near, R).length_m for make in (build_u_turn, build_omega_turn, build_switch_back, build_fishtail)
    ]
    assert lengths == pytest.approx([math.pi * R] * 4, abs=1e-4)
    assert [compute_turn_depth_m(kind, 2 * R, R) for kind in ("u", "omega", "switch-back")] == [R, R, R]


def test_turns_do_not_depend_on_the_place_or_heading() -> None:
    x, y, heading = 310.0, -45.0, 2.1
    there = (x - 3 * math.sin(heading), y + 3 * math.cos(heading), heading + math.pi)
    for make in (build_omega_turn, build_switch_back, build_fishtail):
        moved = make((x, y, heading), there, R)
        assert_ends(moved, there)
        assert moved.length_m == pytest.approx(make(A, level(3.0), R).length_m, abs=1e-9)


def test_turns_that_do_not_exist_are_none() -> None:
    assert build_u_turn(A, level(7.9), R) is None
    assert build_omega_turn(A, level(8.0), R) is None
    assert build_switch_back(A, level(8.1), R) is None
    assert build_fishtail(A, level(8.1), R) is None


def test_a_turn_is_in_front_of_the_tracks() -> None:
    for make in (build_omega_turn, build_switch_back, build_fishtail):
        points = np.concatenate([p for _, p in make(A, level(3.0), R).sample()])
        assert points[:, 0].min() >= -1e-9


@pytest.mark.parametrize("make", TURNS)
def test_tracks_that_are_not_opposite_are_refused(make) -> None:
    with pytest.raises(TurnError, match="must be opposite"):
        make(A, (0.0, 3.0, 3.0), R)


@pytest.mark.parametrize(
    ("kind", "spacing", "radius", "says"),
    [
        ("u", 3.0, 4.0, "A U-turn over 3.0 m does not exist"),
        ("loop", 3.0, 4.0, 'Turn kind "loop" is unknown'),
        ("omega", -1.0, 4.0, "Track spacing -1.0 m"),
        ("omega", math.nan, 4.0, "Track spacing nan m"),
        ("omega", 3.0, 0.0, "Turning radius 0.0 m"),
    ],
)
def test_depth_refuses_what_is_no_turn(kind: str, spacing: float, radius: float, says: str) -> None:
    with pytest.raises(TurnError, match=says):
        compute_turn_depth_m(kind, spacing, radius)
