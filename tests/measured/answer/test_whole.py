"""What a part told, asked of the whole: circles of the simulator itself with and without a gain of the steering."""

from dataclasses import replace

import numpy as np

from tests.measured.benches import NOISE, eg105, rig
from vehicle.learnt import Settings
from vehicle.measured.answer.case import Case
from vehicle.measured.answer.whole import whole_case
from vehicle.measured.fit.fitting import empty_fit
from vehicle.measured.fit.knobs import knobs_for
from vehicle.measured.fit.openloop import Term, Terms, settings_in
from vehicle.measured.mend.extension import Extension
from vehicle.measured.replay.course import Course
from vehicle.measured.replay.drives import DRILLS, driven
from vehicle.measured.replay.horizons import run_squares
from vehicle.measured.replay.part import Part
from vehicle.measured.surprise.bench import prepare
from vehicle.measured.surprise.floor import floor_squares

KNOBS = knobs_for(eg105(), "steering_gain")
MORE: Settings = {"steering_gain": KNOBS.values(np.array([1.3]))}


def course_of(*settings: Settings) -> Course:
    """A circle to the right per run, driven with these effects."""
    drill = next(one for one in DRILLS if one.id == "circles")
    made = [driven(rig(), drill, 0.0, 1.4, one).stretches[0] for one in settings]
    stretches = tuple(replace(one, run=run) for run, one in enumerate(made))
    names = tuple(f"run {run}" for run in range(len(made)))
    return Course(names, stretches, (0.0, 0.0), sum(one.rows for one in stretches))


def part_of(course: Course, *runs: int) -> Part:
    """Some runs of a course."""
    stretches = tuple(replace(course.stretches[run], run=number) for number, run in enumerate(runs))
    return Part(Course(tuple(course.names[run] for run in runs), stretches, (0.0, 0.0), course.rows_read), runs)


def case_of(part: Part, *terms: Term) -> Case:
    """The case of a part in which these terms were found, each run held out told the same."""
    bench = prepare(part.course, rig(), {}, NOISE)
    settings = {run: settings_in(terms, run) for run in range(len(part.runs))}
    found: Terms = terms
    extension = Extension(found, {}, {run: (one, one) for run, one in settings.items()})
    return Case(bench, empty_fit(bench), extension, floor_squares(bench, settings))


def test_a_part_that_is_the_whole_has_its_case() -> None:
    course = course_of({}, {})
    case = case_of(Part(course, (0, 1)))
    assert whole_case(course, Part(course, (0, 1)), case) is case


def test_runs_outside_the_part_are_driven_with_all_that_was_found() -> None:
    course = course_of(MORE, MORE, {}, MORE)
    part = part_of(course, 1, 3)
    case = case_of(part, Term(KNOBS, np.array([1.3])))
    slightly: Settings = {"steering_gain": KNOBS.values(np.array([1.29]))}
    case = replace(case, extension=replace(case.extension, held_out={0: (slightly, MORE), 1: (MORE, slightly)}))
    whole = whole_case(course, part, case)
    assert whole.extension.held_out == {0: (MORE, MORE), 1: (slightly, MORE), 2: (MORE, MORE), 3: (MORE, slightly)}
    assert len(whole.floor) == 4 and whole.final.shape == (4,)
    before = whole.number(run_squares(course, rig(), {run: {} for run in range(4)}))
    assert (whole.final[[0, 1, 3]] < 0.1 * before[[0, 1, 3]]).all()
    assert whole.final[2] > 10.0 * before[2], "a run without the effect is an error that the part did not show"


def test_of_two_levels_a_run_outside_the_part_gets_the_one_that_suits_it() -> None:
    course = course_of({}, MORE, MORE, {}, MORE)
    part = part_of(course, 0, 1)
    level = np.array(KNOBS.neutral)
    case = case_of(part, Term(KNOBS, level, frozenset({0})), Term(KNOBS, np.array([1.3]), frozenset({1})))
    whole = whole_case(course, part, case)
    gains = [whole.extension.held_out[run][0]["steering_gain"] for run in range(5)]
    assert gains == [KNOBS.values(level) if run in (0, 3) else MORE["steering_gain"] for run in range(5)]
