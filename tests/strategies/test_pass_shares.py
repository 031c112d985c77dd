"""Rounds shared out among tractors: every metre once, in equal time, far apart."""

import math

import numpy as np
import pytest
import shapely
from shapely.ops import substring

from fields import Field
from fields.layout.headland_passes import lay_headland_passes
from strategies.headland.pass_shares import HeadlandSegment, reverse_pass, share_headland
from strategies.path_planning.connector import Connector, TurnCosts
from strategies.program.field_job import FieldJob


def job_on(jobs, outline: shapely.Polygon, tractors: int, count: int = 3) -> FieldJob:  # type: ignore[no-untyped-def]
    """A job with rounds on a field."""
    field = Field("f", outline)
    job = jobs.on_field(field, tractors)
    job.headland_passes = lay_headland_passes(field, jobs.width_m, count)
    job.rim_connector = Connector(outline.buffer(-0.3, join_style="mitre"), jobs.radius_m, TurnCosts(1.5, 1.0, 4.0))
    return job  # type: ignore[no-any-return]


def ground(segment: HeadlandSegment) -> shapely.LineString:
    """The part of the centre line that is worked."""
    line = shapely.LineString(segment.line)
    first = segment.first_m or 0.0
    return substring(line, first, first + segment.length_m)


DONUT = shapely.box(0, 0, 220, 120).difference(shapely.box(90, 50, 120, 75))
# The second round of outline and hole is one ring: borders that run square through a nest do not meet it.
NEAR = shapely.box(0, 0, 220, 120).difference(shapely.box(60, 11, 160, 60))


@pytest.mark.parametrize("outline", [shapely.box(0, 0, 200, 80), DONUT, NEAR], ids=["rectangle", "donut", "near"])
@pytest.mark.parametrize("tractors", [1, 2, 3, 5])
@pytest.mark.parametrize("outside_in", [True, False])
def test_every_metre_once(jobs, outline: shapely.Polygon, tractors: int, outside_in: bool) -> None:  # type: ignore[no-untyped-def]
    job = job_on(jobs, outline, tractors)
    shares = share_headland(job, outside_in=outside_in)
    assert len(shares) == tractors
    for headland_pass in job.headland_passes:
        own = [
            one
            for share in shares
            for one in share
            if (one.headland_pass.number, one.headland_pass.ring) == (headland_pass.number, headland_pass.ring)
        ]
        assert sum(one.length_m for one in own) == pytest.approx(headland_pass.length_m, abs=1e-3)
        covered = shapely.union_all([ground(one).buffer(0.01) for one in own])
        assert headland_pass.line.difference(covered).length < 0.01


@pytest.mark.parametrize("tractors", [2, 3, 4])
def test_shares_are_even_and_begin_far_apart(jobs, tractors: int) -> None:  # type: ignore[no-untyped-def]
    job = job_on(jobs, shapely.box(0, 0, 200, 80), tractors)
    shares = share_headland(job, outside_in=True)
    lengths = [sum(one.length_m for one in share) for share in shares]
    mean = sum(headland_pass.length_m for headland_pass in job.headland_passes) / tractors
    assert lengths == pytest.approx([mean] * tractors, rel=0.25)
    starts = [share[0].start for share in shares]
    apart = min(math.dist(a, b) for i, a in enumerate(starts) for b in starts[:i])
    assert apart > 60.0


def test_order_of_rounds(jobs) -> None:  # type: ignore[no-untyped-def]
    job = job_on(jobs, shapely.box(0, 0, 200, 80), 2)
    for outside_in in (True, False):
        for share in share_headland(job, outside_in=outside_in):
            numbers = [one.headland_pass.number for one in share]
            assert numbers == sorted(numbers, reverse=not outside_in) and set(numbers) == {1, 2, 3}


def test_backwards_and_back_is_the_same_round(jobs) -> None:  # type: ignore[no-untyped-def]
    for headland_pass in job_on(jobs, DONUT, 1).headland_passes:
        again = reverse_pass(reverse_pass(headland_pass))
        for side, same in zip(headland_pass.sides, again.sides, strict=True):
            assert np.array_equal(side.points, same.points)
            assert (side.start_turn_rad, side.end_turn_rad) == (same.start_turn_rad, same.end_turn_rad)
        assert reverse_pass(headland_pass).sides[0].start_turn_rad == -headland_pass.sides[-1].end_turn_rad
