"""Which layout of a field to plan with: several are compared by the time one tractor would take."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
import shapely

from fields.errors import FieldError
from fields.field import Field
from fields.layout import Layout, lay_tracks
from fields.options import effort_m, lay_options
from planner.scenario import SOW, Scenario
from strategies.headland.laps import shift_of
from strategies.headland.shifts import shared
from strategies.job import Job
from strategies.orders.sequence import searched
from strategies.orders.table import TurnTable

MOST_ROUNDS = 50
MOST_TRACKS = 125  # orders of more are not searched to compare layouts: the estimate decides
MOST_TOGETHER = 250  # tracks of all layouts compared: what comes last is left out
NEAR_LINES = 4  # turns over more are estimated for the comparison
LEAST_GAIN = 0.01  # of the time: what gains less may as well lose, and is not worth a second bearing or another round
DEEPER = 0.01  # of the time: what one round more is charged, as corners take longer than the comparison sees
WORSE = 1.005  # layouts this much dearer than the plain one by estimate are not compared
GRID_M = 1e-6


def layouts(scenario: Scenario, field: Field, headland_m: float, apart_m: float = 0.0) -> list[Layout]:
    """The layouts to compare, first the plain one: one bearing, and as many rounds as the headland takes.

    Without rounds, and where bearing and headland are asked for, there is no other. A bearing that is asked for is that
    of every layout, a headland as well. Tracks are `apart_m` from each other, so that machines can pass on them, or as
    far as the working width lets them. Raises FieldError where no track is left.
    """
    width, bearing = scenario.width_m, scenario.bearing_deg
    if scenario.tracks_only:
        return [lay_tracks(field, width, headland_m, bearing)]
    plain = _plain(scenario, field, headland_m, apart_m)
    found = [plain]
    if bearing is None:
        options = (option for option in _options(scenario, plain) if option is not plain)
        found += [option for option in options if effort_m(option) <= WORSE * effort_m(plain)][:1]
    if len(plain.tracks) > MOST_TRACKS:
        return [found[_cheapest([effort_m(layout) for layout in found])]]
    if scenario.headland_m is None and plain.rounds < MOST_ROUNDS:
        found += _deeper(scenario, field, plain.rounds + 1, apart_m)
    together = accumulate(len(layout.tracks) for layout in found)
    return [layout for layout, tracks in zip(found, together, strict=True) if tracks <= MOST_TOGETHER]


def _plain(scenario: Scenario, field: Field, headland_m: float, apart_m: float) -> Layout:
    """One bearing inside as many rounds as the headland takes and the field has room for."""
    width, bearing = scenario.width_m, scenario.bearing_deg
    most = min(max(1, math.ceil(headland_m / width - 1e-6)), MOST_ROUNDS)
    for count in range(most, 1, -1):
        try:
            depth = headland_m if count == most else count * width
            return lay_tracks(field, width, depth, bearing, rounds=count, apart_m=apart_m)
        except FieldError:
            if scenario.headland_m is not None:
                raise
    return lay_tracks(field, width, width, bearing, rounds=1, apart_m=apart_m)


def _deeper(scenario: Scenario, field: Field, rounds: int, apart_m: float) -> list[Layout]:
    """The most promising layout inside so many rounds; none where these leave no room for tracks."""
    width = scenario.width_m
    try:
        plain = lay_tracks(field, width, rounds * width, scenario.bearing_deg, rounds=rounds, apart_m=apart_m)
    except FieldError:
        return []
    return _options(scenario, plain)[:1] if scenario.bearing_deg is None else [plain]


def _options(scenario: Scenario, plain: Layout) -> list[Layout]:
    """The layouts beside a plain one; cells are none where tracks are spared, as turns in one lead over the next."""
    return [one for one in lay_options(plain) if scenario.operation != SOW or len(one.cells) == 1]


def quickest(jobs: Sequence[Job]) -> int:
    """Which of several jobs for one tractor on a field is done soonest; the first where others gain little."""
    if len(jobs) == 1:
        return 0
    deeper = [job.layout.rounds > jobs[0].layout.rounds for job in jobs]
    return _cheapest([finish_s(job) * (1.0 + DEEPER * more) for job, more in zip(jobs, deeper, strict=True)])


def _cheapest(costs: list[float]) -> int:
    """The place of the least of some costs, 0 where it is hardly less than the first."""
    best = min(range(len(costs)), key=lambda place: (round(costs[place], 1), place))
    return best if costs[best] < (1.0 - LEAST_GAIN) * costs[0] else 0


def finish_s(job: Job) -> float:
    """Seconds in which one tractor would finish the field: its best order, the rounds, missed ground at their rate."""
    tracks = list(job.layout.tracks)
    order = searched(tracks, job, TurnTable(job, tracks, NEAR_LINES), roughly=True)
    rounds_s, left_m = _rounds_s(job)
    worked = _worked_m2(job) - left_m * job.layout.width_m
    return (order.seconds + rounds_s) * job.layout.field.area_m2 / worked


def _rounds_s(job: Job) -> tuple[float, float]:
    """Seconds of the rounds driven by one tractor, with all their corners, and the metres that no way leads to."""
    shift = shift_of(job, shared(job, outside_in=True, begin=job.layout.field.entrance)[0])
    if shift is None:
        return 0.0, math.fsum(lap.length_m for lap in job.rounds)
    driven = math.fsum(leg.length_m / leg.speed_mps for leg in shift.legs)
    shifts = sum(a.gear != b.gear for a, b in pairwise(shift.legs))
    return driven + shifts * job.connector.costs.cusp_s, shift.left_m


def _worked_m2(job: Job) -> float:
    """Ground that the implement passes over where everything is driven as planned, corners whole."""
    layout, half = job.layout, 0.5 * job.layout.width_m
    lines = [shapely.LinearRing(lap.line) if lap.closed else lap.line for lap in job.rounds]
    around = shapely.buffer(lines, half, cap_style="flat", join_style="mitre")
    along = shapely.buffer([shapely.LineString([t.start, t.end]) for t in layout.tracks], half, cap_style="flat")
    worked = shapely.union_all(np.concatenate([around, along]), grid_size=GRID_M)
    return float(shapely.intersection(worked, layout.field.boundary, grid_size=GRID_M).area)
