"""Effects and terms of the rest as coordinates of one tractor."""

import numpy as np
import pytest

from tests.identification.residual_models import eg105, get_parameters
from vehicle.identification.fit.effect_parameters import (
    build_discrepancy_parameters,
    build_parameters,
    collect_settings,
    find_finest_size,
    get_chain_block,
)
from vehicle.model.discrepancy_model import DISCREPANCY_TERMS, MAX_AMOUNT
from vehicle.model.effects import EFFECTS_BY_ID


def test_starts_are_those_of_the_catalogue_or_shares_of_the_file() -> None:
    lag = eg105().steering.lag_s
    assert get_parameters("steering_lag").starts == tuple((lag * share,) for share in (0.5, 1.6, 2.5, 4.0, 7.0))
    assert get_parameters("steering_backlash").starts == ((0.5,), (1.5,), (3.0,))
    assert get_parameters("steering_offset").starts == ((0.0,),)
    assert get_parameters("steering_dead_time").reduce_starts().starts == ((0.05,), (0.2,), (0.35,), (0.5,), (0.9,))
    assert get_parameters("steering_backlash").reduce_starts() == get_parameters("steering_backlash")


def test_a_patch_is_fixed_for_what_is_searched_and_for_nothing_else() -> None:
    patch = (10.0, 5.0, 16.0)
    assert build_parameters(eg105(), "grip_patch", {"grip_patch": patch}).compute_values(np.array([1.3])) == {
        "ratio": 1.3, "east_m": 10.0, "north_m": 5.0, "radius_m": 16.0
    }  # fmt: skip
    assert build_parameters(eg105(), "steering_offset", {"grip_patch": patch}).fixed_values == ()


def test_coordinates_stay_inside_what_a_tractor_can_have() -> None:
    assert get_parameters("steering_offset").clip(np.array([-30.0])).tolist() == [-8.0]
    assert get_parameters("cross_slope_drift").clip(np.array([0.7, -0.7])).tolist() == [0.5, -0.5]
    assert get_parameters("cross_slope_drift").compute_deviation(np.array([0.03, -0.04])) == pytest.approx(0.05)


def test_the_two_components_of_a_rest_go_together() -> None:
    groups = build_discrepancy_parameters()
    assert sum(len(group) for group in groups) == len(DISCREPANCY_TERMS)
    assert [one.id for one in groups[2]] == ["angle_to_east", "angle_to_north"]
    assert groups[0][0].compute_values(np.array([0.5])) == {"angle_by_speed": 0.5}
    assert groups[0][0].clip(np.array([-1e9])).tolist() == [-MAX_AMOUNT], "a file may have no more"


def test_times_are_not_told_finer_than_half_a_row() -> None:
    assert find_finest_size(eg105(), "steering_dead_time", 0.05) == 0.05
    assert find_finest_size(eg105(), "steering_dead_time", 1.0) == 0.5
    assert find_finest_size(eg105(), "steering_offset", 1.0) == EFFECTS_BY_ID["steering_offset"].size.finest


def test_settings_and_blocks_are_those_of_the_catalogue() -> None:
    parts = [(get_parameters("steering_offset"), np.array([1.5])), (get_parameters("side_slip"), np.array([5.0]))]
    assert collect_settings(parts) == {"steering_offset": {"angle_deg": 1.5}, "side_slip": {"limit_g": 0.2}}
    assert get_chain_block("gnss_latency") == "position to antenna"
