"""The link from the outside: a service in this process, clients over WebSocket."""

import asyncio
import csv
import io
import json
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter
from starlette.testclient import TestClient, WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from planner.fleet.model.rules import FleetRules
from planner.fleet.session import inbound_frames
from planner.fleet.session import outbound_messages as outgoing
from planner.fleet.session.clients import FrameOutbox
from planner.fleet.session.fleet_session import FleetSession
from planner.fleet.session.fleet_twins import FleetTwins
from planner.fleet.session.state_recorder import format_log_csv
from planner.service.access.browsers import LOGIN_COOKIE, BrowserLogins
from planner.service.fleets import fleet_socket
from planner.service.fleets.fleet_routes import build_asyncapi_document
from planner.service.fleets.fleet_sessions import FleetSessions
from planner.service.settings import ServiceSettings
from planner.service.store.service_store import Store
from planner.service.store.tables import TokenRow
from tests.examples import seldom
from tests.service.fleets import fleet_app, fleet_plan, state
from tests.service.one_process import SessionsHere
from vehicle.identification.logs.reader import read_log

TOLD = TypeAdapter(outgoing.OutboundMessage)
OF_KIND = {model.model_fields["kind"].default: model for model in outgoing.list_outbound_messages()}
JUNK = st.one_of(
    st.text(max_size=40),
    st.binary(max_size=40),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
        max_leaves=6,
    ).map(json.dumps),
    st.fixed_dictionaries(
        {}, optional={key: st.none() | st.floats() | st.text(max_size=4) for key in state(0) if key != "sequence"}
    ).map(lambda wrong: json.dumps(state(10**9) | wrong | {"leg": -1})),
)


@dataclass
class Service:
    """A service with one fleet, and tokens by scope; "robot 2" drives its tractor 2, "elsewhere" one of another."""

    client: TestClient
    hub: FleetSessions
    fleet: FleetSession
    tokens: dict[str, str]
    logins: BrowserLogins

    def link(self, role: str, **hello: Any) -> WebSocketTestSession:
        """A client that has not yet said hello."""
        return self.client.websocket_connect(f"ws://127.0.0.1/api/v1/fleets/{self.fleet.id}/link", **hello)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with run_service(tmp_path_factory.mktemp("service")) as running:
        yield running


@pytest.fixture
def own_service(tmp_path: Path) -> Iterator[Service]:
    """A service of a test whose tractors nobody moved before: one that was elsewhere is in doubt."""
    with run_service(tmp_path) as running:
        yield running


@contextmanager
def run_service(data: Path) -> Iterator[Service]:
    store = Store(ServiceSettings(data=data))
    hub = SessionsHere(store)
    app = fleet_app(store, hub)
    tokens = {scope: store.create_token_text(scope, scope) for scope in ("read", "planner", "operator", "admin")}
    begin = time.time()
    for fleet_id in ("f1", "f2"):
        store.save_fleet(fleet_id, "small", "{}", {"begin_s": begin, "times": 1.0, "way": "predict"})
    for number in (1, 2, 3):
        tokens[f"robot {number}"] = store.create_token_text(f"robot {number}", "robot", fleet="f1", tractor=number)
    tokens["elsewhere"] = store.create_token_text("elsewhere", "robot", fleet="f2", tractor=1)
    with TestClient(app, base_url="http://127.0.0.1", client=("127.0.0.1", 4000)) as client:
        fleet = FleetSession("f1", "small", fleet_plan(3), FleetRules(), begin_s=begin)
        hub.add(fleet)
        yield Service(client, hub, fleet, tokens, app.state.logins)
    store.close()


def hello(session: WebSocketTestSession, role: str, tractor: int | None = None, token: str | None = None) -> Any:
    """Say hello; the answer."""
    session.send_json({"kind": "connect", "role": role, "tractor": tractor, "token": token, "version": 1})
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


