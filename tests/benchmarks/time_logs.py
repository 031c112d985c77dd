"""Time logs of ISO 11783-10 task data as the benchmarks need them: every value of a job by its DDI.

Files are read by planner.task_logs; here stand the jobs of a folder with their fields.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from fields.formats.isoxml import read_boundary_rings
from planner.task_logs.formats.isoxml_logs import parse_time_log

WIDTH, ACTIVE_MM, INACTIVE_MM, ACTIVE_S, INACTIVE_S = "0043", "0075", "0076", "0077", "0078"
WORK_STATE, SPEED, AREA_M2 = "008D", "EA7E", "0074"


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
    parcels = {
        each.get("A", ""): Parcel(
            each.get("A", ""), float(each.get("D", "nan")), np.array(read_boundary_rings(each)[0])
        )
        for each in root.iter("PFD")
    }
    logs = []
    for task in root.iter("TSK"):
        names = [each.get("A", "") for each in task.iter("TLG")]
        if len(names) == 1:
            logs.append(read_log(folder / f"{names[0]}.xml", task.get("E", "")))
    return parcels, sorted(logs, key=lambda log: log.name)


def read_log(header: Path, field: str) -> TimeLog:
    """One log; `header` is its .xml file."""
    log = parse_time_log(header.read_bytes(), header.with_suffix(".bin").read_bytes(), header.stem)
    values = {ddi: log.values[:, place] for place, (ddi, _) in enumerate(log.columns)}
    return TimeLog(header.stem, field, log.time_s - log.time_s[0], log.lat_deg, log.lon_deg, values)
