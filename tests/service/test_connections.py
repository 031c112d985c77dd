"""Connections that never finish are closed, and never keep a new one from its place."""

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import pytest
import uvicorn
import websockets.exceptions
import websockets.sync.client
from starlette.responses import PlainTextResponse, StreamingResponse
from starlette.types import Receive, Scope, Send

from planner.service.errors import BusyError
from planner.service.fleets.fleet_socket import PENDING_LIMITS, hold_place_until_connect
from planner.service.gateway.connection_limits import (
    ConnectionLimits,
    ConnectionRegistry,
    compute_network_key,
)
from planner.service.gateway.connection_protocol import (
    MOST_PER_TURN,
    LimitedWebSocket,
    RequestScheduler,
    build_limited_protocol_class,
)
from planner.service.gateway.request_gate import name_client
from tests.service.conftest import wait_until

REQUEST = b"GET / HTTP/1.1\r\nhost: x\r\n\r\n"
PATIENCE_S = 60.0  # for what takes a moment, on a machine that does much else


def make_book(**limits: float) -> tuple[ConnectionRegistry, list[float]]:
    now = [0.0]
    return ConnectionRegistry(ConnectionLimits(**limits), clock=lambda: now[0]), now  # type: ignore[arg-type]


def test_the_oldest_that_waits_gives_way_and_who_has_all_its_requests_under_way_gets_no_more() -> None:
    book, _ = make_book(per_address=2, total=10)
    gone: list[str] = []
    first = book.add_connection("a", lambda: gone.append("first"))
    book.add_connection("a", lambda: gone.append("second"))
    assert first is not None
    book.begin_request(first, is_known=True)
    third = book.add_connection("a", lambda: gone.append("third"))
    assert third is not None
    assert gone == ["second"] and len(book) == 2 and book.closed_by_reason == {"displaced": 1}
    book.begin_request(third, is_known=True)
    assert book.add_connection("a", lambda: None) is None and book.closed_by_reason["refused"] == 1
    assert book.add_connection("b", lambda: None) is not None
    book.end_request(third)
    book.end_request(first)
    assert book.add_connection("a", lambda: None) is not None
    assert gone == ["second", "third"], "one that was answered is as young as a new one"
    book.remove_connection(first)
    assert book.add_connection("a", lambda: None) is not None and len(gone) == 2


@pytest.mark.parametrize(
    ("total", "names", "known", "last"),
    [(4, ("a", "b1", "b2", "b3"), "", "b1"), (3, ("a1", "a2", "b"), "a", "b")],
    ids=["whatever it asks without a token", "where that is busy, another does"],
)
def test_the_address_that_has_the_most_gives_way(total: int, names: tuple[str, ...], known: str, last: str) -> None:
    book, _ = make_book(per_address=5, total=total)
    gone: list[str] = []
    for name in (*names, "c"):
        made = book.add_connection(name[0], lambda name=name: gone.append(name))  # type: ignore[misc]
        assert made is not None
        book.begin_request(made, is_known=name[0] == known)
    assert gone == [last] and book.closed_by_reason == {"displaced": 1}


@pytest.mark.parametrize(
    ("lasted_s", "received", "slow"),
    [(29.0, 0, False), (40.0, 40 * 511, True), (40.0, 40 * 513, False), (1801.0, 10**9, True)],
)
def test_a_body_may_come_slowly_but_not_for_ever(lasted_s: float, received: int, slow: bool) -> None:
    book, now = make_book(body_s=30.0, slowest_bytes_per_s=512.0)
    one = book.add_connection("a", lambda: None)
    assert one is not None and not book.is_body_too_slow(one)
    book.begin_request(one, is_known=False)
    now[0], one.received_bytes = lasted_s, received
    assert book.is_body_too_slow(one) == slow


