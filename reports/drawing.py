"""The pictures of a page as numbers for its template: map and animation in centimetres, y down; bars; the front."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from reports.palette import TRACTORS
from reports.paths import (
    REVERSING,
    STATES,
    TOLERANCE_M,
    WORKING,
    Extent,
    Piece,
    extent,
    pieces,
    round_length,
    swath,
    waits,
)
from reports.results import Drive, PlanResult, Points, Ranking
from reports.wording import duration, feasible

MOST_POINTS = 60_000  # of all paths of a map
MOST_SAMPLES = 40_000  # of all tractors of an animation
_MARGIN = 0.03  # of the larger side of the map
_TICKS_S = (1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, 86400)
_APART = 10.0  # between two points of the front picture, in its units
_FRONT = (560.0, 320.0, 62.0, 16.0, 12.0, 44.0)  # width, height, then room left, right, above and below


@dataclass(frozen=True)
class Viewport:
    """Metres, y north, to whole centimetres from the upper left corner, y down."""

    west: float
    north: float

    def of(self, points: Points) -> list[tuple[int, int]]:
        """Points (n, 2) on paper."""
        flat = np.rint((points - (self.west, self.north)) * (100.0, -100.0)).astype(int)
        return [(int(x), int(y)) for x, y in flat]

    def line(self, points: Points, closed: bool = False) -> str:
        """Path data of a polyline (n, 2); moves after the first are relative, which halves the text."""
        flat = self.of(points)
        steps = [f"{x - x0} {y - y0}" for (x0, y0), (x, y) in pairwise(flat) if (x, y) != (x0, y0)]
        return f"M{flat[0][0]} {flat[0][1]}" + (f"l{' '.join(steps)}" if steps else "") + ("z" if closed else "")


def map_picture(drive: Drive) -> dict[str, Any]:
    """Outline, strips, paths, marks and scale bar of a drive; every size is in centimetres on the ground."""
    box = extent(drive)
    size = box.size or 1.0
    margin = _MARGIN * size
    frame = Viewport(box.west - margin, box.north + margin)
    bar = round_length(max(box.width, 0.5 * size) / 4)
    height = box.height + 2 * margin
    return {
        "width": round((box.width + 2 * margin) * 100),
        "height": round((height + 0.06 * size) * 100),
        "unit": max(round(size), 1),
        "field": "".join(frame.line(ring, closed=True) for ring in (drive.boundary, *drive.holes)),
        "swaths": "".join(frame.line(swath(track, drive.width_m), closed=True) for track in drive.tracks),
        "lanes": _lanes(drive, frame),
        "entrance": None if drive.entrance is None else frame.of(np.array([drive.entrance]))[0],
        "bar": {"x": round(margin * 100), "y": round((height + 0.02 * size) * 100), "length": round(bar * 100)},
        "bar_text": f"{bar:g} m",
        "animation": _animation(drive, frame),
        "reversing": any(bool((status == REVERSING).any()) for status in drive.status),
        "waiting": any(bool((status == STATES["waiting"]).any()) for status in drive.status),
    }


def _lanes(drive: Drive, frame: Viewport) -> list[dict[str, Any]]:
    tolerance_m = TOLERANCE_M
    cut = _cut(drive, tolerance_m)
    while sum(len(piece.points) for lane in cut for piece in lane) > MOST_POINTS and tolerance_m < 10.0:
        tolerance_m *= 2
        cut = _cut(drive, tolerance_m)
    return [_lane(drive, frame, number, lane) for number, lane in enumerate(cut)]


def _cut(drive: Drive, tolerance_m: float) -> list[list[Piece]]:
    return [pieces(xy, status, tolerance_m) for xy, status in zip(drive.xy, drive.status, strict=True)]


def _lane(drive: Drive, frame: Viewport, number: int, lane: list[Piece]) -> dict[str, Any]:
    back = [piece for piece in lane if piece.status == REVERSING]
    turning = [piece for piece in lane if piece.status not in (WORKING, REVERSING)]
    return {
        "number": number + 1,
        "colour": number % len(TRACTORS),
        "start": frame.of(drive.xy[number][:1])[0],
        "work": [
            {"d": frame.line(piece.points), "from": _time(piece.first, drive), "to": _time(piece.last, drive)}
            for piece in lane
            if piece.status == WORKING
        ],
        "turn": "".join(frame.line(piece.points) for piece in turning),
        "back": "".join(frame.line(piece.points) for piece in back),
        "waits": [
            {"at": frame.of(np.array([(x, y)]))[0], "text": duration(seconds)}
            for x, y, seconds in waits(drive.xy[number], drive.status[number], drive.step_s)
        ],
    }


def _time(sample: int, drive: Drive) -> float:
    return round(sample * drive.step_s, 3)


def _animation(drive: Drive, frame: Viewport) -> dict[str, Any]:
    """Positions as differences in centimetres and one digit of status per sample, `step` seconds apart."""
    total = sum(len(xy) for xy in drive.xy)
    every = max(math.ceil(1.0 / drive.step_s - 1e-9), math.ceil(total / MOST_SAMPLES), 1)
    tractors = []
    for xy, status in zip(drive.xy, drive.status, strict=True):
        kept = np.minimum(np.arange(0, len(xy) + every - 1, every), len(xy) - 1)
        flat = np.asarray(frame.of(xy[kept]))
        moves = np.diff(flat, axis=0, prepend=np.zeros((1, 2), dtype=int))
        tractors.append({"moves": moves.ravel().tolist(), "status": "".join(str(s) for s in status[kept].tolist())})
    longest = max(len(xy) for xy in drive.xy) - 1
    return {"step": round(every * drive.step_s, 6), "end": _time(longest, drive), "tractors": tractors}


def bar_rows(drive: Drive) -> list[dict[str, Any]]:
    """Per tractor its total and, per manner, seconds in words and the share of the longest bar in percent."""
    totals = [sum(drive.seconds[name][number] for name in STATES) for number in range(len(drive.xy))]
    longest = max(totals) or 1.0
    return [
        {
            "number": number + 1,
            "total": duration(total),
            "parts": [
                {
                    "state": name,
                    "text": duration(drive.seconds[name][number]),
                    "share": round(drive.seconds[name][number] / longest * 100, 3),
                }
                for name in STATES
            ],
        }
        for number, total in enumerate(totals)
    ]


def front_picture(ranking: Ranking) -> dict[str, Any] | None:
    """Points, Pareto line, deadline and ticks of time against number of tractors; None without a feasible plan."""
    plans = [plan for plan in feasible(ranking) if plan.time_s is not None]
    if not plans:
        return None
    width, height, left, right, above, below = _FRONT
    limit = ranking.allowed_s
    top = max([plan.time_s or 0.0 for plan in plans] + ([limit] if limit is not None else [])) * 1.06 or 1.0
    counts = sorted({plan.tractors for plan in plans})
    span = counts[-1] - counts[0]

    def x(count: int) -> float:
        inner = width - left - right - 40
        return round(left + 20 + (inner * (count - counts[0]) / span if span else inner / 2), 1)

    def y(time_s: float) -> float:
        return round(height - below - (height - above - below) * time_s / top, 1)

    names = list(dict.fromkeys(plan.strategy for plan in plans))
    return {
        "box": Extent(left, above, width - right, height - below),
        "width": width,
        "height": height,
        "points": _front_points(plans, names, [(x(plan.tractors), y(plan.time_s or 0.0)) for plan in plans]),
        "line": " ".join(f"{x(count)},{y(time)}" for count, time in _front_line(plans)),
        "deadline": None if limit is None else {"y": y(limit), "text": f"deadline {duration(limit)}"},
        "counts": [{"x": x(count), "text": str(count)} for count in counts],
        "times": [{"y": y(time), "text": _hours(time)} for time in _ticks(top)],
        "names": [{"text": name, "colour": index % len(TRACTORS)} for index, name in enumerate(names)],
    }


def _front_line(plans: list[PlanResult]) -> list[tuple[int, float]]:
    return sorted((plan.tractors, plan.time_s or 0.0) for plan in plans if plan.on_pareto_front)


def _front_points(plans: list[PlanResult], names: list[str], places: list[tuple[float, float]]) -> list[dict[str, Any]]:
    """Points to draw, the best last; one that would hide another is moved right, but not as far as the next count."""
    columns = sorted({x for x, _ in places})
    room = min((right - left for left, right in pairwise(columns)), default=_FRONT[0] / 4)
    step = min(_APART, 0.6 * room / max(sum(x == column for x, _ in places) for column in columns))
    points: list[dict[str, Any]] = []
    for plan, (x, y) in zip(plans, places, strict=True):
        while any(abs(other["x"] - x) < 0.99 * step and abs(other["y"] - y) < _APART for other in points):
            x = round(x + step, 3)
        points.append(
            {
                "x": x,
                "y": y,
                "colour": names.index(plan.strategy) % len(TRACTORS),
                "front": plan.on_pareto_front,
                "text": f"{plan.tractors} x {plan.strategy}, {plan.turn}: {duration(plan.time_s)}",
            }
        )
    return points[::-1]


def _ticks(top_s: float) -> list[int]:
    """Times from 0 to `top_s` at the smallest handy step that gives six or fewer."""
    step = next((step for step in _TICKS_S if top_s / step <= 6), 86400 * math.ceil(top_s / 86400 / 6))
    return list(range(0, math.floor(top_s) + 1, step))


def _hours(seconds: int) -> str:
    hours, rest = divmod(seconds, 3600)
    return f"{hours}:{rest // 60:02d}" + (f":{rest % 60:02d}" if rest % 60 else "")
