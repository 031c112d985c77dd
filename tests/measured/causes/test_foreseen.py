"""What is foreseen of a trial is what the trial gains, where lines are straight; and nothing is refused by it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.measured.benches import LinearBench, bench_of, eg105, knobs, linear_bench
from vehicle.measured.causes.foreseen import Foresight, Motions, Seen, older
from vehicle.measured.causes.refit import restarted
from vehicle.measured.causes.selection import ended, scan
from vehicle.measured.causes.trial import Projector, Tried, needed, tried
from vehicle.measured.fit.fitting import Fit, refined
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.surprise.whitening import Increments
from vehicle.measured.thresholds import FORESEEN, OLDEST

Settings = Mapping[str, Mapping[str, float]]


@dataclass(eq=False)
class LinearPath(LinearBench):
    """Its columns are motions of the path, weighed row by row."""

    weights: np.ndarray = field(default_factory=lambda: np.ones(120))

    @property
    def course(self) -> Any:
        stretches = [SimpleNamespace(wheel=np.zeros(1))]
        return SimpleNamespace(names=("run",), rows=len(self.base) // 5, places={}, stretches=stretches)

    @property
    def path_rows(self) -> slice:
        return slice(0, 3 * self.course.rows)

    def path(self, settings: Settings) -> list[Increments]:
        moved = LinearBench.surprise(self, settings)[self.path_rows] - self.base[self.path_rows]
        return [Increments(np.zeros_like(moved), np.zeros_like(moved), moved)]

    def path_surprise(self, moves: list[Increments], settings: Settings) -> np.ndarray:
        out: np.ndarray = self.weights[self.path_rows] * (self.base[self.path_rows] + moves[0].turned)
        return out

    def surprise(self, settings: Settings) -> np.ndarray:
        return self.weights * super().surprise(settings)


@pytest.fixture
def bench() -> Any:
    made = linear_bench(steering_offset=1.0, heading_bias=-2.0, grip_drift=0.5)
    in_path = np.arange(120) < 72
    return LinearPath(made.base, {name: one * in_path for name, one in made.columns.items()})


def foresight(bench: Any, fit: Fit) -> Foresight:
    project = Projector(fit.slope)
    return Foresight(bench, fit, project, project(fit.surprise))


def trials(bench: Any, ahead: Foresight, *names: str) -> dict[str, Tried]:
    return {name: tried(bench.changes, ahead.fit, knobs(name), ahead.project) for name in names}


def moved(ahead: Foresight, some: dict[str, Tried]) -> dict[str, Motions]:
    return {name: motions for one in some.values() for name, motions in ahead.motions(one).items()}


def test_what_is_foreseen_beside_another_fit_with_other_weights_is_what_a_trial_gains_there(bench: Any) -> None:
    first = foresight(bench, bench.fit())
    seen = moved(first, trials(bench, first, "heading_bias", "grip_drift"))
    weights = np.random.default_rng(3).uniform(0.3, 3.0, 120)
    other: Any = LinearPath(bench.base, bench.columns, weights=weights)
    ahead = foresight(other, refined(other, Fit(other.fit("steering_offset").parts, other.surprise({}), np.zeros(0))))
    promises = ahead.promises(seen, seen)
    fresh = trials(other, ahead, *seen)
    for name, promise in promises.items():
        assert promise.whole == pytest.approx(fresh[name].gain, rel=1e-4) and fresh[name].gain > 10.0
        asked = len(other.asked)
        worth = promise.whole / FORESEEN / needed(1e6) * 1e6
        assert ahead.hopeless(promise, 0.99 * worth) is None
        begun = ahead.hopeless(promise, 1.01 * worth)
        assert begun is not None and not begun.ended and len(other.asked) == asked, "without a simulation"
        assert begun.columns == pytest.approx(fresh[name].columns, abs=1e-4 * np.abs(fresh[name].columns).max())


def test_motions_are_forgotten_after_some_scans_and_those_of_a_fresh_trial_are_new(bench: Any) -> None:
    ahead = foresight(bench, bench.fit())
    seen: Seen = moved(ahead, trials(bench, ahead, "heading_bias", "grip_drift"))
    for _ in range(OLDEST - 1):
        seen = older(seen) | moved(ahead, trials(bench, ahead, "grip_drift"))
        assert set(seen) == {"heading_bias", "grip_drift"}
    assert set(older(seen)) == {"grip_drift"}


@pytest.fixture(scope="module")
def circles() -> Bench:
    bench = bench_of("circles", {"steering_offset": {"angle_deg": 1.0}})
    return replace(bench, course=replace(bench.course, stretches=tuple(
        replace(one, wheel=None) for one in bench.course.stretches
    )))  # fmt: skip


def test_what_is_foreseen_as_hopeless_is_tried_before_it_is_said_that_nothing_is_left(circles: Bench) -> None:
    beside = (knobs("heading_bias"), np.array([0.0]))
    before = scan(circles, restarted(circles, (beside,), None), eg105(), set())
    fit = restarted(circles, (beside, (knobs("steering_offset"), np.array([0.99]))), None)
    after = scan(circles, fit, eg105(), set(), known=before)
    untried = [one for one in after.candidates if one.foreseen is not None]
    assert untried and not any(one.ended for one in untried)
    whole = {one.knobs.id: one for one in ended(circles, after, after.candidates)}
    for one in untried:
        alone = tried(circles.changes, fit, one.knobs, after.project)
        assert alone.gain < needed(0.0), "rightly"
        assert whole[one.knobs.id].ended and whole[one.knobs.id].gain == alone.gain


def test_beside_a_clear_one_only_what_may_go_before_it_is_tried(circles: Bench) -> None:
    fit = restarted(circles, ((knobs("antenna_right"), np.array([0.0])),), None)
    after = scan(circles, fit, eg105(), set(), known=scan(circles, fit, eg105(), set()))
    begun = [one for one in after.candidates if not one.ended]
    clear = after.candidates[0]
    same = ended(circles, after, after.candidates, clear)
    assert begun and all(one in same for one in begun if one.foreseen is not None)
    whole = ended(circles, after, same)
    assert all(one.ended for one in whole) and whole[0] is clear
