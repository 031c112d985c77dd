"""Wrong units, axes and signs that are easily taken for one another, and right logs, which must all pass."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.identification.log_tables import (
    BENT,
    HOME,
    SPOIL,
    in_unit,
    refusal,
    runs,
    saved,
    swapped,
    table,
    to_degrees,
    turned,
)  # fmt: skip
from tests.truth.drives import default_programme, reversing
from tests.truth.model import Truth, make_logs
from vehicle.identification.errors import LogError
from vehicle.identification.logs.conventions import find_convention_errors
from vehicle.identification.logs.reader import build_log, read_logs
from vehicle.identification.logs.readings import SPEED_UNITS, LogConvention, Suspicion
from vehicle.identification.logs.schema import Log

STRAIGHT = ("straight_090", "straight_270", "implement_straight")


def found(frame: pd.DataFrame, wheelbase_m: float | None = None) -> list[Suspicion]:
    return find_convention_errors(build_log(frame, "run", check=False), wheelbase_m)


def sentence(one: Suspicion) -> str:
    return str(LogError(one.format_sentence()))


# --- speeds ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["steps", "speed_steps", "stop_and_go"])
def test_each_speed_column_is_held_against_the_path(name: str) -> None:
    frame = runs()[name]
    for fixes in SPEED_UNITS:
        for fix in fixes:
            # A command that is seldom reached says nothing of a unit that is only twice as large.
            is_open = name == "stop_and_go" and fix.startswith("speed-command") and fixes is not SPEED_UNITS[0]
            assert [one.fix for one in found(SPOIL[fix](frame))] == [fix] * (not is_open), fix
    assert found(in_unit(1.0 / 0.6, "speed_command_mps")(frame)) == []  # 40 % slip


def test_speeds_are_converted_once() -> None:
    message = refusal(lambda: build_log(table(), "run", ["speed-kmh", "speed-command-kmh"]))
    assert "speed-kmh and speed-command-kmh" in message


# --- axes --------------------------------------------------------------------------------------------------------


def test_swapped_axes_are_told_from_their_two_symptoms() -> None:
    (one,) = found(swapped(runs()["figure_eight"]))
    assert one.fix is LogConvention.EAST_NORTH_SWAPPED and "easting and northing are swapped" in one.format_sentence()
    # The mirror image of a swap is a heading from east and steering to the left: both readings are told.
    assert "fixes heading-ccw-east fixes steering-left-positive" in sentence(one)
    for fix in (LogConvention.HEADING_CCW_EAST, LogConvention.STEERING_LEFT):
        assert [one.fix for one in found(SPOIL[fix](runs()["figure_eight"]))] == [fix]


@pytest.mark.parametrize("in_order", [True, False])
def test_utm_coordinates_say_which_axis_is_which(in_order: bool) -> None:
    frame = runs()["steps"]
    frame = frame.assign(easting_m=frame.easting_m + 528_000.0, northing_m=frame.northing_m + 4_769_000.0)
    if not in_order:
        (one,) = found(swapped(frame))
        assert one.fix is LogConvention.EAST_NORTH_SWAPPED and "fixes heading-ccw-east" not in sentence(one)
        (one,) = found(swapped(frame).drop(columns="heading_deg"))
        assert one.fix is LogConvention.EAST_NORTH_SWAPPED
        return
    mirrored = SPOIL[LogConvention.STEERING_LEFT](SPOIL[LogConvention.HEADING_CCW_EAST](frame))
    assert [one.fix for one in found(mirrored)] == [LogConvention.HEADING_CCW_EAST, LogConvention.STEERING_LEFT]


def test_a_straight_run_leaves_the_axes_open_and_other_runs_decide(tmp_path: Path) -> None:
    spoiled = {name: swapped(runs()[name]) for name in ("straight_090", "circles_left")}
    (alone,) = found(spoiled["straight_090"])
    assert alone.fix is LogConvention.HEADING_CCW_EAST and "fixes east-north-swapped" in sentence(alone)
    paths = [saved(frame, tmp_path / f"{name}.csv") for name, frame in spoiled.items()]
    message = refusal(lambda: read_logs(paths))
    assert message.startswith("straight_090: it seems that easting and northing are swapped")
    assert [log.name for log in read_logs(paths, ["east-north-swapped"])] == list(spoiled)


@pytest.mark.parametrize("place", [HOME, (10.4, 55.4)])
def test_latitude_before_longitude(place: tuple[float, float], tmp_path: Path) -> None:
    degrees = to_degrees(runs()["figure_eight"])
    degrees = degrees.assign(
        easting_m=degrees.easting_m + place[0] - HOME[0], northing_m=degrees.northing_m + place[1] - HOME[1]
    )
    if place != HOME:  # a degree of longitude is shorter there
        shrink = np.cos(np.radians(HOME[1])) / np.cos(np.radians(place[1]))
        degrees["easting_m"] = place[0] + (degrees.easting_m - place[0]) * shrink
    names = {one.fix for one in found(swapped(degrees))}
    assert names == {LogConvention.EAST_NORTH_SWAPPED, LogConvention.POSITION_DEGREES}
    path = saved(swapped(degrees), tmp_path / "run.csv")
    (log,) = read_logs(path, list(names))
    assert log.easting_m[0] == log.northing_m[0] == 0.0
    plain = runs()["figure_eight"].easting_m
    assert np.allclose(log.easting_m, plain - plain[0], rtol=5e-3, atol=0.02)


# --- heading -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BENT)
@pytest.mark.parametrize("degrees", [90.0, -90.0, 40.0, -135.0])
def test_a_turned_heading_is_told_with_its_angle(name: str, degrees: float) -> None:
    (one,) = found(turned(degrees)(runs()[name]))
    assert one.fix is None and "give fixes" not in sentence(one)
    side = "clockwise" if degrees > 0.0 else "counter-clockwise"
    told = float(one.what.split(" degrees")[0].split()[-1])
    assert f"degrees {side} of the course" in one.what and told == pytest.approx(abs(degrees), abs=12.0)
    assert ("subtract" if degrees > 0.0 else "add") in one.advice


@pytest.mark.parametrize("name", [*BENT, *STRAIGHT])
@pytest.mark.parametrize("degrees", [-15.0, 15.0])
def test_a_bias_that_an_effect_can_be_passes(name: str, degrees: float) -> None:
    assert found(turned(degrees)(runs()[name])) == []


@pytest.mark.parametrize("name", STRAIGHT)
def test_a_straight_run_with_a_turned_heading_names_both_readings(name: str) -> None:
    (one,) = found(turned(180.0)(runs()[name]))
    assert "fixes heading-reversed" in sentence(one)
    if one.fix is not LogConvention.HEADING_REVERSED:
        assert "driven along one line only" in one.format_sentence()
    (one,) = found(turned(-70.0)(runs()[name]))
    assert one.fix is None and "70 degrees counter-clockwise" in one.what


@pytest.mark.parametrize("spoil", [turned(180.0), SPOIL[LogConvention.HEADING_CCW_NORTH]], ids=["turned", "mirrored"])
def test_runs_with_turns_decide_for_straight_ones(
    spoil: Callable[[pd.DataFrame], pd.DataFrame], tmp_path: Path
) -> None:
    paths = [saved(spoil(runs()[name]), tmp_path / f"{name}.csv") for name in ("straight_090", "circles_right")]
    fix = "heading-reversed" if spoil is not SPOIL[LogConvention.HEADING_CCW_NORTH] else "heading-ccw-north"
    message = refusal(lambda: read_logs(paths))
    assert message.startswith("straight_090") and f"give fixes {fix} to convert" in message
    assert "one line only" not in message and message.count("fixes ") == 1
    assert len(read_logs(paths, [fix])) == 2


def test_radians_of_a_drive_due_east_are_no_degrees_from_east() -> None:
    for shift in (-0.3, 0.0, 0.3):
        frame = turned(shift)(runs()["straight_090"])
        assert [one.fix for one in found(SPOIL[LogConvention.HEADING_RADIANS](frame))] == [
            LogConvention.HEADING_RADIANS
        ]


# --- steering ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BENT)
@pytest.mark.parametrize("offset_deg", [-4.0, -1.1, 1.1, 4.0])
@pytest.mark.parametrize("wheelbase_m", [None, 2.4])
def test_radians_with_an_offset_are_radians(name: str, offset_deg: float, wheelbase_m: float | None) -> None:
    frame = SPOIL[LogConvention.STEERING_RADIANS](runs()[name])
    for column in ("steering_deg", "steering_command_deg"):
        frame[column] += np.radians(offset_deg)
    assert [one.fix for one in found(frame, wheelbase_m)] == [LogConvention.STEERING_RADIANS]


@pytest.mark.slow
def test_small_degrees_with_a_large_offset_are_no_radians() -> None:
    """Angles within a degree on a path that a standing offset bends: only changes of the angle may count."""
    names = (*STRAIGHT, "autosteer_180")
    gentle = [(index, drive) for index, drive in enumerate(default_programme()) if drive.name in names]
    assert len(gentle) == 4
    for seed in range(8):
        truth = Truth({"steering_offset": {"angle_deg": 6.0}}, seed, rate_hz=10.0)
        for frame in (truth.log(drive, index) for index, drive in gentle):
            shrunk = in_unit(1.0 / max(frame.steering_deg.abs().max(), 1.0), "steering_command_deg", "steering_deg")
            assert found(shrunk(frame), 2.4) == []


# --- shuttle -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BENT)
@pytest.mark.parametrize("heading", [True, False])
def test_reverse_gear_while_driving_forward_is_the_shuttle(name: str, heading: bool) -> None:
    frame = runs()[name].assign(shuttle=-1)
    (one,) = found(frame if heading else frame.drop(columns="heading_deg"))
    assert one.fix is None and one.what == "shuttle is -1 where the tractor drives forward"
    assert "first in line 2" in one.why


def back_and_forth() -> pd.DataFrame:
    return make_logs({}, 4, [reversing()], rate_hz=10.0)[0]


def test_a_shuttle_of_the_wrong_sign() -> None:
    frame = back_and_forth()
    assert found(frame) == []
    (one,) = found(frame.assign(shuttle=-frame.shuttle))
    assert one.fix is None and one.what == "shuttle has the wrong sign"


def test_a_missing_shuttle_of_a_run_with_reverse_is_seen() -> None:
    frame = back_and_forth()
    (one,) = found(frame.drop(columns="shuttle"))
    first = int(np.flatnonzero(frame.shuttle < 0)[0]) + 2
    assert "drives in reverse" in one.what and one.advice == "write -1 in those rows"
    assert int(one.why.rsplit(" ", 1)[1]) == pytest.approx(first, abs=30)


def test_reverse_all_the_way_is_told_where_the_path_turns_enough() -> None:
    """Driven backwards the path is that of the mirrored steering, and the heading points away from it."""
    for name, words in (("figure_eight", "drives in reverse"), ("straight_090", "or reverse without -1 in shuttle")):
        backwards = SPOIL[LogConvention.STEERING_LEFT](turned(180.0)(runs()[name]))
        assert words in found(backwards)[0].format_sentence()


def test_a_mirrored_path_along_one_line_is_not_the_shuttle() -> None:
    """Towards the south-east a swap turns the course against the heading; gentle bends show the steering mirrored."""
    time = np.arange(0.0, 60.0, 0.1)
    steering = 4.0 * np.sin(2.0 * np.pi * time / 20.0)
    heading = np.radians(135.0) + np.cumsum(1.4 / 2.4 * np.tan(np.radians(steering))) * 0.1
    heading -= np.mean(heading) - np.radians(135.0)
    frame = pd.DataFrame({
        "time_s": time, "easting_m": np.cumsum(np.sin(heading)) * 0.14, "northing_m": np.cumsum(np.cos(heading)) * 0.14,
        "heading_deg": np.degrees(heading), "speed_mps": 1.4, "steering_deg": steering,
    })  # fmt: skip
    assert found(frame) == []
    assert found(swapped(frame))[0].fix is LogConvention.EAST_NORTH_SWAPPED


def test_a_reversed_heading_is_not_the_shuttle() -> None:
    frame = turned(180.0)(back_and_forth())
    assert [one.fix for one in found(frame)] == [LogConvention.HEADING_REVERSED]


# --- standing ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_tractor_that_never_moves_is_refused(noise: float) -> None:
    rng = np.random.default_rng(1)
    frame = runs()["steps"]
    rows = len(frame)
    frame = frame.assign(
        easting_m=5.0 + noise * rng.standard_normal(rows), northing_m=7.0 + noise * rng.standard_normal(rows)
    )
    message = refusal(lambda: build_log(frame, "yard"))
    assert message.startswith("yard: its positions stay within") and "never moves" in message


def test_a_slow_drive_moves() -> None:
    frame = runs()["steps"]
    slow = frame.assign(time_s=frame.time_s * 5.0).drop(columns=["speed_mps", "speed_command_mps"])
    assert isinstance(build_log(slow, "slow"), Log)


def test_positions_that_jump_in_most_rows_are_no_matter_of_the_clock() -> None:
    message = refusal(lambda: build_log(in_unit(100.0, "easting_m", "northing_m")(runs()["speed_steps"]), "run"))
    assert "position jumps faster than 20 m/s" in message and "give positions in metres" in message
