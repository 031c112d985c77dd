"""Hints say where to look; drives without anything wrong give none."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from fields.arrays import Floats
from tests.identification.analytic_drives import circle, course
from tests.identification.diagnosis.problems import build_empty_fit, build_problem, leave_parts
from vehicle.identification.diagnosis import hints
from vehicle.identification.diagnosis.drive_data import POSE_CELL_S, POSE_CELLS
from vehicle.identification.diagnosis.grammar import CONSTANT, Coordinate, Hypothesis, build_scope, list_nuisances
from vehicle.identification.diagnosis.hints import (
    CHANGES,
    QUANTITY_WORDS,
    WHERE_WORDS,
    compare_thirds,
    compute_chance,
    compute_noise_floor,
    compute_rank_sigmas,
    find_hints,
    find_laws,
    limit_noise,
    list_law_hints,
    list_loud,
    list_quantities,
    measure_unexplained,
    replay_commands,
)
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.noise import FREEDOM, POSE_PARTS
from vehicle.identification.diagnosis.search import Judgement, PredictiveComparison
from vehicle.identification.replay.drive_segments import HORIZONS_S, DriveDataset, DriveSegment
from vehicle.identification.replay.horizon_errors import (
    Pieces,
    compute_horizon_errors,
    join_pieces,
    measure_dataset,
    measure_pieces,
    sum_by_run,
)
from vehicle.identification.replay.simulation import simulate_instruments
from vehicle.model.effects import PATH

RNG = np.random.default_rng(5)
BLOCKS = 60
clean = lru_cache(maxsize=1)(lambda: build_problem(seed=1))

SPREAD = FREEDOM / (FREEDOM - 2.0)
DRAWS = 8


def fit_base(problem: Problem) -> Fit:
    model = tuple(list_nuisances(problem.data))
    return problem.fit(model, np.zeros(len(model)), 2)


def turn_headings(segment: DriveSegment) -> DriveSegment:
    """Headings of a compass near iron: 3 degrees off, to and fro with the direction of travel."""
    return replace(segment, heading=segment.heading + math.radians(3.0) * np.cos(segment.heading))


def sway_antenna(segment: DriveSegment) -> DriveSegment:
    """An antenna that leans out of bends by 25 cm per m/s2."""
    aside = -0.25 * segment.speed * np.gradient(segment.heading, segment.time)
    east, north = segment.east + aside * np.sin(segment.heading), segment.north - aside * np.cos(segment.heading)
    return replace(segment, east=east, north=north)


def test_a_clean_drive_follows_no_law_and_the_noise_is_kept() -> None:
    problem = clean()
    fit = fit_base(problem)
    noise, bases = problem.get_noise(), dict(problem.bases.arrays)
    assert find_laws(problem, fit, list_quantities(problem)) == []
    assert not any("depends on" in hint.words for hint in find_hints(problem, fit, ()))
    assert all(np.array_equal(noise[channel], amounts) for channel, amounts in problem.get_noise().items())
    assert problem.bases.arrays.keys() == bases.keys()


@pytest.mark.parametrize(
    ("alter", "instrument", "depends_on"),
    [(turn_headings, "heading", "the direction of travel"), (sway_antenna, "position", "lateral acceleration")],
)
def test_what_is_wrong_with_an_instrument_is_told_with_what_it_depends_on(
    alter: object, instrument: str, depends_on: str
) -> None:
    problem = build_problem(alter, seed=1)  # type: ignore[arg-type]
    hint = find_hints(problem, fit_base(problem), ())[0]
    assert hint.instrument == instrument and hint.depends_on == depends_on
    assert hint.words.startswith("The error looks like ") and hint.words.endswith(f"depends on {depends_on}.")


def test_laws_that_no_tractor_file_holds_are_told_where_they_are_clear() -> None:
    parent = Hypothesis("steering_gain", CONSTANT, (Coordinate((("bend", 1.0),), 0.2, -0.5, 0.5),))
    law = build_scope(parent, "by_implement")

    def judge(hypothesis: Hypothesis, z: float) -> Judgement:
        return Judgement(hypothesis, PredictiveComparison(None, 50.0, z))

    (hint,) = list_law_hints([judge(law, 6.0), judge(law, 2.0), judge(parent, 9.0)])
    assert hint.depends_on == "the implement" and hint.block == PATH
    assert hint.words == "A part of the error would go if the steering gain changed with the implement."


def make_ratios(**of: float) -> dict[str, Floats]:
    pose = np.full(12, 0.5)
    pose[[2, 9, 10, 5]] = [of.get(name, 0.5) for name in ("walk", "along", "across", "turns")]
    return {"pose": pose}


@pytest.mark.parametrize(
    ("ratios", "shown"),
    [({"along": 9.0}, "speed"), ({"across": 4.0}, "heading"), ({"walk": 3.0}, "position"),
     ({"along": 9.0, "across": 4.0}, "position"), ({"turns": 3.0}, None)],
)  # fmt: skip
def test_noise_that_is_too_loud_says_which_instrument(ratios: dict[str, float], shown: str | None) -> None:
    quiet, loud = np.ones(BLOCKS), np.full(BLOCKS, 5.0)
    (hint,) = list_loud({"pose": loud, "wheel": quiet, "speed": np.zeros(0)}, make_ratios(**ratios))
    assert hint.instrument == shown and (hint.block == PATH) == (shown is None)
    assert not list(list_loud({"pose": quiet, "wheel": quiet, "speed": quiet}, make_ratios(**ratios)))


def test_errors_that_are_larger_somewhere_are_compared_by_thirds() -> None:
    values = RNG.uniform(0.0, 1.0, BLOCKS)
    squares = RNG.uniform(0.9, 1.1, BLOCKS) * (1.0 + 3.0 * values) ** 2
    assert compute_rank_sigmas(values, squares) > 4.0 and 2.0 < compare_thirds(values, squares) < 4.0
    assert compute_rank_sigmas(np.ones(BLOCKS), squares) == 0.0
    reverse = np.zeros(BLOCKS)
    reverse[20:28] = 1.0
    assert compare_thirds(reverse, np.where(reverse > 0.0, 9.0, 1.0)) == pytest.approx(3.0)
    assert compare_thirds(np.zeros(BLOCKS), np.ones(BLOCKS)) == 1.0


def test_every_quantity_has_words() -> None:
    assert set(list_quantities(clean())) <= set(QUANTITY_WORDS) and set(WHERE_WORDS) <= set(QUANTITY_WORDS)
    assert {key for change in CHANGES for key in change.keys} <= set(QUANTITY_WORDS)


# --- The noise floor is the error of draws from the noise model itself; what is above it is unexplained ---

problem = lru_cache(maxsize=1)(build_problem)


def mean_squares(pieces: Pieces, horizon: float) -> Floats:
    """Mean squares (3,) across, along and of the heading."""
    total = pieces[horizon][:, 2:].sum(axis=0)
    return np.asarray(total[:3] / total[3])


def draw_errors(made: Problem, horizon: float) -> Floats:
    """Mean squares (3,) over a horizon of draws from the covariances of the windows."""
    data, noise, rng = made.data, made.noise["pose"], np.random.default_rng(3)
    covariance = np.tensordot(np.exp(noise.amounts), noise.parts, axes=1)
    roots = np.linalg.cholesky(covariance + 1e-14 * np.eye(covariance.shape[1]))
    east, north, heading = (data.cut(data.path[name], POSE_CELLS) for name in ("east", "north", "heading"))
    squares = []
    for window in np.flatnonzero(data.east.observed.all(axis=1)):
        segment = data.window_segments[window]
        for _ in range(DRAWS):
            moved = (roots[window] @ rng.standard_normal(3 * POSE_CELLS)).reshape(3, -1)
            drawn = replace(data.segments[segment], time=POSE_CELL_S * np.arange(POSE_CELLS), speed=np.ones(POSE_CELLS),
                            east=east[window] + moved[0], north=north[window] + moved[1],
                            heading=heading[window] + moved[2])  # fmt: skip
            antenna = np.stack([east[window], north[window]], axis=1)
            squares.append(measure_pieces(drawn, antenna, heading[window]))
    return mean_squares(join_pieces(squares), horizon)


@pytest.mark.parametrize("part", [2, 3, 4, 5, 6, 7, 8, 9, 10])
def test_the_floor_is_the_error_of_draws_from_the_noise_model(part: int) -> None:
    """Each part alone: random walk, slow heading, yaw rates, turning, speeds and crab, where its error shows."""
    made = problem()
    leave_parts(made, (part,))
    floor = mean_squares(compute_noise_floor(made, build_empty_fit(made), made.data.dataset), 5.0) / SPREAD
    drawn = draw_errors(made, 5.0)
    told = drawn > 0.1 * drawn.max() * np.array([1.0, 1.0, 0.1])
    assert np.sqrt(floor[told]) == pytest.approx(np.sqrt(drawn[told]), rel=0.3)


def test_white_noise_of_the_receiver_is_that_of_its_rows() -> None:
    """A cell holds the mean of several rows; across and along 5 s nothing but that noise is left."""
    made = problem()
    leave_parts(made, (0,))
    floor = mean_squares(compute_noise_floor(made, build_empty_fit(made), made.data.dataset), 5.0)
    rows = POSE_CELL_S / made.data.row_step_s
    assert np.sqrt(floor[:2]) == pytest.approx(POSE_PARTS[0].usual * math.sqrt(rows * SPREAD), rel=0.1)


def test_noise_of_a_wheel_that_follows_its_command_turns_the_path() -> None:
    """A wheel angle off by white noise per cell of 0.2 s turns the heading by a random walk."""
    made = problem()
    leave_parts(made, ())
    quiet = mean_squares(compute_noise_floor(made, build_empty_fit(made), made.data.dataset), 5.0)
    sizes = made.get_noise()
    made.set_noise({**sizes, "wheel": np.append(2.0 * math.log(1e-3), np.full(4, -40.0))})
    loud = mean_squares(compute_noise_floor(made, build_empty_fit(made), made.data.dataset), 5.0)
    # Over T seconds a random walk is off its mean by T / 6 of its variance per second, and turns with the path.
    rate = 1e-3 * 1.4 / made.rig.tractor.wheelbase_m
    assert quiet.max() < 1e-6
    assert 0.3 < math.sqrt(loud[2]) / (rate * math.sqrt(0.2 * 5.0 / 6.0 * SPREAD)) < 3.0


def test_the_floor_is_the_same_each_time_and_has_the_rows_of_the_error() -> None:
    made = problem()
    leave_parts(made, (0, 5))
    fit = build_empty_fit(made)
    first, second = (compute_noise_floor(made, fit, made.data.dataset) for _ in range(2))
    error = measure_dataset(made.data.dataset, made.rig, {})
    for horizon in HORIZONS_S:
        assert np.array_equal(first[horizon], second[horizon])
        of_floor, of_error = (sum_by_run(pieces, made.data.runs, horizon)[:, 3] for pieces in (first, error))
        assert of_floor == pytest.approx(hints.DRAWS * of_error)
    assert set(compute_horizon_errors(first)) == set(HORIZONS_S)


def test_commands_replayed_by_the_core_lead_where_the_replay_of_the_vehicle_leads() -> None:
    made = problem()
    replayed, begin = replay_commands(made.data, made.rig, [])[:2], 0
    for segment in made.data.segments:
        antenna, heading, _, _ = simulate_instruments(made.rig, segment, {})
        rows = slice(begin, begin + segment.rows)
        driven = replace(segment, east=antenna[:, 0], north=antenna[:, 1], heading=heading)
        pieces = measure_pieces(driven, *(one[rows] for one in replayed))
        assert math.sqrt(mean_squares(pieces, 5.0)[:2].sum()) < 0.02
        begin += segment.rows


def test_what_the_fit_calls_noise_is_no_more_than_ground_and_instruments_make() -> None:
    made = problem()
    leave_parts(made, ())
    loud = {channel: np.full(len(amounts), 4.0) for channel, amounts in made.get_noise().items()}
    made.set_noise(loud)
    limits = limit_noise(made)
    assert limits["pose"][0] == pytest.approx(math.exp(2.0)) and limits["pose"][9] == 0.003
    assert limits["wheel"][4] == pytest.approx(0.07) and np.all(limits["speed"][1:] < 0.2)


def make_pieces(of_5: float, of_20: float = 1.0) -> Pieces:
    """A piece of two runs each with these mean squares, in units of the floor."""
    sizes = {1.0: 1.0, 5.0: of_5, 10.0: 1.0, 20.0: of_20}
    return {
        horizon: np.array([[run, 0.0, size, size, size, 1.0] for run in range(2)]) for horizon, size in sizes.items()
    }


def make_dataset(seconds: float) -> DriveDataset:
    """Two runs with so much driving together, with speeds."""
    (one,) = course(circle(0.0, seconds + 0.1)).segments
    return DriveDataset(("a", "b"), (one,), (0.0, 0.0), one.rows)


@pytest.mark.parametrize("after, before, share", [(1.2, 9.0, 0.0), (5.0, 9.0, 0.5), (9.0, 9.0, 1.0), (9.0, 2.0, 1.0)])
def test_the_unexplained_share_is_what_no_cause_takes_away_above_the_floor(
    after: float, before: float, share: float
) -> None:
    found = measure_unexplained(make_dataset(600.0), 0.1, make_pieces(1.0), make_pieces(before), make_pieces(after))
    assert found == (pytest.approx(share), (5.0,) if share > 0.0 else ())


def test_every_horizon_is_held_against_its_own_floor() -> None:
    """One at the floor makes no other good that stands at twice of it; longer pieces are fewer, and chance more."""
    floor, before = make_pieces(1.0), make_pieces(9.0)
    far = measure_unexplained(make_dataset(600.0), 0.1, floor, before, make_pieces(1.0, 2.0))
    assert far == (0.0, (20.0,))
    chance = 1.0 + compute_chance(100.0, 20.0)
    for size, above_s in ((chance - 0.01, ()), (chance + 0.01, (20.0,))):
        assert measure_unexplained(make_dataset(100.0), 0.0, floor, before, make_pieces(1.0, size))[1] == above_s
