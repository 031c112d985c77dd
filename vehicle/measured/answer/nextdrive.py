"""The cheapest drive that would tell apart causes that look alike in the logs at hand.

A small library of drives a person can make is simulated with each rival at the value it needs to explain the logs; the
drive counts as decisive when the other rival, free to change its value, stays clearly wrong.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.measured.answer.verdict import NextDrive
from vehicle.measured.causes.trial import Projector, tried
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import Knobs, knobs_for
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import DT_S, Course, Stretch
from vehicle.measured.replay.replaying import replay, seen
from vehicle.measured.surprise.bench import Bench, Channel, prepare
from vehicle.measured.thresholds import DECISIVE
from vehicle.tractor import Tractor

STEP_S = 0.1
PACE_MPS = 1.4
Values = Mapping[str, dict[str, float]]


@dataclass(frozen=True)
class Program:
    """A drive: pieces of (seconds, wheel angle in deg, share of the usual speed, implement, heading in deg)."""

    id: str
    words: str
    passes: tuple[tuple[float, tuple[tuple[float, float, float, float], ...]], ...]

    @property
    def seconds(self) -> float:
        """Length of the drive."""
        return sum(piece[0] for _, pieces in self.passes for piece in pieces)


def _program(id: str, words: str, *passes: tuple[float, tuple[tuple[float, float, float, float], ...]]) -> Program:
    return Program(id, words, passes)


LIBRARY: tuple[Program, ...] = (
    _program("implement-lifted", "Drive straight ahead for 30 s, implement up for the first 15 s, then down.",
             (0.0, ((15.0, 0.0, 1.0, 0.0), (15.0, 0.0, 1.0, 1.0)))),
    _program("there-and-back", "Drive the same straight line there and back, 20 s each way, the implement as it was.",
             (0.0, ((20.0, 0.0, 1.0, 1.0),)), (180.0, ((20.0, 0.0, 1.0, 1.0),))),
    _program("there-and-back-lifted", "Drive the same straight line there and back, 20 s each way, implement up.",
             (0.0, ((20.0, 0.0, 1.0, 0.0),)), (180.0, ((20.0, 0.0, 1.0, 0.0),))),
    _program("circles", "Drive a circle to the right and one to the left at 15 degrees, 20 s each.",
             (0.0, ((20.0, 15.0, 1.0, 0.0),)), (0.0, ((20.0, -15.0, 1.0, 0.0),))),
    _program("two-speeds", "Drive a circle at 12 degrees for 20 s slowly and for 15 s at twice the speed.",
             (0.0, ((20.0, 12.0, 0.7, 0.0), (15.0, 12.0, 2.0, 0.0)))),
    _program("steps", "Steer in steps of 4, 8 and 15 degrees to both sides, 4 s each.",
             (0.0, tuple((4.0, a, 1.0, 0.0) for a in (0.0, 4.0, -4.0, 8.0, -8.0, 15.0, -15.0, 0.0)))),
    _program("small-steps", "Steer in steps of half a degree up to 2 degrees and back, 4 s each.",
             (0.0, tuple((4.0, a, 1.0, 0.0) for a in (0.0, 0.5, 0.0, -1.0, 0.5, 2.0, 0.0, -2.0, 0.0)))),
    _program("bends-at-speeds", "Weave at 10 degrees, 6 s each way, at three speeds.",
             (0.0, tuple((6.0, a, s, 0.0) for s in (0.6, 1.2, 2.0) for a in (10.0, -10.0)))),
    _program("four-ways", "Drive straight ahead to all four points of the compass, 15 s each, implement up.",
             *[(float(way), ((15.0, 0.0, 1.0, 0.0),)) for way in (0, 90, 180, 270)]),
)  # fmt: skip


def next_drive(bench: Bench, fit: Fit, tractor: Tractor, rivals: Mapping[str, Values]) -> NextDrive | None:
    """The shortest decisive drive for the first set of rivals; the most telling one when none decides."""
    for name, others in rivals.items():
        for other, values in others.items():
            both = ({**fit.settings}, {**{k: v for k, v in fit.settings.items() if k != name}, other: values})
            scored = [(program, _score(bench, program, tractor, both, (name, other))) for program in LIBRARY]
            good = [one for one in scored if one[1] > DECISIVE]
            program, score = min(good, key=lambda o: o[0].seconds) if good else max(scored, key=lambda o: o[1])
            return NextDrive(program.id, program.words, program.seconds, (name, other), score, score > DECISIVE)
    return None


def _score(
    bench: Bench, program: Program, tractor: Tractor, both: tuple[Values, Values], names: tuple[str, str]
) -> float:
    """What separates the rivals: the smaller of the two losses of explaining one's drive by the other."""
    heading = _usual_heading(bench)
    losses = []
    for true, wrong, name in ((both[0], both[1], names[1]), (both[1], both[0], names[0])):
        made = _driven(bench, program, heading, true)
        trial = prepare(made, replace(bench.rig, origin=(0.0, 0.0)), true, bench.noise)
        trial = replace(trial, wheel=_steady(bench.wheel, trial), speed=_steady(bench.speed, trial))
        losses.append(_misfit(trial, tractor, wrong, name))
    return min(losses)


