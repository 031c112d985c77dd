"""The guard: what counts as harm and as help, what is taken out first, and halves that show the same as all runs."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.residual_models import build_programme_model, get_parameters
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.replay.horizon_errors import HorizonError, HorizonSquares, compute_horizon_errors
from vehicle.identification.thresholds import HARM_FACTOR
from vehicle.identification.verdict import guard
from vehicle.identification.verdict.cross_fit import choose_balanced_half, select_runs, split_in_halves
from vehicle.identification.verdict.guard import (
    drop_harm,
    grant_chance,
    is_harmful,
    is_helpful,
    list_doubtful_circles,
    list_unjudged,
    measure_harm,
    measure_harm_of_runs,
)

PLAIN = HorizonError(2.0, 4.0, 1.0)


@pytest.mark.parametrize(
    "after, harmful, helpful",
    [
        (PLAIN, False, False),
        (HorizonError(1.0, 4.0, 1.0), False, True),
        (HorizonError(1.0, 4.0, 1.2), True, False),
        (HorizonError(2.08, 4.0, 1.0), False, False),
        (HorizonError(2.2, 4.0, 1.0), True, False),
        (HorizonError(2.0, 4.0, math.nan), False, False),
    ],
)
def test_any_kind_of_error_that_rises_is_harm(after: HorizonError, harmful: bool, helpful: bool) -> None:
    """A heading that was not measured is nan and judges nothing."""
    before = {1.0: PLAIN, 5.0: PLAIN}
    assert is_harmful(before, {1.0: PLAIN, 5.0: after}) is harmful
    assert is_helpful(before, {1.0: PLAIN, 5.0: after}) is helpful


def test_the_way_is_not_judged_without_a_measured_speed_and_long_horizons_only_where_asked() -> None:
    before, after = {5.0: PLAIN, 20.0: PLAIN}, {5.0: HorizonError(2.0, 8.0, 1.0), 20.0: HorizonError(6.0, 4.0, 1.0)}
    assert measure_harm(before, after) == 3.0
    assert measure_harm(before, after, longest_s=5.0) == 2.0
    assert measure_harm(before, after, with_along=False, longest_s=5.0) == 1.0


def test_what_noise_alone_leaves_is_no_harm() -> None:
    before, after, noise = ({5.0: HorizonError(cross, 4.0, 1.0)} for cross in (2.0, 2.5, 2.4))
    assert measure_harm(before, after) == 1.25
    assert measure_harm(before, after, noise_floor=noise) == pytest.approx(2.5 / 2.4)


def test_the_scatter_of_few_pieces_about_the_noise_is_no_harm() -> None:
    """Of 88 pieces of 5 s the error is up to 12 % more than the noise floor by chance, of twenty times as many 3 %."""
    noise = {5.0: HorizonError(1.0, 1.74, 0.3)}
    before, after = {5.0: HorizonError(1.8, 1.77, 1.3)}, {5.0: HorizonError(1.3, 1.88, 0.9)}
    assert measure_harm(before, after, noise_floor=noise) > HARM_FACTOR
    few, many = (grant_chance(noise, seconds) for seconds in (440.0, 8800.0))
    assert few[5.0].along_cm == pytest.approx(1.74 * math.sqrt(1.0 + 2.0 * math.sqrt(4.0 / (3.0 * 88.0))))
    assert measure_harm(before, after, noise_floor=few) == 1.0
    assert measure_harm(before, after, noise_floor=many) > HARM_FACTOR


def test_differences_in_the_last_digit_are_no_harm() -> None:
    tiny, more = HorizonError(0.1, 0.1, 0.01), HorizonError(0.14, 0.14, 0.03)
    assert not is_harmful({1.0: tiny}, {1.0: more})


def test_a_heading_that_hardly_moves_the_path_is_no_harm() -> None:
    """0.05 degrees move a tractor at 1 m/s by 0.04 cm in a second, and by 0.2 cm in five."""
    before, after = HorizonError(1.0, 1.0, 0.6), HorizonError(1.0, 1.0, 0.65)
    assert not is_harmful({1.0: before}, {1.0: after})
    assert is_harmful({5.0: before}, {5.0: after})


@dataclass(frozen=True)
class _Explained:
    """Stand-in of an explained case: terms and which of them are names."""

    ids: frozenset[str]
    names: tuple[str, ...]

    @property
    def case(self) -> Any:
        return SimpleNamespace(extension=SimpleNamespace(term_ids=self.ids))


@pytest.mark.parametrize(
    "harmful, kept",
    [
        ((), {"steering_gain", "antenna_right", "wheel_slip", "grip_by_angle"}),
        (("grip_by_angle",), {"steering_gain", "antenna_right", "wheel_slip"}),
        (("wheel_slip",), {"steering_gain", "antenna_right"}),
        (("antenna_right",), {"steering_gain"}),
        (("antenna_right", "steering_gain"), set()),
    ],
)
def test_terms_without_a_name_go_first_and_names_last(
    harmful: Collection[str], kept: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The slip is only likely; of the names only the one that does harm goes."""
    explained: Any = _Explained(
        frozenset({"steering_gain", "antenna_right", "wheel_slip", "grip_by_angle"}), ("steering_gain", "antenna_right")
    )
    monkeypatch.setattr(guard, "keep_terms", lambda selection, case, ids: replace(case, ids=frozenset(ids)))
    judge: Any = SimpleNamespace(
        selection=None, measure_harm=lambda case, longest_s: 1.0 + 0.5 * len(case.ids & set(harmful))
    )
    assert drop_harm(judge, explained, 5.0).case.extension.term_ids == kept


