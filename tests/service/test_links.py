"""The link from the outside: a service in this process, clients over WebSocket."""

from __future__ import annotations

import csv
import io
import json
import time
import zipfile
from collections.abc import Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter
from starlette.testclient import TestClient, WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from planner.service.api.refusals import add_refusals
from planner.service.centre.operated import SEEN_S
from planner.service.centre.rules import Rules
from planner.service.links import fleets, frames, link
from planner.service.links import told as outgoing
from planner.service.links.asyncapi import document
from planner.service.links.hub import Hub
from planner.service.links.live import LiveFleet
from planner.service.links.outbox import Outbox
from planner.service.links.recording import log_csv
from planner.service.links.twinning import Twins
from planner.service.settings import Settings
from planner.service.store import Store
from tests.service.fleets import fleet_plan
from vehicle.measured.logs.reading import read_log

TOLD = TypeAdapter(outgoing.Told)
OF_KIND = {model.model_fields["kind"].default: model for model in outgoing.TOLD}


@dataclass
class Service:
    """A service with one fleet, and tokens by scope."""

    client: TestClient
    hub: Hub
    fleet: LiveFleet
    tokens: dict[str, str]

    def link(self, role: str, **hello: Any) -> WebSocketTestSession:
        """A client that has not yet said hello."""
        return self.client.websocket_connect(f"ws://127.0.0.1/api/v1/fleets/{self.fleet.id}/link", **hello)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    data: Path = tmp_path_factory.mktemp("service")
    given_settings = Settings(data=data)
    store = Store(given_settings)
    hub = Hub(store)

    @asynccontextmanager
    async def life(app: FastAPI) -> Any:
        await hub.start()
        yield
        await hub.stop()
        store.close()

    app = FastAPI(lifespan=life)
    app.state.settings, app.state.store, app.state.hub = given_settings, store, hub
    app.include_router(link.router, prefix="/api/v1")
    app.include_router(fleets.router, prefix="/api/v1")
    add_refusals(app, lambda parameter: parameter)
    tokens = {scope: store.new_token(scope, scope) for scope in ("read", "control")}
    begin = time.time()
    store.save_fleet("f1", "small", "{}", {"begin_s": begin, "times": 1.0, "way": "predict"})
    with TestClient(app, base_url="http://127.0.0.1", client=("127.0.0.1", 4000)) as client:
        fleet = LiveFleet("f1", "small", fleet_plan(3), Rules(), begin_s=begin)
        hub.add(fleet)
        yield Service(client, hub, fleet, tokens)


def hello(session: WebSocketTestSession, role: str, tractor: int | None = None, token: str | None = None) -> Any:
    """Say hello; the answer."""
    session.send_json({"kind": "hello", "role": role, "tractor": tractor, "token": token, "version": 1})
    return told(session)


def told(session: WebSocketTestSession) -> Any:
    """The next frame, which its model knows."""
    frame = session.receive_json()
    OF_KIND[frame["kind"]].model_validate(frame)
    return frame


def until(session: WebSocketTestSession, kind: str) -> Any:
    """The next frame of a kind."""
    for _ in range(400):
        frame = told(session)
        if frame["kind"] == kind:
            return frame
    raise AssertionError(f"no {kind} in 400 frames")


def state(sequence: int, **other: Any) -> dict[str, Any]:
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    return {
        "kind": "state", "id": "t", "sequence": sequence, "time": at, "easting_m": 1000.0, "northing_m": 2000.0,
        "heading_deg": 0.0, "speed_mps": 0.0, "speed_command_mps": 0.0, "steering_command_deg": 0.0, "shuttle": 1,
        "start": 0, "mode": "stopped", "leg": 0, "leg_m": 0.0, "implement": 0,
    } | other  # fmt: skip


