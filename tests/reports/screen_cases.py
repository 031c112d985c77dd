"""Rankings, records of many fields and a day made by hand, for tests of the first screen."""

from dataclasses import replace
from typing import Any

from reports.common.plan_records import PullFigures, Shortfall, SlopePlace, UnworkedPiece
from reports.common.plan_results import PlanRanking, PlanResult
from reports.day.results import DayJob, DayResult, FleetDay, UnworkedField
from reports.plan.comparison import ComparedWay, ComparisonRow

HOUR_S = 3600.0
STRATEGIES = ("split-field", "row-by-row-optimised", "interleaved")
REMARK = "bends and starts are worked more slowly than the implement asks for, 40 m in all"
REFUSED = (
    PlanResult("row-by-row", 7, "u", False, "Turning radius 4.10 m needs 8.20 m, rows are 10.00 m apart."),
    PlanResult("interleaved", 9, "u", False, "skipped: by estimate it is slower", bound_s=9000.0, is_simulated=False),
    PlanResult(
        "col-by-col",
        4,
        "u",
        False,
        "machines may come within 0.10 m of each other",
        is_simulated=False,
        keeps_clearance=False,
    ),
)
KNEE_S = {1: 11_916.0, 2: 6_200.0, 3: 4_400.0, 4: 3_900.0, 5: 3_700.0, 6: 3_600.0}
"""By number of tractors: of 4,400 s a fourth saves 500 s, less than half of 1,100 s."""
SURE = {6: 1.0, 5: 1.0, 4: 1.0, 3: 0.999, 2: 0.984, 1: 0.62}
LATE = {6: 0.0, 5: 0.0, 4: 0.0, 3: 0.1, 2: 0.35, 1: 21.0}


def build_plan(rank: int, strategy: str, tractors: int, hours: float, cost: float, **more: Any) -> PlanResult:
    """A plan that can be driven, without samples."""
    values: dict[str, Any] = {
        "turn": "u+switch-back", "feasible": True, "rank": rank, "time_s": HOUR_S * hours, "cost": cost,
        "worked_pct": 98.4, "missed_m2": 639.0, "waiting_s": 34.0, "turning_s": 2312.0, "overlap_pct": 1.2,
        "finished_s": HOUR_S * hours + 102.0, "finished_cost": cost + 2.26, "min_clearance_m": 2.96,
    }  # fmt: skip
    return PlanResult(strategy, tractors, **(values | more))


def add_samples(
    plan: PlanResult, share: float | None, late_cost: float = 0.0, limit_s: float | None = None
) -> PlanResult:
    """The plan with a median a tenth above its simulated time, and so sure to be in time."""
    time_s, cost = plan.time_s or 0.0, plan.cost or 0.0
    half_s, late_s = 1.1 * time_s, 1.3 * time_s
    return replace(
        plan, p50_s=half_s, p80_s=1.2 * time_s, p95_s=late_s, p50_done_s=half_s, p95_done_s=late_s,
        finish_probability=share, finish_probability_interval=None if share is None else (share, share),
        paid_cost=1.05 * cost, expected_cost=1.05 * cost + late_cost,
        meets_deadline=None if limit_s is None else half_s <= limit_s,
    )  # fmt: skip


PLANS = tuple(
    build_plan(3 * place + number + 1, strategy, tractors, (3.31 + 0.1 * number) / tractors, 132.0 + 2 * tractors,
               on_pareto_front=number == 0)
    for place, tractors in enumerate((6, 5, 4, 3, 2, 1))
    for number, strategy in enumerate(STRATEGIES)
)  # fmt: skip
DEFAULT = PlanRanking(
    "denmark", 3.92, 1, (*PLANS, *REFUSED), currency="EUR",
    scenario={"tractor": "Yanmar EG105", "width_m": 3.0, "implement": None, "clearance_m": 0.5},
)  # fmt: skip


KNEE = replace(
    DEFAULT, prices_assumed=True,
    plans=tuple(
        replace(plan, time_s=seconds, finished_s=seconds + 102.0, cost=seconds * plan.tractors / 90.0,
                finished_cost=seconds * plan.tractors / 90.0 + 2.26)
        for plan in PLANS
        for seconds in (KNEE_S[plan.tractors] * 1.03 ** STRATEGIES.index(plan.strategy),)
    ),
)  # fmt: skip


def build_sampled(shares: dict[int, float], late: dict[int, float], limit_s: float | None, **more: Any) -> PlanRanking:
    """The default ranking with samples: by number of tractors how sure and how much for late ground."""
    plans = [add_samples(plan, shares[plan.tractors], late[plan.tractors], limit_s) for plan in PLANS]
    values: dict[str, Any] = {
        "samples": 10_000,
        "late_ground_per_ha": 80.0,
        "start": "13:00",
        "chosen": ("split-field", 2),
    } | more
    return replace(DEFAULT, plans=(*plans, *REFUSED), allowed_s=limit_s, **values)


