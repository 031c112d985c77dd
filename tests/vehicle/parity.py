"""One drive, twice: by the compiled loop in a pymunk space, and by the replay of its commands."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pymunk

from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.rig import build_rig_and_corrections
from vehicle.identification.replay.simulation import replay_segment, simulate_logged_values
from vehicle.missions.plan import Mission, Plan
from vehicle.model.ground import find_ground_index
from vehicle.model.tractor import DiscrepancyModel, EffectSetting, Implement, Tractor
from vehicle.records import BODY_ANGLE, BODY_PLACE, DT_S, GATE, LEG, STATE
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.compile import build_ground_records, build_model_record, compile_plan
from vehicle.sim.pymunk_bridge import PymunkEngine, create_body
from vehicle.trials.drive import TRACE_COLUMNS, run_trials

GROUND = "soil"
SPEED_MPS = 2.5
NORTH = 0.5 * math.pi
Array = npt.NDArray[np.float64]


def add_effect(tractor: Tractor, name: str, values: Mapping[str, float]) -> Tractor:
    """The tractor with one effect."""
    return tractor.model_copy(update={"effects": {name: EffectSetting(value=dict(values))}})


def add_discrepancy_model(tractor: Tractor, **amounts: float) -> Tractor:
    """The tractor with a discrepancy model for every speed and angle of these drives."""
    return tractor.model_copy(
        update={"discrepancy_model": DiscrepancyModel(amounts=amounts, speed_mps=(0.0, 5.0), angle_deg=(-35.0, 35.0))}
    )


@dataclass(frozen=True, eq=False)
class Driven:
    """What the loop did: columns of vehicle.trials.drive per step (n, 12), and whether the implement worked."""

    rows: Array
    working: float

    def column(self, name: str) -> Array:
        """One column (n,)."""
        return np.ascontiguousarray(self.rows[:, TRACE_COLUMNS.index(name)])

    @property
    def place(self) -> Array:
        """Centre of mass (n, 2)."""
        return self.rows[:, BODY_PLACE]


def by_command(tractor: Tractor, commands_deg: Array, working: float = 0.0, speed_mps: float = SPEED_MPS) -> Driven:
    """Drive commands (n,) from standstill, one per step."""
    states, legs = np.zeros(1, dtype=STATE), np.zeros(1, dtype=LEG)
    states["stage"], states["working"] = 1, working
    legs["speed"], legs["ground"] = speed_mps, find_ground_index(GROUND)
    empty = (np.zeros(0, dtype=GATE), np.zeros((1, 2)), np.zeros(1))
    return _drive(tractor, (0.0, 0.0, NORTH), states, legs, *empty, np.radians(commands_deg)[:, None], working)


def by_plan(tractor: Tractor, mission: Mission, seconds: float, working: float) -> Driven:
    """Drive a mission of one leg under guidance."""
    program = compile_plan(Plan((mission,)), tractor)
    state = program.states[0]
    pose = float(state["x"]), float(state["y"]), float(state["angle"])
    steps = np.zeros((0, 1))
    arrays = program.states, program.legs, program.gates, program.points, program.cumulative
    return _drive(tractor, pose, *arrays, steps, working, round(seconds / DT_S))


def _drive(
    tractor: Tractor, pose: tuple[float, float, float], states: Any, legs: Any, gates: Any, points: Any,
    cumulative: Any, commands: Array, working: float, steps: int = 0,
) -> Driven:  # fmt: skip
    space = pymunk.Space()
    engine = PymunkEngine(space, [create_body(space, tractor, pose)])
    steps = steps or len(commands)
    track = np.empty((steps, 1, len(TRACE_COLUMNS)))
    rows = run_trials(
        steps, DT_S, max(1, round(1.0 / (tractor.guidance.rate_hz * DT_S))), 1, engine.bridge, states,
        np.array([build_model_record(tractor, Implement())]), build_ground_records(), build_steering_tables(tractor),
        legs, gates,
        points, cumulative, commands, np.zeros((0, 4)), track,
    )  # fmt: skip
    return Driven(track[:rows, 0], working)


def replayed(tractor: Tractor, driven: Driven, target: Array) -> tuple[Array, Array, Array]:
    """States (n, 5) of the replay of the drive's commands, antenna (n, 2) and heading (n,) as they would be logged.

    The measured pose, which effects of a place or a direction look at, is that of the drive.
    """
    count = len(driven.rows)
    time, zero = DT_S * np.arange(count), np.zeros(count)
    x, y, angle = driven.column("x"), driven.column("y"), driven.rows[:, BODY_ANGLE].copy()
    grids = {
        "command": driven.column("command"), "target": target, "working": np.full(count, driven.working),
        "east": x, "north": y, "heading": angle, "speed": zero,
    }  # fmt: skip
    grids["wheel"] = zero
    rig, settings = build_rig_and_corrections(tractor, GROUND, (0.0, 0.0))
    stretch = DriveSegment(0, 0.0, time, x, y, angle, True, zero, True, zero, grids["command"], target, zero, grids)
    states = replay_segment(rig, stretch, settings, from_sensor=False, from_speed=False)
    antenna, heading, _, _ = simulate_logged_values(rig, stretch, states, settings)
    return states, antenna, heading
