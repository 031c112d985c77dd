"""A commanded speed that was not driven is told and taken out; slip and honest commands are left alone."""

import numpy as np
import pandas as pd
import pytest

from tests.diagnosis.hiding import hidden
from tests.truth.drives import Drive, drive, stairs, straight, three_speeds_programme
from tests.truth.model import Truth
from tests.truth.second import second_logs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.sensor_checks import correct_commanded_speeds
from vehicle.model.effects import get_effect

LINES = (straight(90.0, seconds=40.0), straight(270.0, seconds=40.0))
PACES = drive("paces", 60.0, stairs((60.0, 0.0)), stairs((20.0, 1.0), (20.0, 1.6), (20.0, 2.2)))


def frames_of(*drives: Drive, **effects: dict[str, float]) -> list[pd.DataFrame]:
    return [Truth(effects, 5, rate_hz=10.0).log(one, index) for index, one in enumerate(drives)]


def commanded(frames: list[pd.DataFrame], factor: float = 1.0, **columns: float) -> list[Log]:
    """Logs with the commanded speed multiplied, or columns of one value in its place, set right together."""
    wrong = [frame.assign(speed_command_mps=factor * frame.speed_command_mps).assign(**columns) for frame in frames]
    return correct_commanded_speeds([build_log(frame, f"run {index}") for index, frame in enumerate(wrong)])


@pytest.mark.slow
def test_honest_commands_and_slip_are_left_alone() -> None:
    slow = {"wheel_slip": {"ratio": 0.2}, "implement_slip": {"ratio": 0.2}}
    for effects in ({}, slow, hidden(["speed_lag", "cross_slope_drift"]), hidden(["antenna_forward", "gnss_latency"])):
        logs = commanded(frames_of(*LINES, PACES, **effects))
        assert [log.corrections for log in logs] == [(), (), ()]
    for tractor in ("eg105", "mr1000a"):
        frames = second_logs(hidden(["side_slip", "implement_slip"]), 541, three_speeds_programme(), tractor)
        assert not any(log.corrections for log in commanded(frames))


@pytest.mark.parametrize("factor", [0.6, 0.75, 0.92])
def test_a_command_below_what_was_driven_is_told_and_multiplied(factor: float) -> None:
    frames = frames_of(*LINES, PACES)
    for log, frame in zip(commanded(frames, factor), frames, strict=True):
        (told,) = log.corrections
        assert told.startswith(f"the tractor drives {100 * (1 / factor - 1):.0f} % faster than speed_command_mps in ")
        assert log.speed_command_mps == pytest.approx(frame.speed_command_mps.to_numpy(), rel=0.01)


def test_a_command_above_what_was_driven_looks_like_slip_and_its_words_say_so() -> None:
    assert [log.corrections for log in commanded(frames_of(*LINES, PACES), 1.3)] == [(), (), ()]
    assert "the commanded speed is not what was driven" in get_effect("wheel_slip").describe({"ratio": 0.23})
    assert "commanded speed is" not in get_effect("wheel_slip").describe({"ratio": 0.1})


def test_faster_one_way_only_is_no_factor() -> None:
    """Downhill a tractor is faster than commanded, and with the implement up than with it down."""
    there, back = frames_of(*LINES)
    there = there.assign(speed_command_mps=0.8 * there.speed_command_mps)
    assert [log.corrections for log in commanded([there, back])] == [(), ()]


def test_a_command_that_stands_still_while_the_pace_changes_is_left_out_of_all_logs() -> None:
    first, second, third = commanded(frames_of(PACES, *LINES), speed_command_mps=1.9)
    (told,) = first.corrections
    assert told.startswith(
        "speed_command_mps is 1.9 in every row although the tractor's pace changes: the tractor was "
    )
    assert (
        second.corrections == third.corrections
        and "speed_command_mps is 1.9 in every row, as in run 0" in second.corrections[0]
    )
    assert all(log.speed_command_mps is None for log in (first, second, third))
    mixed = [*frames_of(PACES), frames_of(LINES[0])[0].assign(speed_command_mps=1.4)]
    assert all(log.speed_command_mps is not None for log in commanded(mixed)), "a steady drive at a steady command"


def test_a_load_that_slows_the_tractor_is_no_command_that_stands_still() -> None:
    steady = drive("load", 60.0, stairs((60.0, 0.0)), 1.5, stairs((30.0, 0.0), (30.0, 1.0)))
    (log,) = commanded(frames_of(steady, implement_slip={"ratio": 0.4}))
    assert log.corrections == () and log.speed_command_mps is not None


def test_what_was_set_right_stays_as_it_is() -> None:
    once = commanded(frames_of(*LINES, PACES), 0.75)
    again = correct_commanded_speeds(once)
    assert [log.corrections for log in again] == [log.corrections for log in once]
    assert all(np.array_equal(a.speed_command_mps, b.speed_command_mps) for a, b in zip(again, once, strict=True))
