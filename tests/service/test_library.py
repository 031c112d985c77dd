"""Files, plans and days are renamed, replaced, copied, searched and deleted, by those who may."""

from collections.abc import Mapping
from typing import Any

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.farm.settings import read_example_text
from planner.service.store.tables import Owner
from tests.service.conftest import SMALL, bearer

Header = Mapping[str, str]
LARGER = SMALL.replace(b"80.0", b"90.0")


def add(client: TestClient, token: Header, kind: str, filename: str, content: bytes, **more: str) -> Any:
    """The answer to an upload."""
    return client.post(f"/api/v1/{kind}", files={"file": (filename, content)}, data=more, headers=dict(token))


def add_field(client: TestClient, token: Header, name: str, content: bytes = SMALL, **more: str) -> Any:
    """The answer to the upload of a field in metres."""
    return add(client, token, "fields", f"{name}.geojson", content, local="true", **more)


def list_names(client: TestClient, kind: str, search: str = "") -> list[str]:
    """Names of what was uploaded, as they are listed."""
    items = client.get(f"/api/v1/{kind}", params={"search": search} if search else {}).json()["items"]
    return [each["name"] for each in items if not each.get("sample")]


def ask_plan(client: TestClient, token: Header, field: str) -> Any:
    """A plan that waits, as no worker runs."""
    answer = client.post("/api/v1/plans", json={"field": field, "local": True}, headers=dict(token))
    assert answer.status_code == 202, answer.text
    return answer.json()


def test_a_field_goes_round(client: TestClient, token: Header) -> None:
    made = add_field(client, token, "north").json()
    assert made["owner"] == "a operator planner" and made["changed"] is None
    copied = client.post("/api/v1/fields/north/copy", json={}, headers=dict(token))
    assert copied.status_code == 201 and copied.json()["name"] == "north copy"
    assert copied.json()["options"] == {"local": True}
    assert client.post("/api/v1/fields/north/copy", json={}, headers=dict(token)).json()["name"] == "north copy 2"
    renamed = client.patch("/api/v1/fields/north copy", json={"name": "Große Breite"}, headers=dict(token)).json()
    assert renamed["name"] == "Große Breite" and renamed["changed"]
    assert client.get("/api/v1/fields/Große Breite").content == SMALL
    assert client.get("/api/v1/fields/north copy").status_code == 404
    assert list_names(client, "fields") == ["Große Breite", "north", "north copy 2"]
    assert list_names(client, "fields", "GROSSE breite") == ["Große Breite"], "ß is ss in capitals"
    assert list_names(client, "fields", "copy NORTH") == ["north copy 2"]
    assert client.delete("/api/v1/fields/north", headers=dict(token)).status_code == 204
    assert list_names(client, "fields") == ["Große Breite", "north copy 2"]
    seen = [each["what"] for each in client.get("/api/v1/events").json()["items"] if "field" in each["what"]]
    assert seen == ["field uploaded", "field copied", "field copied", "field renamed", "field deleted"]


def test_a_plan_keeps_the_field_it_was_made_of(client: TestClient, token: Header, app: FastAPI) -> None:
    add_field(client, token, "north")
    job = ask_plan(client, token, "north")
    running = app.state.store.claim_job("w")
    before = running.inputs
    assert running.id == job["id"]
    refused = add_field(client, token, "north", LARGER)
    assert refused.status_code == 409 and "replace it or choose another name" in refused.json()["error"]
    assert client.get("/api/v1/fields/north").content == SMALL
    assert add_field(client, token, "north", LARGER, replace="true").json()["changed"]
    assert client.get("/api/v1/fields/north").content == LARGER
    assert client.get("/api/v1/fields/north/summary").json()["field"]["area_ha"] == pytest.approx(0.405)
    later = ask_plan(client, token, "north")
    client.patch("/api/v1/fields/north", json={"name": "south"}, headers=dict(token))
    client.delete("/api/v1/fields/south", headers=dict(token))
    kept = app.state.store.get_job(job["id"])
    assert kept.status == "running" and app.state.store.report_job(kept.number, "w", (1, 2, "At work"))
    assert kept.inputs == before and kept.work["field"] == "field/north.geojson"
    assert app.state.store.blobs.read_bytes(kept.inputs["field/north.geojson"]) == SMALL
    changed = app.state.store.get_job(later["id"])
    assert app.state.store.blobs.read_bytes(changed.inputs["field/north.geojson"]) == LARGER


