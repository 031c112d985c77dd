"""A selection of causes in which a parameter follows its law, in the place of what stood in for the law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from vehicle.identification.cause_selection.evidence import estimate_robust_covariance
from vehicle.identification.cause_selection.refit import compute_unnamed_gain, refit_with_new_weights
from vehicle.identification.cause_selection.selection import CauseSelection, drop_superfluous
from vehicle.identification.fit.effect_parameters import build_parameters
from vehicle.identification.fit.residual_fit import EffectFit, FitPart
from vehicle.identification.laws.bases import BY_IMPLEMENT, BY_PLACE, OVER_MINUTES, LawBasis, RunClock
from vehicle.identification.laws.columns import GAIN, LawColumns, list_targets, scale_increments
from vehicle.identification.laws.scores import LawScore, LawScorer
from vehicle.identification.laws.selection import (
    DRIFT,
    PATCH,
    STAND_INS,
    FoundLaw,
    LawOutcome,
    compute_law_range,
    find_laws,
)
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.residuals.innovations import PoseIncrements
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import ABOVE_UNNAMED_FACTOR, LAW_SPREAD_FACTOR, LOOK_ALIKE_LOSS, LOOK_ALIKE_SHARE
from vehicle.model.effect_kinds import INTERVAL_SIGMAS
from vehicle.model.effects import POSITION, get_effect
from vehicle.model.tractor import Settings, Tractor

# Chosen: the motion is linear in a law, and only the treatment of outliers changes from step to step, which may make a
# step too long.
LAW_STEPS, STEP_SHARES = 3, (1.0, 0.4)
# Chosen: soil forgets within such a window; headings that clearly show less than this share of a law contradict it.
HEADING_WINDOW_S, LEAST_HEADING_SHARE = 2.0, 0.5
FEWEST_HEADING_WINDOWS = 10
OUTER_SHARE_OF_FIT = 0.02  # chosen: nearly all that the logs show must be possible


@dataclass(frozen=True, eq=False)
class SettledLaw:
    """A law in the final fit: value of the parameter where all columns are 0, amounts (c,), and their errors (95 %).

    `mean` and `mean_error` are for the average over what the logs show; `low` and `high` the range over them.
    `competitors` are effects of the catalogue that explain as much.
    """

    found: FoundLaw
    constant: float
    amounts: Array
    errors: Array
    mean: float
    mean_error: float
    low: float
    high: float
    competitors: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class LawSelection:
    """A selection of causes, the laws that it contains, and how all laws compared."""

    selection: CauseSelection
    laws: tuple[SettledLaw, ...]
    outcome: LawOutcome


def settle_laws(selection: CauseSelection, clock: RunClock, tractor: Tractor) -> LawSelection:
    """Return the selection with the law that its residuals ask for, without what has become superfluous beside it.

    Unchanged where every parameter is constant, where the catalogue's own effect of the same law is in the fit, where
    little is left of the law once all else is fitted beside it, or where it leaves the range of what is possible: runs
    in which the path does not follow the wheel angle at all have another cause than a gain of 0.
    """
    outcome = find_laws(selection, clock)
    if not outcome.laws or outcome.base_fit is None or _is_own_effect(selection, outcome.laws[0]):
        return LawSelection(selection, (), outcome)
    found = outcome.laws[0]
    size = get_effect(found.effect_id).size.scale_to_wheelbase(tractor.wheelbase_m)
    if not found.score.target.moves_path:
        row_law = _read_row_law(found)
        is_possible = size.low < row_law.low and row_law.high < size.high
        is_clear = is_possible and not _is_outweighed(found, selection)
        return LawSelection(selection, (row_law,) if is_clear else (), outcome)
    parts = outcome.base_fit.parts
    if found.effect_id not in outcome.base_fit.settings:
        parameters = build_parameters(tractor, found.effect_id)
        parts = (*parts, (parameters, np.array(parameters.neutral)))
    settled = _fit_with_law(selection, outcome.base_fit, parts, found)
    settled, score = _refine_law(drop_superfluous(settled), found)
    model = settled.residual_model
    is_in_headings = not isinstance(model, LawResidualModel) or not is_contradicted_by_headings(
        model, settled.fit.settings
    )
    if is_shadow_of_covariates(settled) or not is_in_headings:
        return LawSelection(selection, (), outcome)
    slack = LOOK_ALIKE_LOSS + LOOK_ALIKE_SHARE * found.score.gain
    competitors = tuple(name for name in STAND_INS if name in selection.effect_ids)
    is_undecided = selection.fit.loss - slack < settled.fit.loss
    law = _read_law(settled, found, score, competitors if is_undecided else ())
    is_possible = size.low < law.low and law.high < size.high
    if law.high - law.low <= LAW_SPREAD_FACTOR * score.target.finest or not is_possible:
        return LawSelection(selection, (), outcome)
    return LawSelection(settled, (law,), outcome)


def is_shadow_of_covariates(settled: CauseSelection) -> bool:
    """Whether a law explains little beside covariates that it could not replace, as any name may be their shadow.

    What it explains is what returns where the parameter is constant, with all others following.
    """
    model = settled.residual_model
    if not settled.unnamed or not isinstance(model, LawResidualModel) or model.law is None:
        return False
    constant = add_law(model, replace(model.law, amounts=np.zeros_like(model.law.amounts)))
    without = refit_with_new_weights(constant, settled.fit.parts, settled.unnamed)
    return without.loss - settled.fit.loss <= ABOVE_UNNAMED_FACTOR * compute_unnamed_gain(settled.fit)


def _is_outweighed(found: FoundLaw, selection: CauseSelection) -> bool:
    """Whether a law of what shows the path explains little beside covariates of the path, as of ground that pushes."""
    if not selection.unnamed or get_effect(found.effect_id).block != POSITION:
        return False
    return found.score.gain <= ABOVE_UNNAMED_FACTOR * compute_unnamed_gain(selection.fit)


def _is_own_effect(selection: CauseSelection, law: FoundLaw) -> bool:
    """Whether the best law is what an effect of the catalogue in the fit says, and no other explains as much."""
    own = {(GAIN, OVER_MINUTES): DRIFT, (GAIN, BY_PLACE): PATCH}.get((law.effect_id, law.kind))
    is_patch = "radius_m" in law.score.basis.detail
    return own in selection.fit.settings and (own != PATCH or is_patch) and not law.alternatives


def _fit_with_law(
    selection: CauseSelection, base_fit: EffectFit, parts: tuple[FitPart, ...], found: FoundLaw
) -> CauseSelection:
    """Return the selection with a law and with these parts, and with its covariates where they explain more."""
    columns, target = LawColumns(selection.residual_model, base_fit), found.score.target
    centre = compute_centre(selection.residual_model, found.score.basis, columns.compute_weights(target))
    units = columns.compute_unit_increments(target)
    law = ActingLaw(found.effect_id, found.score.basis, centre, np.zeros(found.score.freedoms), units)
    model = add_law(selection.residual_model, law)
    settled = replace(selection, residual_model=model, fit=refit_with_new_weights(model, parts, ()), unnamed=())
    for _ in range(LAW_STEPS):
        settled, _ = _refine_law(settled, found)
    if settled.fit.loss < selection.fit.loss + LOOK_ALIKE_LOSS:
        return settled
    fit = refit_with_new_weights(settled.residual_model, settled.fit.parts, selection.unnamed)
    return replace(settled, fit=fit, unnamed=selection.unnamed)


def is_contradicted_by_headings(model: LawResidualModel, settings: Settings) -> bool:
    """Whether measured headings clearly do not turn as the law of a model says: positions alone then show it.

    Positions that wander look like steering that changes, but leave the headings as they are.
    """
    share, error = measure_heading_share(model, settings)
    return share + INTERVAL_SIGMAS * error < LEAST_HEADING_SHARE


def measure_heading_share(model: LawResidualModel, settings: Settings) -> tuple[float, float]:
    """Return how much of what a law turns measured headings show (1: all), and its standard error.

    The turns of HEADING_WINDOW_S that the simulation leaves are regressed on those of the law, beside a constant gain
    and a constant curvature. The error is infinite where headings show nothing of it.
    """
    bare, full = (one.simulate_increments(settings) for one in (replace(model, law=None), model))
    extra = [with_law.turned - without.turned for with_law, without in zip(full, bare, strict=True)]
    return measure_turned_share(model.dataset.segments, bare, extra)


def measure_turned_share(
    segments: Sequence[DriveSegment], bare: Sequence[PoseIncrements], extra: Sequence[Array]
) -> tuple[float, float]:
    """Return how much of `extra` turns (k - 1,) between rows, beyond those of `bare`, measured headings show (1: all),
    and its standard error, infinite where headings show nothing of it."""
    windows = [
        _sum_turns(segment, without, turned)
        for segment, without, turned in zip(segments, bare, extra, strict=True)
        if segment.heading_measured
    ]
    turns = np.concatenate([np.zeros((4, 0)), *windows], axis=1)
    if turns.shape[1] < FEWEST_HEADING_WINDOWS or not np.any(turns[1]):
        return 0.0, np.inf
    columns = turns[1:].T / np.maximum(np.sqrt(np.mean(turns[1:] ** 2, axis=1)), 1e-12)
    inverse = np.linalg.pinv(columns.T @ columns, hermitian=True)
    amounts = inverse @ columns.T @ turns[0]
    scatter = columns * (turns[0] - columns @ amounts)[:, None]
    errors = np.sqrt(np.diag(inverse @ scatter.T @ scatter @ inverse))
    unit = float(np.sqrt(np.mean(turns[1] ** 2)))
    return float(amounts[0]) / unit, float(errors[0]) / unit


def _sum_turns(segment: DriveSegment, without: PoseIncrements, extra: Array) -> Array:
    """Return sums over windows (4, w): what the measured heading turns beyond the simulation, the `extra` turns, what
    the simulation turns, and what it drives."""
    edges = np.flatnonzero(np.diff(np.floor((segment.time - segment.time[0]) / HEADING_WINDOW_S), prepend=-1.0))
    parts = (np.diff(segment.heading) - without.turned, extra, without.turned, without.ahead)
    return np.array([np.add.reduceat(part, edges[:-1]) for part in parts]) if len(edges) > 1 else np.zeros((4, 0))


def _refine_law(selection: CauseSelection, found: FoundLaw) -> tuple[CauseSelection, LawScore]:
    """Return the selection with the amounts of its law one step better, and the score of the step."""
    residual_model, fit = selection.residual_model, selection.fit
    assert isinstance(residual_model, LawResidualModel) and residual_model.law is not None
    columns, basis, law = LawColumns(residual_model, fit), found.score.basis, residual_model.law
    target = next(one for one in list_targets(residual_model, fit) if one.effect_id == found.effect_id)
    constant = columns.compute_columns(target, columns.constant) if not target.is_in_fit else np.zeros((0, 0))
    scorer = LawScorer(residual_model, fit, target, constant, [columns.compute_columns(target, basis)])
    score = scorer.score_law(0, basis)
    for share in STEP_SHARES:
        amounts = law.amounts + share * score.amounts
        model = add_law(residual_model, replace(law, amounts=amounts))
        refitted = refit_with_new_weights(model, fit.parts, selection.unnamed)
        if refitted.loss < fit.loss:
            return replace(selection, residual_model=model, fit=refitted), score
    return selection, score


def _read_law(selection: CauseSelection, found: FoundLaw, score: LawScore, competitors: tuple[str, ...]) -> SettledLaw:
    """Return a law with the amounts and values of the final fit."""
    model, fit, target = selection.residual_model, selection.fit, score.target
    assert isinstance(model, LawResidualModel) and model.law is not None
    size = get_effect(found.effect_id).size.name
    value = fit.settings[found.effect_id][size] if target.is_in_fit else target.value
    amounts = model.law.amounts
    rows = np.concatenate([found.score.basis.compute_rows(segment) for segment in model.dataset.segments])
    change = value + (rows - model.law.centre) @ amounts
    outer_share = 0.0 if found.kind == BY_IMPLEMENT else OUTER_SHARE_OF_FIT
    low, high = compute_law_range(change, LawColumns(model, fit).compute_weights(target), outer_share)
    mean_error = target.finest
    if target.is_in_fit:
        covariance = estimate_robust_covariance(model, fit, widen_for_few=True)
        mean_error = INTERVAL_SIGMAS * float(np.sqrt(np.diag(covariance)[fit.find_columns(found.effect_id)][0]))
    return SettledLaw(
        found,
        float(value - model.law.centre @ amounts),
        amounts,
        INTERVAL_SIGMAS * score.sigmas,
        float(value),
        mean_error,
        low,
        high,
        competitors,
    )


def _read_row_law(found: FoundLaw) -> SettledLaw:
    """Return a law of a parameter that cannot act in the residual model, as it was scored."""
    score = found.score
    low, high = (found.constant + change for change in (found.low, found.high))
    errors = INTERVAL_SIGMAS * score.sigmas
    return SettledLaw(found, found.constant, score.amounts, errors, score.target.value, score.target.finest, low, high)


# --- a residual model in which a parameter of the path follows a law -------------------------------------------------
# It acts on the simulated motion, before the filter of the residuals and its treatment of outliers, so that a law as
# large as a third of the curvature is no larger an error than a small one.


@dataclass(frozen=True, eq=False)
class ActingLaw:
    """A law of one effect: amounts (c,) of its columns about their `centre` (c,), and the change of the motion per unit
    of the effect, per segment."""

    effect_id: str
    basis: LawBasis
    centre: Array
    amounts: Array
    units: Sequence[PoseIncrements]


@dataclass(frozen=True, eq=False)
class LawResidualModel(ResidualModel):
    """A residual model whose simulated motion follows a law, on top of the settings."""

    law: ActingLaw | None = None

    def simulate_increments(self, settings: Settings) -> list[PoseIncrements]:
        """Simulate the increments of the centre of mass per segment, with latency and law applied."""
        return self._apply_law(super().simulate_increments(settings))

    def _simulate_paths(self, settings_list: Sequence[Settings]) -> Iterator[list[PoseIncrements]]:
        return (self._apply_law(moves) for moves in super()._simulate_paths(settings_list))

    def _apply_law(self, moves: list[PoseIncrements]) -> list[PoseIncrements]:
        law = self.law
        if law is None:
            return moves
        out = []
        for segment, move, unit in zip(self.dataset.segments, moves, law.units, strict=True):
            change = ((law.basis.compute_rows(segment) - law.centre) @ law.amounts)[:-1]
            extra = scale_increments(unit, change)
            out.append(PoseIncrements(move.ahead + extra.ahead, move.aside + extra.aside, move.turned + extra.turned))
        return out


def add_law(residual_model: ResidualModel, law: ActingLaw) -> LawResidualModel:
    """Return a residual model with a law, or with another one than before."""
    if isinstance(residual_model, LawResidualModel):
        return replace(residual_model, law=law)
    values = {field.name: getattr(residual_model, field.name) for field in fields(ResidualModel)}
    return LawResidualModel(**values, law=law)


def compute_centre(residual_model: ResidualModel, basis: LawBasis, weights: Array) -> Array:
    """Return the weighted mean (c,) of the columns of a law over all rows."""
    rows = np.concatenate([basis.compute_rows(segment) for segment in residual_model.dataset.segments])
    return np.asarray(np.average(rows, axis=0, weights=weights))
