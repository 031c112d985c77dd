"""Section 5.3: both ways beside the thesis, and how they depend on rate and age."""

import numpy as np
import pytest

from vehicle.tractor import load_tractor
from vehicle.trials.coupling import Apart, Drive, couple, drive_master
from vehicle.trials.sheets.twin import FIELD_MPS, HIDDEN, PRE_MPS
from vehicle.twin.motion import Noise
from vehicle.twin.twin import PREDICT, THESIS


@pytest.fixture(scope="module")
def field() -> Drive:
    """A master of 5.3.2 on short straights, with noise and what is hidden in it."""
    return drive_master(load_tractor("eg105"), FIELD_MPS, hidden=HIDDEN, noise=Noise(), share=0.3)


def apart(drive: Drive, way: str, rate_hz: float, age_s: float) -> Apart:
    return couple(drive, load_tractor("mr1000a"), way, rate_hz=rate_hz, age_s=age_s, look_hz=5)[0]


def test_two_simulated_tractors_stay_within_what_the_thesis_prints() -> None:
    drive = drive_master(load_tractor("eg105"), PRE_MPS, share=0.3)
    for way in (THESIS, PREDICT):
        one = apart(drive, way, 10.0, 0.05)
        assert one.across_m.max() < 0.145 and (one.across_m < 0.05).mean() > 0.9
    alone, _ = couple(drive, load_tractor("mr1000a"), THESIS, rate_hz=10.0, age_s=0.05, poses=False)
    assert alone.across_m.max() > 1.0, "without correction the steering curves lead apart"


def test_prediction_keeps_to_a_tractor_unlike_it(field: Drive) -> None:
    one = apart(field, PREDICT, 3.0, 0.3)
    assert one.distance_m.mean() <= 0.10 and np.degrees(np.abs(one.heading_rad)).mean() <= 0.5


def test_age_costs_the_thesiss_way_its_way_driven_and_prediction_little(field: Drive) -> None:
    thesis = [apart(field, THESIS, 10.0, age).distance_m.mean() for age in (0.0, 0.5, 1.0)]
    ours = [apart(field, PREDICT, 10.0, age).distance_m.mean() for age in (0.0, 0.5, 1.0)]
    # A frame 0.5 s older is as much further behind.
    assert np.diff(thesis) == pytest.approx([0.95 * FIELD_MPS * 0.5] * 2, abs=0.1)
    assert max(ours) < 0.06 and thesis[2] > 10.0 * ours[2]
