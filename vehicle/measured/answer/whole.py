"""What was found in a part of long logs, asked of all of them: the errors before and after, and the noise floor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vehicle.learnt import Settings
from vehicle.measured.answer.case import Case, with_real_noise
from vehicle.measured.fit.openloop import Terms, settings_in
from vehicle.measured.mend.levels import level_of
from vehicle.measured.replay.course import Course
from vehicle.measured.replay.horizons import Halves, run_squares
from vehicle.measured.replay.part import Part
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.surprise.floor import floor_squares
from vehicle.measured.surprise.weights import channels


def whole_case(course: Course, part: Part, case: Case) -> Case:
    """The case of a part of a course with the errors of the whole; itself where the part is the whole.

    Runs outside the part had no share in what was found, and are driven with all of it.
    """
    if part.course is course:
        return case
    # Filters of the path, which take most room, tell of causes, and those were told by the part.
    noise = with_real_noise(case.bench, case.fit).noise
    bench = Bench(course, case.bench.rig, noise, (), *channels(course, case.bench.rig, case.fit.settings))
    settings, held_out = dict(_of_unseen(course, part, case)), dict[int, Halves]()
    for number, run in enumerate(part.runs):
        settings[run] = settings_in(case.extension.terms, number)
        held_out[run] = case.extension.held_out[number]
    held_out |= {run: (one, one) for run, one in settings.items() if run not in held_out}
    floor = floor_squares(bench, settings, tolerated=case.tolerated)
    return replace(case, bench=bench, extension=replace(case.extension, held_out=held_out), floor=floor)


def _of_unseen(course: Course, part: Part, case: Case) -> Mapping[int, Settings]:
    """Settings of the runs outside the part, of two levels those that suit a run better."""
    terms: Terms = case.extension.terms
    unseen = [run for run in range(len(course.names)) if run not in part.runs]
    levels = [settings_in(level_of(terms, level), 0) for level in (0, 1)]
    if levels[0] == levels[1]:
        return dict.fromkeys(unseen, levels[0])
    others = replace(course, stretches=tuple(one for one in course.stretches if one.run not in part.runs))
    errors = [
        case.number(run_squares(others, case.bench.rig, dict.fromkeys(range(len(course.names)), one))) for one in levels
    ]
    better = np.argmin(errors, axis=0)
    return {run: levels[better[run]] for run in unseen}