def test_a_viewer_needs_a_login_or_a_token_is_shown_all_and_cannot_send(service: Service) -> None:
    with service.link("viewer") as viewer:
        assert "scope 'read'" in hello(viewer, "viewer")["sentence"]
    cookie = f"{LOGIN_COOKIE}={service.logins.redeem_code(service.logins.code)}"
    with service.link("viewer", headers={"cookie": cookie}) as viewer:
        assert hello(viewer, "viewer")["kind"] == "welcome"
        scene = until(viewer, "scene")
        assert [len(tractor["legs"]) for tractor in scene["tractors"]] == [3, 3, 3]
        assert scene["tractors"][1]["legs"][0]["points_m"][0] == [1020.0, 2000.0]
        assert until(viewer, "tick")["fleet"]["state"] == "ready"
        viewer.send_json({"kind": "stop_all"})
        assert "only watches" in until(viewer, "refused")["sentence"]
        for _ in range(fleet_socket.MOST_REFUSED):
            viewer.send_json({"kind": "stop_all"})
        with pytest.raises(WebSocketDisconnect) as end:
            while True:
                viewer.receive_json()
        assert end.value.code == 1008, "who talks on is turned out"
    assert service.fleet.manager.state == "ready"


@pytest.mark.parametrize(
    "role, holder, words",
    [
        ("tractor", None, "'robot'"),
        ("tractor", "read", "'robot'"),
        ("tractor", "operator", "'robot'"),
        ("tractor", "robot 2", "tractor 2 of the fleet f1 alone"),
        ("tractor", "elsewhere", "tractor 1 of the fleet f2 alone"),
        ("control", None, "'operator'"),
        ("control", "read", "'operator'"),
        ("control", "planner", "'operator'"),
        ("control", "robot 1", "tractor 1 of the fleet f1 alone"),
        ("viewer", "elsewhere", "tractor 1 of the fleet f2 alone"),
    ],
)
def test_who_lacks_the_right_is_turned_away(service: Service, role: str, holder: str | None, words: str) -> None:
    with service.link(role) as client:
        answer = hello(client, role, 1, None if holder is None else service.tokens[holder])
        assert answer["kind"] == "refused" and words in answer["sentence"]
        with pytest.raises(WebSocketDisconnect):
            client.receive_json()


@pytest.mark.slow
def test_a_link_whose_token_expires_is_turned_out(service: Service) -> None:
    token = service.hub.store.create_token_text("guest", "operator", expires="1d")
    with service.link("control") as guest:
        hello(guest, "control", None, token)
        with service.hub.store.database.open_write_session() as session:
            guests = sa.update(TokenRow).where(TokenRow.name == "guest")
            session.execute(guests.values(expires="2026-01-01T00:00:00.000Z"))
        assert "has expired" in until(guest, "refused")["sentence"]  # the hub looks by itself, once a second


def test_a_page_behind_a_proxy_with_https_is_linked_and_those_of_other_sites_and_of_no_fleet_are_not(
    service: Service,
) -> None:
    behind = {"host": "farm.example", "origin": "https://farm.example"}
    forwarded = behind | {"x-forwarded-proto": "https", "x-forwarded-for": "192.0.2.7"}
    evil = [each | {"origin": "https://evil.example"} for each in (behind, forwarded, {})]
    for headers, kind in ((behind, "welcome"), (forwarded, "welcome"), *((each, "refused") for each in evil)):
        with service.link("control", headers=headers) as client:
            told = hello(client, "control", None, service.tokens["operator"])
            assert told["kind"] == kind and (kind == "welcome" or "evil.example" in told["sentence"])
    with service.client.websocket_connect("ws://127.0.0.1/api/v1/fleets/none/link") as client:
        assert "no live fleet" in client.receive_json()["sentence"]


@pytest.mark.slow
def test_states_are_acknowledged_once_kept_and_not_kept_twice(service: Service) -> None:
    with service.link("tractor") as tractor:
        welcome = hello(tractor, "tractor", 1, service.tokens["robot 1"])
        assert welcome["last_sequence"] == -1
        assert welcome["settings"]["horizon_s"] == until(tractor, "release")["horizon_s"] == 20.0
        assert len(welcome["plan"]["tractors"][0]) == 3
        for sequence in range(5):
            tractor.send_json(state(sequence, northing_m=2000.0 + sequence))
        acknowledged = [until(tractor, "ack")["sequence"]]
        while acknowledged[-1] < 4:  # a busy machine may keep the five in several goes
            acknowledged.append(until(tractor, "ack")["sequence"])
        assert acknowledged == sorted(set(acknowledged)) and acknowledged[-1] == 4
    with service.link("tractor") as tractor:  # the link was lost without a goodbye; it sends the last ones again
        assert hello(tractor, "tractor", 1, service.tokens["robot 1"])["last_sequence"] == 4
        for sequence in range(3, 8):
            tractor.send_json(state(sequence, northing_m=2000.0 + sequence))
        until_kept(tractor, 7)
        tractor.send_json({"kind": "disconnect"})
    rows = service.hub.store.read_recording("f1", 0)
    assert [row[0] for row in rows] == list(range(8))


