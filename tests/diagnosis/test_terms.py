"""Effects in the simulator: closed forms of the terms, and what they do to a tractor that drives."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.errors import VehicleError
from vehicle.missions.plan import Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.effects import CATALOGUE, NEUTRAL_FIELDS, check_effect, compute_effect_fields, get_neutral_values
from vehicle.model.ground import find_ground_index
from vehicle.model.tractor import DiscrepancyModel, EffectSetting, Implement, Tractor, load_tractor
from vehicle.records import STATE
from vehicle.sim import effect_terms
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.compile import MODEL, build_ground_records, build_model_record
from vehicle.sim.dynamics import step_speed_control, step_steering_system
from vehicle.sim.world import simulate

EG105 = load_tractor("eg105")
SOIL = find_ground_index("soil")
SEEN = DiscrepancyModel(
    amounts={"grip_by_speed": 0.1, "angle_by_square": 0.5}, speed_mps=(0.5, 2.5), angle_deg=(-20.0, 20.0)
)


def with_effect(name: str, **value: float) -> Tractor:
    return EG105.model_copy(update={"effects": {name: EffectSetting(value=value)}})


def model(tractor: Tractor) -> np.ndarray:
    return np.array([build_model_record(tractor, Implement())])[0]


def tangent(tractor: Tractor, angle_deg: float, speed: float = 1.4, working: float = 0.0, **place: float) -> float:
    table = build_steering_tables(EG105)[SOIL]
    return effect_terms.compute_affected_tangent(
        math.radians(angle_deg), speed, place.get("east", 0.0), place.get("north", 0.0), 1.0, 0.0,
        place.get("seconds", 0.0), working, table, model(tractor),
    )  # fmt: skip


def drive(tractor: Tractor, length: float = 60.0, implement: bool = False) -> SimulationRun:
    leg = Leg(np.array([[0.0, 0.0], [0.0, length]]), 1.4, implement=implement, task=LegTask("track"))
    return simulate(Plan((Mission((leg,)),)), tractor, Implement())


def test_every_field_of_an_effect_is_in_the_record_and_neutral_changes_nothing() -> None:
    assert set(NEUTRAL_FIELDS) <= set(MODEL.names or ())
    for entry in CATALOGUE:
        values = get_neutral_values(entry.id, EG105.steering)
        fields = compute_effect_fields({entry.id: values})
        assert set(fields) <= set(MODEL.names or ())
        tractor = with_effect(entry.id, **values)
        for angle in (-20.0, -1.0, 0.0, 3.0, 30.0):
            assert tangent(tractor, angle) == pytest.approx(
                tangent(with_effect("steering_offset", angle_deg=0.0), angle)
            )


def test_a_neutral_effect_drives_like_none() -> None:
    plain, neutral_run = drive(EG105), drive(with_effect("steering_offset", angle_deg=0.0))
    assert np.array_equal(plain.record, neutral_run.record)


def test_tangents_follow_their_definitions() -> None:
    base = tangent(EG105, 10.0)
    assert tangent(with_effect("steering_gain", ratio=1.2), 10.0) == pytest.approx(1.2 * base)
    assert tangent(with_effect("steering_asymmetry", ratio=1.2), 10.0) == pytest.approx(base)
    left = tangent(EG105, -10.0)
    assert tangent(with_effect("steering_asymmetry", ratio=1.2), -10.0) == pytest.approx(1.2 * left)
    assert tangent(with_effect("steering_offset", angle_deg=2.0), 8.0) == pytest.approx(base)
    draft = with_effect("implement_side_draft", curvature_per_m=0.01)
    assert tangent(draft, 10.0, working=1.0) == pytest.approx(base + 0.01 * EG105.wheelbase_m)
    assert tangent(draft, 10.0) == pytest.approx(base)


def test_grip_belongs_to_its_place_and_its_time() -> None:
    base = tangent(EG105, 10.0)
    patch = with_effect("grip_patch", ratio=0.5, east_m=10.0, north_m=0.0, radius_m=5.0)
    assert tangent(patch, 10.0, east=13.0) == pytest.approx(0.5 * base)
    assert tangent(patch, 10.0, east=16.0) == pytest.approx(base)
    drift = with_effect("grip_drift", per_minute=0.1)
    assert tangent(drift, 10.0, seconds=30.0) == pytest.approx(1.05 * base)
    assert tangent(drift, 10.0, seconds=3600.0) == pytest.approx((1.0 + effect_terms.DRIFT_LIMIT) * base)


@given(st.floats(0.5, 3.0), st.floats(0.1, 6.0))
def test_understeer_takes_its_angle_per_acceleration(speed: float, loss: float) -> None:
    """On a circle, what is lost must be the loss times the lateral acceleration of what is left."""
    table = build_steering_tables(EG105)[SOIL]
    record = model(with_effect("understeer", deg_per_mps2=loss))
    left = effect_terms.solve_understeer(math.radians(12.0), speed, table, record)
    held = tangent(EG105, math.degrees(left))
    assert math.radians(12.0) - left == pytest.approx(
        math.radians(loss) * speed**2 * held / EG105.wheelbase_m, rel=0.02
    )


@given(st.floats(0.03, 0.3), st.floats(0.5, 5.0), st.floats(-30.0, 30.0))
def test_side_force_has_a_limit(limit: float, speed: float, angle: float) -> None:
    held = tangent(with_effect("side_slip", limit_g=limit), angle, speed)
    assert abs(held) * speed**2 / EG105.wheelbase_m <= limit * effect_terms.GRAVITY_MPS2 * (1.0 + 1e-9)
    assert abs(held) <= abs(tangent(EG105, angle, speed)) + 1e-12


@given(st.lists(st.floats(-0.3, 0.3), min_size=1, max_size=40), st.floats(0.0, 5.0))
def test_play_never_leaves_its_gap(angles: list[float], width: float) -> None:
    record, play = model(with_effect("steering_backlash", angle_deg=width)), 0.0
    for angle in angles:
        before, play = play, float(effect_terms.apply_play(play, angle, record))
        assert abs(play - angle) <= math.radians(width / 2.0) + 1e-12
        assert play == before or abs(abs(play - angle) - math.radians(width / 2.0)) < 1e-12


def test_delay_reads_between_steps() -> None:
    ring = np.zeros(8)
    for step in range(20):
        ring[step % 8] = step
    assert effect_terms.read_delayed(ring, 19, 2.25) == pytest.approx(16.75)
    assert effect_terms.read_delayed(ring, 19, 0.0) == 19.0


def test_a_slope_pushes_downhill_whichever_way_one_drives() -> None:
    record = model(with_effect("cross_slope_drift", ratio=0.05, bearing_deg=90.0))
    assert effect_terms.compute_ground_drift(0.0, 2.0, math.cos(math.pi / 2), 1.0, record) == pytest.approx((0.0, 0.1))
    assert effect_terms.compute_ground_drift(0.0, 2.0, math.cos(-math.pi / 2), -1.0, record) == pytest.approx(
        (0.0, -0.1)
    )
    assert effect_terms.compute_ground_drift(0.0, 2.0, 1.0, 0.0, record) == pytest.approx((0.0, 0.0))


def test_wheel_slip_slows_the_plan_in_proportion() -> None:
    plain, slow = drive(EG105), drive(with_effect("wheel_slip", ratio=0.2))
    assert plain.outcome == slow.outcome == DONE
    steady = slice(150, 300)
    assert slow.record[steady, 0, 4].mean() == pytest.approx(0.8 * plain.record[steady, 0, 4].mean(), rel=5e-3)
    down = with_effect("implement_slip", ratio=0.2)
    assert drive(down).duration_s == pytest.approx(plain.duration_s, abs=0.2)
    assert drive(down, implement=True).duration_s == pytest.approx(slow.duration_s, rel=0.02)


def paced(lag_s: float, start: float, target: float, steps: int) -> np.ndarray:
    """Reference speed after each step of 1/60 s towards a target."""
    state, record, out = np.zeros(1, dtype=STATE), model(with_effect("speed_lag", time_s=lag_s)), np.empty(steps)
    state["reference_speed"], state["target_speed"] = start, target
    ground = build_ground_records()[SOIL]
    for step in range(steps):
        step_speed_control(state[0], record, ground, float(state[0]["reference_speed"]), 1.0 / 60.0)
        out[step] = state[0]["reference_speed"]
    return out


@pytest.mark.parametrize(("lag_s", "start", "target"), [(0.8, 1.0, 1.4), (2.0, 2.0, 1.0)])
def test_a_small_change_of_speed_follows_its_time_constant(lag_s: float, start: float, target: float) -> None:
    """Below the acceleration that the drive line has, the speed is an exponential."""
    time = np.arange(1, 61) / 60.0
    assert paced(lag_s, start, target, 60) == pytest.approx(target + (start - target) * np.exp(-time / lag_s))


def test_a_lag_keeps_to_the_acceleration_and_comes_to_a_standstill() -> None:
    steep = np.diff(paced(0.8, 0.0, 3.0, 120))
    assert steep[:60] == pytest.approx(0.7 / 60.0) and steep.max() <= 0.7 / 60.0 + 1e-12
    assert paced(0.8, 1.0, 0.0, 600)[-1] == 0.0


def test_a_tractor_with_a_lag_brakes_in_time() -> None:
    plain, late = drive(EG105), drive(with_effect("speed_lag", time_s=2.0))
    assert plain.outcome == late.outcome == DONE
    assert late.duration_s > plain.duration_s + 2.0
    assert late.record[:, 0, 1].max() < plain.record[:, 0, 1].max() + 0.05


def test_an_antenna_to_the_right_shifts_the_track_to_the_left() -> None:
    run = drive(with_effect("antenna_right", distance_m=0.15))
    assert run.outcome == DONE
    assert run.record[300:350, 0, 0].mean() == pytest.approx(-0.15, abs=0.01)


def first_move(dead_time_s: float) -> int:
    """Step at which the wheels move after the command jumped from 0 to 10 degrees a second into the run."""
    state, record = np.zeros(1, dtype=STATE), model(with_effect("steering_dead_time", time_s=dead_time_s))
    for step in range(180):
        state["command"] = math.radians(10.0) if step >= 60 else 0.0
        step_steering_system(state[0], record, 1.0 / 60.0)
        state["clock"] += 1
        if state[0]["steering"] != 0.0:
            return step
    raise AssertionError("the wheels never moved")


def test_dead_time_holds_the_wheels_back() -> None:
    assert first_move(0.0) == 60
    assert first_move(0.5) == 90


def with_rest(rest: DiscrepancyModel) -> Tractor:
    return EG105.model_copy(update={"discrepancy_model": rest})


def test_the_rest_follows_its_definition_where_it_was_seen() -> None:
    turned = tangent(EG105, 10.0 + 0.5 * 2.0**2, 2.0)
    assert tangent(with_rest(SEEN), 10.0, 2.0) == pytest.approx(1.2 * turned)


def test_the_rest_fades_and_ends_outside_of_what_was_seen() -> None:
    for angle, speed in ((10.0, 2.71), (24.1, 1.4), (-24.1, 1.4), (10.0, 0.29)):
        assert tangent(with_rest(SEEN), angle, speed) == pytest.approx(tangent(EG105, angle, speed), rel=1e-9)
    half = effect_terms.compute_discrepancy_trust(math.radians(22.0), 1.4, model(with_rest(SEEN)))
    assert half == pytest.approx(0.5)


def test_the_rest_can_be_switched_off() -> None:
    off = with_rest(SEEN.model_copy(update={"on": False}))
    assert np.array_equal(drive(off).record, drive(EG105).record)


def test_a_push_carries_a_tractor_that_drives_and_no_other() -> None:
    record = model(
        with_rest(DiscrepancyModel(amounts={"push_to_east": 0.1}, speed_mps=(0.0, 3.0), angle_deg=(-5.0, 5.0)))
    )
    assert effect_terms.compute_ground_drift(0.0, 1.4, 1.0, 0.0, record) == pytest.approx((0.1, 0.0))
    assert effect_terms.compute_ground_drift(0.0, 1.4, 0.0, 1.0, record) == pytest.approx((0.0, 0.1))
    assert effect_terms.compute_ground_drift(0.0, 0.0, 1.0, 0.0, record) == pytest.approx((0.0, 0.0))
    assert effect_terms.compute_ground_drift(math.radians(30.0), 1.4, 1.0, 0.0, record) == pytest.approx((0.0, 0.0))


@pytest.mark.parametrize(
    ("values", "word"),
    [({"amounts": {"grip_by_moon": 1.0}}, "grip_by_moon"), ({"amounts": {"grip_by_speed": math.inf}}, "finite"),
     ({"angle_deg": (5.0, -5.0)}, "smaller value first"), ({"speed_mps": (2.0, 2.0)}, "smaller value first")],
)  # fmt: skip
def test_an_impossible_rest_is_refused(values: dict[str, Any], word: str) -> None:
    with pytest.raises((VehicleError, ValueError), match=word):
        DiscrepancyModel(**({"amounts": {}, "speed_mps": (0.0, 3.0), "angle_deg": (-5.0, 5.0)} | values))


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [("steering_ofset", {"angle_deg": 1.0}, "unknown"), ("steering_offset", {"angle": 1.0}, "angle_deg"),
     ("steering_offset", {"angle_deg": 40.0}, "-8 to 8"), ("wheel_slip", {"ratio": math.nan}, "ratio")],
)  # fmt: skip
def test_impossible_effects_are_refused(name: str, value: dict[str, float], word: str) -> None:
    with pytest.raises(VehicleError, match=word):
        check_effect(name, value)
