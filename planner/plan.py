"""All candidates of a scenario, simulated on all cores, ranked."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from planner.evaluate import Candidate
from planner.pool import evaluated
from planner.scenario import Scenario, clock
from planner.site import Site, prepare
from reports.results import PlanResult, Ranking
from strategies.registry import STRATEGIES
from vehicle.effects import REST_KEY
from vehicle.tractor import Tractor

Progress = Callable[[int, int], None]
SAME_S = 0.05


def candidates(scenario: Scenario) -> list[Candidate]:
    """Every combination worth simulating; for one tractor a formation is the plain order of tracks, tried once."""
    found = []
    for tractors in scenario.tractors:
        names = list(scenario.strategies)
        if tractors == 1:
            formations = [name for name in names if STRATEGIES[name].abreast]
            alone = [name for name in names if not STRATEGIES[name].abreast]
            names = alone or formations[:1]
        found += [Candidate(name, tractors) for name in names]
    return found


def plan(scenario: Scenario, *, processes: int | None = None, progress: Progress | None = None) -> tuple[Site, Ranking]:
    """Simulate and rank all candidates; the result does not depend on the number of processes.

    Raises the refusals of planner.errors for a scenario that cannot be planned at all.
    """
    site = prepare(scenario)
    todo = candidates(scenario)
    results = []
    for result in evaluated([(site, candidate) for candidate in todo], processes):
        results.append(result)
        if progress:
            progress(len(results), len(todo))
    return site, rank(site, results)


def rank(site: Site, results: Iterable[PlanResult]) -> Ranking:
    """Order by time, then tractors, then name; infeasible plans last. Marks the front of time against count."""
    results = list(results)
    feasible = sorted(
        (r for r in results if r.feasible), key=lambda r: (round(r.time_s or 0.0, 3), r.tractors, r.strategy)
    )
    front = _front(feasible)
    ranked = [
        replace(result, rank=place, on_pareto_front=result in front) for place, result in enumerate(feasible, start=1)
    ]
    rest = sorted((r for r in results if not r.feasible), key=lambda r: (r.tractors, r.strategy))
    scenario, field = site.scenario, site.layout.field
    return Ranking(
        field_name=field.name,
        area_ha=field.area_ha,
        seed=scenario.seed,
        plans=(*ranked, *rest),
        start=None if scenario.start_s is None else clock(scenario.start_s),
        before=None if scenario.before_s is None else clock(scenario.before_s),
        allowed_s=scenario.allowed_s,
        assumptions=assumptions(site),
        tractor_effects=tractor_effects(site.tractor),
    )


def _front(feasible: list[PlanResult]) -> list[PlanResult]:
    """Plans than which none is both as quick and as small, and better in one."""
    front: list[PlanResult] = []
    for result in sorted(feasible, key=lambda r: (r.tractors, r.time_s or 0.0)):
        if not front or (result.time_s or 0.0) < (front[-1].time_s or 0.0) - SAME_S:
            if front and front[-1].tractors == result.tractors:
                continue
            front.append(result)
    return front


def tractor_effects(tractor: Tractor) -> dict[str, dict[str, float]]:
    """Effects of a tractor file with their values, and the amounts of its rest under "rest" if that is switched on."""
    found = {name: dict(setting.value) for name, setting in tractor.effects.items()}
    if tractor.rest is not None and tractor.rest.on:
        found[REST_KEY] = dict(tractor.rest.amounts)
    return found


def assumptions(site: Site) -> tuple[str, ...]:
    """What every plan of a ranking takes for granted, in sentences."""
    manner, layout, tractor = site.manner, site.layout, site.tractor
    kmh = 3.6
    return (
        f"{tractor.name}, implement {layout.width_m:g} m wide, working {manner.tool_m:.1f} m behind the antenna.",
        f"Work at {manner.work_speed_mps * kmh:.3g} km/h, turns at {manner.turn_speed_mps * kmh:.3g} km/h.",
        f"Planned turning radius {manner.radius_m:.2f} m; headland {layout.headland_m:g} m at the ends of "
        f"{len(layout.tracks)} tracks at bearing {layout.bearing_deg:.0f} degrees.",
        "Outside the field counts the path of the antenna; body and implement may reach over the boundary in turns.",
        "Time runs from the start on the headland to the end of the last track; the headland itself is left for a "
        "last round, which is not counted.",
        f"Every tractor is paid for until the last one is done: {site.scenario.price_per_hour:g} an hour"
        + (f" and {site.scenario.price_per_tractor:g} a tractor." if site.scenario.price_per_tractor else "."),
        *(("Positions err as those of an RTK receiver do, a few millimetres.",) if site.scenario.gnss else ()),
    )
