"""Closed forms of moves: they lead where they should, the quickest first, and only where the body has room."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.moves.closed_forms import (
    CURVED_REVERSE_S,
    LEADS_IN_M,
    LEADS_OUT_M,
    SAME_S,
    charge_backing_up_s,
    compute_awkward_s,
    estimate_settling_s,
    list_closed_forms,
    measure_backing_up,
    pick_with_room,
    weigh_forms,
)
from strategies.moves.move_finder import MOST_POSES
from strategies.moves.search import BEND_S, has_way_on, measure_remaining_m, search_move, shorten_rows
from strategies.path_planning.machine_body import MachineBody
from strategies.path_planning.primitives import advance_pose
from strategies.rules.driving_rules import DrivingRules
from strategies.site.ground import build_ground, has_room_on_path, measure_length_inside

RADIUS_M, MARGIN_M = 5.0, 0.1
RADII, COSTS = np.array([RADIUS_M, 1.25 * RADIUS_M]), DrivingRules(2.0, 2.0, 1.4, RADIUS_M, 0.0, cusp_s=4.0).turn_costs
SETTLING = np.array([[0.0, 5.0, 20.0], [4.0, 2.0, 0.0]])
FAR_S_PER_M = 1.5  # charged for reversing far
LEADS = LEADS_OUT_M, LEADS_IN_M
ALL_KINDS = np.array([True, True, True, True])
NO_LIMIT = math.inf, math.inf  # of backing up
BODY = MachineBody(((-1.8, 3.0, 1.1), (-2.6, -1.8, 2.0)), 1.0)
CROP = build_ground(shapely.box(20.0, 15.0, 60.0, 45.0), 6.0)
NO_KEPT = CROP.grid, CROP.frame, 0.5, 0.0


def drive(pose: tuple[float, float, float], rows: np.ndarray) -> tuple[float, float, float]:
    for length, curvature, gear in rows:
        pose = advance_pose(*pose, length, curvature, gear)
    return pose


@settings(max_examples=60, deadline=None)
@given(x=st.floats(-40, 40), y=st.floats(-40, 40), heading=st.floats(-3.14, 3.14))
def test_every_form_ends_at_its_goal(x: float, y: float, heading: float) -> None:
    goal = np.array([x, y, heading])
    forms, seconds, kinds = list_closed_forms(
        goal, RADII, COSTS, SETTLING, *LEADS, ALL_KINDS, 0.0, math.inf, math.inf, 40
    )
    assert len(forms) == len(seconds) == len(kinds) > 0
    assert (np.diff(seconds) >= 0.0).all()
    for rows in forms:
        u, v, after = drive((0.0, 0.0, 0.0), rows)
        assert math.dist((u, v), (x, y)) < 1e-6
        assert abs(math.remainder(after - heading, 2.0 * math.pi)) < 1e-6
        assert (np.abs(rows[:, 1]) <= 1.0 / RADIUS_M + 1e-9).all()


def test_kinds_that_may_not_be_driven_are_left_out() -> None:
    goal, forward = np.array([0.0, 6.0, math.pi]), np.array([True, True, True, False])
    forms, _, _ = list_closed_forms(goal, RADII, COSTS, SETTLING, *LEADS, forward, 0.0, *NO_LIMIT, 40)
    assert len(forms)
    assert (forms[:, :, 2][forms[:, :, 0] > 0.0] > 0.0).all()


def test_no_form_reverses_farther_than_allowed() -> None:
    goal = np.array([-30.0, 0.0, 0.0])
    longest_m = []
    for backed_m, limit_m in ((0.0, math.inf), (0.0, 10.0), (6.0, 10.0)):
        forms, _, _ = list_closed_forms(
            goal, RADII, COSTS, SETTLING, *LEADS, ALL_KINDS, backed_m, limit_m, math.inf, 60
        )
        longest_m.append(max(measure_backing_up(rows, 0.0) for rows in forms))
        assert all(measure_backing_up(rows, backed_m) <= limit_m for rows in forms)
    assert longest_m[0] >= 30.0


@settings(max_examples=60, deadline=None)
@given(
    goal=st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0), st.floats(-3.1, 3.1)),
    backed_m=st.floats(0.0, 15.0),
)
def test_reversing_far_is_charged_before_the_quickest_are_chosen(
    goal: tuple[float, float, float], backed_m: float
) -> None:
    """The first of a few is the cheapest of all; where the charge is infinite none backs up far."""
    how = np.array(goal), RADII, COSTS, SETTLING, *LEADS, ALL_KINDS, backed_m
    every, every_s, _ = list_closed_forms(*how, *NO_LIMIT, 2000)
    _, few_s, _ = list_closed_forms(*how, 10.0, FAR_S_PER_M, 5)
    near, _, _ = list_closed_forms(*how, 10.0, math.inf, 5)
    beyond_m = np.array([max(0.0, measure_backing_up(rows, backed_m) - 10.0) for rows in every])
    assert few_s[0] == pytest.approx((every_s + FAR_S_PER_M * beyond_m).min(), abs=SAME_S)
    assert all(charge_backing_up_s(rows, backed_m, 10.0, math.inf) == 0.0 for rows in near)


@pytest.mark.parametrize(
    ("rows", "charge_s"),
    [([[5.0, 0.2, 1.0], [3.0, 0.0, 1.0]], 0.0), ([[5.0, 0.2, -1.0], [3.0, 0.0, 1.0]], CURVED_REVERSE_S)],
)
def test_what_drivers_avoid_is_charged(rows: list[list[float]], charge_s: float) -> None:
    assert compute_awkward_s(np.array(rows)) == pytest.approx(charge_s)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "charge_s"),
    [
        ([[5.0, 0.2, 1.0]], 4.0),
        ([[5.0, 0.2, 1.0], [2.5, 0.0, 1.0]], 3.0),
        ([[5.0, 0.2, 1.0], [2.5, 0.0, 1.0], [2.5, 0.0, -1.0]], 2.0),
        ([[5.0, 0.2, 1.0], [30.0, 0.0, 1.0]], 0.0),
        ([[5.0, 0.0, 1.0]], 0.0),
    ],
)
def test_a_line_begun_soon_after_an_arc_is_charged(rows: list[list[float]], charge_s: float) -> None:
    assert estimate_settling_s(np.array(rows), SETTLING) == pytest.approx(charge_s)


def test_forms_without_room_are_passed_over() -> None:
    wide, narrow = (build_ground(shapely.box(-20.0, -30.0, 40.0, top), 6.0) for top in (60.0, 12.0))
    start, goal = np.array([0.0, 0.0, 0.0]), np.array([0.0, 8.0, math.pi])
    forms, _, _ = list_closed_forms(goal, RADII, COSTS, SETTLING, *LEADS, ALL_KINDS, 0.0, *NO_LIMIT, 60)
    tables = BODY.guide_m, BODY.points, BODY.reach_m
    free, tight = (
        pick_with_room(start, forms, 60, *tables, ground.grid, ground.frame, MARGIN_M) for ground in (wide, narrow)
    )
    assert set(tight.tolist()) < set(free.tolist())
    assert len(tight)


@settings(max_examples=60, deadline=None)
@given(goal=st.tuples(st.floats(-25.0, 25.0), st.floats(-25.0, 25.0), st.floats(-3.1, 3.1)), top=st.floats(6.0, 40.0))
def test_forms_are_picked_that_have_room_by_themselves(goal: tuple[float, float, float], top: float) -> None:
    """Those that begin as one without room are passed over without a look at their places."""
    ground = build_ground(shapely.box(-30.0, -12.0, 30.0, top), 6.0)
    body = BODY.guide_m, BODY.points, BODY.reach_m, ground.grid, ground.frame
    forms, _, _ = list_closed_forms(
        np.array(goal), RADII, COSTS, SETTLING, *LEADS, ALL_KINDS, 0.0, math.inf, math.inf, 60
    )
    picked = set(pick_with_room(np.zeros(3), forms, 60, *body, MARGIN_M).tolist())
    ample, any_room = (
        {k for k, rows in enumerate(forms) if has_room_on_path(np.zeros(3), rows, *body, margin)}
        for margin in (MARGIN_M + 0.05, MARGIN_M)  # places on an arc are not the same on a longer one
    )
    assert ample <= picked <= any_room


def test_a_search_leads_round_a_wall() -> None:
    ground = build_ground(shapely.box(0.0, 0.0, 80.0, 60.0) - shapely.box(38.0, 0.0, 42.0, 40.0), 6.0)
    start, goal = np.array([15.0, 15.0, 0.0]), np.array([65.0, 15.0, 0.0])
    body = BODY.guide_m, BODY.points, BODY.reach_m, ground.grid, ground.frame, MARGIN_M
    remaining = measure_remaining_m(start, goal, 1.1, RADIUS_M, 2.0, NO_KEPT, ground.grid, ground.frame)
    how = RADII[:1], COSTS, SETTLING, ALL_KINDS, 12.0
    rows = search_move(start, goal, remaining, *how, FAR_S_PER_M, NO_KEPT, MOST_POSES, body)
    assert len(rows)
    shorter = shorten_rows(start, rows, *how, NO_KEPT, body)
    for path in (rows, shorter):
        assert drive(tuple(start), path) == pytest.approx(tuple(goal), abs=1e-6)
    assert has_room_on_path(start, shorter, *body[:5], MARGIN_M - 1e-9)  # a search has the body straight at every step
    bends, fewer = (np.count_nonzero(np.diff(path[path[:, 0] > 0.0, 1])) for path in (rows, shorter))
    costs_s = [
        weigh_forms(start, path[None], np.zeros(1, np.int64), COSTS, SETTLING, NO_KEPT)[0].sum()
        for path in (rows, shorter)
    ]
    assert fewer < bends and costs_s[1] <= costs_s[0] + BEND_S * bends
    assert rows[:, 0].sum() > 2.0 * math.hypot(25.0, 25.0)  # over the end of the wall


@pytest.mark.parametrize(("wheels_s_per_m", "goes_round"), [(2.0, True), (0.0, False)])
def test_a_search_leads_round_ground_where_wheels_are_dear(wheels_s_per_m: float, goes_round: bool) -> None:
    """Forty metres through the crop are charged 80 s; round it are 12 m or so more than straight on."""
    ground, kept = build_ground(shapely.box(0.0, 0.0, 80.0, 60.0), 6.0), (CROP.grid, CROP.frame, 0.5, wheels_s_per_m)
    start, goal = np.array([8.0, 30.0, 0.0]), np.array([72.0, 30.0, 0.0])
    body = BODY.guide_m, BODY.points, BODY.reach_m, ground.grid, ground.frame, MARGIN_M
    remaining = measure_remaining_m(start, goal, 1.1, RADIUS_M, COSTS[0], kept, ground.grid, ground.frame)
    how = RADII[:1], COSTS, SETTLING, ALL_KINDS, 12.0
    rows = search_move(start, goal, remaining, *how, FAR_S_PER_M, kept, MOST_POSES, body)
    shorter = shorten_rows(start, rows, *how, kept, body)
    assert drive(tuple(start), shorter) == pytest.approx(tuple(goal), abs=1e-6)
    assert (measure_length_inside(start, shorter, *kept[:3]) <= 1.0) == goes_round
    assert shorter[:, 0].sum() == pytest.approx(84.0 if goes_round else 64.0, abs=8.0)


@pytest.mark.parametrize(("width_m", "behind_m", "most_m"), [(60.0, 30.0, 10.0), (6.0, 100.0, 103.0)])
def test_a_search_reverses_no_farther_than_it_has_to(width_m: float, behind_m: float, most_m: float) -> None:
    """To a place straight behind: there is another way on wide ground, in a lane only one at a charge."""
    ground = build_ground(shapely.box(0.0, -0.5 * width_m, 40.0 + behind_m, 0.5 * width_m), 6.0)
    start, goal = np.array([20.0 + behind_m, 0.0, 0.0]), np.array([20.0, 0.0, 0.0])
    body = BODY.guide_m, BODY.points, BODY.reach_m, ground.grid, ground.frame, MARGIN_M
    remaining, how = (
        measure_remaining_m(start, goal, 1.1, RADIUS_M, 2.0, NO_KEPT, ground.grid, ground.frame),
        (RADII[:1], COSTS, SETTLING),
    )
    rows = search_move(start, goal, remaining, *how, ALL_KINDS, 10.0, FAR_S_PER_M, NO_KEPT, MOST_POSES, body)
    backing_m = measure_backing_up(shorten_rows(start, rows, *how, ALL_KINDS, 10.0, NO_KEPT, body), 0.0)
    assert len(rows) and backing_m <= most_m
    forwards = ALL_KINDS & (np.arange(len(ALL_KINDS)) < 3)
    rows = search_move(start, goal, remaining, *how, forwards, 10.0, FAR_S_PER_M, NO_KEPT, MOST_POSES, body)
    assert bool(len(rows)) == (width_m > 6.0), "in the lane there is no way forwards"


def test_a_pocket_has_no_way_on() -> None:
    pocket, field = shapely.box(0.0, 0.0, 9.0, 5.0), shapely.box(0.0, 20.0, 80.0, 80.0)
    ground = build_ground(shapely.union(pocket, field), 6.0)
    tables = BODY.guide_m, BODY.points, BODY.reach_m, ground.grid, ground.frame, MARGIN_M
    gears = np.array([1.0, -1.0])
    found = [has_way_on(np.array(pose), gears, RADIUS_M, 400, *tables) for pose in ((4.0, 2.5, 0.0), (40.0, 50.0, 0.0))]
    assert found == [False, True]
