"""What logs taught of a soil becomes a line of a table, and a plan drives with it."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planner.errors import HeadlandError, RequestError
from planner.evaluation.field_physics import FieldPhysics, adapt_to_ground
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.soil_rows import SoilLine, build_soil_row, format_soil_table, parse_soil_line
from planner.request.plan_request import PlanRequest
from tests.reports.test_diagnosis import diagnosis, in_model
from vehicle.errors import VehicleError
from vehicle.identification.diagnosis.results import LIKELY, NAMED, ParameterLaw
from vehicle.model.effect_kinds import PER_SLOPE
from vehicle.model.soil import find_soil
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import EffectSetting, load_tractor

pytestmark = pytest.mark.usefixtures("first_layout")

SLIP, GRIP = in_model("wheel_slip", NAMED, 0.06), in_model("side_slip", NAMED, 0.3)


def save(path: Path, moisture_pct: float, *found: Any) -> None:
    line = parse_soil_line(f"{path}#north", moisture_pct, "soil")
    path.write_text(format_soil_table(build_soil_row(diagnosis(*found), line), line.path), encoding="utf-8")


def test_a_line_has_what_is_named_of_the_soil_with_its_interval(tmp_path: Path) -> None:
    others = in_model("understeer", LIKELY, 2.0), in_model("steering_offset", NAMED, 1.25)
    save(tmp_path / "soils.csv", 22.0, SLIP, replace(GRIP, interval={"limit_g": (0.25, math.inf)}), *others)
    soil = find_soil("north", 22.0, tmp_path / "soils.csv")
    assert soil.effects == {
        "wheel_slip": EffectSetting(value={"ratio": 0.06}, interval={"ratio": (0.054, 0.066)}),
        "side_slip": EffectSetting(value={"limit_g": 0.3}),
    }
    assert soil.ground == "soil" and soil.rolling_share == 0.06
    assert soil.source == "diagnosis of 2 runs (2 min) of Yanmar EG105"


def test_other_lines_stay_and_moistures_between_are_interpolated(tmp_path: Path) -> None:
    path = tmp_path / "soils.csv"
    path.write_text('name,cone_index_kpa,source\nhill,900,"penetrometer, May"\n', encoding="utf-8")
    save(path, 20.0, in_model("wheel_slip", NAMED, 0.04))
    save(path, 30.0, in_model("wheel_slip", NAMED, 0.10), GRIP)
    assert find_soil("hill", None, path).source == "penetrometer, May"
    soil = find_soil("north", 25.0, path)
    assert soil.effects["wheel_slip"].value["ratio"] == pytest.approx(0.07)
    assert soil.effects["wheel_slip"].interval["ratio"] == pytest.approx((0.063, 0.077))
    assert set(soil.effects) == {"wheel_slip"}, "the drier line knows no limit of side forces"
    assert set(find_soil("north", 30.0, path).effects) == {"wheel_slip", "side_slip"}


def test_a_table_of_any_usual_form_keeps_its_lines(tmp_path: Path) -> None:
    path = tmp_path / "soils.csv"
    path.write_bytes("name;cone_index_kpa;source\nhill;900,5;Prüfer, Mai\n".encode("cp1252"))
    save(path, 20.0, SLIP)
    hill = find_soil("hill", None, path)
    assert (hill.cone_index_kpa, hill.source) == (900.5, "Prüfer, Mai")
    assert find_soil("north", 20.0, path).effects["wheel_slip"].value == {"ratio": 0.06}


def test_a_line_with_more_cells_than_columns_is_refused_and_not_cut(tmp_path: Path) -> None:
    path = tmp_path / "soils.csv"
    path.write_text("name,cone_index_kpa\nhill,900,penetrometer\n", encoding="utf-8")
    row = build_soil_row(diagnosis(SLIP), SoilLine(path, "north", 22.0))
    with pytest.raises(VehicleError, match=r"Line 2 of .*soils.csv.* has more values than the table has columns"):
        format_soil_table(row, path)


def test_a_plan_drives_with_the_soil_in_place_of_the_tractor_file(tmp_path: Path) -> None:
    save(tmp_path / "soils.csv", 22.0, SLIP)
    known = {"wheel_slip": EffectSetting(value={"ratio": 0.2}), "speed_lag": EffectSetting(value={"time_s": 1.0})}
    tractor = load_tractor("eg105").model_copy(update={"effects": known})
    request = PlanRequest(field="iwamizawa", soil=f"{tmp_path}/soils.csv#north", moisture_pct=22.0)
    effects = prepare_context(WorkOrder(request, tractor=tractor)).tractor.effects
    assert effects["wheel_slip"].value == {"ratio": 0.06} and effects["speed_lag"] == known["speed_lag"]


def test_a_drift_per_slope_is_that_of_the_field_of_the_plan() -> None:
    """Rear tyres slip by half a degree on 10 %, 0.087 m/m per slope: of 0.4, 0.313 are left, on a fall of 10 %."""
    drift = EffectSetting(value={"ratio": 0.02, "bearing_deg": 10.0, PER_SLOPE: 0.4}, interval={"ratio": (0.01, 0.03)})
    tractor = load_tractor("eg105").model_copy(update={"effects": {"cross_slope_drift": drift}})
    heights = np.tile(-0.1 * 5.0 * np.arange(6.0), (6, 1))
    physics = FieldPhysics(terrain=Terrain(0.0, 0.0, 5.0, heights))
    value = adapt_to_ground(tractor, physics, "soil").effects["cross_slope_drift"].value
    assert value["ratio"] == pytest.approx(0.1 * (0.4 - math.radians(5.0)), abs=1e-6)
    assert value["bearing_deg"] == pytest.approx(90.0) and value[PER_SLOPE] == 0.4
    assert adapt_to_ground(tractor, FieldPhysics(), "soil") is tractor


@pytest.mark.parametrize(("soil", "moisture_pct", "ground", "sentence"), [
    ("{path}#north", 22.0, "soil", "has the soil 'north' at 22 % moisture already; give another name or moisture"),
    ("{path}#north", None, "soil", "needs the moisture of the logs; add moisture_pct"),
    ("{path}#north", 130.0, "soil", "moisture_pct 130 is no moisture of a soil; give % of dry weight, from 0 to 100."),
    ("{path}#north", math.nan, "soil", "moisture_pct nan is no moisture of a soil"),
    ("{path}", 22.0, "soil", "does not name the soil; write .*soils.csv#NAME."),
    ("{path}#north", 30.0, "asphalt", "has the soil 'north' on soil, which cannot be interpolated with one measured"),
])  # fmt: skip
def test_a_line_that_cannot_be_added_is_refused(
    tmp_path: Path, soil: str, moisture_pct: float | None, ground: str, sentence: str
) -> None:
    save(tmp_path / "soils.csv", 22.0, SLIP)
    with pytest.raises(RequestError, match=sentence) as caught:
        parse_soil_line(soil.format(path=tmp_path / "soils.csv"), moisture_pct, ground)
    assert "\n" not in str(caught.value)


def test_a_name_without_a_table_goes_to_the_usual_one() -> None:
    assert parse_soil_line("north", 22.0, "soil") == SoilLine(Path("soils.csv"), "north", 22.0)


@pytest.mark.parametrize(("found", "more", "sentence"), [
    ((), {}, "soils.csv is left as it is: these logs name nothing of a soil"),
    ((in_model("wheel_slip", NAMED, 0.4),), {}, "name nothing of a soil"),  # no soil: the commanded speed is wrong
    ((replace(SLIP, status=LIKELY),), {}, "by these logs wheel slip is likely, and not certain; add more of them"),
    ((replace(SLIP, law=ParameterLaw("by_place", {}, "It grows to the north.")),), {}, "name nothing of a soil"),
    ((SLIP,), {"unsaved_reason": "what was found harms other runs"}, "is left as it is: "),
])  # fmt: skip
def test_logs_that_teach_nothing_add_nothing(found: tuple[Any, ...], more: dict[str, Any], sentence: str) -> None:
    with pytest.raises(RequestError, match=sentence):
        build_soil_row(diagnosis(*found, **more), SoilLine(Path("soils.csv"), "north", 22.0))


@pytest.mark.parametrize(("text", "sentence"), [
    ("name,ground,wheel_slip\na,soil,2\n", "wheel_slip has ratio = 2; use a value from -0.5 to 0.9"),
    ("name,ground,wheel_slip_low\na,soil,0.1\n", "wheel_slip has an interval and no value"),
    ("name,ground,wheel_slip,wheel_slip_low\na,soil,0.1,0.2\n", "wheel_slip 0.1 lies outside of wheel_slip_low to"),
    ("name,ground,moisture_pct\na,soil,20\na,asphalt,30\n", "and all a cone_index_kpa or the same ground"),
])  # fmt: skip
def test_a_table_with_a_fault_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "soils.csv").write_text(text, encoding="utf-8")
    with pytest.raises(HeadlandError, match=sentence):
        parse_soil_line(f"{tmp_path}/soils.csv#a", 22.0, "soil")
