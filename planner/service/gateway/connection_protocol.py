"""uvicorn's protocols with time limits, and with requests admitted by address in turn.

Reading the head of a request costs almost nothing, parsing and answering it half a millisecond. Each turn admits only
a few requests, fewer while the event loop is late, so that it always has time for stops; operators go first.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from planner.service.gateway.connection_limits import (
    GREETED_SCOPE_KEY,
    ConnectionRegistry,
    OpenConnection,
    RateLimiter,
    compute_network_key,
)
from planner.service.settings import LIMITS

TURN_S = 0.005
MOST_PER_TURN = 4

Admit = Callable[[], None]
REQUEST, ANSWER = "request", "answer"  # timers of a connection
BODY_CHECK_PERIOD_S = 5.0
END_OF_HEAD = re.compile(rb"\r?\n\r?\n")
BEARER_HEADER = re.compile(rb"\nauthorization:[ \t]*bearer[ \t]+(hl_[\w-]{1,200})[ \t]*\r?\n", re.IGNORECASE)
RankToken = Callable[[str], "bool | None"]
"""Whether the holder of a token operates fleets, and so goes first; None for an unknown token."""


@dataclass(slots=True, eq=False)
class QueueTicket:
    """A place in the queue; one whose `admit` is None has left it."""

    admit: Admit | None


class RequestScheduler:
    """Admits requests at once while there are few, else in turns. For use in one event loop."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._urgent_limiter = RateLimiter(LIMITS.most_urgent_per_s, LIMITS.most_urgent_per_s, clock)
        self._waiting: OrderedDict[str, deque[QueueTicket]] = OrderedDict()
        self._budget, self._turn_due_s = float(MOST_PER_TURN), 0.0
        self._timer: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        return sum(map(len, self._waiting.values()))

    def schedule_request(self, address: str, admit: Admit) -> QueueTicket | None:
        """Call `admit` now and return None, or at this address's turn and return the ticket until then."""
        if self._timer is None:
            self._budget = float(MOST_PER_TURN)
            self._schedule_next_turn()
        if not self._waiting and self._budget >= 1.0:
            self._budget -= 1.0
            admit()
            return None
        ticket = QueueTicket(admit)
        self._waiting.setdefault(address, deque()).append(ticket)
        return ticket

    def can_skip_queue(self, token: str) -> bool:
        """Whether an operator's request skips the queue: a limited number per second of one token do."""
        return self._urgent_limiter.take_token(token) == 0.0

    def _schedule_next_turn(self) -> None:
        self._turn_due_s = self._clock() + TURN_S
        self._timer = asyncio.get_running_loop().call_later(TURN_S, self._admit_next_requests)

    def _admit_next_requests(self) -> None:
        """Admit the next few; stop when nobody waits."""
        late = self._clock() - self._turn_due_s > LIMITS.late_turn_s
        self._budget = float(LIMITS.fewest_per_turn if late else MOST_PER_TURN)
        while self._budget >= 1.0 and self._waiting:
            address, tickets = next(iter(self._waiting.items()))
            ticket = tickets.popleft()
            if tickets:
                self._waiting.move_to_end(address)
            else:
                del self._waiting[address]
            admit = ticket.admit
            if admit is not None:
                self._budget -= 1.0
                admit()
        if self._waiting or self._budget < MOST_PER_TURN:
            self._schedule_next_turn()
        else:
            self._timer = None


def build_limited_protocol_class(connections: ConnectionRegistry, rank: RankToken) -> type[H11Protocol]:
    """The class of protocols whose connections share one registry and whose requests share one scheduler."""
    shared = {"connection_registry": connections, "request_scheduler": RequestScheduler()}
    return type("RegisteredProtocol", (LimitedProtocol,), shared | {"rank_token": staticmethod(rank)})


