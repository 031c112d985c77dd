"""What the tests of the strategies share; metres, x = east and y = north."""

import pytest

from strategies.rules.driving_rules import DrivingRules


@pytest.fixture(scope="session")
def driving_rules() -> DrivingRules:
    return DrivingRules(work_speed_mps=1.5, turn_speed_mps=1.5, reverse_speed_mps=1.0, radius_m=4.3, tool_m=2.3)
