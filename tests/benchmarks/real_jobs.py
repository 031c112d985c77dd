"""Plan jobs that were really driven, from boundary, width and working speed, and compare with what was logged.

    python -m tests.benchmarks.real_jobs FOLDER [--width 9]

FOLDER holds ISO 11783-10 task data with time logs (forage harvester jobs of the ISOXML.NET samples, for instance). Each
job is planned for one tractor, harvest, the headland first. Net time is the logged time without stops of `STOP_S` and
more. What one machine and its driver are like is taken from the other jobs alone, so that none helps to predict itself:
how much slower the headland is driven than the rest, one factor on the time, one on the worked distance, and how much
jobs scatter. The tracks are also planned in the order in which the driver took them (driven_order). East-west is
stretched so that the outline has the area that the task data says it has.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from fields.geometry.field import Field
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.farm.random_inputs import UncertaintySettings
from planner.request.plan_request import PlanRequest
from planner.risk.leg_graph import LegGraph, build_leg_graph
from planner.risk.monte_carlo import sample_outcomes
from tests.benchmarks.driven_order import Driven, driven_again, worked
from tests.benchmarks.time_logs import (
    ACTIVE_MM,
    INACTIVE_MM,
    SPEED,
    WIDTH,
    WORK_STATE,
    Parcel,
    TimeLog,
    read_folder,
)
from vehicle.missions.plan import HEADLAND_PASS

STOP_S = 5.0
STANDING_MPS, MOVING_MPS = 0.06, 0.2
SPEED_MPS = 0.1 / 3.6  # unit of the logged speed
EARTH_M = 6_371_008.8
CENTRAL = (0.1, 0.9)
DRAWS = 10_000
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Job:
    """What was measured (seconds, metres, m/s) and what the plan of the same field comes to."""

    name: str
    area_ha: float
    net_s: float
    active_m: float
    inactive_m: float
    ratio: float
    planned_s: float
    rounds_s: float
    planned_active_m: float
    planned_inactive_m: float
    graph: LegGraph
    driven: Driven | None


def stops_s(time_s: Array, speed_mps: Array, least_s: float = STOP_S) -> float:
    """Seconds spent standing for `least_s` and more at a time; both (n,), the speed holds until the next row."""
    still = np.concatenate([[False], speed_mps[:-1] < STANDING_MPS, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    lasts = time_s[edges[1::2]] - time_s[edges[::2]]
    return float(lasts[lasts >= least_s].sum())


def placed(parcel: Parcel, log: TimeLog) -> tuple[shapely.Polygon, Array]:
    """Outline and positions (n, 2) in metres, east-west stretched until the outline has its area."""
    middle = parcel.lonlat.mean(axis=0)
    metres = np.radians(1.0) * EARTH_M * np.array([np.cos(np.radians(middle[1])), 1.0])
    outline, points = (parcel.lonlat - middle) * metres, (np.column_stack([log.lon, log.lat]) - middle) * metres
    stretch = np.array([parcel.area_m2 / shapely.Polygon(outline).area, 1.0])
    return shapely.Polygon(outline * stretch), points * stretch


def measured_job(parcel: Parcel, log: TimeLog, width_m: float) -> Job:
    """Measure one job and plan it."""
    outline, points = placed(parcel, log)
    speed, works = log.values[SPEED] * SPEED_MPS, log.values[WORK_STATE] == 1
    moving = works & (speed > MOVING_MPS)
    working_mps = float(speed[moving].mean())
    field = Field(name=log.name, boundary=outline)
    scenario = PlanRequest(
        field=log.name, width_m=width_m, speed_mps=working_mps, operation="harvest", tractors=(1,),
        strategies=("split-field",),
    )  # fmt: skip
    site = prepare_context(WorkOrder(scenario, field))
    one = simulate_candidate(site, Candidate("split-field", 1))
    if one.run is None or not one.result.feasible or one.result.time_s is None:
        raise SystemExit(f"{log.name}: no plan ({one.result.reason})")
    legs = one.run.plan.missions[0].legs
    outer = outline.difference(outline.buffer(-site.layout.headland_passes * width_m))
    near = shapely.contains_xy(outer, points[:, 0], points[:, 1])
    return Job(
        name=log.name,
        area_ha=parcel.area_m2 / 1e4,
        net_s=float(log.time_s[-1]) - stops_s(log.time_s, speed),
        active_m=log.last(ACTIVE_MM) / 1e3,
        inactive_m=log.last(INACTIVE_MM) / 1e3,
        ratio=float(np.median(speed[moving & near]) / np.median(speed[moving & ~near])),
        planned_s=one.result.time_s,
        rounds_s=sum(leg.length_m for leg in legs if leg.task.kind == HEADLAND_PASS) / working_mps,
        planned_active_m=sum(leg.length_m for leg in legs if leg.implement),
        planned_inactive_m=sum(leg.length_m for leg in legs if not leg.implement),
        graph=build_leg_graph(one.run),
        driven=driven_again(field, scenario, worked(points, log.time_s, moving), ~near[moving]),
    )


def slowed_s(job: Job, ratio: float) -> float:
    """The plan's time with its rounds driven at `ratio` of the working speed."""
    return job.planned_s + job.rounds_s * (1.0 / ratio - 1.0)


