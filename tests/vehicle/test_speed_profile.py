"""Speed limits along a path: closed forms, and what a simulated tractor makes of them."""

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, distance, line_locate_point, points

from fields.arrays import Floats, measure_along
from strategies.path_planning.paths import PathSegment, merge_segments
from vehicle.control.speed_profile import (
    MAX_LIMIT_MPS,
    DrivingLimits,
    build_driving_limits,
    compute_correction_speed,
    compute_straight_time_s,
    limit_by_bends,
    limit_by_brakes,
)
from vehicle.missions.plan import HEADLAND_PASS, TURN, Leg, LegTask, Mission, Plan
from vehicle.missions.plan_file import format_plan, parse_plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.tractor import Implement, Tractor
from vehicle.records import REC_SPEED
from vehicle.sim.compile import compile_plan, compute_point_speeds
from vehicle.sim.world import World, simulate

LIMITS = DrivingLimits(lateral_mps2=1.0, steering_mps=1.2, window_m=4.0, length_m=2.8, deceleration_mps2=0.5)
STEP_M = 0.1


def make_line(*pieces: tuple[float, float]) -> np.ndarray:
    """A polyline of segments of (length, curvature), from the origin to the north."""
    segments = [PathSegment(length, curvature, 1) for length, curvature in pieces]
    ((_, line),) = merge_segments((0.0, 0.0, 0.5 * math.pi), segments, "route").sample(STEP_M)
    return line


def compute_speed_limits(line: Floats, limits: DrivingLimits) -> Floats:
    """Largest speeds (n,) at the points of a polyline (n, 2) driven in one gear, braking included."""
    count = len(line)
    speeds = np.empty(count)
    distances = measure_along(line)
    lateral, length = np.full(count, limits.lateral_mps2), np.full(count, limits.length_m)
    limit_by_bends(line, distances, lateral, length, limits.steering_mps, limits.window_m, speeds)
    limit_by_brakes(distances, limits.deceleration_mps2, speeds)
    return speeds


def find_limit(line: np.ndarray, along_m: float, limits: DrivingLimits = LIMITS) -> float:
    """The limit at a distance along a line."""
    steps = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    return float(np.interp(along_m, steps, compute_speed_limits(line, limits)))


@pytest.mark.slow
@pytest.mark.parametrize("radius_m", [12.0, -30.0])
def test_a_long_circle_is_driven_at_the_lateral_acceleration(radius_m: float) -> None:
    line = make_line((60.0, 1.0 / radius_m))
    assert find_limit(line, 30.0) == pytest.approx(math.sqrt(abs(radius_m)), rel=0.01)


@pytest.mark.slow
def test_near_full_lock_the_wheels_must_be_able_to_return() -> None:
    returning = LIMITS.steering_mps / (1.4 * math.atan(LIMITS.length_m / 4.0))
    assert find_limit(make_line((60.0, 0.25)), 30.0) == pytest.approx(returning, rel=0.01)
    assert returning < math.sqrt(4.0), "less than by the lateral acceleration"


def test_between_two_arcs_the_wheels_get_the_steering_distance() -> None:
    radius_m = 6.0
    line = make_line((20.0, 1.0 / radius_m), (20.0, -1.0 / radius_m))
    swing = 2.0 * math.atan(LIMITS.length_m / radius_m)
    assert find_limit(line, 20.0) == pytest.approx(LIMITS.steering_mps / swing, rel=0.02)


def test_a_clothoid_is_limited_by_its_rate_of_curvature() -> None:
    growth, middle_m = 0.01, 20.0  # 1/m2; it bends to the right before the middle and to the left after it
    lengths = np.arange(0.0, 2.0 * middle_m, STEP_M)
    headings = 0.5 * math.pi + 0.5 * growth * (lengths + 0.5 * STEP_M - middle_m) ** 2
    line = np.concatenate(([[0.0, 0.0]], np.cumsum(STEP_M * np.column_stack([np.cos(headings), np.sin(headings)]), 0)))
    free = DrivingLimits(1e6, LIMITS.steering_mps, LIMITS.window_m, LIMITS.length_m, 1e6)
    swing = 2.0 * math.atan(free.length_m * growth * free.window_m)
    assert find_limit(line, middle_m, free) == pytest.approx(free.steering_mps / swing, rel=0.03)


def test_straights_are_free_and_bends_are_braked_for() -> None:
    assert (compute_speed_limits(make_line((50.0, 0.0)), LIMITS) == MAX_LIMIT_MPS).all()
    line = make_line((100.0, 0.0), (30.0, 0.1))
    before, at = find_limit(line, 60.0), find_limit(line, 96.0)
    assert before**2 == pytest.approx(at**2 + 2.0 * LIMITS.deceleration_mps2 * 36.0, rel=1e-3)


def test_a_straight_takes_the_time_of_a_trapezium_or_a_triangle() -> None:
    # 4 m/s from 2 and to 1 m/s at 1 m/s2: 2 s over 6 m, 3 s over 7.5 m, and 6.5 m at 4 m/s.
    assert compute_straight_time_s(20.0, 4.0, 2.0, 1.0, 1.0) == pytest.approx(2.0 + 3.0 + 6.5 / 4.0)
    # 2 m from 1 to 1 m/s: up to sqrt(3) and back.
    assert compute_straight_time_s(2.0, 4.0, 1.0, 1.0, 1.0) == pytest.approx(2.0 * (math.sqrt(3.0) - 1.0))


