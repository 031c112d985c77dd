"""The open-loop error as one vector: what a model drives wrong from the commands, anchored again and again.

Unlike the surprises of a bench it does not ask what instruments and soil explain. It is what is left to lower when no
cause is known, at the speed that was measured where one was: every horizon and every kind of error counts the same,
each as a share of what it was before.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.effects import BY_ID, REST_KEY, SPEED
from vehicle.layout import DT_S
from vehicle.learnt import Settings
from vehicle.measured.fit.fitting import flat
from vehicle.measured.fit.heldout import Pieces, steps_without
from vehicle.measured.fit.knobs import Knobs
from vehicle.measured.fit.products import add_products, squared
from vehicle.measured.fit.solver import (
    FIRST_STEP,
    LATER_STEP,
    Point,
    Rule,
    descend,
    slope_of,
    with_near_slope,
)
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.anchoring import add_off_middle
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.horizons import Cuts, anchored_pieces, cuts, driven_poses
from vehicle.measured.replay.replaying import replay
from vehicle.measured.replay.states import FORWARD
from vehicle.measured.replay.windows import window_of
from vehicle.measured.surprise.bench import Bench
from vehicle.rest import BY_NAME

HORIZONS_S = (1.0, 5.0)  # chosen: soil drowns what is sought over longer ones, noise of the receiver over shorter
KINDS = 3  # errors across, along and of the heading
ITERATIONS = 3  # chosen: candidates start where a straight line promises most, and every step costs m simulations
SETTLED = 0.01  # chosen, of the loss: a step that gains less is the last; half of what a term must be worth


@dataclass(frozen=True, eq=False)
class Term:
    """An effect or a term of the rest at coordinates; `runs` None stands for all runs."""

    knobs: Knobs
    at: Array
    runs: frozenset[int] | None = None

    @property
    def value(self) -> dict[str, float]:
        """Values of the effect, or the amount of the term of the rest."""
        return self.knobs.values(self.at)

    def acts_in(self, run: int) -> bool:
        """Whether the term counts in a run."""
        return self.runs is None or run in self.runs


Terms = tuple[Term, ...]


def settings_in(terms: Sequence[Term], run: int) -> Settings:
    """Settings of one run."""
    settings: dict[str, dict[str, float]] = {}
    for term in terms:
        if term.acts_in(run):
            key = REST_KEY if term.knobs.id in BY_NAME else term.knobs.id
            settings[key] = settings.get(key, {}) | term.value
    return settings


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """The errors of a bench under terms, as a vector in units of what they were without any (n,).

    Errors along the way are judged beside what is `tolerated`: effects of the speed that no term has to take away.
    Terms that are `settled` act beside all others, and no fit moves them.
    """

    bench: Bench
    tolerated: Settings = field(default_factory=dict)
    settled: Terms = ()

    def errors(self, terms: Sequence[Term]) -> Array:
        """The whole vector: the sum of its squares is 1 without terms."""
        return next(self.errors_of_each([terms]))

    def errors_of_each(self, each: Sequence[Sequence[Term]]) -> Iterator[Array]:
        """As errors, of many lists of terms, one after another: they are driven side by side."""
        acting = [(*self.settled, *terms) for terms in each]
        asked = [{run: settings_in(terms, run) for run in range(self.run_count)} for terms in acting]
        for some in self.bench.batches(asked):
            for out in self._raw(some):
                out /= self._units
                yield out

    def _raw(self, each: Sequence[Mapping[int, Settings]]) -> Iterator[Array]:
        """The vectors in metres and radians, one for the settings of every run."""
        stretches = self.bench.course.stretches
        pairs = [(stretch, settings[stretch.run]) for settings in each for stretch in stretches]
        poses = driven_poses(self.bench.rig, pairs, by_speed=True)
        for first in range(0, len(pairs), len(stretches)):
            mine = zip(pairs[first : first + len(stretches)], poses[first : first + len(stretches)], strict=True)
            whole = np.concatenate([part for one, pose in mine for part in self._anchored(*one, *pose)]).ravel()
            yield whole if np.isfinite(whole).all() else np.nan_to_num(whole, copy=False)

    def _anchored(self, stretch: Stretch, settings: Settings, antenna: Array, heading: Array) -> Iterator[Array]:
        """Errors (k, 3) of one stretch, from its poses driven, per horizon."""
        behind = self._behind(stretch, settings)
        for cut in self._cuts[stretch]:
            errors = anchored_pieces(stretch, antenna, heading, cut)
            if behind is not None:
                add_off_middle(*cut, behind, errors[:, 1])
            yield errors

    @cached_property
    def _cuts(self) -> dict[Stretch, list[Cuts]]:
        """Pieces of every stretch, by horizon."""
        return {one: [cuts(one.time, horizon) for horizon in HORIZONS_S] for one in self.bench.course.stretches}

    def _behind(self, stretch: Stretch, settings: Settings) -> Array | None:
        """How far the measured speed has come beyond the commanded one, per row (m); None where one was not logged.

        The path is driven at the measured speed, so that no fault of the speed bends it; what the speed itself gets
        wrong is added along the way. Only effects of the speed change it.
        """
        if stretch.target is None or not stretch.speed_seen:
            return None
        own = dict(self.tolerated)
        own |= {name: values for name, values in settings.items() if name in BY_ID and BY_ID[name].block == SPEED}
        key = (stretch.run, stretch.start_s, str(own))
        if key not in self._ways:
            states = replay(self.bench.rig, stretch, own, from_sensor=True, from_speed=False)
            gained = np.cumsum(stretch.grids["speed"] - states[:, FORWARD]) * DT_S
            self._ways[key] = np.interp(stretch.time, np.arange(len(gained)) * DT_S, gained)
        return self._ways[key]

    @cached_property
    def _ways(self) -> dict[tuple[int, float, str], Array]:
        """Ways already driven, by stretch and settings of the speed."""
        return {}

    @cached_property
    def _units(self) -> Array:
        """Per entry, the size of its horizon and kind without terms, so that each of them sums up to its share."""
        (whole,) = self._raw([{run: {} for run in range(self.run_count)}])
        group = np.concatenate([
            np.repeat(np.arange(len(HORIZONS_S)), one.rows * KINDS) * KINDS
            + np.tile(np.arange(KINDS), one.rows * len(HORIZONS_S))
            for one in self.bench.course.stretches
        ])  # fmt: skip
        sums = np.bincount(group, whole * whole, len(HORIZONS_S) * KINDS)
        seen = np.count_nonzero(sums)
        return np.asarray(np.sqrt(np.maximum(sums[group], 1e-12) * seen))

    @cached_property
    def runs(self) -> npt.NDArray[np.int64]:
        """Run of every entry."""
        stretches = self.bench.course.stretches
        return np.concatenate([np.full(one.rows * KINDS * len(HORIZONS_S), one.run) for one in stretches])

    @cached_property
    def windows(self) -> npt.NDArray[np.int64]:
        """Window of 20 s of every entry, counted through all runs."""
        numbers, count = [], 0
        for one in self.bench.course.stretches:
            window = count + window_of(one.time)
            numbers.append(np.tile(np.repeat(window, KINDS), len(HORIZONS_S)))
            count = int(window[-1]) + 1
        return np.concatenate(numbers)

    @cached_property
    def places(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Run and half of every window."""
        count = int(self.windows.max()) + 1
        runs, halves = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        runs[self.windows] = self.runs
        first = 0
        for one in self.bench.course.stretches:
            size = int(window_of(one.time[-1:])[0]) + 1
            halves[first : first + size] = np.arange(size) % 2
            first += size
        return runs, halves

    @property
    def run_count(self) -> int:
        """Number of runs."""
        return len(self.bench.course.names)

    def by_run(self, errors: Array) -> Array:
        """Sum of squares per run (runs,)."""
        return np.bincount(self.runs, errors * errors, self.run_count).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Model:
    """Terms at their best: `errors` (n,) is what is left, `slope` (n, m) its change per coordinate."""

    terms: Terms
    errors: Array
    slope: Array

    @property
    def loss(self) -> float:
        """What is left of the squared error; 1 without terms."""
        return squared(self.errors)

    @property
    def ids(self) -> frozenset[str]:
        """Ids in use."""
        return frozenset(term.knobs.id for term in self.terms)