def _steady(channels: tuple[Channel | None, ...], trial: Bench) -> tuple[Channel | None, ...]:
    """Weights of the logs' own channels, as even numbers per row."""
    known = [one for one in channels if one is not None]
    if not known:
        return tuple(None for _ in trial.course.stretches)
    level = float(np.median(np.concatenate([one.sigma for one in known])))
    rows = [np.full(stretch.rows, level) for stretch in trial.course.stretches]
    return tuple(Channel(one, known[0].memory, one) for one in rows)


def _misfit(trial: Bench, tractor: Tractor, wrong: Values, name: str) -> float:
    """Loss left when the rival may choose its value again."""
    knobs: Knobs = knobs_for(tractor, name)
    rest = {k: v for k, v in wrong.items() if k != name}
    surprise = trial.surprise(rest)
    fixed = Fit((), surprise, np.zeros((len(surprise), 0)))

    def change(settings: Values, base: Array, blocks: frozenset[str]) -> Array:
        """As Bench.change, on top of the other effects."""
        return trial.change({**rest, **settings}, base, blocks)

    return fixed.loss - tried(change, fixed, knobs, Projector(fixed.slope)).gain


def _usual_heading(bench: Bench) -> float:
    """The heading driven most (rad): of a drive that repeats, the same."""
    east = np.concatenate([np.cos(one.heading) for one in bench.course.stretches])
    north = np.concatenate([np.sin(one.heading) for one in bench.course.stretches])
    return math.atan2(float(north.mean()), float(east.mean()))


def _driven(bench: Bench, program: Program, heading: float, settings: Values) -> Course:
    """The drive as the tractor with these effects would log it, without noise."""
    pace = float(np.median(np.concatenate([one.speed for one in bench.course.stretches]))) or PACE_MPS
    made = []
    for run, (turn, pieces) in enumerate(program.passes):
        empty = blank(run, heading - math.radians(turn), pieces, pace)
        states = replay(bench.rig, empty, settings, from_sensor=False, from_speed=True)
        antenna, angle, wheel, speed = seen(bench.rig, empty, states, settings)
        grid = np.arange(len(states)) * DT_S
        grids = dict(empty.grids)
        for name, values in (("east", antenna[:, 0]), ("north", antenna[:, 1]), ("heading", angle), ("wheel", wheel)):
            grids[name] = np.interp(grid, empty.time, values)
        made.append(
            replace(
                empty, east=antenna[:, 0], north=antenna[:, 1], heading=angle, wheel=wheel, speed=speed, grids=grids
            )
        )
    names = tuple(f"pass {run + 1}" for run in range(len(made)))
    return Course(names, tuple(made), (0.0, 0.0), sum(one.rows for one in made))


def blank(
    run: int, heading: float, pieces: tuple[tuple[float, float, float, float], ...], pace: float, step: float = STEP_S
) -> Stretch:
    """A drive that has only its commands yet: pieces as in Program, `heading` in rad."""
    ends = np.cumsum([piece[0] for piece in pieces])
    time = np.arange(0.0, ends[-1] - 1e-9, step)
    grid = np.arange(math.ceil(time[-1] / DT_S) + 1) * DT_S

    def at(times: npt.NDArray[Any], column: int, factor: float) -> Array:
        values = np.array([piece[column] for piece in pieces]) * factor
        return values[np.minimum(np.searchsorted(ends, times, side="right"), len(pieces) - 1)]

    columns = {"command": (1, math.pi / 180.0), "target": (2, pace), "working": (3, 1.0), "speed": (2, pace)}
    grids = {name: at(grid, *how) for name, how in columns.items()}
    grids |= {"east": np.zeros(len(grid)), "north": np.zeros(len(grid)), "heading": np.full(len(grid), heading)}
    rows = {name: at(time, *how) for name, how in columns.items()}
    zero = np.zeros(len(time))
    return Stretch(
        run, 0.0, time, zero, zero, np.full(len(time), heading), True, rows["speed"], True, None, rows["command"],
        rows["target"], rows["working"], grids,
    )  # fmt: skip
