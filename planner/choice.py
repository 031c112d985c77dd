"""Which layout of a field to plan with: several are compared by the time one tractor would take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import shapely

from fields.errors import FieldError
from fields.field import Field
from fields.layout import Layout, lay_tracks
from fields.options import effort_m, lay_options
from fields.rounds import Round
from planner.scenario import Scenario
from strategies.corners import corner_ways, tangent_m, worked_into
from strategies.job import Job
from strategies.sequence import searched
from strategies.table import TurnTable

if TYPE_CHECKING:
    from planner.site import Site

MOST_ROUNDS = 50
MOST_TRACKS = 200  # orders of more are not searched to compare layouts: the estimate decides
BESIDES = 2  # layouts compared with the plain one in as many rounds as turns need
LEAST_GAIN = 0.005  # of the time: what gains less is not worth a second bearing or another round
FORCED_CORNER_S = 40.0  # a corner that no plain way leads round
GRID_M = 1e-6


def layouts(scenario: Scenario, field: Field, headland_m: float) -> list[Layout]:
    """The layouts to compare, first the plain one: one bearing, and as many rounds as the headland takes.

    Without rounds, and where bearing and headland are asked for, there is no other. A bearing that is asked for is that
    of every layout, a headland as well. Raises FieldError where no track is left.
    """
    width, bearing = scenario.width_m, scenario.bearing_deg
    if scenario.tracks_only:
        return [lay_tracks(field, width, headland_m, bearing)]
    plain = _plain(scenario, field, headland_m)
    found = [plain]
    if bearing is None:
        options = lay_options(plain)
        found += [option for option in options if option is not plain][:BESIDES]
    if scenario.headland_m is None and plain.rounds < MOST_ROUNDS:
        found += _deeper(scenario, field, plain.rounds + 1)
    return found


def _plain(scenario: Scenario, field: Field, headland_m: float) -> Layout:
    """One bearing inside as many rounds as the headland takes and the field has room for."""
    width, bearing = scenario.width_m, scenario.bearing_deg
    most = min(max(1, math.ceil(headland_m / width - 1e-6)), MOST_ROUNDS)
    for count in range(most, 1, -1):
        try:
            depth = headland_m if count == most else count * width
            return lay_tracks(field, width, depth, bearing, rounds=count)
        except FieldError:
            if scenario.headland_m is not None:
                raise
    return lay_tracks(field, width, width, bearing, rounds=1)


def _deeper(scenario: Scenario, field: Field, rounds: int) -> list[Layout]:
    """The most promising layout inside so many rounds; none where these leave no room for tracks."""
    width = scenario.width_m
    try:
        plain = lay_tracks(field, width, rounds * width, scenario.bearing_deg, rounds=rounds)
    except FieldError:
        return []
    return (lay_options(plain) if scenario.bearing_deg is None else [plain])[:1]


def quickest(sites: Sequence[Site]) -> Site:
    """The site whose field one tractor would finish soonest; the first where others gain little.

    Where there are many tracks, sites with as many rounds as the first are compared by the estimated driving alone.
    """
    plain = sites[0]
    if len(sites) == 1:
        return plain
    if max(len(site.layout.tracks) for site in sites) > MOST_TRACKS:
        known = [site for site in sites if site.layout.rounds == plain.layout.rounds]
        cost = [effort_m(site.layout) for site in known]
    else:
        known = list(sites)
        cost = [finish_s(site) for site in known]
    best = min(range(len(known)), key=lambda place: (round(cost[place], 1), place))
    return known[best] if cost[best] < (1.0 - LEAST_GAIN) * cost[0] else plain


def finish_s(site: Site) -> float:
    """Seconds in which one tractor would finish the field: its best order, the rounds, missed ground at their rate."""
    job = site.job(1)
    tracks = list(site.layout.tracks)
    driven = searched(tracks, job, TurnTable(job, tracks)).seconds + math.fsum(_round_s(job, lap) for lap in job.rounds)
    return driven * site.layout.field.area_m2 / _worked_m2(site)


def _round_s(job: Job, lap: Round) -> float:
    """Seconds of a round with its corners."""
    sides = lap.sides
    turns = [side.after_rad for side in sides] if lap.closed and sides[0].before_rad else []
    turns = turns or [a.after_rad for a, _ in pairwise(sides)]
    return lap.length_m / job.manner.work_speed_mps + math.fsum(_corner_s(job, turn) for turn in turns)


def _corner_s(job: Job, turn_rad: float) -> float:
    """Seconds that a corner adds to the length of its sides: the way round it, less what of them is not driven."""
    manner, width = job.manner, job.layout.width_m
    if not job.square:
        spared = 2.0 * tangent_m(turn_rad, manner.radius_m) - manner.radius_m * abs(turn_rad)
        return -spared / manner.work_speed_mps
    end, begin = worked_into(turn_rad, width)
    ahead = np.array([math.cos(turn_rad), math.sin(turn_rad)]) * (begin + manner.tool_m)
    ways = corner_ways((end + manner.tool_m, 0.0, 0.0), (*ahead.tolist(), turn_rad), manner.radius_m)
    costs = (job.connector.costs.time_s(way) for way in ways if job.connector.reversing or not way.reverse_m)
    return min(costs, default=FORCED_CORNER_S) + (end - begin) / manner.work_speed_mps


def _worked_m2(site: Site) -> float:
    """Ground that the implement passes over where everything is driven as planned, corners whole."""
    layout, half = site.layout, 0.5 * site.layout.width_m
    lines = [shapely.LinearRing(lap.line) if lap.closed else lap.line for lap in site.rounds]
    around = shapely.buffer(lines, half, cap_style="flat", join_style="mitre")
    along = shapely.buffer([shapely.LineString([t.start, t.end]) for t in layout.tracks], half, cap_style="flat")
    worked = shapely.union_all(np.concatenate([around, along]), grid_size=GRID_M)
    return float(shapely.intersection(worked, layout.field.boundary, grid_size=GRID_M).area)
