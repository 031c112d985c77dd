"""Fields with small obstacles, driven: nothing is touched, little is missed, and what is missed is told."""

from concurrent.futures import Executor
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import affinity

from fields import Field
from fields.geometry.obstacles import Obstacle
from planner import plan
from planner.errors import RequestError
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import measure_coverage
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.moves.drives import ROOM_TOLERANCE_M
from tests.examples import seldom
from vehicle.missions.run import SimulationRun
from vehicle.sim.compile import compute_contact_boxes

pytestmark = pytest.mark.usefixtures("first_layout")

BOX = shapely.box(0, 0, 120, 60)
POLE = Obstacle("pole", shapely.Point(60, 31), 0.25)
STONE = Obstacle("rock", shapely.box(40.0, 15.0, 43.0, 17.0))
AT_END = Obstacle("pole", shapely.Point(13, 31), 0.25)


def site_with(*obstacles: Obstacle, no_headland: bool = True, **options: Any) -> PlanningContext:
    request = PlanRequest(bearing_deg=90.0, no_headland=no_headland, tractors=(1,), **options)
    return prepare_context(WorkOrder(request, Field("posts", BOX, obstacles=obstacles)))


def nearest_m(run: SimulationRun, site: PlanningContext, shape: shapely.Geometry) -> float:
    """How near a box of tractor or implement ever comes to a shape."""
    boxes, near = compute_contact_boxes(site.tractor, site.implement), np.inf
    poses = np.concatenate([run.get_poses(tractor)[::3] for tractor in range(run.plan.tractors)])
    poses = poses[shapely.distance(shapely.points(poses[:, :2]), shape) < 12.0]
    for low, high, half in (("tail", "nose", "half_width"), ("tool_tail", "tool_front", "tool_half_width")):
        box = shapely.box(boxes[low], -boxes[half], boxes[high], boxes[half])
        for x, y, angle in poses:
            placed = affinity.translate(affinity.rotate(box, angle, (0, 0), use_radians=True), x, y)
            near = min(near, placed.distance(shape))
    return near


@pytest.mark.slow
@pytest.mark.parametrize("no_headland", [*seldom(True), False])
def test_no_track_is_interrupted_and_nothing_is_touched(no_headland: bool) -> None:
    plain, among = site_with(no_headland=no_headland), site_with(POLE, STONE, no_headland=no_headland)
    assert [(t.start_m, t.end_m) for t in among.layout.swaths] == [(t.start_m, t.end_m) for t in plain.layout.swaths]
    before, after = (simulate_candidate(site, Candidate("split-field", 1)) for site in (plain, among))
    assert before.run is not None and after.run is not None and after.result.feasible
    assert after.result.time_s == pytest.approx(before.result.time_s, rel=0.1)
    for obstacle in (POLE, STONE):
        assert nearest_m(after.run, among, obstacle.shape) >= among.request.margin_m - ROOM_TOLERANCE_M
    found = measure_coverage(after.run, among)
    assert found.worked_m2 + found.unworked_m2 == pytest.approx(among.layout.field.area_m2, abs=0.1)
    taken = sum(obstacle.shape.area for obstacle in (POLE, STONE))
    assert found.field_m2 == pytest.approx(BOX.area - taken, abs=0.1)
    assert 10.0 < found.unworked_m2 - measure_coverage(before.run, plain).unworked_m2 < 100.0, (
        "wedges before and behind each"
    )


def test_a_pole_at_the_end_of_a_track_cuts_its_line() -> None:
    """The pole stands 2 to 5 m inside the end of a track: the track stays as it is laid, and is worked behind the pole
    from where the machine stands clear of it."""
    site, usual = site_with(AT_END, headland_m=11.0), site_with(headland_m=11.0)
    assert site.layout.swaths == usual.layout.swaths
    moves = get_site_moves(site)
    strips = [line.build_strip(site.layout.width_m) for line in moves.lines]
    assert not any(strip.intersects(AT_END.shape) for strip in strips)
    (cut,) = [line for line in moves.lines if abs(line.tool_path[0, 1] - 31.5) < 0.1]
    assert 13.0 + 0.25 + 0.3 < cut.tool_path[0, 0] < 15.0
    driven = simulate_candidate(site, Candidate("split-field", 1))
    assert driven.run is not None and driven.result.feasible
    assert nearest_m(driven.run, site, AT_END.shape) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("tractors", "width_m"), [(1, 3.0), (2, 4.0)])
def test_mirrored_it_takes_as_long(move: Any, tractors: int, width_m: float) -> None:
    field = Field("posts", BOX, obstacles=(POLE, STONE))
    mirrored = move(field, lambda shape: affinity.scale(shape, -1, 1, origin=(0, 0)))
    request = PlanRequest(bearing_deg=90.0, no_headland=True, tractors=(tractors,), width_m=width_m)
    sites = (prepare_context(WorkOrder(request, one)) for one in (field, mirrored))
    here_s, there_s = (simulate_candidate(site, Candidate("split-field", tractors)).result.time_s for site in sites)
    assert there_s == pytest.approx(here_s, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("x_m", [12.0, 20.0, 32.0])
def test_a_side_cut_at_the_arc_of_a_round_corner_is_led_to(x_m: float) -> None:
    """A tree just behind a corner leaves no room for its arc: a raised path leads on to what remains of the side."""
    tree = Obstacle("tree", shapely.Point(x_m, 5.0), 1.5)
    field = Field("tree", shapely.box(0.0, 0.0, 90.0, 70.0), obstacles=(tree,))
    site = prepare_context(
        WorkOrder(PlanRequest(width_m=6.0, corners="round", tractors=(1,), speed_mps=10.0 / 3.6), field)
    )
    result = simulate_candidate(site, Candidate("row-by-row", 1)).result
    assert result.reason is None or "obstacle" in result.reason


class NeverAsked(Executor):
    """Drives nothing."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Any:
        raise AssertionError("something was driven")


def test_a_margin_that_takes_most_of_the_field_is_refused_before_anything_is_driven() -> None:
    field = Field("posts", shapely.box(0, 0, 100, 60), obstacles=(Obstacle("pole", shapely.Point(0, 30), 0.25),))
    request = PlanRequest(no_headland=True, tractors=(1,), margin_m=60.0)
    with pytest.raises(RequestError, match=r"60 m leaves 4\d %.*less than half"):
        plan(request, field=field, executor=NeverAsked())