def test_wheels_on_their_way_slow_a_tractor_down() -> None:
    assert compute_correction_speed(0.0, 0.84) == MAX_LIMIT_MPS
    assert compute_correction_speed(0.42, 0.84) == pytest.approx(2.0)
    assert compute_correction_speed(1.2, 0.84) == 1.0


def drive(tractor: Tractor, line: np.ndarray, speed_mps: float, kind: str = TURN) -> SimulationRun:
    """One leg driven alone."""
    leg = Leg(line, speed_mps, task=LegTask(kind))
    return simulate(Plan((Mission((leg,)),)), tractor, Implement(), max_time_s=900.0)


def locate_guided_point(run: SimulationRun, tractor: Tractor) -> np.ndarray:
    """Where the guided point was, (t, 2)."""
    poses, ahead = run.get_poses(0), tractor.guide_m
    return poses[:, :2] + ahead * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])


@pytest.mark.parametrize("kmh", [4.0, 8.0, 12.0, 15.0])
def test_an_s_at_full_lock_is_followed_as_well_at_any_speed(eg105: Tractor, kmh: float) -> None:
    radius = 1.08 * eg105.compute_smallest_radius_m("soil")
    line = make_line((30.0, 0.0), (1.57 * radius, 1 / radius), (1.57 * radius, -1 / radius), (30.0, 0.0))
    run = drive(eg105, line, kmh / 3.6)
    apart = distance(LineString(line), points(locate_guided_point(run, eg105)))
    assert run.outcome == DONE
    assert apart.max() < 0.6, "without limits 15 m at 15 km/h"


@pytest.mark.parametrize("kmh", [5.0, 12.0, 18.0])
@pytest.mark.parametrize("offset_m", [0.7, 3.0])
def test_a_tractor_off_its_line_returns_at_any_speed(eg105: Tractor, kmh: float, offset_m: float) -> None:
    leg = Leg(np.array([[0.0, 0.0], [0.0, 200.0]]), kmh / 3.6, task=LegTask(HEADLAND_PASS))
    world = World(Plan((Mission((leg,)),)), eg105, Implement())
    world.run(max_time_s=8.0)
    world.bodies[0].position = (offset_m, world.bodies[0].position.y)
    run = world.run(max_time_s=400.0)
    settled = run.get_poses(0)[:, 1] > 8.0 * kmh / 3.6 + 45.0
    assert run.outcome == DONE and np.abs(run.get_poses(0)[settled, 0]).max() < 0.1


Piece = st.tuples(st.floats(3.0, 25.0), st.sampled_from([0.0, 0.03, -0.08, 0.15, -0.2, 0.22]))


@pytest.mark.slow
@given(st.lists(Piece, min_size=2, max_size=6), st.floats(1.0, 4.5))
@settings(max_examples=15)
def test_no_record_exceeds_the_limits(pieces: list[tuple[float, float]], speed_mps: float) -> None:
    from vehicle.model.tractor import load_tractor

    tractor = load_tractor("eg105")
    line = make_line((20.0, 0.0), *pieces, (20.0, 0.0))
    run = drive(tractor, line, speed_mps)
    path, limits = LineString(line), compute_speed_limits(line, build_driving_limits(tractor, "soil"))
    at = line_locate_point(path, points(locate_guided_point(run, tractor)))
    own = np.array([path.project(Point(place)) for place in line])
    allowed = np.minimum(np.interp(at, own, limits), speed_mps)
    assert run.outcome == DONE
    assert (run.record[:, 0, REC_SPEED] <= allowed + 0.3).all(), "the speed controller lags by a few tenths of a second"


def test_experiments_may_drive_without_limits(eg105: Tractor, build: Any) -> None:
    plan = build.plan([build.arc((0.0, 0.0), 5.0, 0, 180)])
    assert np.isinf(compile_plan(plan, eg105, limits_speed=False).points[:, 2]).all()
    assert np.isfinite(compile_plan(plan, eg105).points[:, 2]).all()


def test_a_plan_tells_the_speed_at_every_point(eg105: Tractor, build: Any) -> None:
    legs = [build.leg((5.0, -40.0), (5.0, 0.0)), build.arc((0.0, 0.0), 5.0, 0, 180)]
    plan = build.plan(legs)
    speeds = compute_point_speeds(plan, eg105)[0]
    assert [len(one) for one in speeds] == [len(leg.points) for leg in legs]
    assert speeds[0][-1] == speeds[1][0] and max(speeds[0]) <= legs[0].speed_mps
    document = json.loads(format_plan(plan, point_speeds=[speeds]))
    assert [leg["speeds_mps"] for leg in document["tractors"][0]] == speeds
    assert format_plan(parse_plan(json.dumps(document))) == format_plan(plan)


def test_work_below_a_speed_is_summed(eg105: Tractor, build: Any) -> None:
    """From standstill to 1.4 m/s at 0.7 m/s2 and back: below 0.7 m/s on 0.35 m at either end, but for the lag."""
    run = simulate(build.plan([build.leg((0.0, 0.0), (0.0, 40.0), kind="track", implement=True)]), eg105, Implement())
    assert run.sum_slow_work_m(0.0) == 0.0
    assert 0.3 < run.sum_slow_work_m(0.7) < 2.0
    assert run.sum_slow_work_m(10.0) == pytest.approx(40.0, abs=1.0)
