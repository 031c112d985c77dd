"""What need not be tried again: candidates of channels that a fit leaves as they were."""

from dataclasses import replace

import numpy as np
import pytest

from tests.measured.benches import bench_of, eg105, knobs
from vehicle.effects import PATH, POSITION, SPEED, STEERING, effect
from vehicle.measured.causes.known import Known, channels
from vehicle.measured.causes.refit import restarted
from vehicle.measured.causes.selection import scan
from vehicle.measured.causes.trial import Projector
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.surprise.bench import Bench

APART = frozenset({PATH, POSITION})


@pytest.fixture(scope="module")
def bench() -> Bench:
    return bench_of("circles", {"steering_offset": {"angle_deg": 1.0}})


@pytest.fixture(scope="module")
def before(bench: Bench) -> Known:
    return scan(bench, restarted(bench, (), None), eg105(), set())


def left(fit: Fit) -> np.ndarray:
    return Projector(fit.slope)(fit.surprise)


def test_after_a_cause_of_the_wheel_only_the_wheel_is_scanned_again(bench: Bench, before: Known) -> None:
    fit = restarted(bench, ((knobs("steering_lag"), np.array([0.3])),), None)
    assert before.still(bench, fit, left(fit)) >= APART
    assert STEERING not in before.still(bench, fit, left(fit)), "a part of its own, and other surprises"
    after = scan(bench, fit, eg105(), set(), known=before)
    old, new = ({one.knobs.id: one for one in found.candidates} for found in (before, after))
    assert set(new) == set(old) - {"steering_lag"}
    kept = {name for name in new if new[name] is old[name]}
    assert kept >= {name for name, one in old.items() if one.ended and effect(name).block in APART}
    assert not any(effect(name).block == STEERING for name in kept)
    fresh = scan(bench, fit, eg105(), set())
    gains = {one.knobs.id: one.gain for one in fresh.candidates if one.ended}
    assert {name: new[name].gain for name in kept & set(gains)} == pytest.approx(
        {name: gains[name] for name in kept & set(gains)}, abs=0.1
    )


def test_after_a_cause_of_the_path_it_is_scanned_again(bench: Bench, before: Known) -> None:
    fit = restarted(bench, ((knobs("steering_offset"), np.array([1.0])),), None)
    block = effect("steering_offset").block
    assert block not in before.still(bench, fit, left(fit)) and not before.same_path(bench, fit)
    after = scan(bench, fit, eg105(), set(), known=before)
    assert after.scores is not before.scores
    old = {one.knobs.id: one for one in before.candidates}
    assert not any(one is old[one.knobs.id] for one in after.candidates if effect(one.knobs.id).block == block)


def test_the_same_fit_is_not_scanned_again_but_for_what_was_only_begun(bench: Bench, before: Known) -> None:
    again = scan(bench, before.fit, eg105(), {"heading_bias"}, known=before)
    old = {one.knobs.id: one for one in before.candidates if one.ended}
    assert again.scores is before.scores and any(not one.ended for one in before.candidates)
    assert all(one is old[one.knobs.id] for one in again.candidates if one.knobs.id in old)
    assert {one.knobs.id for one in again.candidates} == {one.knobs.id for one in before.candidates} - {"heading_bias"}


def test_without_a_wheel_angle_the_steering_shows_in_the_path(bench: Bench) -> None:
    bare = replace(bench.course, stretches=tuple(replace(one, wheel=None) for one in bench.course.stretches))
    blocks = [of for of, _ in channels(replace(bench, course=bare))]
    assert blocks == [(PATH, POSITION, STEERING), (), (SPEED,)]
    assert [of for of, _ in channels(bench)] == [(PATH, POSITION), (STEERING,), (SPEED,)]
