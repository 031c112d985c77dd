"""Touching tractors and the clearance between them."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely import Polygon
from shapely.affinity import rotate, translate
from shapely.ops import unary_union

from vehicle.model.tractor import Implement, Tractor, load_tractor
from vehicle.records import STATE
from vehicle.sim.clearance import compute_outline_distance, compute_point_distance, find_too_close, is_beside
from vehicle.sim.compile import build_model_record, compute_contact_boxes
from vehicle.sim.world import simulate

SPEED = 5.0 / 3.6
# A start at 0.7 m/s^2 loses v / 2a.
START_LOSS_S = SPEED / (2 * 0.7)
POSES = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-math.pi, math.pi))
TRACTOR = load_tractor("eg105")
MODEL_3M = np.array([build_model_record(TRACTOR, Implement(width_m=3.0))])[0]
NARROW, WIDE = Implement(width_m=1.5), Implement(width_m=6.0, hitch_m=2.5)


def shape(implement: Implement, pose: tuple[float, float, float]) -> Any:
    """The outline as shapely sees it: tractor box and implement box, turned and moved."""
    boxes = compute_contact_boxes(TRACTOR, implement)
    parts = [
        Polygon([(rear, -half), (front, -half), (front, half), (rear, half)])
        for rear, front, half in (
            (boxes["tail"], boxes["nose"], boxes["half_width"]),
            (boxes["tool_tail"], boxes["tool_front"], boxes["tool_half_width"]),
        )
    ]
    turned = rotate(unary_union(parts), pose[2], origin=(0, 0), use_radians=True)
    return translate(turned, pose[0], pose[1])


def states_at(*poses: tuple[float, float, float]) -> Any:
    states = np.zeros(len(poses), dtype=STATE)
    for state, pose in zip(states, poses, strict=True):
        state["x"], state["y"], state["angle"] = pose
    return states


def test_the_outline_by_hand() -> None:
    # Rear end 1.1 + 0.74 behind the centre of mass, nose 4.26 - 1.84 ahead; tool centre 1.1 + 1.5 behind.
    assert compute_contact_boxes(TRACTOR, Implement(width_m=3.0, hitch_m=1.5, length_m=1.0)) == pytest.approx({
        "nose": 2.42, "tail": -1.84, "half_width": 1.02, "tool_front": -2.1, "tool_tail": -3.1, "tool_half_width": 1.35,
    })  # fmt: skip


@pytest.mark.parametrize(("x", "y", "expected"), [(0, 0, 0), (3, 0, 1), (-2, 0, 1), (0, -2, 1.5), (5, 4.5, 5)])
def test_point_to_box_by_hand(x: float, y: float, expected: float) -> None:
    assert compute_point_distance(x, y, -1.0, 2.0, 0.5) == pytest.approx(expected)


@given(POSES, POSES, st.sampled_from([NARROW, WIDE]), st.sampled_from([NARROW, WIDE]))
def test_distance_of_outlines_agrees_with_shapely(
    a: tuple[float, float, float], b: tuple[float, float, float], first: Implement, second: Implement
) -> None:
    expected = shape(first, a).distance(shape(second, b))
    assume(expected > 0.0)
    states = states_at(a, b)
    models = [np.array([build_model_record(TRACTOR, implement)])[0] for implement in (first, second)]
    assert compute_outline_distance(states[0], models[0], states[1], models[1]) == pytest.approx(expected, abs=1e-9)
    assert compute_outline_distance(states[1], models[1], states[0], models[0]) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        ((0.0, 7.0, 90.0), math.hypot(7.0 - 3.1 - 1.35, 2.1 - 1.35)),  # corners of the two tools
        ((10.0, 0.0, 180.0), 10.0 - 2.42 - 2.42),  # nose to nose
        ((0.0, 5.0, 0.0), 5.0 - 1.35 - 1.35),  # side by side: the tools are widest
    ],
)
def test_distance_of_outlines_by_hand(pose: tuple[float, float, float], expected: float) -> None:
    states = states_at((0.0, 0.0, 0.0), (pose[0], pose[1], math.radians(pose[2])))
    model = np.array([build_model_record(TRACTOR, Implement(width_m=3.0, hitch_m=1.5, length_m=1.0))])[0]
    assert compute_outline_distance(states[0], model, states[1], model) == pytest.approx(expected, abs=1e-9)
    assert compute_outline_distance(states[1], model, states[0], model) == pytest.approx(expected, abs=1e-9)


def test_outlines_that_cross_like_a_plus_touch_though_no_corner_is_inside() -> None:
    # A beam 5.4 m across and 0.5 m deep, 4.1 to 4.6 m behind; a tractor 2.04 m wide, from -1.84 to 2.42 m, across it.
    model = np.array([build_model_record(TRACTOR, Implement(width_m=6.0, hitch_m=3.0, length_m=0.5))])[0]
    beam = (float(model["tool_tail"]) + float(model["tool_front"])) / 2.0
    assert model["tool_half_width"] > 2.42 and model["tool_front"] - model["tool_tail"] < 2.04
    states = states_at((0.0, 0.0, 0.0), (beam, 0.0, math.pi / 2))
    assert compute_outline_distance(states[0], model, states[1], model) == 0.0
    assert compute_outline_distance(states[1], model, states[0], model) == 0.0
    clearances = np.full(2, np.inf)
    assert find_too_close(states, np.array([model]), clearances, np.zeros((2, 2)), 0.5, 0.5) == (0.0, 0, 1)


@given(st.lists(POSES, min_size=2, max_size=6))
def test_smallest_clearances_agree_with_all_pairs(poses: list[tuple[float, float, float]]) -> None:
    spread = [(x + 7.0 * i, y, angle) for i, (x, y, angle) in enumerate(poses)]
    shapes = [shape(NARROW, pose) for pose in spread]
    table = np.array([[a.distance(b) if a is not b else np.inf for b in shapes] for a in shapes])
    assume((table > 0.0).all())
    states, models = states_at(*spread), np.array([build_model_record(TRACTOR, NARROW)])
    for clearance in (-1.0, 1e8):
        clearances, starts = np.full(len(poses), np.inf), np.full((len(poses), len(poses)), np.inf)
        closest, first, second = find_too_close(states, models, clearances, starts, clearance, clearance)
        assert clearances.min() == pytest.approx(table.min(), abs=1e-9)
        assert (clearances >= table.min(axis=1) - 1e-9).all(), "never closer than the true neighbour"
    assert closest == pytest.approx(table.min(), abs=1e-9)
    assert table[first, second] == pytest.approx(table.min(), abs=1e-9)


def test_head_on_is_reported_when_the_noses_meet(build: Any, eg105: Tractor, implement: Implement) -> None:
    far = [build.leg((50, 0), (50, 30))]
    run = simulate(build.plan(far, [build.leg((0, 0), (0, 40))], [build.leg((0, 40), (0, 0))]), eg105, implement)
    # Noses are 40 - 2 x 2.42 m apart; each drives half of it.
    expected = (40.0 - 2 * 2.42) / 2 / SPEED + START_LOSS_S
    assert [(a, b) for _, a, b in run.contacts] == [(1, 2)]
    assert run.contacts[0][0] == pytest.approx(expected, abs=0.2)
    assert run.min_clearance_m < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("slow", [False, True])
def test_a_long_touch_hides_no_later_one(build: Any, eg105: Tractor, implement: Implement, slow: bool) -> None:
    """Two tractors push each other for half a minute; two others meet meanwhile."""
    early = [[build.leg((0, 0), (0, 40))], [build.leg((0, 20), (0, 0))]]
    late = [[build.leg((30, 0), (30, 40))], [build.leg((30, 40), (30, 0))]]
    run = simulate(build.plan(*early, *late), eg105, implement, max_time_s=30.0, slow=slow)
    assert [(a, b) for _, a, b in run.contacts] == [(0, 1), (2, 3)]


def test_a_stop_clearance_ends_the_run_before_the_contact(build: Any, eg105: Tractor, implement: Implement) -> None:
    plan = build.plan([build.leg((0, 0), (0, 40))], [build.leg((0, 40), (0, 20)), build.leg((0, 20), (0, 0))])
    run = simulate(plan, eg105, implement, stop_clearance_m=2.0)
    expected = (40.0 - 2 * 2.42 - 2.0) / 2 / SPEED + START_LOSS_S
    assert run.outcome == "conflict" and run.contacts == () and run.conflict is not None
    assert {run.conflict.first, run.conflict.second} == {0, 1}
    assert (run.conflict.first_leg, run.conflict.second_leg) == (0, 0)
    assert run.conflict.time_s == pytest.approx(expected, abs=0.2)
    assert run.conflict.time_s == pytest.approx(run.time_s[-1])
    assert 2.0 - 2 * SPEED * 0.1 - 0.01 < run.min_clearance_m < 2.0
    assert np.isnan(run.finish_s).all()


@pytest.mark.parametrize(("width", "apart", "expected"), [
    (3.0, 4.0, 4.0 - 2.7),  # frames of 0.9 x 3 m are wider than the tractors
    (1.5, 4.0, 4.0 - 2.04),
    (6.0, 7.5, 7.5 - 5.4),
])  # fmt: skip
def test_clearance_of_parallel_tractors(
    build: Any, eg105: Tractor, width: float, apart: float, expected: float
) -> None:
    plan = build.plan([build.leg((0, 0), (0, 20))], [build.leg((apart, 0), (apart, 20))])
    run = simulate(plan, eg105, Implement(width_m=width))
    assert run.outcome == "done" and run.contacts == ()
    assert run.min_clearance_m == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("slow", [False, True])
def test_exactly_parallel_tractors_with_gaps_between_them_do_not_touch(build: Any, eg105: Tractor, slow: bool) -> None:
    """Chipmunk takes boxes of the first and the last for touching after 1.7 s, 3 m apart, and would push them aside."""
    begins = (-14.854008233433296, 0.915549812575235), (-12.723543102625387, 2.902240687543854)
    begins = (*begins, (-10.59307797181748, 4.888931562512475))
    ends = (-21.673991834062925, 8.229086828764599), (-26.363510303884652, 17.52931471992258)
    ends = (*ends, (-17.413061572449095, 12.202468578703968))
    plan = build.plan(*[[build.leg(begin, end)] for begin, end in zip(begins, ends, strict=True)])
    run = simulate(plan, eg105, Implement(width_m=3.0), max_time_s=4.0, slow=slow)
    assert run.contacts == ()
    turns = np.abs(np.diff(np.unwrap([run.get_poses(number)[:, 2] for number in range(3)]), axis=1))
    assert turns.max() < 1e-6, "none is pushed"


def test_clearance_in_a_crossing_agrees_with_shapely_along_the_record(
    build: Any, eg105: Tractor, implement: Implement
) -> None:
    plan = build.plan([build.leg((0, 0), (0, 40))], [build.leg((-14, 30), (20, 26))])
    run = simulate(plan, eg105, implement)
    rows = run.record[:, :, :3]
    found = min(shape(implement, tuple(a)).distance(shape(implement, tuple(b))) for a, b in rows)
    assert 0.0 < found < 8.0
    assert run.min_clearance_m == pytest.approx(found, abs=1e-9)


def test_a_single_tractor_has_no_clearance(build: Any, eg105: Tractor, implement: Implement) -> None:
    run = simulate(build.plan([build.leg((0, 0), (0, 5))]), eg105, implement)
    assert math.isinf(run.min_clearance_m) and run.contacts == () and run.conflict is None


@pytest.mark.parametrize(("pose", "expected"), [
    ((3.0, 0.0, 0.0), True),  # the next track of a 3 m implement, abreast
    ((3.0, 5.2, math.pi), True),  # passing on it
    ((-3.0, 5.2, math.radians(3.0)), True),  # 3 cos 3 - 5.2 sin 3 = 2.72 m aside
    ((-3.0, 5.2, math.radians(8.0)), False),  # 2.25 m
    ((2.3, 0.0, 0.0), False),  # 1.02 m of tractor and 1.35 m of implement are in line within 2.37 m
    ((0.0, 6.0, 0.0), False),  # behind each other
    ((4.0, 0.0, math.radians(12.0)), False),
    ((4.0, 0.0, math.radians(90.0)), False),
])  # fmt: skip
def test_beside_by_hand(pose: tuple[float, float, float], expected: bool) -> None:
    x, y, turned = pose
    states, model = states_at((5.0, 7.0, math.pi / 2), (5.0 + x, 7.0 + y, math.pi / 2 + turned)), MODEL_3M
    assert is_beside(states[0], model, states[1], model) == is_beside(states[1], model, states[0], model) == expected


@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize(("beside_m", "outcome"), [(0.2, "done"), (0.4, "conflict"), (None, "conflict")])
def test_beside_each_other_another_clearance_counts(
    build: Any, eg105: Tractor, slow: bool, beside_m: float | None, outcome: str
) -> None:
    """Two pass each other 3 m apart, with 3 - 2.7 m between their implements."""
    plan = build.plan([build.leg((0, 0), (0, 25))], [build.leg((3, 25), (3, 0))])
    run = simulate(plan, eg105, Implement(width_m=3.0), stop_clearance_m=0.5, beside_clearance_m=beside_m, slow=slow)
    assert run.outcome == outcome
    assert outcome == "conflict" or run.min_clearance_m == pytest.approx(0.3, abs=1e-6)


def test_behind_each_other_the_whole_clearance_counts(build: Any, eg105: Tractor, implement: Implement) -> None:
    plan = build.plan([build.leg((0, 10), (0, 12))], [build.leg((0, 0), (0, 20))])
    run = simulate(plan, eg105, implement, stop_clearance_m=0.5, beside_clearance_m=0.05)
    assert run.outcome == "conflict" and 0.2 < run.min_clearance_m < 0.5


def test_a_pair_that_is_too_close_counts_however_close_another_has_been() -> None:
    """Without that, a pair at 0.4 m would pass unseen once others had been at 0.3 m."""
    states = states_at((0.0, 0.0, 0.0), (0.0, 3.0, 0.0), (60.0, 0.0, 0.0), (65.0 + 0.22, 0.0, math.pi))
    models, clearances = np.array([MODEL_3M]), np.full(4, 0.3)
    found = find_too_close(states, models, clearances, np.full((4, 4), np.inf), 0.5, 0.1)
    assert found[1:] == (2, 3) and found[0] == pytest.approx(5.22 - 2 * 2.42)