class LimitedProtocol(H11Protocol):
    """Closes who sends no whole header, sends a body too slowly or does not take an answer.

    What comes is only kept until the head of a request is whole; then the request waits for its turn.
    """

    connection_registry: ConnectionRegistry
    request_scheduler: RequestScheduler
    rank_token: RankToken
    _connection: OpenConnection | None = None
    _timers: dict[str, asyncio.TimerHandle]
    """Those of the head or the body of a request, and of an answer that is not taken."""
    _ticket: QueueTicket | None = None
    _is_admitted = False
    _has_known_token = False
    _buffered = b""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Register the connection, or close it where there is no room."""
        self._timers = {}
        super().connection_made(transport)
        self._connection = self.connection_registry.add_connection(self._address, transport.abort)
        if self._connection is None:
            transport.abort()
            return
        self._end_connection_later(REQUEST, self.connection_registry.limits.header_s, "no whole header")

    def connection_lost(self, exc: Exception | None) -> None:
        """Free the place in the registry."""
        self._unregister()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Hold data back until a request is admitted; count it after that."""
        if self._connection is None:
            return
        if self._is_admitted:
            self._connection.received_bytes += len(data)
            self._parse_and_time(lambda: super(LimitedProtocol, self).data_received(data))
            return
        self._buffered += data
        is_long = len(self._buffered) > LIMITS.most_head_bytes
        if self._ticket is not None or is_long:
            self.flow.pause_reading()
        if self._ticket is None and (is_long or END_OF_HEAD.search(self._buffered)):
            self._admit_or_queue(self._admit_request)

    def on_response_complete(self) -> None:
        """The next request gets its own time and turn, even where it arrived with the last."""
        if self._connection is None:
            super().on_response_complete()
            return
        self.connection_registry.end_request(self._connection)
        self._end_connection_later(REQUEST, self.connection_registry.limits.header_s, "no whole header")
        if self.conn.trailing_data[0]:
            self._ticket = self.request_scheduler.schedule_request(self._address, self._parse_next_request)
        else:
            self._is_admitted = False
            super().on_response_complete()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """A link stays in the registry until its first frame was accepted."""
        connection, self._connection = self._connection, None
        self._unregister()
        super().handle_websocket_upgrade(event)
        link = self.transport.get_protocol()
        if connection is not None and isinstance(link, LimitedWebSocket):
            link.register_connection(self.connection_registry, connection)
        elif connection is not None:
            self.connection_registry.remove_connection(connection)

    def pause_writing(self) -> None:
        """The client does not take its answer: start the time limit."""
        super().pause_writing()
        if ANSWER not in self._timers and self._connection is not None:
            self._end_connection_later(ANSWER, self.connection_registry.limits.stalled_s, "answer not taken")

    def resume_writing(self) -> None:
        """The client takes its answer again."""
        super().resume_writing()
        self._stop_timer(ANSWER)

    @property
    def _address(self) -> str:
        return compute_network_key(self.client[0]) if self.client else ""

    def _admit_or_queue(self, admit: Callable[[], None]) -> None:
        """Admit an operator's request now, any other in its turn."""
        match = BEARER_HEADER.search(self._buffered, 0, LIMITS.most_head_bytes)
        token = match[1].decode() if match else ""
        is_operator = self.rank_token(token) if token else None
        self._has_known_token = is_operator is not None
        if is_operator and self.request_scheduler.can_skip_queue(token):
            admit()
        else:
            self._ticket = self.request_scheduler.schedule_request(self._address, admit)

    def _admit_request(self) -> None:
        """Parse the data held back."""
        self._ticket, self._is_admitted = None, True
        buffered, self._buffered = self._buffered, b""
        if self._connection is not None:
            self.flow.resume_reading()
            self._parse_and_time(lambda: super(LimitedProtocol, self).data_received(buffered))

    def _parse_next_request(self) -> None:
        """Parse data that arrived with the last request."""
        self._ticket = None
        if self._connection is not None:
            self._parse_and_time(super().on_response_complete)

    def _parse_and_time(self, parse: Callable[[], None]) -> None:
        """Parse; where a request begins, the time limit of its head ends and that of its body begins."""
        before = self.cycle
        parse()
        if self.cycle is before or self._connection is None:
            return
        self._stop_timer(REQUEST)
        self.connection_registry.begin_request(self._connection, is_known=self._has_known_token)
        if self.cycle.more_body:
            self._check_body_speed()

    def _end_connection_later(self, timer: str, limit_s: float, reason: str) -> None:
        self._stop_timer(timer)
        self._timers[timer] = self.loop.call_later(limit_s, self._end_connection, reason)

    def _check_body_speed(self) -> None:
        """Check every few seconds that the body still arrives; pauses made by the service itself do not count."""
        if self._connection is None or self.cycle is None or not self.cycle.more_body:
            return
        if not self.flow.read_paused and self.connection_registry.is_body_too_slow(self._connection):
            self._end_connection("body too slow")
            return
        self._timers[REQUEST] = self.loop.call_later(BODY_CHECK_PERIOD_S, self._check_body_speed)

    def _end_connection(self, reason: str) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            self.connection_registry.end_connection(connection, reason)

    def _unregister(self) -> None:
        for timer in (REQUEST, ANSWER):
            self._stop_timer(timer)
        if self._ticket is not None:
            self._ticket.admit = None
        connection, self._connection = self._connection, None
        if connection is not None:
            self.connection_registry.remove_connection(connection)

    def _stop_timer(self, timer: str) -> None:
        if (running := self._timers.pop(timer, None)) is not None:
            running.cancel()


