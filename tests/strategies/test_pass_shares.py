"""Rounds in the order in which one tractor would drive them: every side once."""

import numpy as np
import pytest
import shapely

from fields import Field
from fields.layout.headland_passes import lay_headland_passes
from strategies.headland.pass_shares import list_segments, reverse_pass
from strategies.path_planning.connector import Connector, TurnCosts
from strategies.program.field_job import FieldJob


def job_on(jobs, outline: shapely.Polygon, count: int = 3) -> FieldJob:  # type: ignore[no-untyped-def]
    """A job with rounds on a field."""
    field = Field("f", outline)
    job = jobs.on_field(field)
    job.headland_passes = lay_headland_passes(field, jobs.width_m, count)
    job.rim_connector = Connector(outline.buffer(-0.3, join_style="mitre"), jobs.radius_m, TurnCosts(1.5, 1.0, 4.0))
    return job  # type: ignore[no-any-return]


DONUT = shapely.box(0, 0, 220, 120).difference(shapely.box(90, 50, 120, 75))
# The second round of outline and hole is one ring.
NEAR = shapely.box(0, 0, 220, 120).difference(shapely.box(60, 11, 160, 60))


@pytest.mark.parametrize("outline", [shapely.box(0, 0, 200, 80), DONUT, NEAR], ids=["rectangle", "donut", "near"])
def test_every_side_once_from_outside_in(jobs, outline: shapely.Polygon) -> None:  # type: ignore[no-untyped-def]
    job = job_on(jobs, outline)
    segments = list_segments(job)
    assert len(segments) == sum(len(headland_pass.sides) for headland_pass in job.headland_passes)
    covered = shapely.union_all([shapely.LineString(one.line).buffer(0.01) for one in segments])
    assert all(headland_pass.line.difference(covered).length < 0.01 for headland_pass in job.headland_passes)
    if len({one.headland_pass.ring for one in segments}) == 1:
        numbers = [one.headland_pass.number for one in segments]
        assert numbers == sorted(numbers)


def test_backwards_and_back_is_the_same_round(jobs) -> None:  # type: ignore[no-untyped-def]
    for headland_pass in job_on(jobs, DONUT).headland_passes:
        again = reverse_pass(reverse_pass(headland_pass))
        for side, same in zip(headland_pass.sides, again.sides, strict=True):
            assert np.array_equal(side.points, same.points)
            assert (side.start_turn_rad, side.end_turn_rad) == (same.start_turn_rad, same.end_turn_rad)
        assert reverse_pass(headland_pass).sides[0].start_turn_rad == -headland_pass.sides[-1].end_turn_rad