DEADLINE = build_sampled(SURE, LATE, 4 * HOUR_S, deadline="17:00")
RAIN = replace(
    build_sampled({count: 0.9 - 0.1 / count for count in SURE}, {count: 8.0 / count for count in SURE}, None),
    scenario={**DEFAULT.scenario, "rain": "14:30=20,15:00=50"},
)
LATE_RANKING = build_sampled(dict.fromkeys(SURE, 0.0), dict.fromkeys(SURE, 157.0), 600.0, deadline="13:10",
                             chosen=None, shortfalls=(Shortfall("late"),))  # fmt: skip
REMARKS = (REMARK, "12 m of the headland cannot be reached and are skipped", f"tractor 1 {'waits and ' * 22}goes on")
REMARKED = replace(
    DEADLINE, plans=tuple(replace(plan, remarks=REMARKS) for plan in DEADLINE.plans),
    cut_off=UnworkedPiece(3400.0, 0.0, 0.0),
)  # fmt: skip
WEAK = replace(
    DEADLINE, pull=PullFigures("cultivator", 6.0, 8.0, 15.0, 40.0, 70.0, 90.0, 56.0, 3.7, 4.9, 30.0),
    plans=tuple(replace(plan, remarks=(REMARK,)) for plan in DEADLINE.plans),
)  # fmt: skip
TOO_WEAK = replace(WEAK, pull=replace(WEAK.pull, needed_kw=90.0), shortfalls=(Shortfall("pull"),))
CUT_OFF = replace(
    DEFAULT, plans=tuple(replace(plan, worked_pct=19.7, works_enough=False) for plan in PLANS),
    shortfalls=(Shortfall("worked", "No recommendation: only 19.7 % of the field is worked; 78 % is cut off by "
                                  "obstacles."),),
    prices_assumed=True,
)  # fmt: skip
NONE_WORKS = replace(DEFAULT, plans=REFUSED[:1] * 6)
FUEL = replace(
    DEADLINE,
    plans=tuple(replace(plan, fuel_l=29.6 + plan.tractors, fuel_l_per_ha=(29.6 + plan.tractors) / 3.92,
                        co2_kg=2.65 * (29.6 + plan.tractors), fuel_l_by_tractor=(16.0,) * plan.tractors,
                        steepest_along=SlopePlace(-8.4, 1, 30.0, 40.0, 9.5, 56.2),
                        steepest_across=SlopePlace(5.2, 2, 30.0, 90.0), rollover=SlopePlace(31.0, 1, 30.0, 90.0))
                for plan in DEADLINE.plans),
    ground_sentences=("The soil is loam at 22 % moisture.",),
)  # fmt: skip
RANKINGS = {
    "default": DEFAULT, "knee": KNEE, "fuel": FUEL, "deadline": DEADLINE, "rain": RAIN, "late": LATE_RANKING,
    "remarks": REMARKED, "weak": WEAK, "too weak": TOO_WEAK, "cut off": CUT_OFF, "refused": NONE_WORKS,
}  # fmt: skip


WAY = ComparedWay("auto", None, None, 3.0)


def build_records(count: int = 3) -> list[ComparisonRow]:
    """Records of many fields, the last without a plan."""
    records = [
        ComparisonRow(f"farm.geojson#{number}", WAY, replace(DEADLINE, field_name=f"field {number}"))
        for number in range(1, count)
    ]
    refusal = "Field 'strip' is nowhere wider than the working width of 3 m; use a narrower implement."
    return [*records, ComparisonRow("farm.geojson#strip", WAY, refusal=refusal)]


def build_job(number: int, machine: str, start_h: float, **more: Any) -> DayJob:
    """A job of an hour and a half."""
    start_s = HOUR_S * start_h
    job = DayJob(
        field=f"field {number}", machine=machine, strategy="split-field", tractors=2, area_ha=2.5,
        leaves_s=start_s - 900.0, km=3.0, start_s=start_s, end_s=start_s + 5000.0, time_s=4800.0,
        finish_probability=0.97, finish_probability_interval=(0.965, 0.975), p50_end_s=start_s + 5400.0,
        p95_end_s=start_s + 7000.0, cost=99.5, lost_cost=1.25, worked_pct=99.0, refills=None,
        p50_start_s=start_s + 300.0, p50_leaves_s=start_s - 600.0,
    )  # fmt: skip
    return replace(job, **more)


def build_day(count: int = 3) -> DayResult:
    """A day of so many fields that two fleets work in turn, and one that is skipped."""
    jobs = tuple(build_job(number, ("robots", "Fendts")[number % 2], 8.0 + number) for number in range(count))
    fleets = tuple(
        FleetDay(name, "2 x A, harrow", 8 * HOUR_S, 20 * HOUR_S, 9.0, 12.0, 20 * HOUR_S)
        for name in ("robots", "Fendts")
    )
    left = (UnworkedField("far", 1.0, 80.0, "no fleet has time for it besides the other fields"),)
    return DayResult(
        8 * HOUR_S, 26 * HOUR_S, jobs, left, fleets, 0.0, 104.0 + 100.75 * count, 0.91, "EUR", 1000, 1, "",
        fields=(*(job.field for job in jobs), "far"), windows=((),) * (count + 1),
        p50_done_s=max(job.p50_end_s for job in jobs) + 45.0,
        p95_done_s=max(job.p95_end_s for job in jobs) + 45.0,
    )  # fmt: skip
