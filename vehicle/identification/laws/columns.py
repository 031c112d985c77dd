"""Changes of the residuals when the value of a parameter changes with a quantity.

Effects of the path change the simulated motion between two rows: its change per unit of the constant value times the
quantity runs through the filter of the residuals. For other effects the change of the residuals themselves is
multiplied row by row: exact for the wheel and the speed, and for an instrument as long as the quantity changes more
slowly than the filter forgets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vehicle.identification.cause_selection.covariates import PathResponse
from vehicle.identification.fit.effect_parameters import EffectParameters, build_parameters, find_finest_size
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.laws.bases import (
    BY_ANGLE,
    BY_IMPLEMENT,
    BY_PLACE,
    BY_SIDE,
    BY_SPEED,
    LawBasis,
    build_group_basis,
)
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.residuals.innovations import PoseIncrements
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import BEGINS_TO_SLIDE_SHARE, OUTLIER_SIGMAS
from vehicle.model.effects import PATH, POSITION, STEERING, get_effect
from vehicle.records import GRAVITY_MPS2

SIDE_SLIP = "side_slip"
GAIN, OFFSET, HEADING = "steering_gain", "steering_offset", "heading_bias"
ALWAYS_TESTED = (GAIN, OFFSET, HEADING)  # what may change although its mean is neutral
SMALL_SHARE = 0.5  # chosen, of the tolerance of an effect: a motion to which the filter responds linearly
STEP_SHARE = 0.1  # chosen, of the typical size: a change of the motion by far more than rounding, and nearly linear
# Laws that are effects of their own (asymmetry, implement draft and slip, understeer), or that a geometry cannot have.
EXCLUDED_KINDS = {
    GAIN: {BY_SIDE},
    OFFSET: {BY_SIDE, BY_ANGLE, BY_IMPLEMENT},
    "steering_asymmetry": {BY_SIDE, BY_ANGLE},
    "steering_backlash": {BY_SIDE, BY_ANGLE, BY_PLACE},
    "understeer": {BY_SPEED, BY_SIDE, BY_ANGLE},
    "side_slip": {BY_SPEED, BY_SIDE, BY_ANGLE},
    "implement_side_draft": {BY_IMPLEMENT, BY_SIDE, BY_ANGLE},
    "cross_slope_drift": {BY_SIDE, BY_ANGLE, BY_SPEED},
    "wheel_slip": {BY_IMPLEMENT, BY_SIDE, BY_ANGLE},
    "implement_slip": {BY_IMPLEMENT, BY_SIDE, BY_ANGLE},
    "speed_lag": {BY_SIDE, BY_ANGLE, BY_SPEED, BY_PLACE},
}
INSTRUMENT_EXCLUDED_KINDS = {BY_ANGLE, BY_SIDE, BY_SPEED, BY_PLACE, BY_IMPLEMENT}
STEERING_EXCLUDED_KINDS = {BY_PLACE, BY_ANGLE, BY_SPEED, BY_SIDE}


@dataclass(frozen=True, eq=False)
class LawTarget:
    """A parameter whose laws are tested: effect, value in the fit and its smallest size, both in the effect's unit.

    `unit_per_step` converts the coordinate in the fit to that unit; it is 1 outside the fit.
    """

    effect_id: str
    value: float
    finest: float
    unit_per_step: float
    is_in_fit: bool

    @property
    def moves_path(self) -> bool:
        """Whether the effect acts on the simulated motion."""
        return get_effect(self.effect_id).block == PATH

    def allows(self, kind: str) -> bool:
        """Whether a law of a kind is possible and no effect of its own."""
        block = get_effect(self.effect_id).block
        if block == POSITION:
            return kind not in INSTRUMENT_EXCLUDED_KINDS
        if block == STEERING:
            return kind not in STEERING_EXCLUDED_KINDS
        return kind not in EXCLUDED_KINDS.get(self.effect_id, ())


def list_targets(residual_model: ResidualModel, fit: EffectFit) -> list[LawTarget]:
    """List the effects of a fit with one value, and those that may change although their mean is neutral."""
    tractor, targets = residual_model.rig.tractor, []
    parts = {parameters.id: (parameters, coordinates) for parameters, coordinates in fit.parts}
    for name in dict.fromkeys((*ALWAYS_TESTED, *parts)):
        entry = get_effect(name)
        parameters, coordinates = parts.get(name, (build_parameters(tractor, name), None))
        if parameters.count != 1 or entry.kind.is_searched or entry.is_stand_in or len(entry.params) > 1:
            continue
        at = np.array(parameters.neutral) if coordinates is None else coordinates
        value = float(parameters.compute_values(at)[entry.size.name])
        if not np.isfinite(value):
            continue
        per_step = _compute_unit_per_coordinate(parameters, at) if name in parts else 1.0
        finest = find_finest_size(tractor, name, residual_model.get_interval_s(name))
        if finest <= 0.0:
            continue  # a limit has no small size of which laws could be multiples
        targets.append(LawTarget(name, value, finest, per_step, name in parts))
    return targets


def _compute_unit_per_coordinate(parameters: EffectParameters, coordinates: Array) -> float:
    """Return the change of the value of an effect per unit of its coordinate."""
    name, step = get_effect(parameters.id).size.name, 1e-4 * parameters.typical[0]
    low, high = (float(parameters.compute_values(coordinates + shift)[name]) for shift in (0.0, step))
    return (high - low) / step


class LawColumns:
    """Columns of the residuals for laws of the parameters of one fit."""

    def __init__(self, residual_model: ResidualModel, fit: EffectFit) -> None:
        """Replay the fit once."""
        self.residual_model, self.fit = residual_model, fit
        self.response = PathResponse(residual_model, fit)
        self.segments = residual_model.dataset.segments
        self._unit_increments: dict[str, list[PoseIncrements]] = {}
        self.constant = build_group_basis([1] * len(residual_model.dataset.names), 0)

    def compute_columns(self, target: LawTarget, basis: LawBasis) -> Array:
        """Return the change of all residuals (n, c) per unit of each column of a law."""
        rows = [basis.compute_rows(segment) for segment in self.segments]
        if not target.moves_path:
            return self._multiply_rows(target, rows)
        out = np.zeros((5 * self.residual_model.dataset.rows, rows[0].shape[1]))
        sizes = np.maximum(np.max([np.abs(part).max(axis=0) for part in rows], axis=0), 1e-9)
        scales = SMALL_SHARE * target.finest / sizes  # the filter is linear in small motions only
        for index, unit in enumerate(self.compute_unit_increments(target)):
            terms = [scale_increments(unit, column) for column in (rows[index][:-1] * scales).T]
            place = self.response.places[index]
            out[place] = self.response.compute_columns(index, terms) / scales * self._outlier_shares[place, None]
        return out

    def compute_unit_increments(self, target: LawTarget) -> list[PoseIncrements]:
        """Return the change of the simulated motion per unit of the constant value of a parameter, per segment."""
        if target.effect_id not in self._unit_increments:
            size = get_effect(target.effect_id).size
            step = STEP_SHARE * size.scale_to_wheelbase(self.residual_model.rig.tractor.wheelbase_m).typical
            low, high = (
                self.residual_model.simulate_increments(
                    {**self.fit.settings, target.effect_id: {size.name: target.value + shift}}
                )
                for shift in (0.0, step)
            )
            grips = [self._find_grip(segment, move) for segment, move in zip(self.segments, low, strict=True)]
            self._unit_increments[target.effect_id] = [
                PoseIncrements(*((after - before) * grip / step for before, after in zip(old, new, strict=True)))
                for old, new, grip in zip(map(_list_columns, low), map(_list_columns, high), grips, strict=True)
            ]
        return self._unit_increments[target.effect_id]

    def _find_grip(self, segment: DriveSegment, move: PoseIncrements) -> Array:
        """Return 1 where a segment shows the steering (k - 1,), 0 where tyres are near their limit.

        Tyres begin to slide before the limit, in a way of their own: what is left there is of no other parameter.
        """
        if SIDE_SLIP not in self.fit.settings:
            return np.ones(len(move.turned))
        lateral = np.abs(move.turned * move.ahead) / np.maximum(np.diff(segment.time), 1e-3) ** 2
        limit = self.fit.settings[SIDE_SLIP]["limit_g"] * GRAVITY_MPS2
        return np.where(lateral < BEGINS_TO_SLIDE_SHARE * limit, 1.0, 0.0)

    @cached_property
    def _outlier_shares(self) -> Array:
        """Change of a residual that counts linearly, as an outlier does, per change of the error itself (n,)."""
        return np.asarray(OUTLIER_SIGMAS / np.maximum(np.abs(self.fit.residuals), OUTLIER_SIGMAS))

    def _multiply_rows(self, target: LawTarget, rows: Sequence[Array]) -> Array:
        unit = self._compute_unit_column(target)[:, None]
        by_row = np.concatenate(rows)
        return np.asarray(unit * np.concatenate([np.repeat(by_row, 3, axis=0), by_row, by_row]))

    def _compute_unit_column(self, target: LawTarget) -> Array:
        """Return the change of the residuals (n,) per unit of the constant value of a parameter."""
        if target.is_in_fit:
            columns = self.fit.jacobian[:, self.fit.find_columns(target.effect_id)] / target.unit_per_step
            return np.asarray(columns[:, 0])
        entry = get_effect(target.effect_id)
        step = STEP_SHARE * entry.size.typical
        base = self.residual_model.compute_residuals(self.fit.settings)
        settings = {**self.fit.settings, target.effect_id: {entry.size.name: target.value + step}}
        return (self.residual_model.compute_change(settings, base, frozenset({entry.block})) - base) / step

    def compute_weights(self, target: LawTarget) -> Array:
        """Return how much every row of the logs shows of a parameter (rows,): the square of its change there."""
        if target.moves_path:
            units = zip(self.compute_unit_increments(target), self.segments, strict=True)
            return np.concatenate([_compute_turned_squares(unit, segment) for unit, segment in units])
        rows = self.residual_model.dataset.rows
        squares = self._compute_unit_column(target) ** 2
        path = squares[: 3 * rows].reshape(-1, 3).sum(axis=1)
        return np.asarray(path + squares[3 * rows : 4 * rows] + squares[4 * rows :])


def scale_increments(unit: PoseIncrements, factor: Array) -> PoseIncrements:
    """Return motion times a factor between rows (k - 1,)."""
    return PoseIncrements(unit.ahead * factor, unit.aside * factor, unit.turned * factor)


def _list_columns(move: PoseIncrements) -> tuple[Array, Array, Array]:
    return move.ahead, move.aside, move.turned


def _compute_turned_squares(unit: PoseIncrements, segment: DriveSegment) -> Array:
    """Return the squares of what a unit of a parameter turns, per second, with a 0 for the last row (k,)."""
    squares = unit.turned**2 / np.maximum(np.diff(segment.time), 1e-3)
    return np.append(squares, 0.0)
