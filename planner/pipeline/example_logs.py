"""Example task data: logs as a terminal would have recorded them of a saved plan, with a known pace and known stops.

They serve to try imports without a machine, and as logs with known truth in tests.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from fields.arrays import Flags, Floats, Integers
from fields.geometry.field import Field
from fields.geometry.geodesy import DEGREES_CRS, project
from fields.terrain.point_files import RTK_FIXED
from fields.units import DAY_S
from planner.errors import HeadlandError, RequestError
from planner.evaluation.ground.coverage import locate_antenna
from planner.evaluation.work_order import read_requested_field
from planner.pipeline.outputs.saved_plans import SavedPlanRun, simulate_saved_plan
from planner.task_logs.formats.isoxml_logs import DEGREES_PER_UNIT, TLG_EPOCH
from vehicle.missions.plan import LEAVE
from vehicle.records import WORKING

EXAMPLE_PACE = 0.9
"""Speed of the example as a share of the planned speed."""
STOP_INTERVAL_S, STOP_LENGTHS_S = 240.0, (12, 20, 35, 60, 90)
"""Mean interval of stops, and their possible lengths."""
TRAILING_S = 3.0  # logged after the end of work
START_DATE_AND_S = (date(2026, 5, 4), 8.0 * 3600.0)
DDI_COLUMNS = ("0043", "0074", "0075", "0076", "0077", "0078", "008D", "018D")


@dataclass(frozen=True, eq=False)
class SimulatedLog:
    """The content of one tractor's log: seconds (n,), metres (n, 2), at work (n,), and its stops in seconds."""

    time_s: Floats
    xy: Floats
    is_working: Flags
    stops_s: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class ExampleTaskData:
    """Files of a TASKDATA folder by name, and the true values of every tractor."""

    files: dict[str, bytes]
    truths: tuple[SimulatedLog, ...]
    width_m: float


def simulate_task_data(plan: str | Path, seed: int = 1, pace: float = EXAMPLE_PACE) -> ExampleTaskData:
    """Task data of a saved plan of a georeferenced field, one log per tractor.

    Raises MissionError, RequestError or VehicleError if the file has no such plan.
    """
    saved_run = simulate_saved_plan(plan)
    if saved_run.saved.crs is None:
        raise RequestError(
            "The plan is in local metres, but logs need a place on the earth; plan a field in longitude and latitude."
        )
    width_m = saved_run.request.width_m
    random = np.random.default_rng(seed)
    truths = tuple(_simulate_log(saved_run, tractor, random, pace) for tractor in range(saved_run.saved.plan.tractors))
    names = [f"TLG{number:05d}" for number in range(1, len(truths) + 1)]
    files = {"TASKDATA.XML": _build_task_data(names, saved_run).encode()}
    columns = "".join(f'<DLV A="{name}" B="" C="DET-1"/>' for name in DDI_COLUMNS)
    header = f'<?xml version="1.0" encoding="UTF-8"?>\n<TIM A="" D="4"><PTN A="" B="" D=""/>{columns}</TIM>\n'
    for name, truth in zip(names, truths, strict=True):
        lonlat = project(truth.xy + np.array(saved_run.saved.origin_m), saved_run.saved.crs, DEGREES_CRS)
        files[f"{name}.xml"] = header.encode()
        files[f"{name}.bin"] = encode_records(truth.time_s, lonlat, _build_values(truth, width_m))
    return ExampleTaskData(files, truths, width_m)


def _simulate_log(saved_run: SavedPlanRun, tractor: int, random: np.random.Generator, pace: float) -> SimulatedLog:
    """A tractor's run at 1 Hz, slower by the factor `pace`, with additional stops."""
    run = saved_run.run
    end_s = float(run.finish_s[tractor])
    stops, due_s = [], 0.0
    while (due_s := due_s + STOP_INTERVAL_S * float(random.uniform(0.6, 1.4))) < end_s:
        stops.append((due_s, float(random.choice(STOP_LENGTHS_S))))
    clock_s = np.arange(0.0, end_s / pace + sum(length_s for _, length_s in stops) + TRAILING_S, 1.0)
    plan_time_s = clock_s * pace
    for begin_s, length_s in stops:  # the time of the plan stands still during stops
        log_time_s = begin_s / pace + sum(
            earlier_length_s for earlier_begin_s, earlier_length_s in stops if earlier_begin_s < begin_s
        )
        plan_time_s -= pace * np.clip(clock_s - log_time_s, 0.0, length_s)
    rows = np.clip(np.round(plan_time_s / float(run.time_s[1] - run.time_s[0])).astype(int), 0, len(run.time_s) - 1)
    is_working = find_work_state(saved_run, tractor)[rows]
    places = locate_antenna(run.get_poses(tractor)[rows], saved_run.tractor.guide_m)
    return SimulatedLog(clock_s, places, is_working, tuple(s for _, s in stops))


