"""What is counted of logs with one column spoiled: read right, left alone with a remark, mended wrongly, or silent."""

from dataclasses import replace

import pytest

from tests.diagnosis.log_sets import list_sets, load_set_tractor, make_frames, make_right_frames
from tests.diagnosis.mixups import MIXUPS, Reading, judge_reading, list_differing, read_as_told
from tests.diagnosis.records import judge_diagnosis
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log


@pytest.fixture(scope="module")
def right() -> list[Log]:
    return [build_log(frame, frame.attrs["name"]) for frame in make_right_frames(3)]


def test_every_mixup_changes_its_columns_and_no_others() -> None:
    assert len(MIXUPS) >= 84
    frame = make_right_frames(3)[2]
    for name, mixup in MIXUPS.items():
        changed = mixup.change(frame)
        assert {column for column in frame if not changed[column].equals(frame[column])} <= set(mixup.columns), name
        assert len(changed) == len(frame) and set(changed) == set(frame), name
        assert name.startswith("pitch_deg") or not changed.equals(frame[list(changed)]) or "shuttle" in name, name


@pytest.mark.parametrize(
    ("name", "outcome"),
    [("speed_mps in km/h", "right"), ("heading backwards", "right"), ("heading_deg in gon", "remarked")],
)
def test_reading_as_told(name: str, outcome: str) -> None:
    one = next(one for one in list_sets("mixups", 3) if one.label == name)
    tractor = load_set_tractor(one)
    spoiled, right = (read_as_told(frames, tractor) for frames in (make_frames(one), make_right_frames(3)))
    assert right.logs is not None and not right.fixes
    assert judge_reading(MIXUPS[name], spoiled, right.logs) == outcome


def test_outcomes_of_reading_by_hand(right: list[Log]) -> None:
    mixup = MIXUPS["speed_mps in mph"]
    assert right[0].speed_mps is not None
    off = [replace(log, speed_mps=1.2 * log.speed_mps) for log in right if log.speed_mps is not None]
    none = [replace(log, speed_mps=None) for log in right]
    assert list_differing(off[0], right[0]) == ["speed_mps"] and not list_differing(none[0], right[0])
    assert judge_reading(mixup, Reading(None, (), "refused"), right) == "remarked"
    assert judge_reading(mixup, Reading(None, ("time-ms",), "refused"), right) == "wrong"
    assert judge_reading(mixup, Reading(right[1:], (), "left out"), right) == "remarked"
    assert judge_reading(mixup, Reading(right, ("speed-kmh",), ""), right) == "right"
    assert judge_reading(mixup, Reading(off, ("speed-kmh",), ""), right) == "wrong"
    assert judge_reading(mixup, Reading(off, (), "speed_mps reads high"), right) == "remarked"
    assert judge_reading(mixup, Reading(off, (), ""), right) is None
    assert (
        judge_reading(MIXUPS["speed 0.4 s late"], Reading(right, (), ""), right) is None
    )  # the lag is within the noise


@pytest.mark.parametrize(
    ("name", "said", "outcome"),
    [
        ("speed_mps in mph", {"named": ["wheel_slip"]}, "wrong"),
        ("speed 0.4 s late", {"named": ["clock_offset_speed"]}, "right"),
        ("speed 0.4 s late", {"notes": ["speed_mps is late"]}, "remarked"),
        ("speed 0.4 s late", {}, "silent"),
    ],
)
def test_outcomes_of_a_diagnosis_by_hand(name: str, said: dict[str, list[str]], outcome: str) -> None:
    one = next(one for one in list_sets("mixups", 3) if one.label == name)
    record: dict[str, list[str]] = {"named": [], "notes": [], "hints": [], "columns": [], **said}
    assert judge_diagnosis(one, record) == outcome
