"""The same question is not computed again: answers, pages and drives are the same, and any other question is new."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle
from planner.evaluation.work_order import WorkOrder
from planner.farm.machines import FarmTractor
from planner.farm.settings import FarmPrices
from planner.pipeline import planning
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.planning import PlanningResult, plan_order
from planner.pipeline.result_cache import NO_CACHE, ResultCache
from planner.request.plan_request import PlanRequest
from planner.risk.costs import CostTerms
from reports.plan.figures import format_ranking_csv, format_ranking_json
from reports.plan.ranking_page import render_plan_page
from vehicle.missions.plan_file import format_plan
from vehicle.model.tractor import Implement

pytestmark = pytest.mark.usefixtures("first_layout")

POND = Obstacle("pond", shapely.box(34, 18, 40, 24), 0.0, "pond")
FIELD = Field("bay", shapely.box(0, 0, 72, 45), obstacles=(POND,), entrance=(30.0, 0.0))
STRATEGIES = ("split-field", "interleaved", "row-by-row")  # two that are driven, and one that comes too near
REQUEST = PlanRequest(
    field="bay", width_m=6.0, tractors=(1, 2), strategies=STRATEGIES, operation="sow", start_s=36000, deadline_s=43200
)
ORDER = WorkOrder(REQUEST, FIELD)
PRICES, HIRE = FarmPrices(tractor_price=90_000.0, fuel_per_l=1.5), FarmPrices(per_hour=30.0, late_per_ha=40.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("plans")


@pytest.fixture(scope="module")
def first(folder: Path, first_layout: None) -> PlanningResult:
    """The answer to the question, which is in the folder from then on."""
    return answer(ResultCache(folder), with_pictures=True)


@pytest.fixture
def cache(folder: Path, first: PlanningResult, tmp_path: Path) -> ResultCache:
    """A cache that holds the answer to the question."""
    return ResultCache(shutil.copytree(folder, tmp_path / "plans"))


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The number of candidates of every plan that is computed."""
    counts, iterate = list[int](), planning.iter_outcomes

    def count(executor: Any, packed: bytes, candidates: Any, *more: Any, **options: Any) -> Any:
        counts.append(len(candidates))
        return iterate(executor, packed, candidates, *more, **options)

    monkeypatch.setattr(planning, "iter_outcomes", count)
    return counts


class ComputedError(Exception):
    """A plan is about to be computed."""


def answer(cache: ResultCache, order: WorkOrder = ORDER, **options: Any) -> PlanningResult:
    return plan_order(order, executor=SerialExecutor(), cache=cache, **options)


def write(result: PlanningResult) -> tuple[str, str, str]:
    """Table, JSON and page of an answer."""
    best, ranking = result.ranking.best, result.ranking
    assert best is not None
    drive = result.pictures[best.strategy, best.tractors]
    page = render_plan_page(ranking, drive, result.pictures, None)
    return format_ranking_csv(ranking), format_ranking_json(ranking), page


def test_the_same_question_has_the_same_answer_and_is_not_computed(
    cache: ResultCache, first: PlanningResult, computed: list[int]
) -> None:
    second = answer(cache, with_pictures=True)
    assert not computed
    assert write(second) == write(first)
    assert first.run is not None and second.run is not None
    assert np.array_equal(second.run.record, first.run.record, equal_nan=True)
    assert {key: format_plan(one) for key, one in second.plans.items()} == {
        key: format_plan(one) for key, one in first.plans.items()
    }


@pytest.mark.parametrize(
    "order",
    [
        replace(ORDER, request=replace(REQUEST, seed=3)),
        replace(ORDER, cost_terms=CostTerms(PRICES, FarmTractor(name="t"))),  # a slower plan may be cheaper
        replace(ORDER, field=replace(FIELD, obstacles=())),
        replace(ORDER, implement=Implement(hitch_m=2.0)),
        replace(ORDER, simulates_all=True),
    ],
)
def test_another_question_is_computed(cache: ResultCache, monkeypatch: pytest.MonkeyPatch, order: WorkOrder) -> None:
    monkeypatch.setattr(planning, "iter_outcomes", Mock(side_effect=ComputedError))
    with pytest.raises(ComputedError):
        answer(cache, order)


@pytest.mark.parametrize(
    "order",
    [
        replace(
            ORDER,
            request=replace(
                REQUEST,
                start_s=32400,
                deadline_s=43260,
                price_per_hour=70.0,
                price_per_tractor=9.0,
                rain="13:00",
                samples=500,
                budget=80.0,
                objective="fastest",
            ),
        ),
        replace(ORDER, cost_terms=CostTerms(HIRE, FarmTractor(name="t"))),
    ],
)
def test_what_a_drive_is_worth_is_told_without_planning_it_anew(
    cache: ResultCache, computed: list[int], order: WorkOrder
) -> None:
    found, again = (write(answer(cache, order, with_pictures=True)) for _ in range(2))
    assert not computed
    assert found == again == write(answer(NO_CACHE, order, with_pictures=True))


def test_only_other_numbers_of_tractors_are_computed(cache: ResultCache, computed: list[int]) -> None:
    order = replace(ORDER, request=replace(REQUEST, tractors=(1, 3), price_per_hour=70.0))
    found = answer(cache, order)
    assert computed == [len(STRATEGIES)] and found.run is not None
    assert write(found) == write(answer(NO_CACHE, order))


def test_what_was_driven_and_failed_is_driven_again_too(
    tmp_path: Path, computed: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def find_fault(context: Any, run: Any, places: Any) -> str | None:
        return "the second one sinks" if run.plan.tractors == 2 else None

    monkeypatch.setattr("planner.evaluation.candidates.evaluate._find_fault", find_fault)
    cache, request = ResultCache(tmp_path), replace(REQUEST, strategies=("split-field",))
    order, dear = (replace(ORDER, request=one) for one in (request, replace(request, price_per_hour=70.0)))
    first = write(answer(cache, order))
    assert write(answer(cache, order, with_pictures=True))[:2] == first[:2]
    found = answer(cache, dear, with_pictures=True)
    assert len(computed) == 1 and any(two == 2 for _, two in found.pictures)
    assert write(found) == write(answer(NO_CACHE, dear, with_pictures=True))


def test_a_damaged_answer_is_computed_again(cache: ResultCache, first: PlanningResult, computed: list[int]) -> None:
    for path in cache.folder.iterdir():
        path.write_text(path.read_text().replace("time_s", "time_t"))
    assert format_ranking_json(answer(cache).ranking) == format_ranking_json(first.ranking)
    assert len(computed) == 1
