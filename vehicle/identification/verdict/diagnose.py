"""From logs to a diagnosis: the order of the work, and the results.

Causes are chosen by the residuals of the logs (cause_selection). Where residuals remain that no cause explains, the
open-loop error itself is lowered (model_extension); the added terms are a calibration without a name, unless nothing
else could replace them (named_causes).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vehicle.identification.cause_selection.selection import CauseSelection
from vehicle.identification.columns.staleness import mark_stale_columns_of_set
from vehicle.identification.columns.wheel_scale import correct_wheel_scale
from vehicle.identification.diagnosis.log_notes import (
    build_fault_diagnosis,
    check_runs,
    describe_columns,
    describe_unsaved_names,
    list_diagnosis_notes,
    list_onset_faults,
    mark_other_turning,
    mark_unlike_runs,
)
from vehicle.identification.diagnosis.results import (
    EQUIVALENT,
    NAMED,
    NOT_VISIBLE,
    Diagnosis,
    Finding,
    GroundLevel,
)
from vehicle.identification.errors import LogError
from vehicle.identification.faults.heading_kind import drop_course_headings
from vehicle.identification.faults.steering_faults import mark_steering_faults
from vehicle.identification.faults.turning_kind import ARTICULATED, find_other_turning
from vehicle.identification.faults.unlike_runs import RunDifference, describe_groups, find_unlike_runs
from vehicle.identification.fit.open_loop import collect_run_settings
from vehicle.identification.laws.bases import OVER_DAY, RunClock, build_run_clock
from vehicle.identification.laws.settle import LawSelection, settle_laws
from vehicle.identification.logs.column_quality import drop_columns_coarse_elsewhere, drop_commands_not_logged
from vehicle.identification.logs.command_checks import correct_commanded_speeds
from vehicle.identification.logs.log_sets import merge_copies
from vehicle.identification.logs.reader import count_rows_left_out
from vehicle.identification.logs.schema import Array, Log
from vehicle.identification.logs.sensor_checks import correct_sensors_like_others
from vehicle.identification.model_extension.term_proposals import assign_clear_level_runs, sum_driving_time
from vehicle.identification.model_extension.tractor_extension import (
    EquivalentEffect,
    ModelExtension,
    build_extended_tractor,
)
from vehicle.identification.replay.drive_programmes import find_usual_heading_and_speed
from vehicle.identification.replay.drive_segments import DriveDataset, build_dataset
from vehicle.identification.replay.horizon_errors import (
    FEWEST_PIECE_ROWS,
    HalfSettings,
    HorizonSquares,
    compute_horizon_errors,
    find_piece_bounds,
    make_zero_squared_errors,
    sum_squared_errors_by_run,
)
from vehicle.identification.replay.rig import ReplayRig, build_rig, build_rig_and_corrections
from vehicle.identification.residuals.innovations import refuse_spinning_simulation
from vehicle.identification.residuals.residual_model import ResidualModel, build_residual_model
from vehicle.identification.thresholds import SAME_ERROR_FACTOR
from vehicle.identification.verdict.correlations import compute_value_correlations, describe_intervals
from vehicle.identification.verdict.cross_fit import SearchedRuns, explain_agreeing_runs, explain_selection
from vehicle.identification.verdict.findings import (
    CompetitorsByName,
    add_delay_like_competitors,
    build_findings,
    choose_next_drive,
)
from vehicle.identification.verdict.guard import GuardedCase, guard_case, guard_groups
from vehicle.identification.verdict.held_out_case import (
    ERROR_PIECE_S,
    DiagnosisCase,
    build_whole_dataset_case,
    collect_whole_settings,
    restore_real_noise,
)
from vehicle.identification.verdict.hints import add_hints, find_wrong_heading, hint_at_withdrawn
from vehicle.identification.verdict.law_drives import choose_law_drive, choose_side_drive
from vehicle.identification.verdict.law_findings import (
    add_laws,
    describe_offset_at_work,
    leave_out_stand_ins,
    mark_one_sided,
)
from vehicle.identification.verdict.named_causes import ExplainedCase, ReportStep, keep_terms, measure_unexplained
from vehicle.identification.verdict.residual_curves import build_residual_plot
from vehicle.identification.verdict.unclear_findings import (
    doubt_names,
    doubt_shared_lateness,
    doubt_stand_ins,
    drop_unclear_terms,
    withdraw_cancelling_delays,
    withdraw_faked,
    withdraw_unclear,
)
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effects import get_effect
from vehicle.model.tractor import Tractor

ReportProgress = Callable[[int, int], None]


def diagnose_logs(
    logs: Sequence[Log], tractor: Tractor, ground: str, progress: ReportProgress | None = None
) -> Diagnosis:
    """Return what the simulation of a tractor gets wrong in these logs, why, and the gain of correcting it.

    Effects that the tractor file already has are removed and fitted again; the error before is that of the file.
    `progress` is called with steps done and an estimate of all steps. Raises LogError when no segment can be replayed
    or none has enough positions for an error, unless faults are to be told, and VehicleError for an unknown ground or a
    tractor that spins.
    """
    count = _ProgressCounter(progress)
    logs = correct_wheel_scale(correct_logs(logs, tractor), tractor, ground)
    try:
        dataset = build_dataset(logs, (tractor.antenna_forward_m, tractor.antenna_right_m))
        _refuse_sparse(dataset)
    except LogError as error:
        if not any(log.faults for log in logs):
            raise
        return build_fault_diagnosis(logs, tractor, ground, str(error))
    rig = build_rig(tractor, ground, dataset.origin)
    refuse_spinning_simulation(rig, dataset.segments)
    unlike_runs = find_unlike_runs(logs, tractor, ground)
    searched, clock, law_selection = _search_causes(logs, dataset, rig, unlike_runs, count.count_step)
    agreeing, subset = searched.agreeing, searched.subset
    selection, explained_case = searched.selection, searched.explained
    if law_selection.selection is not selection:
        selection = law_selection.selection
        explained_case = explain_selection(selection, rig.tractor, count.count_step)
        explained_case = leave_out_stand_ins(explained_case, law_selection)
    changing_ids = [law.found.effect_id for law in law_selection.laws]
    explained_case = drop_unclear_terms(selection, explained_case, changing_ids)
    wrong_heading = find_wrong_heading(logs, explained_case.case.found_values)
    faked_ids = wrong_heading.faked_ids if wrong_heading is not None else frozenset[str]()
    if faked_ids & explained_case.case.extension.term_ids:
        explained_case = keep_terms(selection, explained_case, explained_case.case.extension.term_ids - faked_ids)
    file_model = build_rig_and_corrections(tractor, ground, dataset.origin)
    guarded = guard_case(agreeing, subset, selection, explained_case, file_model, count.count_step)
    guarded = guard_groups(guarded, dataset, subset, selection, file_model) if searched.left_out else guarded
    withdrawn_ids = explained_case.case.extension.term_ids - guarded.explained.case.extension.term_ids
    explained_case = guarded.explained
    competitors = _collect_competitors(selection, explained_case)
    turning = find_other_turning(logs, tractor)
    faked_ids |= turning.faked_ids if turning is not None else frozenset[str]()
    count.count_step()
    findings = build_findings(explained_case.case, explained_case.names, competitors, count.count_step)
    findings = add_laws(findings, law_selection, clock, subset.dataset.names, rig.tractor, explained_case)
    findings = withdraw_faked(withdraw_unclear(findings, explained_case.case), faked_ids)
    findings = doubt_shared_lateness(withdraw_cancelling_delays(findings))
    findings = doubt_stand_ins(findings, tractor, has_unnamed=bool(selection.unnamed))
    findings = doubt_names(findings) if turning is not None and turning.kind == ARTICULATED else findings
    findings = describe_offset_at_work(mark_one_sided(findings, subset.dataset), tractor.wheelbase_m)
    names = [name for name in explained_case.names if name not in faked_ids]
    guarded = replace(guarded, explained=replace(explained_case, names=names))
    whole_explained = replace(explained_case, case=build_whole_dataset_case(agreeing, subset, explained_case.case))
    _, saved_settings = collect_whole_settings(dataset, subset, guarded.saved.case)
    diagnosis = _build_diagnosis(
        dataset, selection, guarded, whole_explained, saved_settings, findings, competitors, tractor, ground
    )
    if diagnosis.unexplained_share > 0.0:
        diagnosis = add_hints(diagnosis, law_selection, explained_case.case, clock)
        diagnosis = hint_at_withdrawn(diagnosis, withdrawn_ids)
    if wrong_heading is not None:
        hint = wrong_heading.hint
        diagnosis = replace(diagnosis, known_outside=hint.words, hints=(hint, *diagnosis.hints))
    drive = diagnosis.next_drive or choose_law_drive(law_selection) or choose_side_drive(selection, findings)
    diagnosis = replace(diagnosis, runs=mark_unlike_runs(diagnosis.runs, searched.left_out), next_drive=drive)
    diagnosis = diagnosis if turning is None else mark_other_turning(diagnosis, turning)
    count.report_completion()
    valued_ids = [finding.id for finding in findings if finding.interval]
    notes = list_diagnosis_notes(logs, selection.residual_model, tractor, diagnosis)
    unsaved_notes = describe_unsaved_names(set(guarded.unsaved_names) - faked_ids, set(guarded.shown_names) - faked_ids)
    group_notes = describe_groups(unlike_runs, logs, bool(searched.left_out))
    return replace(
        diagnosis,
        rows_gated_by_reason=count_rows_left_out(logs, dataset.rows),
        faults=list_onset_faults(logs),
        interval_note=describe_intervals(selection.residual_model, selection.fit, valued_ids),
        columns=describe_columns(logs, diagnosis.findings),
        notes=(*group_notes, *notes, *unsaved_notes),
    )


def _search_causes(
    logs: Sequence[Log], dataset: DriveDataset, rig: ReplayRig, unlike_runs: Sequence[RunDifference], step: ReportStep
) -> tuple[SearchedRuns, RunClock, LawSelection]:
    """Return causes and laws of the runs that agree, or of all runs where a law over the day explains those unlike."""

    def search_without(unlike: Sequence[RunDifference]) -> tuple[SearchedRuns, RunClock, LawSelection]:
        searched = explain_agreeing_runs(dataset, rig, unlike, step)
        clock = build_run_clock(logs, searched.subset.runs)
        return searched, clock, settle_laws(searched.selection, clock, rig.tractor)

    of_agreeing = search_without(unlike_runs)
    if not of_agreeing[0].left_out or unlike_runs[0].group:
        return of_agreeing
    of_all = search_without(())
    return of_all if any(law.found.kind == OVER_DAY for law in of_all[2].laws) else of_agreeing


def correct_logs(logs: Sequence[Log], tractor: Tractor) -> list[Log]:
    """Return the logs as they are replayed: each drive once, without coarse columns, courses for headings and rows of
    faults that begin, with sensors and commanded speeds corrected."""
    logs = drop_commands_not_logged(drop_columns_coarse_elsewhere(merge_copies(logs)))
    logs = mark_steering_faults(drop_course_headings(logs, tractor))
    return mark_stale_columns_of_set(correct_commanded_speeds(correct_sensors_like_others(logs)))


def _list_competitors_of_likely(selection: CauseSelection, explained_case: ExplainedCase) -> CompetitorsByName:
    """Return the alternatives to effects that are only likely."""
    likely_ids = explained_case.case.extension.term_ids - set(explained_case.names)
    return {name: others for name, others in selection.lookalikes.items() if name in likely_ids and others}


def _collect_competitors(selection: CauseSelection, explained_case: ExplainedCase) -> CompetitorsByName:
    """Return the alternatives to each name of the fit, by the residuals or for lack of a heading."""
    competitors = {
        name: selection.lookalikes.get(name, {}) if name in selection.effect_ids else {}
        for name in explained_case.names
    }
    return add_delay_like_competitors(
        selection.residual_model, competitors, explained_case.case.found_values, explained_case.case.extension.term_ids
    )


def _refuse_sparse(dataset: DriveDataset) -> None:
    if not any(len(find_piece_bounds(segment.time, ERROR_PIECE_S)[0]) for segment in dataset.segments):
        raise LogError(
            f"No {ERROR_PIECE_S:g} s of these logs hold {FEWEST_PIECE_ROWS} measured positions, the fewest that "
            "errors are computed "
            "from; log positions at 1 Hz or faster, without rows that are lost."
        )


class _ProgressCounter:
    """Progress in steps; the total is not known beforehand, so the estimate grows when necessary."""

    def __init__(self, progress: ReportProgress | None) -> None:
        self.progress, self.steps_done, self.steps_total = progress, 0, 100

    def count_step(self) -> None:
        """Count one step."""
        self.steps_done += 1
        self.steps_total = max(self.steps_total, self.steps_done + 20)
        if self.progress:
            self.progress(self.steps_done, self.steps_total)

    def report_completion(self) -> None:
        """Report that everything is done."""
        if self.progress:
            self.progress(self.steps_total, self.steps_total)


def _build_diagnosis(
    dataset: DriveDataset,
    selection: CauseSelection,
    guarded: GuardedCase,
    whole_explained: ExplainedCase,
    saved_settings: Mapping[int, HalfSettings],
    findings: list[Finding],
    competitors: CompetitorsByName,
    tractor: Tractor,
    ground: str,
) -> Diagnosis:
    """Build the diagnosis: causes from the searched subset, errors from the whole dataset, with what may be saved."""
    explained_case, saved = guarded.explained, guarded.saved.case.extension
    residual_model, fit, case = selection.residual_model, selection.fit, explained_case.case
    extension = case.extension
    file_rig, settings = build_rig_and_corrections(tractor, ground, dataset.origin)
    before = sum_squared_errors_by_run(dataset, file_rig, dict.fromkeys(range(len(dataset.names)), settings))
    after = sum_squared_errors_by_run(dataset, residual_model.rig, saved_settings)
    before_explained = whole_explained.case.compute_run_errors(select_run_squares(before, whole_explained.case))
    # Most important first: by the held-out error that returns without the effect.
    by_gain = sorted(findings, key=lambda finding: -(finding.gain_pct or 0.0))
    named = [finding.id for finding in by_gain if finding.status == NAMED]
    equivalents = {
        finding.id: EquivalentEffect(finding.interval, finding.equivalent_to)
        for finding in findings
        if finding.status == EQUIVALENT
    }
    certain_ids = {*named, *equivalents}
    unexplained = measure_unexplained(whole_explained, before_explained)
    share = unexplained.share
    unseen_ids = [finding.id for finding in findings if finding.status == NOT_VISIBLE and finding.value is None]
    return Diagnosis(
        names=dataset.names,
        rows_used=dataset.rows,
        rows_gated=dataset.rows_read - dataset.rows,
        minutes=dataset.seconds / 60.0,
        ground=ground,
        before=compute_horizon_errors(before),
        after=compute_horizon_errors(after),
        noise_floor=compute_horizon_errors(whole_explained.case.noise_floor),
        guilty_block=_find_named_cause_block(named, findings, selection if share > 0.0 else None),
        block_error=_compute_block_errors(restore_real_noise(residual_model, fit), case),
        findings=tuple(findings),
        named=tuple(named),
        unexplained_share=share,
        depends_on=_list_covariates(selection, extension) if share > 0.0 else (),
        next_drive=choose_next_drive(
            residual_model,
            fit,
            residual_model.rig.tractor,
            {**competitors, **_list_competitors_of_likely(selection, explained_case)},
            case.found_values,
        ),
        tractor=_choose_discrepancy_model(
            tractor,
            build_extended_tractor(residual_model.dataset, tractor, ground, saved, named, equivalents, unseen_ids)
            if not guarded.unsaved_reason
            else tractor,
            before_explained,
            whole_explained.case.final_errors,
        ),
        calibration={name: value for name, value in case.found_values.items() if name not in certain_ids},
        curve=build_residual_plot(
            residual_model,
            {run: collect_run_settings(extension.terms, run) for run in range(len(residual_model.dataset.names))},
            named or list(competitors),
            selection.unnamed,
        ),
        grounds=_describe_ground_levels(explained_case),
        pace_mps=find_usual_heading_and_speed(dataset.segments)[1],
        along_judged=whole_explained.case.residual_model.has_measured_speed,
        above_noise_s=unexplained.above_s,
        correlations=compute_value_correlations(fit),
        runs=check_runs(dataset, before, after),
        holdout=guarded.holdout,
        hints=(unexplained.hint,) if unexplained.hint is not None else (),
        unsaved_reason=guarded.unsaved_reason,
    )


def select_run_squares(squares: Sequence[HorizonSquares], case: DiagnosisCase) -> list[HorizonSquares]:
    """Return the squared errors of runs (one each) with those of the runs of a case alone; the others are empty."""
    runs = {segment.run for segment in case.residual_model.dataset.segments}
    empty = make_zero_squared_errors(len(squares))
    return [squares[run] if run in runs else empty[run] for run in range(len(squares))]


def _list_covariates(selection: CauseSelection, extension: ModelExtension) -> tuple[str, ...]:
    """Return what the remaining error depends on: the covariates of the fit, else those of the discrepancy model."""
    discrepancy_covariates = [
        f"{TERMS_BY_NAME[name].effect} that depends on {TERMS_BY_NAME[name].regressor}"
        for name in TERMS_BY_NAME
        if name in extension.term_ids
    ]
    return tuple(covariate.description for covariate in selection.unnamed) or tuple(
        dict.fromkeys(discrepancy_covariates)
    )


def _choose_discrepancy_model(tractor: Tractor, extended: Tractor, before: Array, after: Array) -> Tractor:
    """Keep the discrepancy model of the file, unless there is a new one or these logs contradict it."""
    if (
        extended.discrepancy_model is not None
        or tractor.discrepancy_model is None
        or float(before.sum()) > SAME_ERROR_FACTOR * float(after.sum())
    ):
        return extended
    return extended.model_copy(update={"discrepancy_model": tractor.discrepancy_model})


def _find_named_cause_block(
    named: list[str], findings: list[Finding], unexplained_selection: CauseSelection | None
) -> str | None:
    """Return the block of the first name; without one, of the first alternative, or of the first covariate."""
    if named:
        return get_effect(named[0]).block
    equivalents = [finding for finding in findings if finding.status == EQUIVALENT]
    if equivalents:
        return equivalents[0].block
    return (
        unexplained_selection.unnamed[0].block
        if unexplained_selection is not None and unexplained_selection.unnamed
        else None
    )


def _compute_block_errors(residual_model: ResidualModel, case: DiagnosisCase) -> dict[str, tuple[float, float]]:
    """Per channel cut at the sensors, the root mean square residual before and after (1 is noise alone)."""
    main = collect_run_settings([replace(term, runs=None) for term in case.main_terms.values()], 0)
    residual_model = build_residual_model(residual_model.dataset, residual_model.rig, main, residual_model.noise)
    first, last = residual_model.compute_residuals({}), np.zeros(5 * residual_model.dataset.rows)
    settings_by_run = {
        run: collect_run_settings(case.extension.terms, run) for run in range(len(residual_model.dataset.names))
    }
    for settings in {str(run_settings): run_settings for run_settings in settings_by_run.values()}.values():
        is_run = np.isin(
            residual_model.residual_runs,
            [run for run, run_settings in settings_by_run.items() if run_settings == settings],
        )
        last[is_run] = residual_model.compute_residuals(settings)[is_run]
    rows = residual_model.dataset.rows
    channels = {
        "wheel to path and antenna": slice(0, 3 * rows),
        "command to wheel": slice(3 * rows, 4 * rows),
        "speed": slice(4 * rows, 5 * rows),
    }
    return {
        name: (float(np.sqrt(np.mean(first[channel] ** 2))), float(np.sqrt(np.mean(last[channel] ** 2))))
        for name, channel in channels.items()
        if np.any(first[channel])
    }


def _describe_ground_levels(explained_case: ExplainedCase) -> tuple[GroundLevel, ...]:
    """Effects with two levels and the runs that were clearly at each, the longer driving first."""
    if explained_case.open_loop_fit is None:
        return ()
    dataset = explained_case.case.residual_model.dataset
    seconds = sum_driving_time(dataset)
    levels = []
    for term, runs in assign_clear_level_runs(explained_case.open_loop_fit.loop, explained_case.open_loop_fit.model):
        entry, value = get_effect(term.parameters.id), term.value
        level = GroundLevel(entry.id, value, entry.describe(value), tuple(dataset.names[run] for run in runs))
        levels.append((-float(seconds[sorted(term.runs or ())].sum()), level))
    return tuple(level for _, level in sorted(levels, key=lambda pair: pair[0]))
