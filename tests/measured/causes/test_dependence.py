"""What an error depends on when it has no name."""

from dataclasses import replace

import numpy as np
import pytest

from tests.measured.benches import bench_of, rig
from tests.measured.drawn import backwards, circle, course
from vehicle.measured.causes.dependence import (
    ALWAYS,
    DISTANCE,
    Dependence,
    Response,
    _per_angle,
    columns,
    dependences,
    explained,
    scores,
)
from vehicle.measured.fit.fitting import empty_fit
from vehicle.measured.surprise.bench import Bench, prepare
from vehicle.measured.surprise.whitening import Increments


@pytest.fixture(scope="module")
def pushed() -> Bench:
    """A tractor pushed to the east by 1 cm/s while it drives to all four points of the compass."""
    return bench_of("four-ways", {"rest": {"push_to_east": 0.01}})


def test_columns_explain_what_their_products_say() -> None:
    """One column: side squared over square. Two orthogonal ones add up, two that are the same count once."""
    assert explained(np.array([[4.0]]), np.array([6.0])) == pytest.approx(9.0)
    assert explained(np.diag([4.0, 100.0]), np.array([6.0, 10.0])) == pytest.approx(10.0)
    assert explained(np.full((2, 2), 4.0), np.array([6.0, 6.0])) == pytest.approx(9.0)
    assert explained(np.zeros((1, 1)), np.zeros(1)) == 0.0


def test_a_push_is_told_by_the_direction_of_travel(pushed: Bench) -> None:
    fit = empty_fit(pushed)
    best = scores(pushed, fit)[0]
    assert best.terms.words == "a push over the ground that depends on the direction of travel and the time on the way"
    path = fit.surprise[: 3 * pushed.course.rows]
    assert best.freedoms == 2 and 0.8 * float(path @ path) < best.gain <= 1.001 * float(path @ path)
    made = columns(pushed, fit, best.terms)
    amounts = np.linalg.lstsq(made, -fit.surprise, rcond=None)[0]
    assert amounts == pytest.approx([0.01, 0.0], abs=0.002)


def test_responses_are_linear_in_their_terms(pushed: Bench) -> None:
    fit = empty_fit(pushed)
    response = Response(pushed, fit)
    stretch, move = pushed.course.stretches[0], response.moves[0]
    bend = next(one for one in dependences(pushed) if one.on == "the direction of travel")
    east, north = bend.make(stretch, move, _per_angle(pushed, stretch))
    both = Increments(east.ahead, east.aside, east.turned + 2.0 * north.turned)
    one, two, sum_of = response.local(0, [east, north, both]).T
    assert np.abs(one).max() > 1.0 and sum_of == pytest.approx(one + 2.0 * two, abs=1e-8)


def test_waves_are_looked_for_between_eight_rows_and_the_length_of_a_run(pushed: Bench) -> None:
    told = [one for one in dependences(pushed) if one.per_run]
    periods = [float(one.on.split()[-2]) for one in told if "coming back" in one.on]
    assert min(periods) >= 2.5 and max(periods) <= 7.5  # half of a run of 15 s
    assert any(one.on == "time, changing slowly during a run" for one in told)
    made = columns(pushed, empty_fit(pushed), told[0])
    assert made.shape[1] in (4, 8)  # free in every run; waves of grip are nothing where nothing turns


def test_the_curvature_of_an_angle_is_the_slope_of_the_measured_law(pushed: Bench) -> None:
    """About straight ahead: the difference of two degrees of the table, over the wheelbase."""
    grid = np.linspace(-rig().tractor.max_steering_deg, rig().tractor.max_steering_deg, len(rig().table))
    left, right = (float(np.tan(np.interp(angle, grid, rig().table))) for angle in (-1.0, 1.0))
    slope = (right - left) / np.radians(2.0) / rig().tractor.wheelbase_m
    stretch = pushed.course.stretches[0]
    assert stretch.wheel is not None and not stretch.wheel.any()
    assert _per_angle(pushed, stretch) == pytest.approx(slope)


def test_words_and_blocks_of_a_term() -> None:
    grip = Dependence("speed", "a change of grip", lambda s, m, b: [])
    assert grip.words == "a change of grip that depends on speed" and grip.block == "wheel to path"
    assert Dependence(ALWAYS, DISTANCE, lambda s, m, b: []).words == "a change of the distance driven"
    assert Dependence(ALWAYS, DISTANCE, lambda s, m, b: []).block == "speed"


