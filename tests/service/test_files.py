"""Files over HTTP: uploaded, read before they are kept, summed up, never a path."""

import io
import json
import tempfile
import warnings
import zipfile
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.farm.settings import read_example_text
from planner.pipeline.outputs.guidance_lines import build_guidance
from reports.plan.guidance_export import find_guidance_format, write_guidance
from tests.drawn_fields import feature, rectangle, write_features
from tests.fields.farm_files import partfield, pattern, points, polygon, taskdata
from tests.planner.saved_plans import saved
from tests.service.conftest import SMALL, Shared, store_done_job
from vehicle.missions.plan_file import format_plan

LOG = "time_s,easting_m,northing_m,steering_deg,speed_mps\n" + "".join(
    f"{row / 10:.1f},{row / 7:.3f},0.0,0.0,1.4\n" for row in range(400)
)

HERE_M = [(500_000.0, 5_650_000.0), (500_045.0, 5_650_000.0), (500_045.0, 5_650_080.0), (500_000.0, 5_650_080.0)]
"""A rectangle of 0.36 ha on the middle of UTM zone 32, metres: 9 degrees east, 51 degrees north."""

Plans = tuple[TestClient, dict[str, str], str]


def upload(client: TestClient, path: str, token: dict[str, str], file: str, content: bytes, **form: str) -> Any:
    return client.post(f"/api/v1/{path}", files={"file": (file, content)}, data=form, headers=token)


def test_a_field_is_uploaded_read_and_deleted(client: TestClient, token: dict[str, str]) -> None:
    answer = upload(client, "fields", token, "C:\\farm\\north.geojson", SMALL)
    assert answer.status_code == 201 and answer.json()["name"] == "north" and answer.json()["size"] == len(SMALL)
    assert [each["name"] for each in client.get("/api/v1/fields").json()["items"]][-1] == "north"
    assert client.get("/api/v1/fields/north").content == SMALL
    found = client.get("/api/v1/fields/north/summary?local=true").json()
    assert found["field"]["area_ha"] == 0.36 and found["field"]["rings_m"][0][1] == [45.0, 0.0]
    assert found["field"]["rings_deg"] is None and found["error"] is None
    assert upload(client, "fields", token, "north.geojson", SMALL).status_code == 201  # the same again
    other = SMALL.replace(b"80.0", b"90.0")
    assert upload(client, "fields", token, "north.geojson", other).status_code == 409
    assert upload(client, "fields", token, "north.geojson", other, name="south").status_code == 201
    assert client.delete("/api/v1/fields/north", headers=token).status_code == 204
    assert client.get("/api/v1/fields/north").status_code == 404
    what = [each["what"] for each in client.get("/api/v1/events").json()["items"]]
    assert what == ["field uploaded"] * 3 + ["field deleted"]


def test_samples_are_listed_and_stay(client: TestClient, token: dict[str, str]) -> None:
    found = client.get("/api/v1/fields/netherlands/summary").json()
    lon, lat = found["field"]["rings_deg"][0][0]
    assert 3.0 < lon < 8.0 and 50.0 < lat < 54.0 and found["field"]["crs"].startswith("EPSG:")
    assert client.get("/api/v1/tractors/eg105/summary").json()["name"] == "Yanmar EG105"
    assert b"mass_kg" in client.get("/api/v1/tractors/eg105").content
    assert upload(client, "fields", token, "denmark.geojson", SMALL).status_code == 409


def test_several_fields_of_a_file(client: TestClient, token: dict[str, str], tmp_path: Path) -> None:
    parcels = [feature(rectangle(x, 0, 45, 80), id=name) for name, x in (("a", 0), ("b", 100))]
    two = write_features(tmp_path / "two.geojson", *parcels)
    assert upload(client, "fields", token, "two.geojson", two.read_bytes()).status_code == 201
    found = client.get("/api/v1/fields/two/summary?local=true").json()
    assert [each["key"] for each in found["fields"]] == ["a", "b"] and found["field"] is None
    assert "choose one" in found["error"]
    assert client.get("/api/v1/fields/two/summary?local=true&key=b").json()["field"]["name"] == "b"
    assert client.get("/api/v1/fields/two/summary?local=true&key=c").status_code == 422


