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
from planner.scenario import Scenario
from strategies.job import Job
from strategies.laps import shift_of
from strategies.sequence import searched
from strategies.shifts import shared
from strategies.table import TurnTable

if TYPE_CHECKING:
    from planner.site import Site

MOST_ROUNDS = 50
MOST_TRACKS = 200  # orders of more are not searched to compare layouts: the estimate decides
BESIDES = 2  # layouts compared with the plain one in as many rounds as turns need
NEAR_LINES = 5  # turns over more are estimated for the comparison
LEAST_GAIN = 0.01  # of the time: what gains less may as well lose, and is not worth a second bearing or another round
DEEPER = 0.01  # of the time: what one round more is charged, as corners take longer than the comparison sees
WORSE = 1.02  # layouts this much dearer than the cheapest by estimate are not compared
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
        most = WORSE * effort_m(options[0])
        found += [option for option in options if option is not plain and effort_m(option) <= most][:BESIDES]
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
        cost = [finish_s(site) * (1.0 + DEEPER * (site.layout.rounds > plain.layout.rounds)) for site in known]
    best = min(range(len(known)), key=lambda place: (round(cost[place], 1), place))
    return known[best] if cost[best] < (1.0 - LEAST_GAIN) * cost[0] else plain


def finish_s(site: Site) -> float:
    """Seconds in which one tractor would finish the field: its best order, the rounds, missed ground at their rate."""
    job = site.job(1)
    tracks = list(site.layout.tracks)
    order = searched(tracks, job, TurnTable(job, tracks, NEAR_LINES), roughly=True)
    rounds_s, left_m = _rounds_s(job)
    worked = _worked_m2(site) - left_m * site.layout.width_m
    return (order.seconds + rounds_s) * site.layout.field.area_m2 / worked


def _rounds_s(job: Job) -> tuple[float, float]:
    """Seconds of the rounds driven by one tractor, with all their corners, and the metres that no way leads to."""
    shift = shift_of(job, shared(job, outside_in=True, begin=job.layout.field.entrance)[0])
    if shift is None:
        return 0.0, math.fsum(lap.length_m for lap in job.rounds)
    driven = math.fsum(leg.length_m / leg.speed_mps for leg in shift.legs)
    shifts = sum(a.gear != b.gear for a, b in pairwise(shift.legs))
    return driven + shifts * job.connector.costs.cusp_s, shift.left_m


def _worked_m2(site: Site) -> float:
    """Ground that the implement passes over where everything is driven as planned, corners whole."""
    layout, half = site.layout, 0.5 * site.layout.width_m
    lines = [shapely.LinearRing(lap.line) if lap.closed else lap.line for lap in site.rounds]
    around = shapely.buffer(lines, half, cap_style="flat", join_style="mitre")
    along = shapely.buffer([shapely.LineString([t.start, t.end]) for t in layout.tracks], half, cap_style="flat")
    worked = shapely.union_all(np.concatenate([around, along]), grid_size=GRID_M)
    return float(shapely.intersection(worked, layout.field.boundary, grid_size=GRID_M).area)