@pytest.mark.parametrize("is_measured, named", [(True, ["steering_rate"]), (False, [])])
def test_what_the_wheel_angle_shows_keeps_its_name_though_it_is_not_saved(
    is_measured: bool, named: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both raise errors over 20 s: that of the path may have any cause, that of the wheel angle has fallen."""
    names = ("steering_rate", "side_slip")
    explained: Any = _Guarded(_GuardedTerms(frozenset(names)), list(names))
    monkeypatch.setattr(guard, "cross_fit", lambda *_: [])
    monkeypatch.setattr(guard, "_build_holdout", lambda *_: None)
    monkeypatch.setattr(
        guard,
        "drop_harm",
        lambda judge, case, longest_s: case if longest_s == 5.0 else _Guarded(_GuardedTerms(frozenset()), []),
    )
    selection: Any = SimpleNamespace(residual_model=SimpleNamespace(has_measured_wheel_angle=is_measured))
    nothing: Any = None
    guarded = guard.guard_case(nothing, nothing, selection, explained, (nothing, nothing), lambda: None)
    assert guarded.explained.names == named and not guarded.saved.case.extension.term_ids
    assert list(guarded.shown_names) == named
    assert set(guarded.unsaved_names) == set(names) - set(named)


@dataclass(frozen=True)
class _GuardedTerms:
    """Stand-in of a case: its terms and refused effects."""

    term_ids: frozenset[str]
    refused_effects: frozenset[str] = frozenset()

    @property
    def extension(self) -> Any:
        return self


@dataclass(frozen=True)
class _Guarded:
    """Stand-in of an explained case whose parts may be replaced."""

    case: _GuardedTerms
    names: list[str]


def test_both_halves_hold_one_of_two_runs_that_show_an_effect() -> None:
    model = build_programme_model("four-ways", {})
    information = np.array([0.0, 1.0, 1.0, 0.0])

    class _Fit:
        parts = ((get_parameters("steering_gain"), np.ones(1)),)
        jacobian = (np.sqrt(information)[model.residual_runs])[:, None]
        residuals = np.zeros(len(model.residual_runs))

    fit: Any = _Fit()
    half = choose_balanced_half(model, fit)
    assert len(half) == 2 and len(half & {1, 2}) == 1


def test_runs_of_a_half_are_numbered_anew_and_each_half_judges_the_other() -> None:
    model = build_programme_model("four-ways", {})
    fit = EffectFit((), np.zeros(len(model.residual_runs)), np.zeros((len(model.residual_runs), 0)))
    halves = list(split_in_halves(model, fit))
    assert len(halves) == 2
    for seen, unseen in halves:
        assert [segment.run for segment in seen.segments] == list(range(len(seen.names)))
        assert {model.dataset.names[segment.run] for segment in unseen.segments} == set(model.dataset.names) - set(
            seen.names
        )


def test_a_single_run_is_halved_by_its_pieces() -> None:
    model = build_programme_model("four-ways", {})
    alone = replace(model, dataset=select_runs(model.dataset, [0]))
    assert not list(split_in_halves(alone, EffectFit((), np.zeros(0), np.zeros((0, 0)))))  # 15 s are one piece
    long_model = build_programme_model("bends-at-speeds", {})
    dataset = replace(
        long_model.dataset, segments=tuple(_repeat(segment, 4) for segment in long_model.dataset.segments)
    )
    halves = list(split_in_halves(replace(long_model, dataset=dataset), EffectFit((), np.zeros(0), np.zeros((0, 0)))))
    (first, second), _ = halves
    assert min(first.seconds, second.seconds) > 39.0
    assert not {segment.start_s for segment in first.segments} & {segment.start_s for segment in second.segments}


def _repeat(segment: Any, times: int) -> Any:
    """A segment that goes on for several times its duration."""
    step = float(segment.time[1])
    time = np.concatenate([segment.time + number * (segment.time[-1] + step) for number in range(times)])
    names = ("east", "north", "heading", "speed", "working", "wheel", "command", "target")
    columns = {name: np.tile(getattr(segment, name), times) for name in names if getattr(segment, name) is not None}
    return replace(segment, time=time, **columns)


@pytest.mark.parametrize(
    ("halves", "unjudged"),
    [
        ([{"steering_gain"}, set()], set()),
        ([set(), set()], set()),  # too short to show anything
        ([{"grip_patch"}, set()], {"steering_gain"}),
        ([{"grip_patch"}, {"steering_gain"}], set()),
    ],
)
def test_halves_do_not_judge_what_neither_of_them_found(halves: list[set[str]], unjudged: set[str]) -> None:
    assert list_unjudged({"steering_gain"}, halves) == unjudged


@pytest.mark.parametrize(("low", "is_doubtful"), [(-0.01, True), (19.0, False)])
def test_a_circle_that_may_help_no_run_held_out_is_not_saved(low: float, is_doubtful: bool) -> None:
    case: Any = SimpleNamespace(
        extension=SimpleNamespace(term_ids={"grip_patch", "steering_gain", "grip_by_angle"}),
        compute_held_out_gain=lambda _: (1.0, (low, 90.0)),
    )
    assert list_doubtful_circles(case) == ({"grip_patch"} if is_doubtful else frozenset())


def build_squares(cross_cm: float, rows: float = 100.0) -> HorizonSquares:
    """Sums of squares of a run (m2, m2, rad2, rows) with this error across over each horizon."""
    return {horizon: np.array([rows * (0.01 * cross_cm) ** 2, 0.0, 0.0, rows]) for horizon in (1.0, 5.0, 10.0, 20.0)}


def test_what_helps_the_one_run_with_most_of_the_error_and_harms_the_others_is_harm() -> None:
    """From 40 and four times 2 cm to 20 and four times 4: the error of all falls by half, most runs double theirs."""
    noise = {horizon: HorizonError(0.5, 0.5, 0.1) for horizon in (1.0, 5.0, 10.0, 20.0)}
    before, after = (
        [build_squares(size) for size in sizes] for sizes in ((40.0, 2.0, 2.0, 2.0, 2.0), (20.0, 4.0, 4.0, 4.0, 4.0))
    )
    pooled = measure_harm(compute_horizon_errors(before), compute_horizon_errors(after), True, math.inf, noise)
    assert pooled == 1.0
    assert measure_harm_of_runs(before, after, True, math.inf, noise) == pytest.approx(2.0**0.6)
    assert measure_harm_of_runs(before, before, True, math.inf, noise) == 1.0


def test_runs_below_noise_are_neither_harmed_nor_helped() -> None:
    noise = {5.0: HorizonError(5.0, 5.0, 5.0)}
    before, after = [build_squares(1.0)] * 5, [build_squares(4.0)] * 5
    assert measure_harm_of_runs(before, after, True, math.inf, noise) == 1.0
    few = [build_squares(10.0)] * 4, [build_squares(20.0)] * 4
    assert measure_harm_of_runs(*few, True, math.inf, noise) == 1.0
    assert measure_harm_of_runs(few[0] + few[0][:1], few[1] + few[1][:1], True, math.inf, noise) == pytest.approx(2.0)
