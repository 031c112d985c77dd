"""Logs with few rows a second: nothing is claimed that lies between two rows."""

import pytest

from tests.diagnosis.hiding import eg105
from vehicle.identification.diagnosis.demo_logs import HiddenEffect, simulate_demo_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [pytest.param(5.0, marks=pytest.mark.matrix), 2.0])
def test_clean_logs_at_low_rates_get_no_name(rate_hz: float) -> None:
    found = diagnose_logs(simulate_demo_logs(None, eg105(), "soil", 41, rate_hz=rate_hz), eg105(), "soil")
    assert not found.named and found.unexplained_share == 0.0
    assert not any(one.named for one in found.tractor.effects.values())


@pytest.mark.matrix
def test_slip_on_half_the_runs_is_told_with_its_runs() -> None:
    slipping = simulate_demo_logs(HiddenEffect("wheel_slip", {"ratio": 0.15}), eg105(), "soil", 41)[::2]
    plain = simulate_demo_logs(None, eg105(), "soil", 41)[1::2]
    found = diagnose_logs([*slipping, *plain], eg105(), "soil")
    assert found.named == ("wheel_slip",)
    wet = next(one for one in found.grounds if abs(one.value["ratio"] - 0.15) < 0.02)
    assert set(wet.runs) <= {log.name for log in slipping} and len(wet.runs) >= 4
    assert found.unexplained_share == 0.0 and not any(run.unlike for run in found.runs)
    assert any("on two grounds, or of two tractors" in note for note in found.notes)