@pytest.mark.parametrize(
    "path, name, content, words",
    [
        ("fields", "x.geojson", b"{", "JSON"),
        ("fields", "x.geojson", SMALL.replace(b"80.0", b"NaN", 1), "is not finite"),
        ("fields", "x.geojson", SMALL.replace(b"80.0", b"1e308", 1), "is beyond 1e+08"),
        ("fields", "x.shp", SMALL, "does not end in '.shp'"),
        ("fields", "..geojson", SMALL, "cannot be used"),
        ("tractors", "x.toml", b"mass_kg = -1", "mass_kg"),
        ("farms", "x.toml", b"[prices]\nnothing = 1", "nothing"),
        ("farms", "x.toml", b"[[tractors]]\nname = 'a'\nfile = '/etc/passwd'", "no tractor '/etc/passwd'"),
        ("farms", "x.toml", b"[[tractors]]\nname = 'a'\nfile = '../../a.toml'", "no tractor '../../a'"),
        ("logs", "x.csv", b"a,b\n1,2\n3,4\n", "time_s"),
        ("logs", "x.csv", b"", "empty"),
    ],
)
def test_what_is_no_file_of_its_kind_is_refused_in_a_sentence(
    shared: Shared, path: str, name: str, content: bytes, words: str
) -> None:
    client, token = shared
    answer = upload(client, path, token, name, content)
    assert answer.status_code == 422 and words in answer.json()["error"], answer.json()
    assert answer.json()["error"].endswith(".") and "\n" not in answer.json()["error"]
    assert [each for each in client.get(f"/api/v1/{path}").json()["items"] if not each["sample"]] == []


def test_a_farm_brings_the_tractors_that_were_uploaded(client: TestClient, token: dict[str, str]) -> None:
    tractor = client.get("/api/v1/tractors/eg105").content
    assert upload(client, "tractors", token, "mine.toml", tractor).status_code == 201
    farm = b"[[tractors]]\nname = 'own'\nfile = 'mine.toml'\ncount = 2\n"
    assert upload(client, "farms", token, "farm.toml", farm).status_code == 201
    assert client.get("/api/v1/farms/farm/summary").json()["tractors"][0]["name"] == "own"
    body, of_farm = {"field": "denmark", "tractors": "1"}, {"farm": "farm"}
    refused = client.post("/api/v1/plans", json=body | of_farm | {"tractor": "a/own"}, headers=token)
    assert refused.status_code == 422 and "There is no tractor 'a/own'" in refused.json()["error"]
    mine = "tractor/mine.toml"
    for more, tractor, path in ((of_farm, "own", "own"), (of_farm, "mine", mine), ({}, "mine", mine)):
        assert client.post("/api/v1/plans", json=body | more | {"tractor": tractor}, headers=token).status_code == 202
        job = client.app.state.store.list_jobs()[0]  # type: ignore[attr-defined]
        assert job.work["tractor"] == path and ("farm/mine.toml" in job.inputs) == bool(more)
    assert upload(client, "farms", token, "example.toml", read_example_text("farm").encode()).status_code == 201


def test_a_field_of_task_data(client: TestClient, token: dict[str, str]) -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        line = pattern("Main", "1", points((10, 0), (10, 200), kind="6"))
        archive.writestr("TASKDATA/TASKDATA.XML", taskdata(partfield(polygon() + line)))
    assert upload(client, "fields", token, "acre.zip", content.getvalue()).status_code == 201
    found = client.get("/api/v1/fields/acre/summary").json()["field"]
    assert (found["name"], len(found["rings_m"])) == ("Long acre", 2)
    assert found["area_ha"] == pytest.approx(5.84, rel=1e-3)
    assert [one["name"] for one in found["lines"]] == ["Main"]
    both = {"field": "acre", "guidance_line": "Main", "bearing": 10.0}
    answer = client.post("/api/v1/plans", json=both, headers=token)
    assert answer.status_code == 422 and "guidance_line is a bearing, and so is bearing" in answer.json()["error"]
    assert (
        client.post("/api/v1/plans", json={"field": "acre", "guidance_line": "Main"}, headers=token).status_code == 202
    )


def test_a_log_says_what_it_is_or_which_mapping_reads_it(client: TestClient, token: dict[str, str]) -> None:
    assert upload(client, "logs", token, "run 1.csv", LOG.encode()).status_code == 201
    found = client.get("/api/v1/logs/run 1/summary").json()
    assert found["rows"] == 400 and found["seconds"] == pytest.approx(39.9) and found["error"] is None
    content = LOG.replace("time_s", "Zeit").replace("speed_mps", "v [m/s]").replace(",", ";").replace(".", ",").encode()
    assert upload(client, "logs", token, "run.csv", content).status_code == 201
    assert 'add mapping "time_s=Zeit" mapping' in client.get("/api/v1/logs/run/summary").json()["error"]
    for pair, status in (("time_s=Zeit", 202), ("tim=Zeit", 422)):
        answer = client.post("/api/v1/diagnoses", json={"logs": ["run"], "mapping": [pair]}, headers=token)
        assert answer.status_code == status, answer.json()
    assert "mapping tim=Zeit is for no column" in answer.json()["error"]


