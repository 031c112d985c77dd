"""What the tests of the strategies share; metres, x = east and y = north."""

import math
from collections.abc import Callable, Sequence

import pytest

from strategies.program.driving_rules import DrivingRules


@pytest.fixture(scope="session")
def driving_rules() -> DrivingRules:
    return DrivingRules(work_speed_mps=1.5, turn_speed_mps=1.5, reverse_speed_mps=1.0, radius_m=4.3, tool_m=2.3)


@pytest.fixture(scope="session")
def same_pose() -> Callable[[Sequence[float], Sequence[float]], bool]:
    """Whether two poses (x, y, angle) are one."""

    def same(a: Sequence[float], b: Sequence[float]) -> bool:
        return math.dist(a[:2], b[:2]) < 1e-6 and abs(math.remainder(a[2] - b[2], 2 * math.pi)) < 1e-6

    return same
