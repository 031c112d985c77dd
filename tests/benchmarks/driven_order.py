"""The order in which a driver took the tracks of a field, out of positions of a log, and what it comes to when planned.

The tracks are those that a plan lays along the driver's bearing. A track was worked when the driver was on its strip,
in its direction, with the implement at work; of several passes over it that count nearly as much the one nearest to its
line. A driver overlaps, so that there are more passes than tracks, and directions of neighbours do not always alternate
as the driver's did: the search drives each track in the direction that makes the order quickest. What a better order
saves is thus told too low rather than too high. Two plans differ in the order of tracks alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fields.geometry.field import Field
from fields.layout.swaths import Swath
from planner.evaluation.candidates.line_programme import ComposedPlan, ProgrammeDriver, sketch_plans
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.lines.work_line import WorkLine
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.programmes.build_plan import build_plan
from strategies.programmes.move_table import MoveTable
from strategies.programmes.programme import Programme, make_programme
from strategies.registry import STRATEGIES
from vehicle.missions.plan import SWATH

ALIGNED = math.cos(math.radians(20.0))
APART_S = 20.0  # away from a strip for longer: another pass over it
MOSTLY = 0.7  # of the metres of the longest pass over a strip: another one that may have been meant for it
PLANNED = "split-field"
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Worked:
    """Where work was done: positions and the way to the next row (n, 2) in metres, and times (n,) in seconds."""

    points: Array
    steps: Array
    time_s: Array

    @property
    def metres(self) -> Array:
        """Length of each step, (n,)."""
        return np.asarray(np.hypot(*self.steps.T))


@dataclass(frozen=True)
class Driven:
    """A plan in the order of the driver, and one in the planner's own, on the same tracks: seconds, and metres off
    work. `found` is the share of the metres of the tracks on which the driver was seen to work along them."""

    time_s: float
    inactive_m: float
    planned_s: float
    planned_inactive_m: float
    found: float


def worked(points: Array, time_s: Array, works: NDArray[np.bool_]) -> Worked:
    """The rows at work, with the way from each to the next."""
    steps = np.diff(points, axis=0, append=points[-1:])
    return Worked(points[works], steps[works], time_s[works])


def bearing_deg(done: Worked) -> float:
    """The bearing of most of the work, from 0 to 180 degrees: the mean of doubled angles, weighted by metres."""
    angle = np.arctan2(done.steps[:, 0], done.steps[:, 1])
    mean = 0.5 * math.atan2(*(float((done.metres * part(2.0 * angle)).sum()) for part in (np.sin, np.cos)))
    return math.degrees(mean) % 180.0


def taken(track: Swath, done: Worked, width_m: float) -> float | None:
    """When a track was worked (mean, s); None where nobody was seen on it."""
    along = (np.array(track.end_m) - track.start_m) / track.length_m
    offset = done.points - np.array(track.start_m)
    far, aside = offset @ along, offset @ np.array([-along[1], along[0]])
    ahead = done.steps @ along
    rows = np.flatnonzero(
        (np.abs(aside) <= 0.5 * width_m) & (far >= 0.0) & (far <= track.length_m)
        & (np.abs(ahead) >= ALIGNED * done.metres) & (done.metres > 0.0)
    )  # fmt: skip
    if not len(rows):
        return None
    passes = np.split(rows, np.flatnonzero(np.diff(done.time_s[rows]) > APART_S) + 1)
    metres = [float(done.metres[one].sum()) for one in passes]
    whole = [one for one, long in zip(passes, metres, strict=True) if long >= MOSTLY * max(metres)]
    best = min(whole, key=lambda one: float(np.abs(aside[one]).mean()))
    return float(done.time_s[best].mean())


def driven_order(tracks: Sequence[Swath], done: Worked, width_m: float) -> list[Swath]:
    """The tracks in the order of the driver; one that nobody was seen on comes after its neighbour."""
    seen = {track: taken(track, done, width_m) for track in tracks}
    known = [track for track in tracks if seen[track] is not None]
    keys = []
    for number, track in enumerate(tracks):
        near = min(known, key=lambda other: (abs(other.line - track.line), other.line), default=track)
        keys.append((seen[near] or 0.0, abs(near.line - track.line), number, track))
    return [key[3] for key in sorted(keys, key=lambda key: key[:3])]


def rank_lines(lines: Sequence[WorkLine], order: Sequence[Swath], headland: str) -> list[int]:
    """Stages of work lines by which their tracks are worked in an order, and the headland before or after all."""
    ranks = []
    for line in lines:
        pieces = [(rank, one) for rank, one in enumerate(order, start=1) if one.line == line.task.number]
        middle = line.paths[0].mean(axis=0)
        if line.task.kind == SWATH:
            ranks.append(min(pieces, key=lambda piece: math.dist(middle, np.mean(piece[1].points_m, axis=0)))[0])
        else:
            ranks.append(0 if headland == HEADLAND_FIRST else len(order) + 1)
    return ranks


def driven_again(field: Field, scenario: PlanRequest, done: Worked, interior: NDArray[np.bool_]) -> Driven | None:
    """Plan a field along the driver's bearing in the driver's order and in the planner's; None where either cannot be
    driven. `interior` marks the rows that are off the headland."""
    inner = Worked(done.points[interior], done.steps[interior], done.time_s[interior])
    site = prepare_context(WorkOrder(replace(scenario, bearing_deg=round(bearing_deg(inner), 2)), field))
    width_m = scenario.width_m

    table, order = MoveTable(get_site_moves(site)), driven_order(site.layout.swaths, inner, width_m)
    ranks = [rank_lines(table.lines, order, headland) for headland in (HEADLAND_FIRST, "")]
    owns = [_simulated(site, compose_programme(make_programme(table, 1, each))) for each in ranks]
    own = min((one for one in owns if one is not None), default=None)
    planned = _simulated(site, sketch_plans(site, STRATEGIES[PLANNED], 1)[0].compose())
    if own is None or planned is None:
        return None
    tracks = site.layout.swaths
    found = sum(track.length_m for track in tracks if taken(track, inner, width_m) is not None)
    return Driven(*own, *planned, found / sum(track.length_m for track in tracks))


def compose_programme(programme: Programme) -> ComposedPlan:
    """A programme as a plan to be driven."""
    return ComposedPlan("", programme, lambda: build_plan(programme, tractors=1), programme.compute_tractor_s())


def _simulated(site: PlanningContext, composed: ComposedPlan) -> tuple[float, float] | None:
    """Seconds and metres off work of a plan for one tractor."""
    driven = ProgrammeDriver(site, beside=False).drive(composed)
    if driven.reason is not None:
        return None
    return driven.run.duration_s, sum(leg.length_m for leg in driven.run.plan.missions[0].legs if not leg.implement)
