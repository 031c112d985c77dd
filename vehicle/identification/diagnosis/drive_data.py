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

from vehicle.identification.errors import LogError
from vehicle.identification.logs.schema import Array, Mask
from vehicle.identification.logs.thresholds import STANDSTILL_MPS, WINDOW_S
from vehicle.identification.replay.drive_inputs import DriveInputs, Places, Samples, build_inputs
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.records import DT_S, HISTORY_STEPS

POSE_CELL_S, SENSOR_CELL_S = 0.4, 0.2  # cells of a window; shorter ones cost time and tell nothing more at 10 Hz
STRIDE = 2  # steps of the grid in a step of the path: 1/30 s, which turns 0.1 % otherwise than 1/60 s
STEP_S, PATH_STEP_S = DT_S, STRIDE * DT_S
POSE_CELLS, SENSOR_CELLS = round(WINDOW_S / POSE_CELL_S), round(WINDOW_S / SENSOR_CELL_S)
FEWEST_WINDOWS = 3
LEAST_CELL_SHARE = 0.2  # of the cells of a window that hold a position
CRAWL_MPS = 0.2  # windows driven more slowly on average say nothing


@dataclass(frozen=True, eq=False)
class DriveData(DriveInputs):
    """All segments of a dataset that hold a window.

    `window_runs` (w,) are indices of runs, `window_starts` (w,) steps of the path.
    """

    dataset: DriveDataset
    window_runs: Places
    window_starts: Places
    window_segments: Places

    @property
    def windows(self) -> int:
        """Number of windows."""
        return len(self.window_runs)

    @property
    def runs(self) -> int:
        """Number of runs, with those that hold no window."""
        return len(self.dataset.names)

    @cached_property
    def path_runs(self) -> Places:
        """The run of every step of the path (m,)."""
        return self.spread([segment.run for segment in self.segments])

    @cached_property
    def row_step_s(self) -> float:
        """The median time between rows (s)."""
        return float(np.median(np.concatenate([np.diff(segment.time) for segment in self.segments])))

    def cut(self, values: Array, cells: int) -> Array:
        """Means (w, cells) of values per step of the path over all cells of the windows."""
        steps = round(WINDOW_S / PATH_STEP_S)
        last = self.path_starts[1:][self.window_segments] - 1
        places = np.minimum(self.window_starts[:, None] + np.arange(steps), last[:, None])
        return np.asarray(values[places].reshape(len(places), cells, -1).mean(axis=2))


def build_drive_data(dataset: DriveDataset) -> DriveData:
    """Lay the segments of a dataset out in windows.

    Raises LogError where fewer than FEWEST_WINDOWS hold enough driving.
    """
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
    samples = _build_samples(kept, windows, inputs.step_starts, inputs.path_starts)
    return DriveData(**vars(inputs) | samples, dataset=dataset, window_runs=runs, window_starts=starts,
                     window_segments=window_segments)  # fmt: skip


