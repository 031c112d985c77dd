"""The drive that would tell apart what the logs could not: each programme is simulated with both explanations.

The difference of what instruments would show is measured in the noise of the logs. An explanation may still give way:
its amounts, and those of all that is in every model, move as far as the logs leave them open. What remains, d standard
deviations, is a predictive difference of d * d / 2 nats with a standard error of d, so half of it is compared with the
threshold of naming. On drawn noise the z of naming is d / 2 within 16 % up to d = 4.5; on a drive of three or four
windows it grows more slowly beyond (1.6 to 3.1 at d = 7 to 9, 19 to 34 nats), so naming needs the logs beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vehicle.identification.diagnosis.drive_data import build_drive_data
from vehicle.identification.diagnosis.grammar import Hypothesis, split_amounts
from vehicle.identification.diagnosis.model_fit import CHANNELS, FIT_STEP, Fit, Problem
from vehicle.identification.diagnosis.results import NextDrive
from vehicle.identification.logs.schema import Array
from vehicle.identification.logs.thresholds import SURE_SIGMAS
from vehicle.identification.replay.drive_programmes import (
    DRIVE_PROGRAMMES,
    DriveProgramme,
    find_usual_heading_and_speed,
    simulate_programme,
)
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment

SIGMAS_PER_Z = 2.0  # standard deviations between two explanations per standard error of their predictive difference
NO_EFFECT = "no effect"  # the name of the alternative without any hypothesis
Alternative = tuple[Hypothesis, Array]
CompetingPair = tuple[Alternative, Alternative | None]
"""Two hypotheses that explain the logs equally well, with their amounts; None stands for neither."""


def choose_next_drive(problem: Problem, fit: Fit, competitors: Sequence[CompetingPair]) -> NextDrive | None:
    """The drive that decides between most pairs, and of several that which separates most per second.

    When none decides it is the one that separates most. None without a pair. `separates` is the pair that is hardest to
    separate of those decided; `score` its separation in standard deviations. A drive decides where the right
    alternative would win by SURE_SIGMAS standard errors, as naming asks for.
    """
    explained = [(name_pair(*pair), [_explain(problem, fit, pair, own) for own in pair], pair[1] is not None)
                 for pair in competitors]  # fmt: skip
    choices = []
    for programme in DRIVE_PROGRAMMES if explained else ():
        trial, drives = build_trial(problem, programme), []
        for names, (first, second), can_both_adapt in explained:
            score = compute_separation(trial, first, second, can_both_adapt)
            is_clear = score > SIGMAS_PER_Z * SURE_SIGMAS
            drives.append(NextDrive(programme.id, programme.description, programme.seconds, names, score, is_clear))
        decided = [drive for drive in drives if drive.decides]
        drive = min(decided, key=lambda one: one.score) if decided else max(drives, key=lambda one: one.score)
        choices.append((len(decided), drive.score / (drive.seconds if decided else 1.0), drive))
    return max(choices, key=lambda choice: choice[:2])[2] if choices else None


def name_pair(first: Alternative, second: Alternative | None) -> tuple[str, str]:
    """The effects of a pair, with their laws where both are of one effect."""
    if second is None:
        return first[0].id, NO_EFFECT
    one, other = first[0], second[0]
    return (one.id, other.id) if one.id != other.id else (f"{one.id}:{one.law}", f"{other.id}:{other.law}")


def _explain(problem: Problem, fit: Fit, pair: CompetingPair, own: Alternative | None) -> Fit:
    """One alternative of a pair in the place of what the fit has of both, with how precisely the logs determine it."""
    paired = [alternative[0] for alternative in pair if alternative is not None]
    parts = [part for part in split_amounts(fit.model, fit.amounts) if part[0] not in paired]
    parts += [] if own is None else [own]
    model, amounts = tuple(one for one, _ in parts), np.concatenate([amount for _, amount in parts])
    residuals = problem.compute_residuals(model, amounts)
    return replace(fit, model=model, amounts=amounts, residuals=residuals,
                   curvature=problem.linearise(model, amounts, residuals).curvature)  # fmt: skip


def compute_separation(trial: Problem, first: Fit, second: Fit, can_both_adapt: bool = True) -> float:
    """Standard deviations between what two explanations show on a drive, whichever of them is right: the smaller value.

    The wrong one may adapt. Where the second is the model without an effect, only that one counts as wrong: an effect
    whose amount is adapted to nothing is not there.
    """
    shown = [trial.compute_residuals(one.model, one.amounts) for one in (first, second)]
    difference = np.concatenate(
        [trial.noise[channel].whiten(shown[0][channel] - shown[1][channel]).ravel() for channel in CHANNELS]
    )
    losses, both = [], list(zip((first, second), shown, strict=True))
    for wrong, own in both if can_both_adapt else both[1:]:
        count = len(wrong.amounts)
        secants = trial.compute_secants(wrong.model, wrong.amounts, own, range(count), FIT_STEP)
        response = np.concatenate([secants[channel].reshape(-1, count) for channel in CHANNELS])
        crossed = response.T @ difference
        taken = crossed @ np.linalg.solve(wrong.curvature + response.T @ response, crossed)
        losses.append(float(difference @ difference - taken))
    return math.sqrt(max(min(losses), 0.0))


def build_trial(problem: Problem, programme: DriveProgramme) -> Problem:
    """A drive of the plain tractor where the logs begin, with their columns, their rate and their noise.

    What one run of the logs had is not in it.
    """
    logs = problem.data.dataset
    heading, pace = find_usual_heading_and_speed(logs.segments)
    driven = simulate_programme(problem.rig, programme, heading, pace, {}, problem.data.row_step_s)
    segments, start_s = [], 0.0
    for segment, (_, pieces) in zip(driven.segments, programme.passes, strict=True):
        segments.append(_adapt_segment(segment, logs, start_s))
        start_s += sum(piece[0] for piece in pieces)
    dataset = replace(driven, names=(programme.id,), segments=tuple(segments), origin=logs.origin)
    trial = Problem(build_drive_data(dataset), problem.rig)
    absent = np.zeros(trial.data.path_starts[-1])
    trial.bases.arrays |= {f"by_run:{run}": absent for run in range(problem.data.runs)}
    trial.set_noise(problem.get_noise())
    return trial


def _adapt_segment(segment: DriveSegment, logs: DriveDataset, start_s: float) -> DriveSegment:
    """A simulated pass as these logs would hold it: where they begin, on their slope, with their columns."""
    every, begin = logs.segments, logs.segments[0]
    east, north = float(begin.east[0]), float(begin.north[0])
    grids = segment.grids | {"east": segment.grids["east"] + east, "north": segment.grids["north"] + north}
    if logs.cross_slope.is_usable:
        cosine, sine = np.cos(grids["heading"]), np.sin(grids["heading"])
        grids["across"] = logs.cross_slope.east * sine - logs.cross_slope.north * cosine
    return replace(
        segment,
        run=0,
        start_s=start_s,
        east=segment.east + east,
        north=segment.north + north,
        heading_measured=any(one.heading_measured for one in every),
        speed_measured=any(one.speed_measured for one in every),
        wheel=segment.wheel if any(one.wheel is not None for one in every) else None,
        command=segment.command if any(one.command is not None for one in every) else None,
        target=segment.target if any(one.target is not None for one in every) else None,
        grids=grids,
    )
