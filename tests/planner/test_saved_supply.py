"""What machines of a plan are and carry is saved with it, and goes on with it."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planner.errors import HeadlandError
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.farm_inputs import GivenOptions
from planner.pipeline.going_on import continue_order, read_continued_order
from planner.pipeline.outputs.saved_plans import MACHINES_KEY, read_machines, read_supply, simulate_saved_plan
from planner.pipeline.planning import PlanningResult, plan
from planner.request.plan_request import PlanRequest
from strategies.rules.supply import Supply
from tests.drawn_fields import feature, rectangle, write_features
from vehicle.missions.plan import REFILL
from vehicle.missions.plan_file import parse_saved_plan
from vehicle.model.tractor import Implement, load_tractor

pytestmark = pytest.mark.usefixtures("first_layout")

CARRIED = Supply(200.0, 0.1, 40.0)  # lasts for 500 m of track


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("supply")


@pytest.fixture(scope="module")
def whole(folder: Path) -> PlanningResult:
    """A plan of one tractor with a tank, saved as plan.json."""
    field = write_features(folder / "field.geojson", feature(rectangle(0, 0, 90, 60)))
    request = PlanRequest(field=str(field), local=True, width_m=4.0, tractors=(1,), strategies=("split-field",))
    answer = plan(request, supply=CARRIED, executor=SerialExecutor())
    answer.save(folder / "plan.json")
    return answer


def change_plan(folder: Path, change: Callable[[dict[str, Any]], Any]) -> str:
    """The plan with changed machines, left after five minutes."""
    saved = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    change(saved["scenario"][MACHINES_KEY])
    (folder / "changed.json").write_text(json.dumps(saved), encoding="utf-8")
    return f"{folder}/changed.json@0:05"


def count_refills(answer: PlanningResult) -> int:
    return sum(leg.task.kind == REFILL or leg.stand_s > 0.0 for m in answer.run.plan.missions for leg in m.legs)


@pytest.mark.slow
def test_a_plan_with_a_tank_goes_on_with_what_is_left_in_it_and_says_so_again(
    folder: Path, whole: PlanningResult
) -> None:
    source = f"{folder}/plan.json@0:12"
    answer = plan(whole.context.request, done=source, executor=SerialExecutor())
    assert answer.context.supply == CARRIED
    (stand,) = answer.context.going_on.stands
    assert 0.0 < stand.used <= CARRIED.capacity
    assert 0 < count_refills(answer) < count_refills(whole)
    answer.save(folder / "again.json")
    assert read_supply(parse_saved_plan((folder / "again.json").read_text(encoding="utf-8"))) == CARRIED
    last = plan(whole.context.request, done=f"{folder}/again.json@0:00:05", executor=SerialExecutor())
    assert last.context.going_on.stands[0].used == pytest.approx(stand.used, abs=10.0), "of the first load still"
    given = GivenOptions({"field": whole.context.request.field, "local": True}, ["local"], (source,))
    assert given.build_order(given.build_request()).supply == CARRIED


@pytest.mark.slow
def test_a_plan_of_an_earlier_headland_that_does_not_say_how_large_its_tank_is_asks_for_it(
    folder: Path, whole: PlanningResult
) -> None:
    def say_it_in_words(machines: dict[str, Any]) -> None:
        del machines["supply"]
        machines["load"] = "a load of 200"

    source = change_plan(folder, say_it_in_words)
    with pytest.raises(HeadlandError, match=r"has a tank, and the plan does not say how large; add farm"):
        plan(whole.context.request, done=source, executor=SerialExecutor())
    assert read_continued_order([source]).supply is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong",
    [
        {"capacity": -1.0},
        {"rate_per_m2": 0.0},
        {"stop_s": float("nan")},
        {"served_at": "the moon"},
        {"place": [1.0]},
        {"place": {"x": 1.0}},
        {"colour": "red"},
    ],
)
def test_a_garbled_supply_is_told(folder: Path, whole: PlanningResult, wrong: dict[str, Any]) -> None:
    source = change_plan(folder, lambda machines: machines["supply"].update(wrong))
    with pytest.raises(HeadlandError, match="supply in the scenario of the plan is garbled; save the plan again"):
        read_continued_order([source])


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [[-1.0], ["much"], 3])
def test_a_garbled_use_is_told(folder: Path, whole: PlanningResult, wrong: Any) -> None:
    source = change_plan(folder, lambda machines: machines.update(used=wrong))
    with pytest.raises(HeadlandError, match="machines in the scenario of the plan are garbled; save the plan again"):
        plan(whole.context.request, done=source, executor=SerialExecutor())


@pytest.mark.slow
def test_the_place_of_a_supply_is_read_as_it_was_saved(folder: Path, whole: PlanningResult) -> None:
    change_plan(folder, lambda machines: machines["supply"].update(served_at="place", place=[3, 4.5], collects=True))
    supply = read_supply(parse_saved_plan((folder / "changed.json").read_text(encoding="utf-8")))
    assert supply == Supply(200.0, 0.1, 40.0, True, "place", (3.0, 4.5))


@pytest.mark.slow
@pytest.mark.parametrize("told_by", ["request", "soil", "tractor", "implement"])
def test_a_saved_plan_is_driven_again_by_the_machines_that_drove_it(
    folder: Path, whole: PlanningResult, told_by: str
) -> None:
    """Those of Python, and what a soil does to a tractor, no name tells: they are saved value by value."""
    request, objects = replace(whole.context.request, refill=None), dict[str, Any]()
    if told_by == "soil":
        (folder / "soils.csv").write_text("name,ground,moisture_pct,wheel_slip\nnorth,soil,20,0.2\n", encoding="utf-8")
        request = replace(request, soil=f"{folder}/soils.csv#north", moisture_pct=20.0)
    elif told_by == "tractor":
        objects = {"tractor": load_tractor("eg105").model_copy(update={"name": "mine"})}
    elif told_by == "implement":
        objects = {"implement": Implement(hitch_m=3.0, length_m=2.0)}
    answer = plan(request, executor=SerialExecutor(), **objects)
    again = simulate_saved_plan(answer.save(folder / "machines.json"))
    assert np.array_equal(again.run.record, answer.run.record)
    assert read_machines(again.saved, again.request) == (answer.context.tractor, answer.context.implement)
    assert (MACHINES_KEY in again.saved.scenario) == (told_by != "request")


@pytest.mark.slow
def test_going_on_with_another_soil_keeps_nothing_of_the_first(folder: Path, whole: PlanningResult) -> None:
    lines = ["name,ground,moisture_pct,wheel_slip,side_slip", "north,soil,20,0.2,", "south,soil,20,,0.1"]
    (folder / "two.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    north = replace(whole.context.request, refill=None, soil=f"{folder}/two.csv#north", moisture_pct=20.0)
    answer = plan(north, executor=SerialExecutor())
    answer.save(folder / "north.json")
    for soil in (north.soil, f"{folder}/two.csv#south", "loam"):
        request = replace(north, soil=soil)
        rest = continue_order(WorkOrder(request, done=(f"{folder}/north.json@0:01",)))
        assert prepare_context(rest).tractor == prepare_context(WorkOrder(request)).tractor, soil
        assert (prepare_context(rest).tractor == answer.context.tractor) == (soil == north.soil)
