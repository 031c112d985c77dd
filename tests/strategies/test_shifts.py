"""Rounds shared out among tractors: every metre once, in equal time, far apart."""

import math

import numpy as np
import pytest
import shapely
from shapely.ops import substring

from fields import Field
from fields.rounds import lay_rounds
from strategies.headland.shifts import Stretch, backwards, shared
from strategies.job import Job
from strategies.ways.connect import Connector, TurnCosts


def job_on(jobs, outline: shapely.Polygon, tractors: int, count: int = 3) -> Job:  # type: ignore[no-untyped-def]
    """A job with rounds on a field."""
    field = Field("f", outline)
    job = jobs.on_field(field, tractors)
    job.rounds = lay_rounds(field, jobs.width_m, count)
    job.rim = Connector(outline.buffer(-0.3, join_style="mitre"), jobs.radius_m, TurnCosts(1.5, 1.0, 4.0))
    return job  # type: ignore[no-any-return]


def ground(stretch: Stretch) -> shapely.LineString:
    """The part of the centre line that is worked."""
    line = shapely.LineString(stretch.line)
    first = stretch.first_m or 0.0
    return substring(line, first, first + stretch.length_m)


DONUT = shapely.box(0, 0, 220, 120).difference(shapely.box(90, 50, 120, 75))
# The second round of outline and hole is one ring: borders that run square through a nest do not meet it.
NEAR = shapely.box(0, 0, 220, 120).difference(shapely.box(60, 11, 160, 60))


@pytest.mark.parametrize("outline", [shapely.box(0, 0, 200, 80), DONUT, NEAR], ids=["rectangle", "donut", "near"])
@pytest.mark.parametrize("tractors", [1, 2, 3, 5])
@pytest.mark.parametrize("outside_in", [True, False])
def test_every_metre_once(jobs, outline: shapely.Polygon, tractors: int, outside_in: bool) -> None:  # type: ignore[no-untyped-def]
    job = job_on(jobs, outline, tractors)
    shares = shared(job, outside_in=outside_in)
    assert len(shares) == tractors
    for lap in job.rounds:
        own = [one for share in shares for one in share if (one.lap.number, one.lap.ring) == (lap.number, lap.ring)]
        assert sum(one.length_m for one in own) == pytest.approx(lap.length_m, abs=1e-3)
        covered = shapely.union_all([ground(one).buffer(0.01) for one in own])
        assert lap.line.difference(covered).length < 0.01


@pytest.mark.parametrize("tractors", [2, 3, 4])
def test_shares_are_even_and_begin_far_apart(jobs, tractors: int) -> None:  # type: ignore[no-untyped-def]
    job = job_on(jobs, shapely.box(0, 0, 200, 80), tractors)
    shares = shared(job, outside_in=True)
    lengths = [sum(one.length_m for one in share) for share in shares]
    mean = sum(lap.length_m for lap in job.rounds) / tractors
    assert lengths == pytest.approx([mean] * tractors, rel=0.25)
    starts = [share[0].start for share in shares]
    apart = min(math.dist(a, b) for i, a in enumerate(starts) for b in starts[:i])
    assert apart > 60.0


def test_order_of_rounds(jobs) -> None:  # type: ignore[no-untyped-def]
    job = job_on(jobs, shapely.box(0, 0, 200, 80), 2)
    for outside_in in (True, False):
        for share in shared(job, outside_in=outside_in):
            numbers = [one.lap.number for one in share]
            assert numbers == sorted(numbers, reverse=not outside_in) and set(numbers) == {1, 2, 3}


def test_backwards_and_back_is_the_same_round(jobs) -> None:  # type: ignore[no-untyped-def]
    for lap in job_on(jobs, DONUT, 1).rounds:
        again = backwards(backwards(lap))
        for side, same in zip(lap.sides, again.sides, strict=True):
            assert np.array_equal(side.points, same.points)
            assert (side.before_rad, side.after_rad) == (same.before_rad, same.after_rad)
        assert backwards(lap).sides[0].before_rad == -lap.sides[-1].after_rad
