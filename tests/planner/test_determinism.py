"""Same question, same bytes: whatever the executor, the order of words, or the time of day."""

import json
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planner import HeadlandError, LocalPool, PlanningResult, PlanRequest, SerialExecutor, plan
from planner.request.option_texts import parse_counts
from reports.common.plan_results import PlanRanking
from reports.plan.figures import format_ranking_csv, format_ranking_json
from tests.drawn_fields import rectangle, ring
from tests.examples import seldom
from tests.planner.shapes import STAR, Corners
from vehicle.model.tractor import load_tractor

pytestmark = pytest.mark.usefixtures("first_layout")

SELDOM = ("spawned", "more workers than cores")
"""Processes as those of the default, in the matrix alone."""


def spawned() -> Executor:
    """Two clean processes of the standard library."""
    return ProcessPoolExecutor(2, multiprocessing.get_context("spawn"))


EXECUTORS: dict[str, Callable[[], Executor] | None] = {
    "the default": None,
    "threads": lambda: ThreadPoolExecutor(3),
    "spawned": spawned,
    "more workers than cores": lambda: LocalPool(3),
}


def serial(scenario: PlanRequest) -> PlanRanking:
    return plan(scenario, executor=SerialExecutor()).ranking


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> PlanRequest:
    place = tmp_path_factory.mktemp("field") / "small.geojson"
    place.write_text(json.dumps(rectangle(0, 0, 45, 60)))
    names = ("split-field", "interleaved", "row-by-row-optimised")  # one of each kind
    return PlanRequest(str(place), local=True, tractors=(1, 2), strategies=names, seed=7)


@pytest.fixture(scope="module")
def answer(scenario: PlanRequest) -> PlanningResult:
    """In this process."""
    return plan(scenario, executor=SerialExecutor())


@pytest.fixture(scope="module")
def first(answer: PlanningResult) -> str:
    return format_ranking_json(answer.ranking)


@pytest.fixture(scope="module")
def few(scenario: PlanRequest) -> PlanRequest:
    """A question with three candidates, for what has nothing to do with how many there are."""
    return replace(scenario, strategies=("split-field", "interleaved"))


@pytest.fixture(scope="module")
def few_first(few: PlanRequest) -> str:
    return format_ranking_json(serial(few))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.matrix if name in SELDOM else ()) for name in EXECUTORS]
)
def test_same_bytes_from_any_executor(scenario: PlanRequest, answer: PlanningResult, first: str, name: str) -> None:
    make = EXECUTORS[name]
    with make() if make else nullcontext() as executor:
        other = plan(scenario, executor=executor)
    assert format_ranking_json(other.ranking) == first
    assert other.run.record.tobytes() == answer.run.record.tobytes()


@pytest.mark.slow
def test_same_bytes_for_another_order_of_counts_and_names(scenario: PlanRequest, first: str) -> None:
    swapped = replace(scenario, tractors=parse_counts("2,1-2"), strategies=scenario.strategies[::-1])
    assert swapped.tractors == scenario.tractors
    assert format_ranking_json(serial(swapped)) == first


@pytest.mark.slow
def test_objects_and_names_are_the_same_question(scenario: PlanRequest) -> None:
    from fields import read_field

    only = replace(scenario, tractors=(1,), strategies=("split-field",))
    field, tractor = read_field(only.field, local=True), load_tractor("eg105")
    nameless = replace(only, field="no such file", tractor="no such tractor")
    answer = plan(nameless, field=field, tractor=tractor, executor=SerialExecutor())
    assert (answer.context.request.field, answer.context.request.tractor) == (field.name, tractor.name)
    named = plan(nameless, field=only.field, tractor="eg105", executor=SerialExecutor())
    told = {format_ranking_json(one) for one in (answer.ranking, named.ranking, serial(only))}
    assert len(told) == 1


