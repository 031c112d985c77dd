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
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fields.arrays import Floats
from vehicle.identification.diagnosis.drive_data import build_drive_data
from vehicle.identification.diagnosis.grammar import Hypothesis, split_amounts
from vehicle.identification.diagnosis.model_fit import CHANNELS, FIT_STEP, Fit, Problem
from vehicle.identification.diagnosis.results import NextDrive
from vehicle.identification.logs.thresholds import GRID_S, SURE_SIGMAS
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment, ReplayRig
from vehicle.identification.replay.simulation import replay_segment, simulate_logged_values
from vehicle.model.tractor import Settings
from vehicle.records import DT_S

SIGMAS_PER_Z = 2.0  # standard deviations between two explanations per standard error of their predictive difference
NO_EFFECT = "no effect"  # the name of the alternative without any hypothesis
Alternative = tuple[Hypothesis, Floats]
CompetingPair = tuple[Alternative, Alternative | None]
"""Two hypotheses that explain the logs equally well, with their amounts; None stands for neither."""

PROGRAMME_PACE_MPS = 1.4  # 5 km/h, the speed of the thesis's experiments
ProgrammePiece = tuple[float, float, float, float]
ProgrammePieces = tuple[ProgrammePiece, ...]


def choose_next_drive(problem: Problem, fit: Fit, competitors: Sequence[CompetingPair]) -> NextDrive | None:
    """The drive that decides between most pairs, and of several that which separates most per second.

    When none decides it is the one that separates most. None without a pair. `separates` is the pair that is hardest to
    separate of those decided; `score` its separation in standard deviations. A drive decides where the right
    alternative would win by SURE_SIGMAS standard errors, as naming asks for.
    """
    explained = []
    for pair in competitors:
        one, other = pair[0][0], None if pair[1] is None else pair[1][0]
        names = one.id, NO_EFFECT if other is None else other.id
        if other is not None and one.id == other.id:  # two laws of one effect
            names = f"{one.id}:{one.law}", f"{other.id}:{other.law}"
        explained.append((names, [_explain(problem, fit, pair, own) for own in pair], other is not None))
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
    segments, start_s, every = [], 0.0, logs.segments
    east, north = float(every[0].east[0]), float(every[0].north[0])
    # Simulated passes as these logs would hold them: where they begin, on their slope, with their columns.
    absent = {name for name in ("wheel", "command", "target") if all(getattr(one, name) is None for one in every)}
    for segment, (_, pieces) in zip(driven.segments, programme.passes, strict=True):
        grids = segment.grids | {"east": segment.grids["east"] + east, "north": segment.grids["north"] + north}
        if logs.cross_slope.across:
            cosine, sine = np.cos(grids["heading"]), np.sin(grids["heading"])
            grids["across"] = logs.cross_slope.east * sine - logs.cross_slope.north * cosine
        changed: dict[str, Any] = dict.fromkeys(absent)
        changed |= {"run": 0, "start_s": start_s, "east": segment.east + east, "north": segment.north + north}
        changed["heading_measured"] = any(one.heading_measured for one in every)
        changed["speed_measured"] = any(one.speed_measured for one in every)
        segments.append(replace(segment, grids=grids, **changed))
        start_s += sum(piece[0] for piece in pieces)
    dataset = replace(driven, names=(programme.id,), segments=tuple(segments), origin=logs.origin)
    trial = Problem(build_drive_data(dataset), problem.rig)
    nowhere = np.zeros(trial.data.path_starts[-1])
    trial.bases.arrays |= {f"by_run:{run}": nowhere for run in range(problem.data.runs)}
    trial.set_noise(problem.get_noise())
    return trial


@dataclass(frozen=True)
class DriveProgramme:
    """A drive for a person: passes of a first heading (deg to the right of the usual one) and pieces (seconds, wheel
    angle in deg, share of the usual speed, implement 0 or 1)."""

    id: str
    description: str
    passes: tuple[tuple[float, ProgrammePieces], ...]

    @property
    def seconds(self) -> float:
        """Duration of the drive."""
        return sum(piece[0] for _, pieces in self.passes for piece in pieces)


