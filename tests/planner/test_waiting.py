"""Optimised waiting and giving way: never slower, no contact, the same every time."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from strategies.formations.release_times import measure_outline_extents

from planner.evaluation.candidates.evaluate import Candidate, compute_candidate_figures, run_candidate
from planner.traffic.conflict_repair import can_gates_open, resolve_conflicts
from strategies.program.strategy_record import RefinedPlan
from strategies.registry import STRATEGIES
from strategies.row_by_row import form_row_by_row
from strategies.row_by_row_optimised import NOT_QUICKER_REMARK, refine_optimised
from tests.examples import seldom
from vehicle.missions.plan import DRIVE, SWATH, Leg, LegGate, LegTask, Mission, Plan
from vehicle.missions.plan_file import format_plan
from vehicle.missions.run import CONFLICT, DONE, STALL, SimulationRun
from vehicle.sim.world import World

SPEED = 5 / 3.6


def simulate(site: Any, plan: Plan) -> SimulationRun:
    return World(plan, site.tractor, site.implement).run(stop_clearance_m=0.05, max_time_s=8000.0)


def test_the_outline_on_the_headland_is_that_of_the_contact_shapes(small_site: Any) -> None:
    tractor, implement = small_site.tractor, small_site.implement
    job = small_site.build_job(1)
    formation = form_row_by_row(job)
    slot = formation.rounds[1][0]
    poses = np.array([(4.0, 70.0, turned) for turned in np.radians(np.arange(0.0, 360.0, 2.0))])
    along, across = measure_outline_extents(job, slot, poses, tractor, implement)
    body = World(formation.plan, tractor, implement).bodies[0]
    out, sign = job.compute_heading(slot.swath_pass) + math.pi, 1 if slot.swath_pass.direction > 0 else -1
    for (x, y, turned), reach, sides in zip(poses, along, across, strict=True):
        body.position, body.angle = (x, y), turned
        corners = [body.local_to_world(corner) for shape in body.shapes for corner in shape.get_vertices()]
        aside = [sign * (c.y * math.cos(out) - c.x * math.sin(out)) for c in corners]
        assert reach == pytest.approx(max(c.x * math.cos(out) + c.y * math.sin(out) for c in corners))
        assert sides == pytest.approx((min(aside), max(aside)))


class TestOptimised:
    @pytest.mark.parametrize("tractors", [2, *seldom(3), 5])
    def test_is_never_slower_than_row_by_row_and_touches_nothing(
        self, wide_site: Any, evaluate_once: Any, tractors: int
    ) -> None:
        plain, timed = (evaluate_once(wide_site, n, tractors) for n in ("row-by-row", "row-by-row-optimised"))
        assert plain.feasible and timed.feasible, (plain.reason, timed.reason)
        assert timed.time_s <= plain.time_s
        assert timed.collisions == 0 and timed.min_clearance_m > 0
        assert timed.waiting_s <= plain.waiting_s

    def test_gains_where_rows_queue(self, wide_site: Any, evaluate_once: Any) -> None:
        plain, timed = (evaluate_once(wide_site, n, 5).time_s for n in ("row-by-row", "row-by-row-optimised"))
        assert timed < 0.95 * plain

    def test_works_what_row_by_row_works(self, wide_site: Any, evaluate_once: Any) -> None:
        plain, timed = (evaluate_once(wide_site, n, 5) for n in ("row-by-row", "row-by-row-optimised"))
        assert timed.worked_pct == pytest.approx(plain.worked_pct, abs=0.5)

    def test_is_the_same_every_time(self, wide_site: Any) -> None:
        twice = []
        for _ in range(2):
            refined = refine_optimised(
                wide_site.build_job(3), lambda p: simulate(wide_site, p), wide_site.tractor, wide_site.implement
            )
            twice.append((format_plan(refined.plan), refined.run and refined.run.duration_s))
        assert twice[0] == twice[1]

    def test_one_tractor_has_nothing_to_optimise(self, wide_site: Any, evaluate_once: Any) -> None:
        times = {evaluate_once(wide_site, n, 1).time_s for n in ("row-by-row", "row-by-row-optimised", "col-by-col")}
        assert len(times) == 1
        optimised, plain = (evaluate_once(wide_site, n, 1).remark for n in ("row-by-row-optimised", "row-by-row"))
        assert optimised.startswith("a single tractor has nobody to wait for")
        assert "wait" not in (plain or "") and optimised.endswith(plain or ""), "only the reach over edges may be told"

    def test_a_plan_that_fell_back_says_so(
        self, wide_site: Any, evaluate_once: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def nothing_quicker(job: Any, run: Any, *_: Any) -> RefinedPlan:
            plan = form_row_by_row(job).plan
            return RefinedPlan(plan, run(plan), NOT_QUICKER_REMARK)

        timed = evaluate_once(wide_site, "row-by-row-optimised", 3)
        slow = replace(STRATEGIES["row-by-row-optimised"], refine=nothing_quicker)
        monkeypatch.setitem(STRATEGIES, "row-by-row-optimised", slow)
        fallen = compute_candidate_figures(wide_site, Candidate("row-by-row-optimised", 3))
        assert "no optimised queue" not in (timed.remark or "") and timed.time_s < fallen.time_s
        assert fallen.time_s == evaluate_once(wide_site, "row-by-row", 3).time_s
        assert (fallen.remark or "").startswith("optimised waiting was not quicker: driven as row-by-row")

    def test_a_conflict_on_every_try_falls_back_to_the_plain_queue(self, wide_site: Any) -> None:
        def clumsy(plan: Plan) -> SimulationRun:
            run = simulate(wide_site, plan)
            timed = plan.notes["strategy"] == "row-by-row-optimised"
            return replace(run, outcome=CONFLICT) if timed else run

        job = wide_site.build_job(3)
        refined = refine_optimised(job, clumsy, wide_site.tractor, wide_site.implement)
        assert refined.plan.notes["strategy"] == "row-by-row" and refined.remark == NOT_QUICKER_REMARK
        assert refined.run is not None and refined.run.outcome == DONE


def leg(*points: tuple[float, float], work: bool = True, hold: bool = False, gates: tuple[LegGate, ...] = ()) -> Leg:
    task = LegTask(SWATH if work else DRIVE)
    return Leg(np.array(points, float), SPEED, implement=work, task=task, may_wait=hold, gates=gates)


def crossing(second_start: float = -40.0) -> Plan:
    """Two tractors whose paths cross at right angles at (0, 0), the second from `second_start` on the y axis."""
    along_x = Mission((leg((-40, 0), (-12, 0)), leg((-12, 0), (-9, 0), hold=True), leg((-9, 0), (40, 0), work=False)))
    along_y = Mission(
        (leg((0, second_start), (0, -12)), leg((0, -12), (0, -9), hold=True), leg((0, -9), (0, 40), work=False))
    )
    return Plan((along_x, along_y))


class TestGivingWay:
    def test_without_orders_the_crossing_is_a_conflict(self, small_site: Any) -> None:
        assert simulate(small_site, crossing()).outcome == CONFLICT

    def test_one_waits_for_the_other_and_neither_touches(self, small_site: Any) -> None:
        run, why = resolve_conflicts(crossing(), lambda plan: simulate(small_site, plan))
        assert (run.outcome, why) == (DONE, None)
        assert run.contacts == () and run.min_clearance_m > 0.05
        added = [len(leg.gates) for mission in run.plan.missions for leg in mission.legs]
        assert sum(added) >= 1

    def test_whoever_comes_later_gives_way(self, small_site: Any) -> None:
        run, why = resolve_conflicts(crossing(-43.0), lambda plan: simulate(small_site, plan))
        assert why is None
        waits = [sum(len(leg.gates) for leg in mission.legs) for mission in run.plan.missions]
        assert waits[0] == 0 and waits[1] >= 1
        assert run.finish_s[1] > run.finish_s[0]

    def test_a_plan_without_conflict_is_left_alone(self, small_site: Any) -> None:
        plan = Plan((Mission((leg((0, 0), (40, 0)),)), Mission((leg((0, 12), (40, 12)),))))
        run, why = resolve_conflicts(plan, lambda p: simulate(small_site, p))
        assert why is None and format_plan(run.plan) == format_plan(plan)

    def test_head_on_is_refused_naming_both_and_the_time(self, small_site: Any) -> None:
        plan = Plan((Mission((leg((-40, 0), (40, 0)),)), Mission((leg((40, 0), (-40, 0)),))))
        run, why = resolve_conflicts(plan, lambda p: simulate(small_site, p))
        assert run.outcome != DONE
        assert why is not None and ("tractors 1 and 2" in why or "wait for each other" in why)

    def test_waiting_for_each_other_is_refused(self, small_site: Any) -> None:
        first = Mission((leg((0, 0), (10, 0)), leg((10, 0), (20, 0), gates=(LegGate(1, 1, 5.0),))))
        second = Mission((leg((0, 20), (10, 20)), leg((10, 20), (20, 20), gates=(LegGate(0, 1, 5.0),))))
        run, why = resolve_conflicts(Plan((first, second)), lambda p: simulate(small_site, p))
        assert run.outcome == STALL
        assert why is not None and "wait for each other" in why

    def test_who_waits_in_a_circle_is_known_without_driving(self, small_site: Any) -> None:
        free = crossing()
        one = free.copy_with_gate(0, 1, LegGate(1, 2, 20.0))
        both = one.copy_with_gate(1, 1, LegGate(0, 2, 20.0))
        for plan, open_ in ((free, True), (one, True), (both, False)):
            assert can_gates_open(plan) is open_
            assert open_ or simulate(small_site, plan).outcome == STALL
        behind = free.copy_with_gate(0, 2, LegGate(1, 1, 1.0)).copy_with_gate(
            1, 2, LegGate(0, 1, 1.0)
        )  # each passes the other's gate
        assert can_gates_open(behind)

    def test_no_order_that_holds_all_up_is_driven(self, small_site: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        """Two on one line, each of which may stand before the middle."""
        paths = [[(-40 * side, 0), (-12 * side, 0), (-9 * side, 0), (40 * side, 0)] for side in (1, -1)]
        plan = Plan(tuple(Mission(tuple(leg(*path[k : k + 2], hold=k == 1) for k in range(3))) for path in paths))
        driven: dict[bool, list[Plan]] = {True: [], False: []}
        for known in driven:
            if not known:
                monkeypatch.setattr("planner.traffic.conflict_repair.can_gates_open", lambda _: True)

            def drive(tried: Plan, known: bool = known) -> SimulationRun:
                driven[known].append(tried)
                return simulate(small_site, tried)

            assert resolve_conflicts(plan, drive)[1] is not None
        assert all(can_gates_open(tried) for tried in driven[True])
        assert not all(can_gates_open(tried) for tried in driven[False])

    def test_repairing_is_repeatable(self, small_site: Any) -> None:
        plans = [resolve_conflicts(crossing(), lambda p: simulate(small_site, p))[0].plan for _ in range(2)]
        assert format_plan(plans[0]) == format_plan(plans[1])


def test_a_fleet_on_a_real_parcel_keeps_apart() -> None:
    from planner.evaluation.context import prepare_context
    from planner.request.plan_request import PlanRequest

    site = prepare_context(PlanRequest(field="netherlands", no_headland=True))
    for name in ("interleaved", "split-field"):
        tried = run_candidate(site, Candidate(name, 4))
        assert tried.reason is None and tried.run.contacts == () and tried.run.min_clearance_m > 0
