"""What a set of logs says against a model: one long vector of surprises, each about 1 for a perfect model.

Three channels, cut at the sensors: the path given the measured wheel angle and speed (three surprises a row, see
surprise.whitening), the wheel angle given the command, the speed given the commanded speed. What a log lacks leaves
its channel out, and the block behind it is then driven by the commands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from vehicle.effects import PATH, POSITION, SPEED, STEERING, effect_fields
from vehicle.layout import DT_S
from vehicle.learnt import Settings
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.course import Course, Stretch
from vehicle.measured.replay.horizons import MOST_STEPS
from vehicle.measured.replay.replaying import Rig, antenna_lever, replay, wheel_angles
from vehicle.measured.replay.states import FORWARD
from vehicle.measured.replay.windows import half_of
from vehicle.measured.surprise.noise import first_noise
from vehicle.measured.surprise.weights import Channel, Filter, channels, filters, huber
from vehicle.measured.surprise.whitening import Increments, Noise, all_increments, increments_of_each, innovations

BLOCK_S = 10.0  # half a window: soil forgets within it, a slow cause does not
Parts = dict[str, Array]
Change = tuple[Settings, frozenset[str]]  # settings, and the blocks whose channels they change
Asked = TypeVar("Asked")


@dataclass(frozen=True, eq=False)
class Bench:
    """A course, a tractor, and what is known of the noise; makes vectors of surprises for settings.

    Per stretch a filter of the path and the weights of wheel angle and speed (None where the log lacks one).
    """

    course: Course
    rig: Rig
    noise: Noise
    filters: tuple[Filter, ...]
    wheel: tuple[Channel | None, ...]
    speed: tuple[Channel | None, ...]
    fixed: Settings = field(default_factory=dict)

    def on_top_of(self, settings: Settings) -> Bench:
        """The bench on which the effects asked for come on top of those of these settings."""
        return replace(self, fixed={**self.fixed, **settings})

    def _with_fixed(self, settings: Settings) -> Settings:
        return {**self.fixed, **settings}

    def path(self, settings: Settings) -> list[Increments]:
        """Simulated increments of the centre of mass per stretch, with latency applied."""
        return all_increments(self.rig, self.course.stretches, self._with_fixed(settings))

    def path_surprise(self, moves: list[Increments], settings: Settings) -> Array:
        """Whitened innovations of all stretches (3 rows each), flat."""
        fields = effect_fields(self._with_fixed(settings))
        lever = antenna_lever(self.rig, fields)
        whole, first = np.empty((self.course.rows, 3)), 0
        for stretch, filtered, move in zip(self.course.stretches, self.filters, moves, strict=True):
            out = whole[first : first + stretch.rows]
            innovations(
                filtered.kept, stretch.east, stretch.north, stretch.heading, move.ahead, move.aside, move.turned,
                *lever, fields["heading_bias"], filtered.gains, filtered.roots, out,
            )  # fmt: skip
            out[0] = 0.0  # the filter takes the first position as it is
            first += stretch.rows
        return huber(whole.ravel())

    def chain_surprise(self, settings: Settings) -> Parts:
        """Surprises of wheel angle and speed, driven by the commands."""
        return {"wheel": self.wheel_surprise(settings), "speed": self.speed_surprise(settings)}

    def wheel_surprise(self, settings: Settings) -> Array:
        """Surprises of the wheel angle that the commands come to."""
        settings = self._with_fixed(settings)
        return self._compared(self.wheel, "wheel", lambda stretch: wheel_angles(self.rig, stretch, settings))

    def speed_surprise(self, settings: Settings) -> Array:
        """Surprises of the speed that the commands come to."""
        settings = self._with_fixed(settings)

        def speeds(stretch: Stretch) -> Array:
            return np.asarray(replay(self.rig, stretch, settings, from_sensor=False, from_speed=False)[:, FORWARD])

        return self._compared(self.speed, "speed", speeds)

    def _compared(
        self, weights: tuple[Channel | None, ...], column: str, simulated: Callable[[Stretch], Array]
    ) -> Array:
        """Surprises of one column of all stretches, against what is simulated on the grid."""
        parts = []
        for stretch, channel in zip(self.course.stretches, weights, strict=True):
            measured = getattr(stretch, column)
            if measured is None or channel is None:
                parts.append(np.zeros(stretch.rows))
                continue
            on_grid = simulated(stretch)
            rows = np.interp(stretch.time, np.arange(len(on_grid), dtype=np.float64) * DT_S, on_grid)
            parts.append(_whitened(measured, rows, channel))
        return np.concatenate(parts)

    def surprise(self, settings: Settings) -> Array:
        """The whole vector: path, wheel, speed."""
        chain = self.chain_surprise(settings)
        return np.concatenate([self.path_surprise(self.path(settings), settings), chain["wheel"], chain["speed"]])

    def change(self, settings: Settings, base: Array, blocks: frozenset[str]) -> Array:
        """As surprise(settings), taking over from `base` the channels that effects of the blocks cannot reach."""
        return next(self.changes([(settings, blocks)], base))

    def changes(self, asked: Sequence[Change], base: Array) -> Iterator[Array]:
        """As change, of many settings with their blocks, one after another: they are driven side by side."""
        rows = self.course.rows
        moves = self._paths([settings for settings, blocks in asked if self._moves_path(blocks)])
        for settings, blocks in asked:
            changed = base.copy()
            if self._moves_path(blocks):
                changed[: 3 * rows] = self.path_surprise(next(moves), settings)
            if STEERING in blocks:
                changed[3 * rows : 4 * rows] = self.wheel_surprise(settings)
            if SPEED in blocks:
                changed[4 * rows :] = self.speed_surprise(settings)
            yield changed

    def _moves_path(self, blocks: frozenset[str]) -> bool:
        """Whether effects of the blocks reach the path."""
        return bool(blocks & {PATH, POSITION}) or (STEERING in blocks and not self.has_wheel)

    def _paths(self, each: Sequence[Settings]) -> Iterator[list[Increments]]:
        """The paths of many settings, as many driven at a time as there is room for."""
        for some in self.batches(each):
            fixed = [self._with_fixed(one) for one in some]
            yield from increments_of_each(self.rig, self.course.stretches, fixed)

    def batches(self, each: Sequence[Asked]) -> Iterator[Sequence[Asked]]:
        """What is asked for of the whole course, so many at a time as are driven side by side."""
        steps = sum(len(stretch.grids["speed"]) for stretch in self.course.stretches)
        some = max(MOST_STEPS // steps, 1)
        return (each[first : first + some] for first in range(0, len(each), some))

    @cached_property
    def has_wheel(self) -> bool:
        """Whether the wheel angle was measured."""
        return all(stretch.wheel is not None for stretch in self.course.stretches)

    @cached_property
    def has_speed(self) -> bool:
        """Whether the speed was measured."""
        return all(stretch.speed_seen for stretch in self.course.stretches)

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


def _whitened(measured: Array, simulated: Array, channel: Channel) -> Array:
    off = (measured - simulated) / channel.sigma
    keep = channel.memory
    out: Array = np.concatenate([off[:1], (off[1:] - keep * off[:-1]) / np.sqrt(1.0 - keep * keep)])
    return huber(out)


def prepare(course: Course, rig: Rig, settings: Settings, noise: Noise | None = None) -> Bench:
    """A bench whose weights fit what is left of the logs with the given settings."""
    noise = noise or first_noise(course)
    wheel, speed = channels(course, rig, settings)
    return Bench(course, rig, noise, filters(course, rig, noise, settings), wheel, speed)