@dataclass(frozen=True, eq=False)
class _Coordinates:
    """The problem of lowering the open-loop error by the coordinates of terms."""

    loop: OpenLoop
    terms: Terms

    @cached_property
    def typical(self) -> Array:
        return flat([term.knobs.typical for term in self.terms])

    @cached_property
    def low(self) -> Array:
        return flat([term.knobs.low for term in self.terms])

    @cached_property
    def high(self) -> Array:
        return flat([term.knobs.high for term in self.terms])

    @property
    def linear(self) -> None:
        return None

    @property
    def start(self) -> Array:
        return flat([term.at for term in self.terms])

    def terms_at(self, at: Array) -> Terms:
        """The terms at other coordinates."""
        terms, first = [], 0
        for term in self.terms:
            terms.append(replace(term, at=at[first : first + term.knobs.count]))
            first += term.knobs.count
        return tuple(terms)

    def left(self, at: Array, start: Point) -> Array:
        return self.loop.errors(self.terms_at(at))

    def changes(self, places: Sequence[Array], axes: Sequence[int], start: Point) -> Iterator[Array]:
        return (left - start.left for left in self.loop.errors_of_each([self.terms_at(at) for at in places]))


def moved(terms: Terms, change: Array) -> Terms:
    """Terms with their coordinates changed, kept inside what a tractor can have."""
    others, first = [], 0
    for term in terms:
        count = term.knobs.count
        others.append(replace(term, at=term.knobs.inside(term.at + change[first : first + count])))
        first += count
    return tuple(others)


