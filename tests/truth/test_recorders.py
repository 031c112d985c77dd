"""What all recorders must do alike: effects of the receiver, clocks of columns, faults, draws decided by the seed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.examples import draw_seed
from tests.truth import fifth, fourth
from tests.truth import second as other
from tests.truth.cases import FAULT_IDS, ColumnClock, Fault, TruthCase
from tests.truth.drives import Drive, default_programme, drive, stairs, three_speeds_programme, triangle
from tests.truth.effects import CLEAR_SIZES, NEUTRAL, OUTSIDE, OUTSIDE_NEUTRAL
from tests.truth.model import Truth, make_logs
from tests.truth.recorder import Instruments
from tests.truth.sensors import PERFECT
from tests.truth.test_machines import lay_drive
from tests.truth.third import Third, make_third_logs

PLACE, PATH = {"easting_m", "northing_m"}, {"easting_m", "northing_m", "heading_deg"}
COLUMN_OF = {"position": "easting_m", "heading": "heading_deg", "steering": "steering_deg", "speed": "speed_mps"}
BEND = drive("bend", 40.0, stairs((12.0, 0.0), (14.0, 10.0), (14.0, -10.0)), stairs((18.0, 1.4), (22.0, 2.0)),
             bearing_deg=30.0)  # fmt: skip
WEAVE = drive("weave", 40.0, triangle(12.0, 14.0), stairs((20.2, 1.4), (19.8, 2.0)), bearing_deg=30.0)


LOGS: dict[str, Callable[[TruthCase, Drive, int], pd.DataFrame]] = {
    "first": lambda case, run, index: Truth(
        case.effects, 3, case.rate_hz, soil_deg_per_s=0.0, instruments=PERFECT).log(run, index),
    "second": lambda case, run, index: other.Second(
        case.effects, 3, roughness=0.0, receiver=other.EXACT).log(run, index),
    "third": lambda case, run, index: Third(case, Instruments(), 0.0).log(run, index),
    "fourth": lambda case, run, index: fourth.log_run(case, run, index, Instruments()),
    "fifth": lambda case, run, index: fifth.log_run(
        case, run.name, lay_drive(run), run.bearing_deg or 0.0, index, Instruments()),
}  # fmt: skip
"""Logs without noise, on even ground."""


def recorders(*names: str) -> pytest.MarkDecorator:
    slow = {"fourth": pytest.mark.matrix, "fifth": pytest.mark.matrix}
    return pytest.mark.parametrize("name", [pytest.param(name, marks=slow.get(name, ())) for name in names])


def log(name: str, run: Drive, index: int = 0, **fields: Any) -> pd.DataFrame:
    return LOGS[name](TruthCase("mixed", 3, **fields), run, index)


@recorders("first", "second", "third", "fourth", "fifth")
def test_the_receiver_is_moved_late_and_biased_as_said(name: str) -> None:
    plain, near = log(name, BEND), 0.02 if name == "fifth" else 3e-3
    heading = np.radians(plain.heading_deg)
    for effect, turn in (("antenna_forward", 0.0), ("antenna_right", 0.5 * np.pi)):
        moved, away = log(name, BEND, effects={effect: CLEAR_SIZES[effect]}), CLEAR_SIZES[effect]["distance_m"]
        assert np.allclose(moved.easting_m - plain.easting_m, away * np.sin(heading + turn), atol=near)
        assert np.allclose(moved.northing_m - plain.northing_m, away * np.cos(heading + turn), atol=near)
    late = log(name, BEND, effects={"gnss_latency": {"time_s": 0.2}})
    for column in PATH:
        assert np.allclose(late[column][22:], plain[column][20:-2], atol=near if column in PLACE else 10 * near)
    assert np.array_equal(late.speed_mps, plain.speed_mps) and np.array_equal(late.steering_deg, plain.steering_deg)
    turned = log(name, BEND, effects={"heading_bias": {"angle_deg": 1.5}})
    assert np.allclose((turned.heading_deg - plain.heading_deg) % 360.0, 1.5, atol=near)


@recorders("third", "fourth", "fifth")
@pytest.mark.parametrize("column", COLUMN_OF)
def test_a_clock_moves_its_column_and_no_other(name: str, column: str) -> None:
    plain, cell = log(name, WEAVE), COLUMN_OF[column]
    for clock, rows in ((ColumnClock(delay_s=0.3), 3), (ColumnClock(offset_s=-0.2), -2)):
        moved = log(name, WEAVE, columns={column: clock})
        now, then = moved[cell].to_numpy()[20:-20], plain[cell].to_numpy()[20 - rows : -20 - rows]
        assert np.abs(now - then).max() < (3e-3 if name != "fifth" else 0.15)
        for unmoved in set(plain) - (PLACE if column == "position" else {cell}):
            assert np.array_equal(moved[unmoved], plain[unmoved])
    held = log(name, WEAVE, columns={column: ColumnClock(hold_s=1.0, hold_jitter=0.1)})[cell].to_numpy()
    assert np.mean(np.diff(held[120:]) == 0.0) >= 0.85
    if column in ("speed", "steering"):
        scaled = log(name, WEAVE, columns={column: ColumnClock(scale=1.07)})[cell]
        assert np.abs(scaled - 1.07 * plain[cell]).max() < 0.06
    slow = log(name, WEAVE, columns={column: ColumnClock(filter_s=0.4)})[cell].to_numpy()
    late = [np.mean((slow[30:-30] - np.interp(np.arange(30, len(slow) - 30) - 10.0 * age, np.arange(len(slow)),
                                              plain[cell])) ** 2) for age in np.arange(0.0, 0.9, 0.05)]  # fmt: skip
    assert column == "speed" or 0.05 * np.argmin(late) == pytest.approx(0.4, abs=0.06)


@recorders("third", "fourth", "fifth")
@pytest.mark.parametrize("fault_id", FAULT_IDS)
def test_a_fault_begins_when_it_says(name: str, fault_id: str) -> None:
    """Nothing differs before its first second, and what should differ does so within two seconds of it."""
    fault = Fault(fault_id, 1, 20.0, 30.0, {"mode": 1.0, "size_m": 2.0} if fault_id == "position_lost" else {})
    whole, broken = (log(name, WEAVE, 1, faults=faults) for faults in ((), (fault,)))
    pd.testing.assert_frame_equal(log(name, WEAVE, 0, faults=(fault,)), log(name, WEAVE, 0))
    first = fault_id.split("_")[0]
    column = {"heading": "heading_deg", "speed": "speed_mps", "position": "easting_m"}.get(first, "steering_deg")
    times = whole["time_s"].to_numpy() - whole["time_s"].iloc[0]
    unequal = np.flatnonzero(np.abs(whole[column] - broken[column]).to_numpy() > 1e-9)
    assert 20.0 - 0.05 <= times[unequal[0]] <= 22.0
    frozen = np.ptp(broken[column].to_numpy()[(times >= 20.1) & (times < 29.9)])
    assert fault_id == "steering_loose" or (frozen == 0.0) == fault_id.endswith("_frozen")
    if fault_id.endswith(("_frozen", "_lost")):
        assert times[unequal[-1]] < 30.1


@recorders("third", "fourth", "fifth")
def test_loose_wheels_stop_following_and_stuck_ones_run_to_the_lock(name: str) -> None:
    loose = log(name, WEAVE, faults=(Fault("steering_loose", 0, 20.0),))["steering_deg"].to_numpy()
    assert np.ptp(loose[210:]) < 0.1
    stuck = log(name, WEAVE, faults=(Fault("steering_stuck", 0, 20.0, None, {"side": -1.0}),))["steering_deg"]
    assert stuck.iloc[-1] == pytest.approx(-35.0, abs=0.2)


CHANGES = {
    **dict.fromkeys((*CLEAR_SIZES, *OUTSIDE), PATH),
    **dict.fromkeys(("steering_dead_time", "steering_lag", "steering_rate", "steering_deadband"),
                    PATH | {"steering_deg"}),
    **dict.fromkeys(("cross_slope_drift", "wind_drift", "antenna_forward", "antenna_right"), PLACE),
    **dict.fromkeys(("wheel_slip", "implement_slip", "speed_lag"), PATH | {"speed_mps"}),
    "heading_bias": {"heading_deg"},
}  # fmt: skip


@pytest.mark.parametrize("effect", sorted(CHANGES))
@pytest.mark.parametrize("make", [Truth, other.Second])
def test_an_effect_changes_its_columns_and_no_other(make: type[Truth] | type[other.Second], effect: str) -> None:
    """With the same seed, noise and commands are the same to the bit, so any other difference is the effect's."""
    hidden = {effect: {**CLEAR_SIZES, **OUTSIDE}[effect]}
    if make is other.Second and effect in OUTSIDE:
        with pytest.raises(ValueError, match=f"cannot hide {effect}"):
            make(hidden)
        return
    weave = stairs((6.0, 0.0), (8.0, 3.0), (8.0, -10.0), (8.0, 1.0), (8.0, 15.0))
    run = drive("weave", 38.0, weave, 2.2, 1.0, bearing_deg=70.0)
    plain, changed = (make(effects, seed=5).log(run) for effects in ({}, hidden))
    assert {column for column in plain if not np.array_equal(plain[column], changed[column])} == CHANGES[effect]


