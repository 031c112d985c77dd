"""Requests: what cannot be asked is refused at once, in the sentence of the command line; what can, reads its files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.errors import HeadlandError, strip_unit
from planner.service.sandbox.readings import build_work_order, check_diagnosis_request
from tests.service.conftest import SMALL, Shared, run_next_job

REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"width": -1}, "width"),
    ({"tractors": "3-1"}, "tractors"),
    ({"start": "25:00"}, "start"),
    ({"deadline": "12:00"}, "start"),
    ({"speed_kmh": 99}, "speed_kmh"),
    ({"entrance": "here"}, "entrance"),
    ({"samples": 0, "objective": "surest"}, "samples"),
    ({"headland_first": True, "headland_last": True}, "headland_first"),
    ({"operation": "plough"}, "operation"),
    ({"margin": 1000}, "margin"),
    ({"guidance_line": "north line"}, "guidance_line"),
    ({"refill": "headland"}, "refill"),
]
OF_SERVICE: list[tuple[dict[str, Any], str]] = [
    ({"field": "/etc/passwd"}, "field"),
    ({"tractor": "/etc/passwd"}, "tractor"),
    ({"rain": "rain.csv"}, "rain"),
    ({"widht": 3}, "widht"),
    ({"width": "wide"}, "width"),
    ({"gnss_table": "/etc/passwd"}, "gnss_table"),
    ({"rain": "/etc/rain.csv"}, "rain"),
    ({"rain": "../rain.csv "}, "rain"),
    ({"implement": "plough"}, "implement"),
]


def words(request: dict[str, Any]) -> list[str]:
    """A request as words of the command line."""
    found = []
    for name, value in request.items():
        option = "--" + name.replace("_", "-")
        found += [option] if value is True else [option, *(value if isinstance(value, list) else [str(value)])]
    return found


@pytest.mark.parametrize(("request_", "parameter"), REFUSED, ids=str)
def test_refusals_are_those_of_the_command_line(
    shared: Shared, run: Callable[..., tuple[int, str, str]], request_: dict[str, Any], parameter: str
) -> None:
    client, token = shared
    answer = client.post("/api/v1/plans", json=request_, headers=token)
    assert answer.status_code == 422 and answer.json()["parameter"] == parameter
    status, _, told = run("plan", *words(request_))
    assert status == 2
    for name in ("headland-first", "headland-last", *(one.replace("_", "-") for one in (parameter, *request_))):
        told = told.replace(f"--{name}", name.replace("-", "_"))
    assert answer.json()["error"].replace("headland-", "headland_") in told


@pytest.mark.parametrize(
    ("request_", "sentence"),
    [
        ({"width": "wide"}, 'width is "wide"; give a number.'),
        ({"cell_bearing": "x"}, 'cell_bearing is "x"; give a list.'),
        ({"widht": 3}, "widht is unknown; the API is documented at /api/v1/docs."),
        ([], "The body is []; give an object in braces."),
    ],
)
def test_values_of_no_use_are_named_with_the_rule(shared: Shared, request_: Any, sentence: str) -> None:
    client, token = shared
    assert client.post("/api/v1/plans", json=request_, headers=token).json()["error"] == sentence


@pytest.mark.parametrize(("request_", "parameter"), OF_SERVICE, ids=str)
def test_what_only_a_service_refuses(shared: Shared, request_: dict[str, Any], parameter: str) -> None:
    client, token = shared
    answer = client.post("/api/v1/plans", json=request_, headers=token)
    assert answer.status_code == 422 and answer.json()["parameter"] == parameter
    assert answer.json()["error"].endswith(".") and client.get("/api/v1/plans").json()["items"] == []


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("days", {"day": "fields = 3"}),
        ("days", {"day": "not toml"}),
        ("days", {"day": "[[fields]]\nfile = '../../north.geojson'\n[[fleets]]\nname = 'a'"}),
        ("days", {"day": "farm = '/etc/passwd'"}),
        ("days", {"day": "rain = '/etc/rain.csv'"}),
        ("days", {"day": "", "samples": 0}),
        ("days", {}),
        ("diagnoses", {}),
        ("diagnoses", {"logs": ["../x"]}),
        ("diagnoses", {"logs": ["*"]}),
        ("diagnoses", {"demo": True, "fix": ["time-ms"]}),
        ("diagnoses", {"demo": True, "hide": "nothing"}),
        ("diagnoses", {"demo": True, "tractor": "../x.toml"}),
        ("diagnoses", {"logs": ["x"], "seed": 3}),
        ("diagnoses", {"demo": True, "ground": "ice"}),
        *(("plans", body) for body in (b"{", b"\xff\xfe", b"null", b'{"field": "\\ud800"}', b'{"width": NaN}')),
        ("plans", b'{"width": 1e999}'),
    ],
)
def test_what_cannot_be_asked_of_days_diagnoses_and_plans(shared: Shared, path: str, body: Any) -> None:
    client, token = shared
    content = body if isinstance(body, bytes) else json.dumps(body)
    headers = token | {"content-type": "application/json"}
    answer = client.post(f"/api/v1/{path}", content=content, headers=headers)
    assert answer.status_code == 422 and answer.json()["error"].endswith(".")


def test_what_is_given_wins_over_the_farm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    farm = "[times]\nshift_start = '06:00'\n[[implements]]\nname = 'harrow'\nwidth_m = 6.0\nspeed_kmh = 8.0\n"
    Path("own.toml").write_text(farm)
    asked = build_work_order({"farm": "own.toml", "speed_kmh": 5.0, "deadline": "18:00"})
    scenario = asked.request
    assert scenario.width_m == 6.0 and scenario.speed_mps == pytest.approx(5 / 3.6) and scenario.start_s == 6 * 3600
    assert strip_unit("turn_speed_mps") == "turn_speed_kmh"


def test_a_field_of_several_parcels_is_refused_when_it_is_asked_for(client: TestClient, token: dict[str, str]) -> None:
    square = json.loads(SMALL)["coordinates"][0]
    rings = [[[x + 100.0 * number, y] for x, y in square] for number in range(30)]
    content = json.dumps({"type": "MultiPolygon", "coordinates": [[ring] for ring in rings]}).encode()
    files = {"file": ("many.geojson", content)}
    assert client.post("/api/v1/fields", files=files, headers=token).status_code == 201
    summed = client.get("/api/v1/fields/many/summary?local=true").json()
    answer = client.post("/api/v1/plans", json={"field": "many", "local": True}, headers=token)
    assert answer.status_code == 422 and answer.json()["parameter"] == "field"
    for told in (answer.json()["error"], summed["error"]):
        assert "(headland field FILE --list lists all)" in told and "list_fields" not in told
    one = client.post("/api/v1/plans", json={"field": "many#3", "local": True}, headers=token)
    assert one.status_code == 202


@pytest.mark.parametrize("address, words", [
    ("events?after=3", "it takes fleet, since"), ("me?limit=-1", "it takes none."),
    ("events?sinc=3", "did you mean 'since'?"),
])  # fmt: skip
def test_a_parameter_that_an_address_does_not_have_is_refused(shared: Shared, address: str, words: str) -> None:
    answer = shared[0].get(f"/api/v1/{address}")
    name = address.partition("?")[2].partition("=")[0]
    assert answer.status_code == 422 and answer.json()["parameter"] == name
    assert answer.json()["error"].startswith(f"{name!r} is not a parameter of this address; ")
    assert words in answer.json()["error"]


def test_only_so_many_jobs_may_wait(client: TestClient, token: dict[str, str]) -> None:
    statuses = [client.post("/api/v1/plans", json={}, headers=token).status_code for _ in range(4)]
    assert statuses == [202, 202, 202, 429]


@pytest.mark.slow
def test_a_plan_is_what_the_command_line_makes_of_the_same_file(
    client: TestClient, app: FastAPI, token: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    run: Callable[..., tuple[int, str, str]],
) -> None:  # fmt: skip
    client.post("/api/v1/fields", files={"file": ("small.geojson", SMALL)}, headers=token)
    body = {"field": "small", "local": True, "tractors": "1", "strategies": "split-field", "no_headland": True}
    job = client.post("/api/v1/plans", json=body, headers=token).json()
    assert (job["status"], job["name"], job["request"]) == ("queued", "small", body)
    client.delete("/api/v1/fields/small", headers=token)  # the job keeps it
    run_next_job(app.state.store)
    done = client.get(f"/api/v1/plans/{job['id']}").json()
    assert (done["status"], done["error"], done["progress"]["words"]) == ("done", None, "Done")
    names = {"result.json", "result.csv", "page.html", "maps.json", "map.png", "plan.json", "plan-split-field-1.json"}
    assert set(done["results"]) == names
    results = {name: client.get(f"/api/v1/plans/{job['id']}/results/{name}") for name in names}
    assert results["plan.json"].content == results["plan-split-field-1.json"].content
    assert results["map.png"].content.startswith(b"\x89PNG")
    page = results["page.html"]
    assert page.headers["content-security-policy"].startswith("sandbox allow-scripts; default-src 'none'")
    assert page.headers["x-frame-options"] == "SAMEORIGIN"
    view = client.post(f"/api/v1/plans/{job['id']}/results/page.html/view").json()["path"]
    assert client.get(f"/api/v1/{view}").content == page.content and client.get(f"/api/v1/{view}").status_code == 404

    (tmp_path / "field").mkdir()
    (tmp_path / "field" / "small.geojson").write_bytes(SMALL)
    monkeypatch.chdir(tmp_path)
    arguments = ["field/small.geojson", "--local", "--tractors", "1", "--strategies", "split-field", "--no-headland"]
    status, out, _ = run("plan", *arguments, "--json", "--save", "plan.json")
    assert status == 0 and json.loads(out) == results["result.json"].json()
    assert (tmp_path / "plan.json").read_bytes() == results["plan.json"].content


def test_what_a_diagnosis_cannot_use_is_refused_when_it_is_asked_for() -> None:
    for values, parameter in (({"fix": ["speed-furlongs"]}, "fixes"), ({"ground": "ice"}, "ground")):
        with pytest.raises(HeadlandError) as refused:
            check_diagnosis_request({"tractor": "eg105"} | values)
        assert refused.value.parameter == parameter
    check_diagnosis_request({"tractor": "eg105", "fix": ["speed-kmh"], "ground": "asphalt"})
