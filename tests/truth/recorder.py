"""How a run becomes a log: instruments with noise, clocks and faults; what all references share of a log stands here.

A reference says what was true at every step, and may spoil it; the recorder says what of it each row of a log shows.
Columns have a clock each (tests.truth.cases.ColumnClock). A row shows the last message that came, and a message keeps
its noise in all rows that show it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth.cases import COLUMN_NAMES, ColumnClock, TruthCase
from tests.truth.drives import Drive
from tests.truth.ground import find_point
from tests.truth.laws import follow_law
from tests.truth.signals import NO_CLOCK, draw_coloured, is_within, low_pass, pick_held, round_to

Array = npt.NDArray[np.float64]
Values = Mapping[str, Mapping[str, float]]
ANTENNA_FORWARD_M = 1.1  # nominal place of the antenna, ahead of the rear axle
COLUMNS = (
    "time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "speed_command_mps", "steering_command_deg",
    "steering_deg", "shuttle", "implement", "roll_deg", "pitch_deg",
)  # fmt: skip
FROZEN = {"position_frozen": "position", "heading_frozen": "heading", "speed_frozen": "speed",
          "wheel_sensor_frozen": "steering"}  # fmt: skip
DAY_STARTS_S = 30_000.0  # the clock of a log when that of the day is 0
LOST_MEMORY_S, JUMP_S = 1.5, 5.0  # of a position without a fix: how long it errs alike, and between its jumps


@dataclass(frozen=True)
class Instruments:
    """Standard deviations, memories (s) and last digits of instruments, and how evenly rows come; exact by default."""

    position_m: float = 0.0
    wander_m: float = 0.0
    wander_s: float = 60.0
    heading_deg: float = 0.0
    heading_wander_deg: float = 0.0
    heading_wander_s: float = 1.0
    heading_digit_deg: float = 0.001
    speed_mps: float = 0.0
    speed_digit_mps: float = 0.001
    wheel_deg: float = 0.0
    wheel_digit_deg: float = 0.0
    row_jitter_s: float = 0.0


@dataclass(frozen=True, eq=False)
class Signals:
    """What was true at even steps (k,): m, rad, m/s; angles of wheel and command in deg; `clock_s` is of the day."""

    step_s: float
    clock_s: float
    east: Array
    north: Array
    heading: Array
    speed: Array
    wheel: Array
    command: Array
    implement: Array

    @property
    def time_s(self) -> Array:
        """Since the start (k,)."""
        return self.step_s * np.arange(len(self.east), dtype=np.float64)

    def follow(self, case: TruthCase, effect: str, run: int) -> Array:
        """An instrument's value at every step (k,), by its law if it has one."""
        places = (self.east, self.north, self.implement, self.wheel, self.speed)
        return follow_law(case, effect, run, np.column_stack([self.time_s, self.clock_s + self.time_s, *places]))

    def place_antenna(
        self, case: TruthCase, run: int, nominal_m: float = ANTENNA_FORWARD_M, sway_m: Array | float = 0.0
    ) -> Array:
        """Where the antenna is (k, 2), m east and north; `sway_m` is how far a mast leans to the right."""
        forward, right = (self.follow(case, name, run) for name in ("antenna_forward", "antenna_right"))
        return np.column_stack(find_point(self.east, self.north, self.heading, nominal_m + forward, right + sway_m))


def find_antenna(values: Values, nominal_m: float = ANTENNA_FORWARD_M) -> tuple[float, float]:
    """Where the antenna really stands: ahead of the rear axle, and to its right (m)."""
    return nominal_m + values["antenna_forward"]["distance_m"], values["antenna_right"]["distance_m"]


def read_switches(drive: Drive, times: Array) -> dict[str, Array]:
    """The columns of a log that are what was commanded."""
    return {
        "speed_command_mps": drive.speed(times),
        "shuttle": drive.shuttle(times).astype(int),
        "implement": drive.implement(times).astype(int),
    }


def build_log(name: str, columns: Mapping[str, Array]) -> pd.DataFrame:
    """A log in the order of its contract, the name of its run in `attrs`."""
    frame = pd.DataFrame({column: columns[column] for column in COLUMNS if column in columns})
    frame.attrs["name"] = name
    return frame


def list_row_times(duration_s: float, rate_hz: float, tool: Instruments, rng: np.random.Generator) -> Array:
    """When the rows of a log are written (s)."""
    times = np.arange(0.0, duration_s - 1e-9, 1.0 / rate_hz)
    jitter = min(tool.row_jitter_s, 0.1 / rate_hz)
    times[1:] += jitter * np.clip(rng.standard_normal(len(times) - 1), -3.0, 3.0)
    return times


