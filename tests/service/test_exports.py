"""Plans that jobs made, downloaded as lines for terminals and maps."""

import io
import zipfile

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.pipeline.outputs.guidance_lines import build_guidance
from reports.plan.guidance_export import find_guidance_format, write_guidance
from tests.planner.saved_plans import saved
from tests.service.conftest import Shared, store_done_job
from vehicle.missions.plan_file import format_plan

Plans = tuple[TestClient, dict[str, str], str]


@pytest.fixture(scope="module")
def plans(shared: Shared) -> Plans:
    """A client, its header, and the address of the results of a job with a plan and something that is none."""
    client, token = shared
    assert isinstance(client.app, FastAPI)
    store, one = client.app.state.store, saved()
    text = format_plan(one.plan, crs=one.crs, origin_m=one.origin_m, scenario=one.scenario, ground=one.ground)
    results = [("plan.json", text.encode(), "application/json"), ("map.png", b"\x89PNG\xff", "image/png")]
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
