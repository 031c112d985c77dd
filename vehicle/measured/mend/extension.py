"""What a diagnosis adds to a tractor: terms with their values and intervals, and the settings for data held out."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from vehicle.effects import POSITION, SPEED, STEERING, STEERING_SPEED, effect
from vehicle.kinds import SURE, Interval
from vehicle.learnt import Settings
from vehicle.measured.causes.evidence import of_few, robust_covariance
from vehicle.measured.fit.fitting import Fit, block_sums
from vehicle.measured.fit.heldout import Pieces, steps_without
from vehicle.measured.fit.knobs import finest_of
from vehicle.measured.fit.openloop import OpenLoop, Term, Terms, moved, pieces_of, settings_in, to_neutral
from vehicle.measured.logs.record import Array
from vehicle.measured.mend.levels import driven_seconds, level_of, main_terms
from vehicle.measured.mend.mending import Mended
from vehicle.measured.replay.horizons import Halves, chain, squares
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import DRIVE_LINE_S, LEFT_OF_TOLERANCE, SENSORS_S, TIMING_S
from vehicle.rest import BY_NAME


@dataclass(frozen=True, eq=False)
class Extension:
    """Terms in use, 95 % intervals of their values by id, and the settings of every run for its even and odd windows.

    Where an effect has two levels, its interval is that of the level with the longer driving. `tolerant` are intervals
    as wide as the tolerance of the tractor file at least, and of two levels that farther from neutral: what a claim
    rests on.
    """

    terms: Terms
    intervals: Mapping[str, Mapping[str, Interval]]
    held_out: Mapping[int, Halves]
    tolerant: Mapping[str, Mapping[str, Interval]] = field(default_factory=dict)

    @property
    def ids(self) -> frozenset[str]:
        """Effects and terms of the rest in use."""
        return frozenset(term.knobs.id for term in self.terms)

    def only(self, names: Collection[str]) -> dict[int, Halves]:
        """Held-out settings with the named effects alone."""
        return self._where(lambda name: name in names)

    def without(self, name: str) -> dict[int, Halves]:
        """Held-out settings without one effect."""
        return self._where(lambda other: other != name)

    def beside(self, other: Extension) -> Extension:
        """Both together; where they have an effect in common, that of the other one."""

        def joined(run: int) -> Halves:
            (even, odd), (other_even, other_odd) = self.held_out[run], other.held_out[run]
            return {**even, **other_even}, {**odd, **other_odd}

        mine = {term.knobs.id for term in self.terms}
        told, tolerant = ({name: one[name] for name in mine if name in one} for one in (self.intervals, self.tolerant))
        return Extension(
            (*self.terms, *other.terms), {**told, **other.intervals}, {run: joined(run) for run in self.held_out},
            {**tolerant, **other.tolerant},
        )  # fmt: skip

    def _where(self, kept: Callable[[str], bool]) -> dict[int, Halves]:
        def cut(half: Settings) -> Settings:
            return {name: values for name, values in half.items() if kept(name)}

        return {run: (cut(even), cut(odd)) for run, (even, odd) in self.held_out.items()}


def of_fit(bench: Bench, fit: Fit, names: Collection[str]) -> Extension:
    """The effects with these names as a fit to the surprises gives them."""
    terms = tuple(Term(knobs, at) for knobs, at in fit.parts)
    slope = without_unknowns(fit)
    extra = slope.shape[1] - sum(knobs.count for knobs, _ in fit.parts)
    sums = block_sums(bench, slope, fit.surprise)
    pieces = Pieces(sums.squares, sums.sides, bench.block_runs, bench.block_halves)
    steps = steps_without(pieces, np.concatenate([to_neutral(terms), np.zeros(extra)]))
    covariance = robust_covariance(bench, fit, few=True) if fit.slope.size else np.zeros((0, 0))
    placed = [(term, covariance[place, place]) for term, place in zip(terms, _places(terms), strict=True)]
    intervals = {term.knobs.id: value_interval(term, one, off_alike(bench, term)) for term, one in placed}
    tolerant = {term.knobs.id: value_interval(term, one, tolerance(bench, term)) for term, one in placed}
    held_out: dict[int, Halves] = {
        run: (settings_in(moved(terms, both[0]), run), settings_in(moved(terms, both[1]), run))
        for run, both in steps.items()
    }
    whole = Extension(terms, intervals, held_out)
    kept = tuple(term for term in terms if term.knobs.id in names)
    return Extension(kept, intervals, whole.only(names), tolerant)


def without_unknowns(fit: Fit) -> Array:
    """Slope of a fit without the columns of what differs between tractors.

    That is the same in every run: where one is held out, no effect may give way to it.
    """
    if fit.extra is None:
        return fit.slope
    first = fit.slope.shape[1] - fit.extra.columns.shape[1]
    return np.delete(fit.slope, slice(first, first + fit.extra.unknowns), axis=1)


def of_mended(mended: Mended) -> Extension:
    """The terms that lower the open-loop error."""
    loop, model = mended.loop, mended.model
    pieces = pieces_of(loop, model)
    steps = steps_without(pieces, to_neutral(model.terms))
    inverse = np.linalg.pinv(pieces.squares.sum(axis=0), hermitian=True)
    wider = of_few(pieces.squares, inverse)
    covariance = inverse @ (pieces.sides.T @ pieces.sides) @ inverse * np.outer(wider, wider)
    seconds = driven_seconds(loop.bench.course)
    longest = main_terms(model.terms, seconds)
    told = [
        (term, value_interval(term, covariance[place, place], _open_loop_width(loop.bench, term)))
        for term, place in zip(model.terms, _places(model.terms), strict=True)
    ]
    intervals = {term.knobs.id: interval for term, interval in told if term in longest}
    # Of two grounds the one that differs more from neutral says whether there is an effect at all.
    effects = sorted((one for one in told if one[0].knobs.id not in BY_NAME),
                     key=lambda one: one[0].knobs.deviation(one[0].at))  # fmt: skip
    clearest = {term.knobs.id: interval for term, interval in effects}
    held_out = {run: _halves(loop, run, model.terms, both) for run, both in steps.items()}
    return Extension(model.terms, intervals, held_out, clearest)


def _places(terms: Terms) -> list[slice]:
    ends = np.cumsum(np.array([term.knobs.count for term in terms], dtype=np.int64))
    return [slice(int(end) - term.knobs.count, int(end)) for term, end in zip(terms, ends, strict=True)]


def _halves(loop: OpenLoop, run: int, terms: Terms, steps: tuple[Array, Array]) -> Halves:
    """Settings of a run held out: where an effect has two levels, each half takes the one that suits the other half.

    So what is simulated has told neither the values nor the ground it was driven on.
    """
    options = [level_of(terms, level) for level in (0, 1)]
    if len(options[0]) == len(terms):
        return settings_in(moved(terms, steps[0]), run), settings_in(moved(terms, steps[1]), run)
    chosen = []
    for half, step in enumerate(steps):
        both = [settings_in(level_of(moved(terms, step), level), run) for level in (0, 1)]
        acting = [{**settings_in(loop.settled, run), **one} for one in both]
        losses = [_loss(loop.bench, run, one, 1 - half) for one in acting]
        if not any(losses):  # a run too short for two halves tells its ground by itself
            losses = [_loss(loop.bench, run, one, half) for one in acting]
        chosen.append(both[int(losses[1] < losses[0])])
    return chosen[0], chosen[1]


def _loss(bench: Bench, run: int, settings: Mapping[str, Mapping[str, float]], half: int) -> float:
    """Squared error across over 1 s of one half of a run."""
    total = 0.0
    for stretch in bench.course.of(run):
        antenna, heading, _, _ = chain(bench.rig, stretch, settings)
        total += float(squares(stretch, antenna, heading, half)[1.0][0])
    return total


def value_interval(term: Term, covariance: Array, finest: float) -> dict[str, Interval]:
    """95 % interval of the values of a term from the covariance of its coordinates, and `finest` beside its scatter.

    Where an effect is, as of a patch, was searched for and not fitted: no interval is claimed for it.
    """
    knobs = term.knobs
    if knobs.id in BY_NAME:
        amount, sigma = float(term.at[0]), float(np.sqrt(np.maximum(np.diag(covariance), 0.0))[0])
        return {knobs.id: (amount - SURE * sigma, amount + SURE * sigma)}
    return knobs.interval(term.at, covariance, finest)


def tolerance(bench: Bench, term: Term) -> float:
    """What the tractor file tolerates of a term, of a time never less than half a row; 0 of a term of the rest."""
    return 0.0 if term.knobs.id in BY_NAME else finest_of(bench.rig.tractor, term.knobs.id, bench.row_s)


def _open_loop_width(bench: Bench, term: Term) -> float:
    """What a value told by the open-loop error is off by, which knows nothing of what differs between tractors."""
    return max(tolerance(bench, term), off_alike(bench, term, open_loop=True))


def off_alike(bench: Bench, term: Term, open_loop: bool = False) -> float:
    """How far off a value is (95 %), though its scatter be small: every run is off by as much, to the same side.

    Commands take effect somewhere between two rows, at the beat of a controller, and drive lines differ. Where a
    computer comes to rest and wakes is shaped otherwise in every make, and noise of the wheel sensor pushes a play from
    both sides. What else tractors differ in has a part in the fit of the surprises and leaves a share of the tolerance;
    it has none in the open-loop error.
    """
    if term.knobs.id in BY_NAME:
        return 0.0
    entry = effect(term.knobs.id)
    if entry.size.unit == "s" and entry.block == POSITION:
        # A late position, a late turning and an early speed are one thing to the path: what is known beforehand of the
        # three parts them.
        return SURE * SENSORS_S * (1.0 if open_loop else 1.0 / math.sqrt(3.0))
    if entry.size.unit == "s":
        sigma = DRIVE_LINE_S if entry.block == SPEED else TIMING_S
        return SURE * math.hypot(sigma, bench.row_s / math.sqrt(12.0))
    whole = open_loop or entry.block == STEERING or STEERING_SPEED in entry.plot
    return tolerance(bench, term) * (1.0 if whole else LEFT_OF_TOLERANCE)
