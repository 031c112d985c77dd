"""Which effects are named, which are likely (fitted, clearly not neutral, helpful to held-out runs, but not proven),
and what remains unexplained."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.identification.cause_selection.candidate_fit import Projector, fit_candidate
from vehicle.identification.cause_selection.challenge import (
    get_make_dependent_group,
    is_shown_within_runs,
    is_significant_alone,
)
from vehicle.identification.cause_selection.evidence import is_helping_held_out, list_nameable_parts
from vehicle.identification.cause_selection.refit import compute_unnamed_gain, refit_with_covariates, refit_without
from vehicle.identification.cause_selection.selection import CauseSelection
from vehicle.identification.cause_selection.tolerances import is_within_tolerances
from vehicle.identification.diagnosis.results import Hint
from vehicle.identification.fit.effect_parameters import find_finest_size
from vehicle.identification.fit.open_loop import ModelTerm, fit_terms
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.laws.columns import SIDE_SLIP
from vehicle.identification.logs.schema import Array
from vehicle.identification.model_extension.term_search import (
    OpenLoopFit,
    find_irreplaceable,
    is_at_limit,
    search_terms,
)
from vehicle.identification.model_extension.tractor_extension import (
    ModelExtension,
    build_fit_extension,
    build_open_loop_extension,
)
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import (
    ABOVE_UNNAMED_FACTOR,
    CLEARLY_BEYOND_FACTOR,
    FAR_OUTWEIGHED_SHARE,
    HARM_PCT,
    LEAST_GAIN,
    LEAST_REPORTED_SHARE,
    LEAST_SLIDING_SHARE,
    OUTWEIGHED_SHARE,
    SLIDING_SHARE,
    WORTH_A_NAME_PCT,
    WORTH_OF_WHEEL_PCT,
)
from vehicle.identification.verdict.held_out_case import (
    ERROR_PIECE_S,
    DiagnosisCase,
    build_case,
    compute_noise_error_share,
    find_horizons_above_noise,
    is_calibration,
    is_within_noise,
)
from vehicle.identification.verdict.hints import describe_speed_changes
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effects import SPEED, STEERING, get_effect, get_neutral_values
from vehicle.model.tractor import Tractor


def list_clear_parts(selection: CauseSelection, tractor: Tractor) -> list[str]:
    """Return effects of the fit whose 95 % interval excludes neutral and which help runs that had no part in it.

    Effects that can stand in for any difference between runs are excluded: without a name they mean nothing.
    """
    residual_model, fit = selection.residual_model, selection.fit
    whole_extension = build_fit_extension(residual_model, fit, fit.settings)
    return [
        name
        for name in fit.settings
        if not get_effect(name).is_stand_in
        and is_clear_of_neutral(whole_extension, tractor, name)
        and is_independent_cause(residual_model, fit, name)
        and is_helping_held_out(residual_model, refit_without(residual_model, fit, name), fit, selection.threshold)
    ]


def find_sure_parts(selection: CauseSelection, names: Collection[str], clear_ids: Collection[str]) -> frozenset[str]:
    """Return the clear parts that the residuals allow to be named and that are no calibrations."""
    terms = (
        ModelTerm(parameters, coordinates)
        for parameters, coordinates in selection.fit.parts
        if parameters.id in names and parameters.id in clear_ids
    )
    return frozenset(term.parameters.id for term in terms if not is_calibration(selection.residual_model, term))


def is_independent_cause(residual_model: ResidualModel, fit: EffectFit, name: str) -> bool:
    """Whether an effect needs neither another one of its group nor a difference between runs."""
    return is_significant_alone(residual_model, fit, name) and is_shown_within_runs(residual_model, fit, name)


def is_likely(case: DiagnosisCase, name: str, sure_ids: Collection[str] = ()) -> bool:
    """Whether an effect is clearly not neutral and lowers the error of held-out runs.

    An effect of the steering must remove as much of the wheel angle error as a name must, and cost the path no more. An
    effect at the limit of the possible range, or refuted by the residuals of held-out runs although it lowers the
    error, stands in for something else.

    Effects in `sure_ids`, which the residuals show as clearly as a name needs, may be as small as a named one and cost
    the path as much, because a small effect is lost in the error over 5 s; one of the steering that the wheel shows may
    cost more as long as runs differ in it.
    """
    if (
        name in case.refused_effects
        or not is_clear_of_neutral(case.extension, case.tractor, name)
        or is_reaching_limit(case, name)
    ):
        return False
    term, is_sure = case.main_terms[name], name in sure_ids
    finest = find_finest_size(case.tractor, name, case.residual_model.get_interval_s(name))
    if term.parameters.compute_deviation(term.coordinates) <= (1.0 if is_sure else CLEARLY_BEYOND_FACTOR) * finest:
        return False
    of_wheel = get_effect(name).block == STEERING and case.residual_model.has_measured_wheel_angle
    if of_wheel and case.compute_gain_where_visible(name) < WORTH_OF_WHEEL_PCT:
        return False
    gain, (_, at_best) = case.compute_held_out_gain(name)
    return gain > (-HARM_PCT if of_wheel or is_sure else 0.0) or (of_wheel and is_sure and at_best > 0.0)


def is_clear_of_neutral(extension: ModelExtension, tractor: Tractor, name: str) -> bool:
    """Whether the 95 % interval of an effect, at least as wide as its tolerance, excludes neutral."""
    size = get_effect(name).size.name
    low, high = extension.tolerant_intervals.get(name, extension.intervals[name])[size]
    return not low <= get_neutral_values(name, tractor.steering)[size] <= high


def is_reaching_limit(case: DiagnosisCase, name: str) -> bool:
    """Whether an effect may be at the limit of its range: its value is, or its interval contains the limit.

    A lower end near the file's value, as of a lag of nearly zero, is no limit: only the value itself counts.
    """
    if is_at_limit((case.main_terms[name],)):
        return True
    size = get_effect(name).size.scale_to_wheelbase(case.tractor.wheelbase_m)
    neutral_size = get_neutral_values(name, case.tractor.steering)[size.name]
    low, high = case.extension.intervals[name][size.name]
    return high >= size.high > neutral_size or (size.neutral is not None and low <= size.low < neutral_size)


def is_radius_tolerance(case: DiagnosisCase) -> bool:
    """Whether tyres that slide take no more from the bends where they do than measured radii may be wrong by."""
    effects = {name: values for name, values in case.found_values.items() if name not in TERMS_BY_NAME}
    settings = {**case.tolerated, **effects}
    kept = {name: values for name, values in settings.items() if name != SIDE_SLIP}
    with_slip, without = (
        np.abs(np.concatenate([move.turned for move in case.residual_model.simulate_increments(one)]))
        for one in (settings, kept)
    )
    slides = without - with_slip > LEAST_SLIDING_SHARE * without
    lost = float(np.sum((without - with_slip)[slides]))
    return lost <= SLIDING_SHARE * float(np.sum(without[slides]))


def is_named_effect_shadow(selection: CauseSelection, names: Collection[str], name: str) -> bool:
    """Whether an effect accompanies a named one of the same group and is not significant alone."""
    group = get_make_dependent_group(name)
    if group is None or not any(get_make_dependent_group(other_name) == group for other_name in names):
        return False
    return name not in selection.effect_ids or not is_significant_alone(selection.residual_model, selection.fit, name)


def is_supported_by_residuals(selection: CauseSelection, term: ModelTerm) -> bool:
    """Whether the residuals also show an effect of the open-loop error: on the same side and beyond its tolerance.

    They must show it in addition to everything in the fit, named or not: an effect that only replaces another one
    leaves them unchanged. Covariates may take up what an effect explains, so it is tested without them.
    """
    residual_model, fit = selection.residual_model, refit_with_covariates(selection.residual_model, selection.fit, ())
    parameters, neutral_at = term.parameters, np.array(term.parameters.neutral)
    coordinates = next((coordinates for candidate, coordinates in fit.parts if candidate.id == parameters.id), None)
    if coordinates is None:
        candidate = fit_candidate(residual_model.compute_changes, fit, parameters, Projector(fit.jacobian))
        coordinates = candidate.coordinates if candidate.gain > LEAST_GAIN else neutral_at
    is_same_side = float((coordinates - neutral_at) @ (term.coordinates - neutral_at)) > 0.0
    return is_same_side and parameters.compute_deviation(coordinates) > find_finest_size(
        residual_model.rig.tractor, parameters.id, residual_model.get_interval_s(parameters.id)
    )


ReportStep = Callable[[], None]


@dataclass(frozen=True, eq=False)
class ExplainedCase:
    """The extension of the tractor and which of it is named; `sure_ids` is that of is_likely.

    `law_terms` are terms of the discrepancy model that stand for the law of a parameter, which explains what they
    remove.
    """

    case: DiagnosisCase
    names: list[str]
    open_loop_fit: OpenLoopFit | None
    sure_ids: frozenset[str] = frozenset()
    law_terms: frozenset[str] = frozenset()


def list_nameable(selection: CauseSelection, tractor: Tractor) -> list[str]:
    """Return effects that may be named: clearly beyond tolerance, alone as well, and not shadows of a covariate."""
    residual_model, fit = selection.residual_model, selection.fit
    names = [
        name
        for name in list_nameable_parts(residual_model, fit, tractor)
        if is_independent_cause(residual_model, fit, name)
    ]
    if not selection.unnamed:
        return names
    shadow_loss = compute_unnamed_gain(fit) * ABOVE_UNNAMED_FACTOR
    separate_blocks = list_separate_blocks(residual_model)
    return [
        name
        for name in names
        if get_effect(name).block in separate_blocks
        or refit_without(residual_model, fit, name).loss - fit.loss > shadow_loss
    ]


def list_separate_blocks(residual_model: ResidualModel) -> tuple[str, ...]:
    """Return the blocks that a measured wheel angle separates from the path, so that their errors show on their own."""
    return (STEERING, SPEED) if residual_model.has_measured_wheel_angle else ()


def explain_error(
    selection: CauseSelection, names: list[str], tractor: Tractor, step: ReportStep, with_search: bool = True
) -> ExplainedCase:
    """Use the effects of the fit alone where they explain the error; else everything that lowers the error of held-out
    runs, unless that is not to be searched (`with_search`)."""
    likely = list_clear_parts(selection, tractor)
    sure_ids = find_sure_parts(selection, names, likely)

    def build_case_with(kept_names: Collection[str]) -> DiagnosisCase:
        return build_case(selection, build_fit_extension(selection.residual_model, selection.fit, kept_names))

    names, case = _find_holding_names(lambda kept_names: build_case_with({*kept_names, *likely}), names)
    likely, case = _find_likely_together(build_case_with, case, names, sure_ids)
    if not with_search or is_within_noise(case, case.final_errors):
        return ExplainedCase(case, names, None, sure_ids)
    likely_beside = [
        name for name in likely if get_effect(name).block in list_separate_blocks(selection.residual_model)
    ]
    names, open_loop_fit, case = _extend_with_names(selection, case, names, likely_beside, tractor, step)
    names += find_irreplaceable(
        open_loop_fit,
        tractor,
        compute_noise_error_share(case),
        step,
        lambda name: name not in names and is_holding(case, name),
    )
    return _drop_doubtful(selection, ExplainedCase(case, names, open_loop_fit, sure_ids))


def _find_likely_together(
    build_case_with: Callable[[Collection[str]], DiagnosisCase],
    case: DiagnosisCase,
    names: Sequence[str],
    sure_ids: frozenset[str],
) -> tuple[list[str], DiagnosisCase]:
    """Return the effects that are likely beside the names and each other, with that case.

    The least useful one is dropped first and the others are tested again: they may have depended on it.
    """
    while True:
        likely = sorted(case.extension.term_ids - set(names))
        doubtful = [name for name in likely if not is_likely(case, name, sure_ids)]
        if not doubtful:
            return likely, case
        least_likely = min(doubtful, key=case.compute_gain_where_visible)
        case = build_case_with(case.extension.term_ids - {least_likely})


def _extend_with_names(
    selection: CauseSelection,
    case: DiagnosisCase,
    names: list[str],
    likely: Sequence[str],
    tractor: Tractor,
    step: ReportStep,
) -> tuple[list[str], OpenLoopFit, DiagnosisCase]:
    """Return names that hold beside all further terms, from a search that began with these, and likely effects.

    Where the path is wrong everywhere, its likely effects are left to the search (see list_separate_blocks).
    """
    while True:
        fixed_terms = tuple(
            ModelTerm(parameters, coordinates)
            for parameters, coordinates in selection.fit.parts
            if parameters.id in {*names, *likely}
        )
        open_loop_fit = search_terms(selection.residual_model, tractor, fixed_terms, step, case.tolerated)
        extended_case = _build_extended_case(selection, open_loop_fit)
        supported_names = find_agreeing_effects(open_loop_fit, tractor)
        kept_names = [name for name in names if name in supported_names and is_holding(extended_case, name)]
        if kept_names == names:
            return names, open_loop_fit, extended_case
        names = kept_names


def find_agreeing_effects(open_loop_fit: OpenLoopFit, tractor: Tractor) -> set[str]:
    """Return fixed effects that the open-loop error alone would also give: beyond tolerance, on the same side."""
    loop, fixed_terms = open_loop_fit.loop, open_loop_fit.loop.fixed_terms
    if not fixed_terms:
        return set()
    free_model = fit_terms(replace(loop, fixed_terms=()), (*fixed_terms, *open_loop_fit.model.terms))
    free_coordinates = {term.parameters.id: term.coordinates for term in free_model.terms[: len(fixed_terms)]}
    agreeing = set()
    for term in fixed_terms:
        name, neutral = term.parameters.id, np.array(term.parameters.neutral)
        is_same_side = float((free_coordinates[name] - neutral) @ (term.coordinates - neutral)) > 0.0
        if is_same_side and term.parameters.compute_deviation(free_coordinates[name]) > find_finest_size(
            tractor, name, loop.residual_model.get_interval_s(name)
        ):
            agreeing.add(name)
    return agreeing


def _build_extended_case(selection: CauseSelection, open_loop_fit: OpenLoopFit) -> DiagnosisCase:
    """Build the case of the fixed terms, as the residuals give them, and of the terms that lower the error further."""
    fixed_ids = [term.parameters.id for term in open_loop_fit.loop.fixed_terms]
    fit_extension = build_fit_extension(selection.residual_model, selection.fit, fixed_ids)
    return build_case(selection, fit_extension.merge(build_open_loop_extension(open_loop_fit)))


def _drop_doubtful(selection: CauseSelection, explained_case: ExplainedCase) -> ExplainedCase:
    """Drop effects that lower the error but may be neutral, and fit the other terms again."""
    case, open_loop_fit = explained_case.case, explained_case.open_loop_fit
    assert open_loop_fit is not None
    doubtful = {
        name
        for name in case.main_terms
        if name not in TERMS_BY_NAME
        and name not in explained_case.names
        and (
            is_named_effect_shadow(selection, explained_case.names, name)
            or not is_likely(case, name, explained_case.sure_ids)
            or (name in open_loop_fit.model.term_ids and not _is_extension_supported(selection, case, name))
        )
    }
    if not doubtful:
        return explained_case
    smaller = keep_terms(selection, explained_case, case.extension.term_ids - doubtful)
    names = [name for name in explained_case.names if is_holding(smaller.case, name)]
    return _drop_doubtful(selection, replace(smaller, names=names))


def keep_terms(selection: CauseSelection, explained_case: ExplainedCase, kept_ids: Collection[str]) -> ExplainedCase:
    """Return the case with some of its terms alone; those of the open-loop error are fitted again."""
    names, open_loop_fit = [name for name in explained_case.names if name in kept_ids], explained_case.open_loop_fit
    if open_loop_fit is None:
        kept_effects = explained_case.case.extension.term_ids & frozenset(kept_ids)
        extension = build_fit_extension(selection.residual_model, selection.fit, kept_effects)
        return replace(explained_case, case=build_case(selection, extension), names=names)
    fixed_terms, kept_terms = (
        tuple(term for term in terms if term.parameters.id in kept_ids)
        for terms in (open_loop_fit.loop.fixed_terms, open_loop_fit.model.terms)
    )
    loop = replace(open_loop_fit.loop, fixed_terms=fixed_terms)
    smaller_fit = OpenLoopFit(loop, fit_terms(loop, kept_terms))
    case = _build_extended_case(selection, smaller_fit)
    return replace(explained_case, case=case, names=names, open_loop_fit=smaller_fit)


def _is_extension_supported(selection: CauseSelection, case: DiagnosisCase, name: str) -> bool:
    """Whether an effect of the open-loop error lowers it in held-out runs and the residuals show it too."""
    return case.compute_held_out_gain(name)[0] > 0.0 and is_supported_by_residuals(selection, case.main_terms[name])


def _find_holding_names(
    build_case_with: Callable[[list[str]], DiagnosisCase], names: list[str]
) -> tuple[list[str], DiagnosisCase]:
    """Return names that hold together, with their case: a dropped one may have been the partner of another."""
    while True:
        case = build_case_with(names)
        holding_names = [name for name in names if is_holding(case, name)]
        if holding_names == names:
            return names, case
        names = holding_names


def is_holding(case: DiagnosisCase, name: str) -> bool:
    """Whether an effect removes error where it shows, without harm to the path, and is clearly not neutral.

    An effect at the limit of its range stands in for something else.
    """
    worth, least_worth = case.compute_gain_where_visible(name), _get_least_error_reduction(case.residual_model, name)
    is_clear = is_clear_of_neutral(case.extension, case.tractor, name)
    is_beyond = (
        is_clear
        and not is_calibration(case.residual_model, case.main_terms[name])
        and not is_reaching_limit(case, name)
        and not (name == SIDE_SLIP and is_radius_tolerance(case))
    )
    return is_beyond and worth >= least_worth and case.compute_held_out_gain(name)[0] > -HARM_PCT


def _get_least_error_reduction(residual_model: ResidualModel, name: str) -> float:
    """Return the percentage of held-out error that an effect must remove: less is the trace of a simplification."""
    of_wheel = get_effect(name).block == STEERING and residual_model.has_measured_wheel_angle
    return WORTH_OF_WHEEL_PCT if of_wheel else WORTH_A_NAME_PCT


@dataclass(frozen=True)
class UnexplainedError:
    """Error that no effect explains: share of the error over 5 s above the noise floor, and horizons (s) above it.

    Where a `hint` tells of starts and stops, the share is that at the measured speed.
    """

    share: float
    above_s: tuple[float, ...]
    hint: Hint | None = None


def measure_unexplained(explained_case: ExplainedCase, before: Array) -> UnexplainedError:
    """Measure the error that no effect removes; the share is 0 while the remaining error is noise.

    Terms of the discrepancy model are no effects: what they remove is described, not explained.
    """
    case = explained_case.case
    described_ids = frozenset(TERMS_BY_NAME) - explained_case.law_terms
    settings = case.extension.select_held_out_settings(case.extension.term_ids - described_ids)
    squares = case.simulate_squares(settings)
    horizons_above = find_horizons_above_noise(case, squares)
    if ERROR_PIECE_S not in horizons_above:
        return UnexplainedError(0.0, horizons_above)
    hint = describe_speed_changes(case)
    if hint is not None:
        squares = case.simulate_squares(settings, by_speed=True)
        if is_within_noise(case, case.compute_run_errors(squares), by_chance=True):
            return UnexplainedError(0.0, horizons_above, hint)
    noise_floor, remaining_error = (
        float(case.compute_run_errors(case.noise_floor).sum()),
        float(case.compute_run_errors(squares).sum()),
    )
    share = (remaining_error - noise_floor) / max(float(before.sum()) - noise_floor, remaining_error - noise_floor)
    return UnexplainedError(float(share) if share > LEAST_REPORTED_SHARE else 0.0, horizons_above, hint)


def drop_outweighed_names(selection: CauseSelection, explained_case: ExplainedCase) -> ExplainedCase:
    """Return the case without names that explain little beside what no effect explains.

    A name that removes less than OUTWEIGHED_SHARE of the error that remains is only likely, and with less than
    FAR_OUTWEIGHED_SHARE it is left out: what causes the rest may look like it. Effects that sensors separate from the
    path (list_separate_blocks) show on their own and keep their names.
    """
    case, separate_blocks = explained_case.case, list_separate_blocks(selection.residual_model)
    doubtful = [name for name in explained_case.names if get_effect(name).block not in separate_blocks]
    if not doubtful or is_within_noise(case, case.final_errors, by_chance=True):
        return explained_case
    weights = {name: _weigh_against_rest(case, name) for name in doubtful}
    kept_ids = {name for name in case.extension.term_ids if weights.get(name, 1.0) >= FAR_OUTWEIGHED_SHARE}
    names = [name for name in explained_case.names if weights.get(name, 1.0) >= OUTWEIGHED_SHARE]
    smaller = explained_case if kept_ids == case.extension.term_ids else keep_terms(selection, explained_case, kept_ids)
    return replace(smaller, names=names)


def _weigh_against_rest(case: DiagnosisCase, name: str) -> float:
    """Return the squared error that a name removes, as a share of what remains above the noise with effects alone."""
    effects = case.extension.term_ids - frozenset(TERMS_BY_NAME)
    with_name, without = (
        float(case.simulate_run_errors(case.extension.select_held_out_settings(kept), by_speed=True).sum())
        for kept in (effects, effects - {name})
    )
    rest = with_name - float(case.compute_run_errors(case.noise_floor).sum())
    return (without - with_name) / rest if rest > 0.0 else 1.0


def drop_open_names(selection: CauseSelection, explained_case: ExplainedCase) -> ExplainedCase:
    """Return the case without names that tolerances of the tractor file may look like, unless an alternative is known.

    With one the set is told, and the drive that decides.
    """
    residual_model, fit = selection.residual_model, selection.fit
    open_ids = {
        name
        for name in explained_case.names
        if name in fit.settings
        and not selection.lookalikes.get(name)
        and is_within_tolerances(residual_model, fit, name)
    }
    if not open_ids:
        return explained_case
    return keep_terms(selection, explained_case, explained_case.case.extension.term_ids - open_ids)
