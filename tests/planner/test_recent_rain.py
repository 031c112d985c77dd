"""Rain of the last days in a request: lists and files, the soil it makes, and what is refused."""

import re
from pathlib import Path

import pytest
import shapely

from fields import Field
from planner.errors import HeadlandError, RequestError
from planner.evaluation.field_physics import build_field_physics, estimate_requested_moisture, find_requested_soil
from planner.evaluation.ground_sentences import describe_ground
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.ranking import export_request
from planner.request.plan_request import PlanRequest
from planner.request.recent_rain import DEFAULT_ET0_MM, parse_recent_rain
from vehicle.model.tractor import load_tractor

FIELD = Field("drawn", shapely.box(0, 0, 36, 80))


def test_a_list_and_a_file_of_the_same_days(tmp_path: Path) -> None:
    path = tmp_path / "rain.csv"
    path.write_text("date, RAIN_mm ,et0_mm\n2026-05-01,0,\n2026-05-02,12.5,2\n", encoding="utf-8")
    assert parse_recent_rain("0, 12.5") == ((0.0, 12.5), (DEFAULT_ET0_MM, DEFAULT_ET0_MM))
    rains, et0s = parse_recent_rain(str(path), 4.0)
    assert (
        rains == (0.0, 12.5) and et0s[0] == pytest.approx((4.0, 3.2, 4.8)) and et0s[1] == pytest.approx((2, 1.6, 2.4))
    )


def test_rain_says_the_moisture_of_a_plan_unless_that_is_given() -> None:
    dry, wet = (PlanRequest(field="drawn", soil="loam", rain_mm=rain) for rain in ("0,0,0,0", "20,20,20,20"))
    drier, wetter = find_requested_soil(dry), find_requested_soil(wet)
    assert drier.moisture_pct < 14.0 < 17.0 < (wetter.moisture_pct or 0.0) <= 18.7
    assert (drier.cone_index_kpa or 0.0) > (wetter.cone_index_kpa or 0.0)
    given = PlanRequest(field="drawn", soil="loam", rain_mm="20", moisture_pct=25.0)
    soil = find_requested_soil(given)
    assert soil.moisture_pct == 25.0 and estimate_requested_moisture(given) is not None
    assert build_field_physics(PlanRequest(field="drawn", soil="loam"), FIELD, load_tractor("eg105")).moisture is None


def test_the_plan_tells_the_estimate_with_its_interval() -> None:
    request = PlanRequest(field="drawn", no_headland=True, soil="loam", rain_mm="20,20", et0_mm=1.0)
    context = prepare_context(WorkOrder(request, FIELD))
    text = " ".join(describe_ground(context))
    scenario = export_request(context)
    low, high = scenario["estimated_moisture_range_pct"]
    told = re.search(
        r"40 mm of rain in the last 48 hours and an evapotranspiration of 1 mm a day make the topsoil about ([\d.]+) % "
        r"moist \(([\d.]+) to ([\d.]+) %\)",
        text,
    )
    assert [float(part) for part in told.groups()] == pytest.approx(
        [scenario["estimated_moisture_pct"], low, high], abs=0.06
    )
    assert scenario["moisture_pct"] == pytest.approx(scenario["estimated_moisture_pct"], abs=0.01)
    assert "rain_mm" not in export_request(
        prepare_context(WorkOrder(PlanRequest(field="drawn", no_headland=True), FIELD))
    )


@pytest.mark.parametrize(("values", "sentence"), [
    ({"rain_mm": "3"}, "is of a soil; name that with"),
    ({"soil": "loam", "et0_mm": 3.0}, "is of the days with"),
    ({"soil": "loam", "rain_mm": "3,x"}, "has 'x', which is no number from 0 to 1000"),
    ({"soil": "loam", "rain_mm": "-1"}, "which is no number from 0 to 1000"),
    ({"soil": "loam", "rain_mm": ",".join(["1"] * 367)}, "has 367 days; give 1 to 366"),
    ({"soil": "loam", "rain_mm": "1", "et0_mm": 21.0}, "use 0 to 20 mm a day"),
])  # fmt: skip
def test_what_is_no_rain_is_refused(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(RequestError, match=re.escape(sentence)):
        PlanRequest(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize(("text", "sentence"), [
    ("day\n1\n", "has no column rain_mm"),
    ("rain_mm\n1\nmuch\n", "has the rain_mm 'much' in line 3; give a number from 0 to 1000"),
    ("rain_mm\n", "has 0 days"),
    ("rain_mm,et0_mm\n1,50\n", "has the et0_mm '50' in line 2; give a number from 0 to 20"),
])  # fmt: skip
def test_a_fault_of_a_file_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "rain.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(HeadlandError, match=re.escape(sentence)) as refusal:
        find_requested_soil(PlanRequest(soil="loam", rain_mm=str(path)))
    assert "\n" not in str(refusal.value)


def test_a_soil_without_its_water_needs_its_moisture() -> None:
    with pytest.raises(HeadlandError, match="The soil 'soft' does not say how much water it holds"):
        find_requested_soil(PlanRequest(soil="soft", rain_mm="3"))
