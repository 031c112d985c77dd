"""Saved plans of straight lines, as `headland plan --save` writes them."""

import itertools
import json
from collections.abc import Sequence
from typing import Any

from tests.benchmarks.attack.service import Service
from tests.benchmarks.attack.web import API, ask

ORIGIN_M = (500_000.0, 5_000_000.0)
CRS = "EPSG:32632"
APART_M, FAR_M = 20.0, 3000.0
Point = tuple[float, float]


Line = tuple[Point, Point]
GROUNDS = itertools.count(1)


def lay_lines(tractors: int, length_m: float) -> list[Line]:
    """Lines to the north side by side, on ground of their own: 3 km away from that of all others."""
    y = FAR_M * next(GROUNDS)
    return [((APART_M * number, y), (APART_M * number, y + length_m)) for number in range(tractors)]


def write_plan(lines: Sequence[Line], speed_mps: float) -> str:
    """One leg for each tractor, between two points in metres from ORIGIN_M."""
    return json.dumps({
        "format_version": 1, "crs": CRS, "origin_m": list(ORIGIN_M), "notes": {},
        "scenario": {"field": "mine", "tractor": "eg105", "width_m": 2.0},
        "tractors": [[_write_leg(number, line, speed_mps)] for number, line in enumerate(lines)],
    })  # fmt: skip


def _write_leg(number: int, line: Line, speed_mps: float) -> dict[str, Any]:
    return {
        "task": {"kind": "track", "number": number, "piece": 0}, "may_wait": False, "gear": 1, "implement": True,
        "speed_mps": speed_mps, "ground": "soil", "points_m": [list(point) for point in line], "gates": [],
    }  # fmt: skip


def make_fleet(service: Service, name: str, lines: Sequence[Line], speed_mps: float = 1.0) -> str:
    """The id of a new fleet; raises RuntimeError where it is refused."""
    token, body = service.token("operator", "planner"), {"name": name, "plan": write_plan(lines, speed_mps)}
    answer = ask(service.port, "POST", f"{API}/fleets", token=token, json_body=body, timeout_s=180.0)
    if answer.status != 201:
        raise RuntimeError(f"No fleet: {answer.status} {answer.body[:300]!r} {answer.why}")
    return str(answer.json["id"])
