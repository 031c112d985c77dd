"""Fits of drives that the project's own replay made: true amounts lie within the intervals."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.identification.analytic_drives import rig, simulated
from vehicle.identification.diagnosis.drive_data import build_drive_data
from vehicle.identification.diagnosis.grammar import Hypothesis, build_constant, list_catalogue, list_nuisances
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.verdicts import compute_covariance
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.model.effect_kinds import INTERVAL_SIGMAS
from vehicle.model.effects import get_effect, get_neutral_values
from vehicle.model.tractor import Settings

PROGRAMMES = ("steps", "shuffled-bends", "there-and-back")
NOISE = {"east": 0.008, "north": 0.008, "heading": 0.002}


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
