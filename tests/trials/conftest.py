"""Drives that the tests of the experiments share."""

from typing import Any

import pytest


@pytest.fixture(scope="session")
def eg105() -> Any:
    from vehicle.model.tractor import load_tractor

    return load_tractor("eg105")


@pytest.fixture(scope="session")
def circles(eg105: Any) -> dict[tuple[str, float], Any]:
    """The nine drives of Table 4.1 by model and angle."""
    from vehicle.trials.fixed_steering import drive_table_4_1

    return {(drive.model, drive.steering_deg): drive for drive in drive_table_4_1(eg105)}
