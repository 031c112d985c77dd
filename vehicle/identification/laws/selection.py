"""The simplest law that logs ask for, per parameter, and laws that they cannot tell apart.

Stand-ins of the catalogue for a gain that changes (in a circle, over minutes) and covariates without a name are left
out of the fit on which laws are compared: they compete with the laws instead of hiding what these explain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vehicle.identification.cause_selection.covariates import get_steering
from vehicle.identification.cause_selection.refit import refit_with_covariates, refit_without
from vehicle.identification.cause_selection.selection import CauseSelection
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.laws.bases import (
    BY_IMPLEMENT,
    BY_PLACE,
    BY_SIDE,
    BY_SPEED,
    FEWEST_GROUP_RUNS,
    LawBasis,
    RunClock,
    build_group_basis,
    get_angle_deg,
    list_bases,
)
from vehicle.identification.laws.columns import GAIN, LawColumns, LawTarget, list_targets
from vehicle.identification.laws.scores import LawScore, LawScorer
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import (
    CHANCE_SIGMAS,
    CLEAR_LAW_FACTOR,
    CONCERNED_LOSS,
    FEWEST_TURNED_RAD,
    HELD_OUT_LAW_SHARE,
    LAW_SHARE,
    LAW_SPREAD_FACTOR,
    LEAST_BEND_DEG,
    LEAST_HELPED_SHARE,
    LEAST_STRENGTH,
    LOOK_ALIKE_LOSS,
    LOOK_ALIKE_SHARE,
    MATERIAL_SHARE,
    ROW_LAW_SPREAD_FACTOR,
)

DRIFT, PATCH, UNDERSTEER = "grip_drift", "grip_patch", "understeer"
STAND_INS = (DRIFT, PATCH)
# Chosen, deg: less is straight ahead; and of the rows that turn, those that turn to the side of the group of their run.
LEAST_TURNING_DEG, SIDE_OF_RUNS_SHARE = 1.0, 0.8
OUTER_SHARE = 0.05  # chosen, of the rows at either end of the range of a law: a few rows are no range
# Chosen, of the mean angle of bends: with an implement at work only in much gentler ones, a gain that differs by its
# work may be one by the angle.
ALIKE_BENDS_SHARE = 0.2
LEAST_RUN_INFORMATION = 0.01  # of the best informed run: chosen, a tenth of its precision still tells groups apart


@dataclass(frozen=True, eq=False)
class FoundLaw:
    """A law of one parameter: its score, its range over the logs (5 to 95 %), and laws that explain as much.

    What is hardly more than the least that matters is not clear (`is_clear`): something unknown may look like it.
    """

    score: LawScore
    low: float
    high: float
    alternatives: tuple[FoundLaw, ...] = ()
    is_clear: bool = True

    @property
    def effect_id(self) -> str:
        """The effect whose parameter changes."""
        return self.score.target.effect_id

    @property
    def kind(self) -> str:
        """Kind of the law."""
        return self.score.basis.kind

    @property
    def constant(self) -> float:
        """The constant part of the law, in the unit of the effect: its value where all columns are 0."""
        return self.score.target.value + self.score.step


@dataclass(frozen=True, eq=False)
class LawOutcome:
    """Laws found, at most one per parameter; the fit without stand-ins and covariates, on which they were compared.

    `share` is how much of what stand-ins and covariates explained the first law explains as well.
    """

    laws: tuple[FoundLaw, ...] = ()
    base_fit: EffectFit | None = None
    scores: tuple[FoundLaw, ...] = field(default_factory=tuple)


def find_laws(selection: CauseSelection, clock: RunClock) -> LawOutcome:
    """Return the laws that explain what the covariates and stand-ins of a selection explain, or the best part of it."""
    residual_model = selection.residual_model
    base_fit = drop_stand_ins(selection)
    tested = [
        found
        for target, scores in score_all_laws(selection, base_fit, clock)
        for found in _list_supported(residual_model, base_fit, target, scores)
    ]
    if not tested:
        return LawOutcome((), base_fit)
    best = min(tested, key=lambda found: -_compute_net_gain(found.score))
    needed = base_fit.loss - selection.fit.loss - _compute_random_gain(_count_extra_freedoms(selection, base_fit))
    if best.score.total_gain < LAW_SHARE * needed:
        return LawOutcome((), base_fit, tuple(tested))
    slack = LOOK_ALIKE_LOSS + LOOK_ALIKE_SHARE * best.score.gain
    alike = tuple(
        found
        for found in tested
        if found is not best
        and (found.effect_id, found.kind) != (best.effect_id, best.kind)
        and _compute_net_gain(found.score) > _compute_net_gain(best.score) - slack
    )
    return LawOutcome((replace(best, alternatives=_keep_best_of_kind(alike)),), base_fit, tuple(tested))


def drop_stand_ins(selection: CauseSelection) -> EffectFit:
    """Return the fit without effects that stand in for a changing gain, and without covariates."""
    fit = refit_with_covariates(selection.residual_model, selection.fit, ())
    for name in STAND_INS:
        if name in fit.settings:
            fit = refit_without(selection.residual_model, fit, name)
    return fit


def is_gain_by_speed(residual_model: ResidualModel, fit: EffectFit, clock: RunClock) -> bool:
    """Whether a gain that changes with the speed explains as much as the understeer of a fit does.

    Understeer grows with the square of the speed: logs of a few speeds, or of one speed per bend, show either.
    """
    bases = [basis for basis in list_bases(residual_model.dataset, clock) if basis.kind == BY_SPEED]
    if UNDERSTEER not in fit.settings or not bases:
        return False
    without = refit_without(residual_model, fit, UNDERSTEER)
    columns = LawColumns(residual_model, without)
    target = next(one for one in list_targets(residual_model, without) if one.effect_id == GAIN)
    constant = columns.compute_columns(target, columns.constant) if not target.is_in_fit else np.zeros((0, 0))
    scorer = LawScorer(residual_model, without, target, constant, [columns.compute_columns(target, bases[0])])
    needed = without.loss - fit.loss
    return scorer.score_law(0, bases[0]).total_gain > needed - LOOK_ALIKE_LOSS - LOOK_ALIKE_SHARE * needed


def _count_extra_freedoms(selection: CauseSelection, base_fit: EffectFit) -> int:
    return max(int(selection.fit.jacobian.shape[1] - base_fit.jacobian.shape[1]), 0)


def _compute_random_gain(freedoms: int) -> float:
    """Return the loss that this many free amounts remove by chance."""
    return freedoms + CHANCE_SIGMAS * math.sqrt(2.0 * freedoms)


def _compute_net_gain(score: LawScore) -> float:
    """Return the gain of a law, and of its constant, beyond what its free amounts and the search for it gain by
    chance."""
    return score.total_gain - _compute_random_gain(score.freedoms) - 2.0 * math.log(max(score.basis.searched, 1))


def _keep_best_of_kind(found: Sequence[FoundLaw]) -> tuple[FoundLaw, ...]:
    best: dict[tuple[str, str], FoundLaw] = {}
    for law in sorted(found, key=lambda one: -_compute_net_gain(one.score)):
        best.setdefault((law.effect_id, law.kind), law)
    return tuple(best.values())


def score_all_laws(
    selection: CauseSelection, base_fit: EffectFit, clock: RunClock
) -> list[tuple[LawTarget, list[LawScore]]]:
    """Return the scores of all laws of all parameters, beside the fit without stand-ins."""
    residual_model = selection.residual_model
    columns = LawColumns(residual_model, base_fit)
    bases = list_bases(residual_model.dataset, clock) + _list_patch_bases(selection)
    is_bent_at_work = _is_bent_at_work(residual_model)
    out = []
    for target in list_targets(residual_model, base_fit):
        allowed = [basis for basis in bases if target.allows(basis.kind)]
        if target.effect_id == GAIN and not is_bent_at_work:
            allowed = [basis for basis in allowed if basis.kind != BY_IMPLEMENT]
        laws = [columns.compute_columns(target, basis) for basis in allowed]
        constant = columns.compute_columns(target, columns.constant) if not target.is_in_fit else np.zeros((0, 0))
        scorer = LawScorer(residual_model, base_fit, target, constant, laws)
        scores = [scorer.score_law(number, basis) for number, basis in enumerate(allowed)]
        grouping = _find_two_groups(*scorer.estimate_values_by_run())
        if grouping is not None and not (_follows_side(residual_model, grouping) and not target.allows(BY_SIDE)):
            law = columns.compute_columns(target, grouping)
            scores.append(LawScorer(residual_model, base_fit, target, constant, [law]).score_law(0, grouping))
        out.append((target, scores))
    return out


def _is_bent_at_work(residual_model: ResidualModel) -> bool:
    """Whether the tractor turns with its implement at work, in bends like those with its implement lifted.

    In rows that only keep a line the gain of small angles shows, not that of the implement.
    """
    base_m, rows = residual_model.rig.tractor.wheelbase_m, []
    for segment in residual_model.dataset.segments:
        angle = np.abs(get_steering(segment))
        driven_m = np.hypot(np.diff(segment.east), np.diff(segment.north))
        bent = np.degrees(angle) > LEAST_BEND_DEG
        rows.append(np.stack([angle, np.tan(angle) * driven_m / base_m, segment.working[:-1]])[:, bent])
    angle, turned, working = np.concatenate(rows, axis=1)
    at_work, lifted = (turned * (working > 0.0), turned * (working <= 0.0))
    if at_work.sum() <= FEWEST_TURNED_RAD or lifted.sum() <= FEWEST_TURNED_RAD:
        return False
    means = [float(angle @ weight / weight.sum()) for weight in (at_work, lifted)]
    return min(means) > ALIKE_BENDS_SHARE * max(means)


def _list_patch_bases(selection: CauseSelection) -> list[LawBasis]:
    """Return the law of the circle that the selection found, if any."""
    patch = selection.fit.settings.get(PATCH)
    if patch is None:
        return []
    east, north = patch["east_m"] - selection.residual_model.dataset.origin[0], patch["north_m"]
    north -= selection.residual_model.dataset.origin[1]

    def compute_rows(segment: DriveSegment) -> Array:
        inside = np.hypot(segment.east - east, segment.north - north) < patch["radius_m"]
        return inside.astype(np.float64)[:, None]

    detail = {name: patch[name] for name in ("east_m", "north_m", "radius_m")}
    return [LawBasis(BY_PLACE, compute_rows, detail, 1000)]


def _find_two_groups(values: Array, information: Array) -> LawBasis | None:
    """Return the law by run that splits runs at one value into two groups of at least two informed runs each."""
    informed = np.flatnonzero(information > LEAST_RUN_INFORMATION * np.max(information, initial=0.0))
    if len(informed) < 2 * FEWEST_GROUP_RUNS:
        return None
    ordered, best = informed[np.argsort(values[informed])], (math.inf, 0)
    for size in range(FEWEST_GROUP_RUNS, len(ordered) - FEWEST_GROUP_RUNS + 1):
        scatter = 0.0
        for part in (ordered[:size], ordered[size:]):
            weight = information[part]
            scatter += float(weight @ (values[part] - np.average(values[part], weights=weight)) ** 2)
        best = min(best, (scatter, size))
    edge = 0.5 * (values[ordered[best[1] - 1]] + values[ordered[best[1]]])
    return build_group_basis((values > edge).astype(int).tolist(), 2 ** len(informed))


def _follows_side(residual_model: ResidualModel, grouping: LawBasis) -> bool:
    """Whether the groups of runs are those that turn to either side: a law by run is then one by side."""
    segments = residual_model.dataset.segments
    angles, groups = [get_angle_deg(segment) for segment in segments], [grouping.groups[one.run] for one in segments]
    turning = [np.sign(angle) * (np.abs(angle) > LEAST_TURNING_DEG) for angle in angles]
    sides = np.array([float(turned.sum()) for turned in turning])
    rows = float(sum(np.count_nonzero(turned) for turned in turning))
    return abs(float(sides @ np.where(groups, 1.0, -1.0))) > SIDE_OF_RUNS_SHARE * max(rows, 1.0)


def _list_supported(
    residual_model: ResidualModel, fit: EffectFit, target: LawTarget, scores: Sequence[LawScore]
) -> list[FoundLaw]:
    """Return the laws that are beyond chance, material, wider than the tolerance, and help held-out runs."""
    least = max(LEAST_STRENGTH, MATERIAL_SHARE * 3.0 * residual_model.dataset.rows)
    weights = LawColumns(residual_model, fit).compute_weights(target)
    spread_factor = LAW_SPREAD_FACTOR if target.moves_path else ROW_LAW_SPREAD_FACTOR
    supported = []
    for score in scores:
        is_clear = score.strength > CLEAR_LAW_FACTOR * least
        found = FoundLaw(score, *_compute_range(residual_model, score, weights), is_clear=is_clear)
        concerned = np.abs(score.held_out) > CONCERNED_LOSS
        if (
            _compute_net_gain(score) - score.constant_gain > least
            and score.strength > _compute_random_gain(score.freedoms) + LEAST_STRENGTH
            and found.high - found.low > spread_factor * target.finest
            and float(score.held_out.sum()) > HELD_OUT_LAW_SHARE * score.gain
            and np.count_nonzero(score.held_out[concerned] > 0.0) >= LEAST_HELPED_SHARE * np.count_nonzero(concerned)
        ):
            supported.append(found)
    return supported


def _compute_range(residual_model: ResidualModel, score: LawScore, weights: Array) -> tuple[float, float]:
    rows = np.concatenate([score.basis.compute_rows(segment) for segment in residual_model.dataset.segments])
    outer_share = 0.0 if score.basis.kind == BY_IMPLEMENT else OUTER_SHARE
    return compute_law_range(rows @ score.amounts, weights, outer_share)


def compute_law_range(values: Array, weights: Array, outer_share: float) -> tuple[float, float]:
    """Return the range of the values of a parameter per row (k,) without its outer shares, by how much rows show of it.

    Where the outer share is 0, every value that rows show counts, however few have it: as of a working implement.
    """
    order = np.argsort(values)
    shares = np.cumsum(weights[order])
    if shares[-1] <= 0.0:
        return 0.0, 0.0
    if outer_share == 0.0:
        shown = values[weights > 0.0]
        return float(shown.min()), float(shown.max())
    low, high = np.interp((outer_share, 1.0 - outer_share), shares / shares[-1], values[order])
    return float(low), float(high)
