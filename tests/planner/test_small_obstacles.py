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
from planner.evaluation.ground.coverage import compute_guided_path, measure_coverage
from planner.evaluation.preparation import prepare_context
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
    for low, high, half in (("tail", "nose", "half_width"), ("tool_tail", "tool_front", "tool_half_width")):
        box = shapely.box(boxes[low], -boxes[half], boxes[high], boxes[half])
        for tractor in range(run.plan.tractors):
            for x, y, angle in run.get_poses(tractor)[::3]:
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


def test_a_pole_where_no_bend_fits_cuts_the_track(place: Any) -> None:
    """The pole stands 2 to 5 m inside the end of a track; the track begins behind it with the room to turn aside: the
    radius of a bend, the nose and the tail, less than the 11 m of headland."""
    site = site_with(AT_END, headland_m=11.0)
    usual = {swath.start_m[0] for swath in site_with(headland_m=11.0).layout.swaths}
    ends = sorted({round(x, 3) for swath in site.layout.swaths for x in (swath.start_m[0], swath.end_m[0])})
    assert len(usual) == 1 and len(ends) == 3
    assert site.obstacle_bends.bender is not None
    rules = site.obstacle_bends.bender.rules
    assert ends[1] == pytest.approx(13 + 0.25 + 0.3 + rules.radius_m + rules.nose_m + rules.tail_m, abs=0.01)
    assert ends[1] < 13 + 0.25 + 0.3 + 11.0
    driven = simulate_candidate(site, Candidate("split-field", 1))
    assert driven.run is not None and driven.result.feasible
    assert nearest_m(driven.run, site, AT_END.shape) > 0.0


@pytest.mark.xfail(reason="work lines are cut at a pole that they could bend round with the implement down")
def test_the_pass_keeps_to_its_bend() -> None:
    """Beside the pole the guided point is where planned, to two hands; where the heading changes it looks ahead."""
    site = site_with(POLE)
    run = simulate_candidate(site, Candidate("split-field", 1)).run
    assert run is not None and len(site.obstacle_bends.bent_lines) == 2
    paths = [shapely.LineString(way.points) for way in site.obstacle_bends.bent_lines.values()]
    path = compute_guided_path(run, site, 0)
    for half_m, most_m in ((1.5, 0.25), (25.0, 0.55)):
        middle = path[(np.abs(path[:, 0] - 60) < half_m) & (np.abs(path[:, 1] - 31) < 2.4)]
        aside = np.min([shapely.distance(shapely.points(middle), way) for way in paths], axis=0)
        assert len(middle) > 10 and aside.max() < most_m


@pytest.mark.parametrize("obstacle", [POLE, STONE])
def test_mirrored_it_takes_as_long(obstacle: Obstacle) -> None:
    def time_s(flip: bool) -> float | None:
        def at(shape: Any) -> Any:
            return affinity.scale(shape, -1, 1, origin=(0, 0)) if flip else shape

        field = Field(
            "posts", at(BOX), obstacles=(Obstacle(obstacle.kind, at(obstacle.geometry), obstacle.half_width_m),)
        )
        site = prepare_context(WorkOrder(PlanRequest(bearing_deg=90.0, no_headland=True, tractors=(2,)), field))
        return simulate_candidate(site, Candidate("split-field", 2)).result.time_s

    assert time_s(True) == pytest.approx(time_s(False), rel=0.04)


@pytest.mark.parametrize("x_m", [12.0, 20.0, 32.0])
def test_a_side_cut_at_the_arc_of_a_round_corner_is_led_to(x_m: float) -> None:
    """A tree just behind a corner leaves no room for its arc: a raised path leads on to what remains of the side."""
    tree = Obstacle("tree", shapely.Point(x_m, 5.0), 1.5)
    field = Field("tree", shapely.box(0.0, 0.0, 150.0, 110.0), obstacles=(tree,))
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
