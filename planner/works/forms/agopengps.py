"""AgOpenGPS folders: recorded paths (RecPath.txt and *.rec) with their speed, beside Field.txt and its origin.

A point is easting, northing, heading, speed in km/h and whether the sections were on. There is no clock: times are
what the distances take at those speeds.
"""

from __future__ import annotations

from pathlib import PurePosixPath

import numpy as np

from fields.errors import FieldError
from fields.formats import agopengps
from fields.formats.archive import Members
from fields.reading import some
from planner.works.forms.form import Form
from planner.works.forms.rows import cleaned
from planner.works.record import Found, Logged
from vehicle.measured.errors import LogError

PATH, ENDING = "recpath.txt", ".rec"
SLOWEST_MPS = 0.1
KMH = 1.0 / 3.6
NO_CLOCK = "a recorded path has no clock; times are from distance and speed, and stops are not in it"


def _read(path: str, label: str) -> Found:
    members = Members(path)
    runs, notes = [], []
    for main in [one for one in members if PurePosixPath(one).name.lower() == agopengps.FIELD]:
        folder = PurePosixPath(main).parent
        paths = [one for one in members if PurePosixPath(one).parent == folder and _is_path(one)]
        for name in paths:
            try:
                runs.append(_run(members, main, name, label))
            except (FieldError, LogError) as refusal:
                notes.append(f"{name} is left out: {refusal}")
    if not runs and not notes:
        raise LogError(f"{label} has no recorded path (RecPath.txt); record one in AgOpenGPS, or name another folder.")
    return Found(tuple(runs), tuple(notes))


def _is_path(name: str) -> bool:
    last = PurePosixPath(name).name.lower()
    return last == PATH or last.endswith(ENDING)


def _run(members: Members, main: str, name: str, label: str) -> Logged:
    plane = agopengps.plane_of(members[main], label)
    lines = agopengps.lines_of(members[name])
    rows, short = [], 0
    for line in lines:
        if line.startswith("$") or line.isdecimal():
            continue
        row = _point(line)
        short += row is None
        rows += [] if row is None else [row]
    if len(rows) < 2:
        raise LogError(f"{some(len(rows), 'point')} can be read in it; record the path again.")
    table = np.array(rows)
    speed = np.maximum(table[:, 2] * KMH, 0.0)
    steps = np.hypot(*np.diff(table[:, :2], axis=0).T)
    lasts = steps / np.maximum(0.5 * (speed[1:] + speed[:-1]), SLOWEST_MPS)
    notes = [NO_CLOCK, *([f"{some(short, 'line')} with no point left out"] if short else [])]
    lonlat = np.array([plane.degrees(east, north) for east, north in table[:, :2]])
    folder = PurePosixPath(main).parent.name or members.path.resolve().name
    stem = PurePosixPath(name).stem
    run = Logged(
        stem, "AgOpenGPS", lonlat, np.concatenate([[0.0], np.cumsum(lasts)]), speed, table[:, 3] > 0.5, field=folder,
        outline=tuple(np.array(ring) for ring in agopengps.outline_of(members, main, plane)), notes=tuple(notes),
    )  # fmt: skip
    return cleaned(run)


def _point(line: str) -> tuple[float, float, float, float] | None:
    """Easting, northing, speed and whether at work; decimal commas are seen by twice as many parts."""
    head, _, last = line.replace(" ", "").rpartition(",")
    if last.lower() not in ("true", "false"):
        return None
    numbers = agopengps.numbers_of(head, 4)
    return None if numbers is None else (numbers[0], numbers[1], numbers[3], float(last.lower() == "true"))


def _holds(names: frozenset[str]) -> bool:
    return agopengps.FIELD in names


FORM = Form("AgOpenGPS", (), _read, _holds)
