"""Logs held against the size of the tractor they are said to be of."""

from functools import lru_cache

import pytest

from tests.examples import seldom
from tests.identification.analytic_drives import circle, log
from tests.identification.log_tables import refusal, runs
from tests.truth.drives import default_programme
from tests.truth.effects import CLEAR_SIZES
from tests.truth.model import make_logs
from vehicle.identification.diagnosis.other_vehicles import (
    explain_other_vehicle,
    measure_size,
    refuse_other_vehicle,
    scale_to_logs,
)
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.model.tractor import Tractor, load_tractor


@lru_cache(maxsize=1)
def driven() -> tuple[Log, ...]:
    return tuple(build_log(frame, name) for name, frame in runs().items())


def times(factor: float, **changed: object) -> Tractor:
    """The thesis's tractor on paper, all lengths and radii by a factor."""
    own = load_tractor("eg105").model_dump()
    lengths = ("front_axle_m", "rear_axle_m", "track_m", "length_m", "width_m", "rear_overhang_m")
    for law in own["radius"].values():
        for side in ("right", "left"):
            law[side] = (law[side][0] / factor, law[side][1])
    return Tractor.model_validate(own | {name: own[name] * factor for name in lengths} | changed)


def test_logs_of_the_tractor_fit_it() -> None:
    own = load_tractor("eg105")
    assert explain_other_vehicle(driven(), own, "soil") == ""
    assert measure_size(driven(), own, "soil").bend_ratio == pytest.approx(1.0, abs=0.06)
    assert scale_to_logs(driven(), own, "soil") is own


@pytest.mark.parametrize("name", ["steering_gain", *seldom("steering_rate", "side_slip", "steering_dead_time")])
def test_no_effect_makes_it_another_tractor(name: str) -> None:
    effects = {name: CLEAR_SIZES[name]}
    drives = default_programme()[2:10]
    for drop in ((), ("steering_deg",)):
        logs = [build_log(one, "run") for one in make_logs(effects, 4, drives, rate_hz=5.0, drop=drop)]
        assert explain_other_vehicle(logs, load_tractor("eg105"), "soil") == ""


@pytest.mark.parametrize("factor", [0.2, 2.8, 6.0])
def test_the_size_of_another_vehicle_is_told_and_taken(factor: float) -> None:
    true = load_tractor("eg105").wheelbase_m
    other = times(factor)
    text = refusal(lambda: refuse_other_vehicle(driven(), other, "soil"))
    assert text.startswith("These logs are not of this tractor: at the same wheel angles their path bends")
    assert "as_driven to use this size" in text
    taken = scale_to_logs(driven(), other, "soil")
    assert taken.wheelbase_m == pytest.approx(true, rel=0.06)
    assert explain_other_vehicle(driven(), taken, "soil") == ""


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_angle_all_along_tells_a_size_that_is_far_off(side: float) -> None:
    own = load_tractor("eg105")
    bend = log(circle(side / own.get_power_law("soil").compute_radius_m(10.0 * side)), steering_deg=10.0 * side)
    straight = log(circle(0.0), steering_deg=10.0)
    assert explain_other_vehicle([bend], own, "soil") == explain_other_vehicle([straight], times(6.0), "soil") == ""
    assert "bends 6 times" in explain_other_vehicle([bend], times(6.0), "soil")
    assert explain_other_vehicle([bend], times(2.5), "soil") == "", "an offset of some degrees may do so much"
    assert scale_to_logs([bend], times(6.0), "soil").wheelbase_m == pytest.approx(own.wheelbase_m, rel=0.05)


def test_wheels_do_not_turn_beyond_their_lock() -> None:
    narrow = times(1.0, max_steering_deg=15.0)
    assert "their wheels turn to 30 degrees, and the steering lock of Yanmar EG105 is at 15" in refusal(
        lambda: refuse_other_vehicle(driven(), narrow, "soil")
    )
    assert scale_to_logs(driven(), narrow, "soil").max_steering_deg == pytest.approx(30.0, abs=1.0)