def _list_windows(segment: DriveSegment) -> list[float]:
    """Starts (s) of the windows of a segment that hold driving; the last may be half empty."""
    count = int((segment.time[-1] + 0.5 * WINDOW_S) / WINDOW_S)
    starts = []
    for start in WINDOW_S * np.arange(count):
        rows = (segment.time >= start) & (segment.time < start + WINDOW_S)
        cells = len(np.unique(segment.time[rows] // POSE_CELL_S))
        if rows.any() and cells >= max(4, LEAST_CELL_SHARE * POSE_CELLS):
            starts += [float(start)] if float(np.abs(segment.speed[rows]).mean()) > CRAWL_MPS else []
    return starts


def _build_samples(
    segments: Sequence[DriveSegment], windows: list[tuple[int, float]], step_starts: Places, path_starts: Places
) -> dict[str, Samples]:
    """East, north, heading, wheel angle and speed as measured, in cells of the windows."""
    samples = {}
    for name, count in (("east", POSE_CELLS), ("north", POSE_CELLS), ("heading", POSE_CELLS),
                        ("wheel", SENSOR_CELLS), ("speed", SENSOR_CELLS)):  # fmt: skip
        starts, step_s = (path_starts, PATH_STEP_S) if count == POSE_CELLS else (step_starts, STEP_S)
        parts = [(np.empty(0), np.empty(0), np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))]
        for window, (number, start_s) in enumerate(windows):
            segment = segments[number]
            column = _get_sampled_column(segment, name)
            if column is None:
                continue
            rows = np.flatnonzero((segment.time >= start_s) & (segment.time < start_s + WINDOW_S) & column[1])
            cell = ((segment.time[rows] - start_s) / (WINDOW_S / count)).astype(np.int64)
            places = starts[number] + segment.time[rows] / step_s
            parts.append((column[0][rows], places, window * count + np.minimum(cell, count - 1),
                          np.full(len(rows), number)))  # fmt: skip
        values, places, cells, numbers = (np.concatenate(part) for part in zip(*parts, strict=True))
        shape, size = (len(windows), count), len(windows) * count
        counts = np.bincount(cells, minlength=size)
        means = np.bincount(cells, values, minlength=size) / np.maximum(counts, 1)
        samples[name] = Samples(means.reshape(shape), (counts > 0).reshape(shape), places, cells, numbers)
    return samples


def _get_sampled_column(segment: DriveSegment, name: str) -> tuple[Array, Mask] | None:
    """The values of a column (k,) and in which rows they were measured; None where they cannot be compared."""
    is_absent = {
        "heading": not segment.heading_measured,
        "wheel": segment.wheel is None or segment.command is None,
        "speed": not segment.speed_measured or segment.target is None,
    }
    if is_absent.get(name):
        return None
    every = np.ones(segment.rows, dtype=np.bool_)
    return getattr(segment, name), segment.measured_rows.get(name, every) if name in ("wheel", "speed") else every


PIECE_S = 4.0 * WINDOW_S  # long enough for what lasts, such as a lag of the speed
# 27 minutes: a model of a dozen amounts needs some ten of such driving, and half as many leave the verdicts of the
# sample sets as they are. Errors before and after are those of all driving.
MOST_PIECES = 40
SCALES = {"wheel": math.radians(5.0), "speed": 0.5, "working": 0.5}  # usual changes in a piece with a bend or a start


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
    return replace(dataset, segments=tuple(cut_segment(dataset.segments[number], start) for number, start in pieces))


def _get_steps(segment: DriveSegment, start_s: float) -> slice:
    first = round(start_s / DT_S)
    return slice(first, min(first + round(PIECE_S / DT_S) + 1, len(segment.grids["speed"])))


def cut_segment(segment: DriveSegment, start_s: float) -> DriveSegment:
    """A piece of a segment as a segment of its own, with the commands before it."""
    steps = _get_steps(segment, start_s)
    begin_s, end_s = steps.start * DT_S, (steps.stop - 1) * DT_S
    rows = (segment.time >= begin_s - 1e-9) & (segment.time <= end_s + 1e-9)
    command = segment.grids.get("command")
    earlier = (
        segment.earlier_commands
        if steps.start == 0 or command is None
        else command[max(steps.start - HISTORY_STEPS, 0) : steps.start]
    )
    wheel = segment.logged_wheel
    if wheel is not None:
        inside = (wheel[0] >= begin_s) & (wheel[0] <= end_s)
        wheel = (wheel[0][inside] - begin_s, wheel[1][inside])
    columns = ("east", "north", "heading", "speed", "wheel", "command", "target", "working")
    values: dict[str, Any] = {name: getattr(segment, name) for name in columns}
    values = {name: None if one is None else one[rows] for name, one in values.items()}
    return replace(
        segment,
        **values,
        start_s=segment.start_s + begin_s,
        time=segment.time[rows] - begin_s,
        grids={name: one[steps] for name, one in segment.grids.items()},
        logged_wheel=wheel,
        measured_rows={name: mask[rows] for name, mask in segment.measured_rows.items()},
        earlier_commands=earlier,
    )
