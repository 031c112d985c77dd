"""The load of a plan from tractor, operation and soil."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.energy.draft import get_draft_rule
from vehicle.energy.load import DriveTyre, build_work_load, compute_mobility, list_drive_tyres
from vehicle.energy.traction import compute_net_traction
from vehicle.errors import VehicleError
from vehicle.model.soil import find_soil, load_soils
from vehicle.model.tractor import load_tractor

EG105 = load_tractor("eg105")
BARE = EG105.model_copy(update={"engine": None, "tyres": None, "stability": None})


def test_the_load_of_a_tillage_by_hand() -> None:
    """20 tines of 0.85 (46 + 2.8 v) N per cm in loam, 10 cm deep; Bn of 0.43 x 1.48 m and 0.315 x 1.16 m tyres."""
    load = build_work_load(EG105, 3.0, "till", find_soil("firm"), implement_mass_kg=500.0)
    assert load.compute_draft_n(10.0 / 3.6) == pytest.approx(20 * 0.85 * (46 + 28) * 10)
    assert (load.engine_power_w, load.driveline_efficiency, load.driven_share) == (77_000.0, 0.86, 1.0)
    front_n = 0.5 * 3850.0 * 9.80665 * 1.1 / 2.4
    rear_n = 0.5 * (3850.0 * 1.3 / 2.4 + 500.0) * 9.80665
    rear = 1200e3 * 0.43 * 1.48 / rear_n * 2.0 / (1.0 + 3.0 * 0.43 / 1.48)
    front = 1200e3 * 0.315 * 1.16 / front_n * 2.0 / (1.0 + 3.0 * 0.315 / 1.16)
    expected = (rear * rear_n + front * front_n) / (rear_n + front_n)
    assert load.mobility_number == pytest.approx(expected)
    assert load.rolling_share == pytest.approx(0.04 + 1.0 / expected)


@pytest.mark.parametrize(("name", "expected"), [("hard", 80), ("firm", 53), ("tilled", 40), ("soft", 20)])
def test_a_usual_tyre_has_the_mobility_of_the_classes(name: str, expected: float) -> None:
    """D497, clause on traction: 80, 55, 40 (30 in older editions) and 20 (15) for tyres near their rated load."""
    assert compute_mobility(BARE, find_soil(name)) == pytest.approx(expected, rel=0.05)


def test_a_ground_of_the_thesis_changes_nothing_but_its_rolling() -> None:
    load = build_work_load(EG105, 3.0, "spray", find_soil("mud"))
    assert load.mobility_number is None and load.rolling_share == 0.10 and load.draft_n == (0.0, 0.0, 0.0)
    assert build_work_load(EG105, 3.0, "spray").rolling_share is None


def test_what_the_tractor_file_does_not_say_is_not_limited() -> None:
    load = build_work_load(BARE, 3.0, "till", find_soil("loam"))
    assert load.engine_power_w == math.inf and load.driveline_efficiency == 0.86 and load.centre_height_m is None
    assert build_work_load(BARE, 3.0, "till", engine_power_kw=50.0).engine_power_w == 50_000.0
    with pytest.raises(VehicleError, match="The mass of the implement is -5"):
        build_work_load(EG105, 3.0, "till", implement_mass_kg=-5.0)


def test_two_driven_wheels_carry_the_rear_and_the_implement() -> None:
    assert EG105.tyres is not None
    tyres = EG105.tyres.model_copy(update={"driven_wheels": "2wd"})
    load = build_work_load(EG105.model_copy(update={"tyres": tyres}), 3.0, "till", implement_mass_kg=650.0)
    assert load.driven_share == pytest.approx((3850.0 * 1.3 / 2.4 + 650.0) / 4500.0)


def test_another_implement_and_clay_pull_more() -> None:
    plough = get_draft_rule("plough")
    sand, clay = (build_work_load(EG105, 1.4, "till", find_soil(name), rule=plough) for name in ("sand", "clay"))
    assert clay.compute_draft_n(1.5) == pytest.approx(sand.compute_draft_n(1.5) / 0.45)
    assert clay.compute_draft_n(1.5) == pytest.approx(plough.compute_draft_n(1.4, 1.5, "fine"))


@given(
    st.sampled_from(sorted(name for name, rows in load_soils().items() if rows[0].cone_index_kpa)), st.floats(0.0, 0.3)
)
def test_the_mean_of_the_axles_pulls_as_both_do(name: str, slip: float) -> None:
    """Net traction at the mean mobility number against the sum over the axles: 2 % or 0.004 of the weight."""
    soil, tyres = find_soil(name), list_drive_tyres(EG105, 300.0)
    mean = compute_mobility(EG105, soil, 300.0)
    assert mean is not None and soil.cone_index_kpa is not None and len(tyres) == 2
    pulls = [compute_net_traction(slip, tyre.compute_mobility(soil.cone_index_kpa)) * tyre.load_n for tyre in tyres]
    both = sum(pulls) / sum(tyre.load_n for tyre in tyres)
    assert compute_net_traction(slip, mean) == pytest.approx(both, rel=0.02, abs=0.004)


def test_a_wider_tyre_sinks_less() -> None:
    assert DriveTyre(width_m=0.6).compute_mobility(600.0) > DriveTyre().compute_mobility(600.0)
