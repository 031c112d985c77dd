"""Logs held against the size of the tractor they are said to be of."""

from functools import lru_cache

import pytest

from tests.measured.drawn import circle, log
from tests.measured.tables import refusal, runs
from tests.truth.effects import CLEAR_SIZES
from tests.truth.model import make_logs
from vehicle.measured.logs.reading import Log, log_from_frame
from vehicle.measured.logs.size import as_driven, misfit, refuse_other, size_of
from vehicle.tractor import Tractor, load_tractor


@lru_cache(maxsize=1)
def driven() -> tuple[Log, ...]:
    return tuple(log_from_frame(frame, name) for name, frame in runs().items())


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
    assert misfit(driven(), own, "soil") == ""
    assert size_of(driven(), own, "soil").bends == pytest.approx(1.0, abs=0.06)
    assert as_driven(driven(), own, "soil") is own


@pytest.mark.parametrize("name", ["steering_gain", "steering_rate", "side_slip", "steering_dead_time"])
def test_no_effect_makes_it_another_tractor(name: str) -> None:
    effects = {name: CLEAR_SIZES[name]}
    for drop in ((), ("steering_deg",)):
        logs = [log_from_frame(one, "run") for one in make_logs(effects, 4, rate_hz=5.0, drop=drop)[2:10]]
        assert misfit(logs, load_tractor("eg105"), "soil") == ""


@pytest.mark.parametrize("factor", [0.2, 2.8, 6.0])
def test_the_size_of_another_vehicle_is_told_and_taken(factor: float) -> None:
    true = load_tractor("eg105").wheelbase_m
    other = times(factor)
    text = refusal(lambda: refuse_other(driven(), other, "soil"))
    assert text.startswith("These logs are not of this tractor: at the same wheel angles their path bends")
    assert "as_driven to go on with these" in text
    taken = as_driven(driven(), other, "soil")
    assert taken.wheelbase_m == pytest.approx(true, rel=0.06)
    assert misfit(driven(), taken, "soil") == ""


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_angle_all_along_tells_a_size_that_is_far_off(side: float) -> None:
    own = load_tractor("eg105")
    bend = log(circle(side / own.power_law("soil").radius_m(10.0 * side)), steering_deg=10.0 * side)
    straight = log(circle(0.0), steering_deg=10.0)
    assert misfit([bend], own, "soil") == misfit([straight], times(6.0), "soil") == ""
    assert "bends 6 times" in misfit([bend], times(6.0), "soil")
    assert misfit([bend], times(2.5), "soil") == "", "an offset of some degrees may do so much"
    assert as_driven([bend], times(6.0), "soil").wheelbase_m == pytest.approx(own.wheelbase_m, rel=0.05)


def test_wheels_do_not_turn_beyond_their_lock() -> None:
    narrow = times(1.0, max_steering_deg=15.0)
    assert "their wheels turn to 30 degrees, and the lock of Yanmar EG105 is at 15" in refusal(
        lambda: refuse_other(driven(), narrow, "soil")
    )
    assert as_driven(driven(), narrow, "soil").max_steering_deg == pytest.approx(30.0, abs=1.0)
