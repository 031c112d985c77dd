"""Days that were driven beside days that are planned: python -m tests.benchmarks.campaigns FOLDER

FOLDER holds TASKDATA.XML and time logs (TLG) of ISO 11783-10. Logs of one task are one field; fields that follow one
another within six hours are a campaign. Its end is predicted from the measured time on every field and the changes
between them as `headland day` has them: folding, straight line times road factor at road speed, unfolding. Beside that
stands the end with changes as they were fitted (so long each, so long per metre) on all other campaigns. The order that
was driven is compared with the best by the same ways, from the first field on.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from planner.day.optimization.problem import DayProblem
from planner.day.optimization.solver import solve_day
from planner.farm.settings import FarmTimes
from planner.task_logs.formats.isoxml_logs import parse_time_log

PAUSE_S = 6 * 3600.0
EPOCH = datetime(1980, 1, 1)
METRES_PER_DEGREE = 111_195.0
KMH = 1.0 / 3.6


@dataclass(frozen=True)
class Job:
    """One field as it was driven, or one log of it: first and last moment (seconds since 1980) and place (latitude,
    longitude in degrees)."""

    begins_s: float
    ends_s: float
    first: tuple[float, float]
    last: tuple[float, float]


def read_log(stem: Path) -> Job:
    """A time log from its header (.xml) and records (.bin); raises ValueError for one without positions."""
    log = parse_time_log(stem.with_suffix(".xml").read_bytes(), stem.with_suffix(".bin").read_bytes(), stem.name)
    places = [(float(lat), float(lon)) for lat, lon in zip(log.lat_deg, log.lon_deg, strict=True)]
    if not places or math.isnan(places[0][0] + places[0][1]):
        raise ValueError(f"{stem.name} has no records with positions")
    return Job(float(log.time_s[0]), float(log.time_s[-1]), places[0], places[-1])


def read_jobs(folder: Path) -> list[Job]:
    """All fields of a folder, by time."""
    jobs = []
    for task in ElementTree.parse(folder / "TASKDATA.XML").getroot().iter("TSK"):
        logs = [read_log(folder / str(log.get("A"))) for log in task.iter("TLG")]
        logs.sort(key=lambda log: log.begins_s)
        if logs:
            jobs.append(replace(logs[0], ends_s=logs[-1].ends_s, last=logs[-1].last))
    return sorted(jobs, key=lambda job: job.begins_s)


def campaigns(jobs: Sequence[Job]) -> list[list[Job]]:
    """Jobs parted where nothing was done for long."""
    found: list[list[Job]] = []
    for job in jobs:
        if found and job.begins_s - found[-1][-1].ends_s < PAUSE_S:
            found[-1].append(job)
        else:
            found.append([job])
    return found


def metres(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Straight line between two places that are near one another."""
    north = (b[0] - a[0]) * METRES_PER_DEGREE
    east = (b[1] - a[1]) * METRES_PER_DEGREE * math.cos(math.radians(0.5 * (a[0] + b[0])))
    return math.hypot(north, east)


def change_s(straight_m: float, times: FarmTimes) -> float:
    """Seconds from the end on one field to the beginning on the next."""
    return times.fold_s + times.unfold_s + straight_m * times.road_factor / (times.road_speed_kmh * KMH)


def fitted(others: Sequence[Sequence[Job]]) -> tuple[float, float]:
    """Seconds per change and per metre by least squares on the changes of other campaigns, neither below 0."""
    pairs = [pair for jobs in others for pair in pairwise(jobs)]
    far = np.array([metres(a.last, b.first) for a, b in pairs])
    took = np.array([b.begins_s - a.ends_s for a, b in pairs])
    spread = far - far.mean()
    slope = max(float(spread @ took) / max(float(spread @ spread), 1e-9), 0.0)
    return max(float(took.mean()) - slope * float(far.mean()), 0.0), slope


