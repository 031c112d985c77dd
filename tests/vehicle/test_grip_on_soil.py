"""Grip on soil: slip at work, the bound of side force, the friction circle, and what keeps its bytes."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.energy.load import build_work_load
from vehicle.energy.traction import compute_net_traction, compute_traction_envelope
from vehicle.energy.trafficability import compute_grip_at_work
from vehicle.model.soil import find_soil
from vehicle.model.tractor import Implement, Tractor, load_tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import GRAVITY_MPS2
from vehicle.sim.compile import build_ground_records, build_model_record
from vehicle.sim.dynamics import step_body, step_loaded_body

EG105 = load_tractor("eg105")
DT = 1e-7
SOILS = ("hard", "firm", "tilled", "soft", "loam", "clay")


def build_records(load: WorkLoad, tractor: Tractor = EG105) -> tuple[Any, Any]:
    model = np.array([build_model_record(tractor, Implement(), load)]).view(np.recarray)[0]
    return model, build_ground_records(load).view(np.recarray)[1]


def measure_side_forces(load: WorkLoad, thrust_n: float) -> float:
    """Side force of all tyres over the weight, of a tractor that slides at 45 degrees."""
    model, ground = build_records(load)
    _, right, spin = step_loaded_body(1.0, 1.0, 0.0, 0.0, 0.0, thrust_n, DT, model, ground)
    assert math.isfinite(spin)
    return (1.0 - right) / DT / GRAVITY_MPS2


@pytest.mark.parametrize("mobility", [3.0, 8.0, 12.0])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_sliding_tyres_hold_what_the_soil_bears(mobility: float, share: float) -> None:
    """Below the limits of the thesis (0.75 and 1.0 of the load) all wheels hold the same share of it."""
    envelope = 0.88 * (1.0 - math.exp(-0.1 * mobility))
    thrust_n = share * envelope * EG105.mass_kg * GRAVITY_MPS2
    held = measure_side_forces(WorkLoad(mobility_number=mobility, rolling_share=0.04 + 1.0 / mobility), thrust_n)
    assert held == pytest.approx(envelope * math.sqrt(1.0 - share**2), rel=1e-4)


def test_front_wheels_that_are_not_driven_keep_their_side_force() -> None:
    load = WorkLoad(mobility_number=5.0, rolling_share=0.24, driven_share=0.6)
    envelope = compute_traction_envelope(5.0)
    front_share = EG105.rear_axle_m / (EG105.front_axle_m + EG105.rear_axle_m)
    thrust_n = 0.8 * envelope * 0.6 * EG105.mass_kg * GRAVITY_MPS2
    expected = envelope * (front_share + (1.0 - front_share) * 0.6)
    assert measure_side_forces(load, thrust_n) == pytest.approx(expected, rel=1e-4)


def test_on_hard_soil_the_limits_of_the_thesis_count() -> None:
    front_share = EG105.rear_axle_m / (EG105.front_axle_m + EG105.rear_axle_m)
    held = measure_side_forces(WorkLoad(mobility_number=1e5, rolling_share=0.1), 0.0)
    assert held == pytest.approx(0.75 * front_share + 0.88 * (1.0 - front_share), rel=1e-4)


@given(st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-15e3, 15e3), st.floats(-15e3, 15e3))
def test_grounds_of_the_thesis_keep_their_bytes(
    forward: float, right: float, spin: float, drive: float, thrust: float
) -> None:
    for name in ("asphalt", "soil", "mud"):
        model, ground = build_records(build_work_load(EG105, 3.0, "till", find_soil(name)))
        plain = step_body(forward, right, spin, 0.1, drive, 1 / 60, model, ground)
        assert step_loaded_body(forward, right, spin, 0.1, drive, thrust, 1 / 60, model, ground) == plain


@given(st.floats(0.5, 3.0), st.floats(-0.02, 0.02), st.floats(-0.01, 0.01), st.floats(0.0, 10e3))
def test_small_slip_angles_are_those_of_the_steering_table(
    forward: float, right: float, spin: float, thrust: float
) -> None:
    """Within the limits the soil changes nothing."""
    model, ground = build_records(build_work_load(EG105, 3.0, "till", find_soil("firm")))
    plain = step_body(forward, right, spin, 0.0, 0.0, 1 / 60, model, ground)
    assert step_loaded_body(forward, right, spin, 0.0, 0.0, thrust, 1 / 60, model, ground) == plain


@pytest.mark.parametrize("name", SOILS)
def test_what_a_plan_is_told_is_within_its_interval(name: str) -> None:
    soil = find_soil(name)
    load = build_work_load(EG105, 3.0, "till", soil)
    grip = compute_grip_at_work(EG105, load, soil, 2.0)
    assert grip is not None and load.mobility_number is not None
    assert grip.side_low <= grip.side_limit <= grip.side_high <= 0.88 and 0.0 < grip.side_at_work < grip.side_limit
    weight_n = EG105.mass_kg * GRAVITY_MPS2
    thrust_n = load.compute_draft_n(2.0) + (load.rolling_share or 0.0) * weight_n
    assert grip.side_at_work == pytest.approx(math.sqrt(grip.side_limit**2 - (thrust_n / weight_n) ** 2))
    assert compute_net_traction(grip.slip, load.mobility_number) * weight_n == pytest.approx(load.compute_draft_n(2.0))
    assert 0.4 < grip.pulling_share < 0.81


def test_wheels_that_are_not_driven_are_pulled_along() -> None:
    """With 60 % of the weight on driven wheels, these push the draft and what the others resist."""
    soil = find_soil("firm")
    load = replace(build_work_load(EG105, 3.0, "till", soil), driven_share=0.6)
    grip = compute_grip_at_work(EG105, load, soil, 2.0)
    assert grip is not None and load.mobility_number is not None and load.rolling_share is not None
    weight_n = EG105.mass_kg * GRAVITY_MPS2
    pushed_n = compute_net_traction(grip.slip, load.mobility_number) * 0.6 * weight_n
    assert pushed_n == pytest.approx(load.compute_draft_n(2.0) + load.rolling_share * 0.4 * weight_n)


def test_the_grounds_of_the_thesis_say_nothing_of_it() -> None:
    soil = find_soil("mud")
    assert compute_grip_at_work(EG105, build_work_load(EG105, 3.0, "till", soil), soil, 2.0) is None
