"""Errors that positions show and headings do not: of a receiver without a fix, under trees, or on a swaying antenna.

What turns the tractor turns its headings too. Where headings turn as the wheel angles say, and positions leave the path
that headings and speeds lead along, the positions are wrong. Where they are right, headings lead along their path.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from vehicle.identification.cause_selection.covariates import (
    EXTRA_ANGLE,
    GRIP_CHANGE,
    ErrorCovariate,
    PathResponse,
    TermIncrements,
    compute_curvature_per_angle,
)
from vehicle.identification.diagnosis.results import Hint
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.laws.settle import HEADING_WINDOW_S, LEAST_HEADING_SHARE, measure_turned_share
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.residuals.innovations import PoseIncrements
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effect_kinds import INTERVAL_SIGMAS
from vehicle.model.tractor import Settings

WANDER_WINDOW_S, FEWEST_WINDOW_ROWS = 10.0, 8  # chosen: sums of headings and speeds stay right within centimetres
FEWEST_WINDOWS = 6
# Chosen, times the noise of headings: on even ground it is 1.8, and with more they do not turn as the wheels say.
MOST_TURN_NOISES = 2.5
# Chosen, m, beyond the noise from row to row and more than it: a receiver with a fix drifts by 1.4 cm in a window.
LEAST_WANDER_M = 0.017
SHOWN_QUANTILE = 0.95  # chosen: what positions wander by at most, but for single rows


def describe_wander(wander_m: float) -> Hint:
    """Return the hint on positions that wander by so much."""
    words = (
        f"The positions wander by up to {100.0 * wander_m:.0f} cm within {WANDER_WINDOW_S:.0f} s while headings and "
        "wheel angles agree, as of a receiver without a fix, of trees, or of an antenna that sways."
    )
    return Hint(None, "position", None, words)


class HeadingWitness:
    """What measured headings say about the error of positions, and about what it seems to depend on."""

    def __init__(self, residual_model: ResidualModel, fit: EffectFit, found: Settings) -> None:
        """`fit` is what covariates are scored beside, `found` the values of what was found."""
        self.residual_model, self.fit = residual_model, fit
        self.found = {name: value for name, value in found.items() if name not in TERMS_BY_NAME}

    @cached_property
    def wander_m(self) -> float | None:
        """How far positions alone wander; None where they do not, and where logs cannot tell."""
        segments = self.residual_model.dataset.segments
        if not all(segment.heading_measured and segment.speed_measured for segment in segments):
            return None
        increments = self.residual_model.simulate_increments(self.found)
        if not do_headings_agree(segments, increments):
            return None
        return measure_wander(segments, increments)

    def contradicts(self, covariate: ErrorCovariate) -> bool:
        """Whether headings do not turn as a covariate says: they agree with the wheel angles, or show little of it."""
        if covariate.changed_quantity not in (EXTRA_ANGLE, GRIP_CHANGE):
            return False
        if self.wander_m is not None:
            return True
        share, error = self.measure_share(covariate)
        return share + INTERVAL_SIGMAS * error < LEAST_HEADING_SHARE

    def measure_share(self, covariate: ErrorCovariate) -> tuple[float, float]:
        """Return how much of what a covariate would turn measured headings show (1: all), and its standard error."""
        response, segments = self._response, self.residual_model.dataset.segments
        terms = [
            covariate.make_increments(segment, increments, compute_curvature_per_angle(self.residual_model, segment))
            for segment, increments in zip(segments, response.increments, strict=True)
        ]
        runs = [segment.run if covariate.per_run else 0 for segment in segments]
        amounts = {run: self._fit_amounts(terms, [one == run for one in runs]) for run in set(runs)}
        extra = [
            amounts[run] @ np.stack([term.turned for term in parts]) for run, parts in zip(runs, terms, strict=True)
        ]
        return measure_turned_share(segments, response.increments, extra)

    @cached_property
    def _response(self) -> PathResponse:
        return PathResponse(self.residual_model, self.fit)

    def _fit_amounts(self, terms: Sequence[TermIncrements], is_in: Sequence[bool]) -> Array:
        """Return the amounts (c,) of columns that lower the residuals of some segments most."""
        chosen = np.flatnonzero(is_in).tolist()
        columns = np.concatenate([self._response.compute_columns(index, terms[index]) for index in chosen])
        residuals = np.concatenate([self.fit.residuals[self._response.places[index]] for index in chosen])
        return np.asarray(-np.linalg.lstsq(columns, residuals, rcond=1e-9)[0])


def do_headings_agree(segments: Sequence[DriveSegment], increments: Sequence[PoseIncrements]) -> bool:
    """Whether headings turn within windows as simulated from the wheel angles, but for their noise."""
    turns, noise = [np.zeros(0)], [np.zeros(0)]
    for segment, moved in zip(segments, increments, strict=True):
        edges = np.flatnonzero(np.diff(np.floor(segment.time / HEADING_WINDOW_S), prepend=-1.0))
        apart = np.diff(segment.heading) - moved.turned
        turns.append(np.add.reduceat(apart, edges[:-1]) if len(edges) > 1 else np.zeros(0))
        noise.append(np.diff(apart))
    # The turn of a window has the noise of two headings, a change of the turn from row to row that of six.
    white = 1.4826 * float(np.median(np.abs(np.concatenate(noise)))) / math.sqrt(6.0)
    own = np.concatenate(turns)
    return len(own) > 0 and float(np.sqrt(np.mean(own**2))) <= MOST_TURN_NOISES * math.sqrt(2.0) * white


def measure_wander(segments: Sequence[DriveSegment], increments: Sequence[PoseIncrements]) -> float | None:
    """Return how far (m) positions stray across the path along which headings and speeds lead; None if by noise alone.

    Straight lines in time are none, nor are an antenna elsewhere, a delay, a heading bias and a scale of the speed,
    each for one run.
    """
    windows: dict[int, list[tuple[Array, Array, Array]]] = {}
    for segment, moved in zip(segments, increments, strict=True):
        windows.setdefault(segment.run, []).extend(_split_windows(segment, moved))
    if sum(map(len, windows.values())) < FEWEST_WINDOWS:
        return None
    across = np.concatenate([_measure_across(of_run) for of_run in windows.values() if of_run])
    noise_m = _measure_position_noise(segments)
    is_clear = float(np.mean(across**2)) - noise_m**2 > max(LEAST_WANDER_M, noise_m) ** 2
    return float(np.quantile(np.abs(across), SHOWN_QUANTILE)) if is_clear else None


def _measure_across(windows: Sequence[tuple[Array, Array, Array]]) -> Array:
    """Return how far to the left of the path positions of one run stray (k,), without what known causes explain."""
    strayed, causes, headings = (np.concatenate(columns, axis=0) for columns in zip(*windows, strict=True))
    amounts = np.linalg.lstsq(causes.reshape(-1, causes.shape[2]), strayed.ravel(), rcond=1e-9)[0]
    left = strayed - causes @ amounts
    return np.asarray(left[:, 1] * np.cos(headings) - left[:, 0] * np.sin(headings))


def _split_windows(segment: DriveSegment, moved: PoseIncrements) -> list[tuple[Array, Array, Array]]:
    """Return per window where positions are beside the sum of steps (k, 2), what known causes add to that (k, 2, c),
    both without straight lines in time, and headings (k,)."""
    heading = segment.heading
    middle = 0.5 * (heading[1:] + heading[:-1])
    cosine, sine = np.cos(middle), np.sin(middle)
    steps = np.stack([moved.ahead * cosine + moved.aside * sine, moved.ahead * sine - moved.aside * cosine], axis=1)
    summed = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    to_right = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    velocity = segment.speed[:, None] * ahead
    turned = np.stack([-summed[:, 1], summed[:, 0]], axis=1)
    causes = np.stack([ahead, to_right, velocity, turned, summed], axis=2)
    beside = np.stack([segment.east, segment.north], axis=1) - summed
    number, windows = np.floor(segment.time / WANDER_WINDOW_S), []
    for one in np.unique(number):
        rows = np.flatnonzero(number == one)
        seconds = segment.time[rows]
        if len(rows) >= FEWEST_WINDOW_ROWS and seconds[-1] - seconds[0] > 0.7 * WANDER_WINDOW_S:
            lines = np.stack([np.ones(len(rows)), seconds - seconds.mean()], axis=1)
            flat = np.concatenate([beside[rows][:, :, None], causes[rows]], axis=2).reshape(len(rows), -1)
            flat = flat - lines @ np.linalg.lstsq(lines, flat, rcond=None)[0]
            both = flat.reshape(len(rows), 2, -1)
            windows.append((both[:, :, 0], both[:, :, 1:], heading[rows]))
    return windows


def _measure_position_noise(segments: Sequence[DriveSegment]) -> float:
    """Return the noise of positions from row to row (m, of one axis)."""
    changes = [np.diff(axis, 2) for segment in segments for axis in (segment.east, segment.north)]
    return 1.4826 * float(np.median(np.abs(np.concatenate(changes)))) / math.sqrt(6.0)
