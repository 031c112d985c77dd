"""Drives of the experiments: many tractors with given steering, or one along a path; every step kept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pymunk

from vehicle.bodies import new_space
from vehicle.calibration import identity_table, steering_tables
from vehicle.circles import CIRCLE_SPEED_MPS
from vehicle.compile import compile_grounds, compile_model, compile_plan
from vehicle.engine import Engine
from vehicle.errors import VehicleError
from vehicle.gnss import NO_ERROR, Table, error_keys
from vehicle.ground import Tyres
from vehicle.layout import BODY_PLACE, DT_S, GATE, GROUND, LEG, STATE
from vehicle.missions import Mission, Plan
from vehicle.tractor import Implement, Steering, Tractor
from vehicle.trials.loop import COLUMNS, run_trials
from vehicle.trials.paths import with_jump

Array = npt.NDArray[np.float64]
STEERINGS = ("proposed", "traditional", "none", "unlatched")
APART_M = 1000.0


@dataclass(frozen=True, eq=False)
class Trace:
    """What one tractor did, one row per kept step.

    `time_s` (t,), `rows` (t, 12) with the columns of vehicle.trials.loop, the axles' places ahead of and behind the
    centre of mass (m), and the controlled point ahead of it.
    """

    time_s: Array
    rows: Array
    front_m: float
    rear_m: float
    point_m: float

    def until(self, row: int) -> Trace:
        """The track up to a row."""
        return replace(self, time_s=self.time_s[:row], rows=self.rows[:row])

    def column(self, name: str) -> Array:
        """One column (t,)."""
        return np.asarray(self.rows[:, COLUMNS.index(name)])

    def place(self, ahead_m: float | None = None) -> Array:
        """Path (t, 2) of a point of the centre line; by default the controlled one."""
        reach = self.point_m if ahead_m is None else ahead_m
        angle = self.column("angle")[:, None]
        return np.asarray(self.rows[:, BODY_PLACE] + reach * np.hstack([np.cos(angle), np.sin(angle)]))

    def velocity(self) -> tuple[Array, Array, Array]:
        """Forward and rightward speed of the centre of mass (m/s) and clockwise spin (rad/s), (t,) each."""
        cosine, sine = np.cos(self.column("angle")), np.sin(self.column("angle"))
        vx, vy = self.column("vx"), self.column("vy")
        return vx * cosine + vy * sine, vx * sine - vy * cosine, -self.column("spin")

    def slips(self) -> tuple[Array, Array]:
        """Slip angles of front and rear axle (t,), radians, Eq. 4.1 and 4.2."""
        forward, right, spin = self.velocity()
        front = np.arctan2(right + self.front_m * spin, forward) - self.column("steering")
        return (front + math.pi) % (2 * math.pi) - math.pi, np.arctan2(right - self.rear_m * spin, forward)

    def radius(self, ahead_m: float | None = None) -> Array:
        """Momentary turning radius (t,) of a point of the centre line: its speed over the spin; inf when straight."""
        reach = self.point_m if ahead_m is None else ahead_m
        forward, right, spin = self.velocity()
        with np.errstate(divide="ignore"):
            return np.asarray(np.hypot(forward, right + reach * spin) / np.abs(spin))


def with_steering(tractor: Tractor, name: str) -> Tractor:
    """The tractor with another steering simulator.

    "proposed" is Eq. 2.8; "traditional" its second stage alone, a first-order lag; "none" puts the command on the
    wheels at once; "unlatched" lets stage 3 pass into stage 2. Raises VehicleError for another name.
    """
    if name not in STEERINGS:
        raise VehicleError(f"The steering simulator {name!r} is unknown; use one of: {', '.join(STEERINGS)}.")
    steering = tractor.steering
    changes: dict[str, dict[str, Any]] = {
        "proposed": {},
        "traditional": {"dead_band_deg": 0.0, "switch_deg": 360.0},
        "none": {"dead_band_deg": 0.0, "switch_deg": 360.0, "lag_s": 1e-9, "gain": 1.0},
        "unlatched": {"latch": False},
    }
    return tractor.model_copy(update={"steering": Steering(**{**steering.model_dump(), **changes[name]})})


def compile_tyres(tyres: Sequence[Tyres]) -> npt.NDArray[Any]:
    """One GROUND record per set of tyres."""
    rows = np.zeros(len(tyres), dtype=GROUND)
    for row, tyre in zip(rows, tyres, strict=True):
        row["front_slope"] = math.degrees(tyre.front_slope_per_deg)
        row["front_limit"] = math.radians(tyre.front_limit_deg)
        row["rear_slope"] = math.degrees(tyre.rear_slope_per_deg)
        row["rear_limit"] = math.radians(tyre.rear_limit_deg)
        row["rolling"] = tyre.rolling_resistance
        row["shaped"] = float(tyre.curve is not None or tyre.grip is not None)
        row["grip"] = tyre.grip or 1e6
        if tyre.curve is not None:
            row["peak_slip"], row["peak"] = tyre.curve.peak_slip_rad, tyre.curve.peak
            row["ease"] = tyre.curve.ease_mps
            row["slide_slip"], row["slide"] = tyre.curve.slide_slip_rad, tyre.curve.slide
    return rows


def drive_steered(
    tractors: Sequence[Tractor], tyres: Sequence[Tyres], commands_deg: Array, *, speed_mps: float = CIRCLE_SPEED_MPS,
    dt: float = DT_S, keep: int = 1, standing: bool = False,
) -> list[Trace]:  # fmt: skip
    """Drive tractors of one steering lock, each on its own tyres, by `commands_deg` (steps, n), without correction.

    All start heading north: at full speed with straight wheels, or `standing` with the wheels at the first command.
    Angles reach the wheels as the tractor's steering simulator lets them. Raises VehicleError for a command beyond the
    stop.
    """
    steps, count = commands_deg.shape
    lock = tractors[0].max_steering_deg
    if (np.abs(commands_deg) > lock + 1e-9).any():
        worst = float(np.abs(commands_deg).max())
        raise VehicleError(f"A steering angle of {worst:g} degrees is beyond the stop; use {lock:g} or less.")
    states, legs = np.zeros(count, dtype=STATE), np.zeros(count, dtype=LEG)
    states["leg"] = states["first_leg"] = states["last_leg"] = states["model"] = np.arange(count)
    states["stage"] = 1
    legs["ground"], legs["speed"] = np.arange(count), speed_mps
    poses = np.stack([APART_M * np.arange(count), np.zeros(count), np.full(count, 0.5 * math.pi)], axis=1)
    trial = _Trial(tractors, poses, states, legs)
    if standing:
        states["steering"] = np.radians(commands_deg[0])
    else:
        trial.set_off(speed_mps)
    return trial.run(steps, dt, keep, compile_tyres(tyres), identity_table(lock)[None], np.radians(commands_deg))


def follow(
    tractor: Tractor, mission: Mission, *, tyres: Tyres | None = None, seconds: float = 600.0,
    position_errors: Table = NO_ERROR, seed: int = 1, dt: float = DT_S, jump: tuple[float, float] | None = None,
) -> Trace:  # fmt: skip
    """Drive one tractor along a mission, entered at full speed: with the corrected base model of its grounds, or
    uncorrected on `tyres` of chapter 4. `position_errors` is a GNSS table, `jump` the arguments of paths.with_jump.
    """
    program = compile_plan(Plan((mission,)), tractor)
    if jump is not None:
        program = with_jump(program, *jump)
    legs = program.legs
    if tyres is None:
        grounds, tables = compile_grounds(), steering_tables(tractor)
    else:
        grounds, tables = compile_tyres([tyres]), identity_table(tractor.max_steering_deg)[None]
        legs["ground"] = 0
    legs["lookahead"] = tractor.guidance.lookahead_m
    program.states["error_key"] = error_keys(seed, 1)
    state = program.states[0]
    poses = np.array([[state["x"], state["y"], state["angle"]]])
    trial = _Trial([tractor], poses, program.states, legs, program.gates, program.points, program.cumulative)
    trial.set_off(mission.legs[0].speed_mps)
    return trial.run(round(seconds / dt), dt, 1, grounds, tables, np.zeros((0, 1)), position_errors)[0]


class _Trial:
    """Tractors without outlines in a space of their own, and the arrays their drive needs."""

    def __init__(
        self, tractors: Sequence[Tractor], poses: Array, states: npt.NDArray[Any], legs: npt.NDArray[Any],
        gates: npt.NDArray[Any] | None = None, points: Array | None = None, cumulative: Array | None = None,
    ) -> None:  # fmt: skip
        self.tractors, self.states, self.legs = tractors, states, legs
        self.gates = np.zeros(0, dtype=GATE) if gates is None else gates
        self.points = np.zeros((1, 2)) if points is None else points
        self.cumulative = np.zeros(1) if cumulative is None else cumulative
        self.space = new_space()
        self.bodies = []
        for tractor, (x, y, angle) in zip(tractors, poses, strict=True):
            body = pymunk.Body(tractor.mass_kg, tractor.inertia_kg_m2)
            body.position, body.angle = (float(x), float(y)), float(angle)
            self.space.add(body)
            self.bodies.append(body)

    def set_off(self, speed_mps: float) -> None:
        """Let all drive straight ahead at a speed."""
        self.states["reference_speed"] = self.states["target_speed"] = speed_mps
        for body in self.bodies:
            body.velocity = (speed_mps * math.cos(body.angle), speed_mps * math.sin(body.angle))

    def run(
        self, steps: int, dt: float, keep: int, grounds: npt.NDArray[Any], tables: Array, commands: Array,
        position_errors: Table = NO_ERROR,
    ) -> list[Trace]:  # fmt: skip
        """Drive and hand back one track per tractor."""
        engine = Engine(self.space, self.bodies)
        every = max(1, round(1.0 / (self.tractors[0].guidance.rate_hz * dt)))
        track = np.empty((-(-steps // keep), len(self.bodies), len(COLUMNS)))
        models = np.array([compile_model(tractor, Implement()) for tractor in self.tractors])
        rows = run_trials(
            steps, dt, every, keep, engine.door, self.states, models, grounds, tables, self.legs, self.gates,
            self.points, self.cumulative, commands, position_errors, track,
        )  # fmt: skip
        time = np.arange(rows, dtype=np.float64) * (dt * keep)
        return [
            Trace(time, track[:rows, i], t.front_axle_m, t.rear_axle_m, t.antenna_forward_m - t.rear_axle_m)
            for i, t in enumerate(self.tractors)
        ]