DRIVE_PROGRAMMES = (
    DriveProgramme(
        "implement-lifted",
        "Drive straight ahead for 30 s, implement up for the first 15 s, then down.",
        ((0.0, ((15.0, 0.0, 1.0, 0.0), (15.0, 0.0, 1.0, 1.0))),),
    ),
    DriveProgramme(
        "there-and-back",
        "Drive the same straight line there and back, 20 s each way, with the implement unchanged.",
        ((0.0, ((20.0, 0.0, 1.0, 1.0),)), (180.0, ((20.0, 0.0, 1.0, 1.0),))),
    ),
    DriveProgramme(
        "there-and-back-lifted",
        "Drive the same straight line there and back, 20 s each way, implement up.",
        ((0.0, ((20.0, 0.0, 1.0, 0.0),)), (180.0, ((20.0, 0.0, 1.0, 0.0),))),
    ),
    DriveProgramme(
        "circles",
        "Drive a circle to the right and one to the left at 15 degrees, 20 s each.",
        ((0.0, ((20.0, 15.0, 1.0, 0.0),)), (0.0, ((20.0, -15.0, 1.0, 0.0),))),
    ),
    DriveProgramme(
        "two-speeds",
        "Drive a circle at 12 degrees for 20 s slowly and for 15 s at twice the speed.",
        ((0.0, ((20.0, 12.0, 0.7, 0.0), (15.0, 12.0, 2.0, 0.0))),),
    ),
    DriveProgramme(
        "steps",
        "Steer in steps of 4, 8 and 15 degrees to both sides, 4 s each.",
        ((0.0, tuple((4.0, a, 1.0, 0.0) for a in (0.0, 4.0, -4.0, 8.0, -8.0, 15.0, -15.0, 0.0))),),
    ),
    DriveProgramme(
        "small-steps",
        "Steer in steps of half a degree up to 2 degrees and back, 4 s each.",
        ((0.0, tuple((4.0, a, 1.0, 0.0) for a in (0.0, 0.5, 0.0, -1.0, 0.5, 2.0, 0.0, -2.0, 0.0))),),
    ),
    DriveProgramme(
        "bends-at-speeds",
        "Weave at 10 degrees, 6 s each way, at three speeds.",
        ((0.0, tuple((6.0, a, s, 0.0) for s in (0.6, 1.2, 2.0) for a in (10.0, -10.0))),),
    ),
    DriveProgramme(
        "shuffled-bends",
        "Steer to 20, 5, 25, 10, 15 and 5 degrees, 5 s to the right and 5 s to the left each, in this order.",
        ((0.0, tuple((5.0, side * a, 1.0, 0.0) for a in (20.0, 5.0, 25.0, 10.0, 15.0, 5.0) for side in (1.0, -1.0))),),
    ),
    DriveProgramme(
        "four-ways",
        "Drive straight ahead to all four points of the compass, 15 s each, implement up.",
        tuple((float(way), ((15.0, 0.0, 1.0, 0.0),)) for way in (0, 90, 180, 270)),
    ),
)


def simulate_programme(
    rig: ReplayRig, programme: DriveProgramme, heading: float, pace: float, settings: Settings, step: float = GRID_S
) -> DriveDataset:
    """Return the noiseless log of each pass, from a usual heading (rad) and pace (m/s), a row every `step` seconds."""
    segments = []
    for run, (turn, pieces) in enumerate(programme.passes):
        blank = build_command_segment(run, heading - math.radians(turn), pieces, pace, step)
        states = replay_segment(rig, blank, settings, from_sensor=False, from_speed=True)
        antenna, angle, wheel, speed = simulate_logged_values(rig, blank, states, settings)
        east, north = (np.ascontiguousarray(axis) for axis in antenna.T)
        shown: dict[str, Any] = {"east": east, "north": north, "heading": angle, "wheel": wheel}
        grid = np.arange(len(states)) * DT_S
        grids = blank.grids | {name: np.interp(grid, blank.time, values) for name, values in shown.items()}
        segments.append(replace(blank, **shown, speed=speed, grids=grids))
    names = tuple(f"pass {run + 1}" for run in range(len(segments)))
    return DriveDataset(names, tuple(segments), (0.0, 0.0), sum(segment.rows for segment in segments))


def find_usual_heading_and_speed(segments: Sequence[DriveSegment]) -> tuple[float, float]:
    """Return the mean heading (rad) and the median speed (m/s) of segments."""
    east = np.concatenate([np.cos(segment.heading) for segment in segments])
    north = np.concatenate([np.sin(segment.heading) for segment in segments])
    pace = float(np.median(np.concatenate([segment.speed_in_gear for segment in segments]))) or PROGRAMME_PACE_MPS
    return math.atan2(float(north.mean()), float(east.mean())), pace


def build_command_segment(
    run: int, heading: float, pieces: ProgrammePieces, pace: float, step: float = GRID_S
) -> DriveSegment:
    """Return a drive that has only its commands: pieces of DriveProgramme, `heading` in rad, a row every `step` s."""
    ends = np.cumsum([piece[0] for piece in pieces])
    time = np.arange(0.0, ends[-1] - 1e-9, step)
    grid = np.arange(math.ceil(time[-1] / DT_S) + 1) * DT_S

    def select_values(times: npt.NDArray[Any], column: int, factor: float) -> Floats:
        values = np.array([piece[column] for piece in pieces]) * factor
        return values[np.minimum(np.searchsorted(ends, times, side="right"), len(pieces) - 1)]

    columns = {"command": (1, math.pi / 180.0), "target": (2, pace), "working": (3, 1.0), "speed": (2, pace)}
    grids = {name: select_values(grid, *column_spec) for name, column_spec in columns.items()}
    grids |= {"east": np.zeros(len(grid)), "north": np.zeros(len(grid)), "heading": np.full(len(grid), heading)}
    rows: dict[str, Any] = {name: select_values(time, *column_spec) for name, column_spec in columns.items()}
    rows |= {"east": np.zeros(len(time)), "north": np.zeros(len(time)), "heading": np.full(len(time), heading)}
    return DriveSegment(run, 0.0, time, heading_measured=True, speed_measured=True, wheel=None, grids=grids, **rows)
