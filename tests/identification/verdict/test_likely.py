"""What is likely: how large and how helpful it must be, beside what else, and told by whom."""

from collections.abc import Callable, Collection
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.residual_models import build_programme_model, eg105, get_parameters
from vehicle.identification.cause_selection.selection import CauseSelection
from vehicle.identification.fit.open_loop import ModelTerm, OpenLoopErrors, OpenLoopModel
from vehicle.identification.fit.residual_fit import EffectFit, refine_fit
from vehicle.identification.model_extension.term_search import OpenLoopFit
from vehicle.identification.model_extension.tractor_extension import ModelExtension
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import HARM_PCT
from vehicle.identification.verdict import named_causes
from vehicle.identification.verdict.named_causes import (
    find_sure_parts,
    is_likely,
    is_reaching_limit,
    is_supported_by_residuals,
)
from vehicle.model.effects import get_effect


@pytest.fixture(scope="module")
def circles() -> ResidualModel:
    """Circles to both sides driven with an offset of 1 degree."""
    return build_programme_model("circles", {"steering_offset": {"angle_deg": 1.0}})


@pytest.mark.parametrize(
    "name, at, interval, at_limit",
    [
        ("steering_rate", 70.0, (60.0, 80.0), False),
        ("steering_rate", 88.2, (76.7, 90.0), True),
        ("steering_rate", 2.0, (1.0, 4.0), False),
        ("steering_rate", 1.0, (1.0, 3.0), True),
        ("steering_lag", 0.04, (0.02, 0.08), False),
        ("steering_gain", 0.55, (0.5, 0.6), True),
        ("wheel_slip", 0.2, (0.1, 0.3), False),
        ("steering_dead_time", 1.1, (1.0, 1.2), True),
    ],
)
def test_a_limit_is_reached_by_the_interval_too(
    name: str, at: float, interval: tuple[float, float], at_limit: bool
) -> None:
    """A rate of 88 deg/s where 90 is the most that is tried says no more than that the steering is quick."""
    case: Any = SimpleNamespace(
        tractor=eg105(),
        extension=SimpleNamespace(intervals={name: {get_effect(name).size.name: interval}}),
        main_terms={name: ModelTerm(get_parameters(name), np.array([at]))},
    )
    assert is_reaching_limit(case, name) is at_limit


@pytest.mark.parametrize(
    "at, interval, gain, refused, likely",
    [
        (0.2, (0.05, 0.35), 0.1, (), True),
        (0.2, (0.05, 0.35), -0.1, (), False),
        (0.2, (-0.05, 0.45), 0.1, (), False),
        (0.17, (0.05, 0.29), 0.1, (), False),
        (0.2, (0.05, 0.35), 0.1, ("steering_offset",), False),
    ],
)
def test_what_is_likely_is_clearly_not_neutral_helps_runs_held_out_and_is_clearly_beyond_tolerance(
    at: float, interval: tuple[float, float], gain: float, refused: tuple[str, ...], likely: bool
) -> None:
    """The tolerance of an offset is 0.12 degrees, and half as much again has to be reached."""
    case: Any = SimpleNamespace(
        residual_model=SimpleNamespace(has_measured_wheel_angle=True, row_interval_s=0.1, get_interval_s=lambda _: 0.1),
        tractor=eg105(),
        compute_held_out_gain=lambda name: (gain, (gain, gain)),
        main_terms={"steering_offset": ModelTerm(get_parameters("steering_offset"), np.array([at]))},
        extension=ModelExtension((), {"steering_offset": {"angle_deg": interval}}, {}),
        refused_effects=frozenset(refused),
    )
    assert is_likely(case, "steering_offset") is likely


@pytest.mark.parametrize(
    "at, worth, gain, likely",
    [(0.12, 10.1, 0.0, True), (0.12, 9.9, 0.0, False), (0.12, 10.1, -HARM_PCT, False), (1.2, 99.0, 9.0, False)],
)
def test_what_is_likely_of_the_steering_shows_at_the_wheel_harms_no_path_and_is_at_no_limit(
    at: float, worth: float, gain: float, likely: bool
) -> None:
    case: Any = SimpleNamespace(
        residual_model=SimpleNamespace(has_measured_wheel_angle=True, row_interval_s=0.1, get_interval_s=lambda _: 0.1),
        tractor=eg105(),
        compute_gain_where_visible=lambda name: worth,
        compute_held_out_gain=lambda name: (gain, (gain, gain)),
        main_terms={"steering_dead_time": ModelTerm(get_parameters("steering_dead_time"), np.array([at]))},
        extension=ModelExtension((), {"steering_dead_time": {"time_s": (0.06, 0.2)}}, {}),
        refused_effects=frozenset(),
    )
    assert is_likely(case, "steering_dead_time") is likely


