"""Same question, same bytes: whatever the processes, the order of words, or the time of day."""

from dataclasses import replace
from typing import Any

import pytest
from planner.plan import plan

from planner.scenario import Scenario, parse_counts
from reports.export import ranking_csv, ranking_json


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    import json

    place = tmp_path_factory.mktemp("field") / "small.geojson"
    ring = [[0, 0], [60, 0], [60, 80], [0, 80], [0, 0]]
    place.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return Scenario(str(place), local=True, tractors=(1, 2, 3), seed=7)


@pytest.fixture(scope="module")
def first(scenario: Scenario) -> str:
    return ranking_json(plan(scenario, processes=1)[1])


@pytest.mark.parametrize("processes", [1, 2, 3])
def test_same_bytes_for_any_number_of_processes(scenario: Scenario, first: str, processes: int) -> None:
    assert ranking_json(plan(scenario, processes=processes)[1]) == first


def test_same_bytes_for_another_order_of_counts_and_names(scenario: Scenario, first: str) -> None:
    swapped = replace(scenario, tractors=parse_counts("3,1-2"), strategies=scenario.strategies[::-1])
    assert swapped.tractors == scenario.tractors
    assert ranking_json(plan(swapped, processes=2)[1]) == first


def test_a_plan_does_not_depend_on_what_else_is_asked_for(scenario: Scenario) -> None:
    def alone(count: int, name: str) -> Any:
        only = replace(scenario, tractors=(count,), strategies=(name,))
        (result,) = plan(only, processes=1)[1].plans
        return replace(result, rank=None, on_pareto_front=False)

    every = plan(scenario, processes=2)[1].plans
    for count, name in ((2, "interleaved"), (3, "row-by-row-optimised")):
        (among,) = [p for p in every if (p.tractors, p.strategy) == (count, name)]
        assert replace(among, rank=None, on_pareto_front=False) == alone(count, name)


def test_the_seed_is_echoed_and_changes_nothing_else(scenario: Scenario, first: str) -> None:
    import json

    other = json.loads(ranking_json(plan(replace(scenario, seed=8), processes=2)[1]))
    before = json.loads(first)
    assert (before.pop("seed"), other.pop("seed")) == (7, 8)
    assert before == other


def test_progress_counts_up_to_all(scenario: Scenario) -> None:
    seen: list[tuple[int, int]] = []
    small = replace(scenario, tractors=(1, 2), strategies=("split-field", "interleaved"))
    ranking = plan(small, processes=2, progress=lambda done, total: seen.append((done, total)))[1]
    assert seen == [(n, 4) for n in range(1, 5)]
    assert len(ranking_csv(ranking).splitlines()) == 5
