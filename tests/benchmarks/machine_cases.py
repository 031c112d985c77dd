"""Cases of the benchmark of machines: a machine on a field, planned for one tractor and for a formation of two."""

import time
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from fields.geometry.field import Field
from fields.units import MPS_PER_KMH
from planner.errors import HeadlandError
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import find_contact_places, measure_overhang
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.planning import PlanningResult, plan
from planner.request.plan_request import PlanRequest
from tests.benchmarks.machine_fields import Condition, build_field, measure_fit
from tests.planner.excursions import measure_excursion_m
from vehicle.datasheet.build import build_tractor
from vehicle.datasheet.sheet import Datasheet
from vehicle.missions.run import SimulationRun, find_longest_reversing
from vehicle.model.tractor import RADIUS_FACTOR, Tractor, load_tractor
from vehicle.records import REC_SPEED

SOLO, FORMATION = "row-by-row-optimised", "row-by-row"
FORMATION_TRACTORS = 2
DATASHEETS: Mapping[str, Datasheet] = {
    "r55": Datasheet(wheelbase_m=2.65, width_m=2.5, turning_radius_m=5.5, mass_kg=7000.0),
    "r70": Datasheet(wheelbase_m=3.0, width_m=2.9, turning_radius_m=7.0, mass_kg=11000.0),
}
"""Tractors of 100 and 200 kW by their turning radius: 5.5 and 7.0 m."""
TRACTORS = ("eg105", *DATASHEETS)


@dataclass(frozen=True)
class Machine:
    """A working width at a speed behind a tractor, and its operation."""

    key: str
    width_m: float
    speed_kmh: float
    tractor: str
    operation: str = "till"

    @property
    def name(self) -> str:
        """Key and tractor, as in the names of cases."""
        return f"{self.key}@{self.tractor}"


REFERENCE = Machine("3m5", 3.0, 5.0, "eg105")
MACHINES = (
    Machine("3m", 3.0, 15.0, "eg105"),
    Machine("4m", 4.0, 12.0, "eg105", "sow"),
    Machine("6m", 6.0, 10.0, "r55"),
    Machine("9m", 9.0, 7.0, "r70", "harvest"),
    Machine("12m", 12.0, 12.0, "r70", "sow"),
    Machine("24m", 24.0, 10.0, "r55", "spray"),
    Machine("36m", 36.0, 14.0, "r70", "spray"),
)
"""Ordinary machines, each with the tractor that usually pulls it."""


@dataclass
class Row:
    """What came of a case. Of the formation only feasibility, reason, place and share worked are kept.

    `cpu_s` is of the context and the plan of one tractor, `reference_cpu_s_per_km` that of 3 m at 5 km/h on the same
    field. `fits` and `is_wide` say whether a plan and a formation are asked for. `where` and `formation_where` hold the
    places of faults as sentences, `crash` the last line of a traceback.
    """

    case: str
    parcel: str
    area_ha: float
    machine: str
    condition: str
    fits: bool
    is_wide: bool
    across_m: float
    reachable_pct: float
    feasible: bool = False
    reason: str | None = None
    crash: str | None = None
    where: tuple[str, ...] = ()
    remark: str | None = None
    worked_pct: float | None = None
    time_s: float | None = None
    driven_km: float | None = None
    cpu_s: float = 0.0
    reference_cpu_s_per_km: float | None = None
    excursion_m: float | None = None
    overhang_m: float | None = None
    longest_reverse_m: float | None = None
    formation_feasible: bool | None = None
    formation_reason: str | None = None
    formation_where: tuple[str, ...] = ()
    formation_worked_pct: float | None = None

    @property
    def worked_of_reachable_pct(self) -> float | None:
        """Worked share of what the bar can reach, at most 100, as bent paths work more; None without a run."""
        if self.worked_pct is None:
            return None
        return min(100.0, 100.0 * self.worked_pct / self.reachable_pct) if self.reachable_pct else 100.0

    @property
    def cpu_ratio(self) -> float | None:
        """CPU per simulated kilometre against that of the reference; None without either."""
        if not self.driven_km or not self.reference_cpu_s_per_km:
            return None
        return self.cpu_s / self.driven_km / self.reference_cpu_s_per_km

    def to_values(self) -> dict[str, Any]:
        """Plain values, for a file."""
        return asdict(self) | {"cpu_ratio": self.cpu_ratio}


@cache
def get_tractor(key: str) -> Tractor:
    """A tractor of TRACTORS."""
    return build_tractor(key, DATASHEETS[key]) if key in DATASHEETS else load_tractor(key)


def build_request(machine: Machine, tractors: int = 1) -> PlanRequest:
    """The request of a machine."""
    return PlanRequest(
        width_m=machine.width_m,
        speed_mps=machine.speed_kmh * MPS_PER_KMH,
        operation=machine.operation,
        tractors=(tractors,),
    )


