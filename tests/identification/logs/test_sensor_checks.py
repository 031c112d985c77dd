"""Instruments that contradict each other are found, told and set right; honest ones are left alone."""

import numpy as np
import pandas as pd
import pytest

from tests.diagnosis.hiding import hidden
from tests.identification.log_tables import refusal, runs, table
from tests.truth.drives import (
    Drive,
    circles,
    default_programme,
    drive,
    stairs,
    straight,
    three_speeds_programme,
    triangle,
)
from tests.truth.model import Truth, make_logs
from tests.truth.second import second_logs
from vehicle.identification.logs.column_quality import drop_constant_columns
from vehicle.identification.logs.reader import build_log, list_remarks
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.sensor_checks import (
    correct_sensors,
    correct_sensors_like_others,
    drop_commands_not_driven,
)
from vehicle.model.effects import get_effect

WEAVE = drive("weave", 180.0, triangle(12.0, 14.0), 1.6)
ROWS = drive(
    "rows", 190.0, stairs(*[(18.0, 0.0), (9.0, 30.0), (18.0, 0.0), (9.0, -30.0)] * 4), 1.6,
    stairs(*[(18.0, 1.0), (9.0, 0.0)] * 8),
)  # fmt: skip
LINES = (straight(90.0, seconds=40.0), straight(270.0, seconds=40.0))
PACES = drive("paces", 60.0, stairs((60.0, 0.0)), stairs((20.0, 1.0), (20.0, 1.6), (20.0, 2.2)))


def log_of(one: Drive, seed: int = 5, **effects: dict[str, float]) -> pd.DataFrame:
    return Truth(effects, seed, rate_hz=10.0).log(one)


def read(frame: pd.DataFrame) -> Log:
    return build_log(frame, "run")


@pytest.mark.slow
def test_honest_sensors_are_left_alone() -> None:
    slow = {"wheel_slip": {"ratio": 0.12}, "cross_slope_drift": {"ratio": 0.04, "bearing_deg": 20.0}}
    for effects in ({}, slow, hidden(["steering_dead_time", "gnss_latency"]), hidden(["side_slip", "grip_drift"])):
        for frame in (log_of(WEAVE, 7, **effects), *make_logs(effects, 7, default_programme()[:12:3], rate_hz=10.0)):
            log = read(frame)
            assert log.corrections == ()
            assert not any("off" in one.rule for one in log.gated)


@pytest.mark.parametrize("factor", [0.7, 1.3, 1.4])
def test_a_factor_of_the_speed_sensor_is_told_and_taken_out(factor: float) -> None:
    frame = log_of(WEAVE)
    true = frame.speed_mps.to_numpy()
    log = read(frame.assign(speed_mps=true * factor))
    (told,) = log.corrections
    assert told.startswith(f"speed_mps reads {100 * abs(factor - 1):.0f} % ")
    assert log.speed_mps is not None
    assert float(np.median(log.speed_mps[log.used]) / np.median(true)) == pytest.approx(1.0, abs=0.01)


def test_a_factor_that_straight_logs_tell_is_taken_out_of_bends_of_the_same_sensor() -> None:
    """A circle alone tells no factor; beside a line with the same sensor it does, beside another sensor it does not."""
    line, bend = log_of(straight(90.0, seconds=40.0)), log_of(circles(1))
    wrong = [read(frame.assign(speed_mps=1.3 * frame.speed_mps)) for frame in (line, bend)]
    assert wrong[0].speed_factor > 1.25 and wrong[1].corrections == ()
    first, second = correct_sensors_like_others(wrong)
    assert first is wrong[0] and second.speed_factor == first.speed_factor
    (told,) = second.corrections
    assert "as in run: the same sensor" in told
    assert second.speed_mps is not None
    middle = float(np.median(second.speed_mps) / np.median(bend.speed_mps))
    assert middle == pytest.approx(1.0, abs=0.02)
    assert correct_sensors_like_others([first, second])[1] is second
    assert correct_sensors_like_others([wrong[0], read(bend)])[1].corrections == ()
    assert correct_sensors_like_others([read(line), wrong[1]])[1].corrections == ()


def test_slip_under_the_implement_is_no_factor_of_the_sensor() -> None:
    """A wheel sensor reads more while the implement pulls and right while it does not: that is slip."""
    half = drive("line", 120.0, stairs((60.0, 0.0), (60.0, 0.0)), 1.5, stairs((60.0, 0.0), (60.0, 1.0)))
    frame = log_of(half)
    frame["speed_mps"] *= np.where(frame.implement == 1, 1.25, 1.0)
    assert read(frame).corrections == ()