def test_an_object_that_cannot_be_is_refused_like_its_file(scenario: PlanRequest) -> None:
    broken = load_tractor("eg105").model_copy(update={"mass_kg": -1.0})
    with pytest.raises(HeadlandError, match="mass_kg"):
        plan(scenario, tractor=broken, executor=SerialExecutor())


@pytest.mark.slow
def test_the_run_is_that_of_the_best_plan_and_every_driven_plan_has_its_picture(
    scenario: PlanRequest, answer: PlanningResult
) -> None:
    best = answer.ranking.best
    assert answer.run.duration_s == best.time_s and answer.run.plan.tractors == best.tractors
    assert list(answer.pictures) == [(best.strategy, best.tractors)]
    every = plan(scenario, executor=SerialExecutor(), with_pictures=True)
    assert every.ranking == answer.ranking
    assert set(every.pictures) == {(p.strategy, p.tractors) for p in every.ranking.plans if p.time_s is not None}
    for result in every.ranking.plans:
        if result.time_s is not None:
            drive = every.pictures[result.strategy, result.tractors]
            assert max(drive.finish_s) == result.time_s and len(drive.xy) == result.tractors
    ours, theirs = (one.pictures[best.strategy, best.tractors] for one in (answer, every))
    assert all(np.array_equal(a, b) for a, b in zip(ours.xy, theirs.xy, strict=True))


@pytest.mark.slow
def test_a_plan_does_not_depend_on_what_else_is_asked_for(scenario: PlanRequest) -> None:
    def alone(count: int, name: str) -> Any:
        only = replace(scenario, tractors=(count,), strategies=(name,))
        (result,) = serial(only).plans
        return replace(result, rank=None, on_pareto_front=False)

    every = plan(scenario, executor=SerialExecutor(), simulate_all=True).ranking.plans
    for count, name in ((1, "row-by-row-optimised"), (2, "row-by-row-optimised"), (2, "interleaved")):
        (among,) = [p for p in every if (p.tractors, p.strategy) == (count, name)]
        assert replace(among, rank=None, on_pareto_front=False) == alone(count, name)


@pytest.mark.matrix
def test_the_seed_is_echoed_and_changes_nothing_else(few: PlanRequest, few_first: str) -> None:
    import json

    other = json.loads(format_ranking_json(serial(replace(few, seed=8))))
    before = json.loads(few_first)
    assert (before.pop("seed"), other.pop("seed")) == (7, 8)
    assert (before["scenario"].pop("seed"), other["scenario"].pop("seed")) == (7, 8)
    assert before == other


@pytest.mark.matrix
def test_progress_counts_up_to_all(few: PlanRequest) -> None:
    seen: list[tuple[int, int]] = []
    ranking = plan(few, executor=SerialExecutor(), progress=lambda done, total: seen.append((done, total))).ranking
    assert seen == [(1, 3), (2, 3), (3, 3)], "one tractor is tried once"
    assert len(format_ranking_csv(ranking).splitlines()) == 4


SKEW = [(0.0, 0.0), (83.0, 9.0), (95.0, 61.0), (22.0, 78.0), (0.0, 0.0)]


@pytest.mark.slow
@pytest.mark.parametrize("outline", [STAR, *seldom(SKEW)], ids=["star", "skew"])
def test_another_processor_gives_the_same_plan(outline: Corners, tmp_path: Path) -> None:
    """Libraries choose other code on other processors, which may add in another order or round the other way; where
    they cannot be told to, the two are the same in any case."""
    (tmp_path / "drawn.geojson").write_text(json.dumps(ring(*outline[:-1])))
    older = {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"}
    command = (sys.executable, "-m", "planner.cli.main", "plan", "drawn.geojson", "--local", "--tractors", "2")
    plans = []
    for name, more in (("here", {}), ("older", older)):
        subprocess.run(
            (*command, "--save", f"{name}.json"), cwd=tmp_path, env=os.environ | more, check=True, capture_output=True
        )
        plans.append((tmp_path / f"{name}.json").read_bytes())
    assert plans[0] == plans[1]
