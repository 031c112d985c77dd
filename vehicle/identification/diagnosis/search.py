"""The search: which hypotheses the logs call for, and how well each predicts left-out windows beside its competitors.

A hypothesis enters by evidence. It is judged by prediction: windows are left out in turn, and the density of what was
measured in them is compared with that of the model without it and of every competitor in its place, each fitted with
its own noise. Circles of the ground in which the tractor turns otherwise are scored many at once, by geometry alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from fields.arrays import Flags, Floats
from vehicle.identification.diagnosis.drive_data import PATH_STEP_S, POSE_CELL_S, POSE_CELLS, DriveData
from vehicle.identification.diagnosis.grammar import (
    BY_RUN,
    CONSTANT,
    PATCH_RADII_M,
    PENALTIES,
    WIDTH_PER_TYPICAL,
    Bases,
    Coordinate,
    Hypothesis,
    collect_widths,
    list_catalogue,
    list_competitors,
    list_laws,
    list_nuisances,
)
from vehicle.identification.diagnosis.model_fit import CHANNELS, FIT_STEP, Fit, Gain, Problem, collect_bounds
from vehicle.identification.diagnosis.noise import build_yaw_response, cut_motion
from vehicle.identification.logs.thresholds import ALIKE_SHARE, DOUBT_SIGMAS, LASTING_S
from vehicle.model.effects import get_effect

ADD_NATS = 8.0  # of evidence for another hypothesis: among a hundred tried, chance gives 8 nats once in thirty logs
MOST_TRIED = 4  # hypotheses of a scan that are fitted
MOST_ROUNDS, MOST_TURNS, MOST_VISITS = 8, 6, 2
FOLDS = 5
BETTER_NATS = 2.0  # a competitor that predicts so much better takes the place

Step = Callable[[], None]

SPACING = 0.7  # of the radius between the centres that are tried
FIRST_MOVE_M = 0.5 * PATCH_RADII_M[0]
FINEST_MOVE_M = FIRST_MOVE_M / 8.0
SMALLEST_RADIUS_M = 3.0
MOVES = ((1, 0, 0.0), (-1, 0, 0.0), (0, 1, 0.0), (0, -1, 0.0), (0, 0, 0.5), (0, 0, -0.5))
LARGEST_PATCH_SHARE = 0.7  # of the driving: a circle that holds more is no place
Circle = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class PredictiveComparison:
    """How much better left-out windows are predicted with a hypothesis than by an alternative: nats, and in standard
    errors. `amounts` are those of the alternative; None stands for the model without it."""

    alternative: Hypothesis | None
    nats: float
    z: float
    amounts: Floats | None = None


@dataclass(frozen=True)
class Judgement:
    """A hypothesis of the final model: against nothing, and against what could take its place."""

    hypothesis: Hypothesis
    against_none: PredictiveComparison
    against_others: tuple[PredictiveComparison, ...] = ()


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The final fit, its judgements, and the fit without any hypothesis."""

    fit: Fit
    base: Fit
    judgements: tuple[Judgement, ...]


