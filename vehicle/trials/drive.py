"""Drives of the experiments: many tractors with given steering, each on its own tyres, or one along a path.

The loop calls the functions of vehicle.sim.loop and records every step, without contacts. Paths start at the origin;
"ahead" is north, to the right is east.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fields.arrays import Floats, Integers, Records, build_directions
from vehicle.control.guidance import run_control_tick
from vehicle.control.speed_profile import UNLIMITED_MPS
from vehicle.errors import VehicleError
from vehicle.jit import compile_function
from vehicle.missions.plan import SWATH, Leg, LegTask, Mission, Plan
from vehicle.model.gnss import NO_ERROR, draw_error, make_error_keys
from vehicle.model.ground import Tyres
from vehicle.model.tractor import Implement, Tractor
from vehicle.records import BODY_PLACE, BODY_WIDTH, DT_S, GATE, LEG, STATE
from vehicle.sim.calibration import CIRCLE_SPEED_MPS, build_identity_table, build_steering_tables
from vehicle.sim.compile import (
    CompiledPlan,
    build_ground_records,
    build_model_record,
    build_tyre_ground_records,
    compile_plan,
)
from vehicle.sim.compiled_access import apply_force, get_motion, read_motions, step_space
from vehicle.sim.loop import compute_tractor_force
from vehicle.sim.pymunk_bridge import PymunkEngine, create_body, create_space

# Columns of a trace: the pymunk body, then steering (rad) and values of the controller.
TRACE_COLUMNS = ("x", "y", "angle", "vx", "vy", "spin", "steering", "command", "stage", "lateral", "leg", "done")

POINT_SPACING_M = 0.1
RUN_OUT_M = 6.0  # path after the measured part, so that braking is not measured
STEERING_SIMULATORS: Mapping[str, Mapping[str, Any]] = {
    "proposed": {},
    "traditional": {"dead_band_deg": 0.0, "switch_deg": 360.0},
    "none": {"dead_band_deg": 0.0, "switch_deg": 360.0, "lag_s": 1e-9, "gain": 1.0},
    "unlatched": {"latch": False},
}
"""What each changes of the steering of a tractor file."""
START_SPACING_M = 1000.0
MAX_REAR_SLIP_DEG, MAX_GROWTH_DEG = 30.0, 0.5
CONTROLLED_POINT_M = -0.6  # ahead of the centre of mass; not printed: with it Tables 3.3 and 4.3 come out closest
UNLIMITED_M = 1000.0  # plans limit the lateral error of Eq. 2.5; the experiments do not, like the thesis
LOOKAHEAD_M, SLIP_LOOKAHEAD_M = 5.0, 1.8


@compile_function
def run_trials(  # type: ignore[no-untyped-def]
    steps, dt, steps_per_tick, record_every, bridge, states, models, grounds, tables,
    legs, gates, points, cumulative, commands, position_errors, trace_rows,
) -> int:  # fmt: skip
    """Drive all tractors for `steps` of `dt`, on their paths or, if there are any, by `commands` (steps, n).

    `tables` (grounds, k) are the steering tables; the last one is used for all further grounds. Control runs every
    `steps_per_tick` steps; every `record_every`-th step goes into `trace_rows` (rows, n, columns). Returns the number
    of rows written, which is smaller if all tractors finish early.
    """
    count, rows = len(states), 0
    for step_number in range(steps):
        read_motions(bridge)
        for i in range(count):
            state = states[i]
            state.x, state.y, state.angle = get_motion(bridge, i)[:3]
            if len(commands) > 0:
                state.command, state.target_speed = commands[step_number, i], legs[state.leg].speed
        if len(commands) == 0 and step_number % steps_per_tick == 0:
            running = 0
            for i in range(count):
                if len(position_errors) > 0:
                    draw_error(states[i], position_errors)
                run_control_tick(
                    i, states, models, legs, gates, points, cumulative, step_number * dt, steps_per_tick * dt
                )
                running += 1 - states[i].done
            if running == 0:
                return rows
        for i in range(count):
            state, body = states[i], get_motion(bridge, i)
            ground = legs[state.leg].ground
            table = tables[min(ground, len(tables) - 1)]
            apply_force(bridge, i, compute_tractor_force(state, models[state.model], grounds[ground], table, body, dt))
            if step_number % record_every == 0:
                write_step(trace_rows[rows, i], body, state)
        rows += step_number % record_every == 0
        step_space(bridge, dt)
    return rows


@compile_function
def write_step(row, body, state) -> None:  # type: ignore[no-untyped-def]
    """Write the columns of one tractor at one step: the body before the step, the steering that acts during it."""
    for column in range(BODY_WIDTH):
        row[column] = body[column]
    row[6], row[7], row[8] = state.steering, state.command, float(state.stage)
    row[9], row[10], row[11] = state.lateral, float(state.leg - state.first_leg), float(state.done)


def build_straight_mission(length_m: float, speed_mps: float, ground: str = "asphalt") -> Mission:
    """A straight path ahead."""
    return _build_mission(np.array([[0.0, 0.0], [0.0, length_m]]), speed_mps, ground)


def insert_lateral_offset(program: CompiledPlan, at_m: float, offset_m: float) -> CompiledPlan:
    """The program of a straight path ahead, with the part beyond `at_m` moved to the right by `offset_m`.

    These are path 1 and path 2 of the step response: the lookahead point jumps first, the controlled point later.
    """
    length = float(program.cumulative[-1])
    turns = [[0.0, 0.0], [0.0, at_m], [offset_m, at_m], [offset_m, length]]
    points = np.array([[*point, UNLIMITED_MPS] for point in turns])
    legs = program.legs.copy()
    legs["last_segment"] = 2
    return replace(program, points=points, cumulative=np.array([0.0, at_m, at_m, length]), legs=legs)


def build_sine_mission(amplitude_m: float, omega: float, periods: float, speed_mps: float, ground: str) -> Mission:
    """P_y = A sin(omega P_x) (Eq. 3.1) over a number of periods, P_x ahead and P_y to the left."""
    if not (amplitude_m > 0 and omega > 0):
        raise VehicleError(f"A wave of {amplitude_m:g} m and {omega:g} per metre cannot be driven; use values above 0.")
    end = 2.0 * math.pi * periods / omega + RUN_OUT_M
    x = np.linspace(0.0, end, max(2, round(end / POINT_SPACING_M)) + 1)
    return _build_mission(np.stack([-amplitude_m * np.sin(omega * x), x], axis=1), speed_mps, ground)


def _build_mission(points: Floats, speed_mps: float, ground: str) -> Mission:
    return Mission((Leg(points, speed_mps, ground=ground, task=LegTask(SWATH)),))


@dataclass(frozen=True, eq=False)
class Trace:
    """The drive of one tractor, one row per recorded step.

    `time_s` (t,), `rows` (t, 12) with TRACE_COLUMNS, the distances of the axles ahead of and behind the centre of mass
    (m), and of the controlled point ahead of it.
    """

    time_s: Floats
    rows: Floats
    front_m: float
    rear_m: float
    point_m: float

    def get_column(self, name: str) -> Floats:
        """One column (t,)."""
        return np.asarray(self.rows[:, TRACE_COLUMNS.index(name)])

    def compute_path(self, ahead_m: float | None = None) -> Floats:
        """Path (t, 2) of a point of the centre line, by default of the controlled point."""
        reach = self.point_m if ahead_m is None else ahead_m
        return np.asarray(self.rows[:, BODY_PLACE] + reach * build_directions(self.get_column("angle")))

    def compute_velocity(self) -> tuple[Floats, Floats, Floats]:
        """Forward and rightward speed of the centre of mass (m/s) and clockwise spin (rad/s), (t,) each."""
        cosine, sine = np.cos(self.get_column("angle")), np.sin(self.get_column("angle"))
        vx, vy = self.get_column("vx"), self.get_column("vy")
        return vx * cosine + vy * sine, vx * sine - vy * cosine, -self.get_column("spin")

    def compute_slips(self) -> tuple[Floats, Floats]:
        """Slip angles of front and rear axle (t,), radians, Eq. 4.1 and 4.2."""
        forward, right, spin = self.compute_velocity()
        front = np.arctan2(right + self.front_m * spin, forward) - self.get_column("steering")
        return (front + math.pi) % (2 * math.pi) - math.pi, np.arctan2(right - self.rear_m * spin, forward)

    def compute_radius(self, ahead_m: float | None = None) -> Floats:
        """Momentary turning radius (t,) of a point of the centre line: its speed over the spin; inf if straight."""
        reach = self.point_m if ahead_m is None else ahead_m
        forward, right, spin = self.compute_velocity()
        with np.errstate(divide="ignore"):
            return np.asarray(np.hypot(forward, right + reach * spin) / np.abs(spin))


def replace_steering(tractor: Tractor, name: str) -> Tractor:
    """The tractor with another steering simulator.

    "proposed" is Eq. 2.8; "traditional" is its second stage alone, a first-order lag; "none" applies the command to the
    wheels at once; "unlatched" lets stage 3 change to stage 2. Raises VehicleError for another name.
    """
    if name not in STEERING_SIMULATORS:
        raise VehicleError(f"The steering simulator {name!r} is unknown; use one of: {', '.join(STEERING_SIMULATORS)}.")
    steering = tractor.steering.model_copy(update=STEERING_SIMULATORS[name])
    return tractor.model_copy(update={"steering": steering})


def drive_by_steering_commands(
    tractors: Sequence[Tractor],
    tyres: Sequence[Tyres],
    commands_deg: Floats,
    *,
    speed_mps: float = CIRCLE_SPEED_MPS,
    dt: float = DT_S,
    record_every: int = 1,
    from_standstill: bool = False,
) -> list[Trace]:
    """Drive tractors of one steering lock, each on its own tyres, by `commands_deg` (steps, n), without correction.

    All start heading north: at full speed with straight wheels, or `from_standstill` with the wheels at the first
    command. The steering simulator of each tractor applies. Raises VehicleError for a command beyond the steering stop.
    """
    steps, count = commands_deg.shape
    lock = tractors[0].max_steering_deg
    if (np.abs(commands_deg) > lock + 1e-9).any():
        worst = float(np.abs(commands_deg).max())
        raise VehicleError(f"A steering angle of {worst:g} degrees is beyond the stop; use {lock:g} or less.")
    states, legs = np.zeros(count, dtype=STATE), np.zeros(count, dtype=LEG)
    states["leg"] = states["first_leg"] = states["last_leg"] = states["model"] = np.arange(count)
    states["stage"], states["x"], states["angle"] = 1, START_SPACING_M * np.arange(count), 0.5 * math.pi
    legs["ground"], legs["speed"] = np.arange(count), speed_mps
    if from_standstill:
        states["steering"] = np.radians(commands_deg[0])
    program = CompiledPlan(states, legs, np.zeros(0, dtype=GATE), np.zeros((1, 3)), np.zeros(1))
    surface = build_tyre_ground_records(tyres), build_identity_table(lock)[None]
    start_mps, commands = 0.0 if from_standstill else speed_mps, np.radians(commands_deg)
    return _drive_program(tractors, program, surface, (steps, dt, record_every), commands, start_mps)


def follow_mission(
    tractor: Tractor,
    mission: Mission,
    *,
    tyres: Tyres | None = None,
    seconds: float = 600.0,
    position_errors: Integers = NO_ERROR,
    seed: int = 1,
    jump: tuple[float, float] | None = None,
) -> Trace:
    """Drive one tractor along a mission, starting at full speed: with the corrected base model of its grounds, or
    uncorrected on `tyres` of chapter 4. `position_errors` is a GNSS table, `jump` the arguments of
    insert_lateral_offset.
    """
    program = compile_plan(Plan((mission,)), tractor, limits_speed=False)
    if jump is not None:
        program = insert_lateral_offset(program, *jump)
    legs = program.legs
    if tyres is None:
        grounds, tables = build_ground_records(), build_steering_tables(tractor)
    else:
        grounds, tables = build_tyre_ground_records([tyres]), build_identity_table(tractor.max_steering_deg)[None]
        legs["ground"] = 0
    legs["lookahead"] = tractor.guidance.lookahead_m
    program.states["error_key"] = make_error_keys(seed, 1)
    times, start_mps = (round(seconds / DT_S), DT_S, 1), mission.legs[0].speed_mps
    no_commands = np.zeros((0, 1))
    return _drive_program([tractor], program, (grounds, tables), times, no_commands, start_mps, position_errors)[0]


def _drive_program(
    tractors: Sequence[Tractor],
    program: CompiledPlan,
    surface: tuple[Records, Floats],
    times: tuple[int, float, int],
    commands: Floats,
    start_mps: float,
    position_errors: Integers = NO_ERROR,
) -> list[Trace]:
    """Drive tractors without outlines in a space of their own, straight ahead at `start_mps` at first.

    `surface` are ground records and steering tables, `times` the number of steps, the seconds of one, and after how
    many a row is recorded. Returns one trace each.
    """
    states, (steps, dt, record_every) = program.states, times
    space = create_space()
    bodies = []
    for tractor, x, y, angle in zip(tractors, *(states[name].tolist() for name in ("x", "y", "angle")), strict=True):
        bodies.append(create_body(space, tractor, (x, y, angle)))
        if start_mps:
            bodies[-1].velocity = (start_mps * math.cos(angle), start_mps * math.sin(angle))
    states["reference_speed"] = states["target_speed"] = start_mps
    engine = PymunkEngine(space, bodies)
    rows_by_tractor = np.empty((-(-steps // record_every), len(bodies), len(TRACE_COLUMNS)))
    models = np.array([build_model_record(tractor, Implement()) for tractor in tractors])
    # The experiments drive by Eq. 2.5 as printed: no more lookahead and no less correction at speed.
    models["lookahead_s"], models["lateral_ease"] = 0.0, math.inf
    rows = run_trials(
        steps, dt, tractors[0].guidance.count_steps(dt), record_every, engine.bridge, states, models, *surface,
        program.legs, program.gates, program.points, program.cumulative, commands, position_errors, rows_by_tractor,
    )  # fmt: skip
    time = np.arange(rows, dtype=np.float64) * (dt * record_every)
    return [
        Trace(time, rows_by_tractor[:rows, number], tractor.front_axle_m, tractor.rear_axle_m, tractor.guide_m)
        for number, tractor in enumerate(tractors)
    ]


def is_sideslip_settled(trace: Trace) -> bool:
    """Whether the side-slip of a drive with constant steering settles; otherwise the tractor oversteers.

    It settles if the slip of the rear axle stays below 30 degrees, and its mean over the last quarter of the drive is
    at most half a degree larger than over the quarter before. (Section 4.3.1: the rear slip "continues to increase"
    and cannot be "converged".)
    """
    size = np.degrees(np.abs(trace.compute_slips()[1]))
    if size.max() > MAX_REAR_SLIP_DEG:
        return False
    quarter = len(size) // 4
    growth = size[-quarter:].mean() - size[-2 * quarter : -quarter].mean()
    return bool(growth <= MAX_GROWTH_DEG)


def compute_settled_radius(trace: Trace, ahead_m: float) -> float:
    """Turning radius (m) of a point over the last eighth of a drive; nan if the drive does not settle."""
    if not is_sideslip_settled(trace):
        return math.nan
    radius = trace.compute_radius(ahead_m)
    return float(radius[-max(1, len(radius) // 8) :].mean())


def configure_tractor(
    tractor: Tractor,
    steering: str = "proposed",
    *,
    lookahead_m: float = LOOKAHEAD_M,
    limit_m: float = UNLIMITED_M,
    point_m: float = CONTROLLED_POINT_M,
) -> Tractor:
    """The tractor with a steering simulator, a lookahead, a limit of the lateral error and a controlled point."""
    guidance = tractor.guidance.model_copy(update={"lookahead_m": lookahead_m, "lateral_limit_m": limit_m})
    changes = {"guidance": guidance, "antenna_forward_m": tractor.rear_axle_m + point_m}
    return replace_steering(tractor.model_copy(update=changes), steering)
