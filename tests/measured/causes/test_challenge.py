"""Challenges: a cause that stands in for another gives way, one that does not stays."""

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.measured.benches import LinearBench, bench_of, eg105, knobs
from vehicle.effects import PATH, POSITION, SPEED, STEERING, effect
from vehicle.measured.causes.challenge import (
    _in_place,
    _may_give_way,
    beside,
    challenged,
    shows_within_runs,
    with_more_starts,
)
from vehicle.measured.causes.refit import restarted, without
from vehicle.measured.causes.selection import _by_chance, select
from vehicle.measured.causes.traces import Traces
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import knobs_for
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import CHANCE_SIGMAS, LEAST_GAIN


@pytest.fixture(scope="module")
def bench() -> Bench:
    return bench_of("circles", {"steering_offset": {"angle_deg": 1.0}})


@pytest.mark.parametrize("wheel", [True, False])
@pytest.mark.parametrize("speed", [True, False])
def test_sensors_cut_the_chain(wheel: bool, speed: bool) -> None:
    """What a sensor cuts off cannot stand in for what lies behind it; path and antenna are never cut apart."""
    seen: Any = SimpleNamespace(has_wheel=wheel, has_speed=speed)
    joined = {PATH, POSITION} | (set() if wheel else {STEERING}) | (set() if speed else {SPEED})
    assert beside(seen, PATH) == beside(seen, POSITION) == joined
    assert beside(seen, STEERING) == ({STEERING} if wheel else joined)
    assert beside(seen, SPEED) == ({SPEED} if speed else joined)


def test_rivals_start_on_both_sides_as_far_as_a_tractor_can_have_it() -> None:
    assert with_more_starts(knobs("steering_offset")).starts == ((0.0,), (1.0,), (-1.0,))
    assert with_more_starts(knobs("wheel_slip")).starts == ((0.1,), (0.08,), (-0.08,))
    assert with_more_starts(knobs("speed_lag")).starts[-1] == (0.0,)  # below nothing there is none
    assert with_more_starts(knobs("cross_slope_drift")) == knobs("cross_slope_drift")


def test_a_stand_in_gives_way_to_what_explains_more(bench: Bench) -> None:
    """On one circle to each side, less grip to the left and more to the right looks somewhat like an offset."""
    wrong = restarted(bench, ((knobs("steering_asymmetry"), np.array([0.9])),), None)
    outcome = challenged(bench, wrong, (), eg105())
    assert outcome.better is not None and set(outcome.better.settings) == {"steering_offset"}
    assert outcome.better.settings["steering_offset"]["angle_deg"] == pytest.approx(1.0, abs=0.02)


def test_the_true_cause_stands(bench: Bench) -> None:
    true = restarted(bench, ((knobs("steering_offset"), np.array([1.0])),), None)
    outcome = challenged(bench, true, (), eg105())
    assert outcome.better is None and outcome.alike == {"steering_offset": {}}
    assert select(bench, eg105()).alike == outcome.alike


@pytest.mark.parametrize(
    ("hidden", "spared"),
    [("steering_offset", False), ("grip_drift", False), ("heading_bias", True), ("antenna_right", True)],
)
def test_what_is_not_fitted_again_has_no_rival_there(hidden: str, spared: bool) -> None:
    """A cause in its own place, and one in that of another: straight lines tell of both before a fit is made again."""
    usual = np.array(knobs(hidden).neutral) + np.array(knobs(hidden).typical)
    bench = bench_of("circles", {hidden: knobs(hidden).values(usual)})
    for name, at in ((hidden, usual), ("steering_asymmetry", np.array([0.9]))):
        fit = restarted(bench, ((knobs(name), at),), None)
        worth_of = partial(worth_beside, fit)
        may = _may_give_way(bench, fit, name, worth_of, Traces(bench.changes, fit, bench.surprise(fit.settings)))
        assert not fit.smaller, "nothing was fitted"
        assert may == (name != hidden or not spared)
        rest = without(bench, fit, name)
        best = _in_place(bench, rest, fit.settings, effect(name).block, 0.0)[0]
        assert may or best.gain < worth_of(rest.loss)


def worth_beside(fit: Fit, loss: float) -> float:
    return loss - fit.loss - LEAST_GAIN


@pytest.mark.parametrize(("part_of_each", "shows"), [(True, True), (False, False)])
def test_a_place_shows_where_runs_come_to_it_and_leave_it(part_of_each: bool, shows: bool) -> None:
    """Half of every run bends less, or all of one run: the first is a place, the second is another tractor."""
    turned = np.random.default_rng(5).standard_normal(120)
    rows = np.arange(120)
    patch = np.where(rows % 30 < 15 if part_of_each else rows < 30, turned, 0.0)
    bench: Any = LinearBench(-0.3 * patch, {"grip_patch": patch, "steering_gain": turned})
    bench.rig = SimpleNamespace(tractor=eg105())
    place = knobs_for(eg105(), "grip_patch", {"grip_patch": (0.0, 0.0, 5.0)})
    fit = Fit(((place, np.array([0.7])),), np.zeros(120), patch[:, np.newaxis])
    assert shows_within_runs(bench, fit, "grip_patch") is shows
    assert shows_within_runs(bench, bench.fit("steering_gain", at=0.9), "steering_gain")


def test_chance_grows_with_what_is_free() -> None:
    assert _by_chance(0) == 0.0 and _by_chance(2) == pytest.approx(2.0 + 2.0 * CHANCE_SIGMAS)
