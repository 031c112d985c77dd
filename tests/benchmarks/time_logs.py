"""Time logs of ISO 11783-10 task data, as far as the benchmarks need them: time, position and process data of a job.

A log is a pair of files: the .xml names the values in the order of the .bin, whose records have the time of day (ms),
the day since 1980, position (1e-7 degrees) and the values that changed. Values stand until the next change.
"""

from __future__ import annotations

import struct
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

WIDTH, ACTIVE_MM, INACTIVE_MM, ACTIVE_S, INACTIVE_S = "0043", "0075", "0076", "0077", "0078"
WORK_STATE, SPEED, AREA_M2 = "008D", "EA7E", "0074"
_POSITION = (("A", "i"), ("B", "i"), ("C", "i"), ("D", "B"), ("E", "H"), ("F", "H"), ("G", "B"), ("H", "I"), ("I", "H"))
DAY_MS = 86_400_000


@dataclass(frozen=True, eq=False)
class TimeLog:
    """A job as logged: `time_s` (n,), `lat`, `lon` (n,) in degrees, `values` (n,) by DDI, NaN before the first."""

    name: str
    field: str
    time_s: NDArray[np.float64]
    lat: NDArray[np.float64]
    lon: NDArray[np.float64]
    values: dict[str, NDArray[np.float64]]

    def last(self, ddi: str) -> float:
        """The last value of a counter."""
        return float(self.values[ddi][-1])


@dataclass(frozen=True, eq=False)
class Parcel:
    """A field of the task data: `area_m2` as the file says, `lonlat` (n, 2) of its outline."""

    name: str
    area_m2: float
    lonlat: NDArray[np.float64]


def read_folder(folder: Path) -> tuple[dict[str, Parcel], list[TimeLog]]:
    """Fields by their id, and the logs of tasks that have just one, in the order of their names."""
    root = ElementTree.parse(next(each for each in folder.iterdir() if each.name.upper() == "TASKDATA.XML")).getroot()
    parcels = {each.get("A", ""): _parcel(each) for each in root.iter("PFD")}
    logs = []
    for task in root.iter("TSK"):
        names = [each.get("A", "") for each in task.iter("TLG")]
        if len(names) == 1:
            logs.append(read_log(folder / f"{names[0]}.xml", task.get("E", "")))
    return parcels, sorted(logs, key=lambda log: log.name)


def _parcel(field: ElementTree.Element) -> Parcel:
    outline = next(each for each in field.iter("PLN") if each.get("A") in ("1", "9"))
    ring = next(iter(outline.iter("LSG")))
    points = [(float(each.get("D", "")), float(each.get("C", ""))) for each in ring.iter("PNT")]
    return Parcel(field.get("A", ""), float(field.get("D", "nan")), np.array(points))


def read_log(header: Path, field: str) -> TimeLog:
    """One log; `header` is its .xml file."""
    time = ElementTree.parse(header).getroot()
    position = time.find("PTN")
    form = "<IH" + "".join(kind for key, kind in _POSITION if position is not None and position.get(key) == "")
    names = [each.get("A", "") for each in time.iter("DLV")]
    data, place = header.with_suffix(".bin").read_bytes(), 0
    heads, rows, now = [], [], np.full(len(names), np.nan)
    while place + struct.calcsize(form) < len(data):
        heads.append(struct.unpack_from(form, data, place))
        place += struct.calcsize(form)
        for _ in range(data[place]):
            index, value = struct.unpack_from("<Bi", data, place + 1)
            now[index] = value
            place += 5
        place += 1
        rows.append(now.copy())
    head, table = np.array(heads, dtype=float), np.array(rows)
    seconds = (head[:, 1] * DAY_MS + head[:, 0]) / 1e3
    return TimeLog(
        header.stem, field, seconds - seconds[0], head[:, 2] * 1e-7, head[:, 3] * 1e-7,
        {name: table[:, column] for column, name in enumerate(names)},
    )  # fmt: skip