@dataclass(eq=False)
class Searcher:
    """Searches the hypotheses of a problem. `step` is called from time to time."""

    problem: Problem
    step: Step = lambda: None
    visited: dict[frozenset[str], int] = field(default_factory=dict)
    own_fits: dict[frozenset[str], tuple[Fit, dict[str, Floats]]] = field(default_factory=dict)
    may_change: bool = True

    def __post_init__(self) -> None:
        problem = self.problem
        tractor = problem.rig.tractor
        self.nuisances = tuple(list_nuisances(problem.data))
        self.catalogue = list_catalogue(problem.data, tractor)
        self.hypotheses = [*self.catalogue, *list_competitors(problem.data, tractor, problem.bases)]

    def run(self) -> SearchResult:
        """The model the logs call for, judged."""
        base = self.fit_base()
        fit, judgements = self.settle(self.add_greedily(base))
        return SearchResult(fit, base, tuple(judgements))

    def fit_base(self) -> Fit:
        """The fit of the nuisances alone."""
        return self.problem.fit(self.nuisances, np.zeros(len(self.nuisances)), rounds=4)

    def scan(self, fit: Fit, channels: frozenset[str] = frozenset(CHANNELS)) -> list[Gain]:
        """What further hypotheses that act on some channels would gain; of effects in the model only other laws."""
        known = {one.id for one in fit.model if not one.is_nuisance}
        tried = [one for one in self.hypotheses if one not in fit.model and not (one.is_catalogued and one.id in known)]
        for one in fit.model:  # laws of effects in the model that are not among the hypotheses anyway
            if one.is_catalogued and one.coordinates[0].basis == CONSTANT:
                laws = list_laws(one, self.problem.bases)
                tried += [law for law in laws if law not in self.hypotheses and law not in fit.model]
        tried = [one for one in tried if self.problem.list_channels(one) & channels]
        gains = self.problem.scan(fit, tried)
        circle = None
        if "grip_patch" not in known and "pose" in channels:
            circle = CircleSearch(self.problem, fit).find_best()
        gains += [] if circle is None else [circle]
        self.step()
        # Those that would be large enough to matter.
        worth = [one for one in gains if float(np.linalg.norm(one.amounts)) > one.hypothesis.finest]
        return sorted((one for one in worth if one.nats > -PENALTIES["place"]), key=lambda one: -one.nats)

    def add_greedily(self, fit: Fit) -> Fit:
        """Add the hypothesis with the largest evidence, of the best of a scan, until none has enough."""
        for _ in range(MOST_ROUNDS):
            noise, fits = self.problem.get_noise(), list[Fit]()
            for gain in self._choose_tried(self.scan(fit)):
                fits.append(self._fit_with(fit, gain))
                self.step()
            # Those whose amounts are at least the finest that may be claimed.
            large = [one for one in fits if np.linalg.norm(one.get_amounts(one.model[-1])) >= one.model[-1].finest]
            large.sort(key=lambda one: -one.evidence)
            best, best_noise = fit, noise
            for other in [one for one in large if one.evidence - fit.evidence >= ADD_NATS] or large[:1]:
                self.problem.set_noise(noise)
                better = self._fit_own_noise(other, self.problem.list_channels(other.model[-1]))
                if better.evidence > best.evidence:
                    best, best_noise = better, self.problem.get_noise()
            self.problem.set_noise(best_noise)
            if best.evidence - fit.evidence < ADD_NATS:
                self.problem.set_noise(noise)
                return fit
            fit = self.problem.fit(best.model, best.amounts)
        return fit

    def settle(self, fit: Fit) -> tuple[Fit, list[Judgement]]:
        """Judge every hypothesis; drop what predicts nothing and exchange what a competitor predicts better."""
        for turn in range(MOST_TURNS + 1):
            self.visited[fit.causes] = self.visited.get(fit.causes, 0) + 1
            self.may_change = turn < MOST_TURNS
            changed, judgements = self._judge_all(fit)
            if changed is None and turn > 0:
                changed = self._find_more(fit)
            if changed is None:
                break
            fit = self.problem.fit(changed.model, changed.amounts)
        return fit, judgements

    def _find_more(self, fit: Fit) -> Fit | None:
        """The fit with what an exchange left to explain; None where nothing enters, or only what was judged before."""
        noise, more = self.problem.get_noise(), self.add_greedily(fit)
        if self.may_change and more.causes not in self.visited:
            return more
        self.problem.set_noise(noise)
        return None

    def _may_become(self, other: Fit) -> bool:
        """Whether the search may go on from another model: two that each predict better than the other come twice."""
        return self.may_change and self.visited.get(other.causes, 0) < MOST_VISITS

    def _judge_all(self, fit: Fit) -> tuple[Fit | None, list[Judgement]]:
        """Judgements of a fit, or the better fit that one of them led to."""
        noise, judgements = self.problem.get_noise(), list[Judgement]()
        predicted = self.predict(fit)
        for hypothesis in [one for one in fit.model if not one.is_nuisance]:
            # Without a constant its laws go too, as they could take its place.
            stays = [one != hypothesis and not (one.id == hypothesis.id and hypothesis.is_catalogued)
                     for one in fit.model]  # fmt: skip
            rest = fit.amounts[np.repeat(stays, [one.size for one in fit.model])]
            without = self.problem.refit(tuple(itertools.compress(fit.model, stays)), rest, 6)
            against_none = self._compare(fit, predicted, without, None, noise)
            is_idle = against_none.nats < 0.5 * ADD_NATS or (hypothesis.penalty > 0.0 and against_none.z < DOUBT_SIGMAS)
            if is_idle and self._may_become(without):
                self.problem.set_noise(noise)
                return without, judgements
            others, gains = list[PredictiveComparison](), list[Gain]()
            if against_none.z > 1.0:  # what could take its place
                scanned = self.scan(without, self.problem.list_channels(hypothesis))
                elsewhere = [one for one in scanned if not (hypothesis.place and one.hypothesis.place)]
                gains = [one for one in elsewhere if one.hypothesis not in fit.model]
            for gain in self._choose_tried(gains):
                start = self._fit_with(without, gain)
                others.append(self._compare(fit, predicted, start, gain.hypothesis, noise))
                self.step()
                if takes_over(others[-1], gain.hypothesis, hypothesis) and self._may_become(start):
                    self.problem.set_noise(noise)
                    return start, judgements
            judgements.append(Judgement(hypothesis, against_none, tuple(others)))
            self.problem.set_noise(noise)
        return None, judgements

    def _fit_with(self, fit: Fit, gain: Gain) -> Fit:
        """The fit with a hypothesis; values of single runs are about a constant, which comes with them."""
        law = gain.hypothesis
        constants = [one for one in self.catalogue if one.id == law.id and law.law == BY_RUN and one not in fit.model]
        model = (*fit.model, *constants, law)
        common = np.repeat(gain.amounts.mean(), len(constants))
        amounts = np.concatenate([fit.amounts, common, gain.amounts - common.sum()])
        return self.problem.refit(model, self.problem.search_lines(model, amounts), 6)

    def _choose_tried(self, gains: Sequence[Gain]) -> list[Gain]:
        """The best of the gains of a scan, which are fitted."""
        return [one for one in gains[:MOST_TRIED] if one.nats >= ALIKE_SHARE * max(gains[0].nats, 1.0)]

    def _fit_own_noise(self, fit: Fit, channels: Collection[str]) -> Fit:
        """The fit with the noise of these channels fitted to it, once for every model: noise that makes up for what
        another model lacks hides by how much this one is better."""
        if fit.causes not in self.own_fits:
            for _ in range(2):
                self.problem.fit_noise(fit.residuals, channels)
                fit = self.problem.refit(fit.model, fit.amounts, 4)
            self.own_fits[fit.causes] = fit, self.problem.get_noise()
        fit, noise = self.own_fits[fit.causes]
        self.problem.set_noise(noise)
        return fit

    def _compare(
        self, fit: Fit, predicted: dict[str, Floats], other: Fit, alternative: Hypothesis | None,
        noise: dict[str, Floats],
    ) -> PredictiveComparison:  # fmt: skip
        """The predictive difference between a fit and another, which gets its own noise where the two differ."""
        channels = [c for c in CHANNELS if float(np.abs(fit.residuals[c] - other.residuals[c]).max(initial=0.0)) > 1e-9]
        self.problem.set_noise(noise)
        other = self._fit_own_noise(other, channels)
        their = self.predict(other)
        difference = np.concatenate([(predicted[c] - their[c]).ravel() for c in channels] or [np.zeros(1)])
        total = float(difference.sum())
        error = float(np.sqrt(((difference - difference.mean()) ** 2).sum()))
        self.problem.set_noise(noise)
        amounts = None if alternative is None else other.get_amounts(alternative)
        return PredictiveComparison(alternative, total, total / max(error, 1e-9), amounts)

    def predict(self, fit: Fit) -> dict[str, Floats]:
        """Log density (w, n) of every cell, given by the other windows: one Gauss-Newton step without each fold."""
        problem, data = self.problem, self.problem.data
        widths, bounds = collect_widths(fit.model), collect_bounds(fit.model)
        linear = problem.linearise(fit.model, fit.amounts, fit.residuals, 2.0 * FIT_STEP)
        # Windows of a run are in turn, each run beginning with another: every fold has starts of runs.
        window_runs = data.window_runs
        fold = np.zeros(len(window_runs), dtype=np.int64)
        for run in np.unique(window_runs):
            rows = np.flatnonzero(window_runs == run)
            fold[rows] = (np.arange(len(rows)) + run) % FOLDS
        out = {c: np.zeros_like(fit.residuals[c]) for c in CHANNELS}
        for number in range(FOLDS):
            inside = fold == number
            if not inside.any():
                continue
            moved = np.clip(fit.amounts + widths * linear.step_without(inside)[0], *bounds)
            residuals = problem.compute_residuals(fit.model, moved)
            for c in CHANNELS:
                cells = problem.noise[c].compute_cell_densities(problem.noise[c].whiten(residuals[c]))
                out[c][inside] = cells[inside]
        return out


