"""A plan that takes too long for lack of power says at which speed it works."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from planner.traffic.giving_way import _describe_slow_work
from vehicle.records import REC_SPEED, REC_STATUS, RECORD_COLUMNS, TURNING, WORKING


@pytest.mark.parametrize(("driven_mps", "is_told"), [(0.5, True), (-0.5, True), (1.9, False)])
def test_slow_work_is_told_with_both_speeds(driven_mps: float, is_told: bool) -> None:
    record = np.zeros((50, 1, len(RECORD_COLUMNS)))
    record[:, 0, REC_SPEED], record[:, 0, REC_STATUS] = driven_mps, WORKING
    record[:10, 0, REC_SPEED], record[:10, 0, REC_STATUS] = 0.1, TURNING
    leg = SimpleNamespace(speed_mps=2.0)
    run: Any = SimpleNamespace(record=record, plan=SimpleNamespace(missions=[SimpleNamespace(legs=[leg])]))
    said = _describe_slow_work(run)
    assert ("at 1.8 km/h instead of 7.2" in said) == is_told and bool(said) == is_told
