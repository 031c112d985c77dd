"""A real vehicle: logs of a 1:10 car, where they are at hand (`HEADLAND_CAR_LOGS` names their folder)."""

import os
from pathlib import Path

import pytest

from vehicle.measured.diagnose import diagnose
from vehicle.measured.logs import read_logs
from vehicle.tractor import load_tractor

CAR = Path(__file__).parent / "data" / "dart.toml"
LOGS = os.environ.get("HEADLAND_CAR_LOGS", "")


def test_the_car_can_be_simulated() -> None:
    car = load_tractor(CAR)
    assert car.wheelbase_m == pytest.approx(0.175)


@pytest.mark.skipif(not LOGS, reason="HEADLAND_CAR_LOGS does not name the folder of the logs")
def test_the_error_on_slippery_ground_is_halved() -> None:
    car = load_tractor(CAR)
    files = [str(path) for path in Path(LOGS).glob("*.csv") if "tape" in path.name or "steps" in path.name]
    found = diagnose(read_logs(sorted(files), wheelbase_m=car.wheelbase_m), car, "asphalt")
    assert found.after[1.0].cross_cm < 0.5 * found.before[1.0].cross_cm
    assert found.after[1.0].heading_deg < 0.5 * found.before[1.0].heading_deg
    assert "side_slip" in found.tractor.effects
