"""Pictures show the whole field, with what obstacles cut off of it."""

import pytest
import shapely

from fields import Field
from fields.geometry.obstacles import Obstacle
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.outputs.pictures import build_outline_picture, exclude_cut_off_piece
from planner.request.plan_request import PlanRequest
from reports.common.shortfalls import UnworkedPiece

BOX = shapely.box(0, 0, 100, 60)


@pytest.fixture(scope="module")
def cut() -> PlanningContext:
    """100 m by 60 m with a ditch of 1.5 m across it, 30 m from the left, margin 0.3 m."""
    ditch = Obstacle("ditch", shapely.LineString([(30, -5), (30, 65)]), 0.75)
    return prepare_context(WorkOrder(PlanRequest(field="cut", no_headland=True), Field("cut", BOX, obstacles=(ditch,))))


def test_the_map_is_of_the_whole_field(cut: PlanningContext) -> None:
    drawn = build_outline_picture(cut)
    assert shapely.Polygon(drawn.boundary).equals(BOX) and len(drawn.obstacles) == 1
    (piece,) = drawn.cut_off
    assert piece.m2 == pytest.approx((30 - 1.05) * 60) and 0 < piece.x_m < 29 and 0 < piece.y_m < 60
    missed = shapely.union_all([shapely.Polygon(ring) for ring in drawn.unworked])
    assert missed.intersection(shapely.box(0, 0, 28.9, 60)).area == pytest.approx(28.9 * 60, rel=0.01)


def test_the_largest_piece_left_is_named_unless_it_is_cut_off(cut: PlanningContext) -> None:
    field = cut.layout.field
    own, other = UnworkedPiece(1700.0, 10.0, 30.0), UnworkedPiece(50.0, 90.0, 30.0)
    assert exclude_cut_off_piece(own, field) is None and exclude_cut_off_piece(other, field) is other
    assert exclude_cut_off_piece(None, field) is None
    beside = UnworkedPiece(1750.0, 29.2, 30.0)  # on the margin of 0.3 m to the ditch
    assert exclude_cut_off_piece(beside, field) is None and exclude_cut_off_piece(
        UnworkedPiece(5000.0, 29.2, 30.0), field
    )


def test_a_plan_names_the_largest_piece_of_ground_that_can_be_reached(cut: PlanningContext) -> None:
    result = simulate_candidate(cut, Candidate("split-field", 1)).result
    piece, (left,) = result.largest_missed, cut.layout.field.cut_off_parts
    assert result.missed_m2 is not None and piece is not None and result.missed_m2 > left.area > piece.m2
    assert not left.intersects(shapely.Point(piece.x_m, piece.y_m))
    # What nobody can get to is missed, and not charged: the rest of the field is finished at the rate it was driven.
    worked_m2 = cut.layout.field.area_m2 - result.missed_m2
    assert result.finished_s == pytest.approx(result.time_s * (cut.layout.field.area_m2 - left.area) / worked_m2)
