"""Residuals of a set of logs against a model: one long vector, each entry about 1 for a perfect model.

Three channels, cut at the sensors: the path given measured wheel angle and speed (three residuals a row, see
innovations), the wheel angle given the command, the speed given the commanded speed. A missing column drops its
channel, and the block behind it is then driven by the commands.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment, compute_half_numbers
from vehicle.identification.replay.horizon_errors import MOST_STEPS_AT_ONCE
from vehicle.identification.replay.instrument_timing import (
    compute_timing,
    simulate_logged_speeds,
    simulate_logged_wheel_angles,
)
from vehicle.identification.replay.rig import (
    ReplayRig,
    compute_antenna_lever,
    replay_segments,
    simulate_wheel_angles,
)
from vehicle.identification.replay.state_cache import FORWARD_COLUMN
from vehicle.identification.residuals.innovations import (
    NoiseLevels,
    PoseIncrements,
    compute_innovations,
    compute_reference_headings,
    simulate_all_increments,
    simulate_increments_of_each,
)
from vehicle.identification.residuals.noise_weights import (
    PathFilter,
    ResidualChannel,
    apply_huber,
    build_channels,
    build_filters,
    estimate_first_noise,
    measure_reading_interval,
)
from vehicle.model.effects import PATH, POSITION, SPEED, STEERING, compute_effect_fields, get_effect
from vehicle.model.tractor import Settings

RECEIVER_DELAY = "gnss_latency"
RESIDUAL_BLOCK_S = 10.0  # half a window: soil noise decays within it, a slow cause does not
ChannelResiduals = dict[str, Array]
SettingsChange = tuple[Settings, frozenset[str]]  # settings, and the blocks whose channels they change
SimulateColumn = Callable[[Sequence[DriveSegment]], list[Array]]
Item = TypeVar("Item")


@dataclass(frozen=True, eq=False)
class ResidualModel:
    """A dataset, a tractor, and estimates of the noise; computes residuals for settings.

    Per segment a filter of the path and the weights of wheel angle and speed (None where the log lacks one).
    """

    dataset: DriveDataset
    rig: ReplayRig
    noise: NoiseLevels
    filters: tuple[PathFilter, ...]
    wheel: tuple[ResidualChannel | None, ...]
    speed: tuple[ResidualChannel | None, ...]
    fixed: Settings = field(default_factory=dict)

    def copy_with_fixed_effects(self, settings: Settings) -> ResidualModel:
        """Return the residual model on which further effects add to these settings."""
        return replace(self, fixed={**self.fixed, **settings})

    def _add_fixed(self, settings: Settings) -> Settings:
        return {**self.fixed, **settings}

    def simulate_increments(self, settings: Settings) -> list[PoseIncrements]:
        """Simulate the increments of the centre of mass per segment, with latency applied."""
        return simulate_all_increments(self.rig, self.dataset.segments, self._add_fixed(settings))

    def compute_path_residuals(self, moves: list[PoseIncrements], settings: Settings) -> Array:
        """Return the whitened innovations of all segments (3 rows each), flat."""
        fields = compute_effect_fields(self._add_fixed(settings))
        lever = compute_antenna_lever(self.rig, fields)
        residuals, first = np.empty((self.dataset.rows, 3)), 0
        references = compute_reference_headings(self.rig, self.dataset.segments, self._add_fixed(settings))
        for segment, path_filter, move, reference in zip(
            self.dataset.segments, self.filters, moves, references, strict=True
        ):
            out = residuals[first : first + segment.rows]
            compute_innovations(
                path_filter.memory_shares,
                segment.east,
                segment.north,
                reference,
                move.ahead,
                move.aside,
                move.turned,
                *lever,
                fields["heading_bias"],
                path_filter.gains,
                path_filter.roots,
                out,
            )
            out[0] = 0.0  # the filter starts at the first position
            first += segment.rows
        return apply_huber(residuals.ravel())

    def compute_wheel_and_speed_residuals(self, settings: Settings) -> ChannelResiduals:
        """Return residuals of wheel angle and speed, driven by the commands."""
        return {"wheel": self.compute_wheel_residuals(settings), "speed": self.compute_speed_residuals(settings)}

    def compute_wheel_residuals(self, settings: Settings) -> Array:
        """Return residuals of the wheel angle given the commands."""
        settings = self._add_fixed(settings)
        timing = compute_timing(settings)

        def simulate(segments: Sequence[DriveSegment]) -> list[Array]:
            angles = simulate_wheel_angles(self.rig, segments, settings)
            return [
                simulate_logged_wheel_angles(segment, shown, timing)
                for segment, shown in zip(segments, angles, strict=True)
            ]

        return self._compute_channel_residuals(self.wheel, "wheel", simulate)

    def compute_speed_residuals(self, settings: Settings) -> Array:
        """Return residuals of the speed given the commands."""
        settings = self._add_fixed(settings)
        timing = compute_timing(settings)

        def simulate(segments: Sequence[DriveSegment]) -> list[Array]:
            pairs = [(segment, settings) for segment in segments]
            states = replay_segments(self.rig, pairs, from_sensor=False, from_speed=False)
            return [
                simulate_logged_speeds(segment, one[:, FORWARD_COLUMN], timing)
                for segment, one in zip(segments, states, strict=True)
            ]

        return self._compute_channel_residuals(self.speed, "speed", simulate)

    def _compute_channel_residuals(
        self, weights: tuple[ResidualChannel | None, ...], column: str, simulate: SimulateColumn
    ) -> Array:
        """Return residuals of one column of all segments, against what the simulation would log (k,); 0 where it was
        not measured."""
        channels = list(zip(self.dataset.segments, weights, strict=True))
        weighed = [
            (segment, channel) for segment, channel in channels if getattr(segment, column) is not None and channel
        ]
        simulated = iter(simulate([segment for segment, _ in weighed]))
        parts = []
        for segment, channel in channels:
            measured = getattr(segment, column)
            if measured is None or channel is None:
                parts.append(np.zeros(segment.rows))
                continue
            parts.append(_whiten(measured, next(simulated), channel))
        return np.concatenate(parts)

    def compute_residuals(self, settings: Settings) -> Array:
        """Return all residuals: path, wheel, speed."""
        chain = self.compute_wheel_and_speed_residuals(settings)
        return np.concatenate(
            [self.compute_path_residuals(self.simulate_increments(settings), settings), chain["wheel"], chain["speed"]]
        )

    def compute_change(self, settings: Settings, base: Array, blocks: frozenset[str]) -> Array:
        """As compute_residuals, but channels that effects of these blocks cannot reach are taken from `base`."""
        return next(self.compute_changes([(settings, blocks)], base))

    def compute_changes(self, changes: Sequence[SettingsChange], base: Array) -> Iterator[Array]:
        """As compute_change, for many settings with their blocks, in order: they are driven side by side."""
        rows = self.dataset.rows
        moves = self._simulate_paths([settings for settings, blocks in changes if self._can_move_path(blocks)])
        for settings, blocks in changes:
            changed = base.copy()
            if self._can_move_path(blocks):
                changed[: 3 * rows] = self.compute_path_residuals(next(moves), settings)
            if STEERING in blocks:
                changed[3 * rows : 4 * rows] = self.compute_wheel_residuals(settings)
            if SPEED in blocks:
                changed[4 * rows :] = self.compute_speed_residuals(settings)
            yield changed

    def _can_move_path(self, blocks: frozenset[str]) -> bool:
        """Whether effects of the blocks reach the path."""
        return bool(blocks & {PATH, POSITION}) or (STEERING in blocks and not self.has_measured_wheel_angle)

    def _simulate_paths(self, settings_list: Sequence[Settings]) -> Iterator[list[PoseIncrements]]:
        """Return the paths of many settings, driven in batches that fit in memory."""
        for batch in self.split_batches(settings_list):
            fixed = [self._add_fixed(settings) for settings in batch]
            yield from simulate_increments_of_each(self.rig, self.dataset.segments, fixed)

    def split_batches(self, items: Sequence[Item]) -> Iterator[Sequence[Item]]:
        """Split requests into batches that are driven side by side."""
        steps = sum(len(segment.grids["speed"]) for segment in self.dataset.segments)
        batch_size = max(MOST_STEPS_AT_ONCE // steps, 1)
        return (items[first : first + batch_size] for first in range(0, len(items), batch_size))

    @cached_property
    def has_measured_wheel_angle(self) -> bool:
        """Whether the wheel angle was measured."""
        return all(segment.wheel is not None for segment in self.dataset.segments)

    @cached_property
    def has_measured_speed(self) -> bool:
        """Whether the speed was measured."""
        return all(segment.speed_measured for segment in self.dataset.segments)

    @cached_property
    def row_interval_s(self) -> float:
        """Median time between rows (s)."""
        return float(np.median(np.concatenate([np.diff(segment.time) for segment in self.dataset.segments])))

    @cached_property
    def command_interval_s(self) -> float:
        """Median time between two rows with a measured steering command (s), of a slow one while it changes."""
        return self._measure_interval("command")

    @cached_property
    def wheel_interval_s(self) -> float:
        """Median time between two rows with a measured wheel angle (s), of a slow one while it changes."""
        return self._measure_interval("angle")

    def _measure_interval(self, column: str) -> float:
        if not any(column in segment.measured_rows for segment in self.dataset.segments):
            return self.row_interval_s
        return float(np.median([measure_reading_interval(segment, column) for segment in self.dataset.segments]))

    def get_interval_s(self, name: str) -> float:
        """Return the time (s) within which logs cannot tell when an effect acts: between rows, or between readings.

        A receiver is late beside the turns that wheel angles say.
        """
        if name == RECEIVER_DELAY:
            return self.wheel_interval_s
        return self.command_interval_s if get_effect(name).block == STEERING else self.row_interval_s

    @cached_property
    def residual_runs(self) -> npt.NDArray[np.int64]:
        """Run of every residual."""
        rows = np.concatenate([np.full(segment.rows, segment.run) for segment in self.dataset.segments])
        return np.concatenate([np.repeat(rows, 3), rows, rows])

    @cached_property
    def residual_blocks(self) -> npt.NDArray[np.int64]:
        """Block of about ten seconds of every residual, with the same numbers in all channels."""
        numbers, count = [], 0
        for segment in self.dataset.segments:
            place = (segment.time / RESIDUAL_BLOCK_S).astype(np.int64)
            place = np.minimum(place, max(int(segment.time[-1] / RESIDUAL_BLOCK_S + 0.5) - 1, 0))
            numbers.append(count + place)
            count += int(place[-1]) + 1
        rows = np.concatenate(numbers)
        return np.concatenate([np.repeat(rows, 3), rows, rows])

    @cached_property
    def block_halves(self) -> npt.NDArray[np.int64]:
        """Half of every block: even or odd windows of 20 s of a segment."""
        out = np.zeros(int(self.residual_blocks.max()) + 1, dtype=np.int64)
        first = 0
        for segment in self.dataset.segments:
            size = max(int(segment.time[-1] / RESIDUAL_BLOCK_S + 0.5) - 1, 0) + 1
            out[first : first + size] = compute_half_numbers(RESIDUAL_BLOCK_S * np.arange(size, dtype=np.float64))
            first += size
        return out

    @cached_property
    def block_runs(self) -> npt.NDArray[np.int64]:
        """Run of every block."""
        out = np.zeros(int(self.residual_blocks.max()) + 1, dtype=np.int64)
        out[self.residual_blocks] = self.residual_runs
        return out


def _whiten(measured: Array, simulated: Array, channel: ResidualChannel) -> Array:
    """Return whitened residuals (k,), 0 in rows that were not measured."""
    scaled_error = (measured - simulated) / channel.sigma
    if channel.measured is None:
        return _whiten_errors(scaled_error, channel.memory)
    out = np.zeros(len(measured))
    out[channel.measured] = _whiten_errors(scaled_error[channel.measured], channel.memory)
    return out


def _whiten_errors(scaled_error: Array, keep: float) -> Array:
    out: Array = np.concatenate(
        [scaled_error[:1], (scaled_error[1:] - keep * scaled_error[:-1]) / np.sqrt(1.0 - keep * keep)]
    )
    return apply_huber(out)


def build_residual_model(
    dataset: DriveDataset, rig: ReplayRig, settings: Settings, noise: NoiseLevels | None = None
) -> ResidualModel:
    """Build a residual model whose weights fit the residuals of the given settings."""
    noise = noise or estimate_first_noise(dataset)
    wheel, speed = build_channels(dataset, rig, settings)
    return ResidualModel(dataset, rig, noise, build_filters(dataset, rig, noise, settings), wheel, speed)
