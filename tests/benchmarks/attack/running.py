"""All attacks in order: which needs what, and what becomes of one that breaks.

Here too, links through a proxy with HTTPS (item 5), and connections that send nothing, half a header or half a body,
more than the service has descriptors (item 8).
"""

import resource
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from tests.benchmarks.attack.flooding import UNFINISHED, hold_connections, run_flood
from tests.benchmarks.attack.freezing import attack_with_bodies, attack_with_reads
from tests.benchmarks.attack.memory import attack_memory
from tests.benchmarks.attack.plans import lay_lines, make_fleet
from tests.benchmarks.attack.robots import greet
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service, run_service
from tests.benchmarks.attack.squad import Stop, describe_stops, run_squad
from tests.benchmarks.attack.uploads import attack_readers
from tests.benchmarks.attack.web import API, ask

FARM = "farm.example"
PROXIES: dict[str, dict[str, str]] = {
    "as it is": {}, "X-Forwarded-Proto": {"X-Forwarded-Proto": "https"},
    "all headers": {"X-Forwarded-Proto": "https", "X-Forwarded-For": "192.0.2.7", "X-Real-IP": "192.0.2.7"},
}  # fmt: skip

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


def attack_through_proxy(service: Service, short: bool) -> list[Row]:
    """Item 5: links as a proxy with HTTPS on port 443 passes them, of the page and of a page of another site."""
    fleet = make_fleet(service, "behind https", lay_lines(2, 50.0))
    token, rows = service.token("operator", "planner"), list[Row]()
    for number, (how, added) in enumerate(PROXIES.items()):
        if short and number == 2:
            continue
        kind, sentence = _greet_from(service, fleet, token, f"https://{FARM}", added)
        rows.append(Row(f"5{'abc'[number]}", f"link of https://{FARM}, Host {FARM}, {how}",
                        f"{kind} {sentence[:60]}".strip(), "welcome", kind == "welcome",
                        {"answer": kind, "sentence": sentence}))  # fmt: skip
    kind, sentence = _greet_from(service, fleet, token, "https://evil.example", {})
    rows.append(Row("5d", f"link of https://evil.example, Host {FARM}", kind, "refused", kind != "welcome",
                    {"answer": kind, "sentence": sentence}))  # fmt: skip
    return rows


def _greet_from(service: Service, fleet: str, token: str, origin: str, added: Mapping[str, str]) -> tuple[str, str]:
    kind, sentence, _ = greet(service.port, fleet, "control", token, host=FARM, headers={"Origin": origin, **added})
    return kind, sentence


Shared = Callable[[Service, bool], list[Row]]
Alone = Callable[[Sequence[str], bool], list[Row]]

ENTRANCES: dict[int, Shared] = {5: attack_through_proxy, 1: attack_readers}
LOADS: dict[int, Shared] = {2: attack_with_bodies, 3: attack_with_reads, 15: attack_memory}
"""Attacks that share one service."""
SHORTAGES: dict[int, Alone] = {8: attack_with_connections}
"""Attacks on a service of their own each."""
ITEMS = tuple(sorted({**ENTRANCES, **LOADS, **SHORTAGES}))


def attack(command: Sequence[str], items: Sequence[int] = ITEMS, *, short: bool = False) -> list[Row]:
    """Attack a service that `command` starts; the rows by item.

    One attack after the other, so that times are those of a machine that does nothing else; in the short form three at
    a time, as most of them wait for something.
    """
    raise_own_limit()
    rows, begin = list[Row](), time.monotonic()
    lanes = [lambda: _attack_shared(command, ENTRANCES, items, short, rows, begin),
             lambda: _attack_shared(command, LOADS, items, short, rows, begin),
             lambda: _attack_alone(command, SHORTAGES, items, short, rows, begin)]  # fmt: skip
    threads = [threading.Thread(target=lane) for lane in lanes]
    for thread in threads:
        thread.start()
        if not short:
            thread.join()
    for thread in threads:
        thread.join()
    _report(f"{len(rows)} rows", begin)
    return sorted(rows, key=lambda row: (int(row.item.rstrip("abcdef")), row.item))


def _attack_shared(
    command: Sequence[str], attacks: dict[int, Shared], items: Sequence[int], short: bool, rows: list[Row], begin: float
) -> None:
    """Attacks that share one service; where that does not start, none of them has been held."""
    chosen = [item for item in attacks if item in items]
    if not chosen:
        return
    try:
        with run_service(command) as service:
            while chosen:
                item = chosen.pop(0)
                rows.extend(_try(item, begin, partial(attacks[item], service, short)))
    except Exception as error:  # those that are left are rows too
        rows.extend(_make_broken_row(item, error) for item in chosen)


def _attack_alone(
    command: Sequence[str], attacks: dict[int, Alone], items: Sequence[int], short: bool, rows: list[Row], begin: float
) -> None:
    for item in attacks:
        if item in items:
            rows.extend(_try(item, begin, partial(attacks[item], command, short)))


def _try(item: int, begin: float, run: Callable[[], list[Row]]) -> list[Row]:
    """The rows of an attack; one that breaks has not been held."""
    _report(f"item {item} begins", begin)
    try:
        rows = run()
    except Exception as error:  # whatever it is: the others are still to be tried
        rows = [_make_broken_row(item, error)]
    for row in rows:
        _report(f"{row.item} {row.verdict}: {row.figure}", begin)
    return rows


def _make_broken_row(item: int, error: Exception) -> Row:
    return Row(str(item), "the attack itself", f"broke: {type(error).__name__}: {error}"[:160], "-", False)


def _report(words: str, begin: float) -> None:
    print(f"[{time.monotonic() - begin:6.1f} s] {words}", file=sys.stderr, flush=True)
