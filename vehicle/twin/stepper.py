"""A simulated robot tractor in real time: it drives the legs of its mission as they are released, or remote commands.

The functions are those of the world that plans are simulated in; effects and noise can be hidden in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vehicle.compile import CompiledPlan, compile_plan
from vehicle.errors import MissionError
from vehicle.layout import DT_S, GATE
from vehicle.missions import Leg, Mission, Plan, check_plan
from vehicle.tractor import Implement, Tractor
from vehicle.twin.motion import (
    DRIFT_MEMORY_S,
    NO_NOISE,
    SOIL_MEMORY_S,
    Noise,
    make_machine,
    mission_steps,
    new_body,
    shown_pose,
    with_hidden,
)

AUTOMATIC, REMOTE, STOPPED = "automatic", "remote", "stopped"


@dataclass(frozen=True)
class StepperState:
    """A tractor at one time. Metres east and north of the plan's origin of the antenna, as instruments show them.

    `heading_rad` is mathematical (from east, counter-clockwise), `speed_mps` and `speed_command_mps` are negative in
    reverse, angles of the wheels positive to the right. `leg` counts from 0, `leg_m` is the way driven on it.
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


class Stepper:
    """One tractor on its mission from time 0, standing at its start; gates and followers are for others to watch.

    `released` legs may be driven: the tractor stands at the end of the last of them. `limit_mps` is a speed it must not
    exceed. `hidden` are effects by id (a number stands for the first parameter); `noise` or `noise_m`, the white noise
    of positions, to which all other noise is in its usual proportion, disturb it. The same seed and calls give the same
    drive bit for bit. Raises MissionError for a mission that cannot be driven and VehicleError for an effect.
    """

    def __init__(
        self, mission: Mission, tractor: Tractor, implement: Implement, *,
        hidden: Mapping[str, float | Mapping[str, float]] | None = None, noise: Noise | None = None,
        noise_m: float = 0.0, seed: int = 0,
    ) -> None:  # fmt: skip
        self.tractor = with_hidden(tractor, hidden or {})
        self.noise = noise if noise is not None else Noise().scaled(noise_m / Noise().position_m)
        self.machine = make_machine(self.tractor, implement)
        self.limit_mps = math.inf
        self._given = np.array([1.0, 0.0, 0.0, 0.0])
        self._clock = np.zeros(1, dtype=np.int64)
        self._soil, self._guiding, self._fixing = (
            np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(3)
        )
        self._drift = self.noise_vector() * self._fixing.standard_normal(3)
        self._drifted_s = 0.0
        self._lay(mission)
        row = self._states[0]
        self.body = new_body(float(row["x"]), float(row["y"]), float(row["angle"]))
        self._memory = self._soil_memory()
        self.state = self._shown()

    def noise_vector(self) -> np.ndarray:
        """Standard deviations of the slow drift of east, north (m) and heading (rad)."""
        return np.array([self.noise.position_drift_m, self.noise.position_drift_m, self.noise.heading_drift_rad])

    def _soil_memory(self) -> np.ndarray:
        stays = math.exp(-DT_S / SOIL_MEMORY_S)
        fresh = self.noise.soil_per_m * math.sqrt(1.0 - stays * stays)
        first = self.noise.soil_per_m * float(self._soil.standard_normal())
        return np.array([first, stays, fresh])

    def _lay(self, mission: Mission) -> None:
        """Arrays of a mission whose only gates are its releases: tractor 1 stands for them, its progress is their
        number."""
        alone = Plan((Mission(tuple(replace(leg, gates=(), follow=None) for leg in mission.legs)),))
        check_plan(alone)
        program = compile_plan(alone, self.tractor)
        legs = program.legs
        legs["first_gate"] = np.arange(len(legs))
        legs["last_gate"] = legs["first_gate"] + 1
        gates = np.zeros(len(legs), dtype=GATE)
        gates["tractor"], gates["progress"] = 1, np.arange(1, len(legs) + 1)
        self.mission, self._gates = mission, gates
        self._program: CompiledPlan = program
        self._speeds = legs["speed"].copy()
        self._states = np.concatenate([program.states, np.zeros(1, dtype=program.states.dtype)])

    @property
    def time_s(self) -> float:
        """The time it has been advanced to."""
        return float(self._clock[0]) * DT_S

    @property
    def released(self) -> int:
        """How many legs, from the first, may be driven; 0 at the start."""
        return int(self._states[1]["progress"])

    @released.setter
    def released(self, legs: int) -> None:
        self._states[1]["progress"] = float(legs)

    def remote(self, steering_rad: float, speed_mps: float) -> None:
        """Drive by hand from now on: steering command (positive right) and speed (negative in reverse)."""
        lock = math.radians(self.tractor.max_steering_deg)
        self._given[:] = 0.0, min(max(steering_rad, -lock), lock), speed_mps, 0.0

    def automatic(self) -> None:
        """Drive the released legs from now on, after a halt too."""
        self._given[0], self._given[3] = 1.0, 0.0

    def halt(self) -> None:
        """Brake to a stand as hard as the tractor brakes, and stand until told otherwise."""
        self._given[3] = 1.0

    def follow(self, mission: Mission) -> None:
        """Take a mission whose legs up to the present one are those driven; the rest may be new.

        Raises MissionError when a leg already driven, or the present one, differs.
        """
        now = int(self._states[0]["leg"])
        for number in range(now + 1):
            same = number < len(mission.legs) and np.array_equal(
                mission.legs[number].points, self.mission.legs[number].points
            )
            if not same:
                raise MissionError(
                    f"The new mission differs in leg {number}, and leg {now} is being driven; keep all legs up to it."
                )
        before, place = self._states.copy(), self._program.legs[now]["first_segment"]
        self._lay(mission)
        fresh = self._states[0].copy()
        self._states[:] = before
        row = self._states[0]
        row["first_leg"], row["last_leg"] = fresh["first_leg"], fresh["last_leg"]
        row["segment"] += self._program.legs[now]["first_segment"] - place
        if row["done"] and now < row["last_leg"]:
            row["done"], row["status"] = 0, 3

    def begin_at(self, leg: int, leg_m: float, place: tuple[float, float, float] | None = None) -> None:
        """Stand so many metres along a leg (at most its length), facing along it, as if all before had been driven.

        With `place` it stands there instead: antenna east and north (m) and mathematical heading (rad). Raises
        MissionError for a leg that the mission does not have.
        """
        if not 0 <= leg < len(self.mission.legs):
            raise MissionError(f"There is no leg {leg} in a mission of {len(self.mission.legs)}; start on one of them.")
        one, row, program = self.mission.legs[leg], self._states[0], self._program
        along = min(max(leg_m, 0.0), one.length_m)
        x, y, heading = _pose_on(one, along)
        reach, aside = float(self.machine.models["guide"][0]), 0.0
        if place is not None:
            (x, y, heading), aside = place, self.tractor.antenna_right_m
        cosine, sine = math.cos(heading), math.sin(heading)
        self.body[:] = new_body(x - reach * cosine - aside * sine, y - reach * sine + aside * cosine, heading)
        record = program.legs[leg]
        progress = along + (float(program.legs[leg - 1]["end"]) if leg else 0.0)
        inside = program.cumulative[record["first_segment"] + 1 : record["last_segment"] + 1]
        row["segment"] = record["first_segment"] + int(np.searchsorted(inside, progress, side="right"))
        row["leg"], row["progress"] = leg, progress
        row["x"], row["y"], row["angle"] = self.body[:3]
        row["xs"], row["ys"], row["angles"] = self.body[:3]
        row["stand_left"] = 0.0 if along > 0.0 else record["stand"]
        row["started"], row["away"] = 1, 0
        self.state = self._shown()

    def advance(self, time_s: float) -> StepperState:
        """Drive up to a time (s since the start) and draw what instruments show then."""
        steps = round(time_s / DT_S) - int(self._clock[0])
        if steps > 0:
            self._program.legs["speed"] = np.minimum(self._speeds, self.limit_mps)
            program, machine, noise = self._program, self.machine, self.noise
            ticks = (int(self._clock[0]) + steps - 1) // machine.every - (int(self._clock[0]) - 1) // machine.every
            errors = noise.position_m * self._guiding.standard_normal((ticks, 2))
            pushes = self._soil.standard_normal((steps, 2))
            pushes[:, 1] *= noise.along_m * math.sqrt(DT_S)
            mission_steps(
                steps, DT_S, machine.every, self._clock, self.body, self._states, machine.models, machine.grounds,
                machine.tables, program.legs, self._gates, program.points, program.cumulative, self._given, errors,
                pushes, self._memory,
            )  # fmt: skip
        self.state = self._shown()
        return self.state

    @property
    def truth(self) -> StepperState:
        """The state without noise, effects of the instruments left out: where the antenna of the file really is."""
        row, body = self._states[0], self.body
        angle = float(body[2])
        ahead = float(self.machine.models["guide"][0])
        aside = self.tractor.antenna_right_m
        x = float(body[0]) + ahead * math.cos(angle) + aside * math.sin(angle)
        y = float(body[1]) + ahead * math.sin(angle) - aside * math.cos(angle)
        speed = float(body[3]) * math.cos(angle) + float(body[4]) * math.sin(angle)
        return self._with(row, x, y, angle, speed)

    def _shown(self) -> StepperState:
        """What instruments show now, with noise drawn anew."""
        row, machine, noise = self._states[0], self.machine, self.noise
        x, y, heading = shown_pose(row, machine.models[0], self.body, machine.ahead_m, machine.right_m)
        speed = self.truth.speed_mps
        if noise != NO_NOISE:
            keep = math.exp(-(self.time_s - self._drifted_s) / DRIFT_MEMORY_S)
            fresh = self.noise_vector() * self._fixing.standard_normal(3)
            self._drift = keep * self._drift + math.sqrt(1.0 - keep * keep) * fresh
            self._drifted_s = self.time_s
            white = self._fixing.standard_normal(4)
            x += float(self._drift[0]) + noise.position_m * float(white[0])
            y += float(self._drift[1]) + noise.position_m * float(white[1])
            heading += float(self._drift[2]) + noise.heading_rad * float(white[2])
            speed += noise.speed_mps * float(white[3]) if abs(speed) > noise.speed_mps else 0.0
        return self._with(row, x, y, heading, speed)

    def _with(self, row: np.void, x: float, y: float, heading: float, speed: float) -> StepperState:
        leg = int(row["leg"])
        before = float(self._program.legs[leg - 1]["end"]) if leg else 0.0
        mode = STOPPED if self._given[3] else AUTOMATIC if self._given[0] else REMOTE
        return StepperState(
            self.time_s, x, y, heading, speed, float(row["steering"]), float(row["command"]),
            float(row["target_speed"]), leg, float(row["progress"]) - before, self.mission.legs[leg].gear,
            bool(row["working"]), mode, bool(row["done"]),
        )  # fmt: skip


def _pose_on(leg: Leg, along_m: float) -> tuple[float, float, float]:
    """x, y (m) and heading (rad) of a tractor so far along a leg, which faces backwards where it reverses."""
    steps = np.diff(leg.points, axis=0)
    ends = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))
    k = min(int(np.searchsorted(ends, along_m, side="right")), len(steps) - 1)
    length = math.hypot(*steps[k])
    share = 1.0 - (float(ends[k]) - along_m) / length if length > 0.0 else 0.0
    x, y = leg.points[k] + share * steps[k]
    return float(x), float(y), math.atan2(leg.gear * steps[k, 1], leg.gear * steps[k, 0])
