"""The noise floor: the open-loop error over horizons that a true model would still have in these logs.

Runs are replayed from their commands twice: with the causes of a fit alone, as a tractor file holds them, and with its
nuisances and noise as the fit found it, which is what instruments would have shown. The difference is the floor.

A fit calls noise whatever it has no cause for, so the floor takes of each slow part no more than ground, tyres and
instruments were ever seen to make; what is beyond that is unexplained.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from vehicle.identification.diagnosis.drive_data import (
    PATH_STEP_S,
    POSE_CELL_S,
    SENSOR_CELL_S,
    STRIDE,
    DriveData,
    build_drive_data,
    thin_evenly,
)
from vehicle.identification.diagnosis.grammar import Bases, Hypothesis, split_amounts, sum_fields
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.noise import COMMAND_JITTER, FREEDOM, POSE_PARTS, SENSOR_PARTS
from vehicle.identification.logs.schema import Array
from vehicle.identification.logs.series import turn_path
from vehicle.identification.logs.thresholds import DOUBT_SIGMAS, SEED
from vehicle.identification.replay.drive_inputs import sample_rows
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.identification.replay.horizon_errors import (
    ERROR_PIECE_S,
    Pieces,
    compute_relative_error,
    join_pieces,
    measure_pieces,
)
from vehicle.identification.replay.rig import ReplayRig
from vehicle.identification.replay.simulation import Simulator

MOST_PIECES = 400  # of 40 s: more of a long drive make no other floor
DRAWS = 4  # samples of the noise; with four the floor scatters half as much as the error of the logs
MOST_JITTERS = 2.0  # times COMMAND_JITTER that wheel angles may be off in time where rows are far apart
Rng = np.random.Generator
Model = Sequence[tuple[Hypothesis, Array]]
# Chosen: times the noise floor that counts as noise, and the addition per second between rows, where motion is not
# observed.
ABOVE_FLOOR_FACTOR, ABOVE_FLOOR_PER_ROW_S = 1.3, 1.0
LEAST_SHARE = 0.02  # chosen: smaller shares are printed as 0


@dataclass(frozen=True, eq=False)
class CommandedReplay:
    """What commands lead to: the antenna (k, 2, m) and heading (k,) at all rows, one segment after the other, and the
    wheel angle (rad) and speed (m/s) at the steps of the path (m,)."""

    antenna: Array
    heading: Array
    wheel: Array
    speed: Array


def compute_noise_floor(problem: Problem, fit: Fit, dataset: DriveDataset) -> Pieces:
    """The errors that noise and nuisances leave where the causes of a fit are true, of DRAWS draws.

    `dataset` may hold more runs than those of the problem; of a long one pieces are looked at. The noise is that which
    the problem has now.
    """
    data = problem.data if dataset is problem.data.dataset else build_drive_data(thin_evenly(dataset, MOST_PIECES))
    model = list(split_amounts(fit.model, fit.amounts))
    expected = replay_commands(data, problem.rig, [part for part in model if not part[0].is_nuisance])
    shown = replay_commands(data, problem.rig, model)
    spread = math.sqrt(FREEDOM / (FREEDOM - 2.0))  # a Student t distribution has a larger variance than its scale
    sizes = {channel: spread * own for channel, own in limit_noise(problem).items()}
    ends, rng = np.cumsum([segment.rows for segment in data.segments]), np.random.default_rng(SEED)
    drawn: list[Pieces] = []
    for number, segment in enumerate(data.segments):
        rows = slice(ends[number] - segment.rows, ends[number])
        motion = _MotionDraw(problem, segment, sizes, *(
            one[data.path_starts[number] : data.path_starts[number + 1]]
            for one in (shown.wheel, shown.speed, data.path["heading"])))  # fmt: skip
        for _ in range(DRAWS):
            noisy = motion.draw(shown.antenna[rows], shown.heading[rows], rng)
            drawn.append(measure_pieces(noisy, expected.antenna[rows], expected.heading[rows]))
    return join_pieces(drawn)


def limit_noise(problem: Problem) -> dict[str, Array]:
    """Standard deviations of the parts of the noise per channel, none above what is still noise."""
    parts = {"pose": POSE_PARTS, **SENSOR_PARTS}
    most = {channel: np.array([part.most for part in own]) for channel, own in parts.items()}
    most["wheel"][3:] = np.maximum(most["wheel"][3:], MOST_JITTERS * COMMAND_JITTER * problem.data.row_step_s)
    return {channel: np.minimum(np.exp(0.5 * one.amounts), most[channel]) for channel, one in problem.noise.items()}


def replay_commands(data: DriveData, rig: ReplayRig, model: Model) -> CommandedReplay:
    """Drive the commands of all segments open loop; where none were logged, as wheel and speed were measured."""
    causes = [one for one, _ in model]
    amounts = np.concatenate([np.zeros(0), *(own for _, own in model)])
    rows = sample_rows(data.segments, data.path_starts, PATH_STEP_S)
    simulator = Simulator(replace(data, east=rows, north=rows, heading=rows), rig)
    fields = sum_fields(causes, amounts, Bases(data), simulator.base)
    wheel, path = simulator.replay(fields)
    shown = simulator.show_pose(path, fields)
    antenna = np.stack([shown["east"], shown["north"]], axis=1)
    return CommandedReplay(antenna, shown["heading"], wheel[::STRIDE], path[3])


class _MotionDraw:
    """The motion of a segment at the steps of its path, and the noise that goes with it."""

    def __init__(
        self, problem: Problem, segment: DriveSegment, sizes: dict[str, Array], wheel: Array, speed: Array,
        heading: Array,
    ) -> None:  # fmt: skip
        tractor = problem.rig.tractor
        self.segment, self.sizes, self.wheel, self.speed, self.heading = segment, sizes, wheel, speed, heading
        self.places = segment.time / PATH_STEP_S
        self.turning = np.gradient(heading, PATH_STEP_S)
        self.row_step_s = problem.data.row_step_s
        self.curvature = np.tan(wheel) / tractor.wheelbase_m
        self.bend = 1.0 / (np.cos(wheel) ** 2 * tractor.wheelbase_m)
        self.ahead = tractor.antenna_forward_m

    def draw(self, antenna: Array, heading: Array, rng: Rng) -> DriveSegment:
        """The segment with positions and headings as they might have been measured."""
        east, north, jitter, turned = (self._sample(one) for one in self._draw_ground(rng))
        cosine, sine = np.cos(heading), np.sin(heading)
        places = turn_path(antenna, turned)
        places += jitter[:, None] * np.stack([cosine, sine], axis=1)
        places += self.ahead * turned[:, None] * np.stack([-sine, cosine], axis=1)
        position, direction = self._draw_receiver(rng)
        places += np.stack([east, north], axis=1) + position
        if self.segment.heading_measured:
            heading = heading + turned + direction
        return replace(self.segment, east=places[:, 0], north=places[:, 1], heading=heading)

    def _sample(self, steps: Array) -> Array:
        return np.interp(self.places, np.arange(len(steps)), steps)

    def _draw_ground(self, rng: Rng) -> tuple[Array, Array, Array, Array]:
        """How far the path goes to the east, to the north, and for a moment ahead (m), and how far it turns (rad)."""
        pose, count, forward = self.sizes["pose"], len(self.speed), self.speed

        def remember(number: int) -> Array:
            return draw_memory(rng, count, POSE_PARTS[number].memory_s)

        yaw = np.sum([pose[number] * remember(number) for number in (4, 5, 6)], axis=0)
        yaw = yaw + pose[7] * np.abs(self.turning) * remember(7)
        follow = self._draw_sensor(rng, "wheel", self.wheel)
        lag = self._draw_sensor(rng, "speed", forward)
        yaw += forward * self.bend * follow + self.curvature * lag
        push = lag + pose[8] * draw_cells(rng, count, POSE_CELL_S) + pose[9] * remember(9)
        crab = forward * pose[10] * remember(10)
        cosine, sine = np.cos(self.heading), np.sin(self.heading)
        east, north, turned = (
            np.cumsum(rate) * PATH_STEP_S for rate in (push * cosine - crab * sine, push * sine + crab * cosine, yaw)
        )
        return east, north, forward * pose[11] * draw_cells(rng, count, POSE_CELL_S), turned

    def _draw_sensor(self, rng: Rng, channel: str, values: Array) -> Array:
        """How a wheel angle (rad) or speed (m/s) follows its command otherwise than simulated."""
        segment, sizes, count = self.segment, self.sizes[channel], len(values)
        command, measured = (segment.command, segment.wheel is not None) if channel == "wheel" else (
            segment.target, segment.speed_measured)  # fmt: skip
        if command is None or not measured:
            return np.zeros(count)
        memories_s = [part.memory_s for part in SENSOR_PARTS[channel]]
        late_s = max(memories_s[4], self.row_step_s) if channel == "wheel" else memories_s[4]
        rate = np.gradient(values, PATH_STEP_S)
        slow = sum(sizes[number] * draw_memory(rng, count, memories_s[number]) for number in (1, 2))
        late = sizes[3] * draw_cells(rng, count, SENSOR_CELL_S) + sizes[4] * draw_memory(rng, count, late_s)
        return np.asarray(sizes[0] * draw_cells(rng, count, SENSOR_CELL_S) + slow + rate * late)

    def _draw_receiver(self, rng: Rng) -> tuple[Array, Array]:
        """Noise of positions (k, 2) and of headings (k,) at the rows; a cell holds the mean of several."""
        pose, rows, time = self.sizes["pose"], self.segment.rows, self.segment.time
        by_row = np.sqrt(max(POSE_CELL_S / self.row_step_s, 1.0))
        steps = np.sqrt(np.diff(time, prepend=time[0]))[:, None]
        walk = np.cumsum(steps * rng.standard_normal((rows, 2)), axis=0)
        position = by_row * pose[0] * rng.standard_normal((rows, 2)) + pose[2] * walk
        drift = self._sample(draw_memory(rng, len(self.speed), POSE_PARTS[3].memory_s))
        return position, by_row * pose[1] * rng.standard_normal(rows) + pose[3] * drift


def draw_memory(rng: Rng, count: int, time_constant: float) -> Array:
    """Unit noise (count,) at steps of the path that forgets with a time constant (s)."""
    memory = np.exp(-PATH_STEP_S / time_constant)
    white = np.sqrt(1.0 - memory * memory) * rng.standard_normal(count)
    values, _ = lfilter([1.0], [1.0, -memory], white, zi=[memory * rng.standard_normal()])
    return np.asarray(values)


def draw_cells(rng: Rng, count: int, cell_s: float) -> Array:
    """Unit noise (count,) at steps of the path, the same within a cell."""
    steps = round(cell_s / PATH_STEP_S)
    return np.repeat(rng.standard_normal(-(-count // steps)), steps)[:count]


@dataclass(frozen=True)
class Unexplained:
    """Share of the error over 5 s above the noise floor that remains, and the horizons (s) with an error above it."""

    share: float
    above_s: tuple[float, ...]


def measure_unexplained(
    dataset: DriveDataset, row_step_s: float, floor: Pieces, before: Pieces, after: Pieces
) -> Unexplained:
    """The error that a model leaves: `before` is that of the tractor file, `after` that of the model.

    Errors are in units of the floor, and count along the path where all speeds were measured. Those over a horizon are
    noise where they are no more than noise, and motion between rows, would leave by chance. The share is 0 while the
    error over 5 s is noise.
    """

    def compute_error(pieces: Pieces, horizon: float = ERROR_PIECE_S) -> float:
        return compute_relative_error(pieces, floor, len(dataset.names), dataset.has_speed, horizon)

    def compute_limit(horizon: float) -> float:
        factor = max(ABOVE_FLOOR_FACTOR, 1.0 + compute_chance(dataset.seconds, horizon))
        return (factor + ABOVE_FLOOR_PER_ROW_S * row_step_s) * compute_error(floor, horizon)

    above = tuple(
        horizon
        for horizon, rows in after.items()
        if len(rows) and not compute_error(after, horizon) < compute_limit(horizon)
    )
    if ERROR_PIECE_S not in above:
        return Unexplained(0.0, above)
    rest, whole = (compute_error(pieces) - compute_error(floor) for pieces in (after, before))
    share = rest / max(rest, whole)
    return Unexplained(share if share > LEAST_SHARE else 0.0, above)


def compute_chance(seconds: float, piece_s: float) -> float:
    """How far an error and its floor differ by chance for the pieces of this much driving, as a share.

    A mean of n squares has a variance of 2 / n, the floor is drawn DRAWS times, and a piece has three errors:
    across, along and heading.
    """
    pieces = max(seconds / piece_s, 1.0)
    return DOUBT_SIGMAS * math.sqrt(2.0 * (1.0 + 1.0 / DRAWS) / (3.0 * pieces))
