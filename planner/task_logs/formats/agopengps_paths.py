"""AgOpenGPS folders: recorded paths (RecPath.txt and *.rec) beside Field.txt with its origin.

A point has easting, northing, heading, speed in km/h and whether the sections were on. There is no clock, so times are
computed from distances and speeds.
"""

from __future__ import annotations

from functools import partial
from pathlib import PurePosixPath

import numpy as np

from fields.formats import agopengps
from fields.formats.archive import ArchiveMembers
from fields.text_files import count_noun
from fields.units import MPS_PER_KMH
from planner.task_logs.formats.log_format import LogFormat, read_each, remove_unusable_rows
from planner.task_logs.runs.run_records import LogContents, LoggedRun
from vehicle.identification.errors import LogError

RECORDED_PATH_FILE, RECORDED_PATH_EXTENSION = "recpath.txt", ".rec"
MIN_SPEED_MPS = 0.1
NO_CLOCK_NOTE = "recorded paths have no clock; times are from distance and speed, without stops"


def _read_paths(path: str, label: str) -> LogContents:
    members = ArchiveMembers(path)
    logs = [
        (name, partial(_read_run, members, field_file, name, label))
        for field_file in members
        if PurePosixPath(field_file).name.lower() == agopengps.FIELD_FILE
        for name in members
        if PurePosixPath(name).parent == PurePosixPath(field_file).parent and _is_recorded_path(name)
    ]
    return read_each(
        logs, f"{label} has no recorded path (RecPath.txt); record one in AgOpenGPS, or name another folder."
    )


def _is_recorded_path(name: str) -> bool:
    file_name = PurePosixPath(name).name.lower()
    return file_name == RECORDED_PATH_FILE or file_name.endswith(RECORDED_PATH_EXTENSION)


def _read_run(members: ArchiveMembers, field_file: str, name: str, label: str) -> LoggedRun:
    plane = agopengps.parse_plane(agopengps.split_lines(members[field_file]), label)
    lines = agopengps.split_lines(members[name])
    rows, unread_lines = [], 0
    for line in lines:
        if line.startswith("$") or line.isdecimal():
            continue
        row = _parse_point(line)
        unread_lines += row is None
        rows += [] if row is None else [row]
    if len(rows) < 2:
        raise LogError(f"only {count_noun(len(rows), 'readable point')}; record the path again.")
    table = np.array(rows)
    speed = np.maximum(table[:, 2] * MPS_PER_KMH, 0.0)
    steps = np.hypot(*np.diff(table[:, :2], axis=0).T)
    duration_s = steps / np.maximum(0.5 * (speed[1:] + speed[:-1]), MIN_SPEED_MPS)
    notes = [NO_CLOCK_NOTE, *([f"{count_noun(unread_lines, 'unreadable line')} skipped"] if unread_lines else [])]
    lonlat = np.array([plane.to_degrees(east, north) for east, north in table[:, :2]])
    folder = PurePosixPath(field_file).parent.name or members.path.resolve().name
    run = LoggedRun(
        name=PurePosixPath(name).stem,
        log_format="AgOpenGPS",
        lonlat=lonlat,
        time_s=np.concatenate([[0.0], np.cumsum(duration_s)]),
        speed_mps=speed,
        is_working=table[:, 3] > 0.5,
        field=folder,
        outline=tuple(map(np.array, agopengps.read_rings(members, field_file, agopengps.BOUNDARY_FILE, plane))),
        notes=tuple(notes),
    )
    return remove_unusable_rows(run)


def _parse_point(line: str) -> tuple[float, float, float, float] | None:
    """Easting, northing, speed and whether at work (1 or 0); None for an unreadable line."""
    head, _, last = line.replace(" ", "").rpartition(",")
    if last.lower() not in ("true", "false"):
        return None
    numbers = agopengps.parse_numbers(head, 4)
    return None if numbers is None else (numbers[0], numbers[1], numbers[3], float(last.lower() == "true"))


LOG_FORMAT = LogFormat("AgOpenGPS", (), _read_paths, lambda names: agopengps.FIELD_FILE in names)
