"""A simulated robot tractor in real time: it drives the released legs of its mission, or by remote commands.

It uses the functions of the simulation of plans; effects and noise can be hidden in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fields.arrays import measure_along
from vehicle.errors import MissionError
from vehicle.missions.plan import Leg, Mission, Plan, check_plan
from vehicle.model.gnss import DRIFT_MEMORY_S, SOIL_MEMORY_S
from vehicle.model.tractor import Implement, Tractor
from vehicle.records import DT_S, GATE
from vehicle.sim.compile import compile_plan
from vehicle.twin.step_motion import (
    NO_NOISE,
    TractorNoise,
    add_hidden_effects,
    create_body,
    locate_lever,
    make_tractor_arrays,
    measure_pose,
    run_mission_steps,
)

AUTOMATIC, REMOTE, STOPPED = "automatic", "remote", "stopped"


@dataclass(frozen=True)
class RobotState:
    """A tractor at one time. `x_m` and `y_m` are of the antenna, from the plan's origin, as instruments show them.

    `heading_rad` is mathematical (from east, counter-clockwise), `speed_mps` and `speed_command_mps` are negative in
    reverse, wheel angles positive to the right. `leg` counts from 0, `leg_m` is the distance driven on it.
    """

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    wheel_angle_rad: float
    steering_command_rad: float
    speed_command_mps: float
    leg: int
    leg_m: float
    gear: int
    implement: bool
    mode: str
    done: bool


class RobotTractor:
    """One tractor on its mission from time 0, standing at its start; it ignores gates and orders to follow.

    The first `base_legs` legs may be driven: the tractor stands at the end of the last of them. `speed_limit_mps` is a
    speed it must not exceed. `hidden_effects` are effects by id (a number stands for the first parameter). Noise is
    `noise`, or `noise_m`, the white noise of positions, with all other noise in its usual proportion. The same seed and
    calls give the same drive bit for bit. Raises MissionError for a mission that cannot be driven and VehicleError for
    an effect.
    """

    def __init__(
        self,
        mission: Mission,
        tractor: Tractor,
        implement: Implement,
        *,
        hidden_effects: Mapping[str, float | Mapping[str, float]] | None = None,
        noise: TractorNoise | None = None,
        noise_m: float = 0.0,
        seed: int = 0,
    ) -> None:
        self.tractor = add_hidden_effects(tractor, hidden_effects or {})
        self.noise = noise if noise is not None else TractorNoise().scale(noise_m / TractorNoise().position_m)
        self.arrays = make_tractor_arrays(self.tractor, implement)
        self.speed_limit_mps = math.inf
        self._commands = np.array([1.0, 0.0, 0.0, 0.0])
        self._clock = np.zeros(1, dtype=np.int64)
        self._soil_noise, self._guidance_noise, self._fix_noise = (
            np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)
        )
        self._drift = self.build_drift_sigmas() * self._fix_noise.standard_normal(3)
        self._drifted_s = 0.0
        self._build_mission_arrays(mission)
        row = self._states[0]
        self.body = create_body(float(row["x"]), float(row["y"]), float(row["angle"]))
        stays, size = math.exp(-DT_S / SOIL_MEMORY_S), self.noise.soil_per_m
        first = size * float(self._soil_noise.standard_normal())
        self._soil_state = np.array([first, stays, size * math.sqrt(1.0 - stays * stays)])
        self.state = self._measure_state()

    def build_drift_sigmas(self) -> np.ndarray:
        """Standard deviations of the slow drift of east, north (m) and heading (rad)."""
        return np.array([self.noise.position_drift_m, self.noise.position_drift_m, self.noise.heading_drift_rad])

    def _build_mission_arrays(self, mission: Mission) -> None:
        """Arrays of a mission. The progress of an invisible tractor 1 is the number of released legs: each leg has a
        gate that waits for it."""
        alone = Plan((Mission(tuple(replace(leg, gates=(), follow=None) for leg in mission.legs)),))
        check_plan(alone)
        program = compile_plan(alone, self.tractor)
        legs = program.legs
        legs["first_gate"] = np.arange(len(legs))
        legs["last_gate"] = legs["first_gate"] + 1
        gates = np.zeros(len(legs), dtype=GATE)
        gates["tractor"], gates["progress"] = 1, np.arange(1, len(legs) + 1)
        self.mission, self._gates = mission, gates
        self._program = program
        self._speeds = legs["speed"].copy()
        self._states = np.concatenate([program.states, np.zeros(1, dtype=program.states.dtype)])

    @property
    def time_s(self) -> float:
        """The time the tractor has been advanced to."""
        return float(self._clock[0]) * DT_S

    @property
    def base_legs(self) -> int:
        """Number of released legs, from the first; 0 at the start."""
        return int(self._states[1]["progress"])

    @base_legs.setter
    def base_legs(self, legs: int) -> None:
        self._states[1]["progress"] = float(legs)

    def drive_remotely(self, steering_rad: float, speed_mps: float) -> None:
        """Drive remotely from now on: steering command (positive right) and speed (negative in reverse)."""
        lock = math.radians(self.tractor.max_steering_deg)
        self._commands[:] = 0.0, min(max(steering_rad, -lock), lock), speed_mps, 0.0

    def drive_automatically(self) -> None:
        """Drive the released legs from now on, also after a halt."""
        self._commands[0], self._commands[3] = 1.0, 0.0

    def halt(self) -> None:
        """Brake to a standstill, and stand until another call."""
        self._commands[3] = 1.0

    def replace_mission(self, mission: Mission) -> None:
        """Replace the mission by one with the same legs up to the present one; later legs may be new.

        Raises MissionError if a leg already driven, or the present one, differs.
        """
        now = int(self._states[0]["leg"])
        for number in range(now + 1):
            new = mission.legs[number : number + 1]
            if not new or not np.array_equal(new[0].points, self.mission.legs[number].points):
                raise MissionError(
                    f"The new mission differs in leg {number}, and leg {now} is being driven; keep all legs up to it."
                )
        before, place = self._states.copy(), self._program.legs[now]["first_segment"]
        self._build_mission_arrays(mission)
        fresh = self._states[0].copy()
        self._states[:] = before
        row = self._states[0]
        row["first_leg"], row["last_leg"] = fresh["first_leg"], fresh["last_leg"]
        row["segment"] += self._program.legs[now]["first_segment"] - place
        if row["done"] and now < row["last_leg"]:
            row["done"], row["status"] = 0, 3

    def place_on_leg(self, leg: int, leg_m: float, place: tuple[float, float, float] | None = None) -> None:
        """Stand `leg_m` metres along a leg (at most its length), facing along it, as if all before had been driven.

        With `place` it stands there instead: antenna east and north (m) and mathematical heading (rad). Raises
        MissionError for a leg that the mission does not have.
        """
        if not 0 <= leg < len(self.mission.legs):
            raise MissionError(f"There is no leg {leg} in a mission of {len(self.mission.legs)} legs; use one of them.")
        leg_driven, row, program = self.mission.legs[leg], self._states[0], self._program
        along = min(max(leg_m, 0.0), leg_driven.length_m)
        x, y, heading = _compute_pose_on_leg(leg_driven, along)
        reach, aside = float(self.arrays.models["guide"][0]), 0.0
        if place is not None:
            (x, y, heading), aside = place, self.tractor.antenna_right_m
        cosine, sine = math.cos(heading), math.sin(heading)
        self.body[:] = create_body(x - reach * cosine - aside * sine, y - reach * sine + aside * cosine, heading)
        record = program.legs[leg]
        progress = along + (float(program.legs[leg - 1]["end"]) if leg else 0.0)
        inside = program.cumulative[record["first_segment"] + 1 : record["last_segment"] + 1]
        row["segment"] = record["first_segment"] + int(np.searchsorted(inside, progress, side="right"))
        row["leg"], row["progress"] = leg, progress
        row["x"], row["y"], row["angle"] = self.body[:3]
        row["xs"], row["ys"], row["angles"] = self.body[:3]
        row["stand_left"] = 0.0 if along > 0.0 else record["stand"]
        row["started"], row["away"] = 1, 0
        self.state = self._measure_state()

    def advance(self, time_s: float) -> RobotState:
        """Drive up to a time (s since the start) and measure the state then."""
        steps = round(time_s / DT_S) - int(self._clock[0])
        if steps > 0:
            self._program.legs["speed"] = np.minimum(self._speeds, self.speed_limit_mps)
            program, machine, noise, before = self._program, self.arrays, self.noise, int(self._clock[0]) - 1
            ticks = (before + steps) // machine.steps_per_tick - before // machine.steps_per_tick
            errors = noise.position_m * self._guidance_noise.standard_normal((ticks, 2))
            pushes = self._soil_noise.standard_normal((steps, 2))
            pushes[:, 1] *= noise.along_m * math.sqrt(DT_S)
            run_mission_steps(
                steps, DT_S, machine.steps_per_tick, self._clock, self.body, self._states,
                machine.models, machine.grounds, machine.tables,
                program.legs, self._gates, program.points, program.cumulative,
                self._commands, errors, pushes, self._soil_state,
            )  # fmt: skip
        self.state = self._measure_state()
        return self.state

    @property
    def true_state(self) -> RobotState:
        """The state without noise and effects of the instruments: where the antenna of the file really is."""
        body, angle = self.body, float(self.body[2])
        x, y = locate_lever(body[:3], float(self.arrays.models["guide"][0]), self.tractor.antenna_right_m)
        speed = float(body[3]) * math.cos(angle) + float(body[4]) * math.sin(angle)
        return self._build_state(x, y, angle, speed)

    def _measure_state(self) -> RobotState:
        """What instruments show now, with new noise."""
        row, machine, noise = self._states[0], self.arrays, self.noise
        x, y, heading = measure_pose(row, machine.models[0], self.body, machine.ahead_m, machine.right_m)
        speed = self.true_state.speed_mps
        if noise != NO_NOISE:
            persistence = math.exp(-(self.time_s - self._drifted_s) / DRIFT_MEMORY_S)
            fresh = self.build_drift_sigmas() * self._fix_noise.standard_normal(3)
            self._drift = persistence * self._drift + math.sqrt(1.0 - persistence * persistence) * fresh
            self._drifted_s = self.time_s
            white = self._fix_noise.standard_normal(4)
            x += float(self._drift[0]) + noise.position_m * float(white[0])
            y += float(self._drift[1]) + noise.position_m * float(white[1])
            heading += float(self._drift[2]) + noise.heading_rad * float(white[2])
            speed += noise.speed_mps * float(white[3]) if abs(speed) > noise.speed_mps else 0.0
        return self._build_state(x, y, heading, speed)

    def _build_state(self, x: float, y: float, heading: float, speed: float) -> RobotState:
        row = self._states[0]
        leg = int(row["leg"])
        before = float(self._program.legs[leg - 1]["end"]) if leg else 0.0
        mode = STOPPED if self._commands[3] else AUTOMATIC if self._commands[0] else REMOTE
        wheels, command, target = float(row["steering"]), float(row["command"]), float(row["target_speed"])
        return RobotState(
            self.time_s, x, y, heading, speed, wheels, command, target, leg, float(row["progress"]) - before,
            self.mission.legs[leg].gear, bool(row["working"]), mode, bool(row["done"]),
        )  # fmt: skip


def _compute_pose_on_leg(leg: Leg, along_m: float) -> tuple[float, float, float]:
    """x, y (m) and heading (rad) of a tractor `along_m` along a leg; on a reverse leg it faces backwards."""
    steps, ends = np.diff(leg.points, axis=0), measure_along(leg.points)[1:]
    k = min(int(np.searchsorted(ends, along_m, side="right")), len(steps) - 1)
    length = math.hypot(*steps[k])
    share = 1.0 - (float(ends[k]) - along_m) / length if length > 0.0 else 0.0
    x, y = leg.points[k] + share * steps[k]
    return float(x), float(y), math.atan2(leg.gear * steps[k, 1], leg.gear * steps[k, 0])
