"""What a set of logs says against a model: one long vector of surprises, each about 1 for a perfect model.

Three channels, cut at the sensors: the path given the measured wheel angle and speed (three surprises a row, see
surprise.whitening), the wheel angle given the command, the speed given the commanded speed. What a log lacks leaves
its channel out, and the block behind it is then driven by the commands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.effects import PATH, POSITION, SPEED, STEERING, effect_fields
from vehicle.measured.fit.heldout import half_of
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Course, Stretch
from vehicle.measured.replay.replaying import Rig, Settings, antenna_lever, replay, seen
from vehicle.measured.surprise.whitening import Increments, Noise, increments, innovations, make_gains

BLOCK_S = 10.0
TIMING_S = 0.02  # commands come at the beat of a controller, not of the log
TRANSIENT_S = 0.3  # how far off in time a speed change may be: drive lines differ
DRIVE_LINE_S = 0.2  # and how far one of another make is: what that leaves is not the fault of a cause
MOST_MEMORY = 0.9
OUTLIER = 4.0
Parts = dict[str, Array]


@dataclass(frozen=True, eq=False)
class Filter:
    """Gains and roots of one stretch."""

    gains: Array
    roots: Array
    lever: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Channel:
    """Weights of a directly compared channel of one stretch: standard deviation per row and memory from row to row.

    `scatter` is the part of the standard deviation that a true model would leave: how far the channel scatters in a run
    while nothing changes, and how far commands and drive lines are off in time.
    """

    sigma: Array
    memory: float
    scatter: Array


@dataclass(frozen=True, eq=False)
class Bench:
    """A course, a tractor, and what is known of the noise; makes vectors of surprises for settings."""

    course: Course
    rig: Rig
    noise: Noise
    filters: tuple[Filter, ...]
    wheel: tuple[Channel | None, ...]
    speed: tuple[Channel | None, ...]

    def path(self, settings: Settings) -> list[Increments]:
        """Simulated increments of the centre of mass per stretch, with latency applied."""
        return [self._increments(stretch, settings) for stretch in self.course.stretches]

    def _increments(self, stretch: Stretch, settings: Settings) -> Increments:
        states = replay(self.rig, stretch, settings, from_sensor=True, from_speed=True)
        return sampled(stretch, states, settings)

    def path_surprise(self, moves: list[Increments], settings: Settings) -> Array:
        """Whitened innovations of all stretches (3 rows each), flat."""
        fields = effect_fields(settings)
        lever = antenna_lever(self.rig, fields)
        found = []
        for stretch, filtered, move in zip(self.course.stretches, self.filters, moves, strict=True):
            out = np.empty((stretch.rows, 3))
            innovations(
                stretch.time, stretch.east, stretch.north, stretch.heading, move.ahead, move.aside, move.turned,
                *lever, fields["heading_bias"], filtered.gains, filtered.roots, out,
            )  # fmt: skip
            out[0] = 0.0  # the filter takes the first position as it is
            found.append(out.ravel())
        return huber(np.concatenate(found))

    def chain_surprise(self, settings: Settings) -> Parts:
        """Surprises of wheel angle and speed, driven by the commands."""
        if not any(self.wheel) and not any(self.speed):
            return {"wheel": np.zeros(self.course.rows), "speed": np.zeros(self.course.rows)}
        wheels, speeds = [], []
        for index, stretch in enumerate(self.course.stretches):
            states = replay(self.rig, stretch, settings, from_sensor=False, from_speed=False)
            _, _, wheel, speed = seen(self.rig, stretch, states, settings)
            wheels.append(_whitened(stretch.wheel, wheel, self.wheel[index], stretch.rows))
            speeds.append(_whitened(stretch.speed, speed, self.speed[index], stretch.rows))
        return {"wheel": np.concatenate(wheels), "speed": np.concatenate(speeds)}

    def surprise(self, settings: Settings) -> Array:
        """The whole vector: path, wheel, speed."""
        chain = self.chain_surprise(settings)
        return np.concatenate([self.path_surprise(self.path(settings), settings), chain["wheel"], chain["speed"]])

    def change(self, settings: Settings, base: Array, blocks: frozenset[str]) -> Array:
        """As surprise(settings), taking over from `base` the channels that effects of the blocks cannot reach."""
        rows = self.course.rows
        found = base.copy()
        path_moves = bool(blocks & {PATH, POSITION}) or (STEERING in blocks and not self.has_wheel)
        if path_moves:
            found[: 3 * rows] = self.path_surprise(self.path(settings), settings)
        if blocks & {STEERING, SPEED}:
            chain = self.chain_surprise(settings)
            found[3 * rows : 4 * rows], found[4 * rows :] = chain["wheel"], chain["speed"]
        return found

    @cached_property
    def has_wheel(self) -> bool:
        """Whether the wheel angle was measured."""
        return all(stretch.wheel is not None for stretch in self.course.stretches)

    @cached_property
    def row_s(self) -> float:
        """Median time from row to row (s)."""
        return float(np.median(np.concatenate([np.diff(stretch.time) for stretch in self.course.stretches])))

    @cached_property
    def runs(self) -> npt.NDArray[np.int64]:
        """Run of every entry of the vector."""
        rows = np.concatenate([np.full(one.rows, one.run) for one in self.course.stretches])
        return np.concatenate([np.repeat(rows, 3), rows, rows])

    @cached_property
    def blocks(self) -> npt.NDArray[np.int64]:
        """Block of about ten seconds of every entry, the same numbers in all channels."""
        numbers, count = [], 0
        for stretch in self.course.stretches:
            place = (stretch.time / BLOCK_S).astype(np.int64)
            place = np.minimum(place, max(int(stretch.time[-1] / BLOCK_S + 0.5) - 1, 0))
            numbers.append(count + place)
            count += int(place[-1]) + 1
        rows = np.concatenate(numbers)
        return np.concatenate([np.repeat(rows, 3), rows, rows])

    @cached_property
    def block_halves(self) -> npt.NDArray[np.int64]:
        """Half of every block: those of the even and of the odd windows of 20 s of a stretch."""
        out = np.zeros(int(self.blocks.max()) + 1, dtype=np.int64)
        first = 0
        for stretch in self.course.stretches:
            size = max(int(stretch.time[-1] / BLOCK_S + 0.5) - 1, 0) + 1
            out[first : first + size] = half_of(BLOCK_S * np.arange(size, dtype=np.float64))
            first += size
        return out

    @cached_property
    def block_runs(self) -> npt.NDArray[np.int64]:
        """Run of every block."""
        out = np.zeros(int(self.blocks.max()) + 1, dtype=np.int64)
        out[self.blocks] = self.runs
        return out


def sampled(stretch: Stretch, states: Array, settings: Settings) -> Increments:
    """Increments between rows of replayed states, seen as late as the settings say."""
    grid = stretch_grid(len(states))
    late = stretch.time - effect_fields(settings)["latency"] / 60.0
    return increments(*(np.interp(late, grid, states[:, column]) for column in range(3)))


def stretch_grid(steps: int) -> Array:
    """Times of the steps of a stretch."""
    return np.arange(steps) / 60.0


def _whitened(measured: Array | None, simulated: Array, channel: Channel | None, rows: int) -> Array:
    if measured is None or channel is None:
        return np.zeros(rows)
    off = (measured - simulated) / channel.sigma
    keep = channel.memory
    out: Array = np.concatenate([off[:1], (off[1:] - keep * off[:-1]) / np.sqrt(1.0 - keep * keep)])
    return huber(out)


def huber(values: Array) -> Array:
    """Values whose squares are the loss of Huber: beyond OUTLIER an error counts by its size, not by its square."""
    size = np.abs(values)
    far = np.sign(values) * np.sqrt(np.maximum(2.0 * OUTLIER * size - OUTLIER * OUTLIER, 0.0))
    out: Array = np.where(size > OUTLIER, far, values)
    return out


def prepare(course: Course, rig: Rig, settings: Settings, noise: Noise | None = None) -> Bench:
    """A bench whose weights fit what is left of the logs with the given settings."""
    bench = Bench(course, rig, noise or first_noise(course), (), (), ())
    bench = replace(bench, filters=_filters(bench, settings))
    wheel, speed = _channels(bench, settings)
    return replace(bench, wheel=wheel, speed=speed)


def first_noise(course: Course) -> Noise:
    """White noise of positions and headings; the soil as an ordinary field has it."""
    position, heading = [], []
    for one in course.stretches:
        position += [white_noise(one.time, one.east), white_noise(one.time, one.north)]
        if one.heading_seen:
            heading.append(white_noise(one.time, one.heading))
    p = max(float(np.median(position)), 2e-4)
    h = max(float(np.median(heading)), 2e-4) if heading else 1e3
    return Noise(p, 1.5 * p, h, min(1.0 * h, 0.1), 0.0025, 0.01)


def white_noise(time: Array, values: Array) -> float:
    """Standard deviation of white noise on a smooth signal (k,), robustly: what four rows are off a parabola.

    Third divided differences, which no parabola changes however uneven the times are.
    """
    t = np.lib.stride_tricks.sliding_window_view(time, 4)
    apart = t[:, :, None] - t[:, None, :] + np.eye(4)
    weights = 1.0 / apart.prod(axis=2)
    left = (weights * np.lib.stride_tricks.sliding_window_view(values, 4)).sum(axis=1)
    scaled = left / np.sqrt((weights * weights).sum(axis=1))
    return float(1.4826 * np.median(np.abs(scaled - np.median(scaled))))


def _filters(bench: Bench, settings: Settings) -> tuple[Filter, ...]:
    fields = effect_fields(settings)
    lever = antenna_lever(bench.rig, fields)
    found = []
    for stretch, move in zip(bench.course.stretches, bench.path(settings), strict=True):
        gains, roots = np.empty((stretch.rows, 7, 3)), np.empty((stretch.rows, 3, 3))
        make_gains(
            stretch.time, stretch.heading, move.ahead, move.aside, *lever,
            noise_row(bench.noise, stretch.heading_seen), gains, roots,
        )  # fmt: skip
        found.append(Filter(gains, roots, lever))
    return tuple(found)


def noise_row(noise: Noise, heading_seen: bool) -> Array:
    """Noise as the filter takes it; a heading that was not measured says nothing."""
    heading = noise.heading if heading_seen else 1e3
    return np.array([
        noise.position, noise.position_drift, heading, noise.heading_drift, noise.soil, noise.along
    ])  # fmt: skip


def _channels(bench: Bench, settings: Settings) -> tuple[tuple[Channel | None, ...], tuple[Channel | None, ...]]:
    """Weights of wheel and speed from what is left: spread while steady, timing while moving, memory of all runs."""
    wheel: list[tuple[Array, Array] | None] = []
    speed: list[tuple[Array, Array] | None] = []
    for stretch in bench.course.stretches:
        states = replay(bench.rig, stretch, settings, from_sensor=False, from_speed=False)
        _, _, angle, pace = seen(bench.rig, stretch, states, settings)
        both = stretch.wheel is not None and stretch.command is not None
        step = float(np.median(np.diff(stretch.time)))
        jitter = TIMING_S + step / np.sqrt(12.0)
        wheel.append((stretch.wheel - angle, jitter * _rate(stretch.time, angle)) if both else None)  # type: ignore[operator]
        speed.append(
            (stretch.speed - pace, TRANSIENT_S * _rate(stretch.time, pace)) if stretch.target is not None else None
        )
    return _weights(wheel, 5e-4, 1.0), _weights(speed, 0.005, DRIVE_LINE_S / TRANSIENT_S)


def _rate(time: Array, values: Array) -> Array:
    """Largest rate within half a second around each row."""
    rate = np.abs(np.gradient(values, time))
    width = max(1, round(0.5 / float(np.median(np.diff(time)))))
    padded = np.pad(rate, width, mode="edge")
    out: Array = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).max(axis=1)
    return out


def _weights(pairs: list[tuple[Array, Array] | None], least: float, share: float) -> tuple[Channel | None, ...]:
    """Weights of all stretches; `share` is how much of being off in time a true model would have as well."""
    known = [pair for pair in pairs if pair is not None]
    if not known:
        return tuple(None for _ in pairs)
    moving = float(np.median(np.concatenate([two for _, two in known])))
    steady = np.concatenate([_about_middle(off[rate <= moving]) for off, rate in known])
    low, high = np.quantile(steady, (0.16, 0.84))
    spread = max(0.5 * float(high - low), least)
    scaled = [one / np.hypot(spread, two) for one, two in known]
    before, after = np.concatenate([s[:-1] for s in scaled]), np.concatenate([s[1:] for s in scaled])
    clipped = [np.clip(part, -4.0, 4.0) for part in (before, after)]
    memory = float(clipped[0] @ clipped[1] / max(clipped[0] @ clipped[0], 1e-9))
    memory = min(max(memory, 0.0), MOST_MEMORY)
    fresh = huber((np.concatenate([s[1:] - memory * s[:-1] for s in scaled])) / np.sqrt(1.0 - memory * memory))
    size = max(float(np.sqrt(np.mean(fresh * fresh))), 0.3)
    wide = [None if pair is None else np.hypot(spread, pair[1]) for pair in pairs]
    scatters = [None if pair is None else np.hypot(spread, share * pair[1]) for pair in pairs]
    return tuple(
        None if one is None or plain is None else Channel(size * one, memory, plain)
        for one, plain in zip(wide, scatters, strict=True)
    )


def _about_middle(values: Array) -> Array:
    """Values about their own median: what differs from run to run is no noise."""
    return values - np.median(values) if len(values) else values
