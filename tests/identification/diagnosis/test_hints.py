"""Hints say where to look; drives without anything wrong give none."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.identification.diagnosis.problems import build_problem
from vehicle.identification.diagnosis.grammar import CONSTANT, Coordinate, Hypothesis, build_scope, list_nuisances
from vehicle.identification.diagnosis.hints import (
    CHANGES,
    QUANTITY_WORDS,
    WHERE_WORDS,
    Unexplained,
    compare_thirds,
    compute_rank_sigmas,
    find_hints,
    list_law_hints,
    list_loud,
    list_quantities,
)
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.search import Judgement, PredictiveComparison
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.model.effects import PATH

RNG = np.random.default_rng(5)
BLOCKS = 60
NOTHING = Unexplained(0.0, ())
clean = lru_cache(maxsize=1)(lambda: build_problem(seed=1))


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


def test_a_clean_drive_gives_no_hint_and_the_noise_is_kept() -> None:
    problem = clean()
    fit = fit_base(problem)
    noise, bases = problem.get_noise(), dict(problem.bases.arrays)
    assert find_hints(problem, fit, (), NOTHING) == ()
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
    hint = find_hints(problem, fit_base(problem), (), NOTHING)[0]
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


def make_ratios(**of: float) -> dict[str, Array]:
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