class LimitedWebSocket(WebSocketsSansIOProtocol):
    """A link with limits on pings, fragments, untaken answers and the time to close."""

    _control_frames, _second, _unparsed = 0, -1, b""
    _registration: tuple[ConnectionRegistry, OpenConnection] | None = None

    def register_connection(self, connections: ConnectionRegistry, connection: OpenConnection) -> None:
        """Stay in the registry until `leave_place`, so that others may displace the link."""
        self._registration, self.close_timeout = (connections, connection), LIMITS.close_timeout_s

    def unregister_connection(self) -> None:
        """The first frame was accepted, or the link is gone."""
        registration, self._registration = self._registration, None
        if registration is not None:
            registration[0].remove_connection(registration[1])

    def connection_lost(self, exc: Exception | None) -> None:
        """Free the place in the registry."""
        self.unregister_connection()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse a little at a time, and nothing while parsed frames wait, so that others get their turn."""
        is_first, self._unparsed = not self._unparsed, self._unparsed + data
        if is_first:
            self._parse_slice()

    def _parse_slice(self) -> None:
        """Parse the next slice; reading pauses while data remains."""
        if self.transport.is_closing():
            self._unparsed = b""
            return
        if not self.read_paused:
            size = LIMITS.parse_slice_bytes
            next_slice, self._unparsed = self._unparsed[:size], self._unparsed[size:]
            super().data_received(next_slice)
        if self._unparsed:
            self.transport.pause_reading()
            self.loop.call_later(LIMITS.parse_pause_s, self._parse_slice)
        elif not self.read_paused and not self.transport.is_closing():
            self.transport.resume_reading()

    def handle_connect(self, event: Any) -> None:
        """Give the route a function that says that the first frame was accepted."""
        super().handle_connect(event)
        if hasattr(self, "scope"):
            cast(dict[str, Any], self.scope)[GREETED_SCOPE_KEY] = self.unregister_connection

    def handle_ping(self) -> None:
        """Answer a ping, unless there are too many."""
        if self._enforce_frame_limits():
            super().handle_ping()

    def handle_cont(self, event: Any) -> None:
        """Take a fragment, unless there are too many."""
        if self._enforce_frame_limits():
            super().handle_cont(event)

    def _enforce_frame_limits(self) -> bool:
        """Whether a link stays within its limits; close it if not."""
        second = int(self.loop.time())
        self._control_frames = self._control_frames + 1 if second == self._second else 1
        self._second = second
        is_taking = self.transport.get_write_buffer_size() <= LIMITS.most_unsent_bytes
        if self._control_frames <= LIMITS.most_control_frames_per_s and is_taking:
            return True
        self.transport.abort()
        return False
