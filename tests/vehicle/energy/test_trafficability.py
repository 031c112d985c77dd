"""From which moisture soil is too wet: the army's worked example, measured fields, and what must hold."""

import dataclasses
from pathlib import Path

import pytest

from vehicle.energy.load import build_work_load, compute_mobility
from vehicle.energy.traction import solve_slip
from vehicle.energy.trafficability import (
    compute_cone_index_of_passes,
    compute_mobility_index,
    compute_pull_n,
    compute_tillage_limit_pct,
    compute_trafficability,
    compute_vehicle_cone_index,
    describe_trafficability,
)
from vehicle.model.soil import find_soil
from vehicle.model.tractor import load_tractor

EG105 = load_tractor("eg105")
N_PER_LBF, M_PER_INCH = 1.0 / 0.224809, 1.0 / 39.3701
MUD_TABLE = "name,moisture_pct,clay_pct,cone_index_kpa,low_kpa,high_kpa\nbog,20,20,900,800,1000\nbog,60,20,60,40,90\n"


@pytest.fixture
def bog(tmp_path: Path) -> Path:
    """A table with a soil that becomes mud: 900 kPa at 20 % of moisture, 60 kPa at 60 %."""
    path = tmp_path / "soils.csv"
    path.write_text(MUD_TABLE, encoding="utf-8")
    return path


def test_vehicle_cone_index_of_the_worked_example() -> None:
    """Priddy and Willoughby 2006: HMMWV, 13 450 lb on two axles, 37 x 12.5 in tyres, 17.4 in: 63.2 psi, 435.8 kPa."""
    size = 12.5 * M_PER_INCH, 37.0 * M_PER_INCH, 17.4 * M_PER_INCH
    axle_n = 0.5 * 13_450.0 * N_PER_LBF
    assert compute_mobility_index(axle_n, *size, has_gears=False) == pytest.approx(83.8, abs=0.05)
    assert compute_cone_index_of_passes(axle_n, *size, has_gears=False) == pytest.approx(435.8, abs=0.1)


@pytest.mark.parametrize(("clay_pct", "measured_pct"), [(18.0, 20.0), (53.0, 28.0)])
def test_tillage_limits_of_two_fields(clay_pct: float, measured_pct: float) -> None:
    """Near Berlin: 20 % of moisture with 18 % clay, 28 % with 53 %; the formula is within the 3 % that are said."""
    assert compute_tillage_limit_pct(clay_pct) == pytest.approx(measured_pct, abs=3.0)


def test_the_limits_of_a_soil_that_becomes_mud(bog: Path) -> None:
    """Just above each limit it fails, just below it goes; the softer end of the interval ends earlier."""
    load = build_work_load(EG105, 3.0, "till", find_soil("bog", 20.0, bog))
    limits = compute_trafficability(EG105, load, "bog", speed_mps=1.5, path=bog)
    assert limits is not None and limits.pull.from_pct is not None and limits.sink is not None
    needed_n = load.compute_draft_n(1.5)
    for sign, goes in ((-1, True), (1, False)):
        soil = find_soil("bog", limits.pull.from_pct + sign * 0.01, bog)
        assert (compute_pull_n(EG105, load, soil) >= needed_n) is goes
        soil = find_soil("bog", (limits.sink.from_pct or 0.0) + sign * 0.01, bog)
        assert ((soil.cone_index_kpa or 0.0) >= (compute_vehicle_cone_index(EG105) or 0.0)) is goes
    for limit in (limits.pull, limits.sink):
        assert limit.low_pct is not None and limit.from_pct is not None and limit.high_pct is not None
        assert limit.low_pct < limit.from_pct < limit.high_pct
    assert limits.slip.from_pct is not None and limits.slip.from_pct < limits.pull.from_pct
    soil = find_soil("bog", limits.slip.from_pct, bog)
    mobility = compute_mobility(EG105, soil)
    assert mobility is not None and solve_slip(needed_n / (3850.0 * 9.80665), mobility, 0.3) == pytest.approx(
        0.2, abs=1e-6
    )
    assert limits.work is not None and limits.work.from_pct == pytest.approx(7.5 + 1.91 * 2.0 + 0.34 * 20.0)


def test_a_faster_and_a_heavier_pull_end_earlier(bog: Path) -> None:
    load = build_work_load(EG105, 3.0, "till", find_soil("bog", 20.0, bog))
    heavier = dataclasses.replace(load, draft_n=(1.3 * load.draft_n[0], load.draft_n[1], load.draft_n[2]))
    cases = ((load, 1.5), (load, 3.0), (heavier, 3.0))
    found = [compute_trafficability(EG105, one, "bog", speed_mps=speed_mps, path=bog) for one, speed_mps in cases]
    ends = [limits.pull.from_pct for limits in found if limits is not None]
    assert len(ends) == 3 and None not in ends and ends == sorted(ends, reverse=True) and len(set(ends)) == 3  # type: ignore[type-var]


def test_what_is_said(bog: Path) -> None:
    load = build_work_load(EG105, 3.0, "till", find_soil("bog", 20.0, bog))
    limits = compute_trafficability(EG105, load, "bog", speed_mps=1.5, path=bog)
    assert limits is not None
    work, slip, pull, sink = describe_trafficability(limits, "bog", 25.0)
    assert work == (
        "Bog is compacted when it is worked from about 18 % of moisture (15 % at the earliest, 21 % at the latest). "
        "At present it has 25 %."
    )
    assert (
        slip.startswith("Bog lets the wheels slip by more than 20 % at work from about ") and "At present" not in slip
    )
    assert pull.startswith("Bog does not give the pull for this work from about ")
    assert sink.startswith("Bog does not carry the tractor from about ")


def test_loam_is_too_wet_to_work_long_before_it_is_too_wet_to_pull() -> None:
    load = build_work_load(EG105, 3.0, "till", find_soil("loam"))
    limits = compute_trafficability(EG105, load, "loam", speed_mps=1.5)
    assert limits is not None and limits.pull.from_pct is None and limits.work is not None
    assert len(describe_trafficability(limits, "loam", None)) == 1
    assert compute_trafficability(EG105, load, "mud", speed_mps=1.5) is None


def test_the_army_index_needs_all_axles_driven() -> None:
    assert EG105.tyres is not None
    rear_driven = EG105.model_copy(update={"tyres": EG105.tyres.model_copy(update={"driven_wheels": "2wd"})})
    load = build_work_load(rear_driven, 3.0, "till", find_soil("loam"))
    limits = compute_trafficability(rear_driven, load, "loam", speed_mps=1.5)
    assert limits is not None and limits.sink is None
    assert compute_pull_n(rear_driven, load, find_soil("loam")) < compute_pull_n(EG105, load, find_soil("loam"))
    assert compute_pull_n(EG105, load, find_soil("mud")) == float("inf")