@pytest.mark.slow
def test_the_recording_is_a_log_that_diagnosis_reads(service: Service, tmp_path: Path) -> None:
    with service.link("tractor") as tractor:
        hello(tractor, "tractor", 3, service.tokens["robot 3"])
        begin = time.time() - 3.0
        for sequence in range(30):
            at = datetime.fromtimestamp(begin + 0.1 * sequence, UTC).isoformat()
            tractor.send_json(state(sequence, time=at, northing_m=2000.0 + 0.1 * sequence, speed_mps=1.0, implement=1))
        until_kept(tractor, 29)
    reads = {"authorization": f"Bearer {service.tokens['read']}"}
    answer = service.client.get("/api/v1/fleets/f1/recording", headers=reads)
    assert answer.status_code == 200
    archive = zipfile.ZipFile(io.BytesIO(answer.content))
    assert {entry.external_attr >> 16 for entry in archive.infolist()} == {0o600}  # where it is unpacked, for its owner
    path = tmp_path / "log.csv"
    path.write_bytes(archive.read("tractor-3.csv"))
    log = read_log(path)
    assert log.rows_used == 30 and log.speed_mps is not None and log.speed_mps[0] == 1.0


@pytest.mark.parametrize("at", ["0001-01-02T00:00:00Z", *seldom("2001-01-01T00:00:00Z", "9999-12-30T00:00:00Z")])
def test_a_state_of_a_wrong_clock_is_taken_and_dated_by_the_clock_of_the_service(service: Service, at: str) -> None:
    with service.link("tractor") as tractor:
        seen = hello(tractor, "tractor", 2, service.tokens["robot 2"])["last_sequence"]
        tractor.send_json(state(seen + 1, time=at, easting_m=1020.0))  # on its own way, and not on that of another
        until_kept(tractor, seen + 1)
    assert service.fleet._state_times_s[1] == pytest.approx(time.time(), abs=10.0)
    report = service.fleet.manager.states[1].report
    assert report is not None and report.time_s == pytest.approx(time.time(), abs=10.0)


def test_who_is_displaced_is_told_to_stand_before_its_link_ends_and_everybody_is_told(service: Service) -> None:
    token = service.tokens["robot 1"]
    with service.link("control") as operator, service.link("tractor") as first:
        hello(operator, "control", None, service.tokens["operator"])
        hello(first, "tractor", 1, token)
        with service.link("tractor") as second:
            assert hello(second, "tractor", 1, token)["kind"] == "welcome"
            said = []
            with pytest.raises(WebSocketDisconnect) as end:
                while True:
                    said.append(told(first))
            assert end.value.code == fleet_socket.REPLACED_CODE
            assert said[-1] == {"kind": "stop", "reason": "another link took the place of this tractor"}
            assert until_event(operator, "replaced") == "replaced"
            alarms = until(operator, "alarms")["items"]
            assert [(each["tractor"], each["over"]) for each in alarms if each["code"] == "replaced"] == [(1, True)]
            assert until(second, "heartbeat") and service.fleet.manager.states[0].is_linked


def test_a_state_that_waited_for_a_link_says_nothing_to_a_twin() -> None:
    clock = 1.9e9
    twins = FleetTwins(fleet_plan(1), "predict", 1.0, clock - 1000.0)
    for age, there in ((600.0, False), (1.0, True)):
        at = datetime.fromtimestamp(clock - age, UTC).isoformat()
        frame = inbound_frames.StateFrame.model_validate_json(json.dumps(state(0, time=at)))
        twins.take_state(0, frame, clock - age, clock)
        assert (twins.items[0] is not None) == there


