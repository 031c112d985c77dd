"""Positions and headings that a slower instrument holds: rows by hand, and the path between them."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.identification.analytic_drives import circle, log
from tests.identification.log_tables import held, refusal
from vehicle.identification.logs.column_quality import (
    drop_columns_coarse_elsewhere,
    find_rounding_step,
    interpolate_held_values,
)
from vehicle.identification.logs.reader import build_log, list_remarks, list_shared_remarks
from vehicle.identification.logs.readings import LogConvention
from vehicle.identification.replay.drive_segments import build_dataset

PLACE = ["easting_m", "northing_m"]


def drive(curvature_per_m: float, seconds: float = 20.0) -> pd.DataFrame:
    """A circle with the last millimetres of a receiver and hundredths of a degree of a compass."""
    frame, rng = circle(curvature_per_m, seconds), np.random.default_rng(3)
    noise = {"easting_m": 2e-3, "northing_m": 2e-3, "heading_deg": 0.02}
    return frame.assign(**{name: frame[name] + rng.normal(0.0, size, len(frame)) for name, size in noise.items()})


def columns(frame: pd.DataFrame) -> dict[str, np.ndarray]:
    return {name: frame[name].to_numpy(dtype=np.float64) for name in frame}


def test_positions_of_a_slower_receiver_are_measured_where_they_are_new() -> None:
    frame = drive(0.1)
    told = interpolate_held_values(columns(held(frame, 5, *PLACE)), "run")
    assert told.fresh is not None and (np.flatnonzero(told.fresh) == np.arange(0, 200, 5)).all()
    for name in PLACE:
        one = frame[name].to_numpy()
        assert told.columns[name][:196] == pytest.approx(np.interp(np.arange(196), np.arange(0, 200, 5), one[::5]))
    assert told.corrections == (
        "the positions change only every 0.5 s while rows are 0.1 s apart: the receiver is slower "
        "than the log; repeated values are not used",
    )


@pytest.mark.parametrize("spoil", [
    lambda frame: frame,
    lambda frame: held(frame, 200, *PLACE).assign(easting_m=5.0, northing_m=7.0),
    lambda frame: frame.assign(easting_m=frame.easting_m.round(1), northing_m=frame.northing_m.round(1)),
    lambda frame: pd.concat([frame, frame]),
    lambda frame: frame.iloc[:8],
])  # fmt: skip
def test_what_is_not_held_is_left_as_it_is(spoil: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    given = columns(spoil(drive(0.1)).reset_index(drop=True))
    told = interpolate_held_values(given, "run")
    assert told.fresh is None and not told.corrections
    assert all((told.columns[name] == given[name]).all() for name in given)


def test_slow_positions_in_coarse_steps_are_not_held() -> None:
    # At 0.3 m/s a position in steps of 0.1 m is the same in three rows of 10 Hz, and new where it crosses a step.
    time = np.arange(300) / 10.0
    slow = pd.DataFrame({"time_s": time, "easting_m": (0.2 * time).round(1), "northing_m": (0.22 * time).round(1)})
    assert interpolate_held_values(columns(slow), "run").fresh is None


def test_where_the_tractor_stands_old_positions_are_as_good_as_new() -> None:
    time = np.arange(600) / 10.0
    way = np.interp(time, [0.0, 20.0, 40.0, 60.0], [0.0, 30.0, 30.0, 60.0])
    noise = np.where((time > 20.0) & (time < 40.0), 0.0, np.random.default_rng(3).normal(0.0, 2e-3, 600))
    frame = held(pd.DataFrame({"time_s": time, "easting_m": way + noise, "northing_m": 0.3 * way}), 5, *PLACE)
    fresh = interpolate_held_values(columns(frame), "run").fresh
    assert fresh is not None
    standing = np.flatnonzero(fresh[200:400])
    assert len(standing) > 10 and np.diff(standing).max() <= 20, "measured all along"


def test_a_heading_of_its_own_pace_is_taken_where_it_is_new() -> None:
    frame = drive(0.1)
    told = interpolate_held_values(columns(held(held(frame, 2, *PLACE), 5, "heading_deg")), "run")
    assert told.fresh is not None and (np.flatnonzero(told.fresh) == np.arange(0, 200, 5)).all(), "the slower counts"
    assert len(told.corrections) == 2 and told.corrections[1].startswith("heading_deg changes only every 0.5 s")
    off = (told.columns["heading_deg"] - frame.heading_deg.to_numpy() + 180.0) % 360.0 - 180.0
    assert np.abs(off[:196]).max() < 0.3


def test_what_is_measured_too_rarely_is_refused_or_left_out() -> None:
    frame = drive(0.05, seconds=100.0)
    told = refusal(lambda: build_log(held(frame, 30, *PLACE), "run"))
    assert told == "run: its positions change only every 3 s; log them at 1 Hz or faster."
    rare = interpolate_held_values(columns(held(frame, 30, "heading_deg")), "run")
    assert "heading_deg" not in rare.columns and rare.fresh is None and "column is ignored" in rare.corrections[0]


def test_steering_is_read_in_all_rows_and_positions_in_the_new_ones() -> None:
    frame = held(drive(0.0), 5, *PLACE)
    steps = np.where(np.arange(200) < 92, 4.0, -8.0)
    (one,) = build_dataset([log(frame, steering_deg=steps, steering_command_deg=steps)]).segments
    assert one.rows == 40 and one.time == pytest.approx(np.arange(40) * 0.5)
    grid = np.arange(len(one.grids["wheel"])) / 60.0
    assert np.degrees(one.grids["wheel"]) == pytest.approx(np.interp(grid, [9.1, 9.2], [4.0, -8.0]))
    assert np.degrees(one.denoised_wheel_angle) == pytest.approx(np.degrees(one.grids["wheel"]))


def test_logs_that_say_the_same_are_told_together() -> None:
    runs = [build_log(held(drive(0.1), 5, *PLACE), name) for name in "abcde"]
    same = list_remarks(runs[0])[0].removeprefix("a: ")
    assert list_shared_remarks(runs) == [f"a, b, c, d, e: {same}"]
    assert list_shared_remarks(runs[:4]) == [f"a, b, c, d: {same}"]
    assert list_shared_remarks([runs[0], build_log(drive(0.1), "plain")]) == [f"a: {same}"]


def serpentine(rate_hz: float, passes: int, turn_per_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Times, and headings (deg) of straight passes of 20 s with turns by 180 degrees between, without noise."""
    seconds = 180.0 / turn_per_s
    time = np.arange(round(passes * (20.0 + seconds) * rate_hz)) / rate_hz
    done, within = np.divmod(time, 20.0 + seconds)
    return time, 180.0 * done + turn_per_s * np.maximum(within - 20.0, 0.0)


