"""Steering columns under each other's names are refused with the fix; right names are never doubted."""

import numpy as np
import pandas as pd
import pytest

from tests.identification.fault_logs import clean_frames
from tests.identification.log_tables import refusal
from tests.truth.cases import ColumnClock, TruthCase
from tests.truth.third import make_third_logs
from vehicle.identification.logs.conventions import find_swapped_steering
from vehicle.identification.logs.reader import build_log, read_logs
from vehicle.identification.logs.readings import LogConvention

NAMES = {"steering_deg": "steering_command_deg", "steering_command_deg": "steering_deg"}
FIX = LogConvention.STEERING_SWAPPED


def is_doubted(frame: pd.DataFrame) -> bool:
    return find_swapped_steering(build_log(frame, frame.attrs["name"], check=False)) is not None


@pytest.mark.parametrize("name", ["steps", "lines", "right"])
def test_swapped_columns_are_refused_with_the_fix(name: str) -> None:
    frame = clean_frames()[name]
    text = refusal(lambda: build_log(frame.rename(columns=NAMES), name))
    assert "steering_command_deg and steering_deg are swapped" in text and f"fixes {FIX}" in text
    assert "steering_deg jumps" in text
    mended, right = build_log(frame.rename(columns=NAMES), name, [FIX]), build_log(frame, name)
    for column in NAMES:
        np.testing.assert_array_equal(getattr(mended, column), getattr(right, column))
    assert "remove that fix" in refusal(lambda: build_log(frame, name, [FIX]))


def test_one_log_that_shows_it_is_enough_for_a_set(tmp_path) -> None:  # type: ignore[no-untyped-def]
    paths = []
    for name in ("there", "steps"):
        paths.append(tmp_path / f"{name}.csv")
        clean_frames()[name].rename(columns=NAMES).to_csv(paths[-1], index=False)
    assert "steps: it seems that steering_command_deg and steering_deg are swapped" in refusal(lambda: read_logs(paths))
    assert [log.name for log in read_logs(paths, [FIX])] == ["there", "steps"]


def test_right_columns_are_not_doubted() -> None:
    assert not [name for name, frame in clean_frames().items() if is_doubted(frame)]


def test_logs_that_do_not_show_it_are_not_doubted() -> None:
    straight = clean_frames()["there"].rename(columns=NAMES)
    assert not is_doubted(straight)
    assert not is_doubted(clean_frames()["steps"].drop(columns="steering_deg"))


MORE_SETS = (("closed", 10.0), *((name, rate_hz) for name in ("three_speeds", "mixed") for rate_hz in (5.0, 10.0)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("programme", "rate_hz"),
    [("closed", 5.0), ("one_sided", 10.0), ("ordered_angles", 10.0)]
    + [pytest.param(*each, marks=pytest.mark.matrix) for each in MORE_SETS],
)
def test_any_set_of_swapped_logs_is_told(programme: str, rate_hz: float) -> None:
    """Small steps of the angle, as these last two have them, do not show at 5 Hz which column jumps."""
    for seed in (51, 52):
        frames = make_third_logs(TruthCase("clean", seed, programme=programme, rate_hz=rate_hz))
        assert any(is_doubted(frame.rename(columns=NAMES)) for frame in frames)
        assert not any(is_doubted(frame) for frame in frames)


@pytest.mark.slow
@pytest.mark.parametrize(
    "programme",
    ["closed", *(pytest.param(name, marks=pytest.mark.matrix) for name in ("three_speeds", "mixed", "default"))],
)
@pytest.mark.parametrize(
    "columns",
    [
        {"steering_command": ColumnClock(offset_s=0.5)},
        {"steering_command": ColumnClock(offset_s=0.5), "steering": ColumnClock(hold_s=1.0)},
        {"steering": ColumnClock(offset_s=-0.5)},
        {"steering": ColumnClock(hold_s=2.0, hold_jitter=0.1)},
        {"steering_command": ColumnClock(hold_s=2.0)},
    ],
)
def test_clocks_and_sparse_columns_are_no_swap(columns: dict[str, ColumnClock], programme: str) -> None:
    frames = make_third_logs(TruthCase("clean", 53, columns=columns, programme=programme))
    assert not any(is_doubted(frame) for frame in frames)
