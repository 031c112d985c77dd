"""Gains, statuses and sizes of an answer, by hand."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.residual_models import build_programme_model, eg105, get_parameters
from vehicle.identification.cause_selection.challenge import challenge_causes
from vehicle.identification.cause_selection.refit import compute_unnamed_gain
from vehicle.identification.diagnosis.results import (
    EQUIVALENT,
    LIKELY,
    LIKELY_OF,
    LIKELY_RIGHT,
    NAMED,
    NOT_VISIBLE,
    REFUTED,
)
from vehicle.identification.fit.open_loop import ModelTerm
from vehicle.identification.fit.residual_fit import EffectFit, LinearTerms, refine_fit
from vehicle.identification.model_extension.tractor_extension import ModelExtension, build_fit_extension
from vehicle.identification.replay.horizon_errors import sum_squared_errors_by_run
from vehicle.identification.residuals.noise_floor import compute_noise_floor
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import (
    ABOVE_NOISE_FLOOR_FACTOR,
    ABOVE_NOISE_FLOOR_PER_ROW_S,
    FEW_PIECES_SIGMAS,
    HARM_PCT,
    WORTH_A_NAME_PCT,
)
from vehicle.identification.verdict import named_causes
from vehicle.identification.verdict.findings import (
    build_findings,
    extend_to_neutral,
    find_smallest_visible,
    format_size,
)
from vehicle.identification.verdict.held_out_case import (
    DiagnosisCase,
    compute_noise_error_share,
    estimate_error_reduction,
    is_within_noise,
    restore_real_noise,
)
from vehicle.identification.verdict.named_causes import (
    ExplainedCase,
    UnexplainedError,
    is_holding,
    measure_unexplained,
)
from vehicle.model.effects import get_effect


def test_a_gain_is_what_is_gone_of_the_root_mean_square() -> None:
    """Four times the square is twice the root: half is gone, in every run, so in every set of runs as well."""
    assert estimate_error_reduction(np.full(5, 4.0), np.full(5, 1.0)) == (50.0, (50.0, 50.0))
    whole, (low, high) = estimate_error_reduction(np.array([4.0, 4.0, 4.0]), np.array([1.0, 4.0, 1.0]))
    assert whole == pytest.approx(100.0 * (1.0 - math.sqrt(0.5)))
    # All three draws hit the run without a gain in 1 of 27 sets, two of them in 6 of 27.
    assert (low, high) == (pytest.approx(100.0 * (1.0 - math.sqrt(0.75))), 50.0)
    assert estimate_error_reduction(np.zeros(2), np.zeros(2))[0] == 100.0


@pytest.fixture(scope="module")
def case() -> DiagnosisCase:
    """Circles driven with an offset of 1 degree, which the fit has found."""
    residual_model = build_programme_model("circles", {"steering_offset": {"angle_deg": 1.0}})
    residuals = residual_model.compute_residuals({})
    fit = refine_fit(
        residual_model,
        EffectFit(((get_parameters("steering_offset"), np.zeros(1)),), residuals, np.zeros((len(residuals), 0))),
    )
    return DiagnosisCase(
        residual_model,
        fit,
        build_fit_extension(residual_model, fit, ["steering_offset"]),
        compute_noise_floor(residual_model, {0: {}, 1: {}}),
    )


def test_the_hidden_effect_is_worth_its_name(case: DiagnosisCase) -> None:
    gain, (low, high) = case.compute_held_out_gain("steering_offset")
    assert 50.0 < low <= gain <= high <= 100.0 and case.compute_gain_where_visible("steering_offset") == gain
    assert is_holding(case, "steering_offset") and is_within_noise(case, case.final_errors)
    assert case.remaining_misfit == 1.0 and case.main_terms["steering_offset"].value["angle_deg"] == pytest.approx(
        1.0, abs=0.02
    )
    quarter = [{horizon: 0.25 * sums for horizon, sums in one.items()} for one in
               sum_squared_errors_by_run(
                   case.residual_model.dataset, case.residual_model.rig, {0: {}, 1: {}})]  # fmt: skip
    assert compute_noise_error_share(replace(case, noise_floor=quarter)) == pytest.approx(0.25)
    assert (
        restore_real_noise(case.residual_model, case.fit).noise.position < case.residual_model.noise.position
    )  # these logs have none


def test_every_effect_gets_a_finding(case: DiagnosisCase) -> None:
    told = {one.id: one for one in build_findings(case, ["steering_offset"], {}, lambda: None)}
    assert [name for name, one in told.items() if one.status == NAMED] == ["steering_offset"]
    assert told["steering_offset"].description.startswith("The wheels stand 1.0 degrees to the right")
    assert told["steering_offset"].gain_pct == pytest.approx(case.compute_held_out_gain("steering_offset")[0])
    # Both circles are driven with the implement up and the same speed: neither could have shown.
    assert told["implement_side_draft"].status == NOT_VISIBLE and told["implement_side_draft"].smallest_visible is None
    assert told["steering_gain"].status == REFUTED and told["steering_gain"].value is None
    smallest = told["steering_gain"].smallest_visible
    assert smallest is not None and get_effect("steering_gain").size.finest <= smallest <= 0.08


def test_competitors_of_a_name_are_a_set_with_its_exchange(case: DiagnosisCase) -> None:
    competitors = {"steering_offset": {"implement_side_draft": {"curvature_per_m": 0.0042}}}
    told = {one.id: one for one in build_findings(case, ["steering_offset"], competitors, lambda: None)}
    one, other = told["steering_offset"], told["implement_side_draft"]
    assert one.status == other.status == EQUIVALENT
    assert one.equivalent_to == ("implement_side_draft",) and other.equivalent_to == ("steering_offset",)
    value = one.value and one.value["angle_deg"]
    assert one.exchange == f"{value:.3g} deg looks like 0.0042 1/m of implement_side_draft"
    assert other.exchange == f"looks like {value:.3g} deg of steering_offset" and other.interval is None
    assert one.interval is not None and one.interval["angle_deg"][0] == 0.0  # the other may stand for all of it


def test_a_working_implement_all_the_time_leaves_offset_and_draft_alike() -> None:
    residual_model = build_programme_model("there-and-back", {"steering_offset": {"angle_deg": 1.0}})
    residuals = residual_model.compute_residuals({})
    fit = refine_fit(
        residual_model,
        EffectFit(((get_parameters("steering_offset"), np.zeros(1)),), residuals, np.zeros((len(residuals), 0))),
    )
    assert "implement_side_draft" in challenge_causes(residual_model, fit, (), eg105()).lookalikes["steering_offset"]


def test_the_smallest_visible_size_shrinks_with_the_root_of_the_loss_it_makes(case: DiagnosisCase) -> None:
    """Half the weights: twice the size, unless the tolerance is above both."""
    shown = find_smallest_visible(case, get_effect("steering_asymmetry"))
    rough = replace(case, extension=case.extension)
    rough.__dict__["remaining_misfit"] = 4.0
    assert shown is not None and find_smallest_visible(rough, get_effect("steering_asymmetry")) == pytest.approx(
        max(2.0 * shown, 0.02), rel=0.05
    )


def test_sizes_and_intervals_to_neutral() -> None:
    assert format_size(get_effect("steering_offset"), {"angle_deg": 1.234}) == "1.23 deg"
    assert format_size(get_effect("steering_gain"), {"ratio": 1.1}) == "1.1"
    assert extend_to_neutral(eg105(), get_effect("steering_gain"), (1.1, 1.3)) == (1.0, 1.3)
    assert extend_to_neutral(eg105(), get_effect("wheel_slip"), (-0.2, 0.1)) == (-0.2, 0.1)


def stub(
    final: float, before: float, floor: float = 1.0, row_s: float = 0.0, seconds: float = 900.0, **others: float
) -> Any:
    """A case whose errors over 5 s are `final`, and over others, as `of_20`, what they are given."""
    errors = {5.0: final, **{float(name[3:]): value for name, value in others.items()}}
    return SimpleNamespace(
        residual_model=SimpleNamespace(
            row_interval_s=row_s,
            get_interval_s=lambda _: row_s,
            has_measured_wheel_angle=True,
            dataset=SimpleNamespace(seconds=seconds, segments=()),
        ),
        noise_floor="floor",
        compute_run_errors=lambda squares, over=5.0: np.array([floor if squares == "floor" else squares[0][over][0]]),
        simulate_squares=lambda settings: [
            {over: np.array([error if settings == "no rest" else 0.0, 0.0, 0.0, 9.0]) for over, error in errors.items()}
        ],
        extension=SimpleNamespace(
            term_ids=frozenset({"push_to_east"}),
            select_held_out_settings=lambda names: "with rest" if names else "no rest",
        ),
    )  # fmt: skip


def test_noise_is_a_share_above_the_floor_and_more_where_rows_are_few() -> None:
    assert is_within_noise(stub(0, 0), np.array([ABOVE_NOISE_FLOOR_FACTOR - 0.01]))
    assert not is_within_noise(stub(0, 0), np.array([ABOVE_NOISE_FLOOR_FACTOR + 0.01]))
    assert is_within_noise(
        stub(0, 0, row_s=0.5), np.array([ABOVE_NOISE_FLOOR_FACTOR + 0.5 * ABOVE_NOISE_FLOOR_PER_ROW_S - 0.01])
    )


def test_the_error_of_a_few_pieces_may_be_chance() -> None:
    """Two pieces of three errors: a ratio of two means of six squares scatters by the root of 4 / 6."""
    few = 1.0 + FEW_PIECES_SIGMAS * math.sqrt(4.0 / 6.0)
    assert is_within_noise(stub(0, 0, seconds=10.0), np.array([few - 0.01]), by_chance=True)
    assert not is_within_noise(stub(0, 0, seconds=10.0), np.array([few - 0.01]))
    assert not is_within_noise(stub(0, 0, seconds=10.0), np.array([few + 0.01]), by_chance=True)
    assert not is_within_noise(stub(0, 0, seconds=300.0), np.array([ABOVE_NOISE_FLOOR_FACTOR + 0.01]), by_chance=True)


@pytest.mark.parametrize("final, before, share", [(1.2, 9.0, 0.0), (5.0, 9.0, 0.5), (9.0, 9.0, 1.0), (9.0, 2.0, 1.0)])
def test_the_unexplained_share_is_what_no_name_takes_away_above_the_floor(
    final: float, before: float, share: float
) -> None:
    told = ExplainedCase(stub(final, before), [], None)
    found = measure_unexplained(told, np.array([before]))
    assert found.share == pytest.approx(share) and found.above_s == ((5.0,) if share > 0.0 else ())


def test_every_horizon_is_held_against_its_own_floor() -> None:
    """One at the floor makes no other good that stands at twice of it; longer pieces are fewer, and chance more."""
    told = ExplainedCase(stub(1.0, 9.0, of_1=1.0, of_20=2.0), [], None)
    assert measure_unexplained(told, np.array([9.0])) == UnexplainedError(0.0, (20.0,))
    few = ExplainedCase(
        stub(1.0, 9.0, seconds=100.0, of_20=1.0 + FEW_PIECES_SIGMAS * math.sqrt(4.0 / 15.0) - 0.01), [], None
    )
    assert measure_unexplained(few, np.array([9.0])).above_s == ()


@pytest.mark.parametrize(
    "worth, gain, interval, held",
    [
        (WORTH_A_NAME_PCT, 1.0, (0.5, 1.5), True),
        (WORTH_A_NAME_PCT - 0.01, 1.0, (0.5, 1.5), False),
        (1.0, -HARM_PCT, (0.5, 1.5), False),
        (1.0, 1.0, (-0.1, 1.5), False),
        (1.0, 1.0, (0.0, 1.5), False),
    ],
)
@pytest.mark.parametrize("at, possible", [(0.3, True), (8.0, False)])
def test_a_name_holds_when_it_is_worth_it_does_no_harm_and_is_neither_neutral_nor_at_a_limit(
    worth: float, gain: float, interval: tuple[float, float], held: bool, at: float, possible: bool
) -> None:
    case: Any = SimpleNamespace(
        residual_model=SimpleNamespace(has_measured_wheel_angle=True), tractor=eg105(),
        compute_gain_where_visible=lambda name: worth,
        compute_held_out_gain=lambda name: (gain, (gain, gain)),
        extension=ModelExtension((), {"steering_offset": {"angle_deg": interval}}, {}),
        main_terms={"steering_offset": ModelTerm(get_parameters("steering_offset"), np.array([at]))},
    )  # fmt: skip
    assert is_holding(case, "steering_offset") is (held and possible)
    assert named_causes._get_least_error_reduction(case.residual_model, "steering_offset") == WORTH_A_NAME_PCT


def test_a_likely_effect_is_in_the_model_and_says_so(case: DiagnosisCase) -> None:
    told = {one.id: one for one in build_findings(case, [], {}, lambda: None)}
    assert told["steering_offset"].status == LIKELY and told["steering_offset"].value is not None
    refused = replace(case, refused_effects=frozenset({"steering_gain"}))
    told = {one.id: one for one in build_findings(refused, [], {}, lambda: None)}
    assert told["steering_gain"].status == NOT_VISIBLE, "what the residuals spoke for is not refuted"


def test_names_that_do_not_hold_leave_and_the_others_are_asked_again() -> None:
    """Without `b`, `a` does not hold either."""
    asked: list[list[str]] = []

    def case_with(kept: list[str]) -> Any:
        asked.append(kept)
        return kept

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(named_causes, "is_holding", lambda case, name: name == "c" or (name == "a" and "b" in case))
        assert named_causes._find_holding_names(case_with, ["a", "b", "c"]) == (["c"], ["c"])
    assert asked == [["a", "b", "c"], ["a", "c"], ["c"]]


def test_the_gain_of_unnamed_terms_is_what_the_columns_of_the_effects_leave_of_them() -> None:
    one, other = np.array([1.0, 0.0, 0.0]), np.array([3.0, 4.0, 0.0])
    fit = EffectFit((), np.zeros(3), np.stack([one, other], axis=1), LinearTerms(other[:, None], np.array([2.0])))
    assert (
        compute_unnamed_gain(fit) == pytest.approx(64.0)
        and compute_unnamed_gain(replace(fit, linear_terms=None)) == 0.0
    )


def test_terms_of_a_case_are_those_of_the_longer_driving(case: DiagnosisCase) -> None:
    levels = (ModelTerm(get_parameters("side_slip"), np.array([4.0]), frozenset({0})),
              ModelTerm(get_parameters("side_slip"), np.array([8.0]), frozenset({1})))  # fmt: skip
    residual_model: ResidualModel = case.residual_model
    two = DiagnosisCase(residual_model, case.fit, ModelExtension(levels, {}, {}), case.noise_floor)
    assert set(two.main_terms) == {"side_slip"} and two.main_terms["side_slip"] in levels


def test_no_more_were_right_than_were_called_likely() -> None:
    assert 0 <= LIKELY_RIGHT <= LIKELY_OF
