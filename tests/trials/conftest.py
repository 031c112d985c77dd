"""Drives that the tests of the experiments share."""

import importlib.util
from pathlib import Path
from typing import Any

import pytest


def pytest_sessionstart(session: pytest.Session) -> None:
    """Drop compiled functions of the experiments that are older than any source they may have swallowed."""
    spec = importlib.util.find_spec("vehicle")
    folder = Path(str(spec.origin)).parent if spec else Path()
    newest = max((source.stat().st_mtime for source in folder.rglob("*.py")), default=0.0)
    for index in folder.glob("trials/__pycache__/*.nbi"):
        if index.stat().st_mtime < newest:
            index.unlink(missing_ok=True)


@pytest.fixture(scope="session")
def eg105() -> Any:
    from vehicle.model.tractor import load_tractor

    return load_tractor("eg105")


@pytest.fixture(scope="session")
def circles(eg105: Any) -> dict[tuple[str, float], Any]:
    """The nine drives of Table 4.1 by model and angle."""
    from vehicle.trials.fixed_steering import drive_table_4_1

    return {(drive.model, drive.steering_deg): drive for drive in drive_table_4_1(eg105)}
