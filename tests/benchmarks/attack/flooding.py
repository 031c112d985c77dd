"""Many requests at a time, from processes of their own so that they do not slow down what is measured."""

import contextlib
import multiprocessing
import selectors
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from queue import Empty
from typing import Any

from tests.benchmarks.attack.service import HOST
from tests.benchmarks.attack.web import ask

SPAWN = multiprocessing.get_context("spawn")
JOIN_S, PAUSE_S = 30.0, 0.05
BEGUN = "begun"
HEAD = b"POST /api/v1/fleets HTTP/1.1\r\nHost: 127.0.0.1\r\n"
UNFINISHED = {
    "nothing": b"",
    "half a header": HEAD + b"X-Half: ",
    "half a body": HEAD + b"Content-Type: application/json\r\nContent-Length: 1000\r\n\r\n{",
}
"""What connections send before they fall silent."""


@dataclass
class Flood:
    """A flood that goes on; `results` has what came of it once it is over."""

    process: Any
    queue: Any
    results: dict[str, Any]

    def is_on(self) -> bool:
        """Whether it goes on."""
        return bool(self.process.is_alive())

    def collect(self, timeout_s: float = JOIN_S) -> dict[str, Any]:
        """What came of it, waited for."""
        if not self.results:
            with contextlib.suppress(Empty):
                self.results = self.queue.get(timeout=timeout_s)
        return self.results


@contextlib.contextmanager
def run_flood(what: Callable[..., dict[str, Any]], *arguments: Any) -> Iterator[Flood]:
    """A flood in a process of its own, begun; it ends by itself, or with the body."""
    queue = SPAWN.Queue()
    process = SPAWN.Process(target=_flood, args=(queue, what, arguments), daemon=True)
    process.start()
    flood = Flood(process, queue, {})
    try:
        assert queue.get(timeout=JOIN_S) == BEGUN
        yield flood
        flood.collect()
    finally:
        process.terminate()
        process.join(JOIN_S)


def _flood(queue: Any, what: Callable[..., dict[str, Any]], arguments: tuple[Any, ...]) -> None:
    queue.put(BEGUN)
    queue.put(what(*arguments))


def post_bodies(
    port: int, paths: list[str], token: str | None, size: int, clients: int, seconds: float, most: int
) -> dict[str, Any]:
    """Post JSON of `size` bytes that is nothing but empty lists, with so many clients, `most` requests each."""
    body = b"[" + b"[]," * ((size - 4) // 3) + b"[]]"
    until, statuses = time.monotonic() + seconds, Counter[int]()

    def post(number: int) -> None:
        for count in range(most):
            if time.monotonic() > until:
                return
            path, headers = paths[(number + count) % len(paths)], {"Content-Type": "application/json"}
            answer = ask(port, "POST", path, token=token, body=body, headers=headers, source=_source(number),
                         timeout_s=90.0)  # fmt: skip
            statuses[answer.status] += 1
            time.sleep(PAUSE_S)

    run_threads(post, clients)
    return {"statuses": dict(statuses)}


def read_often(port: int, paths: list[str], token: str | None, clients: int, seconds: float) -> dict[str, Any]:
    """Get paths in turn with so many clients at a time, one request each, waiting for at most some seconds."""
    statuses = Counter[int]()

    def read(number: int) -> None:
        answer = ask(port, "GET", paths[number % len(paths)], token=token, source=_source(number), timeout_s=seconds)
        statuses[answer.status] += 1

    run_threads(read, clients)
    return {"statuses": dict(statuses)}


def hold_connections(port: int, kinds: list[str], count: int, addresses: int, queue_seconds: float) -> dict[str, Any]:
    """Open connections that never finish; how many came about, and when the service has closed them.

    They come from so many addresses of this machine, and are held for `queue_seconds` at most.
    """
    begin, refused = time.monotonic(), 0
    poll, opened, closed = selectors.DefaultSelector(), 0, list[float]()
    for number in range(count):
        link = _connect(port, _source(number % addresses), UNFINISHED[kinds[number % len(kinds)]])
        if link is None:
            refused += 1
            continue
        opened += 1
        poll.register(link, selectors.EVENT_READ)
    while len(closed) < opened and time.monotonic() < begin + queue_seconds:
        for key, _ in poll.select(0.2):
            if _is_over(key.fileobj):
                poll.unregister(key.fileobj)
                closed.append(time.monotonic() - begin)
    return {"opened": opened, "refused": refused, "closed": len(closed), "last_closed_s": max(closed, default=None)}


def _connect(port: int, source: str, head: bytes) -> socket.socket | None:
    try:
        link = socket.create_connection((HOST, port), 2.0, (source, 0))
        link.sendall(head)
    except OSError:
        return None
    link.setblocking(False)
    return link


def _is_over(link: Any) -> bool:
    """Whether the service has closed a connection; what it has answered before is thrown away."""
    try:
        if link.recv(65536):
            return False
    except BlockingIOError:
        return False
    except OSError:
        pass
    link.close()
    return True


def _source(number: int) -> str:
    """An address of this machine that is not the operator's."""
    return f"127.0.{1 + number // 200 % 200}.{2 + number % 200}"


def run_threads(what: Callable[[int], None], count: int) -> None:
    """Do something so many times at once."""
    threads = [threading.Thread(target=what, args=(number,), daemon=True) for number in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
