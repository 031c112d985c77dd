"""Item 8: connections that send nothing, half a header or half a body, more than the service has descriptors."""

import resource
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from tests.benchmarks.attack.flooding import UNFINISHED, hold_connections, run_flood
from tests.benchmarks.attack.robots import greet
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service, run_service
from tests.benchmarks.attack.squad import Stop, describe_stops, run_squad
from tests.benchmarks.attack.web import API, ask

FILES, COUNT = 1024, 1100
ARRIVE_S = 4.0
CLOSED_S, ANSWER_S, LOG_BYTES = 60.0, 2.0, 100_000
LIMIT = "stop 0.5 s, health and new link 2 s, all closed in 60 s, log 100 kB"


def attack_with_connections(command: Sequence[str], short: bool) -> list[Row]:
    """Item 8, from many addresses of this machine and, in the long form, from one."""
    rows = []
    for item, addresses in (("8a", 50),) if short else (("8a", 50), ("8b", 1)):
        with run_service(command, files=FILES) as service:
            rows.append(_hold(service, item, addresses, short))
    return rows


def _hold(service: Service, item: str, addresses: int, short: bool) -> Row:
    raise_own_limit()
    tractors, hold_s = (10, 35.0) if short else (50, CLOSED_S + 15.0)
    log = service.log_bytes()
    with run_squad(service, tractors) as squad:
        squad.go()
        with run_flood(hold_connections, service.port, list(UNFINISHED), COUNT, addresses, hold_s) as flood:
            time.sleep(ARRIVE_S)
            descriptors = service.descriptors()
            kind, _, seconds = greet(service.port, squad.fleet, "control", service.token("operator", "planner"))
            answers = {"health_s": _measure_health(service), "link_s": round(seconds, 3) if kind == "welcome" else None}
            stops = squad.measure_stops(("link", "HTTP"), timeout_s=20.0)
            after = flood.collect(hold_s + 30.0)
        after["health_after_s"] = _measure_health(service)
    written = service.log_bytes() - log
    return _judge(item, addresses, stops, {**answers, **after, "descriptors": descriptors, "log_bytes": written})


def _measure_health(service: Service) -> float | None:
    answer = ask(service.port, "GET", f"{API}/health", token=service.token("operator", "planner"), timeout_s=10.0)
    return round(answer.seconds, 3) if answer.status == 200 else None


def _judge(item: str, addresses: int, stops: list[Stop], values: dict[str, Any]) -> Row:
    words, held, stopped = describe_stops(stops)
    quick = all(values[key] is not None and values[key] <= ANSWER_S for key in ("health_s", "link_s", "health_after_s"))
    all_closed = values.get("opened") == values.get("closed")
    last = values.get("last_closed_s")
    closed = "all" if all_closed else f"{values.get('closed', 0)} of {values.get('opened', 0)}"
    when = f" after {last:.0f} s" if last is not None else ""
    words += (f"; health {_say(values['health_s'])}, new link {_say(values['link_s'])}; {values['descriptors']} of "
              f"{FILES} descriptors; log {values['log_bytes'] / 1000:.0f} kB; closed {closed}{when}")  # fmt: skip
    in_time = all_closed and (last is None or last <= CLOSED_S)
    places = "one address" if addresses == 1 else f"{addresses} addresses"
    return Row(item, f"{COUNT} unfinished connections from {places}", words, LIMIT,
               held and quick and in_time and values["log_bytes"] <= LOG_BYTES, stopped | values)  # fmt: skip


def _say(seconds: float | None) -> str:
    return "none" if seconds is None else f"{seconds:.2f} s"


def raise_own_limit() -> None:
    """Let this process, and those that it starts, have as many descriptors as it may."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
