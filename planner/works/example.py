"""Task data as a terminal would have logged it of a saved plan: driven slower by a known share, with known stops.

A sample to try imports on without a machine, and for tests a log whose truth is known.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from fields.field import Field
from fields.projection import project
from fields.read import read_field
from planner.errors import HeadlandError, ScenarioError
from planner.showing import Shown, machines_with, show
from planner.works.forms.tlg import DAY_S, FIRST_DAY
from planner.works.metres import WGS84
from planner.works.record import Array, Mask
from vehicle.layout import WORKING
from vehicle.missions import LEAVE

PACE = 0.9
"""Share of the planned speed that the example is driven with."""
STOP_EVERY_S, STOPS_S = 240.0, (12, 20, 35, 60, 90)
"""A stop about this often, and how long they are."""
LAST_S = 3.0  # a log goes on for a moment after the work
START = (date(2026, 5, 4), 8.0 * 3600.0)
COLUMNS = ("0043", "0074", "0075", "0076", "0077", "0078", "008D", "018D")
GOOD_FIX = 4
Numbers = npt.NDArray[np.int64]
DEGREE = 1e-7


@dataclass(frozen=True, eq=False)
class Truth:
    """One tractor's log before it is written: seconds (n,), metres (n, 2), at work (n,), and its stops in seconds."""

    time_s: Array
    xy: Array
    works: Mask
    stops_s: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Example:
    """Files of a TASKDATA folder by name, and the truth of every tractor."""

    files: dict[str, bytes]
    truths: tuple[Truth, ...]
    width_m: float


def example(plan: str | Path, seed: int = 1, pace: float = PACE) -> Example:
    """Task data of a saved plan with a place on the earth, one log per tractor.

    Raises MissionError, ScenarioError, VehicleError: the file holds no such plan.
    """
    shown = show(plan)
    if shown.saved.crs is None:
        raise ScenarioError("The plan is in local metres without a place on the earth, which logs have; plan a field "
                            "in longitude and latitude.")  # fmt: skip
    width = shown.scenario.width_m
    draw = np.random.default_rng(seed)
    truths = tuple(_driven(shown, tractor, draw, pace) for tractor in range(shown.saved.plan.tractors))
    names = [f"TLG{number:05d}" for number in range(1, len(truths) + 1)]
    files = {"TASKDATA.XML": _taskdata(names, shown).encode()}
    for name, truth in zip(names, truths, strict=True):
        lonlat = project(truth.xy + np.array(shown.saved.origin_m), shown.saved.crs, WGS84)
        files[f"{name}.xml"] = _header().encode()
        files[f"{name}.bin"] = records(truth.time_s, lonlat, _values(truth, width))
    return Example(files, truths, width)


def _driven(shown: Shown, tractor: int, draw: np.random.Generator, pace: float) -> Truth:
    """A tractor's run at once a second, slower by `pace`, with stops where nothing else would have it stand."""
    run = shown.run
    legs = run.plan.missions[tractor].legs
    end = float(run.finish_s[tractor])
    stops, due = [], 0.0
    while (due := due + STOP_EVERY_S * float(draw.uniform(0.6, 1.4))) < end:
        stops.append((due, float(draw.choice(STOPS_S))))
    clock = np.arange(0.0, end / pace + sum(lasts for _, lasts in stops) + LAST_S, 1.0)
    planned = clock * pace
    for begins, lasts in stops:  # the clock of the plan stands while the machine does
        at = begins / pace + sum(longer for before, longer in stops if before < begins)
        planned -= pace * np.clip(clock - at, 0.0, lasts)
    rows = np.clip(np.round(planned / float(run.time_s[1] - run.time_s[0])).astype(int), 0, len(run.time_s) - 1)
    implement = np.array([leg.implement and leg.task.kind != LEAVE for leg in legs])
    leg = np.minimum(run.leg(tractor)[rows], len(legs) - 1)
    works = implement[leg] & (run.status(tractor)[rows] == WORKING)
    return Truth(clock, antenna(shown, tractor)[rows], works, tuple(lasts for _, lasts in stops))


