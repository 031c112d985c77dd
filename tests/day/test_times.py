"""Field times: refills count in them, and they are planned with as surely as is asked for."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from fields import read_field, write_field
from fields.geometry.field import Field
from planner.day.field_times import ALL_DONE, FieldTime, compute_field_time, hash_field_time_order
from planner.day.formulation import PLANNING_SAMPLES, build_day_hours, build_problem, estimate_mean_time_and_cost
from planner.day.input_file import DayFile, load_day, parse_day
from planner.day.optimization.solver import solve_day
from planner.day.planning import prepare_day
from planner.errors import RequestError
from planner.evaluation.work_order import WorkOrder
from planner.farm.inventory import FarmFile
from planner.farm.random_inputs import UncertaintySettings, build_certain_settings
from planner.request.plan_request import PlanRequest
from planner.risk.costs import build_hire_terms
from planner.risk.monte_carlo import sample_outcomes
from strategies.rules.supply import Supply
from tests.day.test_odds import one_leg
from vehicle.model.tractor import Implement, load_tractor

FIELD = 'file = "iwamizawa"'
TEXT = """
start = "08:00"
strategies = ["split-field"]
[[fields]]
file = "iwamizawa"
[[fleets]]
name = "one"
"""


@pytest.mark.slow
def test_refills_count_in_the_time_of_a_field() -> None:
    field = Field("one", shapely.box(0, 0, 30, 70))
    asked = PlanRequest(field="one", tractors=(1,), strategies=("split-field",), no_headland=True, width_m=6.0)
    dry = WorkOrder(asked, field, load_tractor("eg105"), Implement())
    tank = replace(dry, supply=Supply(capacity=900.0, rate_per_m2=1.0, stop_s=100.0))
    plain, carrying = compute_field_time(dry), compute_field_time(tank)
    assert plain.refills is None and carrying.refills is not None and carrying.refills >= 1
    assert carrying.graph is not None and plain.graph is not None
    stops = carrying.refills
    assert float(carrying.graph.stand_s.sum()) == pytest.approx(100.0 * stops, abs=1.0)
    assert carrying.time_s >= plain.time_s + 100.0 * stops - 1.0
    sample = sample_outcomes(carrying.graph, build_certain_settings(), samples=1, seed=1)
    assert float(sample.finish_s[0]) == pytest.approx(carrying.time_s, rel=0.01)
    less = replace(tank, supply=Supply(capacity=800.0, rate_per_m2=1.0, stop_s=100.0))
    assert len({hash_field_time_order(order) for order in (dry, tank, less)}) == 3


def test_tanks_are_made_good_between_fields_and_not_before_the_first_or_after_the_last() -> None:
    """Two fields 2.5 km from the yard and 5 km apart at 25 km/h: 360 and 720 s, 120 s each to fold and to unfold."""
    two = TEXT.replace("[[fleets]]", '[[fields]]\nfile = "netherlands"\n[[fleets]]').replace(
        'name = "one"', 'name = "tanks"\nimplement = "tanker"\n[[fleets]]\nname = "dry"\nimplement = "harrow"'
    )
    farm = FarmFile.model_validate({
        "tractors": [{"name": "t", "count": 2}],
        "implements": [
            {"name": "tanker", "width_m": 6.0, "capacity": 900.0, "rate_per_m2": 1.0},
            {"name": "harrow", "width_m": 6.0},
        ],
        "times": {"refill_s": 300.0},
    })  # fmt: skip
    day = DayFile.model_validate(tomllib.loads(two))
    fields, found = (read_field("iwamizawa"), read_field("netherlands")), FieldTime("s", 1, 50.0, graph=one_leg(50.0))
    km = np.array([[0.0, 5.0, 2.5], [5.0, 0.0, 2.5], [2.5, 2.5, 0.0]])
    problem = build_problem(day, farm, fields, km, ((found,) * 2,) * 2, build_day_hours(day, farm), 1)
    assert problem.travel_s[1] == ((0, 960, 480), (960, 0, 480), (480, 480, 0))
    assert problem.travel_s[0] == ((0, 1260, 480), (1260, 0, 480), (480, 480, 0))
    tanks, dry = (np.array(problem.travel_cost[fleet]) for fleet in (0, 1))
    assert (tanks - dry > 0.0).tolist() == [[False, True, False], [True, False, False], [False, False, False]]
    first, second = problem.schedule_starts(0, (0, 1)) or (0, 0)
    assert (first, second - first - (problem.work_s[0][0] or 0)) == (8 * 3600 + 480, 1260)


def test_loss_counts_what_is_left_of_a_field() -> None:
    day, farm = parse_day(TEXT.replace(FIELD, f"{FIELD}\nloss_per_ha = 300.0"), "day.toml")
    fields, graph = (read_field("iwamizawa"),), one_leg(50.0)

    def lose(left_ha: float | None) -> float:
        table = ((FieldTime("s", 1, 50.0, graph=graph, left_ha=left_ha),),)
        return build_problem(day, farm, fields, np.zeros((2, 2)), table, build_day_hours(day, farm), 1).value_at_risk[0]

    assert lose(None) == pytest.approx(300.0 * fields[0].area_ha)
    assert lose(0.5) == pytest.approx(150.0) and lose(0.0) == 0.0


@pytest.mark.slow
def test_faults_of_done_work_are_faults_of_the_day_file(tmp_path: Path) -> None:
    def order(done: str) -> WorkOrder:
        text = TEXT.replace(FIELD, f'{FIELD}\ndone = ["{done}"]')
        (tmp_path / "day.toml").write_text(text, encoding="utf-8")
        one = prepare_day(*load_day(str(tmp_path / "day.toml"))).orders[0][0]
        assert one is not None
        return one

    with pytest.raises(RequestError, match=r"missing\.gpkg'; done in the day file takes a file"):
        order("missing.gpkg")
    x_m, y_m = shapely.get_coordinates(shapely.box(*read_field("iwamizawa").boundary.buffer(1.0).bounds)).T
    for shift_m, name in ((0.0, "all.geojson"), (5000.0, "away.geojson")):
        ring = np.column_stack([x_m + shift_m, y_m]).tolist()
        content = {"type": "Polygon", "coordinates": [ring]}
        (tmp_path / name).write_text(json.dumps(content), encoding="utf-8")
    found = compute_field_time(order("all.geojson"))
    assert found.reason == ALL_DONE and found.left_ha == 0.0
    with pytest.raises(RequestError, match="Nothing of what is given as done lies in field"):
        compute_field_time(order("away.geojson"))


class TestCertainty:
    uncertainty = UncertaintySettings(**{**vars(build_certain_settings()), "job_cv": 0.3})
    found = FieldTime("split-field", 1, 3600.0, graph=one_leg(3600.0))

    def test_so_many_of_the_draws_keep_the_planned_time(self) -> None:
        sample = sample_outcomes(self.found.graph, self.uncertainty, samples=PLANNING_SAMPLES, seed=5)
        for asked in (50.0, 80.0, 95.0):
            seconds, paid = estimate_mean_time_and_cost(
                self.found, build_hire_terms(36.0, 0.0), self.uncertainty, 5, asked
            ) or (0, 0.0)
            assert float((sample.finish_s <= seconds).mean()) == pytest.approx(0.01 * asked, abs=2.0 / PLANNING_SAMPLES)
            assert (
                paid
                == (
                    estimate_mean_time_and_cost(self.found, build_hire_terms(36.0, 0.0), self.uncertainty, 5)
                    or (0, 1.0)
                )[1]
            ), "the mean price"

    def problem(self, text: str):
        day, farm = parse_day(text, "day.toml")
        fields = (read_field("iwamizawa"),)
        table = ((self.found,),)
        return build_problem(day, farm, fields, np.zeros((2, 2)), table, build_day_hours(day, farm), 1)

    def test_a_window_that_holds_the_mean_time_only_is_not_planned_for_with_certainty(self) -> None:
        mean = self.problem(TEXT).work_s[0][0]
        assert mean is not None
        closes = 8 * 3600 + 120 + mean + 60  # after unfolding
        window = f"08:00-{closes // 3600:02d}:{closes // 60 % 60:02d}"
        narrow = TEXT.replace('file = "iwamizawa"', f'file = "iwamizawa"\nwindows = ["{window}"]\nloss_per_ha = 1e6')
        assert solve_day(self.problem(narrow)).routes == ((0,),)
        sure = self.problem(f"certainty_pct = 80\n{narrow}")
        assert solve_day(sure).routes == ((),)
        assert sure.begin_s > 8 * 3600 and (sure.work_s[0][0] or 0) > mean

    def test_the_file_and_the_option(self) -> None:
        day, _ = parse_day(TEXT, "day.toml", certainty_pct=90.0)
        assert isinstance(day, DayFile) and day.certainty_pct == 90.0


def test_a_field_of_the_day_names_its_heights(tmp_path: Path) -> None:
    write_field(Field("plot", shapely.box(0, 0, 60, 40)), tmp_path / "plot.geojson")
    text = """
        start = "08:00"
        [[fields]]
        file = "plot.geojson"
        lon = 9.9
        lat = 56.9
        elevation = "dtm.asc"
        elevation_crs = "EPSG:25832"
        [[fleets]]
        name = "one"
    """
    day, farm = parse_day(text, "day", tmp_path)
    with pytest.raises(RequestError, match=r"'plot' of the day names the heights .*dtm\.asc', and there is no such"):
        prepare_day(day, farm)
    (tmp_path / "dtm.asc").write_text("ncols", encoding="ascii")
    prepared = prepare_day(day, farm)
    assert prepared.fields[0].elevation == str(tmp_path / "dtm.asc")
    ((task,),) = prepared.orders
    assert task is not None and task.request.elevation_crs == "EPSG:25832"
    refused = compute_field_time(task)
    assert "does not begin like an ASCII grid" in refused.reason and not refused.is_lasting