@pytest.mark.parametrize("name", ["..%2F..%2Fetc%2Fpasswd", "%2Fetc%2Fpasswd", "..", "%00", "%ff", "a" * 5000])
def test_names_in_addresses_lead_nowhere_else(shared: Shared, name: str) -> None:
    client, _ = shared
    for path in ("fields/{}", "fields/{}/summary", "tractors/{}", "plans/{}", "plans/x/results/{}", "views/{}"):
        answer = client.get(f"/api/v1/{path.format(name)}")
        assert answer.status_code in (404, 405) or answer.url.path in ("/api/v1/", "/api/v1/plans/x/results/")
        assert b"root:" not in answer.content


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
def test_a_shapefile_without_prj_is_read_as_is_said_of_it(client: TestClient, token: dict[str, str]) -> None:
    content = shapefile(HERE_M)
    refused = upload(client, "fields", token, "north.zip", content)
    assert (refused.status_code, refused.json()["parameter"]) == (422, "crs")
    wrong = upload(client, "fields", token, "north.zip", content, crs="EPSG:banana")
    assert (wrong.status_code, wrong.json()["parameter"]) == (422, "crs") and "EPSG:banana" in wrong.json()["error"]
    kept = upload(client, "fields", token, "north.zip", content, crs="EPSG:25832")
    assert kept.status_code == 201 and kept.json()["options"] == {"crs": "EPSG:25832"}
    found = client.get("/api/v1/fields/north/summary").json()["field"]
    assert found["area_ha"] == pytest.approx(0.36, rel=1e-3)
    assert found["rings_deg"][0][0] == pytest.approx([9, 51], abs=1)
    assert client.get("/api/v1/fields/north/summary?crs=EPSG:25833").json()["field"]["rings_deg"][0][0][0] > 14
    asked = client.post("/api/v1/plans", json={"field": "north", "tractors": "1"}, headers=token)
    assert asked.status_code == 202 and asked.json()["request"] == {"field": "north", "tractors": "1"}
    assert client.app.state.store.list_jobs()[0].work["crs"] == "EPSG:25832"  # type: ignore[attr-defined]


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
def test_exchanged_coordinates_are_put_right_when_it_is_said(client: TestClient, token: dict[str, str]) -> None:
    content = shapefile([(north, east) for east, north in HERE_M])
    for said, options in ((("crs",), {}), (("crs", "swap_axes"), {"swap_axes": True})):
        form = {name: {"crs": "EPSG:25832", "swap_axes": "true"}[name] for name in said}
        kept = upload(client, "fields", token, "north.zip", content, **form)
        assert kept.json()["options"] == {"crs": "EPSG:25832"} | options, "the same bytes are read as is said last"
    lon, lat = client.get("/api/v1/fields/north/summary").json()["field"]["rings_deg"][0][0]
    assert (lon, lat) == pytest.approx((9, 51), abs=1)
    local = upload(client, "fields", token, "yard.geojson", SMALL, local="1")
    assert local.json()["options"] == {"local": True}
    assert client.get("/api/v1/fields/yard/summary").json()["field"]["area_ha"] == 0.36
    assert client.get("/api/v1/fields/yard/summary?local=false").status_code == 422