def test_a_viewer_needs_no_token_here_is_shown_all_and_cannot_send(service: Service) -> None:
    with service.link("viewer") as viewer:
        assert hello(viewer, "viewer")["kind"] == "welcome"
        scene = until(viewer, "scene")
        assert [len(tractor["legs"]) for tractor in scene["tractors"]] == [3, 3, 3]
        assert scene["tractors"][1]["legs"][0]["points_m"][0] == [1020.0, 2000.0]
        assert until(viewer, "tick")["fleet"]["state"] == "ready"
        viewer.send_json({"kind": "stop_all"})
        assert "only watches" in until(viewer, "refused")["sentence"]
    assert service.fleet.centre.state == "ready"


@pytest.mark.parametrize("role", ["tractor", "control"])
@pytest.mark.parametrize("scope", [None, "read"])
def test_nobody_drives_or_orders_without_a_token_for_control(service: Service, role: str, scope: str | None) -> None:
    with service.link(role) as client:
        answer = hello(client, role, 1, None if scope is None else service.tokens[scope])
        assert answer["kind"] == "refused" and "control" in answer["sentence"]
        with pytest.raises(WebSocketDisconnect):
            client.receive_json()


def test_pages_of_other_sites_and_unknown_fleets_are_turned_away(service: Service) -> None:
    with service.link("viewer", headers={"origin": "http://evil.example"}) as client:
        assert "evil.example" in hello(client, "viewer")["sentence"]
    with service.client.websocket_connect("ws://127.0.0.1/api/v1/fleets/none/link") as client:
        assert "no live fleet" in client.receive_json()["sentence"]


def test_states_are_acknowledged_once_kept_and_not_kept_twice(service: Service) -> None:
    with service.link("tractor") as tractor:
        welcome = hello(tractor, "tractor", 1, service.tokens["control"])
        assert welcome["last_sequence"] == -1
        assert len(welcome["plan"]["tractors"][0]) == 3
        for sequence in range(5):
            tractor.send_json(state(sequence, northing_m=2000.0 + sequence))
        assert until(tractor, "ack")["sequence"] == 4
    with service.link("tractor") as tractor:  # the link was lost without a goodbye; it sends the last ones again
        assert hello(tractor, "tractor", 1, service.tokens["control"])["last_sequence"] == 4
        for sequence in range(3, 8):
            tractor.send_json(state(sequence, northing_m=2000.0 + sequence))
        while until(tractor, "ack")["sequence"] < 7:
            pass
        tractor.send_json({"kind": "goodbye"})
    rows = service.hub.store.recording("f1", 0)
    assert [row[0] for row in rows] == list(range(8))


def test_the_recording_is_a_log_that_diagnosis_reads(service: Service, tmp_path: Path) -> None:
    with service.link("tractor") as tractor:
        hello(tractor, "tractor", 3, service.tokens["control"])
        begin = time.time() - 3.0
        for sequence in range(30):
            at = datetime.fromtimestamp(begin + 0.1 * sequence, UTC).isoformat()
            tractor.send_json(state(sequence, time=at, northing_m=2000.0 + 0.1 * sequence, speed_mps=1.0, implement=1))
        while until(tractor, "ack")["sequence"] < 29:
            pass
    answer = service.client.get("/api/v1/fleets/f1/recording")
    assert answer.status_code == 200
    archive = zipfile.ZipFile(io.BytesIO(answer.content))
    path = tmp_path / "log.csv"
    path.write_bytes(archive.read("tractor-3.csv"))
    log = read_log(path)
    assert log.rows_used == 30 and log.speed_mps is not None and log.speed_mps[0] == 1.0


@pytest.mark.parametrize("at", ["0001-01-02T00:00:00Z", "2001-01-01T00:00:00Z", "9999-12-30T00:00:00Z"])
def test_a_state_of_a_wrong_clock_is_refused_and_known_to_nobody(service: Service, at: str) -> None:
    with service.link("tractor") as tractor:
        seen = hello(tractor, "tractor", 2, service.tokens["control"])["last_sequence"]
        tractor.send_json(state(seen + 1, time=at))
        refused = until(tractor, "refused")
        assert refused["sequence"] == seen + 1 and "set the clock" in refused["sentence"]
    assert service.fleet.recorder.seen[1] == seen


