"""Guidance lines of a saved plan: what its tractors drive with lowered implements, in longitude and latitude."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
import shapely

from fields.arrays import Floats
from fields.formats.guidance import (
    HEADLAND_PASS,
    SWATH,
    DegreePoints,
    GuidanceArea,
    GuidanceFormat,
    GuidedLine,
    PlanGuidance,
    TractorLines,
)
from fields.geometry.arithmetic import EDGE_M
from fields.geometry.geodesy import LocalPlane, project
from fields.layout.contours import STRAIGHT_M
from planner.errors import RequestError, mark_parameter, suggest_name
from reports.common.palette import get_tractor_colour
from reports.plan.guidance_export import GUIDANCE_FORMATS, find_guidance_format
from strategies.lines.line_wishes import name_line
from vehicle.errors import MissionError
from vehicle.missions.plan import ENTER, LEAVE, REFILL, Leg, LegTask, Plan
from vehicle.missions.plan import SWATH as SWATH_TASK
from vehicle.missions.plan_file import SavedPlan

ConvertToDegrees = Callable[[Floats], DegreePoints]
"""Longitude and latitude of points (n, 2) in metres of a plan."""


def _convert_to_degrees(crs: str, origin_m: tuple[float, float], points_m: Floats) -> DegreePoints:
    """Longitude and latitude of points (n, 2) in metres of a plan with this coordinate system and origin."""
    degrees = project(points_m + np.asarray(origin_m), crs, "EPSG:4326")
    if (np.abs(degrees) > (180.0, 90.0)).any():
        raise RequestError(f"The plan lies outside the earth in {crs!r}; save the plan again.")
    return degrees


def build_guidance(saved: SavedPlan, tractor: int | None = None) -> PlanGuidance:
    """The guidance of a saved plan, or of one of its tractors, counted from 1.

    A line is what a tractor works in one go on a swath or a side of a headland pass; it has two points if it is
    straight to STRAIGHT_M. Its name gives tractor, driving order and swath: ``T1 03 track 14``.

    Raises:
        RequestError: the plan has no coordinate system, or no such tractor.
        MissionError: its outlines are garbled.
        FieldError: its coordinate system is unknown.
    """
    plan, count = saved.plan, saved.plan.tractors
    field = str(saved.ground.get("name") or saved.scenario.get("field") or "Field")
    if saved.crs is None:
        raise RequestError(
            f"The plan of field {field!r} is in local metres, and guidance needs longitude and latitude; plan a field "
            f"whose file says where on the earth it is (or give {mark_parameter('crs')}) and save that plan."
        )
    if tractor is not None and not 1 <= tractor <= count:
        raise RequestError(
            f"{mark_parameter('tractor')} is {tractor}; the plan has tractors 1 to {count}.", parameter="tractor"
        )
    convert = partial(_convert_to_degrees, saved.crs, saved.origin_m)
    tractor_numbers = range(1, count + 1) if tractor is None else (tractor,)
    tractors = tuple(
        TractorLines(number, get_tractor_colour(number - 1), tuple(_iter_lines(plan, number, convert)))
        for number in tractor_numbers
    )
    boundary, area_m2, inside, obstacles, entrance = _read_field_ground(saved.ground, field, convert)
    omissions = tuple(_count_omissions(plan, tractor_numbers).items())
    return PlanGuidance(field, boundary, area_m2, inside, obstacles, entrance, tractors, count > 1, omissions)


def find_format(format_name: str) -> GuidanceFormat:
    """The guidance format of this name; raises RequestError for an unknown one."""
    guidance_format = find_guidance_format(format_name)
    if guidance_format is None:
        format_names = [each.name for each in GUIDANCE_FORMATS]
        raise RequestError(
            f"{mark_parameter('to')} {format_name!r} is unknown{suggest_name(format_name, format_names)}; "
            f"use one of: {', '.join(format_names)}.",
            parameter="to",
        )
    return guidance_format


def _name_line(task: LegTask) -> str:
    """ "track 14b" or "round 1 side 2"."""
    if task.kind == SWATH_TASK:
        return f"track {name_line(task)}"
    return f"round {task.number or 0}" + (f" side {task.piece + 1}" if task.is_piece else "")


def _iter_lines(plan: Plan, number: int, convert: ConvertToDegrees) -> Iterator[GuidedLine]:
    """The lines of a tractor in driving order."""
    segments = list(_iter_worked_segments(plan.missions[number - 1].legs))
    digits = max(2, len(str(len(segments))))
    for order, (task, points_m) in enumerate(segments, start=1):
        line_name = _name_line(task)
        points = convert(points_m)
        yield GuidedLine(
            name=f"T{number} {order:0{digits}d} {line_name}",
            tractor=number,
            order=order,
            kind=SWATH if task.kind == SWATH_TASK else HEADLAND_PASS,
            description=line_name,
            points=points,
            length_m=float(np.hypot(*np.diff(points_m, axis=0).T).sum()),
            bearing_deg=_compute_bearing_deg(points),
        )


def _iter_worked_segments(legs: Sequence[Leg]) -> Iterator[tuple[LegTask, Floats]]:
    """Segments worked in one go: task and points (n, 2), two points if straight."""
    for (is_work, task, _), group in groupby(legs, key=lambda leg: (leg.task.is_work, leg.task, leg.gear)):
        if is_work:
            parts = [leg.points for leg in group]
            yield task, _simplify_line(np.concatenate([parts[0], *(part[1:] for part in parts[1:])]))


def _simplify_line(points: Floats) -> Floats:
    """The line without superfluous points."""
    ends = points[[0, -1]]
    chord = shapely.linestrings(ends)
    if (
        float(shapely.distance(shapely.points(points), chord).max()) <= STRAIGHT_M
        and np.hypot(*(ends[1] - ends[0])) > 0
    ):
        return ends
    simplified: Floats = shapely.get_coordinates(shapely.linestrings(points).simplify(EDGE_M, preserve_topology=False))
    return simplified


def _compute_bearing_deg(points: DegreePoints) -> float:
    """Direction from the first to the last point, clockwise from true north."""
    east_m, north_m = LocalPlane(float(points[0, 0]), float(points[0, 1])).to_metres(*points[-1].tolist())
    return math.degrees(math.atan2(east_m, north_m)) % 360.0


def _count_omissions(plan: Plan, tractor_numbers: Sequence[int]) -> dict[str, int]:
    """How often a plan has what guidance lines cannot show, by name."""
    counts: Counter[str] = Counter()
    for number in tractor_numbers:
        legs = plan.missions[number - 1].legs
        kinds = [kind for kind, _ in groupby(_classify_omitted_leg(leg, plan) for leg in legs) if kind]
        counts.update(kinds)
        counts["orders to give way"] += sum(bool(leg.gates) for leg in legs)
    return {what: count for what, count in sorted(counts.items()) if count}


def _classify_omitted_leg(leg: Leg, plan: Plan) -> str:
    """What a leg without a guidance line is counted as; "" for work."""
    if leg.task.is_work:
        return ""
    if leg.task.kind in (ENTER, LEAVE):
        return "ways in and out"
    if leg.task.kind != REFILL:
        return "turns"
    return "stops to unload" if plan.notes.collects else "stops to refill"


def _read_field_ground(
    ground: dict[str, Any], field: str, convert: ConvertToDegrees
) -> tuple[GuidanceArea | None, float, tuple[GuidanceArea, ...], tuple[GuidanceArea, ...], tuple[float, float] | None]:
    """Boundary, its area (m2), ground inside the headland, obstacles and entrance of a plan."""
    if not ground:
        return None, 0.0, (), (), None
    try:
        rings = _read_rings(ground["boundary_m"])
        inside = [_read_rings(one) for one in ground["inside_headland_m"]]
        obstacles = [(str(one["name"]), _read_rings(one["outline_m"])) for one in ground["obstacles"]]
        entrance = None if ground["entrance_m"] is None else _read_points(ground["entrance_m"]).reshape(1, 2)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise MissionError("The outlines of the field in the plan are garbled; save the plan again.") from None

    def build_area(name: str, rings: Sequence[Floats]) -> GuidanceArea:
        return GuidanceArea(name, tuple(convert(ring) for ring in rings))

    entrance_deg = None if entrance is None else convert(entrance)[0]
    return (
        build_area(field, rings),
        float(shapely.Polygon(rings[0], rings[1:]).area),
        tuple(build_area("inside of the headland", one) for one in inside),
        tuple(build_area(name, one) for name, one in obstacles),
        None if entrance_deg is None else (float(entrance_deg[0]), float(entrance_deg[1])),
    )


def _read_rings(raw_rings: Any) -> list[Floats]:
    """Rings of a polygon, each (n, 2); raises ValueError if they are none."""
    rings = [_read_points(ring) for ring in raw_rings]
    if not rings or any(ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3 for ring in rings):
        raise ValueError(raw_rings)
    return rings


def _read_points(raw_points: Any) -> Floats:
    points = np.array(raw_points, dtype=np.float64)
    if not np.isfinite(points).all():
        raise ValueError(raw_points)
    return points
