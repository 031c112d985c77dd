"""ISOXML task data (ISO 11783-10) with time logs: one run for every log, with the field of its task."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from fields.errors import FieldError
from fields.formats import isoxml
from fields.formats.archive import Members, is_archive
from fields.reading import some
from planner.works.forms.form import Form
from planner.works.forms.rows import cleaned
from planner.works.forms.tlg import TimeLog, moment, read_time_log
from planner.works.record import ACTIVE_M, ACTIVE_S, AREA_M2, FUEL_L, INACTIVE_M, INACTIVE_S, Array, Found, Logged, Mask
from vehicle.measured.errors import LogError

WIDTH, WORK_STATE, SPEED = "0043", "008D", "018D"
COUNTED = {
    AREA_M2: ("0074", 1.0), ACTIVE_M: ("0075", 1e-3), INACTIVE_M: ("0076", 1e-3), ACTIVE_S: ("0077", 1.0),
    INACTIVE_S: ("0078", 1.0), FUEL_L: ("0094", 1e-3),
}  # fmt: skip
"""Totals of a task by their DDI, and the unit of the number (ISO 11783-11)."""
MOST_PER_S = {AREA_M2: 300.0, ACTIVE_M: 6.0, INACTIVE_M: 15.0, ACTIVE_S: 1.0, INACTIVE_S: 1.0, FUEL_L: 0.05}
"""What no machine does more of in a second."""
CONDENSED = frozenset(f"{ddi:04X}" for ddi in range(0xA1, 0xB1))
"""Actual condensed work states of sections, 16 in each (ISO 11783-11)."""
SPEED_UNITS = {"km/h": 1.0 / 3.6, "m/s": 1.0, "mm/s": 1e-3}
MM = 1e-3


@dataclass(frozen=True, eq=False)
class _Parcel:
    """A partfield: its name, stated area and rings in degrees."""

    name: str
    area_m2: float | None
    rings: tuple[Array, ...]


@dataclass(frozen=True)
class _Value:
    """How a device shows one of its values: (number + offset) x scale in a unit."""

    offset: float
    scale: float
    unit: str


def _read(path: str, label: str) -> Found:
    place = Path(path)
    whole = place.is_dir() or is_archive(place)
    if not whole and place.name.lower() != isoxml.TASKDATA:
        raise LogError(f"{label} is one file of task data; name its folder, or the TASKDATA.XML in it.")
    members = Members(place) if whole else Members(place.parent, 0)
    mains = members.named(isoxml.TASKDATA) if whole else [place.name]
    runs: list[Logged] = []
    notes: list[str] = []
    for main in mains:  # each with a limit of its own to how much is read
        runs += _of_folder(Members(place) if whole else members, main, label, notes)
    if not runs and not notes:
        raise LogError(f"{label} is ISOXML without a time log (TLG); export the finished tasks with their logs.")
    return Found(tuple(runs), tuple(notes))


def _of_folder(members: Members, main: str, label: str, notes: list[str]) -> Iterator[Logged]:
    """The runs of one TASKDATA.XML."""
    roots = list(isoxml.roots_of(members, main, label))
    parcels = {one.get("A", ""): _parcel(one) for root in roots for one in root.iter("PFD")}
    values = _values(roots)
    for task, name in _logs(roots):
        try:
            run = _run(members, main, name, values)
        except (FieldError, LogError) as refusal:
            notes.append(f"{name} is left out: {refusal}")
            continue
        parcel = parcels.get(task.get("E", ""))
        if parcel is not None:
            run = replace(run, field=parcel.name, outline=parcel.rings, outline_m2=parcel.area_m2)
        yield replace(run, field=run.field or (task.get("B") or "").strip())


def _logs(roots: list[Element]) -> Iterator[tuple[Element, str]]:
    """Every time log with its task, each once."""
    seen: set[str] = set()
    for task in (one for root in roots for one in root.iter("TSK")):
        for log in task.iter("TLG"):
            name = (log.get("A") or "").strip()
            if name and name not in seen:
                seen.add(name)
                yield task, name


def _run(members: Members, main: str, name: str, values: dict[tuple[str, str], _Value]) -> Logged:
    header, records = members.beside(main, f"{name}.xml"), members.beside(main, f"{name}.bin")
    for content, ending in ((header, "xml"), (records, "bin")):
        if content is None:
            raise LogError(f"{name}.{ending} is not in the folder; copy it whole.")
    log = read_time_log(header or b"", records or b"", name)
    notes = []
    if log.lost_bytes:
        rows = some(len(log.time_s), "record")
        notes.append(f"{some(log.lost_bytes, 'byte')} behind {rows} make no whole record and are left out")
    works = _works(log, notes)
    speed = _speed(log, values)
    time_s = _over_midnight(log.time_s, notes)
    lonlat = np.column_stack([log.lon, log.lat])
    lonlat[log.fix == 0] = np.nan
    run = Logged(
        name, "ISOXML", lonlat, time_s, speed, works, _width_m(log), counters=_counters(log), notes=tuple(notes)
    )  # fmt: skip
    start = float(time_s[0]) if len(time_s) else 0.0
    return replace(cleaned(run), start=moment(start))


def _sections_on(log: TimeLog, notes: list[str]) -> Mask | None:
    """Whether any section is on by the condensed states, two bits a section of which 1 is on; None without them."""
    states = log.values[:, [place for place, (ddi, _) in enumerate(log.columns) if ddi in CONDENSED]]
    if not np.isfinite(states).any():
        return None
    notes.append("at work is where a section is on")
    bits = np.nan_to_num(states).astype(np.int64)
    return np.asarray(np.any([(bits >> shift) & 3 == 1 for shift in range(0, 32, 2)], axis=(0, 2)))


def _over_midnight(time_s: Array, notes: list[str]) -> Array:
    """Times of a terminal that forgets to count the day."""
    back = np.diff(time_s, prepend=time_s[:1]) < -43_200.0
    if back.any():
        notes.append("the day is not counted over midnight; it is here")
    return np.asarray(time_s + 86_400.0 * np.cumsum(back))


def _works(log: TimeLog, notes: list[str]) -> Mask | None:
    """Whether any element of the machine works, else any of its sections; None where none says."""
    places = log.of(WORK_STATE)
    states = log.values[:, places]
    if not np.isfinite(states).any():
        return _sections_on(log, notes)
    if len(places) > 1:
        notes.append(f"{len(places)} elements say whether they work; one that does counts as work")
    return np.asarray((states == 1.0).any(axis=1))


def _speed(log: TimeLog, values: dict[tuple[str, str], _Value]) -> Array | None:
    """The speed in m/s: of the standard, else a value of the maker's own that its device shows as a speed."""
    for place, (ddi, element) in enumerate(log.columns):
        shown = values.get((ddi, element)) or values.get((ddi, ""))
        known = shown is not None and shown.unit in SPEED_UNITS
        if (ddi == SPEED or known) and np.isfinite(log.values[:, place]).any():
            if shown is None or not known:
                return np.asarray(log.values[:, place] * MM)
            return np.asarray((log.values[:, place] + shown.offset) * shown.scale * SPEED_UNITS[shown.unit])
    return None


