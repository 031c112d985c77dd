"""Effects and terms of the rest as coordinates of one tractor."""

import numpy as np
import pytest

from tests.measured.benches import eg105, knobs
from vehicle.effects import BY_ID
from vehicle.measured.fit.knobs import block_of, finest_of, knobs_for, rest_knobs, settings_of
from vehicle.rest import MOST, REST


def test_starts_are_those_of_the_catalogue_or_shares_of_the_file() -> None:
    lag = eg105().steering.lag_s
    assert knobs("steering_lag").starts == tuple((lag * share,) for share in (0.5, 1.6, 2.5, 4.0, 7.0))
    assert knobs("steering_backlash").starts == ((0.5,), (1.5,), (3.0,))
    assert knobs("steering_offset").starts == ((0.0,),)
    assert knobs("steering_dead_time").with_fewer_starts().starts == ((0.05,), (0.2,), (0.35,), (0.5,), (0.9,))
    assert knobs("steering_backlash").with_fewer_starts() == knobs("steering_backlash")


def test_a_patch_is_fixed_for_what_is_searched_and_for_nothing_else() -> None:
    patch = (10.0, 5.0, 16.0)
    assert knobs_for(eg105(), "grip_patch", {"grip_patch": patch}).values(np.array([1.3])) == {
        "ratio": 1.3, "east_m": 10.0, "north_m": 5.0, "radius_m": 16.0
    }  # fmt: skip
    assert knobs_for(eg105(), "steering_offset", {"grip_patch": patch}).fixed == ()


def test_coordinates_stay_inside_what_a_tractor_can_have() -> None:
    assert knobs("steering_offset").inside(np.array([-30.0])).tolist() == [-8.0]
    assert knobs("cross_slope_drift").inside(np.array([0.7, -0.7])).tolist() == [0.5, -0.5]
    assert knobs("cross_slope_drift").deviation(np.array([0.03, -0.04])) == pytest.approx(0.05)


def test_the_two_components_of_a_rest_go_together() -> None:
    groups = rest_knobs()
    assert sum(len(group) for group in groups) == len(REST)
    assert [one.id for one in groups[2]] == ["angle_to_east", "angle_to_north"]
    assert groups[0][0].values(np.array([0.5])) == {"angle_by_speed": 0.5}
    assert groups[0][0].inside(np.array([-1e9])).tolist() == [-MOST], "a file may have no more"


def test_times_are_not_told_finer_than_half_a_row() -> None:
    assert finest_of(eg105(), "steering_dead_time", 0.05) == 0.05
    assert finest_of(eg105(), "steering_dead_time", 1.0) == 0.5
    assert finest_of(eg105(), "steering_offset", 1.0) == BY_ID["steering_offset"].size.finest


def test_settings_and_blocks_are_those_of_the_catalogue() -> None:
    parts = [(knobs("steering_offset"), np.array([1.5])), (knobs("side_slip"), np.array([5.0]))]
    assert settings_of(parts) == {"steering_offset": {"angle_deg": 1.5}, "side_slip": {"limit_g": 0.2}}
    assert block_of("gnss_latency") == "position to antenna"