def slope_of_new(loop: OpenLoop, terms: Terms, errors: Array, new: int) -> Array:
    """Change of the errors, which are those of all terms, per coordinate of the `new` last of them."""
    problem = _Coordinates(loop, terms)
    first = sum(term.knobs.count for term in terms[: len(terms) - new])
    return slope_of(problem, Point(problem.start, errors), FIRST_STEP, first)


def fitted(loop: OpenLoop, terms: Terms, iterations: int = ITERATIONS) -> Model:
    """Terms with all their coordinates at their best together."""
    problem = _Coordinates(loop, terms)
    start = Point(problem.start, loop.errors(terms))

    def settled(before: Point, after: Point) -> bool:
        return before.loss - after.loss < SETTLED * after.loss

    rule = Rule(iterations if terms else 0, settled, first_step=LATER_STEP)
    end = with_near_slope(problem, descend(problem, start, rule))
    return Model(problem.terms_at(end.at), end.left, end.slope)


def pieces_of(loop: OpenLoop, model: Model) -> Pieces:
    """Normal equations per window of 20 s."""
    count, size = int(loop.windows.max()) + 1, model.slope.shape[1]
    squares, sides = np.zeros((count, size, size)), np.zeros((count, size))
    add_products(loop.windows, model.slope, model.errors, squares, sides)
    return Pieces(squares, sides, *loop.places)


def to_neutral(terms: Terms) -> Array:
    """Change of the coordinates that takes every term away."""
    parts = [np.array(term.knobs.neutral) - term.at for term in terms]
    return np.concatenate(parts) if parts else np.zeros(0)


def held_out_loss(loop: OpenLoop, model: Model) -> float:
    """Squared error of every window under coordinates that other runs (or windows) give."""
    pieces = pieces_of(loop, model)
    total = model.loss
    for run, steps in steps_without(pieces, to_neutral(model.terms)).items():
        for half, step in enumerate(steps):
            mine = (pieces.runs == run) & (pieces.halves == half)
            square, side = pieces.squares[mine].sum(axis=0), pieces.sides[mine].sum(axis=0)
            total += float(2.0 * step @ side + step @ square @ step)
    return total