def takes_over(comparison: PredictiveComparison, competitor: Hypothesis, hypothesis: Hypothesis) -> bool:
    """Whether a competitor takes the place of a hypothesis: a law of the same effect only where it predicts clearly
    more than the constant that it varies, as it must more than nothing."""
    is_better = comparison.nats + competitor.penalty - hypothesis.penalty < -BETTER_NATS
    if competitor.id != hypothesis.id or competitor.is_catalogued == hypothesis.is_catalogued:
        return is_better
    if competitor.is_catalogued:
        return is_better or comparison.z < DOUBT_SIGMAS
    return is_better and comparison.z <= -DOUBT_SIGMAS


def build_patch(circle: Circle) -> Hypothesis:
    """A change of grip inside a circle."""
    size = get_effect("grip_patch").size
    width, key = WIDTH_PER_TYPICAL * size.typical, ":".join(["by_place", *(f"{one:.2f}" for one in circle)])
    coordinate = Coordinate((("bend", 1.0),), width, size.low - 1.0, size.high - 1.0, key)
    return Hypothesis("grip_patch", key, (coordinate,), PENALTIES["place"], size.finest, place=circle)


def list_circles(data: DriveData) -> list[Circle]:
    """The circles from which a search for places begins: all over the driving."""
    east, north = data.path["east"], data.path["north"]
    return [
        (float(x), float(y), radius)
        for radius in PATCH_RADII_M
        for x in np.arange(east.min(), east.max() + 1.0, SPACING * radius)
        for y in np.arange(north.min(), north.max() + 1.0, SPACING * radius)
    ]


