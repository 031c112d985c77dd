"""What a simulation takes from segments: their inputs per step, one segment after the other, and when each column was
read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.records import DT_S


@dataclass(frozen=True, eq=False)
class Samples:
    """One measured column in cells, such as those of all windows (w, cells).

    `values` are means over the rows of a cell and 0 without one; `places` are the steps (of the column's axis) of the
    rows used, `cells` their cells, `segments` the segment of each row.
    """

    values: Floats
    observed: Flags
    places: Floats
    cells: Integers
    segments: Integers

    def average(self, rows: Floats) -> Floats:
        """Means (w, cells) of values per row (k,); 0 in cells without a row."""
        size = self.observed.size
        total = np.bincount(self.cells, rows, minlength=size).reshape(self.observed.shape)
        return np.asarray(total / np.maximum(self._counts, 1.0))

    @cached_property
    def _counts(self) -> Floats:
        counts = np.bincount(self.cells, minlength=self.observed.size)
        return counts.reshape(self.observed.shape).astype(np.float64)


def sample_rows(segments: Sequence[DriveSegment], starts: Integers, step_s: float) -> Samples:
    """Samples at every row (k,) of segments that begin at `starts` (s + 1,) of an axis, instead of means over cells."""
    rows = [segment.rows for segment in segments]
    numbers, count = np.repeat(np.arange(len(segments)), rows), sum(rows)
    places = starts[numbers] + np.concatenate([segment.time for segment in segments]) / step_s
    return Samples(np.zeros(count), np.ones(count, dtype=np.bool_), places, np.arange(count), numbers)


@dataclass(frozen=True, eq=False)
class DriveInputs:
    """Segments one after the other on two axes: steps of DT_S for steering and speed, `stride` times as long ones for
    the path.

    `step_starts` and `path_starts` (s + 1,) bound the segments on their axes; arrays on the step axis are (n,), those
    of `path` (m,). `east` to `speed` say at which steps each column was read: poses on the axis of the path, sensors on
    that of the steps.
    """

    segments: tuple[DriveSegment, ...]
    stride: int
    step_starts: Integers
    path_starts: Integers
    command: Floats
    first_wheel: Floats
    target: Floats
    working: Floats
    path: dict[str, Floats]
    east: Samples
    north: Samples
    heading: Samples
    wheel: Samples
    speed: Samples

    @cached_property
    def has_wheel(self) -> Flags:
        """Per segment, whether its wheel angle was measured."""
        return np.array([segment.wheel is not None for segment in self.segments])

    @property
    def path_step_s(self) -> float:
        """The step of the path (s)."""
        return self.stride * DT_S


def build_inputs(segments: Sequence[DriveSegment], stride: int = 1) -> DriveInputs:
    """Lay segments one after the other, every column read in every row."""
    steps = [stride * -(-len(segment.grids["speed"]) // stride) for segment in segments]
    step_starts = np.concatenate([[0], np.cumsum(steps)]).astype(np.int64)
    path_starts = step_starts // stride
    command, target, working = (
        _join([_get_input(segment, name) for segment in segments], steps) for name in ("command", "target", "working")
    )
    pose, sensor = (sample_rows(segments, path_starts, stride * DT_S), sample_rows(segments, step_starts, DT_S))
    # On the axis of the path: measured pose, speed, wheel angle (noisy and steady), slope, seconds.
    wheels = [_get_input(segment, "wheel") for segment in segments]
    pairs = list(zip(segments, wheels, strict=True))
    columns = {name: [one.grids[name] for one in segments] for name in ("east", "north", "heading", "speed", "working")}
    columns |= {
        "wheel": wheels,
        "steady": [one.denoised_wheel_angle if one.wheel is not None else wheel for one, wheel in pairs],
        "across": [one.grids.get("across", np.zeros(len(wheel))) for one, wheel in pairs],
        "seconds": [np.asarray(one.start_s + np.arange(len(wheel)) * DT_S) for one, wheel in pairs],
    }
    path = {name: _join(parts, steps, stride) for name, parts in columns.items()}
    path |= {"cosine": np.cos(path["heading"]), "sine": np.sin(path["heading"])}
    first_wheel = np.array([wheel[0] for wheel in wheels])
    return DriveInputs(
        tuple(segments), stride, step_starts, path_starts, command, first_wheel, target, working, path,
        pose, pose, pose, sensor, sensor,
    )  # fmt: skip


def _join(parts: Sequence[Floats], steps: Sequence[int], stride: int = 1) -> Floats:
    """Columns one after the other, each lengthened to so many steps by its last value, at every `stride`-th step."""
    whole = [
        values if len(values) == count else np.append(values, np.full(count - len(values), values[-1]))
        for values, count in zip(parts, steps, strict=True)
    ]
    # A single segment, such as a replay's of hours, is not copied.
    return np.ascontiguousarray((whole[0] if len(whole) == 1 else np.concatenate(whole))[::stride])


def _get_input(segment: DriveSegment, name: str) -> Floats:
    """An input on the grid of a segment; in place of one that was not logged, what shows the same."""
    other = {"command": "wheel", "wheel": "command", "target": "speed"}.get(name, name)
    return segment.grids[name if getattr(segment, name) is not None else other]
