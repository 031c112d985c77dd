"""Open connections, and which of them are closed when there are too many.

A connection is idle unless it is answering a request with a known token. When there are too many, the address with the
most that has an idle one loses the oldest of these, so that a new one (perhaps an order to stop) gets in. An address
with too many gets another one only in place of an idle one of its own.
"""

from __future__ import annotations

import ipaddress
import logging
import time
from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

from planner.service.settings import LIMITS

GREETED_SCOPE_KEY = "headland.greeted"
"""Key of the ASGI scope of a link for the function to call once its first frame was accepted."""


class RateLimiter:
    """A bucket of tokens for each key, such as an address (token bucket, Turner).

    Tokens come back `per_s` a second, up to `burst`.
    """

    def __init__(self, per_s: float, burst: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._per_s, self._burst, self._clock = per_s, burst, clock
        self._remaining: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take_token(self, key: str = "") -> float:
        """Take a token; 0, or the seconds until there is one."""
        wait_s = self.measure_wait_s(key)
        self.spend_tokens(key, 0.0 if wait_s else 1.0)
        return wait_s

    def measure_wait_s(self, key: str) -> float:
        """Seconds until there is a token; 0 where there is one."""
        return max(0.0, 1.0 - self._count_tokens(key)) / self._per_s

    def spend_tokens(self, key: str, tokens: float) -> None:
        """Take tokens, also more than there are."""
        self._remaining[key] = self._count_tokens(key) - tokens, self._clock()
        self._remaining.move_to_end(key)
        if len(self._remaining) > LIMITS.most_tracked_keys:
            self._remaining.popitem(last=False)  # the key seen least recently has most of its tokens back

    def _count_tokens(self, key: str) -> float:
        remaining, last_time = self._remaining.get(key, (self._burst, 0.0))
        return min(self._burst, remaining + (self._clock() - last_time) * self._per_s)


@dataclass(eq=False)
class OpenConnection:
    """One connection of an address; `close` ends it at once. Times are of a monotonic clock."""

    address: str
    close: Callable[[], None]
    is_idle: bool = True
    begun_s: float | None = None
    received_bytes: int = 0


@dataclass
class ConnectionLimits:
    """Limits on the number of connections and on how slowly they may send (seconds, bytes per second).

    A head takes at most `header_s`. A body may take `body_s`, then it must come at `slowest_bytes_per_s` and end
    within `longest_body_s`. A client that does not read its answer is given `stalled_s`.
    """

    per_address: int = 256
    total: int = 1024
    header_s: float = 10.0
    body_s: float = 30.0
    stalled_s: float = 60.0
    slowest_bytes_per_s: float = 512.0
    longest_body_s: float = 1800.0


@dataclass
class ConnectionRegistry:
    """All connections except links (WebSockets), by age of each address; `closed_by_reason` counts closed ones."""

    limits: ConnectionLimits = field(default_factory=ConnectionLimits)
    clock: Callable[[], float] = time.monotonic
    closed_by_reason: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._by_address: dict[str, OrderedDict[OpenConnection, None]] = {}
        self._reported_s, self._unreported = float("-inf"), 0

    def __len__(self) -> int:
        return sum(map(len, self._by_address.values()))

    def add_connection(self, address: str, close: Callable[[], None]) -> OpenConnection | None:
        """A new connection; None where there is no room for it, so that it must be closed."""
        crowded, own = [], self._by_address.get(address, OrderedDict())
        if len(own) >= self.limits.per_address:
            crowded = [own]
        elif len(self) >= self.limits.total:
            crowded = sorted(self._by_address.values(), key=len, reverse=True)
        if crowded and not any(map(self._close_oldest_idle, crowded)):
            self.closed_by_reason["refused"] += 1
            return None
        connection = OpenConnection(address, close)
        self._by_address.setdefault(address, OrderedDict())[connection] = None
        return connection

    def remove_connection(self, connection: OpenConnection) -> None:
        """Forget a connection that is closed or has become a link."""
        of_address = self._by_address.get(connection.address)
        if of_address is not None:
            of_address.pop(connection, None)
            if not of_address:
                del self._by_address[connection.address]

    def begin_request(self, connection: OpenConnection, *, is_known: bool) -> None:
        """The head of a request is complete, with or without a known token."""
        connection.is_idle, connection.begun_s, connection.received_bytes = not is_known, self.clock(), 0

    def end_request(self, connection: OpenConnection) -> None:
        """The request is answered; the connection now counts as new."""
        connection.is_idle, connection.begun_s = True, None
        of_address = self._by_address.get(connection.address, OrderedDict())
        if connection in of_address:
            of_address.move_to_end(connection)

    def end_connection(self, connection: OpenConnection, reason: str) -> None:
        """Close a connection for a reason, which is counted, and logged at most once a minute."""
        self.remove_connection(connection)
        self.closed_by_reason[reason] += 1
        self._unreported += 1
        if self.clock() - self._reported_s >= LIMITS.report_period_s:
            logging.getLogger(__name__).warning(
                "Closed %d unfinished connections, the last of %s (%s); the next report follows in %.0f s at the "
                "earliest.", self._unreported, connection.address, reason, LIMITS.report_period_s,
            )  # fmt: skip
            self._reported_s, self._unreported = self.clock(), 0
        connection.close()

    def is_body_too_slow(self, connection: OpenConnection) -> bool:
        """Whether the body of a request arrives too slowly, or takes too long."""
        if connection.begun_s is None:
            return False
        lasted_s = self.clock() - connection.begun_s
        if lasted_s < self.limits.body_s:
            return False
        return (
            lasted_s > self.limits.longest_body_s
            or connection.received_bytes < lasted_s * self.limits.slowest_bytes_per_s
        )

    def _close_oldest_idle(self, rows: OrderedDict[OpenConnection, None]) -> bool:
        """Close the oldest idle connection; whether there was one."""
        oldest = next((each for each in rows if each.is_idle), None)
        if oldest is not None:
            self.end_connection(oldest, "displaced")
        return oldest is not None


def compute_network_key(host: str) -> str:
    """What counts as one address: of IPv6 the whole network that one machine usually has (/64)."""
    if ":" not in host:
        return host
    try:
        return str(ipaddress.IPv6Network((host.partition("%")[0], 64), strict=False))
    except ValueError:
        return host


def compute_connection_limits() -> ConnectionLimits:
    """Limits that leave room for links within what the system lets a process open.

    The number of files that may be open is raised as far as the system allows first.
    """
    try:
        import resource
    except ImportError:  # Windows has no such limit for sockets
        return ConnectionLimits()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most_files = min(hard, 65_536) if hard != resource.RLIM_INFINITY else 65_536
    if soft == resource.RLIM_INFINITY or soft < most_files:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most_files, hard))
        soft = most_files
    most = ConnectionLimits()
    total = max(16, min(most.total, (soft - LIMITS.reserved_files) // 2))
    return ConnectionLimits(per_address=min(most.per_address, max(8, total // 2)), total=total)
