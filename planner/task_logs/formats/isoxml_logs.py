"""ISOXML task data (ISO 11783-10) with time logs: one run for every log, with the field of its task.

A time log has two files: a header (XML) that names columns, and binary records. A record has the time of day (ms), the
day since 1980-01-01, those parts of the position that are empty in the header, and the changed values, each a column
number and a 32-bit integer. A value holds until its next change.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from fields.arrays import Flags, Floats
from fields.formats import isoxml
from fields.formats.archive import ArchiveMembers, open_folder_or_archive
from fields.formats.markup import parse_root
from fields.text_files import count_noun, parse_number
from fields.units import DAY_S, KILO, MPS_PER_KMH
from planner.task_logs.formats.log_format import LogFormat, find_dated_rows, read_each, remove_unusable_rows
from planner.task_logs.runs.run_records import (
    ACTIVE_M,
    ACTIVE_S,
    AREA_M2,
    FUEL_L,
    INACTIVE_M,
    INACTIVE_S,
    LogContents,
    LoggedRun,
)
from vehicle.identification.errors import LogError

_POSITION_FIELDS = {"A": "i", "B": "i", "C": "i", "D": "B", "E": "H", "F": "H", "G": "B", "H": "I", "I": "H"}
"""Parts of a position in a record, with the kind of their number (struct)."""
DEGREES_PER_UNIT = 1e-7
METRES_PER_MM = 1.0 / KILO
TLG_EPOCH = datetime(1980, 1, 1)
NO_DAY = 0xFFFF  # in place of a day that is not available
MAX_COLUMNS = 255
WIDTH_DDI, WORK_STATE_DDI, SPEED_DDI = "0043", "008D", "018D"
COUNTERS = {
    AREA_M2: ("0074", 1.0, 300.0),
    ACTIVE_M: ("0075", 1e-3, 6.0),
    INACTIVE_M: ("0076", 1e-3, 15.0),
    ACTIVE_S: ("0077", 1.0, 1.0),
    INACTIVE_S: ("0078", 1.0, 1.0),
    FUEL_L: ("0094", 1e-3, 0.05),
}
"""Totals of a task: their DDI, the unit of their values (ISO 11783-11), and the largest plausible rise per second."""
CONDENSED_STATE_DDIS = frozenset(f"{ddi:04X}" for ddi in range(0xA1, 0xB1))
"""Actual condensed work states of sections, 16 in each (ISO 11783-11)."""
SPEED_UNITS_MPS = {"km/h": MPS_PER_KMH, "m/s": 1.0, "mm/s": METRES_PER_MM}


@dataclass(frozen=True, eq=False)
class TimeLog:
    """Records of one time log, unchecked.

    Attributes:
        columns: DDI as four hexadecimal digits, and device element, of every column.
        time_s: (n,) seconds since 1980-01-01, which stands for a day that is not available too.
        lat_deg, lon_deg: (n,) degrees, NaN if not logged.
        fix_status: (n,) status of the position, 0 for none, NaN if not logged.
        values: (n, columns), NaN before the first value.
        lost_bytes: after the last complete record.
        elevation_m: (n,) height of the antenna, NaN if not logged.
    """

    columns: tuple[tuple[str, str], ...]
    time_s: Floats
    lat_deg: Floats
    lon_deg: Floats
    fix_status: Floats
    values: Floats
    lost_bytes: int
    elevation_m: Floats

    def find_ddi_columns(self, ddi: str) -> list[int]:
        """Columns with a DDI."""
        return [place for place, (name, _) in enumerate(self.columns) if name == ddi]


def parse_time_log(header: bytes, records: bytes, label: str) -> TimeLog:
    """A time log from the contents of its two files; raises FieldError or LogError for an unusable header."""
    time_element = parse_root(header, f"{label}.xml")
    if time_element.tag != "TIM":
        time_element = next(time_element.iter("TIM"), time_element)
    position = time_element.find("PTN")
    attributes = {} if position is None else dict(position.attrib)
    parts = [(key, kind) for key, kind in _POSITION_FIELDS.items() if attributes.get(key) == ""]
    columns = tuple((each.get("A", "").upper().zfill(4), each.get("C", "")) for each in time_element.iter("DLV"))
    if len(columns) > MAX_COLUMNS:
        raise LogError(f"{label}.xml names {len(columns)} columns; a time log has at most {MAX_COLUMNS}.")
    heads, values, lost_bytes = _parse_records(records, "<IH" + "".join(kind for _, kind in parts), len(columns))
    table = {key: heads[:, 2 + place] for place, (key, _) in enumerate(parts)}
    empty = np.full(len(heads), np.nan)
    return TimeLog(
        columns,
        np.where(heads[:, 1] == NO_DAY, 0.0, heads[:, 1]) * float(DAY_S) + heads[:, 0] / 1e3,
        table.get("A", empty) * DEGREES_PER_UNIT,
        table.get("B", empty) * DEGREES_PER_UNIT,
        table.get("D", empty),
        values,
        lost_bytes,
        table.get("C", empty) * METRES_PER_MM,
    )


def _parse_records(data: bytes, struct_format: str, column_count: int) -> tuple[Floats, Floats, int]:
    """Heads (n, parts) and values (n, columns) of the complete records, and the number of bytes after them."""
    head, change = struct.Struct(struct_format), struct.Struct("<Bi")
    size, place = head.size, 0
    heads, rows, current_values = [], [], np.full(column_count, np.nan)
    while place + size < len(data):
        count = data[place + size]
        end = place + size + 1 + change.size * count
        if end > len(data):
            break
        changes = list(change.iter_unpack(data[place + size + 1 : end]))
        if any(index >= column_count for index, _ in changes):
            break  # out of step: the rest are not records
        heads.append(head.unpack_from(data, place))
        for index, value in changes:
            current_values[index] = value
        rows.append(current_values.copy())
        place = end
    parts = len(head.unpack(bytes(size)))
    table = np.array(heads, dtype=np.float64).reshape(len(heads), parts)
    return table, np.array(rows, dtype=np.float64).reshape(len(rows), column_count), len(data) - place


@dataclass(frozen=True)
class _ValuePresentation:
    """Conversion of a value for display by its device: (number + offset) x scale, and its unit."""

    offset: float
    scale: float
    unit: str


def _read_isoxml_logs(path: str, label: str) -> LogContents:
    members = open_folder_or_archive(path)
    if members.path != Path(path) and Path(path).name.lower() != isoxml.TASKDATA_FILE:
        raise LogError(f"{label} is a single file of task data; name its folder, or the TASKDATA.XML in it.")
    logs = (  # each with its own limit of bytes
        log
        for taskdata_file in members.find_paths_by_name(isoxml.TASKDATA_FILE)
        for log in _iter_logs(open_folder_or_archive(path), taskdata_file, label)
    )
    return read_each(logs, f"{label} is ISOXML without a time log (TLG); export the finished tasks with their logs.")


def _iter_logs(
    members: ArchiveMembers, taskdata_file: str, label: str
) -> Iterator[tuple[str, Callable[[], LoggedRun]]]:
    """Every time log of one TASKDATA.XML once, with what reads its run."""
    roots = list(isoxml.read_taskdata_roots(members, taskdata_file, label))
    partfields = {one.get("A", ""): one for root in roots for one in root.iter("PFD")}
    values, seen = _read_presentations(roots), set[str]()
    for task in (one for root in roots for one in root.iter("TSK")):
        for log in task.iter("TLG"):
            name = (log.get("A") or "").strip()
            if name and name not in seen:
                seen.add(name)
                partfield = partfields.get(task.get("E", ""))
                yield name, partial(_read_run, members, taskdata_file, name, values, task, partfield)


def _read_run(
    members: ArchiveMembers,
    taskdata_file: str,
    name: str,
    values: dict[tuple[str, str], _ValuePresentation],
    task: Element,
    partfield: Element | None,
) -> LoggedRun:
    contents = []
    for ending in ("xml", "bin"):
        content = members.read_member_beside(taskdata_file, f"{name}.{ending}")
        if content is None:
            raise LogError(f"{name}.{ending} is missing in the folder; copy the whole folder.")
        contents.append(content)
    log, notes = parse_time_log(contents[0], contents[1], name), []
    if log.lost_bytes:
        rows = count_noun(len(log.time_s), "record")
        notes.append(f"{count_noun(log.lost_bytes, 'byte')} after {rows} skipped: not a complete record")
    is_working, time_s = _find_work_state(log, notes), _correct_days(log.time_s, notes)
    lonlat = np.column_stack([log.lon_deg, log.lat_deg])
    lonlat[log.fix_status == 0] = np.nan
    columns = log.values[:, log.find_ddi_columns(WIDTH_DDI)].T
    widths = [np.median(column[column > 0]) for column in columns if (column > 0).any()]
    run = LoggedRun(
        name=name,
        log_format="ISOXML",
        lonlat=lonlat,
        time_s=time_s,
        speed_mps=_find_speed_mps(log, values),
        is_working=is_working,
        width_m=float(max(widths)) * METRES_PER_MM if widths else None,
        counters=_compute_counter_rises(log, time_s),
        notes=tuple(notes),
        elevation_m=log.elevation_m if (np.isfinite(log.elevation_m) & (log.elevation_m != 0.0)).any() else None,
    )
    run = remove_unusable_rows(run, TLG_EPOCH)
    if partfield is not None:
        area_m2 = parse_number(partfield.get("D"))
        run = replace(
            run,
            field=(partfield.get("C") or "").strip() or partfield.get("A", ""),
            outline=tuple(np.array(ring) for ring in isoxml.read_boundary_rings(partfield)),
            outline_m2=area_m2 if 0.0 < area_m2 < math.inf else None,
        )
    return replace(run, field=run.field or (task.get("B") or "").strip())


def _correct_days(time_s: Floats, notes: list[str]) -> Floats:
    """Times of a terminal that does not count the day at midnight, corrected with a note; rows without a day stay."""
    has_day = find_dated_rows(time_s, TLG_EPOCH)
    corrected_s, known_s = time_s.copy(), time_s[has_day]
    jumps_back = np.diff(known_s, prepend=known_s[:1]) < -0.5 * DAY_S
    if jumps_back.any():
        notes.append("the log does not count the day at midnight; this was corrected")
    corrected_s[has_day] = known_s + float(DAY_S) * np.cumsum(jumps_back)
    return corrected_s


def _find_work_state(log: TimeLog, notes: list[str]) -> Flags | None:
    """Whether any element of the machine works, else any of its sections; None if not logged."""
    places = log.find_ddi_columns(WORK_STATE_DDI)
    states = log.values[:, places]
    if np.isfinite(states).any():
        if len(places) > 1:
            notes.append(f"{len(places)} elements have a work state; the run is working if any of them is")
        return np.asarray((states == 1.0).any(axis=1))
    states = log.values[:, [place for place, (ddi, _) in enumerate(log.columns) if ddi in CONDENSED_STATE_DDIS]]
    if not np.isfinite(states).any():
        return None
    notes.append("the work state is from the sections: working if any section is on")
    bits = np.nan_to_num(states).astype(np.int64)  # two for each section, 1 is on
    return np.asarray(np.any([(bits >> shift) & 3 == 1 for shift in range(0, 32, 2)], axis=(0, 2)))


def _find_speed_mps(log: TimeLog, values: dict[tuple[str, str], _ValuePresentation]) -> Floats | None:
    """The speed in m/s: the standard value, or a proprietary value that its device displays as a speed."""
    for place, (ddi, element) in enumerate(log.columns):
        presentation = values.get((ddi, element)) or values.get((ddi, ""))
        has_speed_unit = presentation is not None and presentation.unit in SPEED_UNITS_MPS
        if (ddi == SPEED_DDI or has_speed_unit) and np.isfinite(log.values[:, place]).any():
            if presentation is None or not has_speed_unit:
                return np.asarray(log.values[:, place] * METRES_PER_MM)
            return np.asarray(
                (log.values[:, place] + presentation.offset) * presentation.scale * SPEED_UNITS_MPS[presentation.unit]
            )
    return None


def _compute_counter_rises(log: TimeLog, time_s: Floats) -> dict[str, float]:
    """The rises of totals over the log; of several elements the largest."""
    totals = {}
    time_s = np.where(find_dated_rows(time_s, TLG_EPOCH), time_s, np.nan)
    for name, (ddi, unit, max_per_s) in COUNTERS.items():
        columns = log.values[:, log.find_ddi_columns(ddi)].T
        rises = [_sum_counter_rises(time_s, column * unit, max_per_s) for column in columns]
        known_rises = [one for one in rises if one is not None]
        if known_rises:
            totals[name] = max(known_rises)
    return totals


def _sum_counter_rises(time_s: Floats, column: Floats, max_per_s: float) -> float | None:
    """The sum of all rises of a total; None without values.

    A total is sent when it changes, so a value that first appears after the first row has risen before. It counts too
    if it can have accumulated since the first row, but not if it continues an earlier log of the task.
    """
    rows = np.flatnonzero(np.isfinite(column))
    if not len(rows):
        return None
    first = float(column[rows[0]])
    starts_in_log = 0.0 <= first <= max_per_s * (float(time_s[rows[0]] - time_s[np.isfinite(time_s)][0]) + 1.0)
    return float(np.maximum(np.diff(column[rows]), 0.0).sum()) + starts_in_log * first


def _read_presentations(roots: list[Element]) -> dict[tuple[str, str], _ValuePresentation]:
    """Display conversions of values by DDI and device element; "" stands for any element."""
    presentations: dict[tuple[str, str], _ValuePresentation] = {}
    for device in (one for root in roots for one in root.iter("DVC")):
        device_presentations = {one.get("A"): one for one in device.findall("DVP")}
        for process_data in device.findall("DPD"):
            shown = device_presentations.get(process_data.get("F"))
            if shown is None:
                continue
            try:
                offset, scale = float(shown.get("B") or 0), float(shown.get("C") or 1)
            except ValueError:
                continue
            value = _ValuePresentation(offset, scale, (shown.get("E") or "").strip())
            ddi, key = (process_data.get("B") or "").upper().zfill(4), process_data.get("A")
            presentations.setdefault((ddi, ""), value)
            for element in device.findall("DET"):
                if any(one.get("A") == key for one in element.findall("DOR")):
                    presentations[(ddi, element.get("A", ""))] = value
    return presentations


LOG_FORMAT = LogFormat("ISOXML", (".xml", ".bin"), _read_isoxml_logs, lambda names: isoxml.TASKDATA_FILE in names)
