"""The next drive: what separates by formula, and drives that alone tell two causes apart."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.analytic_drives import circle, course, rig
from tests.identification.diagnosis.problems import build_drive_problem, build_hypothesis, fit_with
from vehicle.identification.diagnosis.grammar import build_scope
from vehicle.identification.diagnosis.model_fit import CHANNELS, Fit, Problem
from vehicle.identification.diagnosis.next_drive import (
    DRIVE_PROGRAMMES,
    NO_EFFECT,
    PROGRAMME_PACE_MPS,
    SIGMAS_PER_Z,
    DriveProgramme,
    build_command_segment,
    build_trial,
    choose_next_drive,
    compute_separation,
    find_usual_heading_and_speed,
    simulate_programme,
)
from vehicle.identification.logs.thresholds import SURE_SIGMAS
from vehicle.model.tractor import load_tractor

UNDERSTEER = {"understeer": {"deg_per_mps2": 3.0}}
BY_ID = {programme.id: programme for programme in DRIVE_PROGRAMMES}
PIECES = ((2.0, 10.0, 1.0, 0.0), (3.0, -5.0, 0.5, 1.0))


def build_linear_trial(columns: np.ndarray) -> Any:
    """A drive in unit noise on which each amount (k) adds its column (n, k) to the turned channel, whoever explains."""

    def compute_residuals(model: Any, amounts: np.ndarray) -> dict[str, np.ndarray]:
        return {channel: -(columns @ amounts)[None] * (channel == "pose") for channel in CHANNELS}

    def compute_secants(*_: Any) -> dict[str, np.ndarray]:
        return {channel: columns[None] * (channel == "pose") for channel in CHANNELS}

    noise = {channel: SimpleNamespace(whiten=lambda values: values) for channel in CHANNELS}
    return SimpleNamespace(compute_residuals=compute_residuals, compute_secants=compute_secants, noise=noise)


def explain(amounts: list[float], precision: list[float]) -> Fit:
    return Fit((), np.array(amounts), 0.0, {}, np.diag(precision))


def test_what_separates_is_what_the_wrong_explanation_cannot_take() -> None:
    """Two amounts that act at right angles, 3 and 4: what the logs leave open gives way, and all else counts."""
    trial = build_linear_trial(np.eye(2))
    fixed, free = [1e12, 1e12], [1e-12, 1e12]
    assert compute_separation(trial, explain([3.0, 4.0], fixed), explain([0.0, 0.0], fixed)) == pytest.approx(5.0)
    assert compute_separation(trial, explain([3.0, 4.0], fixed), explain([0.0, 0.0], free)) == pytest.approx(4.0)
    # One known as well from the logs as from the drive takes half of its square.
    half = explain([0.0, 0.0], [1.0, 1e12])
    assert compute_separation(trial, explain([3.0, 4.0], fixed), half) == pytest.approx(np.sqrt(0.5 * 9.0 + 16.0))


def test_an_effect_that_adapts_to_nothing_is_not_there() -> None:
    trial, one, none = build_linear_trial(np.eye(2)), explain([3.0, 4.0], [1e-12] * 2), explain([0.0, 0.0], [1e12] * 2)
    assert compute_separation(trial, one, none) == pytest.approx(0.0, abs=1e-4)
    assert compute_separation(trial, one, none, can_both_adapt=False) == pytest.approx(5.0)


@pytest.fixture(scope="module")
def circles() -> Problem:
    """Circles at one speed and one angle, on which a loss by lateral acceleration is a gain."""
    return build_drive_problem("circles", UNDERSTEER)


def build_pair(problem: Problem, first: str, second: str) -> tuple[Fit, Any]:
    """The fit of the first, and both with the amounts by which they explain the logs."""
    hypotheses = [build_hypothesis(problem, name) for name in (first, second)]
    fits = [fit_with(problem, one) for one in hypotheses]
    return fits[0], tuple((one, fit.get_amounts(one)) for one, fit in zip(hypotheses, fits, strict=True))


def shorten(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Leave only some programmes to choose from."""
    chosen: tuple[DriveProgramme, ...] = tuple(BY_ID[name] for name in names)
    monkeypatch.setattr("vehicle.identification.diagnosis.next_drive.DRIVE_PROGRAMMES", chosen)