def run_case(
    parcel: Field, condition: Condition, machine: Machine, seed: int, with_formation: bool, reference: float | None
) -> Row:
    """Plan one machine on a parcel under a condition; a refusal is recorded, and so is any other exception."""
    field = build_field(parcel, condition, seed)
    return plan_field(field, f"{parcel.name}:{machine.name}:{condition}", machine, condition, with_formation, reference)


def plan_field(
    field: Field, case: str, machine: Machine, condition: Condition, with_formation: bool, reference: float | None
) -> Row:
    """Plan one machine on a field, with one tractor and, where there is room, with a formation of two."""
    radius_m = RADIUS_FACTOR * get_tractor(machine.tractor).compute_smallest_radius_m(field.default_ground)
    fit = measure_fit(field, machine.width_m, radius_m)
    row = Row(
        case=case,
        parcel=field.name,
        area_ha=round(field.area_ha, 2),
        machine=machine.name,
        condition=str(condition),
        fits=fit.fits,
        is_wide=fit.is_wide,
        across_m=round(fit.across_m, 1),
        reachable_pct=round(fit.reachable_pct, 2),
        reference_cpu_s_per_km=reference,
    )
    begun = time.process_time()
    try:
        _plan_row(row, field, machine, with_formation and fit.is_wide)
    except HeadlandError as refusal:
        row.reason = str(refusal)
    except Exception as fault:
        last = traceback.extract_tb(fault.__traceback__)[-1]
        row.crash = f"{type(fault).__name__}: {fault} ({last.filename.rsplit('/', 1)[-1]}:{last.lineno})"
    row.cpu_s = row.cpu_s or time.process_time() - begun
    return row


def _plan_row(row: Row, field: Field, machine: Machine, with_formation: bool) -> None:
    """Plan as a user would; a plan that is refused all the same is driven once more to say where."""
    begun = time.process_time()
    answer = _plan(field, machine, SOLO, 1)
    row.cpu_s = time.process_time() - begun
    result, context, run = answer.ranking.plans[0], answer.context, answer.run
    row.feasible, row.reason, row.remark = result.feasible, result.reason, result.remark
    row.worked_pct, row.time_s = result.worked_pct, result.time_s
    if run is not None:
        paths = (run.get_poses(tractor)[:, :2] for tractor in range(run.plan.tractors))
        row.driven_km = sum(float(np.hypot(*np.diff(path, axis=0).T).sum()) for path in paths) / 1000.0
        row.longest_reverse_m = find_longest_reversing(run)[0]
        row.excursion_m, row.overhang_m = measure_excursion_m(run, context), measure_overhang(run, context).farthest_m
    else:
        row.where = _locate_faults(context, SOLO, 1)
    if with_formation:
        answer = _plan(field, machine, FORMATION, FORMATION_TRACTORS)
        result = answer.ranking.plans[0]
        row.formation_feasible, row.formation_reason = result.feasible, result.reason
        row.formation_worked_pct = result.worked_pct
        if not result.feasible:
            row.formation_where = _locate_faults(answer.context, FORMATION, FORMATION_TRACTORS)


def _plan(field: Field, machine: Machine, strategy: str, tractors: int) -> PlanningResult:
    """One candidate planned in this process."""
    request = replace(build_request(machine, tractors), strategies=(strategy,))
    return plan(request, field=field, tractor=get_tractor(machine.tractor), executor=SerialExecutor())


def _locate_faults(context: PlanningContext, strategy: str, tractors: int) -> tuple[str, ...]:
    """Where a plan fails before any repair of the layout; nothing where it cannot be driven at all."""
    run = simulate_candidate(context, Candidate(strategy, tractors)).run
    return () if run is None else tuple(iter_faults(run, context))


def iter_faults(run: SimulationRun, context: PlanningContext) -> Iterator[str]:
    """Of each kind of fault the deepest: what happens there, on which leg, and at what speed."""
    deepest = {place.kind: place for place in sorted(find_contact_places(run, context), key=lambda one: one.depth_m)}
    for place in deepest.values():
        middles = run.get_poses(place.tractor)[:, :2]
        row = int(np.argmin(np.hypot(*(middles - (place.x_m, place.y_m)).T)))
        number = int(run.get_leg_numbers(place.tractor)[row])
        leg, speed_mps = run.plan.missions[place.tractor].legs[number], run.record[row, place.tractor, REC_SPEED]
        way, tool = "reverse" if leg.gear < 0 else "forward", "working" if leg.implement else "lifted"
        yield (
            f"{place.sentence}: tractor {place.tractor + 1} leg {number} ({leg.task.kind}, {way}, {tool}) at "
            f"({place.x_m:.1f}, {place.y_m:.1f}), {3.6 * speed_mps:.1f} of {3.6 * leg.speed_mps:.1f} km/h"
        )
