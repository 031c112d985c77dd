"""Fleets over HTTP, and what is left of them after a restart."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.service.api.refusals import add_refusals
from planner.service.links import fleets, frames, twins
from planner.service.links.clients import TRACTOR, Client
from planner.service.links.hub import Hub
from planner.service.settings import Settings
from planner.service.store import Store
from tests.service.fleets import fleet_plan
from vehicle.plan_file import plan_to_json

PLAN = fleet_plan(2, 2)
TEXT = plan_to_json(
    PLAN.plan, crs=None, origin_m=(1000.0, 2000.0), scenario={"field": "mine", "tractor": "eg105", "width_m": 2.0}
)


class InlineHub(Hub):
    """Works out in this process what others give to another one."""

    async def work(self, fn: Callable[..., Any], *arguments: Any) -> Any:
        return fn(*arguments)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fleets")


@pytest.fixture(scope="module")
def client(data: Path) -> Iterator[TestClient]:
    settings = Settings(data=data)
    store = Store(settings)
    hub = InlineHub(store)

    @asynccontextmanager
    async def life(app: FastAPI) -> Any:
        await hub.start()
        yield
        await hub.stop()

    app = FastAPI(lifespan=life)
    app.state.settings, app.state.store, app.state.hub = settings, store, hub
    for each in (fleets, twins):
        app.include_router(each.router, prefix="/api/v1")
    add_refusals(app, lambda parameter: parameter)
    token = store.new_token("anna", "control")
    with TestClient(app, base_url="http://127.0.0.1", client=("127.0.0.1", 4000)) as made:
        made.headers["authorization"] = f"Bearer {token}"
        yield made
    store.close()


def new(client: TestClient, **other: Any) -> Any:
    return client.post("/api/v1/fleets", json={"name": "north field", "plan": TEXT} | other)


def test_a_fleet_is_made_of_a_plan_started_and_stopped_by_whoever_may(client: TestClient) -> None:
    made = new(client)
    assert made.status_code == 201
    id = made.json()["id"]
    assert made.json()["fleet"]["state"] == "ready" and len(made.json()["tractors"]) == 2
    assert client.post(f"/api/v1/fleets/{id}/start").json()["fleet"]["state"] == "running"
    assert client.post(f"/api/v1/fleets/{id}/stop").json()["fleet"]["state"] == "stopped"
    assert client.post(f"/api/v1/fleets/{id}/start", headers={"authorization": ""}).status_code == 401
    assert id in [each["id"] for each in client.get("/api/v1/fleets").json()["items"]]
    assert client.get(f"/api/v1/fleets/{id}/recording").status_code == 404
    assert client.delete(f"/api/v1/fleets/{id}").status_code == 204
    assert client.get(f"/api/v1/fleets/{id}").status_code == 404
    assert client.post(f"/api/v1/fleets/{id}/start").status_code == 404


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"plan": "{}"}, "format_version"),
        ({"plan": "no-such-job"}, "no-such-job"),
        ({"plan": TEXT.replace("eg105", "/etc/passwd")}, "does not come with Headland"),
        ({"field": "nowhere"}, "no field 'nowhere'"),
        ({"deadline": "25:99"}, "25:99"),
        ({"times": 1000.0}, "times"),
        ({"name": "../up"}, "../up"),
    ],
)
def test_what_no_fleet_can_be_made_of_is_refused_in_a_sentence(
    client: TestClient, wrong: dict[str, Any], sentence: str
) -> None:
    answer = new(client, **wrong)
    assert answer.status_code in (404, 422)
    assert sentence in answer.json()["error"]


def test_what_cannot_be_planned_or_accepted_now_is_refused(client: TestClient) -> None:
    id = new(client).json()["id"]
    assert "No tractor has failed" in client.post(f"/api/v1/fleets/{id}/replan", json={}).json()["error"]
    assert client.post(f"/api/v1/fleets/{id}/replan", json={"without": [9]}).status_code == 422
    assert "not ready" in client.post(f"/api/v1/fleets/{id}/accept", json={"proposal": 1}).json()["error"]
    assert client.get(f"/api/v1/twins/{id}/1").json()["state"] is None
    assert client.post(f"/api/v1/twins/{id}/1/mend", json={}).status_code == 409
    assert client.get(f"/api/v1/twins/{id}/7").status_code == 422


def state(sequence: int, north_m: float) -> frames.State:
    at = datetime.fromtimestamp(2e9 + 0.1 * sequence, UTC)
    return frames.State(
        kind="state", id="t", sequence=sequence, time=at, easting_m=1000.0, northing_m=2000.0 + north_m,
        heading_deg=0.0, speed_mps=1.0, speed_command_mps=1.0, steering_command_deg=0.0, shuttle=1, start=1,
        mode="automatic", leg=0, leg_m=north_m, implement=1,
    )  # fmt: skip


def test_a_fleet_goes_on_after_a_restart_of_the_service(tmp_path: Path) -> None:
    store = Store(Settings(data=tmp_path))

    async def before() -> str:
        hub = InlineHub(store)
        fleet = await hub.create("north", TEXT, {}, {"times": 1.0, "way": "predict", "deadline_s": None, "files": {}})
        fleet.centre.start("anna", time.monotonic())
        tractor = Client(TRACTOR, "tractor 1", 0)
        fleet.join(tractor, time.monotonic())
        fleet.step(time.monotonic())  # its first leg is released
        for sequence in range(8):
            fleet.reported(tractor, state(sequence, 1.5 * sequence), time.monotonic())
        fleet.step(time.monotonic())
        await hub.keep(fleet)  # and then the service is killed
        return fleet.id

    async def after(id: str) -> None:
        hub = InlineHub(store)
        await hub.take_up()
        fleet = hub.fleet(id)
        assert fleet.centre.state == "running"
        assert fleet.centre.states[0].leg_m == pytest.approx(10.5)
        assert len([p for p in fleet.centre.painting.lines[0] if p is not None]) == 8
        tractor = Client(TRACTOR, "tractor 1", 0)
        fleet.join(tractor, time.monotonic())
        assert '"last_sequence":7' in str(await tractor.outbox.take())
        fleet.reported(tractor, state(7, 10.5), time.monotonic())  # sent again: nothing was lost, nothing is kept twice
        fleet.reported(tractor, state(8, 12.0), time.monotonic())
        await hub.keep(fleet)
        assert [row[0] for row in store.recording(id, 0)] == list(range(9))

    asyncio.run(after(asyncio.run(before())))
    store.close()
