"""What a scenario asks to try, and its results in order of merit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from fields.layout import Layout
from planner.candidates.evaluate import Candidate
from planner.describe import cells
from planner.errors import ScenarioError, named
from planner.ground.trampled import TYRE_M
from planner.outlook import advised
from planner.price.cost import account
from planner.refill import carried, supply_words
from planner.scenario import KMH, Scenario, clock
from planner.site import Site
from planner.workday_words import day_words
from reports.results import PlanResult, Ranking, finish_s, quickness
from strategies.registry import STRATEGIES
from vehicle.effects import REST_KEY
from vehicle.tractor import Tractor

SAME_S = 0.05
MOST = 0.5  # of the field taken by a margin: nobody means that
MUCH = 0.25  # of the field taken by a margin, for that to be at fault where no plan works
LEAST_WORKED_PCT = 50.0  # below half of the field a plan does not do what its reader takes it to do


def candidates(scenario: Scenario) -> list[Candidate]:
    """Every combination worth simulating; for one tractor a formation is the plain order of tracks, tried once."""
    tries = []
    for tractors in scenario.tractors:
        names = list(scenario.strategies)
        if tractors == 1:
            formations = [name for name in names if STRATEGIES[name].abreast]
            alone = [name for name in names if not STRATEGIES[name].abreast]
            names = alone or formations[:1]
        tries += [Candidate(name, tractors) for name in names]
    return tries


def rank(site: Site, results: Iterable[PlanResult]) -> Ranking:
    """Order by the time to finish the field, then tractors, then name; infeasible plans last.

    A plan that leaves ground open is charged for it at its own rate: time and hourly cost grow by missed area over
    worked area, what obstacles cut off aside. Plans that leave equal shares open are thus ordered by what was driven.
    Marks the front of that time against count. Raises ScenarioError for a margin that takes most of the field, or much
    where no plan works.
    """
    results = [placed(told(result), site) for result in results]
    check_margin(site, any(result.feasible for result in results))
    feasible = sorted((r for r in results if r.feasible), key=quickness)
    front = _front(feasible)
    ranked = [
        replace(result, rank=place, on_pareto_front=result in front) for place, result in enumerate(feasible, start=1)
    ]
    rest = sorted((r for r in results if not r.feasible), key=lambda r: (r.tractors, r.strategy))
    scenario, field = site.scenario, site.layout.field
    ranking = Ranking(
        field_name=field.name,
        area_ha=field.area_ha,
        seed=scenario.seed,
        plans=(*ranked, *rest),
        start=None if scenario.start_s is None else clock(scenario.start_s),
        before=None if scenario.before_s is None else clock(scenario.before_s),
        allowed_s=scenario.allowed_s,
        assumptions=assumptions(site),
        tractor_effects=tractor_effects(site.tractor),
        scenario=asked(site),
        **_money(site),
        cut_off_m2=field.cut_off_m2,
    )
    return by_the_clock(advised(ranking, site.stakes), site)


def _money(site: Site) -> dict[str, Any]:
    """The currency of a farm, and what its cost is made of."""
    if site.terms is None:
        return {}
    prices = site.terms.prices
    return {"currency": prices.currency, "money": (f"Cost is {account(prices)}.",)}


def by_the_clock(ranking: Ranking, site: Site) -> Ranking:
    """The ranking with the clock of its best plan, as far as there is more of it than field work."""
    day, scenario = site.day, site.scenario
    words = day_words(day, scenario, ranking.best)
    if day is None:
        return replace(ranking, day=words)
    allowed = ranking.allowed_s
    left = None if allowed is None else float(day.work_s(np.array(allowed))) - day.before_s
    start = scenario.told(day.clock_s(day.before_s, begins=True))[:5] or None
    return replace(ranking, day=words, field_start=start, field_allowed_s=left)


def check_margin(site: Site, feasible: bool) -> None:
    """Refuse a margin that takes most of what obstacles leave of the field, or much of it where no plan is feasible."""
    field, margin_m = site.layout.field, site.scenario.margin_m
    left = field.ground.area / field.without_margin_m2
    if left < 1.0 - (MOST if feasible else MUCH):
        why = "less than half of what obstacles leave" if left < 1.0 - MOST else "and no plan works there"
        raise ScenarioError(
            f"The margin ({named('margin_m')}) of {margin_m:g} m leaves {100.0 * left:.0f} % of field '{field.name}', "
            f"{why}; use a smaller margin."
        )


def told(result: PlanResult) -> PlanResult:
    """The result with a remark where it works less of the field than anyone would expect of a plan."""
    if not result.feasible or result.worked_pct is None or result.worked_pct >= LEAST_WORKED_PCT:
        return result
    little = f"works only {result.worked_pct:.0f} % of the field; the rest is headland or between tracks"
    return replace(result, remark=f"{result.remark}; {little}" if result.remark else little)


def placed(result: PlanResult, site: Site) -> PlanResult:
    """The result with longitude and latitude of its largest missed piece where the field has a place on the earth."""
    piece, field = result.largest_missed, site.layout.field
    if piece is None or field.crs is None:
        return result
    ((lon, lat),) = field.to_wgs84([(piece.x_m, piece.y_m)]).tolist()
    return replace(result, largest_missed=replace(piece, lon=lon, lat=lat))


def asked(site: Site) -> dict[str, Any]:
    """The scenario of a ranking as plain values: what was asked for, and what was planned with where that was open."""
    scenario, layout = site.scenario, site.layout
    return {
        "field": layout.field.name,
        "width_m": layout.width_m,
        "headland_m": layout.headland_m,
        "bearing_deg": layout.bearing_deg,
        "tracks": len(layout.tracks),
        "cells": cells(layout),
        "radius_m": site.manner.radius_m,
        "clearance_m": scenario.clearance_m,
        "margin_m": scenario.margin_m,
        "tractor": site.tractor.name,
        "turn": scenario.turn,
        "speed_kmh": scenario.speed_mps / KMH,
        "rounds": layout.rounds,
        "operation": scenario.operation,
        "headland_order": scenario.headland_order,
        "corners": scenario.corners,
        "tracks_only": scenario.tracks_only,
        "turn_speed_kmh": scenario.turning_mps / KMH,
        "price_per_hour": scenario.price_per_hour,
        "price_per_tractor": scenario.price_per_tractor,
        "start": None if scenario.start_s is None else clock(scenario.start_s),
        "before": None if scenario.before_s is None else clock(scenario.before_s),
        "seed": scenario.seed,
        "gnss": scenario.gnss,
        "draws": 0 if site.stakes is None else site.stakes.question.draws,
        "rain": scenario.rain,
        "prefer": scenario.prefer,
        **({} if site.supply is None else carried(site.supply)),
        "budget": scenario.budget,
    }


def _front(feasible: list[PlanResult]) -> list[PlanResult]:
    """Plans than which none is both as quick and as small, and better in one."""
    front: list[PlanResult] = []
    for result in sorted(feasible, key=lambda r: (r.tractors, finish_s(r))):
        if not front or finish_s(result) < finish_s(front[-1]) - SAME_S:
            if front and front[-1].tractors == result.tractors:
                continue
            front.append(result)
    return front


def tractor_effects(tractor: Tractor) -> dict[str, dict[str, float]]:
    """Effects of a tractor file with their values, and the amounts of its rest under "rest" if that is switched on."""
    amounts = {name: dict(setting.value) for name, setting in tractor.effects.items()}
    if tractor.rest is not None and tractor.rest.on:
        amounts[REST_KEY] = dict(tractor.rest.amounts)
    return amounts


def _headland(site: Site) -> str:
    """What becomes of the headland, and from when to when time runs."""
    count = site.layout.rounds
    if not count:
        return (
            "Time runs from the start on the headland to the end of the last track; the headland is left, and charged "
            "like other ground left open."
        )
    plural = "s" if count > 1 else ""
    return (
        f"The headland is worked in {count} round{plural} with {site.scenario.corners} corners, shared by all tractors "
        "before the tracks or after them; time runs from the start to the end of the last track or round."
    )


def _entrance(site: Site) -> tuple[str, ...]:
    """Where the tractors are before and after their work."""
    if site.gate is None:
        return ()
    return (
        "All tractors come in by the entrance, one after another, and leave by it: these ways are driven and timed. "
        "Before and after that they are in nobody's way. Field work is done when the last one sets out for it.",
    )


def _day(site: Site) -> tuple[str, ...]:
    """What of the farm's day counts."""
    day = site.day
    if day is None:
        return ()
    told = ["The clock of the farm counts the same for all tractors: road, unfolding, field work, folding, road."]
    told += [] if day.road_m else ["The road to the field is left out: it has no known length."]
    if day.start_s is None and (day.breaks_s or day.shift_s[1] is not None):
        told.append("Without a start, breaks and shifts of the farm are left out.")
    return tuple(told)