def holds_driving(inside: Flags) -> bool:
    """Whether enough steps of the path are inside a circle, and enough outside, for it to be a place."""
    return bool(inside.sum() >= round(LASTING_S / PATH_STEP_S) and inside.mean() <= LARGEST_PATCH_SHARE)


def find_straightest_circle(data: DriveData, bases: Bases) -> Circle | None:
    """The circle in which the path turns least: a change of grip shows least there. None of few steps is a place."""
    turning = np.square(data.path["speed"] * data.path["steady"])
    sides = [(circle, bases.find_circle(*circle)) for circle in list_circles(data)]
    turned = [(float(turning[inside].sum()), circle) for circle, inside in sides if holds_driving(inside)]
    return min(turned)[1] if turned else None


@dataclass(eq=False)
class CircleSearch:
    """Scores circles beside a fit by what they add to the yaw rate, all at once."""

    problem: Problem
    fit: Fit

    def __post_init__(self) -> None:
        problem, fit = self.problem, self.fit
        self.noise = problem.noise["pose"]
        response = build_yaw_response(problem.data, problem.rig.tractor.antenna_forward_m)
        # The turning of the fit, not that which was measured: a circle changes only what the wheels turn.
        heading = cut_motion(problem.data)[1] - fit.residuals["pose"][:, 2 * POSE_CELLS :]
        yaw = np.gradient(heading, POSE_CELL_S, axis=1)
        linear = problem.linearise_inside(fit)
        root = linear.roots["pose"][:, None, None]
        self.response = root * self.noise.whiten(response * yaw[:, None, :])
        self.rest = (root[:, :, 0] * linear.residuals["pose"]).ravel()
        self.inverse = linear.inverse
        self.known = (root * linear.changes["pose"]).reshape(len(self.rest), -1)
        # Directions that the model explains already, also by other channels, take their part of the rest.
        self.slope = linear.matrix.T @ linear.target

    def find_best(self) -> Gain | None:
        """The best circle, moved and resized until nothing is gained."""
        best, move = self._choose(list_circles(self.problem.data)), FIRST_MOVE_M
        while best is not None and move >= FINEST_MOVE_M:
            east, north, radius = best[1]
            near = [(east + i * move, north + j * move, max(radius + k * move, SMALLEST_RADIUS_M))
                    for i, j, k in MOVES]  # fmt: skip
            other = self._choose(near)
            if other is not None and other[0] > best[0] + 0.1:
                best = other
            else:
                move *= 0.5
        if best is None:
            return None
        patch = build_patch(best[1])
        return Gain(best[0] - patch.penalty, patch, np.array([best[2] * patch.coordinates[0].width]))

    def _choose(self, circles: Sequence[Circle]) -> tuple[float, Circle, float] | None:
        """The best of some circles: nats, the circle, and its amount in widths."""
        kept, columns = [], []
        for circle in circles:
            inside = self.problem.bases.find_circle(*circle)
            if holds_driving(inside):
                kept.append(circle)
                columns.append(self.problem.data.cut(inside.astype(np.float64), POSE_CELLS))
        if not kept:
            return None
        width = WIDTH_PER_TYPICAL * get_effect("grip_patch").size.typical
        own = np.stack(columns, axis=2)
        values = width * (self.response @ own).reshape(len(self.rest), -1)
        crossed = self.known.T @ values
        curvature = (values * values).sum(axis=0) - (crossed * (self.inverse @ crossed)).sum(axis=0) + 1.0
        slope = values.T @ self.rest - crossed.T @ (self.inverse @ self.slope)
        nats = 0.5 * slope * slope / curvature - 0.5 * np.log(curvature)
        place = int(np.argmax(nats))
        return float(nats[place]), kept[place], float(slope[place] / curvature[place])
