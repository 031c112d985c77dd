"""Interleaved: each of n tractors takes every n-th track, one behind the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from strategies.lines.work_line import WorkLine
from strategies.program.field_job import DrivingRules, FieldJob
from strategies.program.legs import build_own_mission, group_by_line, make_strategy_plan
from strategies.program.strategy_record import Strategy
from strategies.programmes.dealing import LineDeal, free_other_lines, group_swath_lines
from strategies.sequencing.swath_order import order_shares_in_pattern
from vehicle.missions.plan import LegGate, Mission, Plan

NAME = "interleaved"


def deal_in_turn(lines: Sequence[WorkLine], rules: DrivingRules, tractors: int) -> LineDeal:
    """Every n-th swath to each of n tractors, which begin one after the other."""
    allowed = free_other_lines(lines, tractors)
    for place, numbers in enumerate(group_swath_lines(lines, tractors)):
        allowed[place % tractors, numbers] = True
    return LineDeal(allowed, rules.stagger_m)


def plan_interleaved(job: FieldJob) -> Plan:
    """Tractors take every n-th line; each starts when the one before it has driven `stagger_m`."""
    lines = group_by_line(job)
    shares = [[swath for line in lines[i :: job.tractors] for swath in line] for i in range(job.tractors)]
    missions = [
        build_own_mission(job, number, order)
        for number, order in enumerate(order_shares_in_pattern(shares, job, jump=1))
    ]
    return make_strategy_plan(job, NAME, _stagger_starts(missions, job.driving_rules.stagger_m))


def _stagger_starts(missions: list[Mission], distance_m: float) -> list[Mission]:
    """Hold each tractor until the one before it has driven `distance_m` of its first working leg."""
    staggered = missions[:1]
    for number, mission in enumerate(missions[1:], start=1):
        first_working_leg = missions[number - 1].legs[1]
        gate = LegGate(number - 1, 1, min(distance_m, first_working_leg.length_m))
        staggered.append(replace(mission, legs=(mission.legs[0].copy_with_gates([gate]), *mission.legs[1:])))
    return staggered


STRATEGY = Strategy(NAME, "take every n-th swath, one behind the other", plan_interleaved, deal=deal_in_turn)
