"""What an answer is drawn from: the fit to the surprises, what is added to the tractor, and errors held out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vehicle.effects import SPEED, STEERING, STEERING_SPEED, effect
from vehicle.learnt import Settings
from vehicle.measured.causes.refit import with_unnamed
from vehicle.measured.causes.selection import Selection
from vehicle.measured.causes.trial import Projector
from vehicle.measured.fit import openloop
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.openloop import Term, settings_in
from vehicle.measured.logs.record import Array
from vehicle.measured.mend.extension import Extension, off_alike, tolerance
from vehicle.measured.mend.levels import driven_seconds, main_terms
from vehicle.measured.replay.horizons import Halves, Squares, chain, run_squares, total_error
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.surprise.floor import floor_squares
from vehicle.measured.surprise.noise import first_noise, tuned
from vehicle.measured.thresholds import ABOVE_FLOOR, ABOVE_PER_ROW_S, CHANCE_OF_FEW
from vehicle.tractor import Tractor

PIECE_S = 5.0  # that errors are summed over
DRAWS = 400  # resampled sets of runs: chosen, leaves an interval steady to its last digit printed


@dataclass(frozen=True, eq=False)
class Case:
    """What findings are drawn from: the fit to the surprises, what is added to the tractor, and the noise floor.

    Errors are judged beside what is `tolerated` (see within_tolerance). `refused` are effects that the surprises spoke
    for, without help to runs held out.
    """

    bench: Bench
    fit: Fit
    extension: Extension
    floor: list[Squares]
    tolerated: Settings = field(default_factory=dict)
    refused: frozenset[str] = frozenset()

    @property
    def tractor(self) -> Tractor:
        """The tractor without effects."""
        return self.bench.rig.tractor

    @cached_property
    def main_terms(self) -> dict[str, Term]:
        """Terms by id, those of the longer driving where an effect has two levels."""
        main = main_terms(self.extension.terms, driven_seconds(self.bench.course))
        return {term.knobs.id: term for term in main}

    @property
    def found(self) -> dict[str, dict[str, float]]:
        """Values of what is added to the tractor."""
        return {name: term.value for name, term in self.main_terms.items()}

    @cached_property
    def plain(self) -> Fit:
        """The fit of the effects without unnamed terms."""
        return with_unnamed(self.bench, self.fit, ())

    @cached_property
    def misfit(self) -> float:
        """Squared error that is left, in units of the noise floor, at least 1: it hides small effects."""
        return max(1.0, float(self.final.sum()) / float(self.number(self.floor).sum()))

    def number(self, squares: list[Squares], horizon: float = PIECE_S) -> Array:
        """Squared errors of every run over a horizon as one number each, in units of the noise floor."""
        seen = all(stretch.speed_seen for stretch in self.bench.course.stretches)
        return total_error(squares, self.floor, seen, horizon)

    def error(self, settings: Mapping[int, Halves], by_speed: bool = False) -> Array:
        """Error of every run as one number; `by_speed` is that of replay.horizons.chain."""
        return self.number(self.squares(settings, by_speed))

    def squares(self, settings: Mapping[int, Halves], by_speed: bool = False) -> list[Squares]:
        """Squared errors of every run by horizon, beside what is tolerated."""
        beside: dict[int, Halves] = {
            run: ({**self.tolerated, **even}, {**self.tolerated, **odd}) for run, (even, odd) in settings.items()
        }
        return run_squares(self.bench.course, self.bench.rig, beside, by_speed)

    def gain_of(self, name: str) -> tuple[float, tuple[float, float]]:
        """Percent of the held-out error over 5 s that an effect takes away, with a 90 % interval over runs.

        Effects that are not of the speed are judged at the speed that was measured.
        """
        if effect(name).block == SPEED:
            return gain_between(self.error(self.extension.without(name)), self.final)
        return gain_between(self.error(self.extension.without(name), by_speed=True), self.final_by_speed)

    @cached_property
    def final(self) -> Array:
        """Error of every run with all that was found."""
        return self.error(self.extension.held_out)

    @cached_property
    def final_by_speed(self) -> Array:
        """The same at the speed that was measured."""
        return self.error(self.extension.held_out, by_speed=True)

    @cached_property
    def as_fitted(self) -> tuple[Array, Projector]:
        """Surprises (n,) with the effects of the fit and no linear terms, and what takes the columns of the fit out."""
        return self.bench.surprise(self.fit.settings), Projector(self.fit.slope)

    def without_one(self, name: str) -> tuple[Array, Projector]:
        """The same with all effects of the fit but one, and without its columns."""
        rest = {other: values for other, values in self.fit.settings.items() if other != name}
        return self.bench.surprise(rest), Projector(np.delete(self.fit.slope, self.fit.columns(name), axis=1))

    def worth_of(self, name: str) -> float:
        """Percent of the error where the effect shows: of the wheel angle for the steering, else of the path."""
        if effect(name).block == STEERING and self.bench.has_wheel:
            settings = self.extension.without(name), self.extension.held_out
            return gain_between(*(_wheel_squares(self.bench, one) for one in settings))[0]
        return self.gain_of(name)[0]


def _wheel_squares(bench: Bench, settings: Mapping[int, Halves]) -> Array:
    """Squared error of the simulated wheel angle, per run."""
    sums = np.zeros(len(bench.course.names))
    for stretch in bench.course.stretches:
        wheel = chain(bench.rig, stretch, settings[stretch.run][0])[2]
        if stretch.wheel is not None:
            sums[stretch.run] += float(np.sum((stretch.wheel - wheel) ** 2))
    return sums


def gain_between(worse: Array, final: Array) -> tuple[float, tuple[float, float]]:
    """Percent of the root mean square that is gone, with a 90 % interval over runs."""
    rng = np.random.default_rng(11)
    drawn = rng.integers(0, len(worse), size=(DRAWS, len(worse)))
    shares = 100.0 * (1.0 - np.sqrt(final[drawn].sum(axis=1) / np.maximum(worse[drawn].sum(axis=1), 1e-12)))
    whole = 100.0 * (1.0 - math.sqrt(float(final.sum()) / max(float(worse.sum()), 1e-12)))
    return whole, (float(np.quantile(shares, 0.05)), float(np.quantile(shares, 0.95)))


def case_of(selection: Selection, extension: Extension) -> Case:
    """The case of what was selected and added, above the noise that these logs really have."""
    bench = with_real_noise(selection.bench, selection.fit)
    runs = range(len(bench.course.names))
    settings = {run: settings_in(extension.terms, run) for run in runs}
    tolerated = within_tolerance(selection)
    floor = floor_squares(bench, settings, tolerated=tolerated)
    return Case(selection.bench, selection.fit, extension, floor, tolerated, selection.refused)


def within_tolerance(selection: Selection) -> Settings:
    """Effects of the fit that are calibrations, with their values."""
    bench = selection.bench
    terms = (Term(knobs, at) for knobs, at in selection.fit.parts)
    return {term.knobs.id: term.knobs.values(term.at) for term in terms if is_calibration(bench, term)}


def is_calibration(bench: Bench, term: Term) -> bool:
    """Whether an effect of the speed, a time or a play of the steering is within what files tolerate of any tractor.

    Drive lines differ by the tolerance. Every steering is late by a beat of commands and rows that no file tells, and
    on top of it by what its own shape poses as; and as a small play poses how the wheels of any make come to rest.
    """
    entry = effect(term.knobs.id)
    of_steering = (entry.block == STEERING and entry.size.unit == "s") or STEERING_SPEED in entry.plot
    beat = off_alike(bench, term) if of_steering else 0.0
    return (of_steering or entry.block == SPEED) and term.knobs.deviation(term.at) <= tolerance(bench, term) + beat


def with_real_noise(bench: Bench, fit: Fit) -> Bench:
    """The bench with the noise that the logs show, not the wider one that a wrong model may have been judged by."""
    return replace(bench, noise=tuned(bench.course, bench.rig, first_noise(bench.course), fit.settings))


def within_noise(case: Case, error: Array, by_chance: bool = False, horizon: float = PIECE_S) -> bool:
    """Whether an error over a horizon is what noise, and what happens unseen between rows, would leave.

    `by_chance` grants a few pieces what chance does to them: so much is said of what is left, and no name rests on it.
    """
    floor = float(case.number(case.floor, horizon).sum())
    few = 1.0 + (chance_of_few(case.bench.course.seconds, horizon) if by_chance else 0.0)
    return float(error.sum()) < (max(ABOVE_FLOOR, few) + ABOVE_PER_ROW_S * case.bench.row_s) * floor


def horizons_above_noise(case: Case, squares: list[Squares]) -> tuple[float, ...]:
    """Horizons (s) over which errors are above what noise, and chance with the pieces there are, would leave."""
    driven = [horizon for horizon in squares[0] if sum(one[horizon][3] for one in squares) > 0.0]
    return tuple(
        horizon for horizon in driven if not within_noise(case, case.number(squares, horizon), True, horizon)
    )


def chance_of_few(seconds: float, piece_s: float = PIECE_S) -> float:
    """How far chance parts two mean squares of the pieces that so much driving gives, as a share.

    A mean of n squares has a variance of 2 / n, the noise floor is drawn as often, and a piece has three errors.
    """
    pieces = max(seconds / piece_s, 1.0)
    return CHANCE_OF_FEW * math.sqrt(4.0 / (3.0 * pieces))


def noise_share(case: Case) -> float:
    """Share of the open-loop error without terms that noise alone would leave, every horizon and kind the same."""
    runs = range(len(case.bench.course.names))
    before = run_squares(case.bench.course, case.bench.rig, {run: {} for run in runs})
    shares = []
    for horizon in openloop.HORIZONS_S:
        sums = [np.sum([one[horizon][:3] for one in squares], axis=0) for squares in (case.floor, before)]
        shares += [float(noise / whole) for noise, whole in zip(*sums, strict=True) if whole > 0.0]
    return min(float(np.mean(shares)), 1.0) if shares else 0.0
