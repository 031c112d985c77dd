"""Problems of the diagnosis on noise-free drives of the simulator itself, weighed by the usual noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from vehicle.identification.diagnosis.drive_data import build_drive_data
from vehicle.identification.diagnosis.grammar import Hypothesis, build_constant, list_nuisances
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.replay.drive_programmes import DRIVE_PROGRAMMES, simulate_programme
from vehicle.identification.replay.rig import ReplayRig, build_rig
from vehicle.model.effects import get_effect
from vehicle.model.tractor import load_tractor

PACE_MPS = 1.4
Effects = Mapping[str, Mapping[str, float]]


@lru_cache(maxsize=1)
def get_rig() -> ReplayRig:
    return build_rig(load_tractor("eg105"), "soil", (0.0, 0.0))


def build_problem(programme: str, effects: Effects, has_heading: bool = True, has_wheel: bool = True) -> Problem:
    """What a tractor with these effects would log on a programme."""
    made = next(one for one in DRIVE_PROGRAMMES if one.id == programme)
    dataset = simulate_programme(get_rig(), made, 0.3, PACE_MPS, effects)
    segments = tuple(
        replace(one, heading_measured=has_heading, wheel=one.wheel if has_wheel else None) for one in dataset.segments
    )
    return Problem(build_drive_data(replace(dataset, segments=segments)), get_rig())


def build_hypothesis(problem: Problem, name: str) -> Hypothesis:
    return build_constant(get_effect(name), problem.data, problem.rig.tractor)


def fit_with(problem: Problem, *hypotheses: Hypothesis) -> Fit:
    """The fit of some hypotheses beside the nuisances, at the noise as it is."""
    model = (*list_nuisances(problem.data), *hypotheses)
    return problem.refit(model, np.zeros(sum(one.size for one in model)))