def test_a_heading_that_stays_on_straight_passes_is_not_held() -> None:
    # At 1 Hz a turn has a handful of rows: every sixth of its changes comes after a pass of the same heading.
    time, heading = serpentine(1.0, 14, 31.0)
    way = np.deg2rad(heading)
    places = {"easting_m": 2.0 * np.cumsum(np.sin(way)), "northing_m": 2.0 * np.cumsum(np.cos(way)) + 0.01 * time}
    told = interpolate_held_values({"time_s": time, "heading_deg": heading % 360.0, **places}, "run")
    assert told.fresh is None and (told.columns["heading_deg"] == heading % 360.0).all()


@pytest.mark.parametrize(("noise_m", "speed_mps"), [(0.005, 0.8), (0.007, 0.5), (0.01, 0.8)])
def test_noise_that_falls_on_the_same_centimetre_twice_is_not_held(noise_m: float, speed_mps: float) -> None:
    rng, time = np.random.default_rng(4), np.arange(10000) / 50.0
    way = speed_mps * time
    east, north = (np.round(share * way + rng.normal(0.0, noise_m, len(time)), 2) for share in (0.6, 0.8))
    assert interpolate_held_values({"time_s": time, "easting_m": east, "northing_m": north}, "run").fresh is None


def test_the_last_digits_of_degrees_are_no_slow_receiver() -> None:
    # 7 decimals are 1.1 cm of latitude and 0.7 cm of longitude, which a slow drive crosses every other row.
    time = np.arange(2000) / 50.0
    degrees = {
        "easting_m": np.round(11.0 + 0.18 * time / 74400.0, 7), "northing_m": np.round(48.1 + 0.24 * time / 111200.0, 7)
    }  # fmt: skip
    frame = pd.DataFrame({"time_s": time, **degrees, "steering_deg": 0.0})
    assert build_log(frame, "run", [LogConvention.POSITION_DEGREES], check=False).fresh is None


def test_one_bad_row_hides_no_slow_instrument() -> None:
    frame = drive(0.1)
    stalled = held(frame, 5, *PLACE).assign(time_s=frame.time_s.replace(frame.time_s[103], frame.time_s[102]))
    told = interpolate_held_values(columns(stalled), "run")
    assert told.fresh is not None and (np.flatnonzero(told.fresh) == np.arange(0, 200, 5)).all()
    slow = held(frame, 5, "heading_deg")
    turning = columns(slow.assign(heading_deg=slow.heading_deg.where(slow.index != 37)))
    told = interpolate_held_values(turning, "run")
    assert told.fresh is not None and (np.flatnonzero(told.fresh) == np.arange(0, 200, 5)).all()
    assert np.flatnonzero(np.isnan(told.columns["heading_deg"])).tolist() == [37]


