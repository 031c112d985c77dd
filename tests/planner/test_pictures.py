"""Pictures show the whole field, with what obstacles cut off of it."""

import pytest
import shapely

from fields import Field
from fields.obstacles import Obstacle
from planner.candidates.evaluate import Candidate, simulated
from planner.describe import outline_picture
from planner.drive import besides_cut_off
from planner.scenario import Scenario
from planner.site import Site, prepare
from reports.results import MissedPiece

BOX = shapely.box(0, 0, 100, 60)


@pytest.fixture(scope="module")
def cut() -> Site:
    """100 m by 60 m with a ditch of 1.5 m across it, 30 m from the left, margin 0.3 m."""
    ditch = Obstacle("ditch", shapely.LineString([(30, -5), (30, 65)]), 0.75)
    return prepare(Scenario(field="cut", tracks_only=True), Field("cut", BOX, obstacles=(ditch,)))


def test_the_map_is_of_the_whole_field(cut: Site) -> None:
    drawn = outline_picture(cut)
    assert shapely.Polygon(drawn.boundary).equals(BOX) and len(drawn.obstacles) == 1
    (piece,) = drawn.cut_off
    assert piece.m2 == pytest.approx((30 - 1.05) * 60) and 0 < piece.x_m < 29 and 0 < piece.y_m < 60
    missed = shapely.union_all([shapely.Polygon(ring) for ring in drawn.missed])
    assert missed.intersection(shapely.box(0, 0, 28.9, 60)).area == pytest.approx(28.9 * 60, rel=0.01)


def test_the_largest_piece_left_is_named_unless_it_is_cut_off(cut: Site) -> None:
    field = cut.layout.field
    own, other = MissedPiece(1700.0, 10.0, 30.0), MissedPiece(50.0, 90.0, 30.0)
    assert besides_cut_off(own, field) is None and besides_cut_off(other, field) is other
    assert besides_cut_off(None, field) is None
    beside = MissedPiece(1750.0, 29.2, 30.0)  # on the margin of 0.3 m to the ditch
    assert besides_cut_off(beside, field) is None and besides_cut_off(MissedPiece(5000.0, 29.2, 30.0), field)


def test_a_plan_names_the_largest_piece_of_ground_that_can_be_reached(cut: Site) -> None:
    result = simulated(cut, Candidate("split-field", 1)).result
    piece, (left,) = result.largest_missed, cut.layout.field.cut_off
    assert result.missed_m2 is not None and piece is not None and result.missed_m2 > left.area > piece.m2
    assert not left.intersects(shapely.Point(piece.x_m, piece.y_m))
    # What nobody can get to is missed, and not charged: the rest of the field is finished at the rate it was driven.
    worked_m2 = cut.layout.field.area_m2 - result.missed_m2
    assert result.finished_s == pytest.approx(result.time_s * (cut.layout.field.area_m2 - left.area) / worked_m2)
