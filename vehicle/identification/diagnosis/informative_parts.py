"""Of long logs the parts that say most: pieces in which steering, speed and implement change, from every run.

A model of a dozen amounts needs some ten minutes of such driving; more of it costs time and memory and changes no
verdict. Errors before and after are still those of all driving.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vehicle.identification.logs.schema import Array
from vehicle.identification.logs.thresholds import WINDOW_S
from vehicle.identification.replay.drive_segments import DriveDataset, DriveSegment
from vehicle.records import DT_S, HISTORY_STEPS

PIECE_S = 4.0 * WINDOW_S  # long enough for what lasts, such as a lag of the speed
MOST_PIECES = 40  # 27 minutes; half as many leave the verdicts of the sample sets as they are
SCALES = {"wheel": math.radians(5.0), "speed": 0.5, "working": 0.5}  # usual changes in a piece with a bend or a start


def choose_informative_parts(dataset: DriveDataset) -> DriveDataset:
    """The dataset with at most MOST_PIECES pieces of PIECE_S, those that say most, in turn from every run."""
    pieces = _list_pieces(dataset)
    if len(pieces) <= MOST_PIECES:
        return dataset
    scores = np.array([_score(dataset.segments[number], start) for number, start in pieces])
    runs = np.array([dataset.segments[number].run for number, _ in pieces])
    chosen = sorted(_choose_in_turn(scores, runs))
    return _keep_pieces(dataset, [pieces[one] for one in chosen])


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


def _score(segment: DriveSegment, start_s: float) -> float:
    """How much changes in a piece, in usual changes; nothing where the tractor stands."""
    steps = _get_steps(segment, start_s)
    grids = segment.grids if "wheel" in segment.grids else {**segment.grids, "wheel": segment.grids["command"]}
    if float(np.abs(grids["speed"][steps]).mean()) < 0.1:
        return 0.0
    return sum((math.tanh(float(np.std(grids[name][steps])) / scale) for name, scale in SCALES.items()), 0.0)


def _choose_in_turn(scores: Array, runs: Array) -> list[int]:
    """The best piece of every run, then the second of every run, and so on."""
    order = np.argsort(-scores, kind="stable")
    rank: dict[int, int] = {}
    turns = []
    for place in order:
        run = int(runs[place])
        rank[run] = rank.get(run, 0) + 1
        turns.append((rank[run], -float(scores[place]), int(place)))
    return [place for _, _, place in sorted(turns)[:MOST_PIECES]]


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
    columns: Sequence[str] = ("east", "north", "heading", "speed", "wheel", "command", "target", "working")
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
