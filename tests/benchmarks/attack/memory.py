"""Item 15: how much memory the process that stops tractors takes while large bodies are sent to it."""

import json
import re
import socket
import time
from collections import Counter
from pathlib import Path

from tests.benchmarks.attack.flooding import run_flood, run_threads
from tests.benchmarks.attack.plans import lay_lines, write_plan
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import HOST, Service
from tests.benchmarks.attack.squad import describe_stops, run_squad
from tests.benchmarks.attack.web import API, ask

MEGABYTE = 2**20
MOST_MB, BODY_MB, PART_BYTES = 400.0, 50, 2**16
LIMIT = f"{MOST_MB:.0f} MB at most, stop 0.5 s"


def attack_memory(service: Service, short: bool) -> list[Row]:
    """Large bodies of an operator: junk, a plan among blanks, in chunks; and uploads of a planner."""
    clients, rows = 8 if short else 40, list[Row]()
    operator, planner = service.token("operator", "planner"), service.token("planner")
    kinds = (("15a", "junk", operator, "fleets", False), ("15b", "a plan among blanks", operator, "fleets", False),
             ("15c", "a plan of many legs", operator, "fleets", False),
             ("15d", "junk in chunks", operator, "fleets", True),
             ("15e", "uploads", planner, "logs", False))  # fmt: skip
    with run_squad(service, 10) as squad:
        for item, kind, token, path, chunked in kinds:
            squad.go()
            arguments = (service.port, kind, token, path, clients, chunked)
            with run_flood(send_bodies, *arguments) as flood:
                time.sleep(3.0)
                stops = squad.measure_stops(("link", "HTTP"))
                result = flood.collect(300.0)
            for fleet in ask(service.port, "GET", f"{API}/fleets", token=operator).json["items"]:
                if fleet["name"].startswith("a plan"):
                    ask(service.port, "DELETE", f"{API}/fleets/{fleet['id']}", token=operator)
            words, held, values = describe_stops(stops)
            assert service.process is not None
            text = Path(f"/proc/{service.process.pid}/status").read_text()
            match = re.search(r"VmHWM:\s+(\d+)", text)
            peak_mb = int(match[1]) / 1024 if match else 0.0
            words = f"{peak_mb:.0f} MB; {result.get('statuses')}; {words}"
            rows.append(Row(item, f"{clients} bodies of {BODY_MB} MB: {kind}", words, LIMIT,
                            held and peak_mb <= MOST_MB, values | {"peak_mb": peak_mb, **result}))  # fmt: skip
    return rows


def send_bodies(port: int, kind: str, token: str, path: str, clients: int, chunked: bool) -> dict[str, object]:
    """Send one body with each of so many clients at the same time; the statuses."""
    statuses = Counter[str]()

    def send(number: int) -> None:
        begin, media, end = make_ends(kind, number)
        size = BODY_MB * MEGABYTE
        fill = (b"[]," * (PART_BYTES // 3 + 1))[:PART_BYTES] if "junk" in kind else b" " * PART_BYTES
        length = "Transfer-Encoding: chunked" if chunked else f"Content-Length: {size}"
        head = (f"POST {API}/{path} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\nContent-Type: {media}\r\n"
                f"{length}\r\nConnection: close\r\n\r\n")  # fmt: skip
        statuses[exchange(port, head, begin, fill, end, size, chunked)] += 1

    run_threads(send, clients)
    return {"statuses": dict(statuses)}


def make_ends(kind: str, number: int) -> tuple[bytes, str, bytes]:
    """The begin of a body, its media type and its end."""
    name = f"{kind} {number} {time.monotonic_ns() % 10**6}"
    if kind == "uploads":
        begin = f'--x\r\nContent-Disposition: form-data; name="file"; filename="{name}.csv"\r\n\r\ntime,x\r\n'
        return begin.encode(), "multipart/form-data; boundary=x", b"\r\n--x--\r\n"
    if "plan" in kind:
        lines = lay_lines(1, 50.0)
        plan = write_plan(lines, 1.0)
        if "many" in kind:
            leg = json.loads(plan)["tractors"][0][0]
            legs = json.dumps([leg] * 20_000).encode()
            plan = plan.replace(json.dumps([[leg]])[1:-1], legs.decode())
        return json.dumps({"name": name, "plan": plan}).encode(), "application/json", b""
    return b"[", "application/json", b"[]]"


def exchange(port: int, head: str, begin: bytes, fill: bytes, end: bytes, size: int, chunked: bool) -> str:
    """The status of the answer, or what came instead of it."""
    try:
        with socket.create_connection((HOST, port), 120.0) as link:
            link.sendall(head.encode())
            left = size - len(begin) - len(end)
            parts = [begin, *([fill] * (left // len(fill))), fill[: left % len(fill)], end]
            try:
                for part in parts:
                    if part:
                        link.sendall(b"%x\r\n%s\r\n" % (len(part), part) if chunked else part)
                if chunked:
                    link.sendall(b"0\r\n\r\n")
            except OSError:
                pass  # the answer may be there already
            answer = link.recv(64)
            return answer[9:12].decode() or "closed"
    except OSError as error:
        return type(error).__name__
