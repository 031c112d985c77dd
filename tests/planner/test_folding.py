"""Implements that fold where they have no room else: two rooms of a field that a narrow passage joins."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from fields.geometry.field import Field
from fields.units import MINUTE_S
from planner import PlanRequest, plan
from planner.errors import HeadlandError, RequestError
from planner.evaluation.ground.contact_places import find_contact_places, measure_overhang
from planner.evaluation.ground.coverage import compute_guided_path, measure_outside_m
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.farm.machines import FarmImplement
from planner.farm.settings import FarmTimes
from planner.pipeline.outputs.driving_steps import list_steps
from planner.pipeline.outputs.step_measures import measure_steps
from planner.pipeline.planning import PlanningResult, plan_order
from reports.plan.leg_list import describe_leg
from vehicle.errors import MissionError
from vehicle.missions.plan import ENTER, LEAVE, Leg, Mission, Plan
from vehicle.missions.plan_file import format_plan, parse_plan
from vehicle.model.tractor import Implement
from vehicle.records import STANDING

pytestmark = pytest.mark.usefixtures("first_layout")

WIDTH_M, ROOM_M, PASSAGE_M = 9.0, (63.0, 54.0), (15.0, 6.0)
FOLD_S = 30.0
CORNER_M = shapely.box(0.0, 0.0, 160.0, 90.0)


def build_two_rooms() -> Field:
    """Two rooms of ROOM_M, one beside the other, joined by a passage of PASSAGE_M."""
    (length, height), (gap, half) = ROOM_M, (PASSAGE_M[0], 0.5 * PASSAGE_M[1])
    rooms = [shapely.box(x, 0.0, x + length, height) for x in (0.0, length + gap)]
    passage = shapely.box(length - 1.0, 0.5 * height - half, length + gap + 1.0, 0.5 * height + half)
    return Field("two rooms", shapely.union_all([*rooms, passage]))


def plan_rooms(**options: Any) -> PlanningResult:
    return plan(PlanRequest(width_m=WIDTH_M, tractors=(1,), **options), field=build_two_rooms())


@pytest.fixture(scope="module")
def folding() -> PlanningResult:
    return plan_rooms()


@pytest.fixture(scope="module")
def two_rooms_farm() -> FarmImplement:
    """A sprayer with a tank for half of the field."""
    return FarmImplement(name="sprayer", width_m=WIDTH_M, capacity=70.0, rate_per_m2=0.02)


@pytest.fixture(scope="module")
def rigid() -> PlanningResult:
    return plan_rooms(transport_width_m=WIDTH_M)


def list_legs(result: PlanningResult) -> tuple[Leg, ...]:
    return result.run.plan.missions[0].legs


@pytest.mark.parametrize(
    ("implement", "folded_m"),
    [
        (Implement(width_m=3.0), None),  # its frame of 2.7 m goes on the road as it is
        (Implement(width_m=12.0), 3.0),
        (Implement(width_m=12.0, transport_width_m=2.5), 2.5),
        (Implement(width_m=12.0, transport_width_m=12.0), None),
        (Implement(width_m=12.0, frame_width_m=2.9), None),
    ],
)
def test_what_is_wider_than_a_road_folds(implement: Implement, folded_m: float | None) -> None:
    assert implement.folds == (folded_m is not None)
    assert implement.folded.contact_width_m == (folded_m or implement.contact_width_m)
    assert implement.folded.width_m == implement.width_m


@pytest.mark.slow
def test_both_rooms_are_worked_by_a_machine_that_folds(folding: PlanningResult, rigid: PlanningResult) -> None:
    """The other room is half of the field: 3,402 of 6,906 m2."""
    whole, half = folding.ranking.best, rigid.ranking.best
    assert whole.worked_pct > 90.0 and half.worked_pct == pytest.approx(0.5 * whole.worked_pct, abs=2.0)
    assert "to fold and unfold" in whole.remark and "fold" not in half.remark
    assert half.largest_missed.reason == "cut off: no passage as wide as the machines (9 m)"
    assert not any(leg.folded for leg in list_legs(rigid))


@pytest.mark.parametrize(("options", "apart"), [({}, [True, False]), ({"transport_width_m": WIDTH_M}, [True, True])])
def test_a_way_to_the_other_room_is_sought_with_the_implement_folded_alone(
    options: dict[str, float], apart: list[bool]
) -> None:
    request = PlanRequest(width_m=WIDTH_M, tractors=(1,), **options)
    moves = get_site_moves(prepare_context(WorkOrder(request, field=build_two_rooms())))
    rooms = np.array([begin[0] > ROOM_M[0] for begin in moves.begins[:-1]])
    is_other = np.not_equal.outer(rooms, rooms)
    for is_apart, expected in zip(moves.estimates.is_apart[:, :-1, :-1], apart, strict=True):
        assert (is_apart[is_other] == expected).all()
    assert not moves.estimates.is_apart[0][:-1, :-1][~is_other].any()


@pytest.mark.slow
def test_the_tractor_stands_to_fold_and_to_unfold(folding: PlanningResult) -> None:
    legs = list_legs(folding)
    turns = [(before, leg) for before, leg in pairwise(legs) if before.folded != leg.folded]
    assert not any(leg.stand_s for leg in legs)
    assert turns and len(turns) % 2 == 0  # it begins and ends unfolded
    assert all(leg.fold_s == FOLD_S for _, leg in turns)
    assert sum(leg.fold_s for leg in legs) == FOLD_S * len(turns)
    assert not any(leg.folded and leg.implement for leg in legs)
    assert f"stands {FOLD_S * len(turns) / MINUTE_S:.1f} min in all" in folding.ranking.best.remark  # type: ignore[union-attr]


@pytest.mark.slow
def test_a_machine_stands_as_long_as_legs_say(folding: PlanningResult) -> None:
    run = folding.run
    number = next(k for k, leg in enumerate(run.plan.missions[0].legs) if leg.folded)
    poses = run.get_poses(0)[run.get_leg_numbers(0) == number]
    still_s = sum(math.dist(a[:2], b[:2]) < 1e-3 for a, b in pairwise(poses)) * (run.time_s[1] - run.time_s[0])
    assert still_s == pytest.approx(FOLD_S, abs=2.0)


@pytest.mark.slow
def test_nothing_is_touched_folded_or_not(folding: PlanningResult) -> None:
    run, context = folding.run, folding.context
    assert run is not None
    assert find_contact_places(run, context) == ()
    assert measure_overhang(run, context).farthest_m < context.request.overhang_m + 0.1
    legs = tuple(leg.copy_with(folded=False) for leg in list_legs(folding))
    unfolded = replace(run, plan=Plan((Mission(legs),)))
    assert measure_overhang(unfolded, context).farthest_m > 0.5 * (0.9 * WIDTH_M - PASSAGE_M[1]) - 0.1


@pytest.mark.slow
def test_a_saved_plan_keeps_what_is_folded(folding: PlanningResult) -> None:
    read = parse_plan(format_plan(folding.run.plan))
    assert [leg.folded for leg in read.missions[0].legs] == [leg.folded for leg in list_legs(folding)]
    text = format_plan(folding.run.plan).replace('"folded": true', '"folded": "yes"', 1)
    with pytest.raises(MissionError, match="folded"):
        parse_plan(text)


@pytest.mark.slow
def test_a_leg_does_not_work_folded(folding: PlanningResult) -> None:
    leg = next(leg for leg in list_legs(folding) if leg.folded)
    assert "folded" in leg.copy_with(implement=True).fault


@pytest.mark.parametrize("width_m", [0.0, -1.0, math.nan, math.inf])
def test_a_width_that_is_none_is_refused(width_m: float) -> None:
    with pytest.raises(RequestError, match="transport width"):
        PlanRequest(transport_width_m=width_m)


def test_a_folded_implement_is_no_wider_than_at_work() -> None:
    with pytest.raises(RequestError, match="A transport width of 14 m is more than the 6 m of the implement"):
        prepare_context(WorkOrder(PlanRequest(width_m=6.0, transport_width_m=14.0), field=Field("f", CORNER_M)))
    with pytest.raises(ValueError, match="A transport width of 14 m is more than the 6 m of the implement"):
        FarmImplement(name="drill", width_m=6.0, transport_width_m=14.0)
    assert not FarmImplement(name="drill", width_m=2.5).simulated_implement.folds, "the usual width is no mistake"


@pytest.mark.slow
def test_the_driver_reads_where_to_fold(folding: PlanningResult) -> None:
    run = folding.run
    steps = list_steps(run, WIDTH_M, measure_steps(run, folding.context.tractor, folding.context.physics))[0]
    stands = [step for step in steps if step.kind in ("fold", "unfold")]
    assert [step.kind for step in stands] == ["fold", "unfold"] * (len(stands) // 2) and stands
    assert [step.seconds for step in stands] == pytest.approx([FOLD_S] * len(stands), abs=0.2)
    assert "refill" not in {step.kind for step in steps}
    assert describe_leg(stands[0]) == "fold the implement"
    total_s = sum(float(seconds[0]) for seconds in run.sum_seconds_by_status().values())
    assert total_s == pytest.approx(run.duration_s, abs=1.0) and float(run.standing_s[0]) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("at_s", [5.0, 60.0])
def test_a_machine_that_stands_folded_goes_on_folded(folding: PlanningResult, tmp_path: Path, at_s: float) -> None:
    """Some seconds after it began to fold it is unfolded still; on its way it need not fold."""
    run = folding.run
    begun_s = float(run.time_s[int(np.argmax(run.find_folding_rows(0)))])
    folding.save(tmp_path / "plan.json")
    moment = round(begun_s + at_s)
    done = f"{tmp_path / 'plan.json'}@0:{moment // 60:02}:{moment % 60:02}"
    result = plan_order(WorkOrder(folding.context.request, field=build_two_rooms(), done=(done,)))
    legs = list_legs(result)
    assert legs[0].folded == (at_s > FOLD_S)
    first = next(number for number, leg in enumerate(legs) if leg.folded)
    assert legs[first].fold_s == (0.0 if legs[0].folded else FOLD_S)
    assert next(leg for leg in legs[first:] if not leg.folded).fold_s == FOLD_S


@pytest.mark.slow
def test_a_tank_is_filled_where_a_boom_folds(two_rooms_farm: FarmImplement, tmp_path: Path) -> None:
    """Stops for the tank, on a line too, are no folding."""
    order = WorkOrder(
        PlanRequest(width_m=WIDTH_M, tractors=(1,), refill="headland"),
        field=build_two_rooms(),
        implement=two_rooms_farm.simulated_implement,
        supply=two_rooms_farm.build_supply(240.0),
    )
    result = plan_order(order)
    best, legs = result.ranking.best, list_legs(result)
    stops_s = [leg.stand_s for leg in legs if leg.stand_s]
    assert best.refills and stops_s == [240.0] * best.refills
    served = (result.run.get_statuses(0) == STANDING) & ~result.run.find_folding_rows(0)
    begun_s = float(result.run.time_s[int(np.argmax(served))])
    result.save(tmp_path / "plan.json")
    for at_s, refills in ((begun_s + 30.0, best.refills), (begun_s + 250.0, best.refills - 1)):
        order = replace(
            order, done=(f"{tmp_path / 'plan.json'}@{at_s // 3600:.0f}:{at_s % 3600 // 60:02.0f}:{at_s % 60:02.0f}",)
        )
        rest = plan_order(order).ranking.best
        assert rest is not None and rest.refills == refills, "a tank is full once it was filled to the end"
    folds = sum(before.folded != leg.folded for before, leg in pairwise(legs))
    assert folds and float(result.run.folding_s[0]) == pytest.approx(FOLD_S * folds, abs=1.0)
    assert float(result.run.standing_s[0]) == pytest.approx(240.0 * best.refills, abs=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("width_m", "folds"), [(6.0, False), (12.0, True)])
@pytest.mark.parametrize("place_m", [3.0, 45.0])
def test_a_gate_is_passed_folded_where_it_is_too_narrow(width_m: float, folds: bool, place_m: float) -> None:
    """Near a corner or not: the lane through it is no ground of lines and turns, and a gate of 10 m takes no 12 m."""
    gated = Field("gated", CORNER_M, entrance=(0.0, place_m))
    result = plan(PlanRequest(width_m=width_m, tractors=(1,)), field=gated)
    best, legs, run = result.ranking.best, list_legs(result), result.run
    assert (best.worked_pct or 0.0) > 97.0
    assert ("for the entrance" in (best.remark or "")) == folds
    passes = [leg for leg in legs if leg.task.kind in (ENTER, LEAVE)]
    assert {leg.folded for leg in passes} == {folds}
    assert float(run.folding_s[0]) == pytest.approx(2.0 * FOLD_S * folds, abs=1.0)
    assert (best.measured["folding_s"] or 0.0) == pytest.approx(float(run.folding_s[0]))
    within = run.find_task_rows(0, (ENTER, LEAVE))
    guided = compute_guided_path(run, result.context, 0)
    outside_m = shapely.distance(shapely.points(guided), CORNER_M)
    assert float(outside_m[~within].max()) < 0.5
    assert float(measure_outside_m(run, 0, result.context)[within].max()) < 0.5


@pytest.mark.slow
def test_all_tractors_that_fold_are_told_and_lists_count_from_the_start_as_the_answer(tmp_path: Path) -> None:
    gated = Field("gated", CORNER_M, entrance=(0.0, 45.0))
    request = PlanRequest(width_m=12.0, tractors=(2,), strategies=("split-field",))
    result = plan_order(WorkOrder(request, field=gated, times=FarmTimes(unfold_s=400.0)))
    best, (drawn, *_) = result.ranking.best, result.pictures.values()
    assert "tractors 1 and 2 stand " in (best.remark or "")
    assert {steps[0].clock_s for steps in drawn.steps} == {best.ready_s} == {400.0 - FOLD_S}
    worked = [step for steps in drawn.steps for step in steps if step.kind in ("track", "round")]
    worked_s = max(step.clock_s + step.seconds for step in worked)
    assert worked_s == pytest.approx(best.stated_end_s, abs=1.0)
    result.save(tmp_path / "plan.json")
    with pytest.raises(HeadlandError, match=r"is in the field from 0:06 h to 0:\d\d h, as .*, and 0:05 is not"):
        plan_order(WorkOrder(request, field=gated, done=(f"{tmp_path}/plan.json@0:05",)))
