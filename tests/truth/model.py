"""The truth: a real tractor with hidden effects, driven and logged. Imports nothing of the project it tests.

It differs from the project's simulator on purpose: a single-track body in vehicle axes, Runge-Kutta 4 at 4 ms, a smooth
valve, saturating tyres on springs, a controller with a jittering clock, uneven soil, drifting and rounded sensors.
What they share is the nominal tractor: the measured radii of the EG105 on soil and its steering times.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth import body
from tests.truth.drives import Drive, default_programme
from tests.truth.effects import Effects, complete
from tests.truth.ground import Track
from tests.truth.laws import name_parameters
from tests.truth.recorder import build_log, find_antenna, read_switches
from tests.truth.sensors import Instruments, disturbed, log_times
from tests.truth.signals import draw_coloured, pick_held, round_to

Array = npt.NDArray[np.float64]
CONTROLLER_S, CONTROLLER_JITTER_S = 0.02, 0.006
LINE_CONTROLLER_S = 0.1
SOIL_MEMORY_S = 0.5
FIELD_SPREAD_M = 10.0


@dataclass(frozen=True)
class Truth:
    """A tractor with hidden `effects` and the conditions of its logging.

    `seed` fixes every draw. `origin` (m) is added to the logged positions; the place of a grip patch is meant before
    that. `soil_deg_per_s` is the yaw noise of the ground at 5 km/h. `terrain` (grade, bearing downhill in degrees) adds
    the columns roll_deg (right side down) and pitch_deg (nose up) and moves nothing: that is for cross_slope_drift.
    `ground` is ground that is no plane: it moves the tractor, and adds the same columns with noise, mounting and lean.
    `mirrored` drives every programme with left and right exchanged. `drop` names columns to leave out.
    """

    effects: Effects = field(default_factory=dict)
    seed: int = 0
    rate_hz: float = 20.0
    origin: tuple[float, float] = (0.0, 0.0)
    mirrored: bool = False
    soil_deg_per_s: float = 0.2
    instruments: Instruments = field(default_factory=Instruments)
    uneven: float = 0.0
    gaps: int = 0
    terrain: tuple[float, float] | None = None
    ground: body.Ground | None = None
    drop: tuple[str, ...] = ()
    step_s: float = 0.004

    def trace(self, drive: Drive, index: int = 0) -> Track:
        """The drive without instruments. `index` numbers the runs of a programme: each has its own draws."""
        drive = drive.mirrored() if self.mirrored else drive
        rng = np.random.default_rng([self.seed, index, 1])
        bearing = rng.uniform(0.0, 360.0) if drive.bearing_deg is None else drive.bearing_deg
        place = rng.uniform(-FIELD_SPREAD_M, FIELD_SPREAD_M, 2)
        quiet = replace(self, effects={}, soil_deg_per_s=0.0, step_s=0.02)
        plain = quiet._integrate(drive, (0.0, 0.0, math.radians(bearing)), np.random.default_rng(0), 0.0)
        return self._integrate(drive, plain.find_start(place, math.radians(bearing), body.REAR), rng, 90.0 * index)

    def log(self, drive: Drive, index: int = 0) -> pd.DataFrame:
        """The drive as its log: the columns of the contract, the name of the drive in `attrs`."""
        trace = self.trace(drive, index)
        drive = drive.mirrored() if self.mirrored else drive
        rng = np.random.default_rng([self.seed, index, 2])
        times = log_times(drive.duration_s, self.rate_hz, self.uneven, self.gaps, rng)
        columns = self._measured(trace, times, rng) | read_switches(drive, times)
        if self.terrain is not None:
            columns |= self._terrain(trace, times)
        if self.ground is not None:
            columns |= self._tilt(trace, times, self.ground)
        columns["time_s"] = np.round(times + rng.integers(0, 1000), 3)
        return build_log(drive.name, {name: values for name, values in columns.items() if name not in self.drop})

    def _integrate(
        self, drive: Drive, start: tuple[float, float, float], rng: np.random.Generator, clock_s: float
    ) -> Track:
        values = complete(self.effects)
        dt = self.step_s
        time = np.arange(0.0, drive.duration_s + 0.5 * dt, dt)
        soil = math.radians(self.soil_deg_per_s)
        # Noise is drawn on one grid whatever the step, so that a finer step sees the same ground.
        grid = np.arange(0.0, drive.duration_s + 0.2, 0.02)
        pushes = soil * draw_coloured(rng, len(grid), 0.02, SOIL_MEMORY_S)
        seen = self.instruments.position_m * rng.standard_normal(len(grid))
        period = LINE_CONTROLLER_S if drive.closed_loop else CONTROLLER_S
        beats = np.arange(0.0, drive.duration_s, period)
        beats[1:] += rng.uniform(0.0, CONTROLLER_JITTER_S, len(beats) - 1)
        rows = np.minimum(np.round(beats / dt).astype(int), len(time) - 1)
        ticks = np.zeros(len(time), dtype=np.bool_)
        ticks[rows] = True
        state = np.zeros(body.STATES)
        state[body.EAST], state[body.NORTH], state[body.HEADING] = start
        first = 0.0 if drive.closed_loop else float(drive.steering(time[:1])[0])
        # The wheels are set before the run starts; the tractor then drives off from a standstill.
        state[body.ACTUATOR] = first
        signal = drive.steering(time)
        states, held, _ = body.integrate(
            state, dt, signal, drive.speed(time) * drive.shuttle(time), signal, drive.implement(time),
            np.interp(time, grid, pushes), np.interp(time, grid, seen), ticks,
            round(values["steering_dead_time"]["time_s"] / dt),
            hidden(values, clock_s)._replace(ground=self.ground or body.Ground()),
            self._loop(drive, start, values), *steady_table(),
        )  # fmt: skip
        slip = 1.0 - values["wheel_slip"]["ratio"]
        working = 1.0 - values["implement_slip"]["ratio"] * drive.implement(time)
        speed = states[:, body.WHEEL_SPEED] * slip * working
        if self.ground is not None:
            ahead = np.array([body.falls(*row[: body.HEADING + 1], self.ground)[1] for row in states])
            speed = speed * (1.0 + self.ground.climb * ahead * np.sign(speed))
        return Track(time, states, held, speed, body.REAR)

    def _loop(self, drive: Drive, start: tuple[float, float, float], values: dict[str, dict[str, float]]) -> body.Loop:
        late = round(values["gnss_latency"]["time_s"] / self.step_s)
        return body.Loop(drive.closed_loop, *start, late, *find_antenna(values))

    def _measured(self, trace: Track, times: Array, rng: np.random.Generator) -> dict[str, Array]:
        values, tool = complete(self.effects), self.instruments
        late = times - values["gnss_latency"]["time_s"]
        east, north = trace.find_point(*find_antenna(values))
        drift, columns = (tool.position_drift_m, tool.position_digit_m, tool.drift_s, rng), {}
        for name, axis, zero in (("easting_m", east, self.origin[0]), ("northing_m", north, self.origin[1])):
            columns[name] = disturbed(np.interp(late, trace.time_s, axis) + zero, times, tool.position_m, *drift)
        heading = np.degrees(np.interp(late, trace.time_s, trace.column(body.HEADING)))
        heading = disturbed(
            heading + values["heading_bias"]["angle_deg"], times, tool.heading_deg, tool.heading_drift_deg,
            tool.heading_digit_deg, tool.drift_s, rng,
        )  # fmt: skip
        columns["heading_deg"] = np.mod(heading, 360.0)
        speed = np.abs(np.interp(times, trace.time_s, trace.speed_mps))
        noise = tool.speed_mps * rng.standard_normal(len(times)) * np.minimum(speed / 0.2, 1.0)
        columns["speed_mps"] = np.maximum(round_to(speed + noise, tool.speed_digit_mps), 0.0)
        columns["steering_command_deg"] = np.round(pick_held(trace.held_deg, times, self.step_s), 3)
        angle = np.interp(times, trace.time_s, trace.column(body.ACTUATOR))
        angle = angle + tool.steering_deg * rng.standard_normal(len(times))
        columns["steering_deg"] = round_to(angle, tool.steering_digit_deg)
        return columns

    def _terrain(self, trace: Track, times: Array) -> dict[str, Array]:
        grade, bearing = self.terrain or (0.0, 0.0)
        turn = math.radians(bearing) - np.interp(times, trace.time_s, trace.column(body.HEADING))
        roll, pitch = np.arctan(grade * np.sin(turn)), -np.arctan(grade * np.cos(turn))
        return {"roll_deg": np.round(np.degrees(roll), 2), "pitch_deg": np.round(np.degrees(pitch), 2)}

    def _tilt(self, trace: Track, times: Array, ground: body.Ground) -> dict[str, Array]:
        """Roll and pitch as a sensor has them; its draws are its own, so that no other column depends on it."""
        rng, tool = np.random.default_rng([self.seed, len(times), 3]), self.instruments
        states = [np.interp(times, trace.time_s, trace.column(k)) for k in (body.EAST, body.NORTH, body.HEADING)]
        falls = np.array([body.falls(*pose, ground) for pose in zip(*states, strict=True)])
        side = np.interp(times, trace.time_s, trace.speed_mps * trace.column(body.SPIN))
        right, ahead = np.degrees(np.arctan(falls)).T
        right += (
            tool.roll_mounting_deg - tool.lean_deg_per_mps2 * side + tool.tilt_deg * rng.standard_normal(len(times))
        )
        ahead -= tool.pitch_mounting_deg + tool.tilt_deg * rng.standard_normal(len(times))
        return {"roll_deg": np.round(right, 2), "pitch_deg": np.round(-ahead, 2)}


@lru_cache(maxsize=1)
def steady_table() -> tuple[Array, Array]:
    """The body's own curvature and wheel angle tables, made once."""
    return body.steady_table()


