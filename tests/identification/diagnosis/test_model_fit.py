"""Fits of drives that the project's own replay made: true amounts lie within the intervals."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.identification.analytic_drives import rig, simulated
from vehicle.identification.diagnosis.drive_data import build_drive_data
from vehicle.identification.diagnosis.grammar import (
    Coordinate,
    Hypothesis,
    build_constant,
    list_catalogue,
    list_nuisances,
)
from vehicle.identification.diagnosis.model_fit import Fit, Linearisation, Problem
from vehicle.identification.diagnosis.verdicts import compute_covariance
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.model.effect_kinds import INTERVAL_SIGMAS
from vehicle.model.effects import get_effect, get_neutral_values
from vehicle.model.tractor import Settings

PROGRAMMES = ("steps", "shuffled-bends", "there-and-back")
NOISE = {"east": 0.008, "north": 0.008, "heading": 0.002}
WIDTH = 2.0


def drive(settings: Settings, seed: int = 4) -> DriveDataset:
    """The programmes one after another, with noise of a receiver."""
    rng, segments = np.random.default_rng(seed), []
    for programme in PROGRAMMES:
        for one in simulated(programme, settings).segments:
            shaken = {name: getattr(one, name) + size * rng.standard_normal(one.rows) for name, size in NOISE.items()}
            segments.append(replace(one, run=len(segments), **shaken))
    names = tuple(f"run {number}" for number in range(len(segments)))
    return DriveDataset(names, tuple(segments), (0.0, 0.0), sum(one.rows for one in segments))


@lru_cache
def problem(name: str, value: float) -> Problem:
    effect = get_effect(name)
    return Problem(build_drive_data(drive({name: {effect.size.name: value}})), rig())


def fit_one(name: str, value: float) -> tuple[Problem, Hypothesis, Fit]:
    own = problem(name, value)
    hypothesis = build_constant(get_effect(name), own.data, own.rig.tractor)
    model = (*list_nuisances(own.data), hypothesis)
    return own, hypothesis, own.fit(model, np.zeros(len(model)))


@pytest.mark.parametrize(
    ("name", "value"),
    [("steering_offset", 1.0), ("steering_gain", 1.08), ("antenna_right", -0.15), ("gnss_latency", 0.2)],
)
def test_a_true_amount_lies_within_its_interval(name: str, value: float) -> None:
    own, hypothesis, fit = fit_one(name, value)
    true = value - float(get_neutral_values(name, own.rig.tractor.steering)[get_effect(name).size.name])
    sigma = float(np.sqrt(np.diag(compute_covariance(own, fit))[fit.locate(hypothesis)][0]))
    assert abs(float(fit.get_amounts(hypothesis)[0]) - true) < INTERVAL_SIGMAS * sigma < 0.5 * abs(true)


def test_the_true_cause_gains_most() -> None:
    """What is hidden stands above all others that act alone, on a fit that knows nothing of it."""
    own = problem("antenna_right", -0.15)
    nuisances = tuple(list_nuisances(own.data))
    base = own.fit(nuisances, np.zeros(len(nuisances)))
    gains = own.scan(base, list_catalogue(own.data, own.rig.tractor))
    assert gains[0].hypothesis.id == "antenna_right" and gains[0].nats > 20.0
    assert gains[0].amounts[0] == pytest.approx(-0.15, abs=0.05)


def test_a_fit_has_no_slope_left_and_more_evidence_than_none() -> None:
    own, hypothesis, fit = fit_one("steering_offset", 1.0)
    for amount in (-0.1, 0.1):
        moved = fit.amounts.copy()
        moved[fit.locate(hypothesis)] += amount
        assert own.compute_cost(fit.model, moved, own.compute_residuals(fit.model, moved)) > fit.cost
    nuisances = fit.model[:-1]
    assert own.refit(nuisances, fit.amounts[:-1]).evidence < fit.evidence - 20.0


# --- The linear problem beside a fit, against ordinary Bayesian regression worked out from the whole table ---


def draw_problem(seed: int = 1) -> tuple[Linearisation, np.ndarray, np.ndarray]:
    """Two channels of six windows and three amounts, with the weighted table and target (rows first by channel)."""
    rng = np.random.default_rng(seed)
    changes = {"pose": rng.normal(size=(6, 4, 3)), "wheel": rng.normal(size=(6, 2, 3))}
    residuals = {name: rng.normal(size=one.shape[:2]) for name, one in changes.items()}
    roots = {name: rng.uniform(0.5, 1.0, 6) for name in changes}
    table = np.concatenate([(changes[c] * roots[c][:, None, None]).reshape(-1, 3) for c in changes])
    target = np.concatenate([(residuals[c] * roots[c][:, None]).ravel() for c in changes])
    return Linearisation(changes, residuals, roots), table, target


def test_windows_left_out_leave_the_regression_of_the_others() -> None:
    linear, table, _ = draw_problem()
    # At the most likely amounts the slope of the whole is nothing: amounts stand where prior and residuals agree.
    amounts = np.linalg.solve(np.eye(3) + table.T @ table, table.T @ np.concatenate(
        [(linear.residuals[c] * linear.roots[c][:, None]).ravel() for c in linear.roots]))  # fmt: skip
    at_best = Linearisation(
        linear.changes, {c: linear.residuals[c] - linear.changes[c] @ amounts for c in linear.roots}, linear.roots
    )
    inside = np.array([True, False, False, True, False, False])
    step, curvature = at_best.step_without(inside)
    kept = [(linear.changes[c] * linear.roots[c][:, None, None])[~inside].reshape(-1, 3) for c in linear.roots]
    aims = [(linear.residuals[c] * linear.roots[c][:, None])[~inside].ravel() for c in linear.roots]
    others, aim = np.concatenate(kept), np.concatenate(aims)
    assert curvature == pytest.approx(np.eye(3) + others.T @ others)
    assert amounts + step == pytest.approx(np.linalg.solve(curvature, others.T @ aim))


def test_all_windows_together_are_the_whole() -> None:
    linear, table, target = draw_problem()
    parts = [linear.sum_windows(np.arange(6) == number) for number in range(6)]
    assert sum(one[0] for one in parts) == pytest.approx(table.T @ table)
    assert sum(one[1] for one in parts) == pytest.approx(table.T @ target)


def make_hypothesis(low: float, high: float, penalty: float = 0.0) -> Hypothesis:
    return Hypothesis("steering_gain", "constant", (Coordinate((("bend", 1.0),), WIDTH, low, high),), penalty)


def test_a_gain_is_the_ratio_of_marginal_likelihoods() -> None:
    """log N(target; 0, I + X X' + x x') - log N(target; 0, I + X X'), the amounts of both integrated out."""
    linear, table, target = draw_problem()
    column = np.random.default_rng(2).normal(size=(len(target), 1))
    gain = linear.predict_gain(make_hypothesis(-math.inf, math.inf, 1.5), column, 1.0)
    assert gain is not None

    def log_density(columns: np.ndarray) -> float:
        covariance = np.eye(len(target)) + columns @ columns.T
        return float(-0.5 * target @ np.linalg.solve(covariance, target) - 0.5 * np.linalg.slogdet(covariance)[1])

    with_it = np.concatenate([table, column], axis=1)
    assert gain.nats == pytest.approx(log_density(with_it) - log_density(table) - 1.5)
    best = np.linalg.solve(np.eye(4) + with_it.T @ with_it, with_it.T @ target)
    assert gain.amounts == pytest.approx(WIDTH * best[3:])


def test_a_gain_on_the_wrong_side_of_a_limit_is_none() -> None:
    linear, _, target = draw_problem()
    column = target[:, None].copy()
    assert linear.predict_gain(make_hypothesis(0.0, 9.0), column, 1.0) is not None
    assert linear.predict_gain(make_hypothesis(0.0, 9.0), -column, 1.0) is None


def test_a_nuisance_at_its_limit_hides_nothing_from_the_scan() -> None:
    own = problem("gnss_latency", 0.2)
    model = tuple(list_nuisances(own.data))
    base = own.refit(model, np.zeros(len(model)))
    (lateness,) = [one for one in model if one.id == "_lateness"]
    assert base.get_amounts(lateness)[0] == lateness.coordinates[0].high
    hypothesis = build_constant(get_effect("gnss_latency"), own.data, own.rig.tractor)
    (gain,) = own.scan(base, [hypothesis])
    added = own.compute_secants((*model, hypothesis), np.append(base.amounts, 0.0), base.residuals, [len(model)], 0.5)
    free = own.linearise(model, base.amounts, base.residuals)
    hidden = free.predict_gain(hypothesis, free.stack(added), 1.0)
    assert hidden is not None and gain.nats > 2.0 * hidden.nats