def find_work_state(saved_run: SavedPlanRun, tractor: int) -> Flags:
    """Whether a tractor of a plan works (t,): with its implement down, and not on its way out."""
    run = saved_run.run
    legs = run.plan.missions[tractor].legs
    is_down = np.array([leg.implement and leg.task.kind != LEAVE for leg in legs])
    leg_numbers = np.minimum(run.get_leg_numbers(tractor), len(legs) - 1)
    return np.asarray(is_down[leg_numbers] & (run.get_statuses(tractor) == WORKING))


def _build_values(truth: SimulatedLog, width_m: float) -> Integers:
    """Integers (n, len(DDI_COLUMNS)) as devices send them: mm, m2, mm, mm, s, s, state, mm/s."""
    steps_m = np.concatenate([[0.0], np.hypot(*np.diff(truth.xy, axis=0).T)])
    durations_s = np.concatenate([[0.0], np.diff(truth.time_s)])
    was_working = np.concatenate([[False], truth.is_working[:-1]])
    active_m, inactive_m = np.cumsum(steps_m * was_working), np.cumsum(steps_m * ~was_working)
    speed_mps = np.concatenate([steps_m[1:], [0.0]])
    table = (
        np.full(len(steps_m), 1e3 * width_m),
        active_m * width_m,
        1e3 * active_m,
        1e3 * inactive_m,
        np.cumsum(durations_s * was_working),
        np.cumsum(durations_s * ~was_working),
        truth.is_working,
        1e3 * speed_mps,
    )
    return np.asarray(np.rint(np.column_stack(table)), dtype=np.int64)


def encode_records(time_s: Floats, lonlat: Floats, values: Integers) -> bytes:
    """The binary file of a time log: a record per row with the changed values (n, columns)."""
    day = (START_DATE_AND_S[0] - TLG_EPOCH.date()).days
    rows, previous = [], np.full(values.shape[1], -1)
    for seconds, (lon, lat), current in zip(time_s.tolist(), lonlat.tolist(), values, strict=True):
        days, second_of_day = divmod(START_DATE_AND_S[1] + seconds, DAY_S)
        head = struct.pack(
            "<IHiiB",
            round(1e3 * second_of_day),
            day + int(days),
            round(lat / DEGREES_PER_UNIT),
            round(lon / DEGREES_PER_UNIT),
            RTK_FIXED,
        )
        changed = np.flatnonzero(current != previous)
        rows.append(
            head + bytes([len(changed)]) + b"".join(struct.pack("<Bi", n, current[n]) for n in changed.tolist())
        )
        previous = current
    return b"".join(rows)


def _build_task_data(names: Sequence[str], saved_run: SavedPlanRun) -> str:
    """The main file: the field if it can be read, and a task with a log for every tractor."""
    try:
        field = read_requested_field(saved_run.request, None)
    except HeadlandError:
        parcel = ""
    else:
        parcel = _build_parcel(field)
    tasks = "".join(
        f'<TSK A="TSK{number}" B="tractor {number}" E="PFD1" G="4"><TLG A="{name}" C="1"/></TSK>'
        for number, name in enumerate(names, start=1)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<ISO11783_TaskData VersionMajor="4" VersionMinor="3" '
        f'DataTransferOrigin="2">{parcel}{tasks}</ISO11783_TaskData>\n'
    )


def _build_parcel(field: Field) -> str:
    rings = [field.boundary.exterior, *field.boundary.interiors]
    lines = ""
    for number, ring in enumerate(rings):
        points = field.to_wgs84([(x, y) for x, y, *_ in ring.coords[:-1]])
        places = "".join(f'<PNT A="2" C="{lat:.9f}" D="{lon:.9f}"/>' for lon, lat in points.tolist())
        lines += f'<LSG A="{1 if number == 0 else 2}">{places}</LSG>'
    name = quoteattr(field.name[:32])
    return f'<PFD A="PFD1" C={name} D="{field.boundary.area:.0f}"><PLN A="1">{lines}</PLN></PFD>'