def hidden(values: dict[str, dict[str, float]], clock_s: float) -> body.Hidden:
    """The effects as the body wants them. `clock_s` is the time of day at the start of the run."""
    heat, known = values["steering_temperature"], name_parameters(values)
    known["half_play"] = 0.5 * known.pop("play")
    known["speed_lag"] = max(known["speed_lag"], body.SPEED_LAG_S)
    del known["dead_time"]
    return body.Hidden(
        **known,  # type: ignore[arg-type]
        temperature=heat["share"],
        temperature_period=heat["period_s"],
        pull=values["speed_pull"]["deg_per_m2ps2"],
        wobble=values["steering_wobble"]["angle_deg"],
        wobble_period=values["steering_wobble"]["period_s"],
        relaxation=values["tyre_relaxation"]["length_m"],
        wind=values["wind_drift"]["speed_mps"],
        wind_bearing=math.radians(values["wind_drift"]["bearing_deg"]),
        clock=clock_s,
    )


def make_logs(
    effects: Effects, seed: int, programme: Sequence[Drive] | None = None, **conditions: object
) -> list[pd.DataFrame]:
    """Logs of a programme (the default one of sixteen runs) by a tractor with hidden effects.

    `conditions` are further fields of Truth (rate_hz, origin, mirrored, uneven, gaps, terrain, drop, ...).
    """
    truth = Truth(effects, seed, **conditions)  # type: ignore[arg-type]
    return [truth.log(drive, index) for index, drive in enumerate(programme or default_programme())]
