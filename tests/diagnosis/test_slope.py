"""Drift where roll was measured, on ground that is no plane: one value per slope, and no name from a lying sensor."""

import numpy as np
import pandas as pd
import pytest

from tests.diagnosis.hiding import brief_programme, eg105, told
from tests.truth.body import Ground
from tests.truth.model import make_logs
from tests.truth.sensors import Instruments
from vehicle.identification.logs.reader import build_log
from vehicle.identification.replay.drive_segments import build_dataset, build_rig
from vehicle.identification.replay.simulation import replay_segment
from vehicle.model.effect_kinds import PER_SLOPE

HILLS = Ground(wave_m=0.6, length_m=45.0, drift=0.4)


def driven(ground: Ground, seed: int = 1) -> list[pd.DataFrame]:
    """Seven runs, the roll sensor mounted 2 degrees off."""
    tool = Instruments(roll_mounting_deg=2.0)
    return make_logs({}, seed, brief_programme(), rate_hz=10.0, ground=ground, instruments=tool)


@pytest.fixture(scope="module")
def frames() -> list[pd.DataFrame]:
    return driven(HILLS)


@pytest.mark.matrix
def test_drift_per_slope_is_found_where_the_ground_is_no_plane(frames: list[pd.DataFrame]) -> None:
    found = told(frames)
    assert found.named == ("cross_slope_drift",)
    (one,) = (each for each in found.findings if each.id == "cross_slope_drift")
    assert one.value is not None and one.interval is not None
    low, high = one.interval[PER_SLOPE]
    assert low <= HILLS.drift <= high and one.value[PER_SLOPE] == pytest.approx(HILLS.drift, rel=0.15)
    assert found.tractor.effects["cross_slope_drift"].value[PER_SLOPE] == pytest.approx(one.value[PER_SLOPE], rel=1e-4)
    assert any("roll_deg gives the slope across the direction of travel" in note for note in found.notes)


@pytest.mark.matrix
def test_no_plane_stands_for_hills_where_roll_is_taken_away(frames: list[pd.DataFrame]) -> None:
    assert "cross_slope_drift" not in told([one.drop(columns="roll_deg") for one in frames]).named


@pytest.mark.matrix
@pytest.mark.parametrize(
    "what", ["the other sign", *(pytest.param(each, marks=pytest.mark.matrix) for each in ("one value", "noise"))]
)
def test_a_roll_sensor_that_lies_earns_no_name(what: str, frames: list[pd.DataFrame]) -> None:
    rng = np.random.default_rng(1)
    wrong = {
        "the other sign": lambda frame: -frame.roll_deg, "one value": lambda frame: 1.7,
        "noise": lambda frame: rng.normal(1.0, 0.5, len(frame)),
    }[what]  # fmt: skip
    found = told([frame.assign(roll_deg=wrong(frame)) for frame in frames])
    assert found.named == ()
    assert sum(note.startswith("roll_deg is not used: ") for note in found.notes) == 1


@pytest.mark.slow
def test_a_slope_on_which_nothing_drifts_is_no_cause() -> None:
    found = told(driven(Ground(0.03, -0.05, wave_m=0.4, length_m=45.0)))
    assert found.named == ()


def test_a_drift_per_slope_is_replayed_where_roll_is_and_as_a_plane_where_it_is_not(frames: list[pd.DataFrame]) -> None:
    drift = {"cross_slope_drift": {"ratio": 0.05, "bearing_deg": 90.0, PER_SLOPE: 0.4}}
    for columns, per_slope in ((frames, True), ([one.drop(columns="roll_deg") for one in frames], False)):
        course = build_dataset([build_log(one, f"run {k}") for k, one in enumerate(columns)])
        rig, segment = build_rig(eg105(), "soil", course.origin), course.segments[0]
        plain, on_slope = (replay_segment(rig, segment, one, from_sensor=True, from_speed=True) for one in ({}, drift))
        aside = np.sum((on_slope[-1, :2] - plain[-1, :2]) * [np.sin(plain[0, 2]), -np.cos(plain[0, 2])])
        way = segment.grids["speed"] / 60.0
        across = 0.4 * segment.grids["across"] if per_slope else 0.05 * np.sin(segment.grids["heading"])
        assert float(aside) == pytest.approx(float(np.sum(way * across)), abs=0.05)


@pytest.mark.matrix
def test_pitch_explains_the_speed_that_a_grade_takes() -> None:
    """With pitch the error along is near the noise; without it the same hills are left over, or pose as a slip."""
    frames = driven(Ground(wave_m=0.6, length_m=45.0, climb=0.8))
    known, unknown = told(frames), told([one.drop(columns=["pitch_deg"]) for one in frames])
    assert known.named == () and any(note.startswith("pitch_deg explains speed") for note in known.notes)
    assert known.before[5.0].along_cm < 0.5 * unknown.before[5.0].along_cm
