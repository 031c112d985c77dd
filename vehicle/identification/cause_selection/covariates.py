"""Unnamed error terms (covariates): what an error depends on when no effect of the catalogue explains it, and the
unknowns of any tractor.

Each covariate bends the path, changes the grip, pushes the tractor or changes its speed in proportion to a regressor.
Covariates compete with the catalogue: where one explains clearly more than any named effect, a name would be wrong, and
the dependence is reported instead.

Unknowns are free in every fit within the differences between tractors: the base model has tyres of an assumed
stiffness, turns at once with its wheels, and takes the measured speed as current. Each difference is a column whose
amount has mean 0 and standard deviation 1 over tractors. Without them such a difference looks like an effect: stiffer
tyres like understeer and a shifted antenna.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.identification.fit.column_products import multiply_columns, sum_column_squares
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.rig import ReplayRig, compute_antenna_lever
from vehicle.identification.residuals.innovations import PoseIncrements, compute_innovations, compute_turn_responses
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import SENSOR_TIMING_S
from vehicle.model.effects import PATH, SPEED, compute_effect_fields
from vehicle.records import GRAVITY_MPS2
from vehicle.sim.calibration import CIRCLE_SPEED_MPS

# From periods that a tractor can follow to long runs; neighbours a tenth apart are equivalent.
PERIODS_S = tuple(np.geomspace(2.5, 80.0, 36).tolist())
FEWEST_ROWS_PER_PERIOD = 8.0  # periods: chosen, with fewer a wave cannot be distinguished from another
LONGEST_PERIOD = 1.3  # of the longest run: chosen, longer ones are straight lines
# Terms, and terms times rows: chosen, 80 MB of columns; more save no time.
MOST_TERMS_TOGETHER, MOST_COLUMN_ROWS = 8, 200_000
LEAST_COLUMN_CHANGE = 1e-12  # of any residual by a column: smaller ones are rounding
DISTANCE_CHANGE, ALWAYS = "a change of the distance driven", "always"
TermIncrements = list[PoseIncrements]
ColumnProducts = tuple[Array, Array, Array]
IncrementMaker = Callable[[DriveSegment, PoseIncrements, Array], TermIncrements]
EXTRA_ANGLE, GRIP_CHANGE = "an extra wheel angle", "a change of grip"


@dataclass(frozen=True)
class ErrorCovariate:
    """A covariate: its regressor, what it changes, its columns, and whether it is free in every run."""

    regressor: str
    changed_quantity: str
    make_increments: IncrementMaker
    per_run: bool = False

    @property
    def description(self) -> str:
        """The covariate as a clause."""
        return (
            self.changed_quantity
            if self.regressor == ALWAYS
            else f"{self.changed_quantity} that depends on {self.regressor}"
        )

    @property
    def block(self) -> str:
        """Block of the chain that it would belong to."""
        return SPEED if self.changed_quantity == DISTANCE_CHANGE else PATH


def make_wheel_angle_increments(increments: PoseIncrements, regressor: Array, per_angle: Array) -> PoseIncrements:
    """Return the motion of an extra wheel angle (rad, to the right), which causes `curvature_per_angle`."""
    zero = np.zeros_like(increments.ahead)
    distance = np.copysign(
        np.hypot(increments.ahead, increments.aside), increments.ahead
    )  # in reverse it turns the other way
    return PoseIncrements(zero, zero, -regressor * distance * per_angle)


def compute_curvature_per_angle(residual_model: ResidualModel, segment: DriveSegment) -> Array:
    """Return the curvature per wheel angle (1/m per rad), averaged over a degree each way because measured radii are
    singular at 0."""
    rig, angle = residual_model.rig, get_steering(segment)
    grid = np.linspace(-rig.tractor.max_steering_deg, rig.tractor.max_steering_deg, len(rig.table))
    tangents = [np.tan(np.interp(np.degrees(angle) + shift, grid, rig.table)) for shift in (-1.0, 1.0)]
    slope: Array = (tangents[1] - tangents[0]) / np.radians(2.0) / rig.tractor.wheelbase_m
    return slope


def make_curvature_share_increments(increments: PoseIncrements, regressor: Array) -> PoseIncrements:
    """Return the motion of an extra share of the curvature."""
    zero = np.zeros_like(increments.ahead)
    return PoseIncrements(zero, zero, regressor * increments.turned)


def _make_drift_increments(segment: DriveSegment, east: float, north: float) -> PoseIncrements:
    """Return the motion of a push of 1 m/s over the ground while the tractor moves."""
    dt, heading = np.diff(segment.time), segment.heading[:-1]
    moving = np.tanh(np.abs(segment.speed[:-1]) / 0.1) * dt
    cosine, sine = np.cos(heading), np.sin(heading)
    zero = np.zeros_like(moving)
    return PoseIncrements((east * cosine + north * sine) * moving, (east * sine - north * cosine) * moving, zero)


def _make_distance_increments(increments: PoseIncrements, regressor: Array) -> PoseIncrements:
    zero = np.zeros_like(increments.ahead)
    return PoseIncrements(regressor * increments.ahead, zero, zero)


def _get_speed(segment: DriveSegment) -> Array:
    return segment.speed_in_gear[:-1]


def get_steering(segment: DriveSegment) -> Array:
    """Return the measured wheel angle, or else the commanded one, between rows (k - 1,), rad to the right."""
    angle = segment.wheel if segment.wheel is not None else segment.command
    assert angle is not None
    return angle[:-1]


def _compute_steering_rate(segment: DriveSegment) -> Array:
    angle = segment.wheel if segment.wheel is not None else segment.command
    assert angle is not None
    rate: Array = np.gradient(angle, segment.time)[:-1]
    return rate


def _build_periodic_covariates(period: float, longest: float) -> list[ErrorCovariate]:
    def make_bends(segment: DriveSegment, increments: PoseIncrements, curvature_per_angle: Array) -> TermIncrements:
        phase = 2.0 * np.pi * segment.time[:-1] / period
        return [make_wheel_angle_increments(increments, wave(phase), curvature_per_angle) for wave in (np.sin, np.cos)]

    def make_grip_changes(
        segment: DriveSegment, increments: PoseIncrements, curvature_per_angle: Array
    ) -> TermIncrements:
        phase = 2.0 * np.pi * segment.time[:-1] / period
        return [make_curvature_share_increments(increments, wave(phase)) for wave in (np.sin, np.cos)]

    is_periodic = period <= 0.5 * longest
    regressor = f"time, repeating every {period:.1f} s" if is_periodic else "time, changing slowly during a run"
    return [
        ErrorCovariate(regressor, EXTRA_ANGLE, make_bends, True),
        ErrorCovariate(regressor, GRIP_CHANGE, make_grip_changes, True),
    ]


def list_covariates(residual_model: ResidualModel) -> list[ErrorCovariate]:
    """Return all covariates that the data could show."""
    terms = [
        ErrorCovariate("speed", EXTRA_ANGLE, lambda s, m, b: [make_wheel_angle_increments(m, _get_speed(s), b)]),
        ErrorCovariate(
            "the square of speed", EXTRA_ANGLE, lambda s, m, b: [make_wheel_angle_increments(m, _get_speed(s) ** 2, b)]
        ),
        ErrorCovariate(
            "time since the start",
            EXTRA_ANGLE,
            lambda s, m, b: [make_wheel_angle_increments(m, s.start_s + s.time[:-1], b)],
        ),
        ErrorCovariate(
            "the direction of travel",
            EXTRA_ANGLE,
            lambda s, m, b: [
                make_wheel_angle_increments(m, np.cos(s.heading[:-1]), b),
                make_wheel_angle_increments(m, np.sin(s.heading[:-1]), b),
            ],
        ),
        ErrorCovariate("speed", GRIP_CHANGE, lambda s, m, b: [make_curvature_share_increments(m, _get_speed(s))]),
        ErrorCovariate(
            "the size of the wheel angle",
            GRIP_CHANGE,
            lambda s, m, b: [make_curvature_share_increments(m, np.abs(get_steering(s)))],
        ),
        ErrorCovariate(
            "the implement", GRIP_CHANGE, lambda s, m, b: [make_curvature_share_increments(m, s.working[:-1])]
        ),
        ErrorCovariate(
            "the direction of travel",
            GRIP_CHANGE,
            lambda s, m, b: [
                make_curvature_share_increments(m, np.cos(s.heading[:-1])),
                make_curvature_share_increments(m, np.sin(s.heading[:-1])),
            ],
        ),
        ErrorCovariate(
            "the rate of steering",
            EXTRA_ANGLE,
            lambda s, m, b: [make_wheel_angle_increments(m, _compute_steering_rate(s), b)],
        ),
        ErrorCovariate(
            "the direction of travel and the driving time",
            "a push over the ground",
            lambda s, m, b: [_make_drift_increments(s, 1.0, 0.0), _make_drift_increments(s, 0.0, 1.0)],
        ),
        ErrorCovariate("speed", DISTANCE_CHANGE, lambda s, m, b: [_make_distance_increments(m, _get_speed(s))]),
        ErrorCovariate(ALWAYS, DISTANCE_CHANGE, lambda s, m, b: [_make_distance_increments(m, np.ones(s.rows - 1))]),
        ErrorCovariate(
            "the wheel angle", DISTANCE_CHANGE, lambda s, m, b: [_make_distance_increments(m, np.abs(get_steering(s)))]
        ),
    ]
    if not all(segment.speed_measured for segment in residual_model.dataset.segments):
        terms = [covariate for covariate in terms if covariate.changed_quantity != DISTANCE_CHANGE]
    longest = max(segment.time[-1] for segment in residual_model.dataset.segments)
    row_s = max(float(np.median(np.diff(segment.time))) for segment in residual_model.dataset.segments)
    fastest = FEWEST_ROWS_PER_PERIOD * row_s
    for period in PERIODS_S:
        if fastest < period < LONGEST_PERIOD * longest:
            terms += _build_periodic_covariates(period, longest)
    return terms


@dataclass(frozen=True, eq=False)
class CovariateScore:
    """How much of the residuals a covariate explains beyond the fit."""

    covariate: ErrorCovariate
    gain: float
    freedoms: int


def score_covariates(residual_model: ResidualModel, fit: EffectFit) -> list[CovariateScore]:
    """Return the gains of all covariates, the largest first."""
    response = PathResponse(residual_model, fit)
    curvatures = [compute_curvature_per_angle(residual_model, segment) for segment in residual_model.dataset.segments]
    ranked = []
    covariates, together = list_covariates(residual_model), _compute_covariate_batch_size(residual_model)
    for batch in (covariates[first : first + together] for first in range(0, len(covariates), together)):
        parts = []
        for index, (segment, increments, curvature) in enumerate(
            zip(residual_model.dataset.segments, response.increments, curvatures, strict=True)
        ):
            parts.append(
                response.compute_term_products(
                    index, [covariate.make_increments(segment, increments, curvature) for covariate in batch]
                )
            )
        for covariate, products in zip(batch, zip(*parts, strict=True), strict=True):
            ranked.append(CovariateScore(covariate, *response.compute_covariate_gain(products, covariate.per_run)))
    return sorted(ranked, key=lambda one: one.freedoms - one.gain)


def _compute_covariate_batch_size(residual_model: ResidualModel) -> int:
    """Return how many covariates are filtered at once."""
    longest = max(segment.rows for segment in residual_model.dataset.segments)
    return max(min(MOST_TERMS_TOGETHER, MOST_COLUMN_ROWS // longest), 1)


def compute_covariate_columns(residual_model: ResidualModel, fit: EffectFit, covariate: ErrorCovariate) -> Array:
    """Return the change of all residuals per unit of each column of a covariate (n, c)."""
    response, segments_of_dataset = PathResponse(residual_model, fit), residual_model.dataset.segments
    parts = [
        response.compute_columns(
            index, covariate.make_increments(segment, increments, compute_curvature_per_angle(residual_model, segment))
        )
        for index, (segment, increments) in enumerate(zip(segments_of_dataset, response.increments, strict=True))
    ]
    runs, run_columns = [segment.run if covariate.per_run else 0 for segment in segments_of_dataset], []
    for run in sorted(set(runs)):
        run_parts = [
            (place, part)
            for place, part, run_of_part in zip(response.places, parts, runs, strict=True)
            if run_of_part == run
        ]
        columns_of_run = np.zeros((parts[0].shape[1], 5 * residual_model.dataset.rows))
        for place, part in run_parts:
            columns_of_run[:, place] = part.T
        run_columns.append(
            columns_of_run[np.max([np.abs(part).max(axis=0) for _, part in run_parts], axis=0) > LEAST_COLUMN_CHANGE]
        )
    return np.concatenate(run_columns).T


class PathResponse:
    """Response of the path residuals to small changes of the simulated motion, segment by segment."""

    def __init__(self, residual_model: ResidualModel, fit: EffectFit) -> None:
        """Replay the fit once."""
        self.residual_model, self.fit = residual_model, fit
        self.increments = residual_model.simulate_increments(fit.settings)
        fields = compute_effect_fields(fit.settings)
        self.lever, self.bias = compute_antenna_lever(residual_model.rig, fields), fields["heading_bias"]
        self.current_residuals = [self._compute_residuals(index, move) for index, move in enumerate(self.increments)]
        ends = np.cumsum([3 * segment.rows for segment in residual_model.dataset.segments])
        self.places = [
            slice(int(end) - 3 * s.rows, int(end)) for end, s in zip(ends, residual_model.dataset.segments, strict=True)
        ]
        self.inverse = np.linalg.pinv(multiply_columns(fit.jacobian, fit.jacobian), rcond=1e-12, hermitian=True)
        self.side = multiply_columns(fit.jacobian, fit.residuals)

    def _compute_residuals(self, index: int, increments: PoseIncrements) -> Array:
        segment, path_filter = self.residual_model.dataset.segments[index], self.residual_model.filters[index]
        out = np.empty((segment.rows, 3))
        compute_innovations(
            path_filter.memory_shares,
            segment.east,
            segment.north,
            segment.heading,
            increments.ahead,
            increments.aside,
            increments.turned,
            *self.lever,
            self.bias,
            path_filter.gains,
            path_filter.roots,
            out,
        )
        out[0] = 0.0
        return out.ravel()

    def compute_columns(self, index: int, terms: TermIncrements) -> Array:
        """Return the columns of one segment (3 k, c); the filter is linear, so any size of a term will do."""
        is_on_the_way = np.array([term.ahead.any() or term.aside.any() for term in terms])
        if not is_on_the_way.any():
            return self._compute_turn_columns(index, terms)
        out = np.empty((3 * self.residual_model.dataset.segments[index].rows, len(terms)))
        for is_moved, make_columns in ((True, self._compute_increment_columns), (False, self._compute_turn_columns)):
            term_numbers = np.flatnonzero(is_on_the_way == is_moved)
            if len(term_numbers):
                out[:, term_numbers] = make_columns(index, [terms[place] for place in term_numbers])
        return out

    def _compute_turn_columns(self, index: int, terms: TermIncrements) -> Array:
        return self.compute_turn_responses(index, np.stack([term.turned for term in terms]))

    def compute_turn_responses(self, index: int, turns: Array, first: int = 0) -> Array:
        """Return the columns (3 k, c) of one segment for turns (c, k - 1) added to those of its rows, from a row on."""
        segment, increments, path_filter = (
            self.residual_model.dataset.segments[index],
            self.increments[index],
            self.residual_model.filters[index],
        )
        rows = slice(first, first + turns.shape[1] + 1)
        out = np.zeros((turns.shape[1] + 1, 3, len(turns)))
        compute_turn_responses(
            segment.time[rows],
            segment.heading[rows],
            increments.ahead[rows],
            increments.aside[rows],
            *self.lever,
            path_filter.gains[rows],
            path_filter.roots[rows],
            turns,
            out,
        )
        return out.reshape(-1, len(turns))

    def _compute_increment_columns(self, index: int, terms: TermIncrements) -> Array:
        increments, current_residuals = self.increments[index], self.current_residuals[index]
        parts = []
        for term in terms:
            moved_increments = PoseIncrements(
                increments.ahead + term.ahead, increments.aside + term.aside, increments.turned + term.turned
            )
            parts.append(self._compute_residuals(index, moved_increments) - current_residuals)
        return np.stack(parts, axis=1)

    def compute_term_products(self, index: int, term_lists: Sequence[TermIncrements]) -> list[ColumnProducts]:
        """Return the products of the columns of several lists of terms in one segment, per list."""
        columns = np.asfortranarray(self.compute_columns(index, [term for terms in term_lists for term in terms]))
        place = self._find_residual_slice(index, columns, 0)
        side, cross = multiply_columns(columns, self.fit.residuals[place]), self._multiply_with_fit(columns, place)
        ends = np.cumsum([len(terms) for terms in term_lists])
        column_slices = [slice(int(end) - len(terms), int(end)) for end, terms in zip(ends, term_lists, strict=True)]
        parts = [columns[:, column_slice] for column_slice in column_slices]
        return [
            (multiply_columns(part, part), side[column_slice], cross[column_slice])
            for part, column_slice in zip(parts, column_slices, strict=True)
        ]

    def compute_column_products(self, index: int, columns: Array, first: int = 0) -> ColumnProducts:
        """As compute_products, for every column alone: squares (c,), products with the residuals (c,) and with the fit
        (c, m)."""
        place, columns = self._find_residual_slice(index, columns, first), np.asfortranarray(columns)
        return (
            sum_column_squares(columns),
            multiply_columns(columns, self.fit.residuals[place]),
            self._multiply_with_fit(columns, place),
        )

    def compute_joint_products(self, index: int, columns: Array, first: int = 0) -> ColumnProducts:
        """Return squares of columns (3 k, c), products with the residuals and with the columns of the fit, for one
        segment.

        The columns are those of its rows from `first` on.
        """
        place, columns = self._find_residual_slice(index, columns, first), np.asfortranarray(columns)
        return (
            multiply_columns(columns, columns),
            multiply_columns(columns, self.fit.residuals[place]),
            self._multiply_with_fit(columns, place),
        )

    def _find_residual_slice(self, index: int, columns: Array, first: int) -> slice:
        """Return the residuals to which columns of one segment belong, from a row on."""
        start = self.places[index].start + 3 * first
        return slice(start, start + len(columns))

    def _multiply_with_fit(self, columns: Array, place: slice) -> Array:
        """Return products (c, m) with the columns of the fit in a part of the residuals, which are indexed once."""
        key = place.start, place.stop
        if key not in self._jacobian_parts:
            jacobian = self.fit.jacobian[place]
            nonzero_columns = np.flatnonzero(jacobian.any(axis=0))  # many belong to one run alone
            self._jacobian_parts[key] = nonzero_columns, np.asfortranarray(jacobian[:, nonzero_columns])
        nonzero_columns, fit_columns = self._jacobian_parts[key]
        out = np.zeros((columns.shape[1], self.fit.jacobian.shape[1]))
        out[:, nonzero_columns] = multiply_columns(columns, fit_columns)
        return out

    @cached_property
    def _jacobian_parts(self) -> dict[tuple[int, int], tuple[npt.NDArray[np.int64], Array]]:
        """Columns of the fit that are not 0 in a part of the residuals, and their indices."""
        return {}

    def compute_covariate_gain(self, parts: Sequence[ColumnProducts], per_run: bool) -> tuple[float, int]:
        """Return the loss that columns remove beyond the fit, from their products per segment, and the number of free
        amounts."""
        square, side, cross = (np.stack([part[k] for part in parts]) for k in range(3))
        if per_run:
            return float(compute_explained_loss(square, side).sum()), side.size
        return self.compute_gain_beyond_fit(square.sum(axis=0), side.sum(axis=0), cross.sum(axis=0)), side.shape[1]

    def compute_gain_beyond_fit(self, square: Array, side: Array, cross: Array) -> float:
        """Return the explained loss after the columns of the fit have taken their share."""
        share = cross @ self.inverse
        return float(compute_explained_loss(square - share @ cross.T, side - share @ self.side))


def compute_explained_loss(square: Array, side: Array) -> Array:
    """Return the loss (...) that columns remove, from their products (..., c, c) and with the residuals (..., c)."""
    scale = np.sqrt(np.maximum(np.diagonal(square, axis1=-2, axis2=-1), 1e-12))
    scaled = side / scale
    if side.shape[-1] == 1:
        size = square[..., 0, 0] / scale[..., 0] ** 2
        return np.asarray(np.where(size > 0.0, scaled[..., 0] ** 2 / np.where(size > 0.0, size, 1.0), 0.0))
    unit = square / (scale[..., :, None] * scale[..., None, :])
    inverse = np.linalg.pinv(unit, rcond=1e-6, hermitian=True)
    return np.asarray(np.einsum("...i,...ij,...j", scaled, inverse, scaled))


LEAST_SPEED_SHARE = 0.1  # of the speed of circles: at lower speeds the path shows little of its curvature


def compute_tractor_difference_columns(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return columns (n, 3) of the residuals, each per usual difference: tyre slip, lag of turning, lag of the speed.

    The prior (amounts about 0) is written into the first rows of the segments, which carry no information: together
    they have a residual of 1 for an amount of 1.
    """
    response, rows = PathResponse(residual_model, fit), residual_model.dataset.rows
    segments = residual_model.dataset.segments
    path = [
        response.compute_columns(
            index, _make_tractor_difference_increments(residual_model.rig, segment, response.increments[index])
        )
        for index, segment in enumerate(segments)
    ]
    out = np.concatenate([*path, np.zeros((2 * rows, path[0].shape[1]))])
    expected = 1.0 / math.sqrt(len(segments))
    for place in response.places:
        out[place.start : place.start + 3] = expected * np.eye(3)
    return out