def test_a_circle_at_two_speeds_tells_understeer_from_a_gain(circles: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    fit, pair = build_pair(circles, "understeer", "steering_gain")
    drive = choose_next_drive(circles, fit, [pair])
    assert drive is not None and drive.id == "two-speeds" and drive.decides
    assert drive.separates == ("understeer", "steering_gain") and drive.score > SIGMAS_PER_Z * SURE_SIGMAS
    assert (drive.description, drive.seconds) == (BY_ID[drive.id].description, BY_ID[drive.id].seconds)
    shorten(monkeypatch, "there-and-back", "circles", "steps")
    other = choose_next_drive(circles, fit, [pair])
    assert other is not None and not other.decides and other.score < 1.0


def test_lifting_the_implement_tells_an_offset_from_a_draft(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = build_drive_problem("there-and-back", {"steering_offset": {"angle_deg": 2.0}})
    fit, pair = build_pair(problem, "steering_offset", "implement_side_draft")
    shorten(monkeypatch, "implement-lifted", "there-and-back")
    drive = choose_next_drive(problem, fit, [pair])
    assert drive is not None and drive.id == "implement-lifted"
    shorten(monkeypatch, "there-and-back")
    same = choose_next_drive(problem, fit, [pair])
    assert same is not None and same.score < drive.score


def test_most_pairs_are_decided_and_the_hardest_of_them_is_named(circles: Problem) -> None:
    fit, pair = build_pair(circles, "understeer", "steering_gain")
    drive = choose_next_drive(circles, fit, [(pair[0], None), pair])
    assert drive is not None and drive.id == "two-speeds" and drive.separates == ("understeer", "steering_gain")
    alone = choose_next_drive(circles, fit, [(pair[0], None)])
    assert alone is not None and alone.separates == ("understeer", NO_EFFECT) and alone.score > drive.score
    assert choose_next_drive(circles, fit, []) is None


def test_equal_explanations_are_never_separated_and_laws_of_one_effect_are_named(circles: Problem) -> None:
    gain = build_hypothesis(circles, "steering_gain")
    law, amounts = build_scope(gain, "by_implement"), np.zeros(1)
    drive = choose_next_drive(circles, fit_with(circles), [((gain, amounts), (law, amounts))])
    assert drive is not None and drive.score == 0.0 and not drive.decides
    assert drive.separates == ("steering_gain:constant", "steering_gain:by_implement")


def test_the_fault_of_one_run_is_not_on_the_next_drive(circles: Problem) -> None:
    gain = build_hypothesis(circles, "steering_gain")
    trial = build_trial(circles, BY_ID["circles"])
    law = build_scope(gain, "by_run:1")
    assert circles.bases.get(law.basis).any() and not trial.bases.get(law.basis).any()
    moved, still = (trial.compute_residuals([one], np.array([0.2]))["pose"] for one in (gain, law))
    nothing = trial.compute_residuals([], np.empty(0))["pose"]
    assert np.abs(moved - nothing).max() > 0.1 and np.array_equal(still, nothing)


def test_a_drive_has_the_columns_and_the_noise_of_the_logs() -> None:
    bare = build_drive_problem("circles", {}, has_heading=False, has_wheel=False)
    bare.noise["pose"].set_amounts(bare.noise["pose"].amounts + 1.0)
    trial = build_trial(bare, BY_ID["four-ways"])
    assert trial.data.east.observed.any() and trial.data.speed.observed.any()
    assert not trial.data.heading.observed.any() and not trial.data.wheel.observed.any()
    np.testing.assert_array_equal(trial.noise["pose"].amounts, bare.noise["pose"].amounts)
    starts_s = [segment.start_s for segment in trial.data.segments]
    assert starts_s == [0.0, 15.0, 30.0, 45.0]
    first = bare.data.dataset.segments[0]
    moved = replace(first, east=first.east + 50.0)
    far = replace(bare.data, dataset=replace(bare.data.dataset, segments=(moved,)))
    begun = build_trial(SimpleNamespace(data=far, rig=bare.rig, get_noise=bare.get_noise), BY_ID["circles"])
    assert begun.data.path["east"][0] == pytest.approx(trial.data.path["east"][0] + 50.0, abs=0.5)


# --- Drives that nobody has made: commands by hand, and a circle that is logged as it is driven ---


def test_a_drive_has_the_commands_of_its_pieces() -> None:
    one = build_command_segment(4, 0.3, PIECES, 2.0, step=0.5)
    assert one.run == 4 and one.time == pytest.approx(np.arange(10) * 0.5) and (one.heading == 0.3).all()
    assert one.command is not None and one.target is not None and one.wheel is None
    assert np.degrees(one.command) == pytest.approx([10.0] * 4 + [-5.0] * 6)
    assert one.target == pytest.approx([2.0] * 4 + [1.0] * 6) and one.working == pytest.approx([0.0] * 4 + [1.0] * 6)
    assert len(one.grids["command"]) == math.ceil(4.5 * 60.0) + 1
    assert np.degrees(one.grids["command"][[119, 121]]) == pytest.approx([10.0, -5.0])


def test_every_drill_lasts_what_its_words_say() -> None:
    assert DriveProgramme("one", "words", ((0.0, PIECES), (180.0, PIECES))).seconds == 10.0
    assert len({drill.id for drill in DRIVE_PROGRAMMES}) == len(DRIVE_PROGRAMMES)
    by_name = {drill.id: drill.seconds for drill in DRIVE_PROGRAMMES}
    assert (by_name["implement-lifted"], by_name["circles"], by_name["four-ways"]) == (30.0, 40.0, 60.0)


def test_a_drill_is_logged_as_it_is_driven() -> None:
    """Two straight passes, the second the other way: each antenna goes its way at the usual pace."""
    drill = DriveProgramme("there", "and back", ((0.0, ((10.0, 0.0, 1.0, 0.0),)), (180.0, ((10.0, 0.0, 1.0, 0.0),))))
    made = simulate_programme(rig(), drill, 0.5, 1.2, {})
    assert made.names == ("pass 1", "pass 2") and [one.run for one in made.segments] == [0, 1]
    for one, heading in zip(made.segments, (0.5, 0.5 - math.pi), strict=True):
        way = np.array([one.east[-1] - one.east[0], one.north[-1] - one.north[0]])
        assert math.atan2(way[1], way[0]) == pytest.approx(math.remainder(heading, 2.0 * math.pi))
        assert np.hypot(*way) == pytest.approx(1.2 * one.time[-1], rel=1e-6)
        assert one.wheel is not None and one.wheel == pytest.approx(np.zeros(one.rows))


def test_a_circle_of_a_drill_has_the_measured_radius() -> None:
    drill = DriveProgramme("circle", "to the right", ((0.0, ((30.0, 15.0, 1.0, 0.0),)),))
    (one,) = simulate_programme(rig(), drill, 0.0, PROGRAMME_PACE_MPS, {}).segments
    late = one.time > 10.0
    way = np.hypot(np.diff(one.east[late]), np.diff(one.north[late])).sum()
    turned = one.heading[late][0] - one.heading[late][-1]
    assert way / turned == pytest.approx(load_tractor("eg105").get_power_law("soil").compute_radius_m(15.0), rel=0.02)


def test_the_usual_drive_is_the_mean_heading_and_the_median_speed() -> None:
    runs = course(circle(0.0, bearing_deg=80.0), circle(0.0, bearing_deg=100.0))
    heading, pace = find_usual_heading_and_speed(runs.segments)
    assert heading == pytest.approx(0.0, abs=1e-9) and pace == pytest.approx(1.5)