def test_a_state_that_waited_for_a_link_says_nothing_to_a_twin() -> None:
    clock = 1.9e9
    twins = Twins(fleet_plan(1), "predict", 1.0, clock - 1000.0)
    for age, there in ((600.0, False), (1.0, True)):
        at = datetime.fromtimestamp(clock - age, UTC).isoformat()
        twins.reported(0, frames.State.model_validate_json(json.dumps(state(0, time=at))), clock)
        assert (twins.items[0] is not None) == there


def test_a_log_leaves_out_what_was_sent_twice_and_what_goes_back_in_time() -> None:
    def row(sequence: int, time_s: float) -> list[Any]:
        return [sequence, time_s, 1.0, 2.0, 0.0, 0.0, 0.0, 0.0, None, 1, 0, 0, 0.0, "automatic"]

    text = log_csv([row(0, 0.0), row(1, 0.1), row(1, 0.1), row(2, 0.05), row(3, 0.3)])
    assert [line["time_s"] for line in csv.DictReader(io.StringIO(text))] == ["0.0", "0.1", "0.3"]


def test_stop_all_reaches_every_tractor_and_one_that_joins_later(service: Service) -> None:
    token = service.tokens["control"]
    with service.link("control") as operator, service.link("tractor") as tractor:
        hello(operator, "control", None, token)
        hello(tractor, "tractor", 2, token)
        operator.send_json({"kind": "start"})
        assert until(tractor, "resume") == {"kind": "resume"}
        assert until(tractor, "release")["released"] == 1
        operator.send_json({"kind": "stop_all"})
        assert until(tractor, "stop")["reason"] == "stopped by stop-all"
        with service.link("tractor") as other:
            hello(other, "tractor", 1, token)
            assert until(other, "stop")["reason"] == "stopped by stop-all"
        assert {"anna": 1, "what": "stop_all"}.items() >= {"what": until_event(operator, "stop_all")}.items()


def until_event(session: WebSocketTestSession, what: str) -> str:
    """The next event of this kind."""
    while True:
        event = until(session, "event")
        if event["what"] == what:
            return what


def test_a_lease_is_shown_to_both_and_only_the_holder_drives(service: Service) -> None:
    token = service.tokens["control"]
    with service.link("control") as one, service.link("control") as two, service.link("tractor") as tractor:
        hello(one, "control", None, token)
        hello(two, "control", None, token)
        hello(tractor, "tractor", 2, token)
        time.sleep(SEEN_S)  # since the test before has stopped all
        one.send_json({"kind": "resume"})
        tractor.send_json(state(1000, easting_m=1020.0, northing_m=2010.0, mode="remote"))
        one.send_json({"kind": "lease", "tractor": 2})
        assert until(one, "lease")["mine"] is True
        assert until(two, "lease")["mine"] is False
        two.send_json({"kind": "lease", "tractor": 2, "sequence": 7})
        refused = until(two, "refused")
        assert refused["sequence"] == 7 and "take it over" in refused["sentence"]
        two.send_json({"kind": "lease", "tractor": 2, "takeover": True})
        assert until(two, "lease")["mine"] is True
        assert until(one, "lease")["mine"] is False
        drive = {
            "kind": "command", "sequence": 0, "time": datetime.now(UTC).isoformat(), "tractor": 2,
            "steering_command_deg": -5.0, "speed_command_mps": 0.5,
        }  # fmt: skip
        one.send_json(drive)
        assert "not yours" in until(one, "refused")["sentence"]
        two.send_json(drive)
        command = until(tractor, "command")
        assert (command["steering_command_deg"], command["speed_command_mps"], command["shuttle"]) == (-5.0, 0.5, 1)
        assert until(tractor, "command")["speed_command_mps"] == 0.0  # nobody says so again: dead man
    assert service.fleet.centre.leases.holder(1) is None


