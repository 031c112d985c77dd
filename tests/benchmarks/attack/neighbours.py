"""Item 6: tractors of two fleets that drive at each other on one field."""

from __future__ import annotations

import math
import time
from typing import Any

import shapely
from shapely import affinity

from tests.benchmarks.attack.plans import Line, Point, make_fleet
from tests.benchmarks.attack.robots import Robot
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service
from tests.benchmarks.attack.squad import Squad

SPEED_MPS = 2.0
FAR_M = 30.0  # beyond which nobody measures boxes


def attack_with_two_fleets(service: Service, short: bool) -> list[Row]:
    """Two fleets head on, and in the long form crossing."""
    half = 20.0 if short else 60.0
    rows = [_drive_at_each_other(service, "6a", "head on", ((0.0, -half), (0.0, half)), ((0.0, half), (0.0, -half)))]
    if not short:
        line = (200.0 - half, 0.0), (200.0 + half, 0.0)
        rows.append(_drive_at_each_other(service, "6b", "crossing", ((200.0, -half), (200.0, half)), line))
    return rows


def _drive_at_each_other(service: Service, item: str, how: str, one: Line, other: Line) -> Row:
    squads = [Squad(service, make_fleet(service, f"{how} {number}", [line], SPEED_MPS), [line], SPEED_MPS)
              for number, line in enumerate((one, other))]  # fmt: skip
    try:
        for squad in squads:
            squad.open()
        begin = time.monotonic()
        for squad in squads:
            squad.order("start")
        until = begin + math.dist(*one) / SPEED_MPS + 5.0
        while time.monotonic() < until and not all(_is_at_end(squad.robots[0]) for squad in squads):
            time.sleep(0.1)
    finally:
        for squad in squads:
            squad.close()
    machine = draw_machine(squads[0].scene["tractors"][0])
    least_m = _find_least_distance(squads[0].robots[0], squads[1].robots[0], machine)
    driven_m = min(squad.robots[0].at_m for squad in squads)
    near = sorted({str(alarm["code"]) for squad in squads for alarm in squad.alarms})
    words = f"{least_m:.2f} m apart at the least, alarms: {', '.join(near) or 'none'}"
    values = {"least_m": round(least_m, 3), "alarms": near, "driven_m": round(driven_m, 1)}
    drove = max(squad.robots[0].at_m for squad in squads) > 1.0
    held = least_m > 0.0 and any(code.startswith("near") for code in near) and drove
    return Row(item, f"tractors of two fleets, {how}", words, "more than 0 m, and an alarm", held, values)


def _is_at_end(robot: Robot) -> bool:
    return robot.at_m > robot.length_m - 0.1


def draw_machine(told: dict[str, Any]) -> shapely.Geometry:
    """The outline of a machine that heads east with its antenna at the origin, by what the scene says of it."""
    boxes = told["boxes_m"]
    tractor = shapely.box(boxes["tail"], -boxes["half_width"], boxes["nose"], boxes["half_width"])
    tool = shapely.box(boxes["tool_tail"], -boxes["tool_half_width"], boxes["tool_front"], boxes["tool_half_width"])
    return affinity.translate(shapely.union(tractor, tool), -told["antenna_forward_m"])


def _find_least_distance(one: Robot, other: Robot, machine: shapely.Geometry) -> float:
    """The least distance of two machines while both drove, metres; 0 where they touch."""
    least, place = math.inf, 0
    for when, where in one.positions:
        while place + 1 < len(other.positions) and other.positions[place + 1][0] <= when:
            place += 1
        there = other.positions[place][1]
        if math.dist(where, there) < FAR_M:
            least = min(least, float(shapely.distance(_place(machine, one, where), _place(machine, other, there))))
    return least


def _place(machine: shapely.Geometry, robot: Robot, where: Point) -> shapely.Geometry:
    """The outline of a robot at a place."""
    (x, y), (x1, y1) = robot.line
    turned = affinity.rotate(machine, math.atan2(y1 - y, x1 - x), origin=(0.0, 0.0), use_radians=True)
    return affinity.translate(turned, *where)
