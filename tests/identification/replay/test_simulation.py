"""The simulation with fields per step against the same effects all the time and against shorter steps, and what a field
of one run changes."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from fields.arrays import Floats
from tests.identification.analytic_drives import rig, simulated
from vehicle.identification.diagnosis.drive_data import PATH_STEP_S, STRIDE, build_drive_data
from vehicle.identification.replay.drive_segments import DriveSegment, measure_wheel_lag
from vehicle.identification.replay.simulation import (
    ANGLE_COLUMN,
    CHAINS,
    FORWARD_COLUMN,
    STEERING_COLUMN,
    X_COLUMN,
    Y_COLUMN,
    Simulator,
    replay_segment,
    simulate_instruments,
    simulate_logged_values,
)
from vehicle.model.effects import compute_effect_fields
from vehicle.model.tractor import Settings
from vehicle.records import DT_S

BASE = dict.fromkeys(CHAINS, "base")
STEERING: list[Settings] = [
    {}, {"steering_dead_time": {"time_s": 0.3}}, {"steering_dead_time": {"time_s": 0.125}},
    {"steering_lag": {"time_s": 0.4}}, {"steering_rate": {"rate_deg_per_s": 7.0}},
    {"steering_deadband": {"angle_deg": 1.2}},
    {"steering_dead_time": {"time_s": 0.2}, "steering_lag": {"time_s": 0.3}, "steering_rate": {"rate_deg_per_s": 9.0}},
]  # fmt: skip
PATH: list[Settings] = [
    {}, {"steering_offset": {"angle_deg": 2.0}}, {"steering_gain": {"ratio": 1.1}},
    {"steering_asymmetry": {"ratio": 1.2}}, {"steering_backlash": {"angle_deg": 2.0}},
    {"understeer": {"deg_per_mps2": 2.0}}, {"side_slip": {"limit_g": 0.08}},
    {"implement_side_draft": {"curvature_per_m": 0.01}}, {"cross_slope_drift": {"ratio": 0.04, "bearing_deg": 60.0}},
    {"speed_scale": {"ratio": 1.06}}, {"clock_offset_speed": {"time_s": 0.2}},
    {"clock_offset_steering": {"time_s": 0.2}},
]  # fmt: skip
LATE_STEPS = 1.8  # of the simulation: the body and the sum of its turns are a longer step behind


@lru_cache
def simulator(programme: str) -> Simulator:
    return Simulator(build_drive_data(simulated(programme, {})), rig())


def spread(own: Simulator, settings: Settings) -> dict[str, Floats]:
    """The fields of settings on all steps, for those that differ from the base."""
    known, neutral = compute_effect_fields(settings), compute_effect_fields({})
    changed = [name for name in known.keys() & own.base.keys() if known[name] != neutral.get(name)]
    return {name: np.full(own.data.path_starts[-1], known[name]) for name in changed}


@pytest.mark.parametrize("settings", [*STEERING, *PATH])
def test_an_effect_all_the_time_is_its_fields_at_every_step(settings: Settings) -> None:
    own = simulator("steps")
    whole, fields = Simulator(own.data, rig(), settings), spread(own, settings)
    assert np.array_equal(whole.simulate_wheel({}), own.simulate_wheel(fields))
    for one, other in zip(whole.replay({}), own.replay(fields), strict=True):
        assert np.array_equal(one, other)
    shown, seen = whole.simulate({}, BASE), Simulator(own.data, rig()).simulate(fields, BASE)
    assert all(np.array_equal(shown[name], seen[name]) for name in shown)


@pytest.mark.parametrize("settings", PATH)
@pytest.mark.parametrize("programme", ["steps", "bends-at-speeds", "implement-lifted"])
def test_the_path_is_that_of_a_replay_at_the_measured_speed(programme: str, settings: Settings) -> None:
    """But for steps of twice the length, by which a turn comes later."""
    own = simulator(programme)
    x, y, angle, _ = own.simulate_path(spread(own, settings), own.simulate_wheel({}))
    for begin, segment in zip(own.data.path_starts, own.data.segments, strict=False):
        states = replay_segment(rig(), segment, settings, from_sensor=True, from_speed=True)[::STRIDE]
        part, rate = slice(begin, begin + len(states)), np.abs(np.diff(states[:, ANGLE_COLUMN])).max() / PATH_STEP_S
        turned = np.abs(angle[part] - states[:, ANGLE_COLUMN])
        away = np.hypot(x[part] - states[:, X_COLUMN], y[part] - states[:, Y_COLUMN])
        way = np.cumsum(np.hypot(*np.diff(states[:, [X_COLUMN, Y_COLUMN]], axis=0, prepend=states[:1, :2]).T))
        assert turned.max() < LATE_STEPS * DT_S * rate + 5e-4
        assert np.all(away < 1e-3 + np.cumsum(np.diff(way, prepend=0.0) * turned) + 0.03 * (rate > 0.01))


def test_a_field_of_one_run_changes_only_that_run() -> None:
    own = simulator("circles")
    runs = own.data.path_runs
    for name, amount in (("offset", 0.02), ("bend", 1.1), ("latency", 12.0), ("shift_right", 0.3)):
        neutral = own.base[name]
        base = own.simulate({}, BASE)
        one = own.simulate({name: np.where(runs == 1, amount, neutral)}, dict.fromkeys(CHAINS, name))
        changed = {run: max(float(np.abs(one[key] - base[key])[own.data.window_runs == run].max()) for key in base)
                   for run in (0, 1)}  # fmt: skip
        assert changed[0] == 0.0 and changed[1] > 1e-3, name


def test_a_late_receiver_shows_where_the_tractor_was() -> None:
    own = simulator("there-and-back")
    base, late = (own.simulate(fields, BASE) for fields in ({}, spread(own, {"gnss_latency": {"time_s": 0.5}})))
    speed = float(np.mean(own.data.path["speed"]))
    behind = np.hypot(base["east"] - late["east"], base["north"] - late["north"])
    assert behind[:, 2:] == pytest.approx(0.5 * speed, rel=0.01)
    delayed = own.simulate(spread(own, {"position_delay": {"time_s": 0.5}}), BASE)
    assert delayed["east"] == pytest.approx(late["east"]) and np.array_equal(delayed["heading"], base["heading"])


def test_only_chains_that_changed_are_driven_again() -> None:
    own = Simulator(build_drive_data(simulated("circles", {})), rig())
    own.simulate({}, BASE)
    assert own.simulations == 3  # wheels, speed and path
    own.simulate({"shift_right": np.full(own.data.path_starts[-1], 0.3)}, {**BASE, "instruments": 1})
    assert own.simulations == 3
    own.simulate({"offset": np.full(own.data.path_starts[-1], 0.01)}, {**BASE, "path": 1})
    assert own.simulations == 4
    for number in range(20):
        own.simulate({"offset": np.full(own.data.path_starts[-1], 0.01 * number)}, {**BASE, "path": 2 + number})
    own.simulate({}, BASE)
    assert own.simulations == 24, "the base stays"


# --- Instruments with clocks of their own, against closed forms: what a log shows, and what drives its replay ---


@pytest.fixture(scope="module")
def segment() -> DriveSegment:
    return simulated("steps", {}).segments[0]


def show_ramps(segment: DriveSegment, settings: Settings) -> tuple[Floats, Floats, Floats, Floats]:
    """What is shown where place, heading, wheel angle and speed grow by 1 m, 0.2, 0.1 rad and 0.3 m/s a second."""
    states = np.zeros((len(segment.steps_s), 5))
    for column, rate in ((X_COLUMN, 1.0), (ANGLE_COLUMN, 0.2), (STEERING_COLUMN, 0.1), (FORWARD_COLUMN, 0.3)):
        states[:, column] = rate * segment.steps_s
    return simulate_logged_values(rig(), segment, states, settings)


def test_ages_add_up(segment: DriveSegment) -> None:
    settings = {
        "gnss_latency": {"time_s": 0.2},
        "position_delay": {"time_s": 0.1},
        "clock_offset_heading": {"time_s": -0.3},
        "clock_offset_steering": {"time_s": 0.4},
        "clock_offset_speed": {"time_s": -0.1},
        "speed_scale": {"ratio": 1.1},
    }
    lever = rig().tractor.antenna_forward_m - rig().tractor.rear_axle_m
    position, heading, wheel, speed = (one[10:-10] for one in show_ramps(segment, settings))
    time = segment.time[10:-10]
    assert position[:, 0] == pytest.approx(time - 0.3 + lever * np.cos(0.2 * (time - 0.3)), abs=1e-4)
    assert heading == pytest.approx(0.2 * (time + 0.1), abs=1e-9)
    assert wheel == pytest.approx(0.1 * (time - 0.4), abs=1e-9)
    assert speed == pytest.approx(1.1 * 0.3 * (time + 0.1), abs=1e-9)


def test_what_is_late_was_under_way_before_the_first_row(segment: DriveSegment) -> None:
    """As behind a gap: a receiver that stood still there would speak against every latency."""
    position, heading, _, _ = show_ramps(segment, {"gnss_latency": {"time_s": 0.2}})
    lever = rig().tractor.antenna_forward_m - rig().tractor.rear_axle_m
    then = segment.time[:5] - 0.2
    assert position[:5, 0] == pytest.approx(then + lever * np.cos(0.2 * then), abs=1e-4)
    assert heading[:5] == pytest.approx(0.2 * then, abs=1e-9)


def test_headings_are_smoothed(segment: DriveSegment) -> None:
    smooth = show_ramps(segment, {"heading_filter": {"time_s": 0.4}})[1]
    assert smooth[40:] == pytest.approx(0.2 * (segment.time - 0.4)[40:], abs=4e-3), "it trails a ramp by its time"
    assert smooth[0] == pytest.approx(0.0, abs=1e-3)


def test_inputs_of_a_replay_are_those_of_its_times(segment: DriveSegment) -> None:
    ramp = replace(segment, grids=segment.grids | {"speed": 1.0 + 0.05 * segment.steps_s})
    late = {"clock_offset_speed": {"time_s": 0.4}, "speed_scale": {"ratio": 1.1}}
    speed = replay_segment(rig(), ramp, late, from_sensor=True, from_speed=True)[:, FORWARD_COLUMN]
    assert speed[:-60] == pytest.approx((ramp.grids["speed"][:-60] + 0.05 * 0.4) / 1.1)
    plain, early = (
        replay_segment(rig(), segment, settings, from_sensor=False, from_speed=True)[:, STEERING_COLUMN]
        for settings in ({}, {"clock_offset_steering_command": {"time_s": 0.2}})
    )
    assert early[60:-60] == pytest.approx(plain[72:-48], abs=1e-6)
    turned, before = (
        replay_segment(rig(), segment, settings, from_sensor=True, from_speed=True)[:, ANGLE_COLUMN]
        for settings in ({}, {"clock_offset_steering": {"time_s": 0.2}})
    )
    assert before[60:-60] - before[60] == pytest.approx(turned[72:-48] - turned[72], abs=2e-3)


@pytest.mark.parametrize(
    ("name", "values", "shown"),
    [
        ("position_delay", {"time_s": 0.3}, "position"),
        ("heading_delay", {"time_s": 0.3}, "heading"),
        ("heading_filter", {"time_s": 0.3}, "heading"),
        ("speed_scale", {"ratio": 1.1}, "speed"),
        ("clock_offset_steering", {"time_s": 0.4}, "wheel"),
    ],
)
def test_each_effect_shows_in_its_own_column(
    segment: DriveSegment, name: str, values: dict[str, float], shown: str
) -> None:
    """Driven at the commanded speed, so that only what is shown differs and not what is driven, but for its start."""
    plain, seen = (simulate_instruments(rig(), segment, settings) for settings in ({}, {name: values}))
    for column, one, other in zip(("position", "heading", "wheel", "speed"), plain, seen, strict=True):
        assert np.allclose(one, other, atol=0.02) is (column != shown)


def test_wheels_follow_their_commands(segment: DriveSegment) -> None:
    assert 0.0 < measure_wheel_lag([segment]) < 0.6
    ahead = np.interp(segment.steps_s + 0.7, segment.steps_s, segment.grids["wheel"])
    assert measure_wheel_lag([replace(segment, grids=segment.grids | {"wheel": ahead})]) < -0.05
    assert measure_wheel_lag([replace(segment, command=None)]) == np.inf