def factor(predicted: Array, measured: Array) -> float:
    """The factor on predictions with the least squared relative errors; both (n,)."""
    share = predicted / measured
    return float(share.sum() / (share * share).sum())


def spread(errors: Array) -> float:
    """Deviation of a normal law with the central interval that Student's has for one more of these errors (n,).

    Deviation and mean are known from n others only: the interval of a new value is wider by both.
    """
    from scipy import stats

    count, (_, high) = len(errors), CENTRAL
    widened = math.sqrt(1.0 + 1.0 / count) * float(stats.t.ppf(high, count - 1) / stats.norm.ppf(high))
    return float(np.std(errors, ddof=1)) * widened


@dataclass(frozen=True)
class Prediction:
    """Of one job by the others: net time and its central interval (s), worked distance (m)."""

    net_s: float
    low_s: float
    high_s: float
    active_m: float


def predicted(job: Job, others: list[Job]) -> Prediction:
    """What the plan of a job says once the others have told what this machine and its driver are like."""
    ratio = float(np.median([other.ratio for other in others]))
    plans = np.array([slowed_s(other, ratio) for other in others])
    nets = np.array([other.net_s for other in others])
    scale = factor(plans, nets)
    scatter = spread(np.log(nets / (scale * plans)))
    laws = UncertaintySettings(job_cv=scatter, slip_cv=0.0, stops_per_hour=0.0, breakdown_hours=0.0, start_delay_s=0.0)
    drawn = sample_outcomes(job.graph, laws, samples=DRAWS, seed=1).finish_s / job.planned_s
    middle = scale * slowed_s(job, ratio)
    low, high = np.quantile(drawn / np.median(drawn), CENTRAL) * middle
    lengths = factor(
        np.array([other.planned_active_m for other in others]), np.array([other.active_m for other in others])
    )
    return Prediction(middle, float(low), float(high), lengths * job.planned_active_m)


