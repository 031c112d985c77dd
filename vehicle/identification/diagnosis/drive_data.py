"""The logs as the likelihood sees them: inputs per step of the simulation, and samples in windows of ten seconds.

Inputs (commands, wheel angles, speeds) are on two axes of all segments one after the other: STEP_S for steering and
speed, PATH_STEP_S for the path. What was measured is averaged over short cells of a window; a cell without a sample is
left out of the likelihood, so columns may be slow or missing. Of long logs those parts are used in which steering,
speed and implement change most, from every run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fields.arrays import Floats, Integers
from vehicle.identification.errors import LogError
from vehicle.identification.logs.thresholds import GRID_S, STANDSTILL_MPS, WINDOW_S
from vehicle.identification.replay.drive_inputs import DriveInputs, Samples, build_inputs
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.records import DT_S, HISTORY_STEPS

SENSOR_CELL_S = 2.0 * GRID_S  # cells of a window; shorter ones cost time and tell nothing more at 10 Hz
POSE_CELL_S = 2.0 * SENSOR_CELL_S
STRIDE = 2  # steps of the grid in a step of the path: 1/30 s, which turns 0.1 % otherwise than 1/60 s
STEP_S, PATH_STEP_S = DT_S, STRIDE * DT_S
POSE_CELLS, SENSOR_CELLS = round(WINDOW_S / POSE_CELL_S), round(WINDOW_S / SENSOR_CELL_S)
FEWEST_WINDOWS = 3
LEAST_CELL_SHARE = 0.2  # of the cells of a window that hold a position
CRAWL_MPS = 2.0 * STANDSTILL_MPS  # windows driven more slowly on average say nothing
PIECE_S = 4.0 * WINDOW_S  # long enough for what lasts, such as a lag of the speed
# 27 minutes: a model of a dozen amounts needs some ten of such driving, and half as many leave the verdicts of the
# sample sets as they are. Errors before and after are those of all driving.
MOST_PIECES = 40
SCALES = {"wheel": math.radians(5.0), "speed": 0.5, "working": 0.5}  # usual changes in a piece with a bend or a start


@dataclass(frozen=True, eq=False)
class DriveData(DriveInputs):
    """All segments that hold a window: runs (w,) by index, and starts (w,) in steps of the path."""

    dataset: DriveDataset
    window_runs: Integers
    window_starts: Integers
    window_segments: Integers

    @property
    def windows(self) -> int:
        """Number of windows."""
        return len(self.window_runs)

    @property
    def runs(self) -> int:
        """Number of runs, with those that hold no window."""
        return len(self.dataset.names)

    @cached_property
    def path_runs(self) -> Integers:
        """The run of every step of the path (m,)."""
        return np.repeat([segment.run for segment in self.segments], np.diff(self.path_starts))

    @cached_property
    def row_step_s(self) -> float:
        """The median time between rows (s)."""
        return float(np.median(np.concatenate([np.diff(segment.time) for segment in self.segments])))

    def cut(self, values: Floats, cells: int) -> Floats:
        """Means (w, cells) of values per step of the path over all cells of the windows."""
        steps = round(WINDOW_S / PATH_STEP_S)
        last = self.path_starts[1:][self.window_segments] - 1
        places = np.minimum(self.window_starts[:, None] + np.arange(steps), last[:, None])
        return np.asarray(values[places].reshape(len(places), cells, -1).mean(axis=2))


def build_drive_data(dataset: DriveDataset) -> DriveData:
    """Lay segments out in windows; raises LogError where fewer than FEWEST_WINDOWS hold enough driving."""
    starts_of = [(segment, starts) for segment in dataset.segments if (starts := _list_windows(segment))]
    kept = [segment for segment, _ in starts_of]
    windows = [(number, start) for number, (_, starts) in enumerate(starts_of) for start in starts]
    if len(windows) < FEWEST_WINDOWS:
        raise LogError(
            f"These logs hold {len(windows)} pieces of {WINDOW_S:g} s in which the tractor drives and its position is "
            f"known; a diagnosis needs {FEWEST_WINDOWS}: give longer runs."
        )
    inputs = build_inputs(kept, STRIDE)
    window_segments = np.array([number for number, _ in windows], dtype=np.int64)
    starts = inputs.path_starts[window_segments] + np.array([round(start / PATH_STEP_S) for _, start in windows])
    runs = np.array([kept[number].run for number in window_segments], dtype=np.int64)
    # East, north, heading, wheel angle and speed as measured, in cells of the windows.
    samples = {}
    for name, count in (("east", POSE_CELLS), ("north", POSE_CELLS), ("heading", POSE_CELLS),
                        ("wheel", SENSOR_CELLS), ("speed", SENSOR_CELLS)):  # fmt: skip
        is_pose = count == POSE_CELLS
        begins, step_s = (inputs.path_starts, PATH_STEP_S) if is_pose else (inputs.step_starts, STEP_S)
        parts = [(np.empty(0), np.empty(0), np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))]
        for window, (number, start_s) in enumerate(windows):
            segment = kept[number]
            is_absent = {  # or cannot be compared
                "heading": not segment.heading_measured,
                "wheel": segment.wheel is None or segment.command is None,
                "speed": not segment.speed_measured or segment.target is None,
            }
            if is_absent.get(name):
                continue
            measured = True if is_pose else segment.measured_rows.get(name, True)
            rows = np.flatnonzero((segment.time >= start_s) & (segment.time < start_s + WINDOW_S) & measured)
            cell = ((segment.time[rows] - start_s) / (WINDOW_S / count)).astype(np.int64)
            places = begins[number] + segment.time[rows] / step_s
            parts.append((getattr(segment, name)[rows], places, window * count + np.minimum(cell, count - 1),
                          np.full(len(rows), number)))  # fmt: skip
        values, places, cells, numbers = (np.concatenate(part) for part in zip(*parts, strict=True))
        shape, size = (len(windows), count), len(windows) * count
        counts = np.bincount(cells, minlength=size)
        means = np.bincount(cells, values, minlength=size) / np.maximum(counts, 1)
        samples[name] = Samples(means.reshape(shape), (counts > 0).reshape(shape), places, cells, numbers)
    return DriveData(**vars(inputs) | samples, dataset=dataset, window_runs=runs, window_starts=starts,
                     window_segments=window_segments)  # fmt: skip


def _list_windows(segment: DriveSegment) -> list[float]:
    """Starts (s) of the windows of a segment that hold driving; the last may be half empty."""
    count = int((segment.time[-1] + 0.5 * WINDOW_S) / WINDOW_S)
    starts = []
    for start in WINDOW_S * np.arange(count):
        rows = (segment.time >= start) & (segment.time < start + WINDOW_S)
        cells = len(np.unique(segment.time[rows] // POSE_CELL_S))
        if rows.any() and cells >= LEAST_CELL_SHARE * POSE_CELLS:
            starts += [float(start)] if float(np.abs(segment.speed[rows]).mean()) > CRAWL_MPS else []
    return starts


def choose_informative_parts(dataset: DriveDataset) -> DriveDataset:
    """The dataset with at most MOST_PIECES pieces of PIECE_S, those that say most, in turn from every run."""
    pieces = _list_pieces(dataset)
    if len(pieces) <= MOST_PIECES:
        return dataset
    by_run: dict[int, list[tuple[float, int]]] = {}
    for place, (number, start) in enumerate(pieces):
        segment = dataset.segments[number]
        steps = _get_steps(segment, start)
        grids = segment.grids if "wheel" in segment.grids else {**segment.grids, "wheel": segment.grids["command"]}
        # How much changes, in usual changes; nothing where the tractor stands.
        changes = (math.tanh(float(np.std(grids[name][steps])) / scale) for name, scale in SCALES.items())
        is_driven = float(np.abs(grids["speed"][steps]).mean()) >= STANDSTILL_MPS
        by_run.setdefault(segment.run, []).append((-sum(changes, 0.0) if is_driven else -0.0, place))
    # The best piece of every run, then the second of every run, and so on.
    turns = sorted((rank, *one) for own in by_run.values() for rank, one in enumerate(sorted(own)))
    return _keep_pieces(dataset, [pieces[place] for place in sorted(place for *_, place in turns[:MOST_PIECES])])


def thin_evenly(dataset: DriveDataset, most_pieces: int) -> DriveDataset:
    """A long dataset with about `most_pieces` pieces of PIECE_S, evenly chosen, at least one of every run."""
    pieces = _list_pieces(dataset)
    if len(pieces) <= most_pieces:
        return dataset
    runs = [dataset.segments[number].run for number, _ in pieces]
    chosen = {*range(0, len(pieces), math.ceil(len(pieces) / most_pieces)), *(runs.index(run) for run in set(runs))}
    return _keep_pieces(dataset, [pieces[one] for one in sorted(chosen)])


def _list_pieces(dataset: DriveDataset) -> list[tuple[int, float]]:
    """The segment of every piece, and its start (s)."""
    counts = [max(int(segment.time[-1] / PIECE_S), 1) for segment in dataset.segments]
    return [(number, PIECE_S * piece) for number, count in enumerate(counts) for piece in range(count)]


def _keep_pieces(dataset: DriveDataset, pieces: Sequence[tuple[int, float]]) -> DriveDataset:
    """The dataset with pieces of segments as segments of their own, with the commands before them."""
    columns, segments = ("east", "north", "heading", "speed", "wheel", "command", "target", "working"), []
    for number, start_s in pieces:
        segment = dataset.segments[number]
        steps, command, earlier = _get_steps(segment, start_s), segment.grids.get("command"), segment.earlier_commands
        begin_s, end_s = steps.start * DT_S, (steps.stop - 1) * DT_S
        rows = (segment.time >= begin_s - 1e-9) & (segment.time <= end_s + 1e-9)
        if steps.start > 0 and command is not None:
            earlier = command[max(steps.start - HISTORY_STEPS, 0) : steps.start]
        wheel = segment.logged_wheel
        if wheel is not None:
            inside = (wheel[0] >= begin_s) & (wheel[0] <= end_s)
            wheel = (wheel[0][inside] - begin_s, wheel[1][inside])
        values: dict[str, Any] = {name: getattr(segment, name) for name in columns}
        values = {name: None if one is None else one[rows] for name, one in values.items()}
        segments.append(
            replace(
                segment,
                **values,
                start_s=segment.start_s + begin_s,
                time=segment.time[rows] - begin_s,
                grids={name: one[steps] for name, one in segment.grids.items()},
                logged_wheel=wheel,
                measured_rows={name: mask[rows] for name, mask in segment.measured_rows.items()},
                earlier_commands=earlier,
            )
        )
    return replace(dataset, segments=tuple(segments))


def _get_steps(segment: DriveSegment, start_s: float) -> slice:
    first = round(start_s / DT_S)
    return slice(first, min(first + round(PIECE_S / DT_S) + 1, len(segment.grids["speed"])))