@dataclass(frozen=True)
class Checked:
    """One campaign: times in seconds. `predicted_s` and `fitted_s` are its length with changes by the planner and as
    fitted elsewhere (None without another campaign), `ways_s` and `best_ways_s` the changes in the order driven and in
    the best order, which is proven within `gap_pct` of the whole."""

    jobs: int
    begins_s: float
    measured_s: float
    on_fields_s: float
    predicted_s: float
    fitted_s: float | None
    ways_s: float
    best_ways_s: float
    gap_pct: float


def check(jobs: Sequence[Job], others: Sequence[Sequence[Job]], times: FarmTimes) -> Checked:
    """A campaign beside its predictions."""
    on_fields = sum(job.ends_s - job.begins_s for job in jobs)
    straight = [metres(a.last, b.first) for a, b in pairwise(jobs)]
    ways = sum(change_s(far, times) for far in straight)
    told = [other for other in others if len(other) > 1]
    each, per_m = fitted(told) if told else (0.0, 0.0)
    best, gap = best_ways_s(jobs, times)
    return Checked(
        len(jobs), jobs[0].begins_s, jobs[-1].ends_s - jobs[0].begins_s, on_fields, on_fields + ways,
        on_fields + sum(each + per_m * far for far in straight) if told else None, ways, best, gap,
    )  # fmt: skip


def best_ways_s(jobs: Sequence[Job], times: FarmTimes) -> tuple[float, float]:
    """Least seconds of changes through all fields from the first on, each entered and left where it was."""
    rest = list(jobs[1:])
    count, whole = len(rest), 1 << 30
    stops = [*rest, jobs[0]]
    moves = tuple(
        tuple(0 if b is jobs[0] or a is b else round(change_s(metres(a.last, b.first), times)) for b in stops)
        for a in stops
    )
    problem = DayProblem(
        work_s=((1,) * count,), work_cost=((0.0,) * count,), skip_cost=(1e6,) * count, value_at_risk=(0.0,) * count,
        windows=(((0, whole),),) * count, travel_s=(moves,),
        travel_cost=(tuple(tuple(float(seconds) for seconds in row) for row in moves),), begin_s=0, home_by_s=whole,
    )  # fmt: skip
    day = solve_day(problem)
    return problem.compute_travel_cost(0, day.routes[0]), day.gap_pct


def clock(seconds: float) -> str:
    """A moment as month, day and time."""
    return f"{EPOCH + timedelta(seconds=seconds):%m-%d %H:%M}"


def lines(found: Sequence[Checked]) -> Iterator[str]:
    """The table."""
    yield (
        f"{'fields':>6} {'begun':>12} {'took h':>7} {'on fields':>9} {'ended':>12} {'predicted':>12} {'off %':>6} "
        f"{'changes fitted':>14} {'off %':>6} {'ways min':>8} {'best':>6} {'gap %':>6}"
    )
    for one in found:
        off = 100.0 * (one.predicted_s / one.measured_s - 1.0)
        end = clock(one.begins_s + one.predicted_s)
        other = "-" if one.fitted_s is None else clock(one.begins_s + one.fitted_s)
        other_off = "-" if one.fitted_s is None else f"{100.0 * (one.fitted_s / one.measured_s - 1.0):.1f}"
        yield (
            f"{one.jobs:6} {clock(one.begins_s):>12} {one.measured_s / 3600.0:7.2f} {one.on_fields_s / 3600.0:9.2f} "
            f"{clock(one.begins_s + one.measured_s):>12} {end:>12} {off:6.1f} {other:>14} {other_off:>6} "
            f"{one.ways_s / 60.0:8.1f} {one.best_ways_s / 60.0:6.1f} {one.gap_pct:6.1f}"
        )


def checks(folder: Path, times: FarmTimes) -> list[Checked]:
    """Every campaign of a folder with two fields or more."""
    found = campaigns(read_jobs(folder))
    return [
        check(jobs, [other for other in found if other is not jobs], times) for jobs in found if len(jobs) > 1
    ]  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    print("\n".join(lines(checks(parser.parse_args().folder, FarmTimes()))))
