"""What tests of several modules do: change a leg, drive with the wheels at an angle, compare runs bit for bit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pymunk

from fields.arrays import Floats
from vehicle.missions.plan import Mission, Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Implement, Tractor
from vehicle.records import BODY_WIDTH, STATE
from vehicle.sim.compile import build_ground_records, build_model_record
from vehicle.sim.loop import run_fixed
from vehicle.sim.pymunk_bridge import PymunkEngine, create_body


def change_leg(plan: Plan, tractor: int, leg: int, **values: Any) -> Plan:
    """The plan with other values in one leg."""
    legs = list(plan.missions[tractor].legs)
    legs[leg] = replace(legs[leg], **values)
    missions = list(plan.missions)
    missions[tractor] = Mission(tuple(legs))
    return replace(plan, missions=tuple(missions))


def drive_fixed(tractor: Tractor, tables: Floats, steps: int, dt: float, **values: float) -> Floats:
    """Raw body track (steps, 6) in pymunk from standstill on soil, with these values in the state."""
    space = pymunk.Space()
    engine = PymunkEngine(space, [create_body(space, tractor, (0.0, 0.0, 0.0))])
    states = np.zeros(1, dtype=STATE)
    for name, value in values.items():
        states[name] = value
    states["stage"] = 1
    track, models = np.empty((steps, BODY_WIDTH)), np.array([build_model_record(tractor, Implement())])
    run_fixed(steps, dt, engine.bridge, states, models, build_ground_records(), 1, tables, track)
    return track


def assert_same_bits(run: SimulationRun, other: SimulationRun) -> None:
    """Assert that both runs are the same bit for bit."""
    assert run.outcome == other.outcome
    assert run.record.tobytes() == other.record.tobytes()
    assert run.time_s.tobytes() == other.time_s.tobytes()
    assert run.finish_s.tobytes() == other.finish_s.tobytes()
    assert (run.contacts, run.conflict) == (other.contacts, other.conflict)
    assert run.min_clearance_m == other.min_clearance_m
    assert (run.stall, run.roll_over) == (other.stall, other.roll_over)
