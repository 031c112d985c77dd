"""The third reference: a tractor on four tyres with a spool valve and a governor, logged by columns with clocks.

It shares with the other references the programmes of commands, the table of effects, the forms of cases and the
measured radii, and nothing of how a log comes about: tests.truth.third_body is the tractor, tests.truth.third_run a
drive, tests.truth.third_columns the instruments. The ground pushes by place (the same when driven again) and by time.
Imports nothing of the project it tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth import third_body as body
from tests.truth import third_columns as columns
from tests.truth import third_run as run
from tests.truth.cases import ColumnClock, Fault, Law, TruthCase
from tests.truth.drives import Drive
from tests.truth.effects import complete
from tests.truth.ground import MAP_SPEED_MPS, find_point
from tests.truth.laws import BODY_EFFECTS, P_LAG, P_RATE, encode_law, evaluate_rows
from tests.truth.signals import NO_CLOCK, draw_coloured, low_pass, pick_held, round_to
from tests.truth.third_columns import EXACT, Reading, Rows, Sensors
from tests.truth.third_drives import PROGRAMMES
from tests.truth.third_outside import OUTSIDE_CAUSES, make_odd

Array = npt.NDArray[np.float64]
ANTENNA_FORWARD_M = 1.1
DAY_STEP_S, MORNING_S = 150.0, 30000.0  # from run to run, and the clock of the first one
TAIL_S = 2.0  # driven on after the last row, for clocks that run ahead
FIELD_SPREAD_M, PATCH_EDGE_M = 9.0, 0.8
GROUND_BY_PLACE, GROUND_BY_TIME, GROUND_S, GUST_S, DEPTH_S = 0.0040, 0.0024, 0.35, 4.0, 7.0
COLUMNS = ("time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "speed_command_mps",
           "steering_command_deg", "steering_deg", "shuttle", "implement")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Track:
    """A drive as it was, a row per step of tests.truth.third_run: states and the command in force (deg)."""

    time_s: Array
    states: Array
    held_deg: Array
    day_s: float

    def column(self, index: int) -> Array:
        """One state over time."""
        return self.states[:, index]

    def find_point(self, forward_m: Array | float, right_m: Array | float) -> tuple[Array, Array]:
        """East and north of a point ahead of the rear axle and to its right."""
        return find_point(*self.states[:, : body.HEADING + 1].T, forward_m - body.REAR, right_m)


@dataclass(frozen=True)
class Third:
    """The tractor of a case. `ground` scales the roughness of the soil (0: none).

    Raises ValueError for a cause outside the catalogue that this reference does not have.
    """

    case: TruthCase
    sensors: Sensors = field(default_factory=Sensors)
    ground: float = 1.0

    def __post_init__(self) -> None:
        unknown = sorted(set(self.case.outside) - set(OUTSIDE_CAUSES))
        if unknown:
            raise ValueError(
                f"The third reference cannot hide {unknown[0]!r}; use one of: {', '.join(OUTSIDE_CAUSES)}."
            )

    @property
    def front_share(self) -> float:
        """Share of the front axle in the driving force: four-wheel drive by every other seed.

        Where the tyres slide the rear axle drives alone: turned wheels that pull would turn beyond their side friction.
        """
        slides = "side_slip" in {*self.case.effects, *(law.effect for law in self.case.laws)}
        return 0.0 if slides or self.case.seed % 2 == 0 else body.FRONT_DRIVE_SHARE

    def track(self, drive: Drive, index: int = 0) -> Track:
        """The drive without instruments; `index` numbers the runs of a programme, each with draws of its own."""
        rng = np.random.default_rng([self.case.seed, index, 31])
        bearing = math.radians(rng.uniform(0.0, 360.0) if drive.bearing_deg is None else drive.bearing_deg)
        place = rng.uniform(-FIELD_SPREAD_M, FIELD_SPREAD_M, 2)
        plain = Third(TruthCase("clean", self.case.seed), EXACT, 0.0)
        east, north = plain._drive(drive, index, (0.0, 0.0, bearing)).find_point(0.0, 0.0)
        middle = [0.5 * float(np.min(axis) + np.max(axis)) for axis in (east, north)]
        return self._drive(drive, index, (float(place[0]) - middle[0], float(place[1]) - middle[1], bearing))

    def log(self, drive: Drive, index: int = 0) -> pd.DataFrame:
        """The drive as a log in the columns of the contract, the name of the drive in `attrs`."""
        track = self.track(drive, index)
        rng = np.random.default_rng([self.case.seed, index, 32])
        times = np.arange(0.0, drive.duration_s - 1e-9, 1.0 / self.case.rate_hz)
        jitter = min(self.sensors.jitter_s, 0.1 / self.case.rate_hz)
        times[1:] += jitter * np.clip(rng.standard_normal(len(times) - 1), -3.0, 3.0)
        values = self._measure(track, drive, index, times, rng) | {
            "time_s": np.round(times + MORNING_S + track.day_s, 3),
            "speed_command_mps": drive.speed(times),
            "shuttle": drive.shuttle(times).astype(int),
            "implement": drive.implement(times).astype(int),
        }
        frame = pd.DataFrame({name: values[name] for name in COLUMNS})
        frame.attrs["name"] = drive.name
        return frame

    def _clock(self, name: str) -> ColumnClock:
        return self.case.columns.get(name, NO_CLOCK)

    def _faults(self, index: int, *ids: str) -> list[Fault]:
        return [fault for fault in self.case.faults if fault.run == index and fault.id in ids]

    def _law(self, name: str, index: int) -> Array:
        """A parameter of an effect as a row of tests.truth.laws; a patch and a drift of grip are laws themselves."""
        values = complete(self.case.effects)[name]
        law = next((law for law in self.case.laws if law.effect == name), None)
        if law is None and name == "grip_patch":
            law = Law(name, "by_place", {"inside": values["ratio"], "outside": 1.0, **values})
        elif law is None and name == "grip_drift":
            law = Law(name, "over_minutes", {"start": 1.0, "per_minute": values["per_minute"]})
        elif law is None:
            law = Law(name, "constant", {"value": min(next(iter(values.values())), 1e6)})
        return encode_law(law, BODY_EFFECTS.get(name, -1), index, PATCH_EDGE_M)

    def _laws(self, index: int) -> Array:
        laws = np.array([self._law(name, index) for name in BODY_EFFECTS])
        oil = self.case.outside.get("oil_temperature")
        if oil is not None:
            cold = math.exp(-index * DAY_STEP_S / oil["warm_s"])
            laws[P_LAG, 2] += oil["lag_s"] * cold
            laws[P_RATE, 2] *= 1.0 - oil["rate_share"] * cold
        return laws

    def _drive(self, drive: Drive, index: int, start: tuple[float, float, float]) -> Track:
        rng = np.random.default_rng([self.case.seed, index, 33])
        time = np.arange(0.0, drive.duration_s + TAIL_S, run.STEP_S)
        rough = self.ground * GROUND_BY_TIME * draw_coloured(rng, len(time), run.STEP_S, GROUND_S)
        gusts = draw_coloured(rng, len(time), run.STEP_S, GUST_S)
        depths = 1.0 + 0.8 * np.sign(np.sin(2.0 * np.pi * time / DEPTH_S + rng.uniform(0.0, 6.0)))
        state = np.zeros(body.STATES)
        state[body.EAST], state[body.NORTH], state[body.HEADING] = start
        signal, laws = drive.steering(time), self._laws(index)
        state[body.WHEEL] = 0.0 if drive.closed_loop else signal[0]
        dead = float(self._law("steering_dead_time", index)[2])
        old, old_heading, errors = self._seen(index, time, rng)
        slope_to = math.radians(complete(self.case.effects)["cross_slope_drift"]["bearing_deg"])
        odd = make_odd(self.case.outside, index)._replace(slope_to=slope_to)
        states, held = run.roll_on(
            state, index * DAY_STEP_S, signal, drive.speed(time) * drive.shuttle(time), drive.implement(time), depths,
            rough, gusts, old, old_heading, errors, round(dead / run.STEP_S), self.front_share, laws,
            draw_waves(self.case.seed, self.ground), odd, self._breaks(index),
            self._way(drive, start), calibrate_curve(self.front_share),
        )  # fmt: skip
        return Track(time, states, held, index * DAY_STEP_S)

    def _breaks(self, index: int) -> body.Breaks:
        breaks = body.Breaks()
        for fault in self._faults(index, "steering_loose", "steering_stuck"):
            end = 1e9 if fault.to_s is None else fault.to_s
            if fault.id == "steering_loose":
                breaks = breaks._replace(
                    loose_from=fault.from_s, loose_to=end, linkage=fault.detail.get("linkage", 0.0)
                )
            else:
                side = fault.detail.get("side", 1.0)
                breaks = breaks._replace(stuck_from=fault.from_s, stuck_to=end, stuck_side=side)
        return breaks

    def _way(self, drive: Drive, start: tuple[float, float, float]) -> body.Way:
        values = complete(self.case.effects)
        forward = ANTENNA_FORWARD_M + values["antenna_forward"]["distance_m"]
        right, bias = values["antenna_right"]["distance_m"], math.radians(values["heading_bias"]["angle_deg"])
        return body.Way(drive.closed_loop, *start, forward, right, ANTENNA_FORWARD_M, bias)

    def _seen(self, index: int, time: Array, rng: np.random.Generator) -> tuple[Rows, Rows, Array]:
        """Rows that the path follower gets position and heading from at each step, and the errors of the position."""
        latency = float(self._law("gnss_latency", index)[2])
        rows: list[Rows] = []
        for name, frozen in (("position", ("position_frozen", "position_lost")), ("heading", ("heading_frozen",))):
            # Where a value stands is not the receiver's stamp: the follower has it when it arrives.
            clock = replace(self._clock(name), offset_s=0.0, drift_s_per_min=0.0)
            when = columns.read_column(clock, time, np.random.default_rng([self.case.seed, index, 34])).when_s
            when = columns.freeze_values(when, time, [each for each in self._faults(index, *frozen) if is_freeze(each)])
            rows.append(np.maximum(((when - latency) / run.STEP_S).astype(np.int64), 0))
        errors = columns.lose_position(time, self._faults(index, "position_lost"), (self.case.seed, index, 35))
        errors += self.sensors.position_m * rng.standard_normal(errors.shape)
        return rows[0], rows[1], errors

    def _measure(
        self, track: Track, drive: Drive, index: int, times: Array, rng: np.random.Generator
    ) -> dict[str, Array]:
        down = drive.implement(track.time_s)
        values = self._measure_position(track, index, times, down, rng)
        values["heading_deg"] = self._measure_heading(track, index, times, down, rng)
        tool = self.sensors
        reading, speed = self._read(track, "speed", np.abs(track.column(body.AHEAD)), times, rng)
        noise = columns.draw_noise(reading, tool.speed_mps, 0.0, 1.0, rng) * np.minimum(speed / 0.2, 1.0)
        speed = round_to(np.maximum(speed + noise, 0.0), tool.speed_digit_mps)
        values["speed_mps"] = columns.freeze_values(speed, times, self._faults(index, "speed_frozen"))
        reading, wheel = self._read(track, "steering", track.column(body.WHEEL), times, rng)
        wheel = round_to(wheel + columns.draw_noise(reading, tool.wheel_deg, 0.0, 1.0, rng), tool.wheel_digit_deg)
        values["steering_deg"] = columns.freeze_values(wheel, times, self._faults(index, "wheel_sensor_frozen"))
        _, command = self._read(track, "steering_command", track.held_deg, times, rng, stairs=True)
        values["steering_command_deg"] = np.round(command, 3)
        return values

    def _measure_position(
        self, track: Track, index: int, times: Array, down: Array, rng: np.random.Generator
    ) -> dict[str, Array]:
        tool, outside = self.sensors, self.case.outside
        forward = ANTENNA_FORWARD_M + self._along("antenna_forward", track, index, down)
        right = self._along("antenna_right", track, index, down)
        if "mast_sway" in outside:
            pull = low_pass(track.column(body.SIDE_PULL), run.STEP_S, 0.3)
            right = right - outside["mast_sway"]["m_per_mps2"] * pull
        if "articulated" in outside:
            forward = forward + outside["articulated"]["antenna_forward_m"] - ANTENNA_FORWARD_M
        axes = np.array(track.find_point(forward, right))
        if "trees" in outside:
            odd = make_odd(outside, index)
            axes += np.array([run.see_past_trees(east, north, odd) for east, north in axes.T]).T
        lost = self._faults(index, "position_lost")
        axes += columns.lose_position(track.time_s, lost, (self.case.seed, index, 35)).T
        clock, latency = self._clock("position"), self._along("gnss_latency", track, index, down)
        reading, frozen = columns.read_column(clock, times, rng), self._faults(index, "position_frozen")
        frozen += [each for each in lost if is_freeze(each)]
        when, values = reading.when_s - np.interp(times, track.time_s, latency), {}
        for name, axis in zip(("easting_m", "northing_m"), axes, strict=True):
            axis = low_pass(axis, run.STEP_S, clock.filter_s)
            noise = columns.draw_noise(reading, tool.position_m, tool.wander_m, tool.wander_s, rng)
            value = np.round(np.interp(when, track.time_s, axis) + noise, 3)
            values[name] = columns.freeze_values(value, times, frozen)
        return values

    def _measure_heading(self, track: Track, index: int, times: Array, down: Array, rng: np.random.Generator) -> Array:
        tool, latency = self.sensors, self._along("gnss_latency", track, index, down)
        true = np.degrees(track.column(body.HEADING)) + self._along("heading_bias", track, index, down)
        clock = self._clock("heading")
        reading = columns.read_column(clock, times, rng)
        when = reading.when_s - np.interp(times, track.time_s, latency)
        heading = np.interp(when, track.time_s, low_pass(true, run.STEP_S, clock.filter_s))
        heading = heading + columns.draw_noise(
            reading, tool.heading_deg, tool.heading_memory_deg, tool.heading_memory_s, rng
        )
        heading = np.mod(round_to(heading, tool.heading_digit_deg), 360.0)
        return columns.freeze_values(heading, times, self._faults(index, "heading_frozen"))

    def _read(
        self, track: Track, name: str, true: Array, times: Array, rng: np.random.Generator, stairs: bool = False
    ) -> tuple[Reading, Array]:
        """What a column's clock makes of a signal; `stairs` for one that jumps."""
        clock = self._clock(name)
        reading = columns.read_column(clock, times, rng)
        value = low_pass(true, run.STEP_S, clock.filter_s) * clock.scale
        if not stairs:
            return reading, np.interp(reading.when_s, track.time_s, value)
        return reading, pick_held(value, reading.when_s, run.STEP_S)

    def _along(self, name: str, track: Track, index: int, down: Array) -> Array:
        """A parameter of an instrument at every step of a track."""
        time, places = track.time_s, (body.EAST, body.NORTH, body.WHEEL, body.AHEAD)
        east, north, wheel, speed = (track.column(place) for place in places)
        here = np.column_stack([time, track.day_s + time, east, north, down, wheel, speed])
        return evaluate_rows(self._law(name, index), here)


