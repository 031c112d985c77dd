"""World and replay drive the same tractor the same, for every effect and every term of the discrepancy model.

Parametrised over the catalogue, so that a new effect is compared from its first day; one that no drive of DRIVES shows
needs one there.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pymunk
import pytest

from fields.arrays import Floats
from vehicle.control.guidance import compute_steering_command, find_target_point, project_point, wrap_angle
from vehicle.identification.diagnosis.demo_logs import draw_hidden_effect
from vehicle.identification.replay.drive_segments import DriveSegment, build_rig_and_corrections
from vehicle.identification.replay.simulation import (
    ANGLE_COLUMN,
    STEERING_COLUMN,
    X_COLUMN,
    Y_COLUMN,
    replay_segment,
    simulate_logged_values,
)
from vehicle.missions.plan import Leg, LegTask, Mission, Plan
from vehicle.model.discrepancy_model import DISCREPANCY_TERMS
from vehicle.model.effects import CATALOGUE, POSITION
from vehicle.model.ground import find_ground_index
from vehicle.model.tractor import DiscrepancyModel, EffectSetting, Implement, Tractor, load_tractor
from vehicle.records import BODY_ANGLE, BODY_PLACE, DT_S, GATE, LEG, STATE
from vehicle.sim.calibration import build_steering_tables, drive_circle
from vehicle.sim.compile import build_ground_records, build_model_record, compile_plan
from vehicle.sim.pymunk_bridge import PymunkEngine, create_body
from vehicle.trials.drive import TRACE_COLUMNS, run_trials

EG105 = load_tractor("eg105")
STEPS, TICK_STEPS = 1500, 6
TIME = DT_S * np.arange(STEPS)
CIRCLE, WAVE = np.full(STEPS, 15.0), 12.0 * np.sin(2.0 * math.pi * TIME / 5.0)
STRAIGHT_M, RADIUS_M = 15.0, 12.0
TRACKS = {
    "circle": np.concatenate([
        [[0.0, 0.0], [0.0, STRAIGHT_M]],
        [[RADIUS_M * (1.0 - math.cos(a)), STRAIGHT_M + RADIUS_M * math.sin(a)] for a in np.radians(range(3, 200, 3))],
    ]),
    "wave": np.array([[2.0 * (1.0 - math.cos(y / 5.0)), y] for y in np.arange(0.0, 45.0, 0.5)]),
}  # fmt: skip

GROUND = "soil"
SPEED_MPS = 2.5
DRIVES = {"circle": (CIRCLE, SPEED_MPS), "wave": (WAVE, SPEED_MPS), "reverse": (WAVE, -0.4 * SPEED_MPS)}
NORTH = 0.5 * math.pi

# On ground that is carried along, a replay keeps the speed on that ground through a change of direction, as a log
# measures it; the world keeps the body's own momentum and lets the speed controller follow. A push of 5 cm/s carries
# 1.25 m in a drive of 25 s; the two differ by up to 7 cm of that.
CARRIED, CARRIED_M, CARRIED_RAD = ("discrepancy push_to_east", "discrepancy push_to_north"), 0.08, 0.01
POSITIONS = [entry.id for entry in CATALOGUE if entry.block == POSITION and not entry.is_of_log_alone]
# Guidance smooths headings over the 1.6 s that it remembers, a replay over the whole drive: 0.1 degrees of the command.
REMEMBERED_RAD = {"heading_filter": 2e-3}


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

    rows: Floats
    working: float

    def column(self, name: str) -> Floats:
        """One column (n,)."""
        return np.ascontiguousarray(self.rows[:, TRACE_COLUMNS.index(name)])

    @property
    def place(self) -> Floats:
        """Centre of mass (n, 2)."""
        return self.rows[:, BODY_PLACE]


def by_command(tractor: Tractor, commands_deg: Floats, working: float = 0.0, speed_mps: float = SPEED_MPS) -> Driven:
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
    cumulative: Any, commands: Floats, working: float, steps: int = 0,
) -> Driven:  # fmt: skip
    space = pymunk.Space()
    engine = PymunkEngine(space, [create_body(space, tractor, pose)])
    steps = steps or len(commands)
    track = np.empty((steps, 1, len(TRACE_COLUMNS)))
    rows = run_trials(
        steps, DT_S, tractor.guidance.count_steps(DT_S), 1, engine.bridge, states,
        np.array([build_model_record(tractor, Implement())]), build_ground_records(), build_steering_tables(tractor),
        legs, gates,
        points, cumulative, commands, np.zeros((0, 4)), track,
    )  # fmt: skip
    return Driven(track[:rows, 0], working)


def replayed(tractor: Tractor, driven: Driven, target: Floats) -> tuple[Floats, Floats, Floats]:
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


def effects() -> dict[str, Tractor]:
    """The tractor with each effect at about its usual size, and with each term of the discrepancy model."""
    acting = [entry.id for entry in CATALOGUE if not entry.is_of_log_alone]
    hidden = {name: draw_hidden_effect(1, EG105, name).values for name in acting}
    by_name = {name: add_effect(EG105, name, values) for name, values in hidden.items()}
    terms = {term.id: add_discrepancy_model(EG105, **{term.id: term.typical}) for term in DISCREPANCY_TERMS}
    return by_name | {f"discrepancy {name}": tractor for name, tractor in terms.items()}


TRACTORS = effects()


@pytest.mark.slow
@pytest.mark.parametrize(("commands", "speed_mps"), DRIVES.values(), ids=DRIVES)
@pytest.mark.parametrize("name", TRACTORS)
def test_loop_and_replay_drive_the_same(name: str, commands: Floats, speed_mps: float) -> None:
    tractor = TRACTORS[name]
    driven = by_command(tractor, commands, 1.0, speed_mps)
    states, _, _ = replayed(tractor, driven, np.full(STEPS, speed_mps))
    off_m, off_rad = (CARRIED_M, CARRIED_RAD) if name in CARRIED else (1e-6, 1e-7)
    assert np.abs(states[:, [X_COLUMN, Y_COLUMN]] - driven.place).max() < off_m
    assert np.abs(states[:, ANGLE_COLUMN] - driven.column("angle")).max() < off_rad
    assert np.abs(states[1:, STEERING_COLUMN] - driven.column("steering")[:-1]).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", TRACTORS)
def test_every_effect_changes_the_compared_drives(name: str) -> None:
    """Without this, two drives could agree because an effect acts in neither: what is driven or shown differs."""

    def shown(tractor: Tractor) -> Floats:
        seen = [
            replayed(tractor, by_command(tractor, commands, 1.0, speed_mps), np.full(STEPS, speed_mps))[1:]
            for commands, speed_mps in DRIVES.values()
        ]
        return np.concatenate([np.column_stack(one) for one in seen])

    assert np.abs(shown(TRACTORS[name]) - shown(EG105)).max() > 2e-3


@pytest.mark.parametrize("track", TRACKS)
@pytest.mark.parametrize("name", ["as its file says", *POSITIONS, "cross_slope_drift"])
def test_guidance_steers_by_what_a_log_would_show(name: str, track: str) -> None:
    """The commands of guidance, replayed, show antenna and heading: Eq. 2.5 on these gives the commands again."""
    tractor = TRACTORS.get(name, EG105)
    leg = Leg(TRACKS[track], SPEED_MPS, ground=GROUND, implement=True, task=LegTask("track"))
    driven = by_plan(tractor, Mission((leg,)), 14.0, working=1.0)
    states, antenna, heading = replayed(tractor, driven, np.full(len(driven.rows), SPEED_MPS))
    assert np.abs(states[:, [X_COLUMN, Y_COLUMN]] - driven.place).max() < 1e-6
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(leg.points, axis=0).T))])
    errors, segment, last = [], 0, len(along) - 2
    for step in range(0, len(driven.rows), TICK_STEPS):
        segment, progress, lateral = project_point(leg.points, along, segment, last, *antenna[step])
        x, y = find_target_point(leg.points, along, segment, last, progress + tractor.guidance.lookahead_m)
        aside = wrap_angle(heading[step] - math.atan2(y - antenna[step, 1], x - antenna[step, 0]))
        command = compute_steering_command(
            lateral, aside, math.radians(tractor.guidance.lateral_gain_deg_per_m), tractor.guidance.heading_gain,
            tractor.guidance.lateral_limit_m, math.radians(tractor.max_steering_deg),
        )  # fmt: skip
        errors.append(command - driven.column("command")[step])
    assert len(errors) == 140 and np.abs(errors).max() < REMEMBERED_RAD.get(name, 1e-6)
    assert np.abs(np.degrees(driven.column("command"))).max() > 3.0


def test_calibration_does_not_remove_a_discrepancy_model() -> None:
    """A tenth more grip per m/s, at 5 km/h: 1.139 times the curvature, in the world as in a replay."""
    pace = 5.0 / 3.6
    exact = EG105.steering.model_copy(update={"dead_band_deg": 0.0})  # else the wheels stop a tenth of a degree short
    tractor = add_discrepancy_model(EG105, grip_by_speed=0.1).model_copy(update={"steering": exact})
    plain, world = (drive_circle(one, 15.0, GROUND).radius_m for one in (EG105, tractor))
    lever = EG105.antenna_forward_m
    rear = math.sqrt(plain**2 - lever**2) / (1.0 + 0.1 * pace)
    assert world == pytest.approx(math.hypot(rear, lever), rel=0.01)
    assert world == pytest.approx(9.09, abs=0.01)
    driven = by_command(tractor, CIRCLE, speed_mps=pace)
    _, antenna, heading = replayed(tractor, driven, np.full(STEPS, pace))
    way = np.hypot(*np.diff(antenna[-60:], axis=0).T).sum()
    assert way / abs(heading[-1] - heading[-60]) == pytest.approx(world, rel=1e-3)