def test_heights_are_uploaded_and_planned_with(client: TestClient, token: dict[str, str]) -> None:
    rows = "\n".join(" ".join(f"{100.0 + 0.1 * column:.2f}" for column in range(60)) for _ in range(60))
    grid = f"ncols 60\nnrows 60\nxllcorner -30\nyllcorner -30\ncellsize 2\n{rows}\n".encode()
    assert upload(client, "elevations", token, "hill.asc", grid).status_code == 201
    assert client.get("/api/v1/elevations/hill/summary").json() | {"remarks": []} == {
        "of": "raster", "rows": 60, "columns": 60, "crs": None, "remarks": [],
    }  # fmt: skip
    twin = upload(client, "elevations", token, "twin.agr", grid)
    assert twin.status_code == 201 and twin.json()["media"] == "text/plain; charset=utf-8", "as headland field reads it"
    assert "a file that ends in .tif" in upload(client, "elevations", token, "hill.shp", grid).json()["error"]
    other = upload(client, "elevations", token, "hill.asc", grid.replace(b"100.00", b"101.00"))
    assert other.status_code == 409 and "There is an elevation 'hill' with other content" in other.json()["error"]
    copied = client.post("/api/v1/elevations/hill/copy", json={"name": "hill"}, headers=token)
    assert copied.status_code == 409 and "There is an elevation 'hill' already; choose" in copied.json()["error"]
    broken = upload(client, "elevations", token, "broken.asc", b"ncols many")
    assert (broken.status_code, broken.json()["parameter"]) == (422, "file")
    assert upload(client, "fields", token, "yard.geojson", SMALL, local="1").status_code == 201
    body = {"field": "yard", "tractors": "1", "elevation": "hill", "soil": "loam", "moisture": 20.0}
    body |= {"draft": "disk harrow", "depth_cm": 10.0, "rain_mm": "0,3", "et0_mm": 2.0}
    asked = client.post("/api/v1/plans", json=body, headers=token)
    assert asked.status_code == 202, asked.json()
    job = client.app.state.store.list_jobs()[0]  # type: ignore[attr-defined]
    assert job.work["elevation"] == "elevation/hill.asc" and "elevation/hill.asc" in job.inputs
    day = (
        'start = "08:00"\n[[fields]]\nfile = "yard.geojson"\nlocal = true\nelevation = "%s"\n[[fleets]]\nname = "one"\n'
    )
    asked = client.post("/api/v1/days", json={"day": day % "hill.asc"}, headers=token)
    assert asked.status_code == 202, asked.json()
    assert "day/hill.asc" in client.app.state.store.list_jobs()[0].inputs  # type: ignore[attr-defined]
    points_json = json.dumps({"type": "MultiPoint", "coordinates": [[9.0, 56.9, each + 1] for each in range(12)]})
    assert upload(client, "elevations", token, "yard.geojson", points_json.encode()).status_code == 201
    twice = client.post("/api/v1/days", json={"day": day % "yard.geojson"}, headers=token)
    assert twice.status_code == 422 and "Two files have the name 'yard.geojson'" in twice.json()["error"]
    unknown = client.post("/api/v1/days", json={"day": day % "other.asc"}, headers=token)
    assert (unknown.status_code, unknown.json()["parameter"]) == (422, "day")
    itself = client.post("/api/v1/days", json={"day": 'farm = "day.toml"'}, headers=token)
    told = "A farm of the day has the name 'day.toml' of the day file itself; upload it under another name."
    assert (itself.status_code, itself.json()["error"], itself.json()["parameter"]) == (422, told, "day")


@pytest.mark.parametrize(
    ("body", "parameter"),
    [
        ({"elevation": "/etc/passwd"}, "elevation"),
        ({"soil": "/etc/soils.csv"}, "soil"),
        ({"soil": "loam", "moisture": 99.0}, "soil"),
        ({"moisture": 20.0}, "moisture"),
        ({"soil": "loam", "rain_mm": "/etc/rain.csv"}, "rain_mm"),
        ({"soil": "loam", "rain_mm": "3,x"}, "rain_mm"),
        ({"soil": "firm", "rain_mm": "3"}, "soil"),
        ({"draft": "/etc/passwd"}, "draft"),
        ({"draft": "plough", "depth_cm": 90.0}, "depth_cm"),
    ],
)
def test_heights_soils_and_implements_that_there_are_not(
    client: TestClient, token: dict[str, str], body: dict[str, object], parameter: str
) -> None:
    answer = client.post("/api/v1/plans", json={"tractors": "1"} | body, headers=token)
    assert (answer.status_code, answer.json()["parameter"]) == (422, parameter)


def test_tables_of_rain_and_of_gnss_errors(client: TestClient, token: dict[str, str]) -> None:
    gnss = (resources.files("vehicle") / "data" / "gnss_rtk.csv").read_bytes()
    rain = b"member,time\n1,16:30\n2,17:00\n3,\n4,18:00\n"
    assert upload(client, "tables", token, "rain.csv", rain).status_code == 201
    assert upload(client, "tables", token, "rtk.csv", gnss).status_code == 201
    for name, content in (("odd.csv", b"a,b\n1,2\n"), ("late.csv", b"hours\nsoon\n"), ("bad.csv", b"east_mm\n1\n")):
        refused = upload(client, "tables", token, name, content)
        assert (refused.status_code, refused.json()["parameter"]) == (422, "file"), name
    assert client.get("/api/v1/tables/rain/summary").json() == {"of": "rain", "times": 3, "share_pct": 75.0}
    assert client.get("/api/v1/tables/rtk/summary").json()["of"] == "gnss"
    body = {"tractors": "1", "start": "15:00", "rain": "rain.csv", "gnss_table": "rtk"}
    assert client.post("/api/v1/plans", json=body, headers=token).status_code == 202
    job = client.app.state.store.list_jobs()[0]  # type: ignore[attr-defined]
    assert (job.work["rain"], job.work["gnss_table"]) == ("table/rain.csv", "table/rtk.csv")
    assert sorted(job.inputs) == ["table/rain.csv", "table/rtk.csv"]
    swapped = client.post("/api/v1/plans", json=body | {"gnss_table": "rain"}, headers=token)
    assert (swapped.status_code, swapped.json()["parameter"]) == (422, "gnss_table")
    early = client.post("/api/v1/plans", json={"rain": "rain.csv"}, headers=token)
    assert (early.status_code, early.json()["parameter"]) == (422, "start")


