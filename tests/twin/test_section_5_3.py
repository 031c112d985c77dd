"""Section 5.3: both methods compared with the thesis, and how they depend on rate and age."""

import numpy as np
import pytest

from vehicle.model.tractor import load_tractor
from vehicle.trials.sheets.twin_link import (
    FIELD_MPS,
    HIDDEN,
    PRE_MPS,
    LinkDeviation,
    MasterDrive,
    drive_master,
    simulate_twin_link,
)
from vehicle.twin.step_motion import TractorNoise
from vehicle.twin.twin import PREDICT, THESIS


@pytest.fixture(scope="module")
def field() -> MasterDrive:
    """A master of 5.3.2 on short straights, with noise and hidden effects."""
    return drive_master(load_tractor("eg105"), FIELD_MPS, hidden=HIDDEN, noise=TractorNoise(), straight_share=0.3)


def measure(drive: MasterDrive, method: str, rate_hz: float, age_s: float) -> LinkDeviation:
    return simulate_twin_link(drive, load_tractor("mr1000a"), method, rate_hz=rate_hz, age_s=age_s, sample_hz=5)[0]


def test_two_simulated_tractors_stay_within_what_the_thesis_prints() -> None:
    drive = drive_master(load_tractor("eg105"), PRE_MPS, straight_share=0.3)
    for method in (THESIS, PREDICT):
        one = measure(drive, method, 10.0, 0.05)
        assert one.across_m.max() < 0.145 and (one.across_m < 0.05).mean() > 0.9
    alone, _ = simulate_twin_link(drive, load_tractor("mr1000a"), THESIS, rate_hz=10.0, age_s=0.05, poses=False)
    assert alone.across_m.max() > 1.0, "without correction the paths diverge"


def test_prediction_follows_a_different_tractor(field: MasterDrive) -> None:
    one = measure(field, PREDICT, 3.0, 0.3)
    assert one.distance_m.mean() <= 0.10 and np.degrees(np.abs(one.heading_rad)).mean() <= 0.5


def test_age_costs_the_thesiss_method_the_driven_distance_and_prediction_little(field: MasterDrive) -> None:
    thesis = [measure(field, THESIS, 10.0, age).distance_m.mean() for age in (0.0, 0.5, 1.0)]
    ours = [measure(field, PREDICT, 10.0, age).distance_m.mean() for age in (0.0, 0.5, 1.0)]
    # A frame 0.5 s older is as much further behind.
    assert np.diff(thesis) == pytest.approx([0.95 * FIELD_MPS * 0.5] * 2, abs=0.1)
    assert max(ours) < 0.06 and thesis[2] > 10.0 * ours[2]