async def small(scope: Scope, receive: Receive, send: Send) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        while (await receive())["type"] != "websocket.disconnect":
            await send({"type": "websocket.send", "text": "well"})
        return
    if scope["path"] == "/large":
        await StreamingResponse(bytes(2**16) for _ in range(2000))(scope, receive, send)
        return
    while (await receive()).get("more_body"):
        pass
    await PlainTextResponse("well")(scope, receive, send)


@contextmanager
def serve(book: ConnectionRegistry) -> Iterator[int]:
    config = uvicorn.Config(
        small, log_config=None, lifespan="off",
        http=build_limited_protocol_class(book, {"hl_op": True, "hl_read": False}.get),
        ws=LimitedWebSocket, timeout_keep_alive=30, ws_per_message_deflate=False,
    )  # fmt: skip
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        yield listening.getsockname()[1]
        server.should_exit = True
        thread.join(10.0)


def connect(port: int, words: bytes = b"") -> socket.socket:
    made = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    made.sendall(words)
    return made


def read_answer(one: socket.socket, count: int = 1) -> bool:
    """Whether so many answers come."""
    got = b""
    while got.count(b"well") < count:
        part = one.recv(1000)
        if not part:
            return False
        got += part
    return True


def test_who_sends_no_whole_header_or_trickles_it_is_closed_and_others_are_answered() -> None:
    book = ConnectionRegistry(ConnectionLimits(per_address=20, total=20, header_s=0.5))
    with serve(book) as port:
        idle = [connect(port, words) for words in (b"", b"GET / HT", b"GET / HTTP/1.1\r\nhost: x\r\n")]
        idle.append(connect(port, REQUEST + b"GET / HTTP/1.1\r\nho"))  # a second head, after a whole request
        with connect(port, REQUEST) as good:
            assert read_answer(good)
        with connect(port) as one, contextlib.suppress(ConnectionError):
            for letter in REQUEST[:20]:
                one.sendall(bytes([letter]))
                time.sleep(0.1)
        for one in idle:
            with contextlib.suppress(ConnectionError):
                while one.recv(65536):
                    pass
            one.close()
    assert book.closed_by_reason == {"no whole header": 5}


def test_a_body_that_does_not_come_and_an_answer_that_is_not_taken_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planner.service.gateway.connection_protocol.BODY_CHECK_PERIOD_S", 0.1)
    book = ConnectionRegistry(ConnectionLimits(header_s=5.0, body_s=0.4, stalled_s=0.5))
    with serve(book) as port:
        half = connect(port, b"POST / HTTP/1.1\r\nhost: x\r\ncontent-length: 1000\r\n\r\nhalf")
        deaf = connect(port, b"GET /large HTTP/1.1\r\nhost: x\r\n\r\n")
        wait_until(lambda: len(book.closed_by_reason) >= 2, PATIENCE_S)
        half.close()
        deaf.close()
    assert book.closed_by_reason == {"body too slow": 1, "answer not taken": 1}


def test_a_new_connection_finds_a_place_among_many_that_wait_and_all_are_given_back() -> None:
    book = ConnectionRegistry(ConnectionLimits(per_address=30, total=50, header_s=30.0))
    with serve(book) as port:
        idle = [connect(port) for _ in range(60)]
        with connect(port, REQUEST) as good:
            assert read_answer(good)
        assert len(book) <= 30 and book.closed_by_reason["displaced"] >= 30
        for one in idle:
            one.close()
        wait_until(lambda: len(book) == 0, PATIENCE_S)


def test_requests_on_one_connection_and_pipelined_ones_are_all_answered() -> None:
    book = ConnectionRegistry(ConnectionLimits(header_s=1.0))
    with serve(book) as port, connect(port, REQUEST * 3) as one:
        assert read_answer(one, 3)
        time.sleep(0.5)
        one.sendall(REQUEST)
        assert read_answer(one)
    assert "no whole header" not in book.closed_by_reason


