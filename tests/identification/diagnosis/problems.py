"""Problems for tests: noise-free drives of the simulator itself, with known noise."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tests.identification.analytic_drives import rig
from vehicle.identification.diagnosis.drive_data import build_drive_data
from vehicle.identification.diagnosis.grammar import Hypothesis, build_constant, list_nuisances
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.next_drive import DRIVE_PROGRAMMES, simulate_programme
from vehicle.identification.diagnosis.noise import POSE_PARTS
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.model.effects import get_effect

PACE_MPS = 1.4
Effects = Mapping[str, Mapping[str, float]]
Alter = Callable[[DriveSegment], DriveSegment]


def build_drives(alter: Alter = lambda segment: segment) -> DriveDataset:
    """Bends at many angles, at three speeds, and lines to all four points of the compass: one run each."""
    segments: list[DriveSegment] = []
    for name, heading in (
        ("shuffled-bends", 0.3),
        ("bends-at-speeds", 2.0),
        ("shuffled-bends", 4.0),
        ("four-ways", 0.0),
    ):
        made = next(one for one in DRIVE_PROGRAMMES if one.id == name)
        for segment in simulate_programme(rig(), made, heading, PACE_MPS, {}).segments:
            segments.append(alter(replace(segment, run=len(segments))))
    names = tuple(f"run {run}" for run in range(len(segments)))
    return DriveDataset(names, tuple(segments), (0.0, 0.0), sum(segment.rows for segment in segments))


def build_problem(alter: Alter = lambda segment: segment, seed: int | None = None) -> Problem:
    """The problem of these drives; `seed` draws white noise of a receiver of the usual quality."""
    rng = np.random.default_rng(seed)

    def measure(segment: DriveSegment) -> DriveSegment:
        altered = alter(segment)
        if seed is None:
            return altered
        east, north, heading = (
            values + size * rng.standard_normal(segment.rows)
            for values, size in ((altered.east, 8e-3), (altered.north, 8e-3), (altered.heading, math.radians(0.2)))
        )
        return replace(altered, east=east, north=north, heading=heading)

    return Problem(build_drive_data(build_drives(measure)), rig())


def build_empty_fit(problem: Problem) -> Fit:
    """The fit without causes, its nuisances at their neutral values."""
    model = tuple(list_nuisances(problem.data))
    amounts = np.zeros(len(model))
    residuals = problem.compute_residuals(model, amounts)
    return Fit(model, amounts, 0.0, residuals, np.eye(len(model)))


def leave_parts(problem: Problem, parts: tuple[int, ...]) -> None:
    """Make all noise negligible but some parts of that of the pose, which get their usual size."""
    pose = np.full(len(POSE_PARTS), -30.0)
    pose[list(parts)] = 2.0 * np.log([POSE_PARTS[part].usual for part in parts])
    problem.set_noise({"pose": pose, "wheel": np.full(5, -40.0), "speed": np.full(5, -40.0)})


def build_drive_problem(programme: str, effects: Effects, has_heading: bool = True, has_wheel: bool = True) -> Problem:
    """What a tractor with these effects would log on a programme."""
    made = next(one for one in DRIVE_PROGRAMMES if one.id == programme)
    dataset = simulate_programme(rig(), made, 0.3, PACE_MPS, effects)
    segments = tuple(
        replace(one, heading_measured=has_heading, wheel=one.wheel if has_wheel else None) for one in dataset.segments
    )
    return Problem(build_drive_data(replace(dataset, segments=segments)), rig())


def build_hypothesis(problem: Problem, name: str) -> Hypothesis:
    return build_constant(get_effect(name), problem.data, problem.rig.tractor)


def build_fit(model: Sequence[Any], amounts: Sequence[float], curvature: np.ndarray) -> Fit:
    """A fit written by hand."""
    return Fit(tuple(model), np.array(amounts), 0.0, {}, curvature)


def fit_with(problem: Problem, *hypotheses: Hypothesis) -> Fit:
    """The fit of some hypotheses beside the nuisances, at the noise as it is."""
    model = (*list_nuisances(problem.data), *hypotheses)
    return problem.refit(model, np.zeros(sum(one.size for one in model)))
