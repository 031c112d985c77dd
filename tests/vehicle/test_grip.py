"""Friction curve and friction circle of the tyre models: hand values, neutrality, energy, symmetry."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from vehicle.errors import VehicleError
from vehicle.model.ground import TYRE_GROUNDS, TYRE_MODELS, FrictionCurve, Tyres, get_tyres
from vehicle.records import GRAVITY_MPS2
from vehicle.sim.compile import build_tyre_ground_records
from vehicle.sim.dynamics import compute_friction_circle_share, compute_friction_share, step_body

DT = 1.0 / 60.0
ENGINE = (0.2, 1.0, 0.5, 0.75)
VELOCITY = (st.floats(-5.0, 5.0), st.floats(-2.0, 2.0), st.floats(-1.0, 1.0))
TANGENT = st.floats(-0.7, 0.7)
SETS = tuple((ground, model) for ground in TYRE_GROUNDS for model in TYRE_MODELS)


@pytest.mark.parametrize(("slip", "share"), [
    (0.0, 0.0), (0.1, 0.5), (-0.1, 0.5), (0.2, 1.0), (0.35, 0.875), (0.5, 0.75), (1.5, 0.75), (-1.5, 0.75),
])  # fmt: skip
def test_the_engine_curve_by_hand(slip: float, share: float) -> None:
    assert compute_friction_share(slip, *ENGINE) == pytest.approx(share, abs=1e-12)


@given(st.floats(-1.6, 1.6))
def test_no_curve_passes_everything(slip: float) -> None:
    assert compute_friction_share(slip, 0.0, 0.0, 0.0, 0.0) == 1.0


@given(st.floats(-1.0, 1.0), st.floats(10.0, 1e5))
def test_push_and_side_force_share_one_circle(part: float, grip: float) -> None:
    share = compute_friction_circle_share(part * grip, grip)
    if share > 0.05:
        assert share**2 + part**2 == pytest.approx(1.0)
    assert 0.05 <= share <= 1.0


def ground_of(**changes: Any) -> Any:
    return build_tyre_ground_records(
        [get_tyres("asphalt", "nonlinear", curve=None).model_copy(update={"grip": None, **changes})]
    )[0]


@given(*VELOCITY, TANGENT, st.floats(-15000.0, 15000.0))
def test_a_wide_circle_without_curve_changes_nothing(
    model: Any, forward: float, right: float, spin: float, tangent: float, drive: float
) -> None:
    plain = step_body(forward, right, spin, tangent, drive, DT, model, ground_of())
    shaped = ground_of(grip=1e9)
    assert shaped["shaped"] == 1.0
    assert step_body(forward, right, spin, tangent, drive, DT, model, shaped) == plain


@pytest.mark.parametrize(("ground", "kind"), SETS)
@given(*VELOCITY, TANGENT, st.sampled_from([1.0, 0.1, 0.01]))
def test_without_drive_the_energy_never_grows(
    model: Any, ground: str, kind: str, forward: float, right: float, spin: float, tangent: float, scale: float
) -> None:
    def energy(velocity: tuple[float, float, float]) -> float:
        u, v, r = velocity
        return 0.5 * float(model["mass"]) * (u * u + v * v) + 0.5 * float(model["inertia"]) * r * r

    before = (forward * scale, right * scale, spin * scale)
    record = build_tyre_ground_records([get_tyres(ground, kind)])[0]
    assert energy(step_body(*before, tangent, 0.0, DT, model, record)) <= energy(before)


@pytest.mark.parametrize(("ground", "kind"), SETS)
@given(*VELOCITY, TANGENT, st.floats(-15000.0, 15000.0))
def test_left_and_right_are_mirror_images(
    model: Any, ground: str, kind: str, forward: float, right: float, spin: float, tangent: float, drive: float
) -> None:
    record = build_tyre_ground_records([get_tyres(ground, kind)])[0]
    a = step_body(forward, right, spin, tangent, drive, DT, model, record)
    b = step_body(forward, -right, -spin, -tangent, drive, DT, model, record)
    assert b == pytest.approx((a[0], -a[1], -a[2]), abs=1e-9)


def test_side_force_of_a_sliding_tractor_by_hand(model: Any) -> None:
    """All four wheels straight and sliding at 0.1 rad: each passes half of 0.15 or 0.2 per degree, up to 5 degrees."""
    record = build_tyre_ground_records([get_tyres("asphalt", "nonlinear").model_copy(update={"grip": None})])[0]
    right = math.tan(0.1)
    after = step_body(1.0, right, 0.0, 0.0, 0.0, 1e-7, model, record)
    friction = 0.5 * 5.0 * (0.15 * 1.1 + 0.2 * 1.3) / 2.4
    assert (after[1] - right) / 1e-7 == pytest.approx(-friction * GRAVITY_MPS2, rel=1e-4)


def test_drive_takes_side_force_from_the_rear_wheels(model: Any) -> None:
    """Driving with 0.6 of the grip leaves the rear axle 0.8 of its side force; the front keeps all of its own."""
    record = build_tyre_ground_records(
        [get_tyres("asphalt", "nonlinear", curve=None).model_copy(update={"grip": 0.5})]
    )[0]
    rear_load = 3850.0 * GRAVITY_MPS2 * 1.3 / 2.4
    right = math.tan(math.radians(2.0))
    after = step_body(1.0, right, 0.0, 0.0, 0.6 * 0.5 * rear_load, 1e-7, model, record)
    friction = 2.0 * (0.15 * 1.1 + 0.8 * 0.2 * 1.3) / 2.4
    assert (after[1] - right) / 1e-7 == pytest.approx(-friction * GRAVITY_MPS2, rel=1e-4)


def test_no_more_drive_than_the_ground_holds(model: Any) -> None:
    record = build_tyre_ground_records(
        [get_tyres("mud", "linear").model_copy(update={"rolling_resistance": 0.0, "grip": 0.1})]
    )[0]
    after = step_body(1.0, 0.0, 0.0, 0.0, 15000.0, DT, model, record)
    assert after[0] - 1.0 == pytest.approx(DT * 0.1 * GRAVITY_MPS2 * 1.3 / 2.4)


def test_an_eased_slip_reads_the_curve_earlier(model: Any) -> None:
    """Sliding with slope 0.1 at 1 m/s, the eased slip is atan(0.1 / 2)."""
    tyres = get_tyres("asphalt", "linear").model_copy(update={"grip": None, "curve": FrictionCurve(ease_mps=1.0)})
    after = step_body(1.0, 0.1, 0.0, 0.0, 0.0, 1e-7, model, build_tyre_ground_records([tyres])[0])
    slip = math.degrees(math.atan(0.1))
    friction = math.atan(0.05) / 0.2 * slip * (0.15 * 1.1 + 0.2 * 1.3) / 2.4
    assert (after[1] - 0.1) / 1e-7 == pytest.approx(-friction * GRAVITY_MPS2, rel=1e-4)


def test_the_parameters_of_the_thesis() -> None:
    mud = get_tyres("mud", "nonlinear")
    assert (mud.front_slope_per_deg, mud.front_limit_deg, mud.rear_slope_per_deg, mud.rear_limit_deg) == (
        0.03, 2.0, 0.04, 2.0,
    )  # fmt: skip
    line = get_tyres("mud", "linear")
    assert (line.front_slope_per_deg, line.rear_slope_per_deg) == (0.0225, 0.03)
    soil = get_tyres("soil", "nonlinear")
    assert (soil.front_slope_per_deg, soil.rear_slope_per_deg, soil.rear_limit_deg) == (0.005, 0.01, 5.0)


def test_what_is_unknown_is_refused_by_name() -> None:
    with pytest.raises(VehicleError, match=r"ground 'ice' is unknown; use one of: asphalt, soil, mud"):
        get_tyres("ice", "linear")
    with pytest.raises(VehicleError, match=r"model 'magic' is unknown; use one of: kinematic, linear, nonlinear"):
        get_tyres("mud", "magic")


@pytest.mark.parametrize("changes", [{"front_slope_per_deg": 0.0}, {"rear_limit_deg": 91.0}, {"grip": -0.1},
                                     {"rolling_resistance": math.nan}])  # fmt: skip
def test_impossible_tyres_are_refused(changes: dict[str, float]) -> None:
    values = {"front_slope_per_deg": 0.1, "front_limit_deg": 5.0, "rear_slope_per_deg": 0.1, "rear_limit_deg": 5.0}
    with pytest.raises(ValidationError):
        Tyres(**{**values, **changes})


def test_plans_keep_the_plain_tyres() -> None:
    from vehicle.sim.compile import build_ground_records

    assert (np.asarray(build_ground_records()["shaped"]) == 0.0).all()
