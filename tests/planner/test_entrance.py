"""Plans of fields with an entrance: ways in and out, one tractor after another at the gate, the same without one."""

import math
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely

from fields import Field, FieldError
from planner.evaluation.candidates.evaluate import Candidate, Outcome, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import compute_guided_path
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.outputs.driving_steps import list_steps
from planner.request.plan_request import PlanRequest
from reports.plan.leg_list import describe_leg
from strategies.path_planning.paths import EDGE_INSET_M, build_entrance_lane
from strategies.registry import STRATEGIES
from vehicle.missions.plan import ENTER, HEADLAND_PASS, LEAVE, SWATH, Leg, LegGate, LegTask, Mission, Plan
from vehicle.missions.plan_file import format_plan, parse_saved_plan
from vehicle.missions.run import DONE
from vehicle.model.tractor import Implement, load_tractor
from vehicle.sim.compile import build_model_record
from vehicle.sim.path_conflicts import PosePath, build_poses, find_conflicting_poses
from vehicle.sim.world import World

pytestmark = pytest.mark.usefixtures("first_layout")

BOX = shapely.box(0, 0, 60, 110)
GATE = (30.0, 0.0)
CASES = [("split-field", 1), ("split-field", 3),
         *(pytest.param(*case, marks=pytest.mark.slow)
           for case in (("interleaved", 2), ("row-by-row", 3), ("col-by-col", 2)))]  # fmt: skip


def site_at(entrance: tuple[float, float] | None, **options: Any) -> PlanningContext:
    return prepare_context(WorkOrder(PlanRequest(field="box", **options), Field("box", BOX, entrance=entrance)))


@cache
def site(entrance: tuple[float, float] | None = GATE) -> PlanningContext:
    return site_at(entrance)


@cache
def driven(strategy: str, tractors: int, entrance: tuple[float, float] | None = GATE) -> Outcome:
    return simulate_candidate(site(entrance), Candidate(strategy, tractors))


class TestGate:
    def test_leads_straight_in_to_where_turns_may_begin(self) -> None:
        found = build_entrance_lane(BOX, shapely.box(2, 2, 58, 108), (30.0, -5.0))
        assert found.in_pose == pytest.approx((30.0, EDGE_INSET_M, 0.5 * math.pi))
        assert found.lead_m == pytest.approx(2.0 - EDGE_INSET_M)
        assert found.out_pose == pytest.approx((30.0, EDGE_INSET_M, -0.5 * math.pi))

    def test_of_a_corner_is_the_diagonal(self) -> None:
        assert build_entrance_lane(BOX, shapely.box(2, 2, 58, 108), (0.0, 0.0)).in_pose[2] == pytest.approx(
            0.25 * math.pi
        )

    def test_of_ground_in_parts_heads_for_the_nearest(self) -> None:
        free = shapely.union(shapely.box(2, 2, 10, 10), shapely.box(20, 2, 58, 108))
        assert build_entrance_lane(BOX, free, (12.0, 0.0)).in_pose[2] == pytest.approx(0.75 * math.pi)


class TestPlaces:
    @pytest.mark.parametrize(
        ("entrance", "words"),
        [
            ((30.0, -51.0), "51 m outside; it must be within 50 m"),
            ((30.0, 40.0), "30 m inside, beyond the headland of"),
            ((12.0, 12.0), "in an obstacle (a hole of the field)"),
        ],
    )
    def test_that_no_tractor_could_use_are_refused(self, entrance: tuple[float, float], words: str) -> None:
        hole = shapely.box(10, 10, 20, 20)
        with pytest.raises(FieldError) as refused:
            prepare_context(WorkOrder(PlanRequest(field="box"), Field("box", BOX - hole, entrance=entrance)))
        assert words in str(refused.value) and refused.value.parameter == "entrance"

    @pytest.mark.parametrize("entrance", [(30.0, -49.0), (30.0, 4.0), (30.0, 0.0)])
    def test_near_the_outline_are_put_on_it(self, entrance: tuple[float, float]) -> None:
        assert site_at(entrance).layout.field.entrance == (30.0, 0.0)

    def test_of_a_request_come_before_those_of_a_field(self) -> None:
        asked = prepare_context(
            WorkOrder(PlanRequest(field="box", entrance=(0.0, 50.0)), Field("box", BOX, entrance=GATE))
        )
        assert asked.layout.field.entrance == pytest.approx((0.0, 50.0))

    def test_on_the_earth_are_degrees(self) -> None:
        field = Field("box", BOX, crs="EPSG:32632", origin_m=(550_000.0, 6_300_000.0))
        ((lon, lat),) = field.to_wgs84([(60.0, 50.0)]).tolist()
        found = prepare_context(WorkOrder(PlanRequest(field="box", entrance=(lon, lat)), field)).layout.field.entrance
        assert found == pytest.approx((60.0, 50.0), abs=1e-3)
        with pytest.raises(FieldError, match="degrees of longitude"):
            prepare_context(WorkOrder(PlanRequest(field="box", entrance=(lat, 95.0)), field))


def line(*points: tuple[float, float], task: str = "drive", speed: float = 1.0) -> Leg:
    return Leg(np.array(points), speed, task=LegTask(task))


class TestOffTheField:
    """A tractor that enters is in nobody's way before it does, one that leaves is not after it has."""

    @pytest.mark.slow
    @pytest.mark.parametrize("slow", [False, True])
    @pytest.mark.parametrize(("kind", "outcome"), [((ENTER, LEAVE), DONE), (("drive", "drive"), "conflict")])
    def test_two_begin_and_end_at_one_place(self, kind: tuple[str, str], outcome: str, slow: bool) -> None:
        paths = [line((0, 0), (15, 0), task=kind[0]), line((15, 0), (30, 0), task=kind[1])]
        plan = Plan((Mission(tuple(paths)), Mission(tuple(paths))))
        plan = plan.copy_with_gate(1, 0, LegGate(0, 1, 0.0))
        run = World(plan, load_tractor("eg105"), Implement()).run(stop_clearance_m=0.5, slow=slow)
        assert run.outcome == outcome
        if outcome == DONE:
            assert not run.contacts and 5.0 < run.min_clearance_m < 15.0