def test_whose_token_is_revoked_is_turned_out_and_what_it_leased_is_free(service: Service) -> None:
    token = service.hub.store.new_token("leaver", "control")
    with service.link("control") as operator, service.link("control") as other:
        hello(operator, "control", None, token)
        hello(other, "control", None, service.tokens["control"])
        operator.send_json({"kind": "lease", "tractor": 1})
        assert until(operator, "lease")["mine"] is True
        service.hub.store.revoke_token("leaver")
        assert service.client.portal is not None
        service.client.portal.call(service.hub.check_tokens)
        assert "was revoked" in until(operator, "refused")["sentence"]
        with pytest.raises(WebSocketDisconnect) as end:
            operator.receive_json()
        assert end.value.code == 1008
        assert until(other, "tick") and service.fleet.centre.leases.holder(0) is None


JUNK = st.one_of(
    st.text(max_size=40), st.binary(max_size=40),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
        max_leaves=6,
    ).map(json.dumps),
    st.fixed_dictionaries(
        {}, optional={key: st.none() | st.floats() | st.text(max_size=4) for key in state(0) if key != "sequence"}
    ).map(lambda wrong: json.dumps(state(10**9) | wrong | {"leg": -1})),
)  # fmt: skip


def test_who_only_watches_and_talks_on_is_turned_out(service: Service) -> None:
    with service.link("viewer") as viewer:
        hello(viewer, "viewer")
        for _ in range(link.MOST_REFUSED):
            viewer.send_json({"kind": "stop_all"})
        with pytest.raises(WebSocketDisconnect) as end:
            while True:
                viewer.receive_json()
        assert end.value.code == 1008


@pytest.mark.parametrize("text", ["a\x00b", "line\nline", "\x7f"])
def test_no_text_passes_that_a_database_cannot_hold(service: Service, text: str) -> None:
    with service.link("tractor") as tractor:
        seen = hello(tractor, "tractor", 3, service.tokens["control"])["last_sequence"]
        ring = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
        for frame in (state(seen + 1, errors=[text]), {"kind": "obstacle", "polygon_m": ring, "name": text}):
            tractor.send_json(frame)
            assert "cannot be used" in until(tractor, "refused")["sentence"]


def test_a_fault_of_the_service_ends_no_link(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    with service.link("tractor") as tractor:
        seen = hello(tractor, "tractor", 3, service.tokens["control"])["last_sequence"]
        with monkeypatch.context() as patch:
            patch.setattr(service.fleet.centre, "reported", broken)
            tractor.send_json(state(seen + 1))
            refused = until(tractor, "refused")
        assert refused["sequence"] == seen + 1 and "fault of its own" in refused["sentence"]
        tractor.send_json(state(seen + 1))
        while until(tractor, "ack")["sequence"] < seen + 1:
            pass


@settings(max_examples=4)
@given(frames_sent=st.lists(JUNK, min_size=20, max_size=40))
def test_no_malformed_frame_passes_and_none_ends_a_stream(service: Service, frames_sent: list[str | bytes]) -> None:
    seen = service.fleet.recorder.seen[2]
    with service.link("tractor") as tractor:
        hello(tractor, "tractor", 3, service.tokens["control"])
        for each in frames_sent:
            if isinstance(each, bytes):
                tractor.send_bytes(each)
            else:
                tractor.send_text(each)
        for _ in frames_sent:
            until(tractor, "refused")
        assert service.fleet.recorder.seen[2] == seen
        tractor.send_json(state(seen + 1))
        while until(tractor, "ack")["sequence"] < seen + 1:
            pass


def test_a_slow_reader_gets_the_newest_tick_and_starts_afresh_when_too_much_waits() -> None:
    box = Outbox(most=3)
    box.put_newest("tick 1")
    box.put_newest("tick 2")
    assert box.dropped_ticks == 1
    for number in range(4):
        box.put(str(number))
    assert box.overflowed and len(box) == 1


def test_the_document_of_the_link_describes_every_frame_that_models_know() -> None:
    made = document()
    json.dumps(made)
    messages = made["components"]["messages"]
    assert {message["name"] for message in messages.values()} >= set(OF_KIND) | {"hello", "state", "command", "goodbye"}
    for message in messages.values():
        assert message["payload"]["$ref"].rsplit("/", 1)[1] in made["components"]["schemas"]
    assert made["components"]["schemas"]["State"]["additionalProperties"] is False