@pytest.mark.parametrize(
    "at, gain, likely",
    [(0.13, 0.1, True), (0.11, 0.1, False), (0.13, -0.9 * HARM_PCT, True), (0.13, -HARM_PCT, False)],
)
def test_what_the_residuals_show_surely_need_be_no_larger_than_a_name_and_may_cost_the_path_as_much(
    at: float, gain: float, likely: bool
) -> None:
    """The tolerance of an offset is 0.12 degrees."""
    case: Any = SimpleNamespace(
        residual_model=SimpleNamespace(has_measured_wheel_angle=True, row_interval_s=0.1, get_interval_s=lambda _: 0.1),
        tractor=eg105(),
        compute_held_out_gain=lambda name: (gain, (gain, gain)),
        main_terms={"steering_offset": ModelTerm(get_parameters("steering_offset"), np.array([at]))},
        extension=ModelExtension((), {"steering_offset": {"angle_deg": (0.05, 0.21)}}, {}),
        refused_effects=frozenset(),
    )
    assert is_likely(case, "steering_offset", {"steering_offset"}) is likely
    assert not is_likely(case, "steering_offset", {"steering_gain"})


@pytest.mark.parametrize("at_best, wheel, likely", [(0.1, 20.0, True), (-0.1, 20.0, False), (0.1, 9.0, False)])
def test_the_path_speaks_against_a_sure_cause_of_the_steering_where_runs_agree(
    at_best: float, wheel: float, likely: bool
) -> None:
    """The tolerance of a dead band is 0.25 degrees, a tenth of a degree is neutral."""
    case: Any = SimpleNamespace(
        residual_model=SimpleNamespace(has_measured_wheel_angle=True, row_interval_s=0.1, get_interval_s=lambda _: 0.1),
        tractor=eg105(),
        compute_gain_where_visible=lambda name: wheel,
        compute_held_out_gain=lambda name: (-5.0, (-12.0, at_best)),
        refused_effects=frozenset(),
        main_terms={"steering_deadband": ModelTerm(get_parameters("steering_deadband"), np.array([0.42]))},
        extension=ModelExtension((), {"steering_deadband": {"angle_deg": (0.17, 0.67)}}, {}),
    )
    assert is_likely(case, "steering_deadband", {"steering_deadband"}) is likely
    assert not is_likely(case, "steering_deadband")


def test_sure_is_what_may_carry_a_name_is_clear_and_is_no_calibration(circles: ResidualModel) -> None:
    """An offset is a fault; a dead time of 0.05 s, the beat of commands and rows, is in any steering."""
    parts = (
        (get_parameters("steering_offset"), np.array([1.0])),
        (get_parameters("steering_dead_time"), np.array([0.05])),
    )
    residuals = circles.compute_residuals({})
    selection = CauseSelection(circles, EffectFit(parts, residuals, np.zeros((len(residuals), 0))), (), 12.0)
    both = ("steering_offset", "steering_dead_time")
    assert find_sure_parts(selection, both, both) == {"steering_offset"}
    assert find_sure_parts(selection, both, both[1:]) == find_sure_parts(selection, both[1:], both) == frozenset()


@pytest.mark.parametrize("wheel, settled", [(True, ("named", "steering_lag")), (False, ("named",))])
def test_only_what_a_measured_wheel_cuts_off_is_settled_without_a_name(wheel: bool, settled: tuple[str, ...]) -> None:
    """Where the path is wrong everywhere, what is likely of it is left to what lowers the error."""
    begun: list[list[str]] = []
    case: Any = SimpleNamespace(final_errors=None, extension=SimpleNamespace(term_ids=frozenset()))
    selection: Any = SimpleNamespace(residual_model=SimpleNamespace(has_measured_wheel_angle=wheel), fit=None)

    def mended(_: Any, __: Any, kept: list[str], likely: list[str], *more: Any) -> Any:
        begun.append([*kept, *likely])
        raise InterruptedError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(named_causes, "list_clear_parts", lambda *_: [])
        patch.setattr(named_causes, "find_sure_parts", lambda *_: frozenset())
        patch.setattr(named_causes, "build_fit_extension", lambda *_: None)
        patch.setattr(named_causes, "build_case", lambda *_: case)
        patch.setattr(named_causes, "_find_holding_names", lambda _, kept: (kept, case))
        patch.setattr(named_causes, "_find_likely_together", lambda *_: (["steering_lag", "understeer"], case))
        patch.setattr(named_causes, "is_within_noise", lambda *_: False)
        patch.setattr(named_causes, "_extend_with_names", mended)
        with pytest.raises(InterruptedError):
            named_causes.explain_error(selection, ["named"], eg105(), lambda: None)
    assert begun == [list(settled)]


