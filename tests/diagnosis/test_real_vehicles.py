"""A real car: what the diagnosis says of its log beside a regression that shares no code with it (`data/SOURCES.md`).

The RAV4 drives a nearly straight motorway: its front wheels move within half a degree. By the regressions its path is
0.8 % longer than its speed adds up to, and its camera points 0.9 degrees to the left of its course.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from vehicle.identification.logs.reader import read_logs
from vehicle.identification.verdict.diagnose import diagnose_logs
from vehicle.identification.verdict.diagnosis_types import Diagnosis
from vehicle.model.tractor import load_tractor

DATA = Path(__file__).parent / "data"
LOG = DATA / "rav4.csv"
Columns = dict[str, NDArray[np.float64]]


@pytest.fixture(scope="module")
def columns() -> Columns:
    names = LOG.read_text(encoding="utf-8").split("\n", 1)[0].split(",")
    return dict(zip(names, np.loadtxt(LOG, delimiter=",", skiprows=1).T, strict=True))


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    car = load_tractor(DATA / "rav4.toml")
    return diagnose_logs(read_logs([LOG], wheelbase_m=car.wheelbase_m), car, "asphalt")


def compute_path_ratio(columns: Columns) -> float:
    """Length of the path per integral of the measured speed."""
    steps = np.hypot(np.diff(columns["easting_m"]), np.diff(columns["northing_m"]))
    speed = columns["speed_mps"]
    return float(steps.sum() / np.sum((speed[1:] + speed[:-1]) / 2.0 * np.diff(columns["time_s"])))


def compute_heading_bias_deg(columns: Columns) -> float:
    """Median of heading minus course over steps of a second."""
    east, north = (columns[name][20:] - columns[name][:-20] for name in ("easting_m", "northing_m"))
    course = np.degrees(np.arctan2(east, north))
    return float(np.median((columns["heading_deg"][10:-10] - course + 180.0) % 360.0 - 180.0))


def test_wheels_that_hardly_move_name_no_cause(columns: Columns, found: Diagnosis) -> None:
    assert np.ptp(columns["steering_deg"]) < 0.5
    assert found.named == ()


def test_what_may_be_saved_raises_no_error(found: Diagnosis) -> None:
    assert found.is_savable
    for horizon, before in found.before.items():
        after = found.after[horizon]
        assert after.cross_cm <= before.cross_cm and after.along_cm <= before.along_cm, horizon


def test_the_hint_is_the_distance_driven_that_the_regression_finds(columns: Columns, found: Diagnosis) -> None:
    assert compute_path_ratio(columns) == pytest.approx(1.008, abs=0.001)
    assert any("distance driven" in words for words in found.depends_on)
    assert found.after[5.0].along_cm < 0.5 * found.before[5.0].along_cm


def test_the_heading_error_goes_without_a_name_for_it(columns: Columns, found: Diagnosis) -> None:
    """A bias of the heading and a side push look alike on one straight road: the error goes, the cause stays open."""
    bias = compute_heading_bias_deg(columns)
    assert bias == pytest.approx(-0.9, abs=0.1)
    assert found.before[1.0].heading_deg == pytest.approx(abs(bias), abs=0.1)
    assert found.after[1.0].heading_deg < 0.5 * found.before[1.0].heading_deg