def _width_m(log: TimeLog) -> float | None:
    """The widest an element was in the median; sections are parts of it."""
    widths = [np.median(column[column > 0]) for column in log.values[:, log.of(WIDTH)].T if (column > 0).any()]
    return float(max(widths)) * MM if widths else None


def _counters(log: TimeLog) -> dict[str, float]:
    """What totals grew by over the log, of several elements' the one that grew most."""
    found = {}
    for name, (ddi, unit) in COUNTED.items():
        grown = [_grown(log.time_s, column * unit, MOST_PER_S[name]) for column in log.values[:, log.of(ddi)].T]
        whole = [one for one in grown if one is not None]
        if whole:
            found[name] = max(whole)
    return found


def _grown(time_s: Array, column: Array, most_per_s: float) -> float | None:
    """The sum of all rises of a total; None where it has no value.

    A total is sent when it changes. One that is first sent later than the first row has risen before: its first value
    counts too where it can have come together since then, and not where it goes on from an earlier log of the task.
    """
    rows = np.flatnonzero(np.isfinite(column))
    if not len(rows):
        return None
    first = float(column[rows[0]])
    new = 0.0 <= first <= most_per_s * (float(time_s[rows[0]] - time_s[0]) + 1.0)
    return float(np.maximum(np.diff(column[rows]), 0.0).sum()) + new * first


def _values(roots: list[Element]) -> dict[tuple[str, str], _Value]:
    """How devices show their values, by DDI and device element; "" stands for any element."""
    found: dict[tuple[str, str], _Value] = {}
    for device in (one for root in roots for one in root.iter("DVC")):
        shown = {one.get("A"): one for one in device.findall("DVP")}
        for each in device.findall("DPD"):
            value = _value(shown.get(each.get("F")))
            if value is None:
                continue
            ddi, key = (each.get("B") or "").upper().zfill(4), each.get("A")
            found.setdefault((ddi, ""), value)
            for element in device.findall("DET"):
                if any(one.get("A") == key for one in element.findall("DOR")):
                    found[(ddi, element.get("A", ""))] = value
    return found


def _value(element: Element | None) -> _Value | None:
    if element is None:
        return None
    try:
        return _Value(float(element.get("B") or 0), float(element.get("C") or 1), (element.get("E") or "").strip())
    except ValueError:
        return None


def _parcel(element: Element) -> _Parcel:
    try:
        area_m2 = float(element.get("D") or "nan")
    except ValueError:
        area_m2 = float("nan")
    name = (element.get("C") or "").strip() or element.get("A", "")
    return _Parcel(name, area_m2 if area_m2 > 0.0 else None, tuple(np.array(ring) for ring in isoxml.rings_of(element)))


FORM = Form("ISOXML", (".xml", ".bin"), _read, lambda names: isoxml.TASKDATA in names)