def time_messages(rows_s: Array, clock: ColumnClock, rng: np.random.Generator) -> Array:
    """When what each row (k, s) shows of a column was measured (k, s); not before 0."""
    shown, hold_s = rows_s, clock.hold_s
    if hold_s > 0.0:
        count = int((rows_s[-1] + 2.0 * hold_s) / (hold_s * (1.0 - 0.5 * min(clock.hold_jitter, 1.0)))) + 8
        steps = hold_s * (1.0 + clock.hold_jitter * rng.uniform(-1.0, 1.0, count))
        sent = np.cumsum(steps) - steps[0] - rng.uniform(0.0, hold_s)
        shown = sent[np.maximum(np.searchsorted(sent, rows_s + 1e-9, side="right") - 1, 0)]
    return np.maximum(shown - clock.delay_s - clock.offset_s - clock.drift_s_per_min * shown / 60.0, 0.0)


def draw_wander(rng: np.random.Generator, at_s: Array, memory_s: float) -> Array:
    """Unit-variance noise with a memory at times from 0 on, by 40 knots in a memory."""
    step_s = memory_s / 40
    knots = np.arange(0.0, float(at_s[-1]) + memory_s, step_s)
    values: Array = np.interp(at_s, knots, draw_coloured(rng, len(knots), step_s, memory_s))
    return values


def freeze_times(at_s: Array, case: TruthCase, run: int, column: str) -> Array:
    """Times of messages of a column that repeats one value while its faults last, as a lost position may (mode 2)."""
    out = at_s.copy()
    for fault in case.faults:
        frozen = "position" if fault.detail.get("mode") == 2 else FROZEN.get(fault.id)
        if fault.run == run and frozen == column:
            out[is_within(fault, at_s)] = fault.from_s
    return out


def draw_position_errors(case: TruthCase, run: int, time_s: Array, tool: Instruments) -> Array:
    """How wrong the receiver is at even times (k, 2), m east and north: driver and log see the same.

    It wanders, and where its fix is lost it wanders more (mode 0) or jumps (mode 1).
    """
    rng, step_s = np.random.default_rng([case.seed, run, 51]), float(time_s[1] - time_s[0])
    errors = np.column_stack([draw_wander(rng, time_s, tool.wander_s) for _ in range(2)]) * tool.wander_m
    for number, fault in enumerate(case.faults):
        if fault.id != "position_lost" or fault.run != run:
            continue
        own, during = np.random.default_rng([case.seed, run, 35, number]), is_within(fault, time_s)
        mode, size = int(fault.detail.get("mode", 0)), fault.detail.get("size_m", 0.5)
        for axis in range(2):
            if mode == 0:
                errors[during, axis] += size * draw_coloured(own, len(time_s), step_s, LOST_MEMORY_S)[during]
            elif mode == 1:
                leaps = size * own.choice([-1.0, 1.0], 200) * own.uniform(0.7, 1.3, 200)
                errors[during, axis] += leaps[((time_s[during] - fault.from_s) / JUMP_S).astype(int)]
    return errors


def record_run(
    case: TruthCase, run: int, signals: Signals, places: Array, headings_deg: Array, rows_s: Array, tool: Instruments,
    rng: np.random.Generator,
) -> dict[str, Array]:  # fmt: skip
    """The measured columns of a run at its rows.

    `places` (k, 2) and `headings_deg` (k,) are what the receiver would say at every step without noise and delay.
    """
    time, clocks = signals.time_s, {name: case.columns.get(name, NO_CLOCK) for name in COLUMN_NAMES}
    late, at = signals.follow(case, "gnss_latency", run), {}
    for name, clock in clocks.items():
        at[name] = freeze_times(time_messages(rows_s, clock, rng), case, run, name)
        if name in ("position", "heading"):
            at[name] = np.maximum(at[name] - np.interp(at[name], time, late), 0.0)

    def read(name: str, true: Array, noise: float, digit: float, is_slack: bool = False) -> Array:
        clock = clocks[name]
        value = np.interp(
            at[name], time, clock.scale * low_pass(np.ascontiguousarray(true), signals.step_s, clock.filter_s)
        )
        _, message = np.unique(at[name], return_inverse=True)
        white = noise * rng.standard_normal(len(rows_s))[message]
        return round_to(value + (white * np.minimum(value / 0.2, 1.0) if is_slack else white), digit)

    wander = tool.heading_wander_deg * draw_wander(rng, time, tool.heading_wander_s)
    command = clocks["steering_command"].scale * low_pass(
        signals.command, signals.step_s, clocks["steering_command"].filter_s
    )
    return {
        "time_s": np.round(rows_s + signals.clock_s + DAY_STARTS_S, 3),
        "easting_m": read("position", places[:, 0], tool.position_m, 0.001),
        "northing_m": read("position", places[:, 1], tool.position_m, 0.001),
        "heading_deg": np.mod(read("heading", headings_deg + wander, tool.heading_deg, tool.heading_digit_deg), 360.0),
        "speed_mps": np.maximum(read("speed", np.abs(signals.speed), tool.speed_mps, tool.speed_digit_mps, True), 0.0),
        "steering_command_deg": np.round(pick_held(command, at["steering_command"], signals.step_s), 3),
        "steering_deg": read("steering", signals.wheel, tool.wheel_deg, tool.wheel_digit_deg),
    }
