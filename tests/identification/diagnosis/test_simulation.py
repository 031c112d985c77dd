"""The simulation with fields per step against the same effects all the time and against shorter steps, and what a field
of one run changes."""

from functools import lru_cache

import numpy as np
import pytest

from tests.identification.analytic_drives import rig, simulated
from vehicle.identification.diagnosis.drive_data import PATH_STEP_S, STRIDE, build_drive_data
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.simulation import ANGLE_COLUMN, CHAINS, X_COLUMN, Y_COLUMN, Simulator, replay_segment
from vehicle.model.effects import compute_effect_fields
from vehicle.model.tractor import Settings
from vehicle.records import DT_S

BASE = dict.fromkeys(CHAINS, "base")


@lru_cache
def simulator(programme: str) -> Simulator:
    return Simulator(build_drive_data(simulated(programme, {})), rig())


def spread(own: Simulator, settings: Settings) -> dict[str, Array]:
    """The fields of settings on all steps, for those that differ from the base."""
    known, neutral = compute_effect_fields(settings), compute_effect_fields({})
    changed = [name for name in known.keys() & own.base.keys() if known[name] != neutral.get(name)]
    return {name: np.full(own.data.path_starts[-1], known[name]) for name in changed}


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


@pytest.mark.parametrize("settings", [*STEERING, *PATH])
def test_an_effect_all_the_time_is_its_fields_at_every_step(settings: Settings) -> None:
    own = simulator("steps")
    whole, fields = Simulator(own.data, rig(), settings), spread(own, settings)
    assert np.array_equal(whole.simulate_wheel({}), own.simulate_wheel(fields))
    for one, other in zip(whole.replay({}), own.replay(fields), strict=True):
        assert np.array_equal(one, other)
    shown, seen = whole.simulate({}, BASE), Simulator(own.data, rig()).simulate(fields, BASE)
    assert all(np.array_equal(shown[name], seen[name]) for name in shown)


LATE_STEPS = 1.8  # of the simulation: the body and the sum of its turns are a longer step behind


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
