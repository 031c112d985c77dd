"""What is notable about logs, in words with sizes: clocks of columns, faults that begin, runs unlike the others, and
notes on the data that a diagnosis rests on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from vehicle.identification.diagnosis.other_vehicles import ARTICULATED, OtherTurning
from vehicle.identification.diagnosis.results import (
    COLUMN_WORDS,
    LIKELY,
    NAMED,
    ColumnTiming,
    Diagnosis,
    Finding,
    Hint,
    RunCheck,
)
from vehicle.identification.faults.level_steps import HEADING_JUMP, STEERING_JUMP
from vehicle.identification.logs.clocks import CLOCKS_FROM_S
from vehicle.identification.logs.column_faults import POSITION_JUMP
from vehicle.identification.logs.directions import COURSE_HEADING
from vehicle.identification.logs.reader import count_rows_left_out, list_shared_remarks
from vehicle.identification.logs.schema import Log, LogFault
from vehicle.identification.logs.thresholds import MAJORITY, STANDING_FACTOR
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.identification.replay.horizon_errors import Pieces, sum_by_run
from vehicle.model.effects import PATH, POSITION, get_effect
from vehicle.model.tractor import Tractor

TIME_EFFECTS = ("steering_dead_time", "gnss_latency")  # what drifting clocks would look like
_LOG_COLUMNS = {
    "position": "easting_m",
    "heading": "heading_deg",
    "speed": "speed_mps",
    "steering": "steering_deg",
    "steering_command": "steering_command_deg",
}
_PLACES = ("position", "heading")
# Ages by effect: the columns concerned, and the field that holds the value.
_TIMING_EFFECTS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "gnss_latency": (("position", "heading"), "delay_s"),
    "position_delay": (("position",), "delay_s"),
    "heading_delay": (("heading",), "delay_s"),
    "heading_filter": (("heading",), "filter_s"),
    **{f"clock_offset_{column}": ((column,), "clock_offset_s") for column in COLUMN_WORDS},
}
# Columns by the first words of a correction.
_CORRECTED_COLUMNS = {
    "the positions get": "position",
    "the positions and headings get": "position",
    "heading_deg changes only": "heading",
    COURSE_HEADING: "heading",
    "speed_mps reads": "speed",
    "steering_deg reads": "steering",
}
EPOCH_FROM_S = 3.0e8  # 1979: no log that counts from its own start lasts for nine years


def describe_columns(logs: Sequence[Log], findings: Sequence[Finding]) -> tuple[ColumnTiming, ...]:
    """Return the columns with a clock of their own: how often they are refreshed, and how old they are found to be."""
    timings = []
    for column in COLUMN_WORDS:
        hold_s, rare_s, share = _measure_column_hold(logs, column)
        ages, sentences = dict[str, tuple[float, str]](), list[str]()
        if hold_s is not None and rare_s is not None and share is not None:
            words = COLUMN_WORDS[column]
            is_rarer = rare_s > 1.2 * hold_s and f"{rare_s:.1f}" != f"{hold_s:.1f}"
            rare = f" (a tenth of the time less often than every {rare_s:.1f} s)" if is_rarer else ""
            sentences.append(
                f"{words[0].upper()}{words[1:]} is refreshed every {hold_s:.1f} s{rare}: {100.0 * share:.0f} % of its "
                "rows repeat or interpolate an older value and are not used."
            )
        for finding in findings:
            columns, name = _TIMING_EFFECTS.get(finding.id, ((), ""))
            if column in columns and finding.value is not None and finding.status in (NAMED, LIKELY):
                ages[name] = finding.value[get_effect(finding.id).size.name], finding.description
        sentences += [words for _, words in ages.values()]
        starts = [start for start, corrected in _CORRECTED_COLUMNS.items() if corrected == column]
        if hold_s is not None and column == "heading":  # a hold of the heading is its correction
            starts = []
        for start in starts:  # as it was in the first of the logs concerned
            concerned = [(log.name, said) for log in logs for said in log.corrections if said.startswith(start)]
            if concerned:
                (name, said), count = concerned[0], len(concerned)
                more = f"{name} and {count - 1} more" if count > 1 else name
                sentences.append(f"{f'all {count} runs' if 1 < count == len(logs) else more}: {said}.")
                break
        if sentences:
            factors = [log.speed_factor for log in logs if log.speed_factor != 1.0]
            scale = factors[0] if factors and column == "speed" else None
            values = {name: value for name, (value, _) in ages.items()}
            words = " ".join(sentences)
            timings.append(ColumnTiming(column, hold_s=hold_s, stale_share=share, words=words, scale=scale, **values))
    return tuple(timings)


def _measure_column_hold(logs: Sequence[Log], column: str) -> tuple[float | None, float | None, float | None]:
    """Return median and 90 % quantile of the hold (s) over the readings of all logs, and the share of stale rows; None
    where a column is not held.

    A value that stands still in one log says less of how often it was read than those that change in others. A command,
    a speed or an angle at rest was read as often as a moving one, so its rows are as stale as those between changes.
    """
    gaps, rows, having = [], [], 0
    for log in logs:
        having += getattr(log, _LOG_COLUMNS[column]) is not None
        measured = log.measured_rows.get(_LOG_COLUMNS[column])
        if measured is not None and np.count_nonzero(measured & log.used) > 2:
            gaps.append(np.diff(log.time_s[log.used][measured[log.used]]))
            rows.append(np.diff(np.flatnonzero(measured[log.used])))
    if not gaps or len(gaps) < MAJORITY * having:
        return None, None, None
    all_gaps, all_rows = np.concatenate(gaps), np.concatenate(rows)
    hold_s = float(np.median(all_gaps))
    if column not in _PLACES:
        all_rows = all_rows[all_gaps <= STANDING_FACTOR * hold_s]
    return hold_s, float(np.quantile(all_gaps, 0.9)), 1.0 - len(all_rows) / float(np.sum(all_rows))


def list_onset_faults(logs: Sequence[Log]) -> tuple[LogFault, ...]:
    """Return the faults of all logs with their times in words, in the order of the logs and of time."""
    return tuple(
        replace(fault, words=_describe_fault(fault, float(log.time_s[0])))
        for log in logs
        for fault in sorted(log.faults, key=lambda one: one.from_s)
    )


def _describe_fault(fault: LogFault, start_s: float) -> str:
    at = format_time(fault.from_s, start_s)
    if fault.id == POSITION_JUMP:
        return f"{fault.words} (at {at}); what follows is compared on its own"
    if fault.id == HEADING_JUMP:
        return f"{fault.words} (at {at}); the headings beside it are turned back and used"
    end = "until the log ends" if fault.to_s is None else f"until {format_time(fault.to_s, start_s)}"
    begin = f"from {at}"
    if fault.between_s is not None:
        earliest, latest = (format_time(time_s, start_s) for time_s in fault.between_s)
        begin = f"from some time between {earliest} and {latest}"
    if fault.id == STEERING_JUMP:
        return f"{begin} {fault.words}"  # says itself which rows are left out
    return f"{begin} {fault.words}, {end}; these rows are left out"


def format_time(time_s: float, start_s: float) -> str:
    """Format a time of a log: the time of the day (UTC) where it counts from 1970, else seconds after the start."""
    if time_s < EPOCH_FROM_S:
        return f"{time_s - start_s:.0f} s after the start"
    return f"{datetime.fromtimestamp(time_s, UTC):%H:%M:%S} UTC"


def build_fault_diagnosis(logs: Sequence[Log], tractor: Tractor, ground: str, reason: str) -> Diagnosis:
    """Build the diagnosis of logs that leave nothing to replay beside their faults, for the sentence `reason`."""
    undiagnosed = f"Nothing else can be diagnosed: {reason[0].lower()}{reason[1:]}"
    return Diagnosis(
        names=tuple(log.name for log in logs),
        ground=ground,
        tractor=tractor,
        rows_gated=sum(len(log.used) for log in logs),
        notes=tuple(list_shared_remarks(logs)),
        faults=list_onset_faults(logs),
        runs=tuple(RunCheck(log.name, None, None) for log in logs),
        rows_gated_by_reason=count_rows_left_out(logs, 0),
        undiagnosed_reason=undiagnosed,
        unsaved_reason=undiagnosed,
    )


def add_outside(diagnosis: Diagnosis, compass_deg: float | None, turning: OtherTurning | None) -> Diagnosis:
    """The diagnosis with what no effect is: headings that are wrong by up to so many degrees by the direction of
    travel, and how the vehicle turns, without a drive that would separate what stands in for that."""
    hints, drive = list[Hint](), diagnosis.next_drive
    if turning is not None:
        is_joint = turning.kind == ARTICULATED
        depends_on = "the rate of steering" if is_joint else "the way the vehicle steers"
        hints.append(Hint(depends_on, None, PATH if is_joint else POSITION, turning.words))
        if drive is not None and any(one.split(":")[0] in turning.faked_ids for one in drive.separates):
            drive = None
    if compass_deg is not None:
        words = (
            f"The headings are wrong by up to {compass_deg:.1f} degrees, depending on the direction of travel, as of a "
            "compass near iron: they turn by as much more or less than the wheels turn the vehicle. Otherwise this "
            "looks like a drift across a slope."
        )
        hints.append(Hint("the direction of travel", "heading", None, words))
    known = hints[0].words if hints else ""
    return replace(diagnosis, known_outside=known, next_drive=drive, hints=(*hints, *diagnosis.hints))


def check_runs(
    dataset: DriveDataset, before: Pieces, after: Pieces, odd_runs: Mapping[int, str]
) -> tuple[RunCheck, ...]:
    """Return the distance errors of runs (across only, if not all speeds were measured); `odd_runs` are unlike."""
    kinds, count = 2 if dataset.has_speed else 1, len(dataset.names)
    errors = [
        [100.0 * math.sqrt(float(run[:kinds].sum() / run[3])) if run[3] else None for run in sum_by_run(pieces, count)]
        for pieces in (before, after)
    ]
    words = {run: f"its {get_effect(name).label} is unlike that of the other runs" for run, name in odd_runs.items()}
    rows = enumerate(zip(dataset.names, *errors, strict=True))
    return tuple(RunCheck(name, first, last, run in words, words.get(run, "")) for run, (name, first, last) in rows)


# --- notes on logs, clocks and the tractor file ----------------------------------------------------------------------


def describe_logs(logs: Sequence[Log], dataset: DriveDataset) -> tuple[str, ...]:
    """Return notes on rows and columns."""
    sentences = list_shared_remarks(logs) + list(dataset.remarks)
    if all(segment.wheel is None for segment in dataset.segments):
        sentences.append(
            "No wheel angle was logged, so faults of the steering and of the path are hard to distinguish."
        )
    if any(segment.target is None for segment in dataset.segments):
        sentences.append("No commanded speed was logged, so the speed control was not checked.")
    if any(log.heading_deg is None for log in logs):  # of all logs, as the errors are; a subset may lack some of them
        sentences.append("Some logs have no heading; the course of the positions is used instead.")
    if len(logs) == 1:
        sentences.append("There is only one run, so its own 20 s windows replace runs not used for fitting.")
    return tuple(sentences)


def describe_clocks(logs: Sequence[Log], diagnosis: Diagnosis) -> list[str]:
    """Return a note where a delay was found in logs too short to check for drifting clocks."""
    late = [finding.id for finding in diagnosis.findings if finding.id in TIME_EFFECTS and finding.value is not None]
    short = sum(float(np.ptp(log.time_s[log.used])) < CLOCKS_FROM_S for log in logs)
    if not late or not short:
        return []
    subject = "The log is" if len(logs) == 1 else f"{short} of {len(logs)} logs are"
    return [
        f"{subject} too short (under {CLOCKS_FROM_S:.0f} s) to check whether the clocks of two instruments drift "
        f"apart; the result for {' and '.join(late)} assumes that they do not."
    ]


def describe_file_corrections(tractor: Tractor, diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return notes on the effects and the discrepancy model that the tractor file already had."""
    sentences = []
    if tractor.effects:
        unseen = [name for name, setting in tractor.effects.items() if diagnosis.tractor.effects.get(name) is setting]
        outcome = f" These logs do not show {', '.join(unseen)}; the value of the file was kept." if unseen else ""
        sentences.append(
            f"The tractor file already has {', '.join(tractor.effects)}; fitted again from scratch. The error before "
            f"is with the values of the file.{outcome}"
        )
    if tractor.discrepancy_model is not None:
        now, outcome = diagnosis.tractor.discrepancy_model, "kept, as these logs do not contradict it"
        if now is not tractor.discrepancy_model:
            outcome = "dropped, as these logs contradict it" if now is None else "replaced"
        sentences.append(f"The tractor file has a discrepancy model: {outcome}.")
    return tuple(sentences)