def shapefile(ring: list[tuple[float, float]]) -> bytes:
    """A zip with a Shapefile of one polygon and no .prj."""
    made = io.BytesIO()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that no system is given, which is what is wanted here
        shape = np.array([shapely.to_wkb(shapely.Polygon(ring))], dtype=object)
        pyogrio.raw.write(
            f"{folder}/field.shp", geometry=shape, field_data=[], fields=[], geometry_type="Polygon",
            driver="ESRI Shapefile",
        )  # fmt: skip
        with zipfile.ZipFile(made, "w") as packed:
            for path in sorted(Path(folder).iterdir()):
                packed.write(path, path.name)
    return made.getvalue()


def test_a_part_of_a_form_that_is_not_known_is_refused_and_only_a_known_token_may_send_much(shared: Shared) -> None:
    client, token = shared
    answer = upload(client, "fields", token, "x.geojson", SMALL, csr="EPSG:25832")
    assert (answer.status_code, answer.json()["parameter"]) == (422, "csr") and "crs" in answer.json()["error"]
    assert upload(client, "logs", token, "x.csv", b"", crs="EPSG:25832").json()["parameter"] == "crs"
    much = SMALL + b" " * 2**20
    for header in ({}, {"Authorization": "Bearer hl_nobody"}, {"Authorization": "Basic eDp5"}):
        assert upload(client, "fields", header, "x.geojson", much).status_code == 401
    assert upload(client, "fields", token, "x.geojson", much, csr="").status_code == 422


@pytest.fixture(scope="module")
def plans(shared: Shared) -> Plans:
    """A client, its header, and the address of the results of a job with a plan and something that is none."""
    client, token = shared
    assert isinstance(client.app, FastAPI)
    store, one = client.app.state.store, saved()
    text = format_plan(one.plan, crs=one.crs, origin_m=one.origin_m, scenario=one.scenario, ground=one.ground)
    results = {"plan.json": text.encode(), "map.png": b"\x89PNG\xff"}
    return client, token, f"/api/v1/plans/{store_done_job(store, results=results).id}/results"


def test_a_plan_is_a_zip_of_what_the_command_writes(plans: Plans) -> None:
    client, token, path = plans
    form = find_guidance_format("agopengps")
    assert form is not None
    done = client.get(f"{path}/plan.json/export", params={"to": "agopengps"}, headers=token)
    assert done.status_code == 200 and "plan-agopengps.zip" in done.headers["content-disposition"]
    with zipfile.ZipFile(io.BytesIO(done.content)) as archive:
        assert {name: archive.read(name) for name in archive.namelist()} == write_guidance(
            build_guidance(saved()), form
        ).files


def test_one_file_comes_as_it_is(plans: Plans) -> None:
    client, token, path = plans
    wanted: dict[str, str] = {"to": "gpx", "tractor": "2", "curves": "false"}
    done = client.get(f"{path}/plan.json/export", params=wanted, headers=token)
    assert done.status_code == 200 and done.headers["content-type"] == "application/gpx+xml"
    assert done.content.count(b"<rte>") == 2 and b"T2 01 track 2a" in done.content


@pytest.mark.parametrize(
    ("name", "wanted", "status", "said"),
    [
        ("plan.json", {"to": "isobus"}, 422, "to 'isobus' is unknown"),
        ("plan.json", {}, 422, "to"),
        ("plan.json", {"to": "kml", "tractor": "3"}, 422, "the plan has tractors 1 to 2"),
        ("plan.json", {"to": "kml", "tracter": "1"}, 422, "is not a parameter of this address"),
        ("map.png", {"to": "kml"}, 422, "is not JSON"),
        ("none.json", {"to": "kml"}, 404, "none.json"),
    ],
)
def test_refusals(plans: Plans, name: str, wanted: dict[str, str], status: int, said: str) -> None:
    client, token, path = plans
    done = client.get(f"{path}/{name}/export", params=wanted, headers=token)
    assert done.status_code == status and said in done.json()["error"]
