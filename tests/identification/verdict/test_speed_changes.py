"""Starts and stops unlike those of the tractor file, and the note on intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.residual_models import build_commanded_model, build_programme_model, get_parameters
from vehicle.identification.cause_selection.refit import add_part, refit_with_new_weights
from vehicle.identification.fit.open_loop import ModelTerm
from vehicle.identification.fit.residual_fit import refine_fit
from vehicle.identification.verdict.correlations import CONTENTS, describe_intervals
from vehicle.identification.verdict.held_out_case import is_calibration
from vehicle.identification.verdict.hints import (
    AT_STARTS,
    SETTLING_S,
    describe_speed_changes,
    find_speed_changes,
)

Array = np.ndarray
PROGRAMME = "two-speeds"


def build_stub_case(change: Callable[[Array, Array], Array], with_target: bool = True) -> Any:
    """A case without causes, whose measured speeds are a change of the simulated ones: of time and speed."""
    dataset = build_commanded_model(PROGRAMME, {}).dataset
    segments = [
        replace(one, speed=change(one.time, one.speed), target=one.target if with_target else None)
        for one in dataset.segments
    ]
    model = SimpleNamespace(dataset=SimpleNamespace(segments=segments), rig=build_commanded_model(PROGRAMME, {}).rig)
    return SimpleNamespace(residual_model=model, tolerated={}, extension=SimpleNamespace(terms=()))


@pytest.mark.parametrize("ahead_s, word", [(0.4, "faster"), (-0.4, "more slowly")])
def test_a_speed_that_changes_sooner_or_later_is_told_at_starts(ahead_s: float, word: str) -> None:
    hint = describe_speed_changes(build_stub_case(lambda time, speed: np.interp(time + ahead_s, time, speed)))
    assert hint is not None and hint.depends_on == AT_STARTS and word in hint.words


def test_a_speed_that_is_wrong_all_the_time_is_none_of_starts() -> None:
    assert describe_speed_changes(build_stub_case(lambda time, speed: 0.9 * speed)) is None
    assert describe_speed_changes(build_stub_case(lambda time, speed: speed + 0.1 * np.sin(time), False)) is None


def test_changes_of_speed_last_until_a_drive_line_has_settled() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    changing = find_speed_changes(time, np.where((time > 8.0) & (time < 9.0), 0.5, 0.0))
    assert time[changing].min() == pytest.approx(8.1 - SETTLING_S, abs=0.11)
    assert time[changing].max() == pytest.approx(8.9 + SETTLING_S, abs=0.11)
    assert not find_speed_changes(time, np.zeros(len(time))).any()


@pytest.mark.parametrize("lag_s, is_usual", [(0.66, True), (0.76, True), (1.2, False)])
def test_a_drive_line_is_a_cause_only_clearly_beyond_its_tolerance(lag_s: float, is_usual: bool) -> None:
    model = build_programme_model(PROGRAMME, {})
    assert is_calibration(model, ModelTerm(get_parameters("speed_lag"), np.array([lag_s]))) is is_usual


def test_the_note_on_intervals_says_what_they_hold() -> None:
    model = build_programme_model("circles", {"steering_gain": {"ratio": 1.08}})
    part = get_parameters("steering_gain"), np.array([1.04])
    fit = refine_fit(model, add_part(model, refit_with_new_weights(model, (), None), part))
    assert describe_intervals(model, fit, ["steering_gain", "wheel_slip"]).startswith(CONTENTS)
    assert describe_intervals(model, fit, ["wheel_slip"]) == ""