def test_a_log_leaves_out_what_was_sent_twice_and_what_goes_back_in_time() -> None:
    def row(sequence: int, time_s: float) -> list[Any]:
        return [sequence, time_s, 1.0, 2.0, 0.0, 0.0, 0.0, 0.0, None, 1, 0, 0, 0.0, "automatic"]

    text = format_log_csv([row(0, 0.0), row(1, 0.1), row(1, 0.1), row(2, 0.05), row(3, 0.3)])
    assert [line["time_s"] for line in csv.DictReader(io.StringIO(text))] == ["0.0", "0.1", "0.3"]


def test_stop_all_reaches_every_tractor(own_service: Service) -> None:
    token = own_service.tokens["operator"]
    with own_service.link("control") as operator, own_service.link("tractor") as tractor:
        hello(operator, "control", None, token)
        hello(tractor, "tractor", 2, own_service.tokens["robot 2"])
        operator.send_json({"kind": "start"})
        assert until(tractor, "resume") == {"kind": "resume"}
        assert until(tractor, "release")["base_end"] == 1
        operator.send_json({"kind": "stop_all"})
        assert until(tractor, "stop")["reason"] == "stopped by stop-all"
        with own_service.link("tractor") as other:
            hello(other, "tractor", 1, own_service.tokens["robot 1"])
            assert until(other, "stop")["reason"] == "stopped by stop-all"
        assert until_event(operator, "stop_all")


def test_a_lease_is_shown_to_both_and_only_the_holder_drives(own_service: Service) -> None:
    token = own_service.tokens["operator"]
    with own_service.link("control") as one, own_service.link("control") as two, own_service.link("tractor") as tractor:
        hello(one, "control", None, token)
        hello(two, "control", None, token)
        hello(tractor, "tractor", 2, own_service.tokens["robot 2"])
        one.send_json({"kind": "resume"})
        tractor.send_json(state(1000, easting_m=1020.0, northing_m=2010.0, mode="remote"))
        until(one, "tick")
        one.send_json({"kind": "lease", "tractor": 2})
        assert until(one, "lease")["is_yours"] is True
        assert until(two, "lease")["is_yours"] is False
        two.send_json({"kind": "lease", "tractor": 2, "sequence": 7})
        refused = until(two, "refused")
        assert refused["sequence"] == 7 and "take it over" in refused["sentence"]
        two.send_json({"kind": "lease", "tractor": 2, "takeover": True})
        assert until(two, "lease")["is_yours"] is True
        assert until(one, "lease")["is_yours"] is False
        wanted = {"steering_command_deg": -5.0, "speed_command_mps": 0.5, "time": datetime.now(UTC).isoformat()}
        drive = {"kind": "command", "sequence": 0, "tractor": 2} | wanted
        one.send_json(drive)
        assert "not yours" in until(one, "refused")["sentence"]
        two.send_json(drive)
        command = until(tractor, "command")
        assert (command["steering_command_deg"], command["speed_command_mps"], command["shuttle"]) == (-5.0, 0.5, 1)
        assert until(tractor, "command")["speed_command_mps"] == 0.0  # nobody says so again: dead man
    assert own_service.fleet.manager.lease_holders.get(1) is None


def until_kept(session: WebSocketTestSession, sequence: int) -> None:
    """Read on until a state is acknowledged."""
    while until(session, "ack")["sequence"] < sequence:
        pass


def until_event(session: WebSocketTestSession, what: str) -> str:
    """The next event of this kind."""
    while True:
        event = until(session, "event")
        if event["what"] == what:
            return what


def test_whose_token_is_revoked_is_turned_out_and_what_it_leased_is_free(service: Service) -> None:
    token = service.hub.store.create_token_text("leaver", "operator")
    with service.link("control") as operator, service.link("control") as other:
        hello(operator, "control", None, token)
        hello(other, "control", None, service.tokens["operator"])
        operator.send_json({"kind": "lease", "tractor": 1})
        assert until(operator, "lease")["is_yours"] is True
        service.hub.store.revoke_token("leaver")
        assert service.client.portal is not None and service.hub.book.refresh()
        service.client.portal.call(service.hub.check_tokens)
        assert "was revoked" in until(operator, "refused")["sentence"]
        with pytest.raises(WebSocketDisconnect) as end:
            operator.receive_json()
        assert end.value.code == 1008
        assert until(other, "tick") and service.fleet.manager.lease_holders.get(0) is None