# --- Columns in steps: which are told apart from what merely stands still ---


@given(
    steps=st.lists(st.integers(-9, 9), min_size=60, max_size=90), step=st.floats(0.01, 5.0), shift=st.floats(-1e3, 1e3)
)
def test_the_step_is_one_that_all_values_are_multiples_of(steps: list[int], step: float, shift: float) -> None:
    found = find_rounding_step(np.array(steps) * step + shift)
    whole = found / step
    assert found == 0.0 or (abs(whole - round(whole)) < 0.01 and round(whole) >= 1)
    changes = np.count_nonzero(np.diff(steps, 2))
    if {0, 1} <= set(steps):
        assert found == (pytest.approx(step, rel=1e-4) if changes >= 20 else 0.0)


def test_values_of_any_size_and_few_values_have_none() -> None:
    assert find_rounding_step(np.array([0.0, 1.0, 2.0])) == 0.0 and find_rounding_step(np.full(90, 2.0)) == 0.0
    assert find_rounding_step(np.random.default_rng(3).normal(size=500)) == 0.0


def test_an_even_motion_is_no_step() -> None:
    time = np.arange(400) / 10.0
    way = np.interp(time, [0.0, 10.0, 15.0, 40.0], [0.0, 7.5, 7.5, 26.25])
    assert find_rounding_step(way) == 0.0 and find_rounding_step(90.0 + 4.0 * time) == 0.0
    assert find_rounding_step(np.round(way / 0.3) * 0.3) == pytest.approx(0.3)


def test_a_heading_in_compass_points_counts_as_not_logged() -> None:
    frame = circle(0.1)
    told = log(frame.assign(heading_deg=(frame.heading_deg / 5.0).round() * 5.0))
    assert told.heading_deg is None and told.coarse_columns == {"heading_deg": pytest.approx(5.0)}
    said = "heading_deg comes in steps of 5 degrees, too coarse to be of use; the column is ignored"
    assert told.corrections == (said,)
    assert log(frame.assign(heading_deg=frame.heading_deg.round())).heading_deg is not None


def test_a_speed_in_whole_kilometres_per_hour_counts_as_not_logged() -> None:
    frame = circle(0.05)
    said = (1.5 + 0.5 * np.sin(0.3 * frame.time_s) + np.random.default_rng(3).normal(0.0, 0.1, 200)) * 3.6
    assert log(frame.assign(speed_mps=said.round() / 3.6)).speed_mps is None
    fine = log(frame.assign(speed_mps=said.round(1) / 3.6))
    assert fine.speed_mps is not None and not fine.corrections


def test_starting_and_stopping_at_once_is_no_coarse_speed() -> None:
    frame = circle(0.05, seconds=120.0)
    driven = np.where(frame.time_s % 10.0 < 8.0, 1.5, 0.0)
    told = log(frame.assign(speed_mps=driven))
    assert told.speed_mps is not None and not told.coarse_columns


def test_positions_in_half_metres_are_refused() -> None:
    frame = circle(0.05)
    places = {name: (2.0 * frame[name]).round() / 2.0 for name in ("easting_m", "northing_m")}
    assert refusal(lambda: log(frame.assign(**places))) == (
        "run: easting_m comes in steps of 0.5 m, too coarse to show how a tractor steers; log positions with more "
        "digits, to 0.01 m or better."
    )
    assert not log(frame.round({"easting_m": 1, "northing_m": 1})).corrections


def test_the_same_compass_is_left_out_where_it_stood_on_one_point() -> None:
    frame, straight = circle(0.1), circle(0.0, bearing_deg=90.0)
    coarse = log(frame.assign(heading_deg=(frame.heading_deg / 5.0).round() * 5.0), "bend")
    still, fine = log(straight, "still"), log(circle(0.03), "fine")
    one, two, three = drop_columns_coarse_elsewhere([coarse, still, fine])
    assert one is coarse and three is fine
    assert two.heading_deg is None and "heading_deg comes in steps of 5 degrees, as in bend," in two.corrections[0]
    assert drop_columns_coarse_elsewhere([still, fine]) == [still, fine]


def test_directions_of_a_square_field_are_no_coarse_compass() -> None:
    turned = np.repeat([0.0, 90.0, 180.0, 270.0], 50)
    assert log(circle(0.05), heading_deg=turned).heading_deg is not None
