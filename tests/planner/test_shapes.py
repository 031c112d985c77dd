"""Shapes of other libraries as fields: what they mean, the advice of refusals followed, and plans with them."""

import json
import pickle
from dataclasses import replace
from typing import Any

import geopandas
import pytest
import shapely
from shapely.affinity import translate

from fields.documents.reader import list_fields, read_field
from fields.errors import FieldError
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import LocalPool, SerialExecutor
from planner.pipeline.many_fields import compare_ways, hash_order, list_headland_requests
from planner.pipeline.outputs.saved_plans import simulate_saved_plan
from planner.pipeline.planning import plan
from planner.request.plan_request import PlanRequest

pytestmark = pytest.mark.usefixtures("first_layout")

GRID = "EPSG:25832"
PARCEL_M = shapely.box(500_000.0, 6_200_000.0, 500_060.0, 6_200_090.0)
PARCEL_DEG = geopandas.GeoSeries([PARCEL_M], crs=GRID).to_crs(4326).iloc[0]
TWO = [PARCEL_M, translate(PARCEL_M, 200.0)]
SMALL: dict[str, Any] = {"tractors": (1,), "strategies": ("split-field",), "width_m": 6.0}


class Shape:
    """A shape of a library that nobody knows."""

    __geo_interface__ = shapely.geometry.mapping(PARCEL_M)
    crs = GRID


@pytest.mark.parametrize(
    ("shape", "options"),
    [
        (geopandas.GeoDataFrame({"name": ["North"]}, geometry=[PARCEL_M], crs=GRID), {}),
        (geopandas.GeoSeries([PARCEL_DEG], crs=4326), {}),
        (geopandas.GeoSeries([PARCEL_DEG], crs=4326).to_crs(3035), {}),
        (Shape(), {}),
        (shapely.MultiPolygon([PARCEL_M]), {"crs": GRID}),
        (PARCEL_M, {"crs": geopandas.GeoSeries([PARCEL_M], crs=GRID).crs}),
        (PARCEL_DEG, {"crs": "EPSG:4326"}),
        (shapely.box(0.0, 0.0, 60.0, 90.0), {"local": True}),
    ],
)
def test_a_shape_is_a_field_and_its_request_is_a_value_like_any_other(shape: Any, options: dict[str, Any]) -> None:
    request = PlanRequest(field=shape, **options)
    field = read_field(request.field, local=request.local, crs=request.crs)
    assert field.area_m2 == pytest.approx(5400.0, rel=1e-3)
    assert field == read_field(shape, local=request.local, crs=request.crs)
    assert field.crs == (None if request.local else "EPSG:32632")
    assert (
        request
        == pickle.loads(pickle.dumps(request))
        == PlanRequest(field=json.loads(json.dumps(request.field)), **options)
    )
    assert hash(request) == hash(replace(request)) and "<shape-" in repr(request)


def follow(shape: Any, words: str, **options: Any) -> None:
    with pytest.raises(FieldError, match=words):
        read_field(shape, **options)


def test_without_a_coordinate_system_the_advice_works_in_degrees_and_in_metres() -> None:
    words = "has no coordinate system; add crs='EPSG:4326' if .*, or local=True"
    follow(PARCEL_DEG, words)
    assert read_field(PARCEL_DEG, crs="EPSG:4326").crs == "EPSG:32632"
    follow(PARCEL_M, words)
    assert read_field(PARCEL_M, local=True).crs is None
    follow(PARCEL_M, "look like metres; give local in place of crs", crs="EPSG:4326")


def test_of_several_the_advice_picks_one() -> None:
    frame = geopandas.GeoDataFrame({"name": ["a", "b"]}, geometry=TWO, crs=GRID)
    parts = geopandas.GeoDataFrame({"name": ["a"]}, geometry=[shapely.MultiPolygon(TWO)], crs=GRID)
    for several in (frame, parts):
        follow(several, r"holds 2 fields; give one alone, such as frame.explode\(\).iloc\[\[0\]\] of a GeoDataFrame or")
        assert read_field(several.explode().iloc[[1]]).area_m2 == pytest.approx(5400.0, rel=1e-3)
    follow(shapely.MultiPolygon(TWO), r"or shape.geoms\[0\] of shapely", local=True)
    assert read_field(shapely.MultiPolygon(TWO).geoms[0], local=True).area_m2 == pytest.approx(5400.0)
    assert [one.key for one in list_fields(frame)] == ["0", "1"]


def test_rows_with_roles_are_read_as_those_of_a_file() -> None:
    tree = shapely.Point(500_030.0, 6_200_040.0)
    frame = geopandas.GeoDataFrame(
        {"role": [None, "obstacle"], "radius_m": [None, 2.0]}, geometry=[PARCEL_M, tree], crs=GRID
    )
    (obstacle,) = read_field(frame).obstacles
    assert obstacle.shape.area == pytest.approx(4.0 * 3.14159, rel=0.02)


@pytest.mark.parametrize(
    "shape", [shapely.Polygon(), shapely.Point(1.0, 2.0), geopandas.GeoSeries([], crs=GRID), shapely.box(0, 0, 1e-3, 1)]
)
def test_what_is_no_field_is_refused_in_one_sentence(shape: Any) -> None:
    with pytest.raises(FieldError, match=r"^[^\n]*\.$"):
        read_field(PlanRequest(field=shape).field, local=True)


def test_plans_are_made_saved_driven_again_and_compared(tmp_path: Any) -> None:
    frame = geopandas.GeoDataFrame({"name": ["North"]}, geometry=[PARCEL_M], crs=GRID)
    request = PlanRequest(field=frame, **SMALL)
    answer = plan(request, executor=SerialExecutor())
    assert answer.ranking.field_name == "North" and answer.ranking.best is not None
    answer.save(tmp_path / "plan.json")
    driven = simulate_saved_plan(tmp_path / "plan.json")
    assert driven.request == request and driven.run.duration_s == answer.run.duration_s
    orders = map(WorkOrder, list_headland_requests(request, ("round",), ("last",)))
    comparison = compare_ways(orders, SerialExecutor())
    assert comparison.rows[0].field_name == "North"
    assert hash_order(WorkOrder(request)) == hash_order(WorkOrder(request))


@pytest.mark.slow
def test_other_processes_plan_a_shape_alike() -> None:
    frame = geopandas.GeoDataFrame({"name": ["North"]}, geometry=[PARCEL_M], crs=GRID)
    answer = plan(PlanRequest(field=frame, **SMALL), executor=SerialExecutor())
    with LocalPool(1) as pool:
        again = plan(PlanRequest(**SMALL), field=frame, executor=pool)
    assert again.context.request == answer.context.request and again.ranking.plans == answer.ranking.plans
