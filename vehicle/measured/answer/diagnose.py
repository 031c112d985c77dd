"""From logs to a diagnosis: the order of the work, and the figures of the answer.

Causes are named by what surprises in the logs (causes.selection). Where surprises are left that no cause explains, the
open-loop error itself is lowered (mend.mending); what that takes is a calibration without a name, unless nothing else
could take its place.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.effects import SPEED, STEERING, effect, neutral
from vehicle.measured.answer.curves import best_curve
from vehicle.measured.answer.findings import Case, Rivals, findings, look_alikes
from vehicle.measured.answer.nextdrive import next_drive
from vehicle.measured.answer.verdict import EQUIVALENT, NAMED, NOT_VISIBLE, Diagnosis, Finding, Grounds
from vehicle.measured.causes.evidence import is_nameable
from vehicle.measured.causes.refit import retuned, without
from vehicle.measured.causes.selection import Selection, select
from vehicle.measured.causes.trial import Projector
from vehicle.measured.fit import openloop
from vehicle.measured.fit.fitting import Fit, empty_fit
from vehicle.measured.fit.openloop import Term, settings_in
from vehicle.measured.logs.record import Array, Log
from vehicle.measured.logs.remarks import remarks
from vehicle.measured.mend.extension import (
    Extension,
    driven_seconds,
    extended_tractor,
    main_terms,
    of_fit,
    of_mended,
)
from vehicle.measured.mend.mending import Mended, clear_levels, irreplaceable, mend
from vehicle.measured.replay.course import make_course
from vehicle.measured.replay.horizons import errors_of, run_squares
from vehicle.measured.replay.replaying import make_rig, own_rig
from vehicle.measured.surprise.bench import Bench, prepare
from vehicle.measured.surprise.floor import floor_squares
from vehicle.measured.surprise.noise import first_noise, tuned
from vehicle.measured.thresholds import (
    ABOVE_FLOOR,
    ABOVE_PER_ROW_S,
    ABOVE_UNNAMED,
    HARM_PCT,
    SAME_ERROR,
    WORTH_A_NAME_PCT,
    WORTH_OF_WHEEL_PCT,
    WORTH_SAYING,
)
from vehicle.tractor import Tractor

ON_OWN_GROUND = (
    "The figures after are for every run on its own ground, told from the other half of the run; the tractor file has "
    "one ground and does worse on the other."
)
Progress = Callable[[int, int], None]


def diagnose(logs: Sequence[Log], tractor: Tractor, ground: str, progress: Progress | None = None) -> Diagnosis:
    """What the simulation of a tractor gets wrong in these logs, why, and what mending it gains.

    Effects that the tractor file has already are set aside and fitted anew; the error before is that of the file.
    `progress` is called with steps done and an estimate of all steps. Raises LogError when no stretch can be replayed
    and VehicleError for an unknown ground.
    """
    count = _Counter(progress)
    course = make_course(logs)
    rig = make_rig(tractor, ground, course.origin)
    bench = prepare(course, rig, {})
    bench = retuned(bench, empty_fit(bench))
    selection = select(bench, rig.tractor, lambda _: count.step())
    names = _nameable(selection, rig.tractor)
    found = _explained(selection, names, rig.tractor, count)
    rivals = {name: look_alikes(selection.bench, selection.fit, name) for name in found.names if name in selection.ids}
    count.step()
    told = findings(found.case, found.names, rivals, count.step)
    answer = _answer(bench, selection, found, told, rivals, tractor, ground)
    count.finish()
    notes = (*_notes(logs, bench), *_about_file(tractor, answer))
    return replace(answer, notes=(*notes, ON_OWN_GROUND) if answer.grounds else notes)


class _Counter:
    """Progress in steps; the whole is not known beforehand, so the estimate grows when it must."""

    def __init__(self, progress: Progress | None) -> None:
        self.progress, self.done, self.total = progress, 0, 100

    def step(self) -> None:
        """One step more."""
        self.done += 1
        self.total = max(self.total, self.done + 20)
        if self.progress:
            self.progress(self.done, self.total)

    def finish(self) -> None:
        """Everything is done."""
        if self.progress:
            self.progress(self.total, self.total)


@dataclass(frozen=True, eq=False)
class _Explained:
    """What is added to the tractor, and which of it has a name."""

    case: Case
    names: list[str]
    mended: Mended | None


def _explained(selection: Selection, names: list[str], tractor: Tractor, count: _Counter) -> _Explained:
    """Named effects alone where they explain what there is; else all that lowers the error of runs held out."""
    bench, fit = selection.bench, selection.fit
    names, case = _holding(lambda kept: _case(selection, of_fit(bench, fit, kept)), names)
    if not selection.unnamed and within_noise(case, case.final):
        return _Explained(case, names, None)
    start = tuple(Term(knobs, at) for knobs, at in fit.parts if knobs.id in names)
    mended = mend(bench, tractor, start, count.step)
    case = _case(selection, of_mended(mended))
    names = [name for name in names if holds(case, name)]
    names += [
        name
        for name in irreplaceable(mended, tractor, noise_share(case), count.step)
        if name not in names and holds(case, name)
    ]
    return _Explained(case, names, mended)


def _holding(case_of: Callable[[list[str]], Case], names: list[str]) -> tuple[list[str], Case]:
    """Names that hold together, with their case: one that does not may have been the partner of another."""
    while True:
        case = case_of(names)
        kept = [name for name in names if holds(case, name)]
        if kept == names:
            return names, case
        names = kept


def holds(case: Case, name: str) -> bool:
    """Whether an effect takes error away where it shows, without harm to the path, and is clearly not neutral."""
    entry = effect(name)
    worth, least = case.worth_of(name), _least_worth(case.bench, name)
    low, high = case.extension.intervals[name][entry.size.name]
    zero = neutral(name, case.tractor.steering)[entry.size.name]
    return worth >= least and case.gain_of(name)[0] > -HARM_PCT and not low <= zero <= high


def noise_share(case: Case) -> float:
    """Share of the open-loop error without terms that noise alone would leave, every horizon and kind the same."""
    runs = range(len(case.bench.course.names))
    before = run_squares(case.bench.course, case.bench.rig, {run: {} for run in runs})
    shares = []
    for horizon in openloop.HORIZONS_S:
        sums = [np.sum([one[horizon][:3] for one in squares], axis=0) for squares in (case.floor, before)]
        shares += [float(noise / whole) for noise, whole in zip(*sums, strict=True) if whole > 0.0]
    return min(float(np.mean(shares)), 1.0) if shares else 0.0


def within_noise(case: Case, error: Array) -> bool:
    """Whether an error is what noise, and what happens unseen between rows, would leave."""
    floor = float(case.number(case.floor).sum())
    return float(error.sum()) < (ABOVE_FLOOR + ABOVE_PER_ROW_S * case.bench.row_s) * floor


def _case(selection: Selection, extension: Extension) -> Case:
    bench = with_real_noise(selection.bench, selection.fit)
    runs = range(len(bench.course.names))
    floor = floor_squares(bench, {run: settings_in(extension.terms, run) for run in runs})
    return Case(selection.bench, selection.fit, extension, floor)


def _least_worth(bench: Bench, name: str) -> float:
    """Percent of the held-out error that an effect must take away: less is the trace of a simplification."""
    of_wheel = effect(name).block == STEERING and bench.has_wheel
    return WORTH_OF_WHEEL_PCT if of_wheel else WORTH_A_NAME_PCT


def with_real_noise(bench: Bench, fit: Fit) -> Bench:
    """The bench with the noise that the logs show, not the wider one that a wrong model may have been judged by."""
    return replace(bench, noise=tuned(bench.course, bench.rig, first_noise(bench.course), fit.settings))


def _answer(
    base: Bench, selection: Selection, found: _Explained, told: list[Finding], rivals: Rivals, tractor: Tractor,
    ground: str,
) -> Diagnosis:  # fmt: skip
    bench, fit, case = selection.bench, selection.fit, found.case
    extension, course = case.extension, base.course
    own, settings = own_rig(tractor, ground, course.origin)
    before = run_squares(course, own, dict.fromkeys(range(len(course.names)), settings))
    after = run_squares(course, bench.rig, extension.held_out)
    # Most important first: by the held-out error that comes back without the effect.
    named = [one.id for one in sorted(told, key=lambda one: -(one.gain_pct or 0.0)) if one.status == NAMED]
    guilty = _guilty(named, told, selection)
    alike = {one.id: one for one in told if one.status == EQUIVALENT}
    share = _unexplained(found, case.number(before))
    unseen = [one.id for one in told if one.status == NOT_VISIBLE and one.value is None]
    seconds = driven_seconds(bench)
    return Diagnosis(
        names=course.names,
        rows_used=course.rows,
        rows_gated=course.rows_read - course.rows,
        minutes=course.seconds / 60.0,
        ground=ground,
        before=errors_of(before),
        after=errors_of(after),
        floor=errors_of(case.floor),
        guilty_block=guilty,
        block_error=_blocks(with_real_noise(bench, fit), extension),
        findings=tuple(told),
        named=tuple(named),
        unexplained_share=share,
        depends_on=tuple(one.words for one in selection.unnamed) if share > 0.0 else (),
        next_drive=next_drive(bench, fit, bench.rig.tractor, rivals),
        tractor=_with_rest(
            tractor, extended_tractor(bench, tractor, ground, extension, named, alike, unseen),
            case.number(before), case.final,
        ),
        calibration={
            term.knobs.id: term.knobs.values(term.at)
            for term in main_terms(extension.terms, seconds) if term.knobs.id not in found.names
        },
        curve=best_curve(
            bench, {run: settings_in(extension.terms, run) for run in range(len(course.names))},
            named or list(rivals), selection.unnamed,
        ),
        grounds=_grounds(found),
    )  # fmt: skip


def _about_file(tractor: Tractor, answer: Diagnosis) -> tuple[str, ...]:
    """What became of the effects and the rest that the tractor file had."""
    found = []
    if tractor.effects:
        unseen = [name for name, one in tractor.effects.items() if answer.tractor.effects.get(name) is one]
        kept = f" These logs do not show {', '.join(unseen)}: kept as the file has it." if unseen else ""
        found.append(
            f"The tractor file has {', '.join(tractor.effects)} already: set aside and fitted anew; the error before "
            f"is that of the file.{kept}"
        )
    if tractor.rest is not None:
        kept = "kept, these logs do not speak against it" if answer.tractor.rest is tractor.rest else "replaced"
        kept = "dropped, these logs speak against it" if answer.tractor.rest is None else kept
        found.append(f"The tractor file has a rest: {kept}.")
    return tuple(found)


def _with_rest(tractor: Tractor, extended: Tractor, before: Array, after: Array) -> Tractor:
    """The extended tractor with the rest of the file, unless there is a new one or these logs speak against it."""
    if extended.rest is not None or tractor.rest is None or float(before.sum()) > SAME_ERROR * float(after.sum()):
        return extended
    return extended.model_copy(update={"rest": tractor.rest})


def _nameable(selection: Selection, tractor: Tractor) -> list[str]:
    """Effects that may carry a name: clearly beyond tolerance, and not in the shadow of an unnamed dependence."""
    bench, fit = selection.bench, selection.fit
    names = [knobs.id for knobs, _ in fit.parts if is_nameable(bench, fit, tractor, knobs.id)]
    if not selection.unnamed:
        return names
    shadow = _unnamed_gain(fit) * ABOVE_UNNAMED
    apart = (STEERING, SPEED) if bench.has_wheel else ()
    return [name for name in names if effect(name).block in apart or without(bench, fit, name).loss - fit.loss > shadow]


def _unnamed_gain(fit: Fit) -> float:
    """Loss that the unnamed terms take away, the other coordinates following."""
    if fit.extra is None:
        return 0.0
    first = fit.slope.shape[1] - fit.extra.columns.shape[1]
    project = Projector(fit.slope[:, :first])
    removed = project(fit.extra.columns @ fit.extra.amounts)
    return float(removed @ removed)


def _unexplained(found: _Explained, before: Array) -> float:
    """Share of the error above the noise floor that no named effect takes away; 0 while what they leave is noise."""
    case = found.case
    floor = float(case.number(case.floor).sum())
    error = case.error(case.extension.only(found.names))
    if within_noise(case, error):
        return 0.0
    named = float(error.sum())
    share = (named - floor) / max(float(before.sum()) - floor, named - floor)
    return float(share) if share > WORTH_SAYING else 0.0


def _guilty(named: list[str], told: list[Finding], selection: Selection) -> str | None:
    """Block of the first name; without one, of the first of a set, or of the first unnamed dependence."""
    if named:
        return effect(named[0]).block
    alike = [one for one in told if one.status == EQUIVALENT]
    if alike:
        return alike[0].block
    return selection.unnamed[0].block if selection.unnamed else None


def _blocks(bench: Bench, extension: Extension) -> dict[str, tuple[float, float]]:
    """Per channel cut at the sensors, the surprise before and after (1 is noise alone)."""
    main = settings_in([replace(term, runs=None) for term in main_terms(extension.terms, driven_seconds(bench))], 0)
    bench = prepare(bench.course, bench.rig, main, bench.noise)
    first, last = bench.surprise({}), np.zeros(5 * bench.course.rows)
    own = {run: settings_in(extension.terms, run) for run in range(len(bench.course.names))}
    for settings in {str(one): one for one in own.values()}.values():
        mine = np.isin(bench.runs, [run for run, one in own.items() if one == settings])
        last[mine] = bench.surprise(settings)[mine]
    rows = bench.course.rows
    cuts = {"wheel to path and antenna": slice(0, 3 * rows), "command to wheel": slice(3 * rows, 4 * rows),
            "speed": slice(4 * rows, 5 * rows)}  # fmt: skip
    return {
        name: (float(np.sqrt(np.mean(first[cut] ** 2))), float(np.sqrt(np.mean(last[cut] ** 2))))
        for name, cut in cuts.items() if np.any(first[cut])
    }  # fmt: skip


def _grounds(found: _Explained) -> tuple[Grounds, ...]:
    """Effects with two levels: which runs were clearly at which, the longer driving first."""
    if found.mended is None:
        return ()
    bench = found.case.bench
    seconds, names = driven_seconds(bench), bench.course.names
    told = []
    for term, runs in clear_levels(found.mended):
        entry, value = effect(term.knobs.id), term.knobs.values(term.at)
        one = Grounds(entry.id, value, entry.words(value), tuple(names[run] for run in runs))
        told.append((-float(seconds[sorted(term.runs or ())].sum()), one))
    return tuple(one for _, one in sorted(told, key=lambda pair: pair[0]))


def _notes(logs: Sequence[Log], bench: Bench) -> tuple[str, ...]:
    """What the reader should know about the rows and columns."""
    found = [line for log in logs for line in remarks(log)]
    if not bench.has_wheel:
        found.append(
            "No wheel angle was logged: faults of the steering system and of the path cannot be told apart well."
        )
    if any(one.target is None for one in bench.course.stretches):
        found.append("No commanded speed was logged: the speed block was not looked at.")
    if any(not one.heading_seen for one in bench.course.stretches):
        found.append("No heading was logged: the course of the positions stands in for it.")
    if len(logs) == 1:
        found.append("One run only: its own 20 s windows stand in for runs not used for fitting.")
    return tuple(found)