def test_products_of_many_stretches_are_explained_at_once() -> None:
    squares, sides = np.array([np.diag([4.0, 100.0]), np.full((2, 2), 4.0)]), np.array([[6.0, 10.0], [6.0, 6.0]])
    assert explained(squares, sides) == pytest.approx([10.0, 9.0])


@pytest.mark.parametrize(
    ("amounts", "size", "words"),
    [({"angle_by_speed": 0.2}, np.radians(0.2), "an extra wheel angle that depends on speed"),
     ({"grip_by_speed": 0.02}, 0.02, "a change of grip that depends on speed"),
     ({"push_to_east": 0.01}, 0.01, "a push over the ground that depends on the direction of travel and the time on "
                                    "the way")],
)  # fmt: skip
@pytest.mark.parametrize("gear", [1.0, -1.0])
def test_a_term_moves_the_tractor_as_the_rest_that_it_becomes(
    amounts: dict[str, float], size: float, words: str, gear: float
) -> None:
    """Two formulas of one thing, forward and in reverse."""
    frame = circle(0.05, 30.0).assign(steering_deg=8.0)
    bench = prepare(course(frame if gear > 0.0 else backwards(frame)), rig(), {})
    (plain,), (moved,), (stretch,) = bench.path({}), bench.path({"rest": amounts}), bench.course.stretches
    terms = next(one for one in dependences(bench) if one.words == words)
    term = terms.make(stretch, plain, _per_angle(bench, stretch))[0]
    for kind in ("ahead", "aside", "turned"):
        change, told = getattr(moved, kind) - getattr(plain, kind), size * getattr(term, kind)
        most = float(np.abs(told).max())
        if most > 0.0:
            assert change[20:] == pytest.approx(told[20:], abs=0.1 * most), kind


def test_turns_alone_answer_as_the_whole_filter_does() -> None:
    """Every column is the difference of two runs of the filter, wherever its turns begin."""
    bench = prepare(course(circle(0.05, 30.0).assign(steering_deg=8.0)), rig(), {})
    response = Response(bench, empty_fit(bench))
    rows = bench.course.stretches[0].rows - 1
    turns = 0.01 * np.random.default_rng(4).standard_normal((3, rows))
    turns[1, : rows // 2] = 0.0
    turns[2] = 0.0
    zero = np.zeros(rows)
    whole = response._moved(0, [Increments(zero, zero, one) for one in turns])
    alone = response.turned(0, turns)
    assert np.abs(alone - whole).max() < 1e-9 < np.abs(alone[:, 1]).max() and not alone[:, 2].any()
    assert not alone[: 3 * (rows // 2), 1].any()


def test_columns_of_every_run_are_those_of_all_runs_cut_up(pushed: Bench) -> None:
    """The slow way: the same columns for each run, 0 in all other rows, without those that are 0 all along."""
    fit = empty_fit(pushed)
    wave = next(one for one in dependences(pushed) if one.per_run)
    whole = columns(pushed, fit, Dependence(wave.on, wave.changes, wave.make))
    each = np.concatenate([whole * (pushed.runs == run)[:, None] for run in np.unique(pushed.runs)], axis=1)
    made = columns(pushed, fit, wave)
    assert len(np.unique(pushed.runs)) > 1 and made.shape[1] > whole.shape[1] > 0
    assert np.array_equal(made, each[:, np.abs(each).max(axis=0) > 1e-12])


def test_products_are_those_of_all_columns_whatever_is_passed_over(pushed: Bench) -> None:
    """Terms with each other, with what is left and with a fit, some of whose columns are of one run alone."""
    slope = np.random.default_rng(2).standard_normal((len(pushed.runs), 3))
    slope[pushed.runs != 0, 1] = 0.0
    fit = replace(empty_fit(pushed), slope=slope)
    response, bend = Response(pushed, fit), next(one for one in dependences(pushed) if one.per_run)
    for index, stretch in enumerate(pushed.course.stretches):
        terms = bend.make(stretch, response.moves[index], _per_angle(pushed, stretch))
        made, place = response.local(index, terms), response.places[index]
        slow = made.T @ made, made.T @ fit.surprise[place], made.T @ slope[place]
        for told in (response.products(index, made), *response.sums(index, [terms, terms])):
            assert all(one == pytest.approx(other, rel=1e-9, abs=1e-6) for one, other in zip(told, slow, strict=True))
