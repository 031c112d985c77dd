"""What a diagnosis reports: a status per effect, errors before and after, the remaining error, and the next drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from fields.arrays import Floats
from vehicle.identification.logs.schema import LogFault
from vehicle.identification.logs.thresholds import ALIKE_SHARE
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.horizon_errors import HorizonError
from vehicle.model.effects import get_effect
from vehicle.model.tractor import Tractor

# How many likely effects were true causes: tests.benchmarks.diagnosis, three references, seed 345000, none of whose
# sets was looked at before.
LIKELY_RIGHT, LIKELY_OF = 3, 5
NAMED, LIKELY, EQUIVALENT, REFUTED, NOT_VISIBLE = "named", "likely", "equivalent", "refuted", "not-visible"
ErrorsByHorizon = dict[float, HorizonError]
ABOVE_FLOOR_FACTOR = 1.0 + ALIKE_SHARE  # chosen: times the noise floor that is still noise
CONSTANT_LAW = "constant"

COLUMN_WORDS = {
    "position": "the position",
    "heading": "the heading",
    "speed": "the measured speed",
    "steering": "the wheel angle",
    "steering_command": "the steering command",
}


@dataclass(frozen=True)
class ParameterLaw:
    """How the parameter of an effect varies: the kind of its law, its coefficients by name (with unit), a sentence."""

    kind: str
    values: dict[str, float]
    words: str


@dataclass(frozen=True)
class ColumnTiming:
    """How old one column of the logs is, in s, estimated before any cause; None where it is not known.

    A column is read `delay_s` after it was true, refreshed every `hold_s` (median), low-passed by
    `filter_s`, and stamped `clock_offset_s` later than the other columns. `stale_share` of its rows repeat an older
    measurement. Its values were `scale` times as large as the true ones, and were divided by it. `column` is one of
    position, heading, speed, steering, steering_command.
    """

    column: str
    delay_s: float | None = None
    hold_s: float | None = None
    filter_s: float | None = None
    clock_offset_s: float | None = None
    stale_share: float | None = None
    words: str = ""
    scale: float | None = None


@dataclass(frozen=True)
class RunCheck:
    """One run: distance errors over 5 s (cm) before and after, and whether it is unlike the other runs, and how."""

    name: str
    error_before_cm: float | None
    error_after_cm: float | None
    unlike: bool = False
    words: str = ""


@dataclass(frozen=True)
class HoldoutRun:
    """One run that had no part in the diagnosis: distance errors by horizon (s), before and after."""

    name: str
    before: ErrorsByHorizon
    after: ErrorsByHorizon


@dataclass(frozen=True)
class HoldoutResult:
    """Errors on runs that had no part in anything, by horizon (s): `helps` says that the extension lowers them.

    `words` is one sentence: which runs were chosen, and how. `is_requested` marks runs that were held out on request;
    else every run was left out once, and driven with what was found on the others.
    """

    runs: tuple[str, ...]
    before: ErrorsByHorizon
    after: ErrorsByHorizon
    helps: bool
    by_run: tuple[HoldoutRun, ...] = ()
    words: str = ""
    is_requested: bool = False

    @property
    def is_unchanged(self) -> bool:
        """Whether both tractors drive alike, as when nothing was found."""
        return self.before == self.after


@dataclass(frozen=True)
class Hint:
    """Where to look when no known cause explains the error: what it depends on, and the instrument or the block.

    `instrument` is a column of the logs as in ColumnTiming, `block` a block of the model; at most one is given.
    """

    depends_on: str | None
    instrument: str | None
    block: str | None
    words: str


@dataclass(frozen=True)
class Finding:
    """One effect of the catalogue.

    `value` and `interval` (95 %) are None unless the effect is in the model: a `likely` effect is clearly not neutral
    and helps held-out runs, without being shown to be the cause. A `refuted` effect is refuted from `smallest_visible`
    on, a limit up to there. `gain_pct` is the reduction of the error over 5 s on runs not used for fitting (of the path
    at the measured speed), `gain_interval` its 90 % interval over runs; `smallest_visible` the smallest size these logs
    would have shown (None when no size would). `exchange` says how much of another effect looks alike. `law` is None
    where no law was tried: the value then is a constant.
    """

    id: str
    status: str
    value: dict[str, float] | None = None
    interval: dict[str, tuple[float, float]] | None = None
    gain_pct: float | None = None
    gain_interval: tuple[float, float] | None = None
    smallest_visible: float | None = None
    description: str = ""
    equivalent_to: tuple[str, ...] = ()
    exchange: str = ""
    law: ParameterLaw | None = None

    @property
    def block(self) -> str:
        """The block of the model that the effect is in."""
        return get_effect(self.id).block

    @property
    def unit(self) -> str:
        """The unit of `smallest_visible` and of the first value."""
        return get_effect(self.id).size.unit

    @property
    def sentence(self) -> str:
        """The description with the law that the value follows, where it is not constant."""
        law = self.law
        if law is None or law.kind == CONSTANT_LAW or not law.words or law.words.rstrip(".") in self.description:
            return self.description
        return f"{self.description} {law.words[:1].upper()}{law.words[1:].rstrip('.')}."


@dataclass(frozen=True)
class NextDrive:
    """The cheapest drive that separates competing causes: what, for how long, and how clearly; without `decides` the
    best known one, which perhaps does not separate them."""

    id: str
    description: str
    seconds: float
    separates: tuple[str, str]
    score: float
    decides: bool = True


@dataclass(frozen=True, eq=False)
class ResidualPlot:
    """The remaining error against its regressor: bin centres, means and standard errors, before and after, and the size
    of a found limit on the regressor."""

    regressor: str
    quantity: str
    regressor_values: Floats
    before: Floats
    before_error: Floats
    after: Floats
    after_error: Floats
    limit: float | None = None


@dataclass(frozen=True)
class ResidualError:
    """The remaining error above the noise over the longest pieces, of `over_s` s, as it would appear in a plan.

    `late_s` is along the path at the usual speed; `aside_cm` across the path with no steering correction.
    """

    over_s: float
    late_s: float
    aside_cm: float


@dataclass(frozen=True)
class PlanGain:
    """A small plan driven by the tractor of the file and by the extended one: time, and lateral error on the tracks.

    `discrepancy_s` and `discrepancy_cm` are the share of the discrepancy model in the change; None without one.
    """

    field: str
    time_before_s: float | None
    time_after_s: float | None
    lateral_before_cm: float
    lateral_after_cm: float
    discrepancy_s: float | None = None
    discrepancy_cm: float | None = None


@dataclass(frozen=True, eq=False)
class PieceErrors:
    """Root mean square errors (cm) per bin with rows: `lows` to `highs` of a quantity, rows, and four errors."""

    lows: Floats
    highs: Floats
    rows: Floats
    cross_before_cm: Floats
    cross_after_cm: Floats
    along_before_cm: Floats
    along_after_cm: Floats


@dataclass(frozen=True, eq=False)
class PlaceErrors:
    """Root mean square distance (cm) in squares of a map: west and south edges (m), side (m), before and after.

    `slopes` is the mean steepness (m/m) of the ground under the rows in each square; None where heights are unknown.
    """

    west_m: Floats
    south_m: Floats
    side_m: float
    before_cm: Floats
    after_cm: Floats
    slopes: Floats | None = None


@dataclass(frozen=True, eq=False)
class PathPair:
    """One driven segment, measured and simulated before and after: time since the start (s), positions (k, 2) in m,
    aligned over the first seconds and then left alone."""

    name: str
    time_s: Floats
    measured_m: Floats
    before_m: Floats
    after_m: Floats


@dataclass(frozen=True, eq=False)
class ReplayEvidence:
    """All logs replayed by the tractor file as it was and by the extended one, in pieces of `piece_s`.

    `over_time` counts the driving time of all logs in s; `by_speed` is in m/s, `by_angle` in degrees to the right.
    """

    piece_s: float
    over_time: PieceErrors
    by_speed: PieceErrors
    by_angle: PieceErrors
    by_place: PlaceErrors
    paths: tuple[PathPair, ...]


@dataclass(frozen=True, eq=False)
class ParameterCorrelations:
    """Correlations (m, m) of the values of one fit, and what they are: effect and parameter."""

    names: tuple[tuple[str, str], ...]
    matrix: Floats


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The whole result; see the contract of `headland diagnose --json`.

    `along_judged` is False where a log lacks a measured speed: errors along the path then say nothing about the
    tractor. `above_noise_s` are the horizons with a remaining error above the noise; `unexplained_share` is for 5 s.
    `correlations` are those of the fitted values, None where fewer than two were fitted; `evidence` is what pages show.
    `next_drive_plan` is the text of a saved plan. `columns` has only columns that are late, held or low-passed, `runs`
    all runs; `hints` say where to look for what no cause explains. `rows_gated_by_reason` counts the rows left out.
    `unsaved_reason` is a sentence when the extension harms runs not used for fitting: nothing is then to be saved.
    `interval_note` says how the error of the model is part of the intervals. `undiagnosed_reason` is a sentence when
    the faults leave nothing to replay, so that nothing but these is known. `known_outside` is a sentence on what
    is known to be wrong and no effect of the catalogue: a vehicle that turns in another way, a compass near iron.
    `file_effects` are those that the tractor file already had.
    """

    names: tuple[str, ...]
    ground: str
    tractor: Tractor
    rows_used: int = 0
    rows_gated: int = 0
    minutes: float = 0.0
    before: ErrorsByHorizon = field(default_factory=dict)
    after: ErrorsByHorizon = field(default_factory=dict)
    noise_floor: ErrorsByHorizon = field(default_factory=dict)
    guilty_block: str | None = None
    block_error: dict[str, tuple[float, float]] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    named: tuple[str, ...] = ()
    unexplained_share: float = 0.0
    depends_on: tuple[str, ...] = ()
    next_drive: NextDrive | None = None
    calibration: dict[str, dict[str, float]] = field(default_factory=dict)
    curve: ResidualPlot | None = None
    notes: tuple[str, ...] = ()
    plan: PlanGain | None = None
    file_effects: tuple[str, ...] = ()
    pace_mps: float = 0.0
    along_judged: bool = True
    above_noise_s: tuple[float, ...] = ()
    correlations: ParameterCorrelations | None = None
    evidence: ReplayEvidence | None = None
    next_drive_plan: str | None = None
    columns: tuple[ColumnTiming, ...] = ()
    faults: tuple[LogFault, ...] = ()
    runs: tuple[RunCheck, ...] = ()
    holdout: HoldoutResult | None = None
    hints: tuple[Hint, ...] = ()
    rows_gated_by_reason: dict[str, int] = field(default_factory=dict)
    unsaved_reason: str = ""
    interval_note: str = ""
    undiagnosed_reason: str = ""
    known_outside: str = ""

    @property
    def is_savable(self) -> bool:
        """Whether the extended tractor may be saved: nothing says that it harms runs it was not fitted to."""
        return not self.unsaved_reason and (self.holdout is None or self.holdout.helps or self.holdout.is_unchanged)

    @property
    def is_noise_only(self) -> bool:
        """Whether the remaining error is only noise over every horizon."""
        return self.unexplained_share == 0.0 and not self.above_noise_s

    @property
    def residual_error(self) -> ResidualError | None:
        """The remaining error above the noise; None without errors or motion."""
        if not self.after or self.pace_mps <= 0.0:
            return None
        horizon_s = max(self.after)
        left, floor = self.after[horizon_s], self.noise_floor[horizon_s]
        along, across = (
            math.sqrt(max(getattr(left, kind) ** 2 - getattr(floor, kind) ** 2, 0.0))
            for kind in ("along_cm", "cross_cm")
        )
        return ResidualError(horizon_s, along / 100.0 / self.pace_mps, across)

    @property
    def headline(self) -> str:
        """The verdict in a few sentences: what began during a run, then the causes."""
        return " ".join([*(fault.sentence for fault in self.faults), self.causes_sentence])

    @property
    def causes_sentence(self) -> str:
        """The causes in a few sentences, without what begins during a run: first what no effect has and is known."""
        if self.undiagnosed_reason:
            return self.undiagnosed_reason
        by_id = {finding.id: finding for finding in self.findings}
        sets = [one for one in self.findings if one.status == EQUIVALENT]
        likely = [one.sentence for one in self.findings if one.status == LIKELY]
        if self.named:
            causes = " ".join(by_id[name].sentence for name in self.named)
        elif len(sets) == 1 and sets[0].exchange:
            causes = f"It may be, though {sets[0].exchange}: {sets[0].sentence}"
        elif sets:
            causes = "Several causes fit these logs equally well: " + " Or: ".join(one.sentence for one in sets)
        elif likely:
            causes = "No cause is certain. Likely: " + " ".join(likely)
        else:
            causes = self._describe_nothing_found()
        return f"{self.known_outside} {causes}" if self.known_outside else causes

    def _describe_nothing_found(self) -> str:
        if self.known_outside:
            return "Apart from that no cause is found."
        unexplained = "No known cause explains these logs"
        if self.depends_on:
            return f"{unexplained}: the simulation misses {join_clauses(self.depends_on)}."
        if self.hints:
            return f"{unexplained if self.unexplained_share > 0.0 else 'No cause found'}. {self.hints[0].words}"
        if self.unexplained_share > 0.0:
            return f"{unexplained}, and the error depends on none of the quantities examined."
        if self.calibration or self.tractor.discrepancy_model is not None:
            return "No cause found; a discrepancy model without a named cause lowers the error."
        if self.file_effects:
            return "Nothing found beyond the effects already in the tractor file: see the notes."
        as_file = "the tractor drives as its file says"
        if self.faults:
            return f"Nothing else found: apart from that, {as_file}, as far as these logs show."
        if self.columns:
            columns = join_clauses([COLUMN_WORDS[column.column] for column in self.columns])
            are = "is" if len(self.columns) == 1 else "are"
            return f"Nothing found apart from how {columns} {are} logged: as far as these logs show, {as_file}."
        if unlike := ", ".join(run.name for run in self.runs if run.unlike):
            nothing = f"Beside the runs unlike the others ({unlike}) nothing is found"
            return f"{nothing}: as far as the other runs show, {as_file}."
        return f"Nothing found: as far as these logs show, {as_file}."


def join_clauses(parts: Sequence[str]) -> str:
    """Join clauses: a; b; and c."""
    if len(parts) < 3:
        return " and ".join(parts)
    return "; ".join(parts[:-1]) + "; and " + parts[-1]


@dataclass(frozen=True, eq=False)
class ReplayedSegment:
    """One segment: the measured rows, the simulated antenna aligned with the first seconds, wheel angle and speed.

    `pieces` holds, per piece of 5 s, its rows and the errors after anchoring (cross, along in m; heading in rad).
    """

    measured: DriveSegment
    antenna: Floats
    wheel: Floats
    speed: Floats
    pieces: tuple[tuple[slice, Floats], ...]


@dataclass(frozen=True, eq=False)
class ReplayResult:
    """A replayed run and its errors by horizon."""

    name: str
    tractor: str
    effects: tuple[str, ...]
    errors: ErrorsByHorizon
    segments: tuple[ReplayedSegment, ...] = field(repr=False)
    rows_gated: int