def antenna(shown: Shown, tractor: int) -> Array:
    """Where the antenna of a tractor of a plan is (t, 2), metres of the plan."""
    machine, _ = machines_with(shown.saved, shown.scenario)
    x, y, angle = shown.run.poses(tractor).T
    reach = machine.antenna_forward_m - machine.rear_axle_m
    return np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])


def _values(truth: Truth, width_m: float) -> Numbers:
    """Whole numbers (n, len(COLUMNS)) as devices send them: mm, m2, mm, mm, s, s, state, mm/s."""
    steps = np.concatenate([[0.0], np.hypot(*np.diff(truth.xy, axis=0).T)])
    lasts = np.concatenate([[0.0], np.diff(truth.time_s)])
    before = np.concatenate([[False], truth.works[:-1]])
    active, inactive = np.cumsum(steps * before), np.cumsum(steps * ~before)
    speed = np.concatenate([steps[1:], [0.0]])
    table = (
        np.full(len(steps), 1e3 * width_m), active * width_m, 1e3 * active, 1e3 * inactive, np.cumsum(lasts * before),
        np.cumsum(lasts * ~before), truth.works, 1e3 * speed,
    )  # fmt: skip
    return np.asarray(np.rint(np.column_stack(table)), dtype=np.int64)


def records(time_s: Array, lonlat: Array, values: Numbers) -> bytes:
    """The binary file of a time log: a record per row with the values (n, columns) that changed."""
    day = (START[0] - FIRST_DAY).days
    written, before = [], np.full(values.shape[1], -1)
    for seconds, (lon, lat), now in zip(time_s.tolist(), lonlat.tolist(), values, strict=True):
        days, rest = divmod(START[1] + seconds, DAY_S)
        head = struct.pack(
            "<IHiiB", round(1e3 * rest), day + int(days), round(lat / DEGREE), round(lon / DEGREE), GOOD_FIX
        )
        changed = np.flatnonzero(now != before)
        written.append(head + bytes([len(changed)]) + b"".join(struct.pack("<Bi", n, now[n]) for n in changed.tolist()))
        before = now
    return b"".join(written)


def _header() -> str:
    columns = "".join(f'<DLV A="{name}" B="" C="DET-1"/>' for name in COLUMNS)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<TIM A="" D="4"><PTN A="" B="" D=""/>{columns}</TIM>\n'


def _taskdata(names: Sequence[str], shown: Shown) -> str:
    """The main file: the field where it can be read, and a task with a log for every tractor."""
    field = _field(shown)
    parcel = "" if field is None else _parcel(field)
    tasks = "".join(
        f'<TSK A="TSK{number}" B="tractor {number}" E="PFD1" G="4"><TLG A="{name}" C="1"/></TSK>'
        for number, name in enumerate(names, start=1)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<ISO11783_TaskData VersionMajor="4" VersionMinor="3" '
        f'DataTransferOrigin="2">{parcel}{tasks}</ISO11783_TaskData>\n'
    )


def _field(shown: Shown) -> Field | None:
    try:
        return read_field(
            shown.scenario.field, local=shown.scenario.local, crs=shown.scenario.crs, swap=shown.scenario.swap
        )
    except HeadlandError:
        return None


def _parcel(field: Field) -> str:
    rings = [field.boundary.exterior, *field.boundary.interiors]
    lines = ""
    for number, ring in enumerate(rings):
        points = field.to_wgs84([(x, y) for x, y, *_ in ring.coords[:-1]])
        places = "".join(f'<PNT A="2" C="{lat:.9f}" D="{lon:.9f}"/>' for lon, lat in points.tolist())
        lines += f'<LSG A="{1 if number == 0 else 2}">{places}</LSG>'
    name = quoteattr(field.name[:32])
    return f'<PFD A="PFD1" C={name} D="{field.boundary.area:.0f}"><PLN A="1">{lines}</PLN></PFD>'
