"""The maps of a ranking as JSON, for programs that draw and play its plans themselves."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from reports.leg_list import cells
from reports.paths import check_drive
from reports.results import Drive, Ranking
from reports.timed import Lane, lanes

MOST_KNOTS = 6000  # of all tractors of one plan together
_CENTIMETRES = 2


def maps_json(ranking: Ranking, drive: Drive | None, drives: Mapping[tuple[str, int], Drive] | None = None) -> str:
    """What there is to draw of the plans of a ranking, as JSON text with a trailing newline.

    `drive` is that of the best plan; `drives` are others by strategy and number of tractors, as `plan_page` takes
    them. Keys: ``field`` (name), ``begin`` (time of day of the field work, or null) and ``plans``, each with
    ``strategy``, ``tractors``, ``title``, ``end_s``, ``width_m``, its ground in metres of the field (``boundary_m``,
    ``holes_m``, ``obstacles_m``, ``fences_m``, ``entrance_m``, ``missed_m``), ``tracks`` and ``rounds`` (each a name
    and its ``points_m``), and ``lanes``: per tractor ``time_s`` and ``points_m`` of its knots, the ``status`` between
    two of them (1 working, 2 turning, 3 waiting, 4 reversing, 5 refilling), and ``steps`` in words.

    Raises:
        ReportError: a drive cannot be drawn.
    """
    best = ranking.best
    shown = {(best.strategy, best.tractors): drive} if best and drive else {}
    shown = {**shown, **{key: one for key, one in (drives or {}).items() if key not in shown}}
    for one in shown.values():
        check_drive(one)
    start = ranking.field_start or ranking.start
    plans = [_plan(strategy, count, one, start) for (strategy, count), one in shown.items()]
    return json.dumps({"field": ranking.field_name, "begin": start, "plans": plans}, allow_nan=False) + "\n"


def _plan(strategy: str, tractors: int, drive: Drive, start: str | None) -> dict[str, Any]:
    names = drive.track_names or tuple(str(number + 1) for number in range(len(drive.tracks)))
    return {
        "strategy": strategy,
        "tractors": tractors,
        "title": drive.title,
        "end_s": max(drive.finish_s, default=0.0),
        "width_m": drive.width_m,
        "boundary_m": _rounded(drive.boundary),
        "holes_m": [_rounded(ring) for ring in drive.holes],
        "obstacles_m": [_rounded(ring) for ring in drive.obstacles],
        "fences_m": [_rounded(line) for line in drive.fences],
        "entrance_m": None if drive.entrance is None else list(drive.entrance),
        "missed_m": [_rounded(ring) for ring in drive.missed],
        "tracks": [
            {"name": name, "points_m": _rounded(track)} for name, track in zip(names, drive.tracks, strict=True)
        ],
        "rounds": [{"name": f"R{each.number}", "points_m": _rounded(each.points)} for each in drive.rounds],
        "lanes": [_lane(lane, drive, number, start) for number, lane in enumerate(lanes(drive, MOST_KNOTS))],
    }


def _lane(lane: Lane, drive: Drive, number: int, start: str | None) -> dict[str, Any]:
    steps = drive.steps[number] if drive.steps else ()
    return {
        "time_s": _rounded(lane.sample * drive.step_s),
        "points_m": _rounded(lane.xy),
        "status": lane.status.tolist(),
        "steps": [
            {"from_s": step.from_s, "seconds": step.seconds, "words": cells(place, step, start)[1]}
            for place, step in enumerate(steps, start=1)
        ],
    }


def _rounded(values: npt.NDArray[Any]) -> Any:
    return np.round(values, _CENTIMETRES).tolist()