def test_names_that_are_taken_or_could_be_paths_are_refused(client: TestClient, token: Header) -> None:
    add_field(client, token, "north")
    add_field(client, token, "south", LARGER)
    job = ask_plan(client, token, "north")
    for name in ("../north", "a/b", "a\\b", "..", " north", "con", "x" * 101, "a\x00b", "#", "a..b"):
        for answer in (
            client.patch("/api/v1/fields/north", json={"name": name}, headers=dict(token)),
            client.post("/api/v1/fields/north/copy", json={"name": name}, headers=dict(token)),
            add(client, token, "fields", "other.geojson", SMALL, name=name),
            client.patch(f"/api/v1/plans/{job['id']}", json={"name": name}, headers=dict(token)),
        ):
            assert answer.status_code == 422 and answer.json()["error"].endswith("."), (name, answer.text)
            assert answer.json()["parameter"] == "name"
    for method, path, name in (
        ("PATCH", "fields/north", "south"), ("PATCH", "fields/north", "denmark"),
        ("POST", "fields/north/copy", "south"), ("POST", "fields/denmark/copy", "denmark"),
        ("PATCH", "fields/denmark", "mine"), ("DELETE", "fields/denmark", ""),
        ("PATCH", "tractors/eg105", "mine"), ("DELETE", "tractors/eg105", ""),
    ):  # fmt: skip
        answer = client.request(method, f"/api/v1/{path}", json={"name": name} if name else None, headers=dict(token))
        assert answer.status_code == 409, (path, answer.text)
    assert client.patch("/api/v1/fields/north", json={"name": ""}, headers=dict(token)).status_code == 422
    assert client.patch("/api/v1/fields/..%2Fnorth", json={"name": "x"}, headers=dict(token)).status_code in (404, 413)
    assert list_names(client, "fields") == ["north", "south"]
    copied = client.post("/api/v1/fields/denmark/copy", json={"name": "mine"}, headers=dict(token))
    assert copied.status_code == 201 and not copied.json()["sample"]
    assert client.get("/api/v1/fields/mine/summary").json()["field"]["area_ha"] > 0
    assert client.patch("/api/v1/fields/north", json={"name": "north"}, headers=dict(token)).status_code == 200


def test_only_the_owner_and_an_administrator_change_a_thing(app: FastAPI, client: TestClient, token: Header) -> None:
    other, chief, reader = bearer(app, "planner"), bearer(app, "admin"), bearer(app, "read")
    add_field(client, token, "north")
    job = ask_plan(client, token, "north")
    attempts: list[tuple[str, str, Any]] = [
        ("PATCH", "fields/north", {"name": "north"}), ("DELETE", "fields/north", None),
        ("PATCH", f"plans/{job['id']}", {"name": "mine"}), ("POST", f"plans/{job['id']}/cancel", None),
        ("DELETE", f"plans/{job['id']}", None),
    ]  # fmt: skip
    for method, path, body in attempts:
        answer = client.request(method, f"/api/v1/{path}", json=body, headers=other)
        assert answer.status_code == 403 and "belongs to the token 'a operator planner'" in answer.json()["error"], path
        assert client.request(method, f"/api/v1/{path}", json=body).status_code == 401, "a browser only looks"
        assert client.request(method, f"/api/v1/{path}", json=body, headers=reader).status_code == 403
    assert add_field(client, other, "north", LARGER, replace="true").status_code == 403
    again = add(client, other, "fields", "north.geojson", SMALL, crs="EPSG:25832")
    assert again.status_code == 403, "how somebody else's field is read is his matter, too"
    assert add_field(client, other, "north").status_code == 201, "the same file, read in the same way, changes nothing"
    assert client.get("/api/v1/fields/north").content == SMALL and list_names(client, "fields") == ["north"]
    mine = client.post("/api/v1/fields/north/copy", json={"name": "mine"}, headers=other).json()
    assert mine["owner"] == "a planner"
    assert client.delete("/api/v1/fields/mine", headers=other).status_code == 204
    for method, path, body in attempts:
        answer = client.request(method, f"/api/v1/{path}", json=body, headers=chief)
        assert answer.status_code in (200, 204), answer.text


