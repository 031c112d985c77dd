"""Gates between headland and tracks: only where one tractor drives over another's ground, and never in a circle."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from strategies.programmes.stages import add_order_gates
from vehicle.missions.plan import HEADLAND_PASS, SWATH, TURN, Leg, LegGate, LegTask, Mission, Plan

SITE: Any = SimpleNamespace(rules=SimpleNamespace(tool_m=1.0), width_m=4.0)
BODY_M = 2.0
TRACK, SIDE = LegTask(SWATH, 0), LegTask(HEADLAND_PASS, 1)


def make_leg(kind: str, *points: tuple[float, float]) -> Leg:
    task = {"t": TRACK, "h": SIDE, "-": LegTask(TURN)}[kind.lower()]
    return Leg(np.array(points, float), 2.0, 1, kind != "-", task=task, may_wait=kind in "TH")


def make_mission(x: float, last: Sequence[Leg] = ()) -> Mission:
    """A track northwards in two parts, and a turn over the headland beyond it, which is worked then, from the west.

    The headland is at y from 100 to 104, the turn goes 3 m into it.
    """
    return Mission(
        (
            make_leg("t", (x, 0.0), (x, 80.0)),
            make_leg("T", (x, 80.0), (x, 100.0)),
            make_leg("-", (x, 100.0), (x, 103.0)),
            make_leg("-", (x, 103.0), (x + 8.0, 100.0)),
            make_leg("t", (x + 8.0, 100.0), (x + 8.0, 20.0)),
            make_leg("T", (x + 8.0, 20.0), (x + 8.0, 0.0)),
            *last,
        )
    )


def work_side(begin: float, end: float) -> list[Leg]:
    """A way to the headland and two parts of it, eastwards."""
    middle = 0.5 * (begin + end)
    return [
        make_leg("-", (begin - 40.0, 0.0), (begin, 102.0)),
        make_leg("h", (begin, 102.0), (middle, 102.0)),
        make_leg("H", (middle, 102.0), (end, 102.0)),
    ]


def list_gates(plan: Plan) -> dict[tuple[int, int], list[LegGate]]:
    return {(t, n): list(leg.gates) for t, m in enumerate(plan.missions) for n, leg in enumerate(m.legs) if leg.gates}


def test_nobody_works_a_headland_that_another_still_turns_on() -> None:
    """The first works it at x from -60 to 140; the second turns at 20, in its first half."""
    plan = Plan((make_mission(-100.0, work_side(-60.0, 140.0)), make_mission(20.0)))
    gates = list_gates(add_order_gates(plan, SITE, {TRACK}, BODY_M, is_kept=True))
    assert gates == {(0, 5): [LegGate(1, 3, round(73.0**0.5 - 0.2, 6))]}
    later = Plan((plan.missions[0], make_mission(60.0)))
    gates = list_gates(add_order_gates(later, SITE, {TRACK}, BODY_M, is_kept=True))
    assert list(gates) == [(0, 8)], "before the second half, where it may wait"


def test_tractors_on_ground_of_their_own_wait_for_nobody() -> None:
    plan = Plan((make_mission(-100.0, work_side(-60.0, 10.0)), make_mission(20.0, work_side(30.0, 140.0))))
    assert list_gates(add_order_gates(plan, SITE, {TRACK}, BODY_M, is_kept=True)) == {}


def test_two_that_wait_for_each_other_wait_in_their_last_parts() -> None:
    """Each works the headland that the other turns on: what one drives before it may wait is all that others await."""
    plan = Plan((make_mission(-100.0, work_side(0.0, 140.0)), make_mission(20.0, work_side(-120.0, -60.0))))
    gates = list_gates(add_order_gates(plan, SITE, {TRACK}, BODY_M, is_kept=True))
    assert {place: gate[0].leg for place, gate in gates.items()} == {(0, 5): 3, (1, 5): 3}


def test_nobody_drives_over_a_crop_that_stands() -> None:
    """The headland comes first: the second drives over that of the first on its way from one track to the next."""
    around = Mission(
        (
            make_leg("h", (0.0, 102.0), (70.0, 102.0)),
            make_leg("H", (70.0, 102.0), (140.0, 102.0)),
            make_leg("-", (140.0, 102.0), (150.0, 50.0)),
            make_leg("t", (150.0, 50.0), (150.0, 0.0)),
        )
    )
    plan = Plan((around, make_mission(20.0)))
    gates = list_gates(add_order_gates(plan, SITE, {SIDE}, BODY_M, is_kept=False))
    assert gates == {(1, 1): [LegGate(0, 0, 69.8)]}, "where it may wait before the turn"
    beside = Plan((around, make_mission(200.0)))
    assert list_gates(add_order_gates(beside, SITE, {SIDE}, BODY_M, is_kept=False)) == {}
