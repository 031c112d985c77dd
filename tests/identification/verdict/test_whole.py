"""What a part told, asked of the whole: circles of the simulator itself with and without a gain of the steering."""

from dataclasses import replace

import numpy as np

from tests.identification.residual_models import NOISE, eg105, rig
from vehicle.identification.fit.effect_parameters import build_parameters
from vehicle.identification.fit.open_loop import ModelTerm, ModelTerms, collect_run_settings
from vehicle.identification.fit.residual_fit import make_empty_fit
from vehicle.identification.model_extension.tractor_extension import ModelExtension
from vehicle.identification.replay.data_subset import DataSubset
from vehicle.identification.replay.drive_programmes import DRIVE_PROGRAMMES, simulate_programme
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.identification.replay.horizon_errors import sum_squared_errors_by_run
from vehicle.identification.residuals.noise_floor import compute_noise_floor
from vehicle.identification.residuals.residual_model import build_residual_model
from vehicle.identification.verdict.held_out_case import DiagnosisCase, build_whole_dataset_case
from vehicle.model.tractor import Settings

KNOBS = build_parameters(eg105(), "steering_gain")
MORE: Settings = {"steering_gain": KNOBS.compute_values(np.array([1.3]))}


def course_of(*settings: Settings) -> DriveDataset:
    """A circle to the right per run, driven with these effects."""
    drill = next(one for one in DRIVE_PROGRAMMES if one.id == "circles")
    made = [simulate_programme(rig(), drill, 0.0, 1.4, one).segments[0] for one in settings]
    segments = tuple(replace(one, run=run) for run, one in enumerate(made))
    names = tuple(f"run {run}" for run in range(len(made)))
    return DriveDataset(names, segments, (0.0, 0.0), sum(one.rows for one in segments))


def part_of(course: DriveDataset, *runs: int) -> DataSubset:
    """Some runs of a course."""
    segments = tuple(replace(course.segments[run], run=number) for number, run in enumerate(runs))
    return DataSubset(
        DriveDataset(tuple(course.names[run] for run in runs), segments, (0.0, 0.0), course.rows_read), runs
    )


def case_of(part: DataSubset, *terms: ModelTerm) -> DiagnosisCase:
    """The case of a part in which these terms were found, each run held out told the same."""
    residual_model = build_residual_model(part.dataset, rig(), {}, NOISE)
    settings = {run: collect_run_settings(terms, run) for run in range(len(part.runs))}
    found: ModelTerms = terms
    extension = ModelExtension(found, {}, {run: (one, one) for run, one in settings.items()})
    return DiagnosisCase(
        residual_model, make_empty_fit(residual_model), extension, compute_noise_floor(residual_model, settings)
    )


def test_a_part_that_is_the_whole_has_its_case() -> None:
    course = course_of({}, {})
    case = case_of(DataSubset(course, (0, 1)))
    assert build_whole_dataset_case(course, DataSubset(course, (0, 1)), case) is case


def test_runs_outside_the_part_are_driven_with_all_that_was_found() -> None:
    course = course_of(MORE, MORE, {}, MORE)
    part = part_of(course, 1, 3)
    case = case_of(part, ModelTerm(KNOBS, np.array([1.3])))
    slightly: Settings = {"steering_gain": KNOBS.compute_values(np.array([1.29]))}
    case = replace(
        case, extension=replace(case.extension, held_out_settings={0: (slightly, MORE), 1: (MORE, slightly)})
    )
    whole = build_whole_dataset_case(course, part, case)
    assert whole.extension.held_out_settings == {
        0: (MORE, MORE),
        1: (slightly, MORE),
        2: (MORE, MORE),
        3: (MORE, slightly),
    }
    assert len(whole.noise_floor) == 4 and whole.final_errors.shape == (4,)
    before = whole.compute_run_errors(sum_squared_errors_by_run(course, rig(), {run: {} for run in range(4)}))
    assert (whole.final_errors[[0, 1, 3]] < 0.1 * before[[0, 1, 3]]).all()
    assert whole.final_errors[2] > 10.0 * before[2], "a run without the effect is an error that the part did not show"


def test_of_two_levels_a_run_outside_the_part_gets_the_one_that_suits_it() -> None:
    course = course_of({}, MORE, MORE, {}, MORE)
    part = part_of(course, 0, 1)
    level = np.array(KNOBS.neutral)
    case = case_of(part, ModelTerm(KNOBS, level, frozenset({0})), ModelTerm(KNOBS, np.array([1.3]), frozenset({1})))
    whole = build_whole_dataset_case(course, part, case)
    gains = [whole.extension.held_out_settings[run][0]["steering_gain"] for run in range(5)]
    assert gains == [KNOBS.compute_values(level) if run in (0, 3) else MORE["steering_gain"] for run in range(5)]
