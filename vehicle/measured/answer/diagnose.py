"""From logs to a diagnosis: the order of the work, and the figures of the answer.

Causes are chosen by what surprises in the logs (causes.selection). Where surprises are left that no cause explains, the
open-loop error itself is lowered (mend.mending); what that takes is a calibration without a name, unless nothing else
could take its place (answer.names).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vehicle.effects import effect
from vehicle.measured.answer.case import PIECE_S, Case, with_real_noise
from vehicle.measured.answer.curves import best_curve
from vehicle.measured.answer.findings import Rivals, findings
from vehicle.measured.answer.late import with_kin
from vehicle.measured.answer.names import Explained, explained, nameable, unexplained
from vehicle.measured.answer.nextdrive import next_drive
from vehicle.measured.answer.notes import notes
from vehicle.measured.answer.verdict import EQUIVALENT, NAMED, NOT_VISIBLE, Diagnosis, Finding, Grounds
from vehicle.measured.answer.whole import whole_case
from vehicle.measured.causes.refit import weighed
from vehicle.measured.causes.selection import Selection, select
from vehicle.measured.errors import LogError
from vehicle.measured.fit.openloop import settings_in
from vehicle.measured.logs.coarse import without_coarse_together
from vehicle.measured.logs.commanded import commands_set_right
from vehicle.measured.logs.record import Array, Log
from vehicle.measured.logs.sensors import set_right_together
from vehicle.measured.mend.extended import Alike, extended_tractor
from vehicle.measured.mend.extension import Extension
from vehicle.measured.mend.levels import clear_levels, driven_seconds
from vehicle.measured.replay.course import Course, make_course
from vehicle.measured.replay.drives import usual
from vehicle.measured.replay.horizons import FEWEST_ROWS, cuts, errors_of, run_squares
from vehicle.measured.replay.part import balanced_part
from vehicle.measured.replay.replaying import make_rig, own_rig
from vehicle.measured.surprise.bench import Bench, prepare
from vehicle.measured.thresholds import SAME_ERROR
from vehicle.rest import BY_NAME
from vehicle.tractor import Tractor

Progress = Callable[[int, int], None]


def diagnose(logs: Sequence[Log], tractor: Tractor, ground: str, progress: Progress | None = None) -> Diagnosis:
    """What the simulation of a tractor gets wrong in these logs, why, and what mending it gains.

    Effects that the tractor file has already are set aside and fitted anew; the error before is that of the file.
    `progress` is called with steps done and an estimate of all steps. Raises LogError when no stretch can be replayed
    or none has enough positions for an error, and VehicleError for an unknown ground.
    """
    count = _Counter(progress)
    logs = commands_set_right(set_right_together(without_coarse_together(logs)))
    course = make_course(logs, (tractor.antenna_forward_m, tractor.antenna_right_m))
    _refuse_sparse(course)
    rig = make_rig(tractor, ground, course.origin)
    part = balanced_part(course)
    bench = weighed(part.course, rig, {})
    selection = select(bench, rig.tractor, lambda _: count.step())
    told = explained(selection, nameable(selection, rig.tractor), rig.tractor, count.step)
    rivals = _rivals(selection, told)
    count.step()
    one_each = findings(told.case, told.names, rivals, count.step)
    whole = replace(told, case=whole_case(course, part, told.case))
    answer = _answer(course, selection, told, whole, one_each, rivals, tractor, ground)
    count.finish()
    return replace(answer, notes=notes(logs, bench, tractor, answer))


def _rivals(selection: Selection, told: Explained) -> Rivals:
    """What is as good as each name of the fit, by the surprises or for want of a heading."""
    rivals = {name: selection.alike.get(name, {}) if name in selection.ids else {} for name in told.names}
    return with_kin(selection.bench, rivals, told.case.found, told.case.extension.ids)


def _refuse_sparse(course: Course) -> None:
    if not any(len(cuts(one.time, PIECE_S)[0]) for one in course.stretches):
        raise LogError(
            f"No {PIECE_S:g} s of these logs hold {FEWEST_ROWS} measured positions, the fewest that errors are told "
            "from; log positions at 1 Hz or faster, without rows that are lost."
        )


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


def _answer(
    course: Course, selection: Selection, told: Explained, whole: Explained, each: list[Finding], rivals: Rivals,
    tractor: Tractor, ground: str,
) -> Diagnosis:  # fmt: skip
    """The answer: causes as `told` of the searched part, errors as they are of the `whole` course."""
    bench, fit, case = selection.bench, selection.fit, told.case
    extension = case.extension
    own, settings = own_rig(tractor, ground, course.origin)
    before = run_squares(course, own, dict.fromkeys(range(len(course.names)), settings))
    after = run_squares(course, bench.rig, whole.case.extension.held_out)
    # Most important first: by the held-out error that comes back without the effect.
    named = [one.id for one in sorted(each, key=lambda one: -(one.gain_pct or 0.0)) if one.status == NAMED]
    alike = {one.id: Alike(one.interval, one.equivalent_to) for one in each if one.status == EQUIVALENT}
    beyond = unexplained(whole, whole.case.number(before))
    share = beyond.share
    unseen = [one.id for one in each if one.status == NOT_VISIBLE and one.value is None]
    return Diagnosis(
        names=course.names,
        rows_used=course.rows,
        rows_gated=course.rows_read - course.rows,
        minutes=course.seconds / 60.0,
        ground=ground,
        before=errors_of(before),
        after=errors_of(after),
        floor=errors_of(whole.case.floor),
        guilty_block=_guilty(named, each, selection if share > 0.0 else None),
        block_error=_blocks(with_real_noise(bench, fit), case),
        findings=tuple(each),
        named=tuple(named),
        unexplained_share=share,
        depends_on=_depends_on(selection, extension) if share > 0.0 else (),
        next_drive=next_drive(bench, fit, bench.rig.tractor, rivals, case.found),
        tractor=_with_rest(
            tractor, extended_tractor(bench.course, tractor, ground, extension, named, alike, unseen),
            whole.case.number(before), whole.case.final,
        ),
        calibration={name: value for name, value in case.found.items() if name not in told.names},
        curve=best_curve(
            bench, {run: settings_in(extension.terms, run) for run in range(len(bench.course.names))},
            named or list(rivals), selection.unnamed,
        ),
        grounds=_grounds(told),
        pace_mps=usual(course.stretches)[1],
        along_judged=whole.case.bench.has_speed,
        above_noise_s=beyond.above_s,
    )  # fmt: skip


def _depends_on(selection: Selection, extension: Extension) -> tuple[str, ...]:
    """What is left depends on: the unnamed terms of the fit, else those of the rest that lowers the error."""
    rest = [f"{BY_NAME[name].changes} that depends on {BY_NAME[name].on}" for name in BY_NAME if name in extension.ids]
    return tuple(one.words for one in selection.unnamed) or tuple(dict.fromkeys(rest))


def _with_rest(tractor: Tractor, extended: Tractor, before: Array, after: Array) -> Tractor:
    """The extended tractor with the rest of the file, unless there is a new one or these logs speak against it."""
    if extended.rest is not None or tractor.rest is None or float(before.sum()) > SAME_ERROR * float(after.sum()):
        return extended
    return extended.model_copy(update={"rest": tractor.rest})


def _guilty(named: list[str], each: list[Finding], left: Selection | None) -> str | None:
    """Block of the first name; without one, of the first of a set, or of the first unnamed term of what is left."""
    if named:
        return effect(named[0]).block
    alike = [one for one in each if one.status == EQUIVALENT]
    if alike:
        return alike[0].block
    return left.unnamed[0].block if left is not None and left.unnamed else None


def _blocks(bench: Bench, case: Case) -> dict[str, tuple[float, float]]:
    """Per channel cut at the sensors, the surprise before and after (1 is noise alone)."""
    main = settings_in([replace(term, runs=None) for term in case.main_terms.values()], 0)
    bench = prepare(bench.course, bench.rig, main, bench.noise)
    first, last = bench.surprise({}), np.zeros(5 * bench.course.rows)
    own = {run: settings_in(case.extension.terms, run) for run in range(len(bench.course.names))}
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


def _grounds(told: Explained) -> tuple[Grounds, ...]:
    """Effects with two levels: which runs were clearly at which, the longer driving first."""
    if told.mended is None:
        return ()
    course = told.case.bench.course
    seconds = driven_seconds(course)
    levels = []
    for term, runs in clear_levels(told.mended.loop, told.mended.model):
        entry, value = effect(term.knobs.id), term.value
        one = Grounds(entry.id, value, entry.words(value), tuple(course.names[run] for run in runs))
        levels.append((-float(seconds[sorted(term.runs or ())].sum()), one))
    return tuple(one for _, one in sorted(levels, key=lambda pair: pair[0]))