def test_greetings_give_way_to_newer_ones() -> None:
    async def main() -> tuple[int, bool]:
        greetings, displaced = ConnectionRegistry(PENDING_LIMITS), 0

        async def wait() -> None:
            nonlocal displaced
            try:
                with hold_place_until_connect(greetings, "a"):
                    await asyncio.sleep(30)
            except BusyError:
                displaced += 1

        tasks = [asyncio.create_task(wait()) for _ in range(130)]
        await asyncio.sleep(0.05)
        found = displaced
        tasks[-1].cancel()
        results = await asyncio.gather(tasks[-1], return_exceptions=True)
        for task in tasks:
            task.cancel()
        return found, isinstance(results[0], asyncio.CancelledError)

    assert asyncio.run(main()) == (2, True)


def test_addresses_of_one_network_of_ipv6_count_as_one() -> None:
    first, same, other = map(compute_network_key, ("2001:db8::1", "2001:db8::ffff:2", "2001:db8:0:1::1"))
    assert first == same != other
    assert name_client({"client": ("2001:db8::1", 1)}) == name_client({"client": ("2001:db8::ffff:2", 2)}) == first
    assert compute_network_key("fe80::1%eth0") == compute_network_key("fe80::2")
    assert compute_network_key("192.0.2.7") == "192.0.2.7" and compute_network_key("odd:") == "odd:"


def test_few_are_admitted_at_once_and_many_in_turns_by_address() -> None:
    async def main() -> list[str]:
        turns, admitted = RequestScheduler(), list[str]()
        for number in range(MOST_PER_TURN + 6):
            turns.schedule_request("a", lambda number=number: admitted.append(f"a{number}"))  # type: ignore[misc]
        turns.schedule_request("b", lambda: admitted.append("b"))
        left = turns.schedule_request("b", lambda: admitted.append("never"))
        assert left is not None and len(admitted) == MOST_PER_TURN and len(turns) == 8
        left.admit = None
        while len(turns):
            await asyncio.sleep(0.001)
        return admitted

    admitted = asyncio.run(main())
    assert len(admitted) == MOST_PER_TURN + 7 and "never" not in admitted
    assert admitted.index("b") <= MOST_PER_TURN + 2, "another address does not wait for all of the first"


def test_an_operators_token_goes_first_so_many_times_a_second() -> None:
    now = [0.0]
    turns = RequestScheduler(lambda: now[0])
    assert [turns.can_skip_queue("x") for _ in range(22)].count(True) == 20
    assert turns.can_skip_queue("y") and not turns.can_skip_queue("x")
    now[0] = 1.0
    assert turns.can_skip_queue("x")


def test_an_operator_is_answered_at_once_while_hundreds_wait_for_their_turn() -> None:
    book = ConnectionRegistry(ConnectionLimits(per_address=500, total=500))
    with serve(book) as port:
        flood = [connect(port, REQUEST * 20) for _ in range(200)]
        took_s = []
        for _ in range(5):
            begun_s = time.monotonic()
            with connect(port, b"GET / HTTP/1.1\r\nhost: x\r\nAuthorization: Bearer hl_op\r\n\r\n") as one:
                assert read_answer(one)
            took_s.append(time.monotonic() - begun_s)
        for one in flood:
            one.close()
    assert sorted(took_s)[2] < 0.25, took_s


def test_a_link_of_many_pings_or_fragments_is_ended_and_an_ordinary_one_is_not() -> None:
    with serve(ConnectionRegistry()) as port:
        link_to = partial(websockets.sync.client.connect, f"ws://127.0.0.1:{port}/", compression=None)
        with link_to() as link:
            link.ping().wait(5.0)
            link.send(["a", "b", "c"])
            assert link.recv(5.0) == "well"
        with pytest.raises(websockets.exceptions.ConnectionClosed), link_to() as link:
            for _ in range(400):
                link.ping()
            link.recv(5.0)
        with pytest.raises(websockets.exceptions.ConnectionClosed), link_to() as link:
            link.send("x" for _ in range(400))
            link.recv(5.0)
