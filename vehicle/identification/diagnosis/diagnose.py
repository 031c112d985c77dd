"""From logs to a diagnosis: the order of the work, and its result with a finding per effect of the catalogue."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from vehicle.errors import VehicleError
from vehicle.identification.diagnosis.corrections import correct_logs
from vehicle.identification.diagnosis.curves import build_residual_plot
from vehicle.identification.diagnosis.drive_data import build_drive_data, choose_informative_parts
from vehicle.identification.diagnosis.grammar import BY_RUN, build_constant, scale_effect
from vehicle.identification.diagnosis.hints import compute_noise_floor, find_hints, measure_unexplained
from vehicle.identification.diagnosis.log_notes import (
    add_outside,
    build_fault_diagnosis,
    check_runs,
    describe_clocks,
    describe_columns,
    describe_file_corrections,
    describe_logs,
    list_onset_faults,
)
from vehicle.identification.diagnosis.model_fit import Problem
from vehicle.identification.diagnosis.next_drive import CompetingPair, choose_next_drive, find_usual_heading_and_speed
from vehicle.identification.diagnosis.other_vehicles import ARTICULATED, find_other_turning
from vehicle.identification.diagnosis.results import EQUIVALENT, LIKELY, NAMED, NOT_VISIBLE, REFUTED, Diagnosis, Finding
from vehicle.identification.diagnosis.saving import Saved, build_extended_tractor, choose_saved
from vehicle.identification.diagnosis.search import Searcher, SearchResult
from vehicle.identification.diagnosis.verdicts import (
    Verdict,
    compute_interval,
    compute_value_correlations,
    compute_values,
    decide,
    describe_law,
    find_pattern,
    find_smallest_visible,
)
from vehicle.identification.errors import LogError
from vehicle.identification.logs.reader import count_rows_left_out
from vehicle.identification.logs.schema import Log
from vehicle.identification.replay.drive_segments import (
    DriveDataset,
    build_dataset,
    build_rig,
    build_rig_and_corrections,
)
from vehicle.identification.replay.horizon_errors import (
    ERROR_PIECE_S,
    FEWEST_PIECE_ROWS,
    compute_horizon_errors,
    find_piece_bounds,
    measure_dataset,
)
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effect_kinds import CIRCLE
from vehicle.model.effects import CATALOGUE, EFFECTS_BY_ID, Effect, get_effect, get_neutral_values
from vehicle.model.tractor import Tractor

ReportProgress = Callable[[int, int], None]
COMPASS = "heading_bias@by_direction"
BLOCKS = {"pose": "wheel to path and antenna", "wheel": "command to wheel", "speed": "speed"}
INTERVAL_NOTE = (
    "Intervals hold 95 %: the scatter between runs where that is more than the noise tells, and what the base model is "
    "known to leave open."
)


def diagnose_logs(
    logs: Sequence[Log], tractor: Tractor, ground: str, progress: ReportProgress | None = None
) -> Diagnosis:
    """What the simulation of a tractor gets wrong in these logs, why, and the gain of correcting it.

    Effects that the tractor file already has are removed and fitted again; the error before is that of the file.
    `progress` is called with steps done and an estimate of all steps. Raises LogError when no segment can be replayed
    or none has enough positions for an error, unless faults are to be reported, and VehicleError for an unknown ground
    or a tractor that spins.
    """
    count = _ProgressCounter(progress)
    logs = correct_logs(logs, tractor)
    try:
        dataset = build_dataset(logs, (tractor.antenna_forward_m, tractor.antenna_right_m))
        if not any(len(find_piece_bounds(segment.time, ERROR_PIECE_S)[0]) for segment in dataset.segments):
            raise LogError(
                f"No {ERROR_PIECE_S:g} s of these logs hold {FEWEST_PIECE_ROWS} measured positions, the fewest that "
                "errors are computed from; log positions at 1 Hz or faster, without rows that are lost."
            )
        data = build_drive_data(choose_informative_parts(dataset))
    except LogError as error:
        if not any(log.faults for log in logs):
            raise
        return build_fault_diagnosis(logs, tractor, ground, str(error))
    problem = Problem(data, build_rig(tractor, ground, dataset.origin))
    # No vehicle turns by more than half a turn between two rows; no number is more, too.
    if not problem.simulator.measure_fastest_turn() * data.row_step_s <= math.pi:
        raise VehicleError(
            f"The simulation of {tractor.name} spins where these logs drive; the axles, the mass, the length and the "
            "width in its tractor file cannot be those of one vehicle."
        )
    result = Searcher(problem, count.count_step).run()
    verdicts = decide(problem, result)
    saved = choose_saved(problem, result.fit, verdicts, count.count_step)
    turning = find_other_turning(logs, tractor)
    compass, kept = None, list[Verdict]()
    for verdict in verdicts:
        effect = EFFECTS_BY_ID.get(verdict.hypothesis.id)
        is_refused = verdict.hypothesis.is_storable and all(one is not verdict for one in saved.verdicts)
        if is_refused and not (effect is not None and effect.is_of_log_alone):
            # What left-out runs refuse: a name becomes likely, anything else is dropped, but columns no path shows.
            if verdict.status != NAMED:
                continue
            verdict = replace(verdict, status=LIKELY)
        if str(verdict.hypothesis) == COMPASS:
            compass = verdict
        elif turning is None or verdict.hypothesis.id not in turning.faked_ids:
            # Without what only stands in for a vehicle that turns otherwise; with a joint nothing has a name, as rams
            # that move half of the vehicle are not those of the file.
            is_joint = turning is not None and turning.kind == ARTICULATED
            kept.append(replace(verdict, status=LIKELY) if is_joint else verdict)
    diagnosis = _Composer(logs, dataset, tractor, ground, problem, result, saved, kept).compose()
    count.report_completion()
    return add_outside(diagnosis, None if compass is None else float(np.linalg.norm(compass.amounts)), turning)


class _ProgressCounter:
    """Progress in steps; the total is not known beforehand, so the estimate grows when necessary."""

    def __init__(self, progress: ReportProgress | None) -> None:
        self.progress, self.steps_done, self.steps_total = progress, 0, 60

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


@dataclass(frozen=True, eq=False)
class _Composer:
    """Composes the diagnosis of what was found."""

    logs: Sequence[Log]
    dataset: DriveDataset
    tractor: Tractor
    ground: str
    problem: Problem
    result: SearchResult
    saved: Saved
    verdicts: Sequence[Verdict]

    def compose(self) -> Diagnosis:
        """The diagnosis: causes from the windows, errors from all driving."""
        dataset, problem, result = self.dataset, self.problem, self.result
        findings = self.build_findings()
        extended = build_extended_tractor(self.problem, self.tractor, self.ground, self.saved.verdicts, findings)
        before, after = (
            measure_dataset(dataset, *build_rig_and_corrections(one, self.ground, dataset.origin))
            for one in (self.tractor, extended)
        )
        floor = compute_noise_floor(problem, result.fit, dataset)
        unexplained_share, above_s = measure_unexplained(dataset, problem.data.row_step_s, floor, before, after)
        clearest = sorted(findings, key=lambda one: -(one.gain_pct or 0.0))  # by the error that returns without it
        named = tuple(one.id for one in clearest if one.status == NAMED)
        equivalents = [one for one in findings if one.status == EQUIVALENT]
        blocks = [*(get_effect(name).block for name in named), *(one.block for one in equivalents)]
        curves = [*named, *(str(one.hypothesis) for one in self.verdicts)]  # the first name, or the clearest verdict
        patterns = [(one.hypothesis.id, find_pattern(self.problem, one)) for one in self.verdicts]
        odd_runs = {one.run: name for name, one in patterns if one is not None and one.kind == BY_RUN}
        diagnosis = Diagnosis(
            names=dataset.names,
            rows_used=dataset.rows,
            rows_gated=dataset.rows_read - dataset.rows,
            minutes=dataset.seconds / 60.0,
            ground=self.ground,
            before=compute_horizon_errors(before),
            after=compute_horizon_errors(after),
            noise_floor=compute_horizon_errors(floor),
            guilty_block=blocks[0] if blocks else None,
            block_error=self._compute_block_errors(),
            findings=tuple(findings),
            named=named,
            unexplained_share=unexplained_share,
            depends_on=self._list_dependences(),
            next_drive=choose_next_drive(problem, result.fit, self._list_pairs()),
            tractor=extended,
            calibration=self._list_uncertain_values(extended, {*named, *(one.id for one in equivalents)}),
            curve=build_residual_plot(problem, result.base, result.fit, curves[0]) if curves else None,
            pace_mps=find_usual_heading_and_speed(dataset.segments)[1],
            along_judged=dataset.has_speed,
            above_noise_s=above_s,
            correlations=compute_value_correlations(problem, result.fit),
            runs=check_runs(dataset, before, after, odd_runs),
            holdout=self.saved.holdout,
            hints=find_hints(problem, result.fit, result.judgements) if above_s else (),
            interval_note=INTERVAL_NOTE if any(one.interval for one in findings) else "",
            rows_gated_by_reason=count_rows_left_out(self.logs, dataset.rows),
            faults=list_onset_faults(self.logs),
            columns=describe_columns(self.logs, findings),
            file_effects=tuple(self.tractor.effects),
        )
        notes = (
            *describe_logs(self.logs, dataset),
            *describe_clocks(self.logs, diagnosis),
            *describe_file_corrections(self.tractor, diagnosis),
        )
        return replace(diagnosis, notes=notes)

    def _list_uncertain_values(self, extended: Tractor, certain: Set[str]) -> dict[str, dict[str, float]]:
        """Values by effect that the extended file has beside those of the old file and of effects that are certain."""
        return {
            name: dict(setting.value)
            for name, setting in extended.effects.items()
            if name not in certain and name not in self.tractor.effects
        }

    def _list_dependences(self) -> tuple[str, ...]:
        """What the saved laws change, and what that depends on, each once."""
        terms = [TERMS_BY_NAME[name] for one in self.saved.verdicts for name in one.hypothesis.terms]
        return tuple(dict.fromkeys(f"{one.effect} that depends on {one.regressor}" for one in terms))

    def _list_pairs(self) -> list[CompetingPair]:
        """What the next drive is to separate: alternatives of an equivalent set, or something likely from nothing."""
        pairs: list[CompetingPair] = []
        for verdict in self.verdicts:
            own = verdict.hypothesis, verdict.amounts
            for one in verdict.others:
                if one.alternative is not None and one.amounts is not None:
                    pairs.append((own, (one.alternative, one.amounts)))
            if verdict.status == LIKELY and not verdict.others:
                pairs.append((own, None))
        return pairs

    def _compute_block_errors(self) -> dict[str, tuple[float, float]]:
        """Per channel cut at the sensors, the root mean square residual before and after (1 is noise alone)."""
        errors = {}
        for channel, noise in self.problem.noise.items():
            if noise.observed.any():
                before, after = (
                    float(np.sqrt((noise.whiten(fit.residuals[channel]) ** 2).sum() / noise.observed.sum()))
                    for fit in (self.result.base, self.result.fit)
                )
                errors[BLOCKS[channel]] = before, after
        return errors

    def build_findings(self) -> list[Finding]:
        """A finding for every effect of the catalogue, in its order."""
        visible = find_smallest_visible(self.problem, self.result.fit)
        known = [one for one in self.verdicts if one.hypothesis.id in EFFECTS_BY_ID]
        by_id = {
            name: [one for one in known if one.hypothesis.id == name] for name in (one.hypothesis.id for one in known)
        }
        findings = {effect_id: self._build_found(own, visible.get(effect_id)) for effect_id, own in by_id.items()}
        for verdict in known:  # effects that could take the place of one
            for other in verdict.others if verdict.status == EQUIVALENT else ():
                alternative, amounts = other.alternative, other.amounts
                if alternative is None or amounts is None or not alternative.is_catalogued:
                    continue
                effect, value = get_effect(alternative.id), compute_values(self.problem, alternative, amounts)
                sets = (verdict.hypothesis.id, *(one for one in verdict.equivalent_to if one != effect.id))
                finding = Finding(
                    effect.id,
                    EQUIVALENT,
                    value,
                    smallest_visible=visible.get(effect.id),
                    description=effect.describe(value),
                    equivalent_to=tuple(one for one in sets if one in EFFECTS_BY_ID),
                    exchange=f"looks like {get_effect(verdict.hypothesis.id).label}",
                )
                findings.setdefault(effect.id, finding)
        return [findings.get(one.id) or self._build_absent(one, visible.get(one.id)) for one in CATALOGUE]

    def _build_found(self, verdicts: Sequence[Verdict], visible: float | None) -> Finding:
        """The finding of an effect: its constant with a law, if it has one."""
        constants = [one for one in verdicts if one.hypothesis.is_catalogued]
        main = (constants or list(verdicts))[0]
        effect = get_effect(main.hypothesis.id)
        is_circle = effect.kind is CIRCLE  # its place is its law
        laws = [one for one in verdicts if not (one.hypothesis.is_catalogued or is_circle) and
                one.hypothesis.law != "with_speed"]  # fmt: skip
        value, interval = dict[str, float](), None
        if constants or main.hypothesis.law == "with_speed":
            value = compute_values(self.problem, main.hypothesis, main.amounts)
            interval = compute_interval(self.problem, main.hypothesis, main.amounts, main.covariance)
        law = describe_law(self.problem, laws[0], constants[0].amounts if constants else None) if laws else None
        if law is not None and not constants:  # the mean over the logs
            hypothesis = laws[0].hypothesis
            mean = float(laws[0].amounts @ self.problem.bases.compute_means(hypothesis))
            value, interval = compute_values(self.problem, hypothesis.make_constant(), np.array([mean])), None
        if main.status == EQUIVALENT and interval is not None:  # another could replace it
            neutral = get_neutral_values(effect.id, self.problem.rig.tractor.steering)[effect.size.name]
            low, high = interval[effect.size.name]
            interval[effect.size.name] = min(low, neutral), max(high, neutral)
        gain, ids = self.saved.gains.get(effect.id), tuple(one for one in main.equivalent_to if one in EFFECTS_BY_ID)
        others = " or ".join(get_effect(one).label for one in ids)
        return Finding(
            effect.id, main.status, value, interval, gain and gain[0], gain and gain[1], visible,
            effect.describe(value), ids, f"these logs cannot tell it from {others}" if others else "", law,
        )  # fmt: skip

    def _build_absent(self, effect: Effect, visible: float | None) -> Finding:
        """The finding of an effect that the logs do not call for."""
        own = build_constant(effect, self.problem.data, self.problem.rig.tractor) if effect.kind is not CIRCLE else None
        channels = frozenset({"pose"}) if own is None else self.problem.list_channels(own)
        said = {str(one.hypothesis) for one in self.verdicts}
        # What the model holds and nothing can be said of may be this effect, and so may what is not told from it.
        is_open = any(effect.id in one.equivalent_to for one in self.verdicts) or any(
            str(one.hypothesis) not in said and self.problem.list_channels(one.hypothesis) & channels
            for one in self.result.judgements
        )
        kind, size, _ = scale_effect(effect, self.problem.data, self.problem.rig.tractor)
        # A usual size would have been seen.
        is_refuted = visible is not None and kind.is_no_larger_fault(visible, size.typical) and not is_open
        status = REFUTED if is_refuted else NOT_VISIBLE
        shown = None if visible is None or not math.isfinite(visible) else visible
        return Finding(effect.id, status, smallest_visible=shown)