def test_a_wheel_sensor_that_is_off_costs_its_rows() -> None:
    frame = log_of(WEAVE)
    rows = (frame.index > 600) & (frame.index < 900)
    log = read(frame.assign(steering_deg=frame.steering_deg.where(~rows, 0.0)))
    (gone,) = [one for one in log.gated if "wheel sensor frozen" in one.rule]
    assert abs(gone.rows - 299) <= 3
    (fault,) = log.faults
    assert (fault.id, fault.run) == ("wheel_sensor_frozen", log.name)
    assert fault.from_s == frame.time_s[601] and abs((fault.to_s or 0.0) - frame.time_s[899]) < 0.2
    assert log.segment_count == 2


def test_a_wheel_angle_that_is_noise_is_not_logged() -> None:
    frame = log_of(WEAVE)
    log = read(frame.assign(steering_deg=np.random.default_rng(2).normal(0.0, 8.0, len(frame))))
    (told,) = log.corrections
    assert log.steering_deg is None and told.startswith("steering_deg is unrelated to the bends of the path")
    straight_on = log_of(straight(90.0, seconds=40.0))
    wander = np.random.default_rng(3).normal(0.0, [[0.3], [8.0]], (2, len(straight_on)))
    noise = read(straight_on.assign(steering_command_deg=wander[0], steering_deg=wander[1]))
    assert noise.steering_deg is not None, "straight ahead tells nothing by itself"
    assert correct_sensors_like_others([log, noise])[1].steering_deg is None
    assert correct_sensors_like_others([log, read(straight_on)])[1].steering_deg is not None
    late = log_of(WEAVE, **hidden(["steering_dead_time", "steering_backlash"]))
    assert read(late).steering_deg is not None
    alone = frame.drop(columns="steering_command_deg").assign(steering_deg=np.roll(frame.steering_deg, 35))
    assert read(alone).steering_deg is not None, "without a command nothing else steers"


@pytest.mark.parametrize(("slalom_deg", "noise_deg"), [(1.5, 0.1), (3.0, 1.0), (3.0, 5.0), (6.0, 2.0)])
def test_a_wheel_angle_that_is_noise_is_told_in_a_mild_slalom(slalom_deg: float, noise_deg: float) -> None:
    frame = log_of(drive("slalom", 60.0, triangle(slalom_deg, 12.0), 1.4))
    rng = np.random.default_rng(4)
    log = read(frame.assign(steering_deg=rng.normal(0.0, noise_deg, len(frame)).round(1)))
    assert log.steering_deg is None
    assert log.corrections[0].startswith("steering_deg is unrelated to the bends of the path (correlation ")
    assert read(frame).steering_deg is not None
    noisy = frame.steering_deg + rng.normal(0.0, 0.3 * slalom_deg, len(frame))
    assert read(frame.assign(steering_deg=noisy)).steering_deg is not None, "noise on an angle that tells is no doubt"


def test_noise_of_the_wheel_sensor_is_left_out_of_all_logs_of_the_set() -> None:
    slalom, line = log_of(drive("slalom", 60.0, triangle(3.0, 12.0), 1.4)), log_of(straight(90.0, seconds=40.0))
    rng = np.random.default_rng(6)
    wander = rng.normal(0.0, 0.3, len(line))
    first = read(slalom.assign(steering_deg=rng.normal(0.0, 1.0, len(slalom))))
    second = read(line.assign(steering_command_deg=wander, steering_deg=rng.normal(0.0, 1.0, len(line))))
    assert first.steering_deg is None and second.steering_deg is not None
    assert correct_sensors_like_others([first, second])[1].steering_deg is None


def test_columns_that_stand_still_are_not_logged() -> None:
    frame = log_of(WEAVE)
    log = read(frame.assign(heading_deg=12.0, steering_command_deg=0.0))
    assert log.heading_deg is None and log.steering_command_deg is None
    assert [one.split(" in every row")[0] for one in log.corrections] == [
        "heading_deg is 12",
        "steering_command_deg is 0",
    ]
    assert "the column is ignored" in list_remarks(log)[0]
    assert read(frame.assign(speed_mps=0.0)).speed_mps is None


def test_a_heading_that_stands_still_on_a_straight_drive_elsewhere_is_not_logged() -> None:
    frame = log_of(straight(200.0, seconds=30.0))
    log = read(frame.assign(heading_deg=90.0))
    assert (
        log.heading_deg is None and "heading_deg is 90 in every row while the path runs towards " in log.corrections[0]
    )
    assert read(frame.assign(heading_deg=200.0)).heading_deg is not None
    assert "heading" in refusal(lambda: read(frame.assign(heading_deg=20.0)))  # a direction of it, read backwards