def asked_in(
    worth: dict[str, float], likely: Callable[[str, frozenset[str]], bool]
) -> tuple[list[frozenset[str]], list[str]]:
    """Cases asked one after the other, from all effects on, and what is likely in the end; `named` has a name."""
    asked: list[frozenset[str]] = []

    def case_with(kept: Collection[str]) -> Any:
        asked.append(frozenset(kept))
        return SimpleNamespace(
            extension=SimpleNamespace(term_ids=frozenset(kept)), compute_gain_where_visible=worth.__getitem__
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(named_causes, "is_likely", lambda case, name, surely: likely(name, case.extension.term_ids))
        first = case_with({"named", *worth})
        told, last = named_causes._find_likely_together(case_with, first, ["named"], frozenset())
    assert last.extension.term_ids == {"named", *told} == asked[-1]
    return asked, told


def test_what_was_likely_beside_what_fell_is_asked_again() -> None:
    """A quick lag made up for a dead time; without that nothing speaks for it."""
    asked, told = asked_in({"lag": 31.0, "dead": -52.0}, lambda name, beside: name == "lag" and "dead" in beside)
    assert told == [] and asked == [{"named", "lag", "dead"}, {"named", "lag"}, {"named"}]


def test_what_is_worth_least_falls_first_and_what_it_spoilt_is_likely_without_it() -> None:
    asked, told = asked_in({"band": 14.0, "dead": -39.0}, lambda name, beside: name == "band" and "dead" not in beside)
    assert told == ["band"] and asked == [{"named", "band", "dead"}, {"named", "band"}]


def selected(residual_model: ResidualModel, *effects: str) -> CauseSelection:
    """A fit of these effects."""
    residuals = residual_model.compute_residuals({})
    parts = tuple((get_parameters(name), np.zeros(get_parameters(name).count)) for name in effects)
    fit = (
        refine_fit(residual_model, EffectFit(parts, residuals, np.zeros((len(residuals), 0))))
        if parts
        else EffectFit((), residuals, np.zeros((len(residuals), 0)))
    )
    return CauseSelection(residual_model, fit, (), 12.0)


@pytest.mark.parametrize(
    "fitted, name, at, told",
    [
        ((), "steering_offset", 1.0, True),
        ((), "steering_offset", -1.0, False),
        (("steering_offset",), "steering_offset", 0.8, True),
        (("steering_offset",), "steering_offset", -0.8, False),
        ((), "implement_side_draft", 0.006, False),
        ((), "antenna_right", 0.1, False),
    ],
)
def test_residuals_tell_what_is_there_to_its_side(
    circles: ResidualModel, fitted: tuple[str, ...], name: str, at: float, told: bool
) -> None:
    assert (
        is_supported_by_residuals(selected(circles, *fitted), ModelTerm(get_parameters(name), np.array([at]))) is told
    )


def test_what_stands_in_the_place_of_what_the_residuals_tell_is_not_told_by_them(circles: ResidualModel) -> None:
    """More curvature to the left looks like an offset to the left as long as nothing else explains it."""
    term = ModelTerm(get_parameters("steering_asymmetry"), np.array([0.9]))
    assert is_supported_by_residuals(selected(circles), term)
    assert not is_supported_by_residuals(selected(circles, "steering_offset"), term)


@pytest.mark.parametrize("gain, told, stays", [(5.0, True, True), (5.0, False, False), (-0.1, True, False)])
def test_what_mends_without_being_told_by_the_residuals_leaves_the_model(gain: float, told: bool, stays: bool) -> None:
    term = ModelTerm(get_parameters("steering_gain"), np.array([0.7]))
    loop: Any = OpenLoopErrors(build_programme_model("circles", {}), {}, ())
    case: Any = SimpleNamespace(
        main_terms={"steering_gain": term},
        extension=SimpleNamespace(term_ids=frozenset({"steering_gain"})),
        compute_held_out_gain=lambda name: (gain, (gain, gain)),
    )
    empty: Any = SimpleNamespace(main_terms={})
    mended = OpenLoopFit(loop, OpenLoopModel((term,), np.zeros(0), np.zeros((0, 1))))
    selection: Any = SimpleNamespace(effect_ids=frozenset())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(named_causes, "is_likely", lambda *_: True)
        patch.setattr(named_causes, "is_supported_by_residuals", lambda *_: told)
        patch.setattr(
            named_causes, "fit_terms", lambda loop, kept: OpenLoopModel(kept, np.zeros(0), np.zeros((0, len(kept))))
        )
        patch.setattr(named_causes, "_build_extended_case", lambda *_: empty)
        left = named_causes._drop_doubtful(selection, named_causes.ExplainedCase(case, [], mended))
    assert left.open_loop_fit is not None and left.open_loop_fit.model.term_ids == (
        {"steering_gain"} if stays else set()
    )
