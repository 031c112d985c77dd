"""The second reference: another tractor, built another way, logged by other instruments. Imports nothing it tests.

It shares with the first reference (tests.truth.model) the programmes of commands, the table of effects and what a log
is, and nothing of how either comes about: see tests.truth.rolling for the tractor. Its receiver is another make: a
drift with half a minute of memory, headings from two antennas with an error that lasts for some rows, a speed that is
an average over the last 0.1 s, a clock that jitters. Two tractors of the thesis are at hand, by their measured radii.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from tests.truth import rolling
from tests.truth.drives import Drive
from tests.truth.effects import OUTSIDE, Effects, complete
from tests.truth.ground import EG105, Curve, Track
from tests.truth.laws import name_parameters
from tests.truth.recorder import build_log, find_antenna, read_switches
from tests.truth.signals import draw_coloured, pick_held, round_to

Array = npt.NDArray[np.float64]
STEP_S = 0.005
BEAT_S = 0.05  # of the controller that hands over commands; 0.1 s when it keeps to a line
GROUND_M, GROUND_MEMORY_M = 0.2, 0.8
TRACTORS = {
    "eg105": EG105,
    "mr1000a": Curve(0.6527535, 1.040, 0.7555497, 1.006),  # thesis, Eq. 5.1
}


@dataclass(frozen=True)
class Receiver:
    """Standard deviations, memories and last digits of the instruments."""

    position_m: float = 0.007
    wander_m: float = 0.012
    wander_s: float = 30.0
    heading_deg: float = 0.10
    heading_memory_deg: float = 0.10
    heading_memory_s: float = 0.4
    speed_mps: float = 0.015
    speed_average_s: float = 0.1
    wheel_deg: float = 0.05
    wheel_digit_deg: float = 0.05
    clock_s: float = 0.003


@dataclass(frozen=True)
class Second:
    """One of TRACTORS with hidden `effects`, on ground of a roughness (rad per m), logged at `rate_hz`.

    `seed` fixes every draw. Raises ValueError for an effect that the table does not have, or that this reference
    cannot hide: those outside the catalogue.
    """

    effects: Effects = field(default_factory=dict)
    seed: int = 0
    tractor: str = "eg105"
    rate_hz: float = 10.0
    roughness: float = 0.002
    receiver: Receiver = field(default_factory=Receiver)

    def __post_init__(self) -> None:
        outside = sorted(set(self.effects) & set(OUTSIDE))
        if outside:
            raise ValueError(f"The second reference cannot hide {outside[0]}; use tests.truth.model.")

    def roll(self, drive: Drive, index: int = 0) -> Track:
        """The drive without instruments; `index` numbers the runs of a programme, each with draws of its own."""
        rng = np.random.default_rng([self.seed, index, 11])
        bearing = math.radians(rng.uniform(0.0, 360.0) if drive.bearing_deg is None else drive.bearing_deg)
        shift = rng.uniform(-8.0, 8.0, 2)
        plain = replace(self, effects={}, roughness=0.0)._rolled(drive, (0.0, 0.0, bearing), rng)
        return self._rolled(drive, plain.find_start(shift, bearing), rng)

    def log(self, drive: Drive, index: int = 0) -> pd.DataFrame:
        """The drive as a log in the columns of the contract, the name of the drive in `attrs`."""
        rolled, rng = self.roll(drive, index), np.random.default_rng([self.seed, index, 12])
        times = np.arange(0.0, drive.duration_s - 1e-9, 1.0 / self.rate_hz)
        times[1:] += self.receiver.clock_s * np.clip(rng.standard_normal(len(times) - 1), -3.0, 3.0)
        columns = self._seen(rolled, times, rng) | read_switches(drive, times)
        return build_log(drive.name, columns | {"time_s": np.round(times + 100.0, 3)})

    def _rolled(self, drive: Drive, start: tuple[float, float, float], rng: np.random.Generator) -> Track:
        values = complete(self.effects)
        time = np.arange(0.0, drive.duration_s + 0.5 * STEP_S, STEP_S)
        signal, state = drive.steering(time), np.zeros(rolling.STATES)
        state[rolling.EAST], state[rolling.NORTH], state[rolling.HEADING] = start
        state[rolling.WHEEL] = 0.0 if drive.closed_loop else signal[0]
        way = float(np.sum(np.abs(drive.speed(time)))) * STEP_S
        ground = self.roughness * draw_coloured(rng, int(way / GROUND_M) + 20, GROUND_M, GROUND_MEMORY_M)
        seen = self.receiver.position_m * rng.standard_normal(len(time))
        targets = drive.speed(time) * drive.shuttle(time)
        late = round(values["gnss_latency"]["time_s"] / STEP_S)
        guide = rolling.Guide(drive.closed_loop, *start, late, *find_antenna(values))
        states, held = rolling.roll_out(
            state, STEP_S, signal, targets, drive.implement(time), seen,
            beats(drive, len(time)), round(values["steering_dead_time"]["time_s"] / STEP_S), ground, GROUND_M,
            TRACTORS[self.tractor], faults(values), guide,
        )  # fmt: skip
        left = (1.0 - values["wheel_slip"]["ratio"]) * (1.0 - values["implement_slip"]["ratio"] * drive.implement(time))
        return Track(time, states, held, states[:, rolling.SPEED] * left)

    def _seen(self, rolled: Track, times: Array, rng: np.random.Generator) -> dict[str, Array]:
        values, tool, count = complete(self.effects), self.receiver, len(times)
        old, columns = times - values["gnss_latency"]["time_s"], {}
        step = 1.0 / self.rate_hz
        for name, axis in zip(("easting_m", "northing_m"), rolled.find_point(*find_antenna(values)), strict=True):
            wander = tool.wander_m * draw_coloured(rng, count, step, tool.wander_s)
            white = tool.position_m * rng.standard_normal(count)
            columns[name] = np.round(np.interp(old, rolled.time_s, axis) + wander + white, 3)
        heading = np.degrees(np.interp(old, rolled.time_s, rolled.column(rolling.HEADING)))
        heading += tool.heading_memory_deg * draw_coloured(rng, count, step, tool.heading_memory_s)
        heading += tool.heading_deg * rng.standard_normal(count) + values["heading_bias"]["angle_deg"]
        columns["heading_deg"] = np.mod(heading, 360.0)
        columns["speed_mps"] = self._speed(rolled, times, rng)
        columns["steering_command_deg"] = np.round(pick_held(rolled.held_deg, times, STEP_S), 3)
        wheel = np.interp(times, rolled.time_s, rolled.column(rolling.WHEEL)) + tool.wheel_deg * rng.standard_normal(
            count
        )
        columns["steering_deg"] = round_to(wheel, tool.wheel_digit_deg)
        return columns

    def _speed(self, rolled: Track, times: Array, rng: np.random.Generator) -> Array:
        """Speed over ground, averaged over the last moment; a standing tractor shows none."""
        tool = self.receiver
        way = np.concatenate([[0.0], np.cumsum(np.abs(rolled.speed_mps[:-1])) * STEP_S])
        span = max(tool.speed_average_s, STEP_S)
        speed = (np.interp(times, rolled.time_s, way) - np.interp(times - span, rolled.time_s, way)) / span
        noise = tool.speed_mps * rng.standard_normal(len(times)) * np.minimum(speed / 0.2, 1.0)
        return np.maximum(np.round(speed + noise, 3), 0.0)


def beats(drive: Drive, steps: int) -> npt.NDArray[np.bool_]:
    """The steps at which a controller hands over a command."""
    return np.arange(steps) % round((2.0 if drive.closed_loop else 1.0) * BEAT_S / STEP_S) == 0


def faults(values: dict[str, dict[str, float]]) -> rolling.Faults:
    """The effects as the rolling tractor wants them."""
    known = name_parameters(values)
    ratio, downhill, play = known.pop("slope"), known.pop("slope_to"), known.pop("play")
    del known["dead_time"]
    return rolling.Faults(half_play=0.5 * play, slope_east=ratio * math.sin(downhill),
                          slope_north=ratio * math.cos(downhill), **known)  # fmt: skip


def second_logs(
    effects: Effects, seed: int, programme: Sequence[Drive], tractor: str = "eg105", **conditions: object
) -> list[pd.DataFrame]:
    """Logs of a programme by one of TRACTORS with hidden effects; `conditions` are further fields of Second."""
    second = Second(effects, seed, tractor, **conditions)  # type: ignore[arg-type]
    return [second.log(drive, index) for index, drive in enumerate(programme)]
