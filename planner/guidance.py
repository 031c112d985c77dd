"""A saved plan as guidance: the lines that its tractors drive with their implements down, in longitude and latitude."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from fields.plane import Plane
from fields.projection import project
from planner.errors import ScenarioError, named, nearest
from planner.steps import track_names
from reports.guidance.form import Form
from reports.guidance.forms import FORMS, form_named
from reports.guidance.lines import ROUND, TRACK, Area, Degrees, Guidance, Line, TractorLines
from vehicle.errors import MissionError
from vehicle.missions import ENTER, LEAVE, REFILL, Leg, Plan, Task
from vehicle.missions import TRACK as ON_TRACK
from vehicle.plan_file import SavedPlan

STRAIGHT_M = 0.01
"""A line that leaves the one from its first to its last point by no more than this is straight."""
CURVE_M = 0.001
"""Points of a curve that lie no farther from the line between others are left out."""
ORDER_DIGITS = 2

Metres = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Frame:
    """Where the metres of a plan are on the earth."""

    crs: str
    origin_m: tuple[float, float]

    def degrees(self, points_m: Metres) -> Degrees:
        """Longitude and latitude of points (n, 2)."""
        found = project(points_m + np.asarray(self.origin_m), self.crs, "EPSG:4326")
        if (np.abs(found) > (180.0, 90.0)).any():
            raise ScenarioError(
                f"The metres of the plan are nowhere on the earth in {self.crs!r}; save the plan again."
            )
        return found


def guidance_of(saved: SavedPlan, tractor: int | None = None) -> Guidance:
    """The guidance of a saved plan; of one tractor alone, counted from 1, where it is given.

    A line is what a tractor drives in one go on a track or a side of a round; two points where it is straight to
    STRAIGHT_M. Its name has the tractor, its place in the driving order, and what it is: ``T1 03 track 14``.

    Raises:
        ScenarioError: the plan has no place on the earth, or no such tractor.
        MissionError: its outlines are garbled.
        FieldError: its coordinate system is unknown.
    """
    plan, count = saved.plan, saved.plan.tractors
    field = str(saved.ground.get("name") or saved.scenario.get("field") or "Field")
    if saved.crs is None:
        raise ScenarioError(
            f"The plan of field {field!r} is in local metres, and guidance needs longitude and latitude; plan a field "
            f"whose file says where on the earth it is (or give {named('crs')}) and save that plan."
        )
    if tractor is not None and not 1 <= tractor <= count:
        raise ScenarioError(
            f"{named('tractor')} is {tractor}; the plan has tractors 1 to {count}.", parameter="tractor"
        )
    frame = _Frame(saved.crs, saved.origin_m)
    wanted = range(1, count + 1) if tractor is None else (tractor,)
    words = _words(plan)
    tractors = tuple(TractorLines(number, tuple(_lines(plan, number, words, frame))) for number in wanted)
    boundary, area_m2, inside, obstacles, entrance = _ground(saved.ground, field, frame)
    told = tuple(_left_out(plan, wanted).items())
    return Guidance(field, boundary, area_m2, inside, obstacles, entrance, tractors, count > 1, told)


def form_for(to: str) -> Form:
    """The form that guidance is asked for in; raises ScenarioError for one that is unknown."""
    form = form_named(to)
    if form is None:
        known = [each.name for each in FORMS]
        raise ScenarioError(
            f"{named('to')} {to!r} is unknown{nearest(to, known)}; use one of: {', '.join(known)}.", parameter="to"
        )
    return form


def _words(plan: Plan) -> dict[tuple[str, int, int], str]:
    """What tracks and sides of rounds are called, by kind, number and piece."""
    tasks = {leg.task for mission in plan.missions for leg in mission.legs if leg.task.works}
    places = sorted({(task.number or 0, task.piece) for task in tasks if task.kind == ON_TRACK})
    tracks = dict(zip(places, track_names(places), strict=True))
    return {
        (task.kind, task.number or 0, task.piece): (
            f"track {tracks[task.number or 0, task.piece]}"
            if task.kind == ON_TRACK
            else f"round {task.number or 0} side {task.piece + 1}"
        )
        for task in tasks
    }


def _lines(plan: Plan, number: int, words: dict[tuple[str, int, int], str], frame: _Frame) -> Iterator[Line]:
    """The lines of a tractor in driving order."""
    stretches = list(_stretches(plan.missions[number - 1].legs))
    digits = max(ORDER_DIGITS, len(str(len(stretches))))
    for order, (task, points_m) in enumerate(stretches, start=1):
        what = words[task.kind, task.number or 0, task.piece]
        points = frame.degrees(points_m)
        yield Line(
            name=f"T{number} {order:0{digits}d} {what}",
            tractor=number,
            order=order,
            kind=TRACK if task.kind == ON_TRACK else ROUND,
            words=what,
            points=points,
            length_m=float(np.hypot(*np.diff(points_m, axis=0).T).sum()),
            bearing_deg=_bearing_deg(points),
        )


def _stretches(legs: Sequence[Leg]) -> Iterator[tuple[Task, Metres]]:
    """What is worked in one go: task and points (n, 2), two of them where it is straight."""
    for (works, task, _), group in groupby(legs, key=lambda leg: (leg.task.works, leg.task, leg.gear)):
        if works:
            parts = [leg.points for leg in group]
            yield task, _plain(np.concatenate([parts[0], *(part[1:] for part in parts[1:])]))


def _plain(points: Metres) -> Metres:
    """The line without points that say nothing."""
    ends = points[[0, -1]]
    chord = shapely.linestrings(ends)
    if (
        float(shapely.distance(shapely.points(points), chord).max()) <= STRAIGHT_M
        and np.hypot(*(ends[1] - ends[0])) > 0
    ):
        return ends
    kept: Metres = shapely.get_coordinates(shapely.linestrings(points).simplify(CURVE_M, preserve_topology=False))
    return kept


def _bearing_deg(points: Degrees) -> float:
    """Direction from the first to the last point, clockwise from true north."""
    east_m, north_m = Plane(float(points[0, 0]), float(points[0, 1])).metres(*points[-1].tolist())
    return math.degrees(math.atan2(east_m, north_m)) % 360.0


def _left_out(plan: Plan, wanted: Sequence[int]) -> dict[str, int]:
    """What a plan has beside lines, counted, in words."""
    found: Counter[str] = Counter()
    for number in wanted:
        legs = plan.missions[number - 1].legs
        kinds = [kind for kind, _ in groupby(_manner(leg) for leg in legs) if kind]
        found.update(kinds)
        found["waits for other tractors"] += sum(bool(leg.gates) for leg in legs)
    return {what: count for what, count in sorted(found.items()) if count}


def _manner(leg: Leg) -> str:
    """What a leg that is no line is counted as; legs of one turn stand one after another."""
    if leg.task.works:
        return ""
    if leg.task.kind in (ENTER, LEAVE):
        return "ways in and out"
    return "stops to refill" if leg.task.kind == REFILL else "turns"


def _ground(
    ground: dict[str, Any], field: str, frame: _Frame
) -> tuple[Area | None, float, tuple[Area, ...], tuple[Area, ...], tuple[float, float] | None]:
    """Boundary, its area, what is inside the headland, obstacles and entrance of a plan."""
    if not ground:
        return None, 0.0, (), (), None
    try:
        rings = _rings(ground["boundary_m"])
        inside = [_rings(one) for one in ground["inside_headland_m"]]
        obstacles = [(str(one["name"]), _rings(one["outline_m"])) for one in ground["obstacles"]]
        entrance = None if ground["entrance_m"] is None else _points(ground["entrance_m"]).reshape(1, 2)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise MissionError("The outlines of the field in the plan are garbled; save the plan again.") from None

    def area(name: str, rings: Sequence[Metres]) -> Area:
        return Area(name, tuple(frame.degrees(ring) for ring in rings))

    place = None if entrance is None else frame.degrees(entrance)[0]
    return (
        area(field, rings),
        float(shapely.Polygon(rings[0], rings[1:]).area),
        tuple(area("inside of the headland", one) for one in inside),
        tuple(area(name, one) for name, one in obstacles),
        None if place is None else (float(place[0]), float(place[1])),
    )


def _rings(given: Any) -> list[Metres]:
    """Rings of a polygon; raises ValueError for what is none."""
    rings = [_points(ring) for ring in given]
    if not rings or any(ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3 for ring in rings):
        raise ValueError(given)
    return rings


def _points(given: Any) -> Metres:
    points = np.array(given, dtype=np.float64)
    if not np.isfinite(points).all():
        raise ValueError(given)
    return points
