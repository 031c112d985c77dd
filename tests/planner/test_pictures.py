"""Pictures show the whole field, with what obstacles cut off of it."""

import pytest
import shapely

from fields import Field
from fields.geometry.obstacles import Obstacle
from planner import plan
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.outputs.pictures import build_outline_picture, exclude_cut_off_piece
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import UnworkedPiece
from reports.plan.map_labels import place_headland_pass_labels

pytestmark = pytest.mark.usefixtures("first_layout")

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
    assert result.missed_m2 > left.area > piece.m2
    assert not left.intersects(shapely.Point(piece.x_m, piece.y_m))
    # What nobody can get to is missed, and not charged: the rest of the field is finished at the rate it was driven.
    worked_m2 = cut.layout.field.area_m2 - result.missed_m2
    assert result.finished_s == pytest.approx(result.time_s * (cut.layout.field.area_m2 - left.area) / worked_m2)


@pytest.mark.slow
def test_the_map_names_lines_as_the_list_of_legs_does() -> None:
    """A tree cuts a track: its pieces have one name each, on the map, in the list and in what is asked of lines."""
    tree = Obstacle("tree", shapely.Point(40.0, 31.0), 3.0)
    treed = Field("treed", shapely.box(0, 0, 90, 60), obstacles=(tree,))
    result = plan(PlanRequest(width_m=3.0, tractors=(1,)), field=treed)
    drawn = next(iter(result.pictures.values()))
    worked = {f"{step.number}{step.part}" for step in drawn.steps[0] if step.kind == "track"}
    assert set(drawn.swath_names) == worked and any(name.endswith("b") for name in worked)
    sides = {f"R{step.number}.{step.part}" for step in drawn.steps[0] if step.kind == "round"}
    assert {side.name for side in drawn.headland_sides} == sides
    assert sides <= {label.text for label in place_headland_pass_labels(drawn, 130.0)}, "each is named on the map"
    cut = next(name for name in worked if name.endswith("b"))
    without = plan(PlanRequest(width_m=3.0, tractors=(1,), leave_out=cut), field=treed)
    assert set(next(iter(without.pictures.values())).swath_names) == worked - {cut}
