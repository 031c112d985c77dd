"""Steering columns under each other's names are refused with the fix; right names are never doubted."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from tests.identification.fault_logs import clean_frames
from tests.identification.log_tables import refusal
from tests.truth.cases import TruthCase
from tests.truth.second import second_logs
from tests.truth.third import make_third_logs
from tests.truth.third_drives import PROGRAMMES
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


@pytest.mark.parametrize(("programme", "rate_hz"), [("closed", 5.0), ("one_sided", 10.0)])
def test_swapped_logs_of_few_steps_are_told(programme: str, rate_hz: float) -> None:
    frames = second_logs({}, 51, PROGRAMMES[programme](), rate_hz=rate_hz)
    assert any(is_doubted(frame.rename(columns=NAMES)) for frame in frames)
    assert not any(is_doubted(frame) for frame in frames)


SETS = (*((name, rate_hz) for name in ("three_speeds", "mixed", "closed") for rate_hz in (5.0, 10.0)),
        ("one_sided", 10.0), ("ordered_angles", 10.0))  # fmt: skip


@pytest.mark.matrix
@pytest.mark.parametrize(("programme", "rate_hz"), SETS)
def test_any_set_of_swapped_logs_is_told(programme: str, rate_hz: float) -> None:
    """Small steps of the angle, as these last two have them, do not show at 5 Hz which column jumps."""
    for seed in (51, 52):
        frames = make_third_logs(TruthCase("clean", seed, programme=programme, rate_hz=rate_hz))
        assert any(is_doubted(frame.rename(columns=NAMES)) for frame in frames)
        assert not any(is_doubted(frame) for frame in frames)


COMMAND, WHEEL = "steering_command_deg", "steering_deg"


def move(frame: pd.DataFrame, column: str, rows: int) -> pd.DataFrame:
    """The frame with a column that comes so many rows later."""
    return frame.assign(**{column: frame[column].shift(rows).bfill().ffill()})


def hold(frame: pd.DataFrame, column: str, rows: int) -> pd.DataFrame:
    """The frame with a column that is read once in so many rows."""
    return frame.assign(**{column: frame[column].to_numpy()[np.arange(len(frame)) // rows * rows]})


@pytest.mark.parametrize(
    "change",
    [
        lambda frame: move(frame, COMMAND, 5), lambda frame: hold(move(frame, COMMAND, 5), WHEEL, 10),
        lambda frame: move(frame, WHEEL, -5), lambda frame: hold(frame, WHEEL, 20),
        lambda frame: hold(frame, COMMAND, 20),
    ],
)  # fmt: skip
def test_late_and_sparse_columns_are_no_swap(change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    assert not [name for name, frame in clean_frames().items() if is_doubted(change(frame))]
