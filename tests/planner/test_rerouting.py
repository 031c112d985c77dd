"""Turns driven another way: stands and what is noted of refills stay with them."""

import math
from dataclasses import replace

import numpy as np

from planner.evaluation.repair.turn_repair import replace_turns
from vehicle.missions.plan import Leg, LegGate, Mission, Plan


def leg(first: float, last: float, stand_s: float = 0.0) -> Leg:
    return replace(Leg(np.array([[0.0, first], [0.0, last]]), 1.0), stand_s=stand_s)


def test_a_turn_with_more_legs_keeps_its_stand_and_the_numbers_of_refills() -> None:
    legs = (leg(0, 10), leg(10, 12, 300.0), leg(12, 14), leg(14, 30), leg(30, 40, 120.0))
    notes = {"refills": [{"tractor": 1, "leg": 1}, {"tractor": 1, "leg": 4}, {"tractor": 2, "leg": 4}]}
    plan = Plan((Mission(legs), Mission(legs)), notes)
    other = (leg(10, 11), leg(11, 12), leg(12, 13), leg(13, 14))
    new = replace_turns(plan, {(0, 1, 3): other})
    stands = [(number, each.stand_s) for number, each in enumerate(new.missions[0].legs) if each.stand_s]
    assert stands == [(1, 300.0), (6, 120.0)]
    assert [(one["tractor"], one["leg"]) for one in new.notes["refills"]] == [(1, 1), (1, 6), (2, 4)]
    assert new.missions[1] is plan.missions[1] or len(new.missions[1].legs) == len(legs)
    assert math.fsum(each.stand_s for each in new.missions[0].legs) == math.fsum(each.stand_s for each in legs)


def test_a_turn_that_is_only_slowed_keeps_gates_whose_legs_have_got_other_numbers() -> None:
    """Of two turns repaired at once, one has more legs than before, and the other waits for what comes after it."""
    first = (leg(0, 10), leg(10, 14), leg(14, 30))
    second = tuple(one.copy_with_gates((LegGate(1, 2, 5.0),)) if n == 1 else one for n, one in enumerate(first))
    slow = (replace(second[1], speed_mps=0.5),)
    new = replace_turns(
        Plan((Mission(second), Mission(first))), {(0, 1, 2): slow, (1, 1, 2): (leg(10, 12), leg(12, 14))}
    )
    assert new.missions[0].legs[1].speed_mps == 0.5
    assert new.missions[0].legs[1].gates == (LegGate(1, 3, 5.0),)
