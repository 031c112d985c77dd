"""What an error depends on when it has no name."""

from dataclasses import replace

import numpy as np
import pytest

from tests.identification.analytic_drives import backwards, circle, course
from tests.identification.residual_models import build_programme_model, rig
from vehicle.identification.cause_selection.covariates import (
    ALWAYS,
    DISTANCE_CHANGE,
    ErrorCovariate,
    PathResponse,
    compute_covariate_columns,
    compute_curvature_per_angle,
    compute_explained_loss,
    list_covariates,
    score_covariates,
)
from vehicle.identification.fit.residual_fit import make_empty_fit
from vehicle.identification.residuals.innovations import PoseIncrements
from vehicle.identification.residuals.residual_model import ResidualModel, build_residual_model


@pytest.fixture(scope="module")
def pushed() -> ResidualModel:
    """A tractor pushed to the east by 1 cm/s while it drives to all four points of the compass."""
    return build_programme_model("four-ways", {"discrepancy_model": {"push_to_east": 0.01}})


def test_columns_explain_what_their_products_say() -> None:
    """One column: side squared over square. Two orthogonal ones add up, two that are the same count once."""
    assert compute_explained_loss(np.array([[4.0]]), np.array([6.0])) == pytest.approx(9.0)
    assert compute_explained_loss(np.diag([4.0, 100.0]), np.array([6.0, 10.0])) == pytest.approx(10.0)
    assert compute_explained_loss(np.full((2, 2), 4.0), np.array([6.0, 6.0])) == pytest.approx(9.0)
    assert compute_explained_loss(np.zeros((1, 1)), np.zeros(1)) == 0.0


def test_a_push_is_told_by_the_direction_of_travel(pushed: ResidualModel) -> None:
    fit = make_empty_fit(pushed)
    best = score_covariates(pushed, fit)[0]
    assert (
        best.covariate.description
        == "a push over the ground that depends on the direction of travel and the driving time"
    )
    path = fit.residuals[: 3 * pushed.dataset.rows]
    assert best.freedoms == 2 and 0.8 * float(path @ path) < best.gain <= 1.001 * float(path @ path)
    made = compute_covariate_columns(pushed, fit, best.covariate)
    amounts = np.linalg.lstsq(made, -fit.residuals, rcond=None)[0]
    assert amounts == pytest.approx([0.01, 0.0], abs=0.002)


def test_responses_are_linear_in_their_terms(pushed: ResidualModel) -> None:
    fit = make_empty_fit(pushed)
    response = PathResponse(pushed, fit)
    segment, move = pushed.dataset.segments[0], response.increments[0]
    bend = next(one for one in list_covariates(pushed) if one.regressor == "the direction of travel")
    east, north = bend.make_increments(segment, move, compute_curvature_per_angle(pushed, segment))
    both = PoseIncrements(east.ahead, east.aside, east.turned + 2.0 * north.turned)
    one, two, sum_of = response.compute_columns(0, [east, north, both]).T
    assert np.abs(one).max() > 1.0 and sum_of == pytest.approx(one + 2.0 * two, abs=1e-8)


def test_waves_are_looked_for_between_eight_rows_and_the_length_of_a_run(pushed: ResidualModel) -> None:
    told = [one for one in list_covariates(pushed) if one.per_run]
    periods = [float(one.regressor.split()[-2]) for one in told if "repeating" in one.regressor]
    assert min(periods) >= 2.5 and max(periods) <= 7.5  # half of a run of 15 s
    assert any(one.regressor == "time, changing slowly during a run" for one in told)
    made = compute_covariate_columns(pushed, make_empty_fit(pushed), told[0])
    assert made.shape[1] in (4, 8)  # free in every run; waves of grip are nothing where nothing turns


def test_the_curvature_of_an_angle_is_the_slope_of_the_measured_law(pushed: ResidualModel) -> None:
    """About straight ahead: the difference of two degrees of the table, over the wheelbase."""
    grid = np.linspace(-rig().tractor.max_steering_deg, rig().tractor.max_steering_deg, len(rig().table))
    left, right = (float(np.tan(np.interp(angle, grid, rig().table))) for angle in (-1.0, 1.0))
    slope = (right - left) / np.radians(2.0) / rig().tractor.wheelbase_m
    segment = pushed.dataset.segments[0]
    assert segment.wheel is not None and not segment.wheel.any()
    assert compute_curvature_per_angle(pushed, segment) == pytest.approx(slope)


def test_words_and_blocks_of_a_term() -> None:
    grip = ErrorCovariate("speed", "a change of grip", lambda s, m, b: [])
    assert grip.description == "a change of grip that depends on speed" and grip.block == "wheel to path"
    assert ErrorCovariate(ALWAYS, DISTANCE_CHANGE, lambda s, m, b: []).description == "a change of the distance driven"
    assert ErrorCovariate(ALWAYS, DISTANCE_CHANGE, lambda s, m, b: []).block == "speed"


