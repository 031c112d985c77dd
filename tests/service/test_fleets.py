"""Fleets over HTTP, and what is left of them after a restart."""

import asyncio
import json
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from planner.fleet.manager.finish_forecast import FinishDistribution
from planner.fleet.session import inbound_frames
from planner.fleet.session.clients import TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from planner.service.fleets import fleet_routes
from planner.service.fleets.fleet_routes import store_new_fleet
from planner.service.fleets.fleet_sessions import FleetSessions
from planner.service.settings import ServiceSettings
from planner.service.store.service_store import Store
from tests.service.conftest import store_done_job
from tests.service.fleets import fleet_app, format_small_plan, state

TEXT = format_small_plan()


class InlineHub(FleetSessions):
    """Works out in this process what others give to another one."""

    async def run_in_process(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return function(*arguments)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fleets")


@pytest.fixture(scope="module")
def client(data: Path) -> Iterator[TestClient]:
    store = Store(ServiceSettings(data=data))
    app = fleet_app(store, InlineHub(store))
    token = store.create_token_text("anna", "operator")
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


def test_a_fleet_of_a_planning_job_has_the_chances_that_were_drawn(client: TestClient) -> None:
    store: Store = client.app.state.store  # type: ignore[attr-defined]
    best = {"strategy": "circuit", "tractors": 2, "time_s": 40.0, "p50_s": 41.0, "p80_s": 42.0, "p95_s": 43.0}
    ranking = json.dumps({"best": best, "plans": [best]})
    results = {"plan.json": TEXT.encode(), "result.json": ranking.encode()}
    id = new(client, plan=store_done_job(store, results=results).id, deadline="23:59").json()["id"]
    live: FleetSession = client.app.state.hub.get_session(id)  # type: ignore[attr-defined]
    assert live.finish_distribution == FinishDistribution(40.0, 41.0, 42.0, 43.0)
    assert store.get_fleet(id).settings["chances"]["p95_s"] == 43.0  # for a restart
    done = store_done_job(store, results={"map.png": b"\x89PNG\xff", "result.json": ranking.encode()})
    answer = new(client, plan=done.id, result="map.png")
    assert answer.status_code == 422 and "JSON" in answer.json()["error"]


def test_a_fleet_of_a_planning_job_knows_the_field_of_the_job(plain: Store) -> None:
    old = plain.blobs.put_bytes(b"as it was")
    job = plain.add_job("plan", "north", {}, {"field/north.geojson": old, "farm/own.toml": plain.blobs.put_bytes(b"")})
    plain.add_file("field", "other", b"another", ".kml")
    wanted = fleet_routes.FleetRequest(name="north", plan=job.id)
    contents, kept = fleet_routes._read_replacement_files(plain, wanted)
    assert contents == {"field": (".geojson", b"as it was")} and kept == {"field": (".geojson", old)}
    given, _ = fleet_routes._read_replacement_files(plain, wanted.model_copy(update={"field": "other"}))
    assert given == {"field": (".kml", b"another")}
    assert fleet_routes._read_replacement_files(plain, wanted.model_copy(update={"plan": "{}"})) == ({}, {})


def test_the_deadline_of_a_fleet_is_by_default_that_of_its_plan(client: TestClient) -> None:
    text = format_small_plan(start_s=8 * 3600, deadline_s=17 * 3600)
    for asked, hour in (({}, 17), ({"deadline": "19:00"}, 19)):
        fleet = new(client, plan=text, **asked).json()["fleet"]
        at = datetime.fromtimestamp(time.time() + fleet["deadline_s"] + 60.0)
        assert at.hour == hour and 0.0 < fleet["deadline_s"] <= 90000.0
        assert fleet["probability"] is None  # nothing was drawn


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
    assert client.get(f"/api/v1/fleets/{id}").json()["recorded"] is False
    client.app.state.hub.get_session(id).recorder.received[1] = 0  # type: ignore[attr-defined]
    assert client.get(f"/api/v1/fleets/{id}").json()["recorded"] is True
    assert "No tractor remains" in client.post(f"/api/v1/fleets/{id}/replan", json={"without": [1, 2]}).json()["error"]
    assert client.post(f"/api/v1/fleets/{id}/replan", json={"without": [9]}).status_code == 422
    assert "not ready" in client.post(f"/api/v1/fleets/{id}/accept", json={"proposal": 1}).json()["error"]
    assert client.get(f"/api/v1/twins/{id}/1").json()["state"] is None
    assert client.post(f"/api/v1/twins/{id}/1/mend", json={}).status_code == 409
    assert client.get(f"/api/v1/twins/{id}/7").status_code == 422


def driven(sequence: int, leg_m: float) -> inbound_frames.StateFrame:
    """What a tractor says of its first leg."""
    at = datetime.fromtimestamp(time.time() - 15.0 + 1.5 * sequence, UTC).isoformat()
    speeds = {"speed_mps": 1.0, "speed_command_mps": 1.0}
    place = {"northing_m": 2000.0 + leg_m, "leg_m": leg_m, "start": 1, "mode": "automatic", "implement": 1}
    return inbound_frames.StateFrame.model_validate_json(json.dumps(state(sequence, time=at, **speeds, **place)))


def test_a_fleet_goes_on_after_a_restart_of_the_service(plain: Store) -> None:

    async def before() -> str:
        hub = InlineHub(plain)
        given = {"times": 1.0, "way": "predict", "deadline_s": None, "files": {}}
        fleet = await hub.create_session(store_new_fleet, plain, "north", TEXT, {}, given)
        fleet.manager.operators.start_fleet_work("anna", time.monotonic())
        tractor = FleetClient(TRACTOR, "tractor 1", 0)
        fleet.add_client(tractor, time.monotonic())
        fleet.step(time.monotonic())  # its first leg is released
        for sequence in range(8):
            fleet.take_state(tractor, driven(sequence, 1.5 * sequence), time.monotonic())
        fleet.step(time.monotonic())
        await hub.save(fleet)  # and then the service is killed
        return fleet.id

    async def after(id: str) -> None:
        hub = InlineHub(plain)
        await hub.restore_sessions()
        fleet = hub.get_session(id)
        assert fleet.manager.state == "running"
        assert fleet.manager.states[0].leg_m == pytest.approx(10.5)
        assert len([p for p in fleet.manager.coverage_lines[0] if p is not None]) == 8
        tractor = FleetClient(TRACTOR, "tractor 1", 0)
        fleet.add_client(tractor, time.monotonic())
        welcome = json.loads(str(await tractor.outbox.take_next_frame()))
        assert (welcome["last_sequence"], welcome["leg"], welcome["leg_m"]) == (7, 0, 10.5)
        # Sent again: nothing was lost, nothing is kept twice.
        fleet.take_state(tractor, driven(7, 10.5), time.monotonic())
        fleet.take_state(tractor, driven(8, 12.0), time.monotonic())
        await hub.save(fleet)
        assert [row[0] for row in plain.read_recording(id, 0)] == list(range(9))

    asyncio.run(after(asyncio.run(before())))


def test_fleets_are_there_as_soon_as_the_service_has_started(plain: Store) -> None:
    settings = {"times": 1.0, "way": "predict", "begin_s": 0.0}
    plain.save_fleet("good", "north", TEXT, settings)
    plain.save_fleet("bad", "south", TEXT, settings | {"times": "fast"})

    async def started() -> None:
        hub = InlineHub(plain)
        await hub.start()
        try:
            assert hub.get_session("good").tractor_count == 2
            assert [id for id, label in hub.labels.items() if label.fault] == ["bad"]
        finally:
            await hub.stop()

    asyncio.run(started())


def test_what_happened_is_written_once_when_the_service_ends_while_it_is_written(
    plain: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    writing, go_on, add_event = threading.Event(), threading.Event(), plain.add_event

    def slow(*arguments: Any) -> int:
        writing.set()
        assert go_on.wait(10.0)
        return add_event(*arguments)

    monkeypatch.setattr(plain, "add_event", slow)

    async def ended() -> None:
        hub = InlineHub(plain)
        given = {"times": 1.0, "way": "predict", "deadline_s": None, "files": {}}
        fleet = await hub.create_session(store_new_fleet, plain, "north", TEXT, {}, given)
        fleet.manager.log_event("anna", "seen once")
        fleet.send_pending_outputs()
        keeping = asyncio.create_task(hub.save(fleet))
        await asyncio.to_thread(writing.wait, 10.0)
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)
        go_on.set()
        await hub.stop()

    asyncio.run(ended())
    assert [event.what for event in plain.list_events()].count("seen once") == 1


def test_an_order_in_the_moment_of_the_end_keeps_nothing_from_ending(store: Store) -> None:
    async def ended() -> None:
        hub = FleetSessions(store)
        await hub.start()
        hub._order_given.set()
        await asyncio.sleep(0.0)  # who waits for orders is about to be woken
        await asyncio.wait_for(hub.stop(), 60.0)

    for _ in range(3):
        asyncio.run(ended())
