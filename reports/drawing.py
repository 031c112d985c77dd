"""The map of a page as numbers for its template and its script: centimetres on the ground, y down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from reports.landmarks import (
    Label,
    WorkMark,
    cell_labels,
    cut_off_labels,
    leg_numbers,
    missed_label,
    round_labels,
    track_labels,
    work_marks,
)
from reports.leg_list import heading, metres
from reports.palette import TRACTORS
from reports.paths import (
    REFILLING_STATUS,
    REVERSING,
    STATES,
    WORKING,
    Extent,
    extent,
    hatching,
    round_length,
    states_of,
    swath,
    waits,
)
from reports.results import Drive, Points
from reports.step_words import step_words
from reports.timed import Lane, lanes
from reports.wording import duration

# Knots of all paths of a page, at some 14 bytes each: with the best plan drawn twice, below two megabytes.
MOST_KNOTS = 30_000  # of the plan shown first
MOST_OTHERS = 60_000  # of all other plans together
_MARGIN = 0.04  # of the larger side of the map
MOST_STEPS = 15_000  # of all plans together, at some 45 bytes each; further plans have no lists of legs
_HATCH = 1.1  # between two lines over ground that is not worked, in hundredths of the larger side of the map


@dataclass(frozen=True)
class Viewport:
    """Metres, y north, to whole centimetres from the upper left corner, y down."""

    west: float
    north: float

    def of(self, points: Points) -> list[tuple[int, int]]:
        """Points (n, 2) on paper."""
        flat = np.rint((points - (self.west, self.north)) * (100.0, -100.0)).astype(int)
        return [(int(x), int(y)) for x, y in flat]

    def line(self, points: Points, closed: bool = False) -> str:
        """Path data of a polyline (n, 2); moves after the first are relative, which halves the text."""
        flat = self.of(points)
        steps = [f"{x - x0} {y - y0}" for (x0, y0), (x, y) in pairwise(flat) if (x, y) != (x0, y0)]
        return f"M{flat[0][0]} {flat[0][1]}" + (f"l{' '.join(steps)}" if steps else "") + ("z" if closed else "")


def map_picture(drives: Mapping[str, Drive]) -> dict[str, Any]:
    """Field, marks and scale bar, and of each drive, by its name, what the script draws of it; the first is drawn.

    All drives are of one field. Sizes are in centimetres on the ground.
    """
    first = next(iter(drives.values()))
    box = _together([extent(drive) for drive in drives.values()])
    size = box.size or 1.0
    margin = _MARGIN * size
    frame = Viewport(box.west - margin, box.north + margin)
    bar = round_length(max(box.width, 0.5 * size) / 4)
    height = box.height + 2 * margin
    share = MOST_OTHERS // max(len(drives) - 1, 1)
    thinned = [lanes(drive, share if place else MOST_KNOTS) for place, drive in enumerate(drives.values())]
    listed = _listed(list(drives.values()))
    states = states_of(drives.values())
    plans = [
        _plan(name, drive, paths, frame, box, number < listed, states)
        for number, ((name, drive), paths) in enumerate(zip(drives.items(), thinned, strict=True))
    ]
    driven = {int(value) for drive in drives.values() for status in drive.status for value in np.unique(status)}
    return {
        "width": round((box.width + 2 * margin) * 100),
        "height": round((height + 0.06 * size) * 100),
        "unit": max(round(size), 1),
        "field": "".join(frame.line(ring, closed=True) for ring in (first.boundary, *first.holes)),
        "swaths": "".join(frame.line(swath(track, first.width_m), closed=True) for track in first.tracks),
        "rounds": [
            {"line": frame.line(one.points), "tint": one.number % 2, "width": round(first.width_m * 100)}
            for one in first.rounds
        ],
        "cells": "".join(frame.line(ring, closed=True) for cell in first.cells for ring in cell.rings),
        "obstacles": "".join(frame.line(ring, closed=True) for ring in first.obstacles),
        "fences": "".join(frame.line(line) for line in first.fences),
        "labels": _texts(track_labels(first, size), frame),
        "round_labels": _texts(round_labels(first, size), frame),
        "cell_labels": _texts(cell_labels(first), frame),
        "cut_off_labels": _texts(cut_off_labels(first), frame),
        "lanes": [_drawn(path, frame, number) for number, path in enumerate(thinned[0])],
        "entrance": None if first.entrance is None else frame.of(np.array([first.entrance]))[0],
        "bar": {"x": round(margin * 100), "y": round((height + 0.02 * size) * 100), "length": round(bar * 100)},
        "bar_text": f"{bar:g} m",
        "plans": plans,
        "reversing": REVERSING in driven,
        "waiting": STATES["waiting"] in driven,
        "refilling": REFILLING_STATUS in driven,
        "missed": any(drive.missed for drive in drives.values()),
    }


def _together(boxes: Sequence[Extent]) -> Extent:
    return Extent(
        min(box.west for box in boxes), min(box.south for box in boxes),
        max(box.east for box in boxes), max(box.north for box in boxes),
    )  # fmt: skip


def _listed(drives: Sequence[Drive]) -> int:
    """How many plans, from the first on, have room for their lists of legs."""
    steps = np.cumsum([sum(map(len, drive.steps)) for drive in drives])
    return max(1, int(np.searchsorted(steps, MOST_STEPS, side="right")))


def _texts(labels: Sequence[Label], frame: Viewport) -> list[dict[str, Any]]:
    """Labels on paper."""
    places = frame.of(np.array([label.place for label in labels]).reshape(-1, 2))
    return [{"x": x, "y": y, "text": label.text} for (x, y), label in zip(places, labels, strict=True)]


def _drawn(path: Lane, frame: Viewport, number: int) -> dict[str, Any]:
    """The whole path of a tractor: its lines by manner."""
    lines = {"work": "", "turn": "", "back": ""}
    for status, first, last in path.runs():
        manner = {WORKING: "work", REVERSING: "back"}.get(status, "turn")
        lines[manner] += frame.line(path.xy[first : last + 1])
    return {"number": number + 1, "colour": number % len(TRACTORS), "start": frame.of(path.xy[:1])[0], **lines}


def _plan(
    name: str, drive: Drive, paths: Sequence[Lane], frame: Viewport, box: Extent, listed: bool, states: Sequence[str]
) -> dict[str, Any]:
    """What the script needs of one plan: knots, arrows, stops and legs per tractor, and seconds by manner."""
    longest = max(len(xy) for xy in drive.xy) - 1
    marks = work_marks(drive, box.size or 1.0)
    return {
        "name": name,
        "title": drive.title,
        "step": drive.step_s,
        "end": round(longest * drive.step_s, 3),
        "lanes": [
            {
                "knots": _knots(path, frame),
                "status": "".join(map(str, path.status.tolist())),
                "arrows": _arrows(marks[number], frame),
                "numbers": [[one["x"], one["y"], one["text"]] for one in _texts(leg_numbers(marks[number]), frame)],
                "legs": _legs(drive, number) if listed else [],
                "heading": heading(number + 1, drive.steps[number]) if drive.steps and listed else "",
                "waits": _stops(drive, number, frame, STATES["waiting"]),
                "refills": _stops(drive, number, frame, REFILLING_STATUS),
            }
            for number, path in enumerate(paths)
        ],
        "seconds": [[round(_seconds(drive, state, number), 1) for state in states] for number in range(len(paths))],
        "missed": _missed(drive, frame, box),
    }


def _stops(drive: Drive, number: int, frame: Viewport, status: int) -> list[list[Any]]:
    """Where on paper a tractor stood in a status, and for how long in words."""
    stood = waits(drive.xy[number], drive.status[number], drive.step_s, status)
    return [[*frame.of(np.array([(x, y)]))[0], duration(seconds)] for x, y, seconds in stood]


def _missed(drive: Drive, frame: Viewport, box: Extent) -> dict[str, Any]:
    """Ground that is not worked, the lines over it, and the largest piece: its place and its area in words."""
    label = missed_label(drive, box)
    return {
        "ground": "".join(frame.line(ring, closed=True) for ring in drive.missed),
        "hatch": "".join(frame.line(line) for line in hatching(drive.missed, _HATCH * (box.size or 1.0) / 100)),
        "largest": label and [*frame.of(label.place[None, :])[0], label.text],
    }


def _knots(path: Lane, frame: Viewport) -> list[int]:
    """Samples and centimetres since the knot before, three numbers each; the first since 0."""
    flat = np.column_stack([path.sample, np.asarray(frame.of(path.xy))])
    return [int(value) for value in np.diff(flat, axis=0, prepend=np.zeros((1, 3), dtype=int)).ravel()]


def _arrows(marks: Sequence[WorkMark], frame: Viewport) -> str:
    """Heads of arrows on worked stretches."""
    return "".join(frame.line(mark.head, closed=True) for mark in marks)


def _legs(drive: Drive, number: int) -> list[list[Any]]:
    """Start and duration (s), length (m, "" of a wait) and words of everything a tractor does, in order."""
    steps = drive.steps[number] if drive.steps else ()
    return [
        [round(step.from_s, 1), round(step.seconds, 1), metres(step), step_words(step)] for step in steps
    ]


def _seconds(drive: Drive, state: str, number: int) -> float:
    """Seconds of a tractor in a state that others of the drives shown may have alone."""
    return drive.seconds[state][number] if state in drive.seconds else 0.0


def bar_rows(drive: Drive, states: Sequence[str] = tuple(STATES)) -> list[dict[str, Any]]:
    """Per tractor its total and, per manner, seconds in words and the share of the longest bar in percent."""
    totals = [sum(_seconds(drive, name, number) for name in states) for number in range(len(drive.xy))]
    longest = max(totals) or 1.0
    return [
        {
            "number": number + 1,
            "total": duration(total),
            "parts": [
                {
                    "state": name,
                    "text": duration(_seconds(drive, name, number)),
                    "share": round(_seconds(drive, name, number) / longest * 100, 3),
                }
                for name in states
            ],
        }
        for number, total in enumerate(totals)
    ]
