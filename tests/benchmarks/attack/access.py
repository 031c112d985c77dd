"""Items 4, 5 and 10: who is let in without a token, through a proxy, and with a token that is for something else."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping

from tests.benchmarks.attack.plans import Line, lay_lines, make_fleet, write_plan
from tests.benchmarks.attack.robots import greet
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service
from tests.benchmarks.attack.squad import Squad, wait_for
from tests.benchmarks.attack.web import API, ask, square_field, upload

PUBLIC = re.compile(rf"{API}/(health|ready|docs|openapi\.json|asyncapi\.json)(/|$)")
"""Routes that tell nothing of farms, and may answer everybody."""
LET_IN = range(200, 400)
FARM = "farm.example"
PROXIES: dict[str, dict[str, str]] = {
    "as it is": {}, "X-Forwarded-Proto": {"X-Forwarded-Proto": "https"},
    "all headers": {"X-Forwarded-Proto": "https", "X-Forwarded-For": "192.0.2.7", "X-Real-IP": "192.0.2.7"},
}  # fmt: skip


def attack_without_token(service: Service, short: bool) -> list[Row]:
    """Item 4: every route that is read, without a token, as a proxy in front of the service would pass it on."""
    fleet = make_fleet(service, "read me", lay_lines(2, 50.0))
    upload(service.port, "fields", "mine.geojson", square_field(), service.token("planner"), local="true")
    paths = _list_paths(service, fleet)
    hosts = ("127.0.0.1", f"127.0.0.1:{service.port}", "localhost", "[::1]")
    open_paths = []
    for host in hosts[:1] if short else hosts:
        for path in paths:
            status = ask(service.port, "GET", path, headers={"Host": host}, timeout_s=30.0).status
            if status in LET_IN or status >= 500 or status == 0:
                open_paths.append(path)
    kind, _, _ = greet(service.port, fleet, "viewer", None, host="127.0.0.1")
    named = sorted({path.removeprefix(API) for path in open_paths})
    words = f"{len(named)} of {len(paths)} routes answer, link: {kind}" + (f"; {', '.join(named[:4])}" if named else "")
    return [Row("4", "every GET route, Host 127.0.0.1, no token", words, "none answers, no link",
                not named and kind != "welcome", {"routes": len(paths), "open": named, "link": kind})]  # fmt: skip


def _list_paths(service: Service, fleet: str) -> list[str]:
    """Every path that is read and is not for everybody, by the service's own description and what is known of it."""
    told = ask(service.port, "GET", f"{API}/openapi.json", token=service.token("admin")).json
    found = {f"{API}/jobs", f"{API}/events", f"{API}/tokens", f"{API}/fleets", f"{API}/fields", "/metrics"}
    for path, methods in dict(told.get("paths", {})).items():
        if "get" in methods:
            value = fleet if path.startswith((f"{API}/fleets", f"{API}/twins")) else "mine"
            found.add(re.sub(r"\{tractor\}|\{number\}", "1", path).replace("{id}", value))
    return sorted(re.sub(r"\{[^}]*\}", "mine", path) for path in found if not PUBLIC.match(path))


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


def attack_with_robot_token(service: Service, short: bool) -> list[Row]:
    """Item 10: a robot's token for what is not its own, one that has expired, and a robot that is displaced."""
    lines = lay_lines(2, 200.0)
    own = make_fleet(service, "own", lines)
    other = make_fleet(service, "other", lay_lines(2, 50.0))
    token = service.new_token(["robot"], own, 1)
    brief = service.new_token(["robot"], own, 2, lasts_s=6.0)
    made = time.monotonic()
    rows = [_try_rights(service, token, own, other), _displace(service, own, lines[:1])]
    time.sleep(max(0.0, 6.5 - (time.monotonic() - made)))
    kind, _, _ = greet(service.port, own, "tractor", brief, 2)
    status = ask(service.port, "GET", f"{API}/fleets/{own}", token=brief).status
    rows.append(Row("10c", "a token that ended half a second ago", f"link {kind}, HTTP {status}", "refused, 401",
                    kind != "welcome" and status == 401, {"link": kind, "status": status}))  # fmt: skip
    return rows


def _try_rights(service: Service, token: str, own: str, other: str) -> Row:
    """A robot's token where it has no business, and where it has."""
    port, may = service.port, []
    links = {"other fleet": (other, "tractor", 1), "other tractor": (own, "tractor", 2),
             "control": (own, "control", None), "view of other fleet": (other, "viewer", None)}  # fmt: skip
    for name, (fleet, role, tractor) in links.items():
        if greet(port, fleet, role, token, tractor)[0] == "welcome":
            may.append(name)
    plan = {"name": "robbed", "plan": write_plan(lay_lines(1, 20.0), 1.0)}
    asked = {"stop": ("POST", f"fleets/{own}/start", None), "make a fleet": ("POST", "fleets", plan),
             "delete a fleet": ("DELETE", f"fleets/{other}", None), "jobs": ("POST", "plans", {"field": "iwamizawa"}),
             "tokens": ("GET", "tokens", None), "read other fleet": ("GET", f"fleets/{other}", None),
             "read files": ("GET", "fields", None)}  # fmt: skip
    for name, (method, path, body) in asked.items():
        if ask(port, method, f"{API}/{path}", token=token, json_body=body).status not in (401, 403, 404):
            may.append(name)
    if upload(port, "fields", "robbed.geojson", square_field(), token, local="true").status != 403:
        may.append("upload")
    own_link = greet(port, own, "tractor", token, 1)[0]
    words = f"{len(may)} of 12 let in; own link {own_link}" + (f": {', '.join(may)}" if may else "")
    return Row("10a", "a robot's token for other things", words, "0; its own link welcome",
               not may and own_link == "welcome", {"may": may, "own": own_link})  # fmt: skip


def _displace(service: Service, fleet: str, lines: list[Line]) -> Row:
    """A second robot takes the place of one that drives."""
    first, second = Squad(service, fleet, lines, 1.0), Squad(service, fleet, lines, 1.0)
    first.robots[0].stays = False
    try:
        first.open()
        first.go(10.0)
        begin = time.monotonic()
        second.open()
        told = wait_for(lambda: first.robots[0].stop_heard_s >= begin, 3.0)
        seconds = first.robots[0].stop_heard_s - begin
    finally:
        first.close()
        second.close()
    words = f"told to stop after {seconds:.2f} s" if told else "link closed, not told to stop"
    return Row("10b", "a robot in whose place another one links", words, "told to stop",
               told, {"told": told, "closed_with": first.robots[0].closed_with})  # fmt: skip
