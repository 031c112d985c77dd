"""Turns timed by simulation."""

import math
from typing import Any

import pytest

from strategies.path_planning.errors import StrategyError
from strategies.path_planning.turns import list_turns
from strategies.rules.driving_rules import DrivingRules
from strategies.rules.turn_timing import TurnTimer
from vehicle.model.tractor import GuidanceParameters, Implement, load_tractor

RADIUS_M, SPEED_MPS = 4.3, 5.0 / 3.6


def clock(**changes: Any) -> TurnTimer:
    driving_rules = DrivingRules(SPEED_MPS, SPEED_MPS, SPEED_MPS, RADIUS_M, tool_m=2.3)
    return TurnTimer(load_tractor("eg105").model_copy(update=changes), Implement(), driving_rules, "soil")


class TestTiming:
    @pytest.mark.parametrize("spacing_m", [9.0, 12.0, 30.0])
    def test_a_u_turn_takes_its_length_at_its_speed(self, spacing_m: float) -> None:
        (path,) = list_turns(spacing_m, RADIUS_M)
        seconds = clock().measure_seconds(path)
        # The straight that it is held against is as long as what lies before and after it.
        assert seconds == pytest.approx((math.pi * RADIUS_M + spacing_m - 2 * RADIUS_M) / SPEED_MPS, abs=0.5)

    def test_quickest_over_one_two_and_more_lines(self) -> None:
        times = clock().measure_best_times(3.0, 20.0, ("u", "omega", "switch-back"))
        assert len(times) == math.ceil(2 * RADIUS_M / 3.0) + 2 and times[0] == 0.0
        # From the third line on a plain U fits, and a line more is 3 m more; nearer, a turn is more than half a circle.
        half_s = math.pi * RADIUS_M / SPEED_MPS
        assert times[3] == pytest.approx(half_s + (9.0 - 2 * RADIUS_M) / SPEED_MPS, abs=0.5)
        assert times[4] - times[3] == pytest.approx(3.0 / SPEED_MPS, abs=0.3)
        assert all(time is not None and time > half_s for time in times[1:3])

    def test_none_where_none_fits(self) -> None:
        assert clock().measure_best_times(3.0, RADIUS_M - 0.1, ("u",))[1:] == (None, None, None, None)

    def test_a_direction_change_costs_time(self) -> None:
        costs = clock().measure_reversal_costs()
        assert 1.5 < costs.cusp_s < 10.0 and costs.swing_sm >= 0.0

    def test_a_tractor_that_cannot_steer_is_refused_in_a_sentence(self) -> None:
        blind = clock(guidance=GuidanceParameters(lateral_gain_deg_per_m=0.0, heading_gain=0.0))
        assert set(blind.measure_best_times(3.0, 20.0, ("u", "omega"))[1:]) == {None}
        with pytest.raises(StrategyError, match=r"does not complete a plain turn of 4\.30 m radius"):
            blind.measure_reversal_costs()