def test_a_replacement_that_is_no_field_or_whose_name_is_taken_while_it_is_read_replaces_nothing(
    app: FastAPI, client: TestClient, token: Header, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert add_field(client, token, "new", SMALL, replace="true").status_code == 201, "nothing was there to replace"
    assert add_field(client, token, "new", b"{}", replace="true").status_code == 422
    assert client.get("/api/v1/fields/new").content == SMALL
    read = app.state.reader.read

    async def read_slowly(*arguments: Any, **options: Any) -> None:
        await read(*arguments, **options)
        app.state.store.add_file("field", "north", SMALL, owner=Owner("somebody else", "0"))

    monkeypatch.setattr(app.state.reader, "read", read_slowly)
    assert add_field(client, token, "north", LARGER, replace="true").status_code == 403
    assert client.get("/api/v1/fields/north").content == SMALL


def test_what_was_there_before_owners_may_be_changed_by_every_planner(app: FastAPI, client: TestClient) -> None:
    app.state.store.add_file("field", "old", SMALL)
    old = app.state.store.add_job("plan", "old", {})
    planner = bearer(app, "planner")
    assert client.patch("/api/v1/fields/old", json={"name": "new"}, headers=planner).status_code == 200
    assert client.patch(f"/api/v1/plans/{old.id}", json={"name": "new"}, headers=planner).json()["name"] == "new"
    assert client.delete(f"/api/v1/plans/{old.id}", headers=planner).status_code == 204


def test_a_plan_is_renamed_copied_searched_and_deleted(app: FastAPI, client: TestClient, token: Header) -> None:
    store = app.state.store
    job = store.add_job("plan", "north till", {"field": "north"}, {"field/x": store.blobs.put_bytes(b"input")})
    running = store.add_job("plan", "running", {})
    store.claim_job("w")
    store.keep_results(job.number, results := {"result.json": b"{}", "map.png": b"p"})
    store.finish_job(job.number, "w", results)
    store.claim_job("w")
    copied = client.post(f"/api/v1/plans/{job.id}/copy", json={}, headers=dict(token)).json()
    assert copied["name"] == "north till copy" and copied["id"] != job.id and copied["status"] == "done"
    assert copied["results"] == ["map.png", "result.json"] and copied["request"] == {"field": "north"}
    path = f"/api/v1/plans/{running.id}"
    assert client.post(f"{path}/copy", json={}, headers=dict(token)).status_code == 409, "it is not done"
    client.patch(f"/api/v1/plans/{copied['id']}", json={"name": "Spring"}, headers=dict(token))
    assert list_names(client, "plans", "sprING") == ["Spring"] and list_names(client, "plans", "nothing") == []
    assert list_names(client, "days") == [] and list_names(client, "plans") == ["Spring", "running", "north till"]
    assert client.delete(f"/api/v1/plans/{job.id}", headers=dict(token)).status_code == 204
    assert client.get(f"/api/v1/plans/{copied['id']}/results/result.json").content == b"{}", (
        "a copy has its own results"
    )
    assert client.delete(path, headers=dict(token)).status_code == 204, "it runs, and is ended"
    assert list_names(client, "plans") == ["Spring"] and not store.report_job(running.number, "w")
    assert client.patch(f"/api/v1/days/{copied['id']}", json={"name": "x"}, headers=dict(token)).status_code == 404
    assert client.get(f"/api/v1/plans/{copied['id']}").json()["owner"] == "a operator planner"


def test_a_tractor_that_a_farm_names_stays(client: TestClient, token: Header) -> None:
    assert client.post("/api/v1/tractors/eg105/copy", json={"name": "mine"}, headers=dict(token)).status_code == 201
    farm = read_example_text("farm").replace('file = "eg105"', 'file = "mine.toml"').encode()
    assert add(client, token, "farms", "own.toml", farm).status_code == 201
    for answer in (
        client.delete("/api/v1/tractors/mine", headers=dict(token)),
        client.patch("/api/v1/tractors/mine", json={"name": "yours"}, headers=dict(token)),
    ):
        assert answer.status_code == 409 and "used by the farm 'own'" in answer.json()["error"]
    assert client.delete("/api/v1/farms/own", headers=dict(token)).status_code == 204
    assert client.delete("/api/v1/tractors/mine", headers=dict(token)).status_code == 204