class TestPlan:
    @pytest.mark.parametrize(("strategy", "tractors"), CASES)
    def test_everybody_comes_in_and_goes_out_by_the_gate(self, strategy: str, tractors: int) -> None:
        one = driven(strategy, tractors)
        assert one.result.feasible, one.result.reason
        for tractor, mission in enumerate(one.run.plan.missions):
            assert mission.enters and mission.leaves
            kinds = [leg.task.kind for leg in mission.legs]
            assert kinds.index(LEAVE) > max(n for n, leg in enumerate(mission.legs) if leg.implement)
            assert not any(leg.implement for leg in mission.legs if leg.task.kind in (ENTER, LEAVE))
            path = compute_guided_path(one.run, site(), tractor)
            assert math.dist(path[0], GATE) < 0.3
            gone = int(np.searchsorted(one.run.time_s, one.run.finish_s[tractor]))
            assert math.dist(path[min(gone, len(path) - 1)], GATE) < 0.5

    @pytest.mark.parametrize(("strategy", "tractors"), CASES)
    def test_no_two_are_in_the_gate_at_once(self, strategy: str, tractors: int) -> None:
        """From the record alone: while both are near the gate no two outlines come together."""
        found = driven(strategy, tractors).run
        model = np.array([build_model_record(site().tractor, site().implement)])
        present = []
        for tractor in range(tractors):
            on = (found.get_leg_numbers(tractor) > 0) | (np.abs(found.record[:, tractor, 4]) > 1e-3)
            on &= found.time_s < found.finish_s[tractor]
            near = np.hypot(*(compute_guided_path(found, site(), tractor) - GATE).T) < 15.0
            present.append(np.flatnonzero(on & near))
        for one in range(tractors):
            for other in range(one):
                both = np.intersect1d(present[one], present[other])
                poses = [build_poses(found.get_poses(tractor)[both]) for tractor in (one, other)]
                pairs = find_conflicting_poses(PosePath(poses[0]), PosePath(poses[1]), model, 0.3, 0.05)
                assert not (pairs[:, 0] == pairs[:, 1]).any()

    def test_one_alone_takes_the_time_of_its_ways_longer(self) -> None:
        """In and out take their length over the speed of turns, setting off, and some seconds where gears change."""
        run = driven("split-field", 1).run
        legs = run.plan.missions[0].legs
        paths = {kind: [leg for leg in legs if leg.task.kind == kind] for kind in (ENTER, LEAVE)}
        begun = float(run.time_s[np.argmax(run.get_leg_numbers(0) >= len(paths[ENTER]))])
        for way, seconds in ((paths[ENTER], begun), (paths[LEAVE], run.duration_s - run.work_finish_s)):
            least = math.fsum(leg.length_m / leg.speed_mps for leg in way)
            changes = sum(one.gear != other.gear for one, other in pairwise(way))
            assert least - 1.0 < seconds < least + 3.0 + 9.0 * changes
        result = driven("split-field", 1).result
        assert result.done_s == pytest.approx(run.work_finish_s) and result.time_s == run.duration_s

    def test_the_lists_tell_the_ways(self) -> None:
        run = driven("split-field", 3).run
        assert run is not None
        for steps in list_steps(run, 3.0):
            words = [describe_leg(step) for step in steps if step.kind != "wait"]
            works = next(step for step in steps if step.kind in (SWATH, HEADLAND_PASS))
            what = f"{'track' if works.kind == SWATH else 'round'} {works.number}"
            assert words[0].startswith(f"from the entrance to {what}") and "to the entrance" in words[-1]
            assert sum("entrance" in each for each in words if not each.startswith("on to")) == 2

    def test_saved_and_driven_again_it_is_the_same(self) -> None:
        run = driven("split-field", 3).run
        again = World(parse_saved_plan(format_plan(run.plan)).plan, site().tractor, site().implement).run()
        assert np.array_equal(again.record, run.record)

    @pytest.mark.slow
    def test_a_fence_all_round_is_passed_at_the_gate_alone(self) -> None:
        fence = shapely.LineString(BOX.exterior.coords)
        pen = prepare_context(
            WorkOrder(PlanRequest(field="pen", margin_m=0.3), Field("pen", BOX, fences=(fence,), entrance=GATE))
        )
        result = simulate_candidate(pen, Candidate("split-field", 2)).result
        assert result.feasible, result.reason


class TestWithout:
    @pytest.mark.slow
    def test_an_entrance_nothing_changes(self) -> None:
        """A plan without one has no way in or out, and time is that of its work."""
        one = driven("split-field", 3, None)
        assert one.result.time_s == one.result.done_s == one.run.work_finish_s
        assert not any(leg.task.kind in (ENTER, LEAVE) for m in one.run.plan.missions for leg in m.legs)

    @pytest.mark.parametrize("strategy", list(STRATEGIES))
    def test_rounds_plans_of_tracks_are_what_they_were(self, strategy: str) -> None:
        """Tracks only: an entrance is where to begin, as ever, and no way from it is driven."""
        only = site_at(GATE, no_headland=True)
        run = simulate_candidate(only, Candidate(strategy, 2)).run
        assert only.gateway is None
        assert not any(mission.enters or mission.leaves for mission in run.plan.missions)