def _bearings(layout: Layout) -> str:
    """The direction of the tracks, or of those of every cell, in words."""
    bearings = [f"{cell.bearing_deg:.0f}" for cell in layout.cells]
    if len(bearings) == 1:
        return f"bearing {bearings[0]} degrees"
    return f"bearings {', '.join(bearings[:-1])} and {bearings[-1]} degrees in {len(bearings)} cells"


def _paid(site: Site) -> str:
    """What is paid for, and until when."""
    scenario = site.scenario
    if site.terms is None:
        hiring = f" and {scenario.price_per_tractor:g} a tractor." if scenario.price_per_tractor else "."
        return f"Every tractor is paid for until the last one is done: {scenario.price_per_hour:g} an hour{hiring}"
    prices = site.terms.prices
    alone = prices.per_hour is None
    until = "until it is done, people until the last is" if alone else "until the last one is done"
    return f"The cost is {account(prices)}; every tractor is paid for {until}."


def assumptions(site: Site) -> tuple[str, ...]:
    """What every plan of a ranking takes for granted, in sentences."""
    manner, layout, tractor = site.manner, site.layout, site.tractor
    kmh = 3.6
    return (
        f"{tractor.name}, implement {layout.width_m:g} m wide, working {manner.tool_m:.1f} m behind the antenna.",
        f"Work at {manner.work_speed_mps * kmh:.3g} km/h, turns at {manner.turn_speed_mps * kmh:.3g} km/h.",
        f"Planned turning radius {manner.radius_m:.2f} m; headland {layout.headland_m:g} m at the ends of "
        f"{len(layout.tracks)} tracks at {_bearings(layout)}.",
        "Outside the field counts the path of the antenna; body and implement may reach over the boundary in turns, "
        "and how long they do is told as the outline outside.",
        "Worked is what the implement passes over while it is down. Ground left open is charged at the plan's own "
        "rate: the time to finish is the time driven times field over worked area, the hourly cost grows alike, and "
        "plans are ranked by it." + (" What obstacles cut off is not charged." if layout.field.cut_off else ""),
        "Trampled is finished ground off the headland that wheels go over while the implement is up; all tyres are "
        f"assumed to be {TYRE_M:g} m wide.",
        _headland(site),
        *_entrance(site),
        *_day(site),
        _paid(site),
        *(() if site.supply is None else supply_words(site.supply)),
        *(("Positions err as those of an RTK receiver do, a few millimetres.",) if site.scenario.gnss else ()),
        *layout.field.remarks,
    )