def _make_tractor_difference_increments(
    rig: ReplayRig, segment: DriveSegment, increments: PoseIncrements
) -> TermIncrements:
    """Return the motion between rows of the usual differences: stiffer tyres, a turn ahead and a speed ahead.

    Tyres without any slip differ from those of the base model by as much as tyres twice as soft. They keep the measured
    radius at the speed of the circles it was measured on.
    """
    dt, zero = np.diff(segment.time), np.zeros_like(increments.ahead)
    spin, pace = increments.turned / dt, increments.ahead / dt
    front, rear, wheelbase_m = (
        float(rig.ground["front_slope"][0]),
        float(rig.ground["rear_slope"][0]),
        rig.tractor.wheelbase_m,
    )
    bend = np.divide(spin, pace, out=zero.copy(), where=np.abs(pace) > CIRCLE_SPEED_MPS * LEAST_SPEED_SHARE)
    inward_slip = spin * pace / (GRAVITY_MPS2 * rear) * increments.ahead
    speed_excess = bend * (pace * pace - CIRCLE_SPEED_MPS**2)
    less_lost = (
        speed_excess * (1.0 / front - 1.0 / rear) / GRAVITY_MPS2 * (1.0 + (bend * wheelbase_m) ** 2) / wheelbase_m
    )
    return [
        PoseIncrements(zero, -inward_slip, less_lost * increments.ahead),
        PoseIncrements(zero, zero, SENSOR_TIMING_S * np.gradient(spin, segment.time[:-1]) * dt),
        PoseIncrements(SENSOR_TIMING_S * np.gradient(pace, segment.time[:-1]) * dt, zero, zero),
    ]