def is_freeze(fault: Fault) -> bool:
    """Whether a fault repeats the last position, and does not degrade it."""
    return fault.id != "position_lost" or fault.detail.get("mode", 0) == 2


def draw_waves(seed: int, ground: float) -> Array:
    """Ridges of the ground: wave numbers to east and north (1/m), phase, and pushes to east and north (slip)."""
    rng = np.random.default_rng([seed, 36])
    turns, lengths = rng.uniform(0.0, 2.0 * np.pi, run.WAVES), np.exp(rng.uniform(np.log(1.5), np.log(9.0), run.WAVES))
    numbers = 2.0 * np.pi / lengths
    pushes = ground * GROUND_BY_PLACE * np.sqrt(2.0 / run.WAVES) * rng.standard_normal((run.WAVES, 2))
    phases = rng.uniform(0.0, 2.0 * np.pi, run.WAVES)
    return np.column_stack([numbers * np.cos(turns), numbers * np.sin(turns), phases, pushes])


@lru_cache(maxsize=2)
def calibrate_curve(front_share: float) -> Array:
    """Mean wheel angle (rad) at even curvatures of the way of the centre of mass, by driving circles at 5 km/h."""
    angles = np.radians(np.linspace(0.0, 50.0, 51))
    ends = np.array([body.settle(angle, MAP_SPEED_MPS, 8.0, front_share) for angle in angles])
    bends = ends[:, body.YAW_RATE] / np.hypot(ends[:, body.AHEAD], ends[:, body.SIDEWAYS])
    grid = np.linspace(-body.TABLE_MOST, body.TABLE_MOST, body.TABLE_SIZE)
    return np.asarray(np.sign(grid) * np.interp(np.abs(grid), bends, angles), dtype=float)


def make_third_logs(case: TruthCase) -> list[pd.DataFrame]:
    """Logs of the case's programme. Raises ValueError for a programme or a cause that this reference does not have."""
    if case.programme not in PROGRAMMES:
        raise ValueError(f"The programme {case.programme!r} is unknown; use one of: {', '.join(PROGRAMMES)}.")
    third = Third(case)
    return [third.log(drive, index) for index, drive in enumerate(PROGRAMMES[case.programme]())]
