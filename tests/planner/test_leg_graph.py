"""The graph of legs and gates: it gives back the run it was made from, and longest paths that can be added by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.farm.random_inputs import build_certain_settings
from planner.risk.leg_graph import TURN_OVER_MORE, TURN_OVER_ONE, WORK_PASS, build_leg_graph
from planner.risk.monte_carlo import sample_outcomes
from vehicle.missions.plan import SWATH, TURN, FollowOrder, Leg, LegGate, LegTask, Mission, Plan
from vehicle.missions.run import SimulationRun
from vehicle.records import WAITING
from vehicle.sim.world import World

pytestmark = pytest.mark.usefixtures("first_layout")

SPEED = 5 / 3.6


def line(x0: float, x1: float, y: float, *gates: LegGate, follow: FollowOrder | None = None, number: int = 0) -> Leg:
    points = np.array([[x0, y], [x1, y]], float)
    return Leg(points, SPEED, implement=True, task=LegTask(SWATH, number), gates=gates, follow=follow)


def driven(site: Any, plan: Plan) -> SimulationRun:
    return World(plan, site.tractor, site.implement).run(max_time_s=4000.0)


def finishes(run: SimulationRun) -> Any:
    return sample_outcomes(build_leg_graph(run), build_certain_settings(), samples=1, seed=1).tractor_finish_s[:, 0]


@pytest.mark.parametrize(
    ("strategy", "tractors"), [("row-by-row", 3), ("row-by-row-optimised", 3), ("col-by-col", 5), ("interleaved", 3)]
)
def test_unchanged_legs_give_back_a_plan_that_waits(wide_site: Any, strategy: str, tractors: int) -> None:
    run = run_candidate(wide_site, Candidate(strategy, tractors)).run
    assert run.sum_seconds(WAITING).sum() > 20.0
    assert finishes(run) == pytest.approx(run.finish_s, rel=0.01)


def test_rounds_of_the_headland_are_given_back_too(place: Any) -> None:
    import shapely

    site = place(shapely.box(0, 0, 36, 80), (0.0, 0.0), no_headland=False)
    run = run_candidate(site, Candidate("split-field", 2)).run
    assert finishes(run) == pytest.approx(run.finish_s, rel=0.01)


def test_one_tractor_without_gates_is_the_sum_of_its_legs(small_site: Any) -> None:
    run = driven(small_site, Plan((Mission((line(0, 30, 0), line(30, 50, 0))),)))
    graph = build_leg_graph(run)
    assert graph.links == ()
    assert graph.driven_s.sum() == pytest.approx(run.finish_s[0], abs=1e-9)
    # 30 m at 5 km/h, and half a metre more to get under way at 0.7 m/s2
    assert graph.driven_s[0] == pytest.approx(30 / SPEED + SPEED / 2 / 0.7, abs=0.3)


def test_waiting_is_no_driving_and_comes_back_through_the_gate(small_site: Any) -> None:
    first = Mission((line(0, 60, 20),))
    second = Mission((line(0, 20, 0), line(20, 40, 0, LegGate(0, 0, 50.0))))
    run = driven(small_site, Plan((first, second)))
    graph = build_leg_graph(run)
    assert run.sum_seconds(WAITING)[1] > 15.0
    alone = build_leg_graph(driven(small_site, Plan((Mission((line(0, 20, 0), line(20, 40, 0))),))))
    assert graph.driven_s[1:] == pytest.approx(alone.driven_s, abs=0.3)  # as if nobody had waited
    assert finishes(run) == pytest.approx(run.finish_s, abs=0.2)
    (link,) = graph.links
    assert (link.source, link.after) == (0, 2)
    assert link.offset_s == pytest.approx(50 / SPEED + SPEED / 2 / 0.7, abs=0.4)
    assert link.delay_s == pytest.approx(SPEED / 2 / 0.7, abs=0.4)  # to move off again


def test_a_slow_leader_makes_its_follower_late(small_site: Any) -> None:
    leader = Mission((line(12, 60, 20),))
    follower = Mission((line(0, 48, 0, follow=FollowOrder(0, 0, 10.0)),))
    graph = build_leg_graph(driven(small_site, Plan((leader, follower))))
    (link,) = graph.links
    slow = replace(graph, driven_s=graph.driven_s * [2.0, 1.0], links=(replace(link, offset_s=2.0 * link.offset_s),))
    before, after = (
        sample_outcomes(each, build_certain_settings(), samples=1, seed=1).tractor_finish_s[1, 0]
        for each in (graph, slow)
    )
    assert after - before == pytest.approx(link.offset_s, abs=1.0)


def test_passes_and_turns_are_told_apart_by_the_tracks_between(small_site: Any) -> None:
    def turn(x: float, number: int) -> Leg:
        return Leg(np.array([[x, 0], [x + 5, 0]], float), SPEED, task=LegTask(TURN, number))

    legs = (
        line(0, 10, 0, number=1), line(10, 20, 0, number=1), turn(20, 2), turn(25, 2), line(30, 40, 0, number=2),
        turn(40, 5), line(45, 55, 0, number=5),
    )  # fmt: skip
    graph = build_leg_graph(driven(small_site, Plan((Mission(legs),))))
    assert graph.group.tolist() == [0, 0, 1, 1, 2, 3, 4]
    assert graph.kind.tolist() == [
        WORK_PASS,
        WORK_PASS,
        TURN_OVER_ONE,
        TURN_OVER_ONE,
        WORK_PASS,
        TURN_OVER_MORE,
        WORK_PASS,
    ]
    assert graph.worked_m.tolist() == pytest.approx([10, 10, 0, 0, 10, 0, 10])


def test_the_order_puts_every_leg_after_those_it_waits_for(wide_site: Any) -> None:
    graph = build_leg_graph(run_candidate(wide_site, Candidate("row-by-row", 3)).run)
    begins = {node: index for index, node in reversed(list(enumerate(graph.order)))}
    ends = {node: index for index, node in enumerate(graph.order)}
    assert sorted(begins) == list(range(graph.node_count))
    assert {node for node in ends if ends[node] > begins[node]} == {link.after for link in graph.links if link.at_end}
    assert all(begins[link.source] < (ends if link.at_end else begins)[link.after] for link in graph.links)


def test_a_leader_may_wait_for_its_follower_to_have_begun(small_site: Any) -> None:
    """Who goes in first follows who comes in after it: a circle of legs, and none of what really waits."""
    leader = Mission((line(0, 12, 20, LegGate(1, 0, 5.0)), line(12, 60, 20)))
    follower = Mission((line(0, 48, 0, follow=FollowOrder(0, 1, 10.0)),))
    run = driven(small_site, Plan((leader, follower)))
    assert run.sum_seconds(WAITING)[0] > 1.0
    assert build_leg_graph(run).order == (2, 0, 1, 2)
    assert finishes(run) == pytest.approx(run.finish_s, abs=0.3)


def test_a_leader_that_sets_out_when_its_follower_is_done_holds_nobody(small_site: Any) -> None:
    leader = Mission((line(0, 12, 20, LegGate(1, 1, 5.0)), line(12, 60, 20)))
    follower = Mission((line(0, 20, 0, follow=FollowOrder(0, 1, 10.0)), line(20, 40, 0)))
    run = driven(small_site, Plan((leader, follower)))
    assert [link.at_end for link in build_leg_graph(run).links] == [False]
    assert finishes(run) == pytest.approx(run.finish_s, abs=0.3)


def test_a_run_that_was_not_finished_has_no_graph(small_site: Any) -> None:
    run = World(Plan((Mission((line(0, 60, 0),)),)), small_site.tractor, small_site.implement).run(max_time_s=5.0)
    with pytest.raises(ValueError, match="timeout"):
        build_leg_graph(run)