def test_a_start_of_a_second_is_no_speed_in_kmh() -> None:
    few = log_of(drive("start", 30.0, stairs((30.0, 0.0)), 1.4))[:12]
    assert float(few.speed_command_mps.mean()) > 2.7 * float(few.speed_mps.mean())
    assert "no segment lasts 5 s" in list_remarks(read(few))[-1]


def test_steering_that_stands_still_is_refused_only_where_the_path_bends() -> None:
    still = log_of(WEAVE).drop(columns="steering_command_deg").assign(steering_deg=0.0)
    assert "steering_deg is 0 in every row while the path bends" in refusal(lambda: read(still))
    line = log_of(straight(90.0)).drop(columns="steering_command_deg").assign(steering_deg=0.0)
    assert read(line).steering_deg is not None


def test_columns_may_stand_still_where_the_tractor_does_nothing_else() -> None:
    assert read(table()).corrections == ()
    assert all(read(frame).corrections == () for frame in runs().values())


def test_an_implement_switch_the_wrong_way_round_is_told() -> None:
    frame = log_of(ROWS)
    assert read(frame).corrections == ()
    wrong = frame.assign(implement=1 - frame.implement)
    text = refusal(lambda: read(wrong))
    assert "implement is 1 where it is lifted and 0 where it works" in text and "fixes implement-reversed" in text
    mended = build_log(wrong, "run", ["implement-reversed"])
    assert np.array_equal(mended.implement, frame.implement)
    assert "remove that fix" in refusal(lambda: build_log(frame, "run", ["implement-reversed"]))


def test_two_rows_are_too_few_to_contradict_each_other() -> None:
    few = log_of(WEAVE)[40:52]
    log = build_log(few.assign(steering_deg=-few.steering_command_deg - np.arange(12)), "few")
    assert "no segment lasts 5 s" in list_remarks(log)[-1]


def test_what_was_set_right_stays_as_it_is() -> None:
    frame = log_of(WEAVE)
    once = read(frame.assign(speed_mps=frame.speed_mps * 1.3, heading_deg=12.0))
    assert correct_sensors(drop_constant_columns(once)).corrections == once.corrections


# --- A commanded speed that was not driven is told and taken out; slip and honest commands are left alone ---


def frames_of(*drives: Drive, **effects: dict[str, float]) -> list[pd.DataFrame]:
    return [Truth(effects, 5, rate_hz=10.0).log(one, index) for index, one in enumerate(drives)]


def commanded(frames: list[pd.DataFrame], factor: float = 1.0, **columns: float) -> list[Log]:
    """Logs with the commanded speed multiplied, or columns of one value in its place, set right together."""
    wrong = [frame.assign(speed_command_mps=factor * frame.speed_command_mps).assign(**columns) for frame in frames]
    return drop_commands_not_driven([build_log(frame, f"run {index}") for index, frame in enumerate(wrong)])


@pytest.mark.slow
def test_honest_commands_and_slip_are_left_alone() -> None:
    slow = {"wheel_slip": {"ratio": 0.2}, "implement_slip": {"ratio": 0.2}}
    for effects in ({}, slow, hidden(["speed_lag", "cross_slope_drift"]), hidden(["antenna_forward", "gnss_latency"])):
        logs = commanded(frames_of(*LINES, PACES, **effects))
        assert [log.corrections for log in logs] == [(), (), ()]
    for tractor in ("eg105", "mr1000a"):
        frames = second_logs(hidden(["side_slip", "implement_slip"]), 541, three_speeds_programme(), tractor)
        assert not any(log.corrections for log in commanded(frames))


def test_a_command_that_was_driven_slower_or_faster_looks_like_slip_and_its_words_say_so() -> None:
    for factor in (0.75, 1.3):
        assert [log.corrections for log in commanded(frames_of(*LINES, PACES), factor)] == [(), (), ()]
        slip = {"ratio": 1.0 - 1.0 / factor}
        assert "the commanded speed is not what was driven" in get_effect("wheel_slip").describe(slip)
    assert "commanded speed is" not in get_effect("wheel_slip").describe({"ratio": 0.1})


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


def test_a_command_that_was_left_out_stays_out_without_another_word() -> None:
    once = commanded(frames_of(PACES, *LINES), speed_command_mps=1.9)
    again = drop_commands_not_driven(once)
    assert [log.corrections for log in again] == [log.corrections for log in once]
    assert all(log.speed_command_mps is None for log in again)
