"""A real vehicle: logs of a 1:10 car, where they are at hand (`HEADLAND_CAR_LOGS` names their folder)."""

import os
from pathlib import Path

import pytest

from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.logs.reader import read_logs
from vehicle.model.tractor import load_tractor

CAR = Path(__file__).parent / "data" / "dart.toml"
LOGS = os.environ.get("HEADLAND_CAR_LOGS", "")


def test_the_car_can_be_simulated() -> None:
    car = load_tractor(CAR)
    assert car.wheelbase_m == pytest.approx(0.175)


@pytest.mark.skipif(not LOGS, reason="HEADLAND_CAR_LOGS does not name the folder of the logs")
def test_the_error_is_halved_and_the_two_grounds_are_told_apart() -> None:
    car = load_tractor(CAR)
    files = sorted(str(path) for path in Path(LOGS).glob("*.csv"))
    found = diagnose_logs(read_logs(files, wheelbase_m=car.wheelbase_m), car, "asphalt")
    for kind in ("cross_cm", "along_cm", "heading_deg"):
        assert getattr(found.after[1.0], kind) < 0.5 * getattr(found.before[1.0], kind)
    assert found.named == ("side_slip",)
    rubber, tape = found.grounds
    assert tape.value["limit_g"] < 0.6 * rubber.value["limit_g"]
    assert all("tape" in run for run in tape.runs) and not any("tape" in run for run in rubber.runs)
