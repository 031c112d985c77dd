"""Interleaved: tractors take every n-th track, one behind the other."""

from __future__ import annotations

from dataclasses import replace

from strategies.job import Job
from strategies.orders.sequence import patterned
from strategies.record import Strategy
from strategies.separate import lines_of, mission_in, plan_of
from vehicle.missions import Gate, Mission, Plan

NAME = "interleaved"


def interleaved(job: Job) -> Plan:
    """Tractors take every n-th line; each starts when the one before it is well under way."""
    lines = lines_of(job)
    shares = [[track for line in lines[i :: job.tractors] for track in line] for i in range(job.tractors)]
    missions = [mission_in(job, number, order) for number, order in enumerate(patterned(shares, job, jump=1))]
    return plan_of(job, NAME, _staggered(missions, job.manner.stagger_m))


def _staggered(missions: list[Mission], distance_m: float) -> list[Mission]:
    """Hold each tractor until the one before it has driven `distance_m` of its first working leg."""
    held = missions[:1]
    for number, mission in enumerate(missions[1:], start=1):
        before = missions[number - 1].legs[1]
        gate = Gate(number - 1, 1, min(distance_m, before.length_m))
        held.append(replace(mission, legs=(mission.legs[0].with_gates([gate]), *mission.legs[1:])))
    return held


STRATEGY = Strategy(NAME, "tractors take every n-th track, one behind the other", interleaved)