MAKERS: dict[str, Callable[[int], list[pd.DataFrame]]] = {
    "first": lambda seed: make_logs({}, seed, default_programme()[:3]),
    "second": lambda seed: other.second_logs({}, seed, three_speeds_programme()[6:]),
    "third": lambda seed: make_third_logs(TruthCase("clean", seed, programme="one_sided")),
    "fourth": lambda seed: fourth.make_fourth_logs(TruthCase("clean", seed, programme="one_speed")),
    "fifth": lambda seed: fifth.make_fifth_logs(TruthCase("clean", seed, programme="right_only", rate_hz=4.0)),
}


@recorders(*MAKERS)
def test_logs_are_decided_by_their_seed(name: str) -> None:
    seed = draw_seed()
    for one, two, three in zip(*(MAKERS[name](number) for number in (seed, seed, seed + 1)), strict=True):
        pd.testing.assert_frame_equal(one, two, check_exact=True)
        assert not one["easting_m"].equals(three["easting_m"]) and one.attrs["name"]
        assert (np.diff(one["time_s"]) > 0.0).all() and (one["speed_mps"].dropna() >= 0.0).all()
        assert one.notna().all(axis=None)
        assert one["heading_deg"].dropna().between(0.0, 360.0).all()


def test_neutral_effects_hide_nothing() -> None:
    run = default_programme()[4]
    pd.testing.assert_frame_equal(Truth({}, 3).log(run), Truth({**NEUTRAL, **OUTSIDE_NEUTRAL}, 3).log(run))
    pd.testing.assert_frame_equal(other.Second({}, 3).log(run), other.Second(NEUTRAL, 3).log(run))