def test_products_of_many_segments_are_explained_at_once() -> None:
    squares, sides = np.array([np.diag([4.0, 100.0]), np.full((2, 2), 4.0)]), np.array([[6.0, 10.0], [6.0, 6.0]])
    assert compute_explained_loss(squares, sides) == pytest.approx([10.0, 9.0])


@pytest.mark.parametrize(
    ("amounts", "size", "words"),
    [({"angle_by_speed": 0.2}, np.radians(0.2), "an extra wheel angle that depends on speed"),
     ({"grip_by_speed": 0.02}, 0.02, "a change of grip that depends on speed"),
     ({"push_to_east": 0.01}, 0.01, "a push over the ground that depends on the direction of travel and the "
     "driving time")],
)  # fmt: skip
@pytest.mark.parametrize("gear", [1.0, -1.0])
def test_a_term_moves_the_tractor_as_the_rest_that_it_becomes(
    amounts: dict[str, float], size: float, words: str, gear: float
) -> None:
    """Two formulas of one thing, forward and in reverse."""
    frame = circle(0.05, 30.0).assign(steering_deg=8.0)
    residual_model = build_residual_model(course(frame if gear > 0.0 else backwards(frame)), rig(), {})
    (plain,), (moved,), (segment,) = (
        residual_model.simulate_increments({}),
        residual_model.simulate_increments({"discrepancy_model": amounts}),
        residual_model.dataset.segments,
    )
    terms = next(one for one in list_covariates(residual_model) if one.description == words)
    term = terms.make_increments(segment, plain, compute_curvature_per_angle(residual_model, segment))[0]
    for kind in ("ahead", "aside", "turned"):
        change, told = getattr(moved, kind) - getattr(plain, kind), size * getattr(term, kind)
        most = float(np.abs(told).max())
        if most > 0.0:
            assert change[20:] == pytest.approx(told[20:], abs=0.1 * most), kind


def test_turns_alone_answer_as_the_whole_filter_does() -> None:
    """Every column is the difference of two runs of the filter, wherever its turns begin."""
    residual_model = build_residual_model(course(circle(0.05, 30.0).assign(steering_deg=8.0)), rig(), {})
    response = PathResponse(residual_model, make_empty_fit(residual_model))
    rows = residual_model.dataset.segments[0].rows - 1
    turns = 0.01 * np.random.default_rng(4).standard_normal((3, rows))
    turns[1, : rows // 2] = 0.0
    turns[2] = 0.0
    zero = np.zeros(rows)
    whole = response._compute_increment_columns(0, [PoseIncrements(zero, zero, one) for one in turns])
    alone = response.compute_turn_responses(0, turns)
    assert np.abs(alone - whole).max() < 1e-9 < np.abs(alone[:, 1]).max() and not alone[:, 2].any()
    assert not alone[: 3 * (rows // 2), 1].any()


def test_columns_of_every_run_are_those_of_all_runs_cut_up(pushed: ResidualModel) -> None:
    """The slow way: the same columns for each run, 0 in all other rows, without those that are 0 all along."""
    fit = make_empty_fit(pushed)
    wave = next(one for one in list_covariates(pushed) if one.per_run)
    whole = compute_covariate_columns(
        pushed, fit, ErrorCovariate(wave.regressor, wave.changed_quantity, wave.make_increments)
    )
    each = np.concatenate(
        [whole * (pushed.residual_runs == run)[:, None] for run in np.unique(pushed.residual_runs)], axis=1
    )
    made = compute_covariate_columns(pushed, fit, wave)
    assert len(np.unique(pushed.residual_runs)) > 1 and made.shape[1] > whole.shape[1] > 0
    assert np.array_equal(made, each[:, np.abs(each).max(axis=0) > 1e-12])


def test_products_are_those_of_all_columns_whatever_is_passed_over(pushed: ResidualModel) -> None:
    """Terms with each other, with what is left and with a fit, some of whose columns are of one run alone."""
    slope = np.random.default_rng(2).standard_normal((len(pushed.residual_runs), 3))
    slope[pushed.residual_runs != 0, 1] = 0.0
    fit = replace(make_empty_fit(pushed), jacobian=slope)
    response, bend = PathResponse(pushed, fit), next(one for one in list_covariates(pushed) if one.per_run)
    for index, segment in enumerate(pushed.dataset.segments):
        terms = bend.make_increments(segment, response.increments[index], compute_curvature_per_angle(pushed, segment))
        made, place = response.compute_columns(index, terms), response.places[index]
        slow = made.T @ made, made.T @ fit.residuals[place], made.T @ slope[place]
        for told in (
            response.compute_joint_products(index, made),
            *response.compute_term_products(index, [terms, terms]),
        ):
            assert all(one == pytest.approx(other, rel=1e-9, abs=1e-6) for one, other in zip(told, slow, strict=True))
