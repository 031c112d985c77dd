"""A relay of TCP that the attacker has in between: it can be stopped or frozen, and shows what went through it."""

from __future__ import annotations

import json
import selectors
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from tests.benchmarks.attack.service import HOST

CHUNK = 65536


@dataclass(eq=False)
class Relay:
    """Passes what comes on its port to another one. `watch` is given what clients send, by connection."""

    to: tuple[str, int]
    watch: Callable[[int, bytes], None] | None = None
    frozen: threading.Event = field(default_factory=threading.Event)
    port: int = 0
    _listening: socket.socket | None = None
    _pairs: list[tuple[socket.socket, socket.socket]] = field(default_factory=list)

    def open(self) -> None:
        """Listen, on the port it had before if it had one."""
        self._listening = socket.create_server((HOST, self.port), backlog=128)
        self.port = self._listening.getsockname()[1]
        threading.Thread(target=self._accept, args=(self._listening,), daemon=True).start()

    def close(self) -> None:
        """Refuse new connections and cut those that there are."""
        if self._listening is not None:
            with suppress(OSError):
                self._listening.shutdown(socket.SHUT_RDWR)
            self._listening.close()
        for pair in self._pairs:
            _cut(pair)
        self._pairs.clear()

    def _accept(self, listening: socket.socket) -> None:
        number = 0
        while True:
            try:
                near, _ = listening.accept()
            except OSError:
                return
            number += 1
            threading.Thread(target=self._pass_on, args=(near, number), daemon=True).start()

    def _pass_on(self, near: socket.socket, number: int) -> None:
        while self.frozen.is_set():
            time.sleep(0.1)
        try:
            far = socket.create_connection(self.to, 5.0)
        except OSError:
            near.close()
            return
        self._pairs.append((near, far))
        with suppress(OSError, ValueError):
            self._copy(near, far, number)
        _cut((near, far))

    def _copy(self, near: socket.socket, far: socket.socket, number: int) -> None:
        """Copy both ways until one side ends; while it is frozen nothing is read."""
        with selectors.DefaultSelector() as poll:
            poll.register(near, selectors.EVENT_READ, far)
            poll.register(far, selectors.EVENT_READ, near)
            while True:
                for key, _ in poll.select(0.2):
                    while self.frozen.is_set():
                        time.sleep(0.05)
                    content = key.fileobj.recv(CHUNK)  # type: ignore[union-attr]
                    if not content:
                        return
                    if key.fileobj is near and self.watch is not None:
                        self.watch(number, content)
                    key.data.sendall(content)


@contextmanager
def run_relay(to: tuple[str, int], watch: Callable[[int, bytes], None] | None = None) -> Iterator[Relay]:
    """A relay that listens, closed afterwards."""
    relay = Relay(to, watch)
    relay.open()
    try:
        yield relay
    finally:
        relay.frozen.clear()
        relay.close()


def _cut(pair: tuple[socket.socket, socket.socket]) -> None:
    for end in pair:
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
        end.close()


class States:
    """What a robot says in the frames of its link that pass a relay."""

    def __init__(self) -> None:
        self.states: dict[int, dict[str, Any]] = {}
        self._rest: dict[int, bytes] = {}
        self._lock = threading.Lock()

    def watch(self, number: int, content: bytes) -> None:
        """Bytes of one connection, which begins with the request of its handshake."""
        with self._lock:
            rest = self._rest.get(number, b"") + content
            if rest.startswith(b"GET "):
                head, end, rest = rest.partition(b"\r\n\r\n")
                rest = rest if end else head
            self._rest[number] = rest if rest.startswith(b"GET ") else self._take_frames(rest)

    def _take_frames(self, rest: bytes) -> bytes:
        """Take whole frames (RFC 6455, masked as those of clients are); the bytes of one that is not whole yet."""
        while len(rest) >= 6:
            length, start = rest[1] & 0x7F, 2
            if length >= 126:
                size = 2 if length == 126 else 8
                length, start = int.from_bytes(rest[2 : 2 + size], "big"), 2 + size
            end = start + 4 + length
            if len(rest) < end:
                break
            mask, body = rest[start : start + 4], rest[start + 4 : end]
            if rest[0] & 0x0F == 1:
                self._take(bytes(byte ^ mask[place % 4] for place, byte in enumerate(body)))
            rest = rest[end:]
        return rest

    def _take(self, text: bytes) -> None:
        frame = json.loads(text)
        if frame.get("kind") == "state":
            self.states[int(frame["sequence"])] = frame
