"""Turns timed by simulation, and the headland sized for them."""

import math
from typing import Any

import pytest

from strategies.path_planning.errors import StrategyError
from strategies.path_planning.turns import (
    TurnReach,
    build_u_turn,
    compute_available_turn_depth_m,
    compute_headland_m,
    compute_turn_depth_m,
    list_allowed_kinds,
)
from strategies.rules.driving_rules import DrivingRules
from strategies.rules.turn_timing import TurnTimer
from vehicle.model.tractor import GuidanceParameters, Implement, load_tractor

RADIUS_M, SPEED_MPS = 4.3, 5.0 / 3.6
UP, DOWN = math.pi / 2, -math.pi / 2


def clock(**changes: Any) -> TurnTimer:
    driving_rules = DrivingRules(SPEED_MPS, SPEED_MPS, SPEED_MPS, RADIUS_M, tool_m=2.3)
    return TurnTimer(load_tractor("eg105").model_copy(update=changes), Implement(), driving_rules, "soil")


class TestTiming:
    @pytest.mark.parametrize("spacing_m", [9.0, 12.0, 30.0])
    def test_a_u_turn_takes_its_length_at_its_speed(self, spacing_m: float) -> None:
        path = build_u_turn((0.0, 0.0, UP), (spacing_m, 0.0, DOWN), RADIUS_M)
        assert path is not None
        seconds = clock().measure_seconds(path)
        # The straight that it is held against is as long as what lies before and after it.
        assert seconds == pytest.approx((math.pi * RADIUS_M + spacing_m - 2 * RADIUS_M) / SPEED_MPS, abs=0.5)

    def test_quickest_over_one_two_and_more_lines(self) -> None:
        times = clock().measure_best_times(3.0, 20.0, ("u", "omega", "switch-back"))
        assert len(times) == math.ceil(2 * RADIUS_M / 3.0) + 2 and times[0] == 0.0
        # From the third line on a plain U fits, and a line more is 3 m more; nearer, a turn is more than half a circle.
        half_s = math.pi * RADIUS_M / SPEED_MPS
        assert times[3] == pytest.approx(half_s + (9.0 - 2 * RADIUS_M) / SPEED_MPS, abs=0.5)
        assert times[4] is not None and times[3] is not None
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


class TestSizing:
    REACH = TurnReach(tool_m=2.3, margin_m=1.5)

    def test_by_hand(self) -> None:
        # Switch-back over 3 m: R sin(acos(1/2 - 3/4R)) = 4.06 m, less than R; 2.3 + 4.3 + 1.5 = 8.1, so 8.5 m.
        assert compute_headland_m("auto", 3.0, RADIUS_M, self.REACH) == 8.5
        # Omega over 3 m: R + sqrt(4R^2 - (R + 1.5)^2) = 4.3 + 6.35; with 3.8 that is 14.45, so 14.5 m.
        assert compute_headland_m("omega", 3.0, RADIUS_M, self.REACH) == 14.5

    @pytest.mark.parametrize("kind", ["omega", "switch-back"])
    @pytest.mark.parametrize("width_m", [2.0, 3.0, 5.0, 12.0])
    def test_what_it_is_sized_for_fits_and_half_a_metre_less_would_not(self, kind: str, width_m: float) -> None:
        headland = compute_headland_m(kind, width_m, RADIUS_M, self.REACH)
        needed = max(compute_turn_depth_m(kind, min(width_m, 2 * RADIUS_M), RADIUS_M), RADIUS_M)
        assert needed <= compute_available_turn_depth_m(headland, self.REACH) + 1e-9
        assert needed > compute_available_turn_depth_m(headland - 0.5, self.REACH)

    def test_a_plain_u_is_allowed_beside_what_is_asked_for(self) -> None:
        assert list_allowed_kinds("auto") == ("u", "omega", "switch-back")
        assert list_allowed_kinds("omega") == ("u", "omega") and list_allowed_kinds("u") == ("u",)
