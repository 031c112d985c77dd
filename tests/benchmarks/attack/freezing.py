"""Items 2 and 3: what large bodies and slow reads do to an order to stand."""

import time
from collections.abc import Callable
from typing import Any

from tests.benchmarks.attack.flooding import post_bodies, read_often, run_flood
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service
from tests.benchmarks.attack.squad import Squad, Stop, describe_stops, run_squad
from tests.benchmarks.attack.web import API, star_field, upload

MEGABYTE = 2**20
LIMIT = "last of the robots within 0.5 s"
JSON_PATHS = [f"{API}/fleets", f"{API}/plans", f"{API}/fleets/none/accept", f"{API}/days"]
SLOW_POINTS = 20_000
ARRIVES_S, COLLECT_S = 0.7, 120.0


def attack_with_bodies(service: Service, short: bool) -> list[Row]:
    """Item 2: large bodies of JSON without a token, of a reader and of a planner."""
    tractors, seconds = (10, 3.0) if short else (50, 15.0)
    large = 12 * MEGABYTE if short else 57 * MEGABYTE
    forms = (
        ("2a", "10 clients post 1 MB of [], without a token", None, MEGABYTE, 10),
        ("2b", f"a reader posts {large // MEGABYTE} MB of [],", "read", large, 1 if short else 2),
        ("2c", "10 clients of a planner post 1 MB of [],", "planner", MEGABYTE, 10),
    )
    rows = []
    with run_squad(service, tractors) as squad:
        for item, attacked, role, size, clients in forms:
            token = None if role is None else service.token(role)
            paths = JSON_PATHS if size == MEGABYTE else JSON_PATHS[:1]
            arguments = (service.port, paths, token, size, clients, seconds, 400)
            rows.append(_measure(squad, item, attacked, short, post_bodies, *arguments))
    return rows


def attack_with_reads(service: Service, short: bool) -> list[Row]:
    """Item 3: slow summaries, without a token and with one."""
    tractors, clients, seconds = (10, 60, 6.0) if short else (50, 120, 60.0)
    planner = service.token("planner")
    for number in range(3):
        upload(service.port, "fields", f"star{number}.geojson", star_field(SLOW_POINTS + number), planner, local="true")
    paths = [f"{API}/fields/star{number % 3}/summary?local=true&crs=EPSG:{32601 + number % 60}"
             for number in range(clients)]  # fmt: skip
    rows = []
    with run_squad(service, tractors) as squad:
        for item, who, token in (("3a", "without a token", None), ("3b", "of a reader", service.token("read"))):
            attacked = f"{clients} slow summaries {who}"
            arguments = (service.port, paths, token, clients, seconds)
            rows.append(_measure(squad, item, attacked, short, read_often, *arguments))
    return rows


def _measure(squad: Squad, item: str, attacked: str, short: bool, flood: Callable[..., Any], *arguments: Any) -> Row:
    """Stop by link and by HTTP while a flood goes on; in the long form in either order, and as long as it goes on."""
    stops, results = list[Stop](), list[Any]()
    for order in (("link", "HTTP"),) if short else (("link", "HTTP"), ("HTTP", "link")):
        squad.go()
        with run_flood(flood, *arguments) as going:
            time.sleep(ARRIVES_S)
            stops += squad.measure_stops(order)
            if going.is_on() and not short:
                squad.go()
                stops += squad.measure_stops(order)
            results.append(going.collect(COLLECT_S))
    words, held, values = describe_stops(stops)
    return Row(item, attacked, f"{words} ({len(squad.robots)} robots)", LIMIT, held, values | {"floods": results})