def report(jobs: list[Job]) -> list[str]:
    """The table and its summary, line by line."""
    lines = [
        "job         ha   net   plan  left out one  error  80 %, min      active  error  inactive   plan",
        "                 min    min           min      %                     km      %        km     km",
    ]
    guesses = [predicted(job, [other for other in jobs if other is not job]) for job in jobs]
    net = np.array([guess.net_s / job.net_s - 1.0 for guess, job in zip(guesses, jobs, strict=True)])
    active = np.array([guess.active_m / job.active_m - 1.0 for guess, job in zip(guesses, jobs, strict=True)])
    inside = [guess.low_s <= job.net_s <= guess.high_s for guess, job in zip(guesses, jobs, strict=True)]
    for job, guess, error, far, good in zip(jobs, guesses, net, active, inside, strict=True):
        lines.append(
            f"{job.name:10s}{job.area_ha:4.2f}{job.net_s / 60:6.1f}{job.planned_s / 60:7.1f}{guess.net_s / 60:14.1f}"
            f"{100 * error:7.1f}{guess.low_s / 60:7.1f} -{guess.high_s / 60:6.1f}{' ' if good else '*'}"
            f"{job.active_m / 1e3:8.2f}{100 * far:7.1f}{job.inactive_m / 1e3:10.2f}{job.planned_inactive_m / 1e3:7.2f}"
        )
    lines += ["", *again(jobs), ""]
    shares = np.array([job.planned_s / job.net_s for job in jobs])
    saved = sum(job.inactive_m - job.planned_inactive_m for job in jobs)
    return [
        *lines,
        f"plan over net, nothing fitted      mean {shares.mean():.2f}, {shares.min():.2f} to {shares.max():.2f}",
        f"net time, left out one at a time   mean error {100 * np.abs(net).mean():.1f} % (target: 7), "
        f"worst {100 * np.abs(net).max():.0f} %",
        f"active distance, in the same way   mean error {100 * np.abs(active).mean():.1f} % (target: 5), "
        f"worst {100 * np.abs(active).max():.0f} %",
        f"inside the central 80 %            {sum(inside)} of {len(jobs)} (* is outside)",
        f"the planned order drives {saved / 1e3:.1f} km less off work than the drivers did, of "
        f"{sum(job.inactive_m for job in jobs) / 1e3:.1f} km: up to the shortest paths, not what a driver may choose",
    ]


def again(jobs: list[Job]) -> list[str]:
    """What the order of the drivers comes to with the planned tractor, beside the planned order of the same tracks."""
    lines = [
        "job       order driven  planned    longer  off work driven  planned    more    of it logged  tracks seen",
        "                   min      min         %               km       km      km              km            %",
    ]
    found = [(job, job.driven) for job in jobs if job.driven is not None]
    for job, one in found:
        lines.append(
            f"{job.name:10s}{one.time_s / 60:12.1f}{one.planned_s / 60:9.1f}"
            f"{100 * (one.time_s / one.planned_s - 1):10.1f}{one.inactive_m / 1e3:17.2f}"
            f"{one.planned_inactive_m / 1e3:9.2f}{(one.inactive_m - one.planned_inactive_m) / 1e3:8.2f}"
            f"{job.inactive_m / 1e3:16.2f}{100 * one.found:13.0f}"
        )
    unlike = [job.name for job, one in found if one.inactive_m > job.inactive_m]
    found = [(job, one) for job, one in found if job.name not in unlike]
    whole, planned = sum(one.time_s for _, one in found), sum(one.planned_s for _, one in found)
    off, least = sum(one.inactive_m for _, one in found), sum(one.planned_inactive_m for _, one in found)
    if not found:
        return lines
    return [
        *lines,
        f"the drivers' orders, same tractor and tracks ({len(found)} of {len(jobs)} jobs): {whole / 3600:.2f} h and "
        f"{off / 1e3:.1f} km off work; planned orders {planned / 3600:.2f} h and {least / 1e3:.1f} km "
        f"({100 * (1 - planned / whole):.1f} % of the time saved); the logs have "
        f"{sum(job.inactive_m for job, _ in found) / 1e3:.1f} km",
        f"not in these sums, as their order drives more off work than was logged, so that passes and tracks do not "
        f"match: {', '.join(unlike) or 'none'}",
    ]


def main() -> None:
    """Read, plan, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--width", type=float, help="working width (m); by default as logged")
    options = parser.parse_args()
    parcels, logs = read_folder(options.folder)
    jobs = [measured_job(parcels[log.field], log, options.width or log.last(WIDTH) / 1e3) for log in logs]
    print("\n".join(report(jobs)))


if __name__ == "__main__":
    main()