@pytest.mark.parametrize("text", ["a\x00b", "line\nline", "\x7f"])
def test_no_text_passes_that_a_database_cannot_hold(service: Service, text: str) -> None:
    with service.link("tractor") as tractor:
        seen = hello(tractor, "tractor", 3, service.tokens["robot 3"])["last_sequence"]
        ring = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
        for frame in (state(seen + 1, errors=[text]), {"kind": "obstacle", "polygon_m": ring, "name": text}):
            tractor.send_json(frame)
            assert "cannot be used" in until(tractor, "refused")["sentence"]


def test_a_fault_of_the_service_ends_no_link(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    with service.link("tractor") as tractor:
        seen = hello(tractor, "tractor", 3, service.tokens["robot 3"])["last_sequence"]
        with monkeypatch.context() as patch:
            patch.setattr(service.fleet.manager, "take_report", broken)
            tractor.send_json(state(seen + 1))
            refused = until(tractor, "refused")
        assert refused["sequence"] == seen + 1 and "because of a fault" in refused["sentence"]
        tractor.send_json(state(seen + 1))
        until_kept(tractor, seen + 1)


@pytest.mark.slow
@settings(max_examples=4)
@given(frames_sent=st.lists(JUNK, min_size=20, max_size=40))
def test_no_malformed_frame_passes_and_none_ends_a_stream(service: Service, frames_sent: list[str | bytes]) -> None:
    seen = service.fleet.recorder.received[2]
    with service.link("tractor") as tractor:
        hello(tractor, "tractor", 3, service.tokens["robot 3"])
        for each in frames_sent:
            if isinstance(each, bytes):
                tractor.send_bytes(each)
            else:
                tractor.send_text(each)
        for _ in frames_sent:
            until(tractor, "refused")
        assert service.fleet.recorder.received[2] == seen
        tractor.send_json(state(seen + 1))
        until_kept(tractor, seen + 1)


def test_an_outbox_sends_stops_first_and_the_newest_tick_and_starts_afresh_when_too_much_waits() -> None:
    box = FrameOutbox()
    for text, kind, is_first in (("w", "welcome", False), ("b", "", False), ("s", "stop", True), ("t", "stop", True)):
        box.put_frame(text, kind, is_first=is_first)
    assert [text for text, _ in box._waiting] == ["w", "t", "s", "b"]
    box = FrameOutbox(most=3)
    box.replace_waiting_tick("tick 1")
    box.replace_waiting_tick("tick 2")
    assert asyncio.run(box.take_next_frame()) == "tick 2"
    for number in range(4):
        box.put_frame(str(number))
    assert box.overflowed and len(box) == 1


@pytest.mark.slow
def test_the_document_of_the_link_describes_every_frame_that_models_know() -> None:
    made = build_asyncapi_document()
    json.dumps(made)
    messages = made["components"]["messages"]
    sent = {"connect", "state", "command", "disconnect"}
    assert {message["name"] for message in messages.values()} >= set(OF_KIND) | sent
    for message in messages.values():
        assert message["payload"]["$ref"].rsplit("/", 1)[1] in made["components"]["schemas"]
    assert made["components"]["schemas"]["StateFrame"]["additionalProperties"] is False


@pytest.mark.slow
def test_stop_all_of_a_fleet_reaches_the_tractors_of_its_neighbour(service: Service) -> None:
    token = service.tokens["elsewhere"]
    other = FleetSession("f2", "beside", fleet_plan(1), FleetRules(), begin_s=time.time())
    service.hub.add(other)
    try:
        address = "ws://127.0.0.1/api/v1/fleets/f2/link"
        with service.client.websocket_connect(address) as tractor, service.link("control") as operator:
            hello(tractor, "tractor", 1, token)
            hello(operator, "control", None, service.tokens["operator"])
            other.manager.operators.start_fleet_work("bert", time.monotonic())
            assert until(tractor, "resume")
            operator.send_json({"kind": "stop_all"})
            assert until(tractor, "stop")["reason"] == "stopped by stop-all"
            assert until_event(operator, "stop_all of neighbours")
            assert other.manager.alarms.is_alarm_on("neighbour stopped", None)
    finally:
        assert service.client.portal is not None
        service.client.portal.call(service.hub.delete, "f2")
    assert not service.hub.neighbourhood.list_neighbours("f1")
