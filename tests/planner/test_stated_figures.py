"""Headline, table, JSON, page, saved plan and day state the same time and cost, over random scenarios."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
from planner.day.planning import plan_day
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.outputs.saved_plans import read_stated_figures, write_saved_plan
from planner.pipeline.planning import PlanningResult, plan
from planner.request.plan_request import PlanRequest
from reports.common.wording import format_price
from reports.day.tables import build_day_screen
from reports.plan.figures import format_ranking_json
from reports.plan.other_plans import format_stated_end
from reports.plan.ranking_page import render_plan_page
from reports.plan.ranking_table import build_first_screen
from tests.drawn_fields import rectangle
from tests.examples import draw_seed
from tests.printing import print_text
from vehicle.missions.plan_file import parse_saved_plan

pytestmark = pytest.mark.usefixtures("first_layout")

EIGHT_S = 8 * 3600
SCENARIOS = [*range(4), *(pytest.param(number, marks=pytest.mark.matrix) for number in range(4, 20))]
SAMPLES = 400
DAY = """
farm = "example"
start = "08:00"
rain = "{rain}"
strategies = ["split-field"]
[[fields]]
name = "near"
file = "small.geojson"
local = true
value_per_ha = 900.0
[[fields]]
name = "far"
file = "small.geojson"
local = true
value_per_ha = 900.0
[[fleets]]
name = "robots"
tractor = "EG105"
count = 1
implement = "cultivator"
[[roads]]
between = ["near", "far"]
km = 1.2
[[roads]]
between = ["yard", "near"]
km = 2.0
[[roads]]
between = ["yard", "far"]
km = 2.5
"""


def draw_request(random: np.random.Generator) -> tuple[PlanRequest, Field]:
    """A small field with one or two tractors, and at random a start, a deadline, rain, an objective or samples."""
    width_m, length_m = random.uniform(30.0, 45.0), random.uniform(60.0, 90.0)
    values: dict[str, Any] = {}
    if random.random() < 0.8:
        values["start_s"] = EIGHT_S
        if random.random() < 0.6:
            values["deadline_s"] = EIGHT_S + 60 * int(random.integers(5, 50))
        if random.random() < 0.4:
            values["rain"] = "08:10=30,08:25=40"
    if random.random() < 0.3:
        values["objective"] = ["fastest", "surest", "cheapest"][int(random.integers(3))]
    if random.random() < 0.8:
        values["samples"] = SAMPLES
    request = PlanRequest(
        field="plot", strategies=("split-field",), tractors=(1, 2), no_headland=bool(random.random() < 0.8), **values
    )
    return request, Field("plot", shapely.box(0, 0, width_m, length_m))


def check_outputs(result: PlanningResult) -> None:
    """Every output states the time and the cost of the best plan as it is ranked."""
    ranking = result.ranking
    best = ranking.best
    time, cost = format_stated_end(ranking, best.stated_end_s), format_price(best.stated_cost)
    screen = print_text(build_first_screen(ranking))
    text = " ".join(screen.split())
    assert re.search(rf"done (in )?{time}[, ]", text) and f", {cost} EUR (assumed prices)" in text
    (row,) = [line.split() for line in screen.splitlines() if line.lstrip().startswith(">") and ";" not in line]
    assert row[1] == "split-field" and time in row and cost in row
    told = json.loads(format_ranking_json(ranking))["best"]
    assert (told["stated_end_s"], told["stated_cost"]) == pytest.approx((best.stated_end_s, best.stated_cost))
    page = render_plan_page(ranking, None)
    assert f"<dd>{time}</dd>" in page and f"<dd>{cost} EUR (assumed prices)</dd>" in page
    stated = read_stated_figures(parse_saved_plan(write_saved_plan(result.context, result.run.plan, ranking)))
    assert (stated.end_s, stated.cost) == (best.stated_end_s, best.stated_cost)


@pytest.fixture(scope="module")
def drawn_seed() -> int:
    return draw_seed()


@pytest.mark.slow
@pytest.mark.parametrize("number", SCENARIOS)
def test_every_output_states_the_same(number: int, drawn_seed: int) -> None:
    request, field = draw_request(np.random.default_rng([drawn_seed, number]))
    result = plan(request, field=field, executor=SerialExecutor())
    check_outputs(result)
    for one in result.ranking.plans:
        if one.p50_done_s is not None and one.meets_deadline is not None and request.rain is None:
            assert one.meets_deadline == (one.p50_done_s <= (request.time_limit_s or 0.0))
            assert one.meets_deadline == (one.finish_probability >= 0.5) or abs(one.finish_probability - 0.5) < 0.01


def test_a_plan_is_in_time_if_half_of_its_samples_are() -> None:
    """A deadline a second after the median is met as stated, one a second before it is missed by that second."""
    field = Field("plot", shapely.box(0, 0, 30, 60))
    values: dict[str, Any] = {
        "field": "plot", "strategies": ("split-field",), "tractors": (1,), "no_headland": True, "start_s": EIGHT_S,
        "samples": 2000,
    }  # fmt: skip
    median_s = plan(PlanRequest(**values), field=field, executor=SerialExecutor()).ranking.plans[0].p50_done_s
    for minutes, met in ((int(median_s // 60) + 1, True), (int(median_s // 60), False)):
        result = plan(PlanRequest(**values, deadline_s=EIGHT_S + 60 * minutes), field=field, executor=SerialExecutor())
        (one,) = result.ranking.plans
        assert one.meets_deadline is met and (one.finish_probability or 0.0) > 0.3
        missed_by_s = result.ranking.missed_by_s
        assert missed_by_s is None if met else missed_by_s == pytest.approx(median_s - 60 * minutes, abs=1.0)
        check_outputs(result)


@pytest.mark.slow
@pytest.mark.parametrize("rain", ["08:30=40,09:00=40", "09:10=60"])
def test_a_day_is_done_when_its_last_field_is(rain: str, tmp_path: Path) -> None:
    (tmp_path / "small.geojson").write_text(json.dumps(rectangle(0, 0, 40, 90)), encoding="utf-8")
    (tmp_path / "day.toml").write_text(DAY.format(rain=rain), encoding="utf-8")
    day = plan_day(tmp_path / "day.toml", samples=SAMPLES)
    last_s = max(job.p50_end_s for job in day.jobs)
    assert last_s == pytest.approx(day.p50_done_s), "one fleet: the day ends with its last field"
    assert day.p95_done_s == pytest.approx(max(job.p95_end_s for job in day.jobs))
    first, second = sorted(day.jobs, key=lambda job: job.p50_end_s)
    assert second.p50_start_s >= first.p50_end_s
    lines = print_text(build_day_screen(day)).splitlines()
    ends = re.findall(r"\d\d:\d\d", lines[0])
    rows = [line.split() for line in lines if line.startswith("robots ")]
    assert rows[-1][1] == second.field and rows[-1][3] == ends[0]
