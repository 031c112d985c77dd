"""The study of chapter 6 of the thesis: Tables 6.1 to 6.3 and its claims, under one set of assumptions."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace

from planner.candidates.evaluate import Candidate
from planner.pool import local_pool
from planner.scenario import Scenario
from planner.site import RADIUS_MARGIN, Site, prepare
from planner.tasks import Progress, outcomes, pack
from reports.results import Claim, PlanResult, Study, StudyRow

HEADLAND_M = 10.0
CLEARANCE_M = 0.05  # the thesis keeps none: its tractors need only not touch
COUNTS = (1, 3, 5, 7, 9, 11)
ROW, TIMED, COL, APART = "row-by-row", "row-by-row-optimised", "col-by-col", "split-field"
INCONSISTENT = "the thesis prints the row of Table 6.3 (5 tractors) here; its Table 6.1 gives 25:30 for 3 in formation"


@dataclass(frozen=True)
class Printed:
    """One printed time of the thesis and the candidate it belongs to."""

    table: str
    label: str
    thesis_s: float
    candidate: Candidate
    note: str = ""


def printed() -> tuple[Printed, ...]:
    """Every time printed in Tables 6.1, 6.2 and 6.3."""
    times = (74 * 60 + 35, 25 * 60 + 30, 20 * 60 + 53, 17 * 60 + 25, 12 * 60 + 30, 13 * 60 + 10)
    first = tuple(
        Printed("6.1", "1 tractor" if count == 1 else f"{count} tractors", float(time), Candidate(ROW, count))
        for count, time in zip(COUNTS, times, strict=True)
    )
    return (
        *first,
        Printed("6.2", "in formation", 1253.0, Candidate(ROW, 3), INCONSISTENT),
        Printed("6.2", "separately", 1290.0, Candidate(APART, 3, jump=1), INCONSISTENT),
        Printed("6.3", "row by row", 1253.0, Candidate(ROW, 5)),
        Printed("6.3", "row by row, waiting optimised", 1038.0, Candidate(TIMED, 5)),
        Printed("6.3", "col by col", 1290.0, Candidate(COL, 5)),
    )


def study(*, executor: Executor | None = None, progress: Progress | None = None) -> Study:
    """Simulate every row of the tables and judge the claims; `executor` and `progress` as planner.planning.plan."""
    todo = list(dict.fromkeys([row.candidate for row in printed()] + [Candidate(APART, 1), Candidate(APART, 3)]))
    if executor is None:
        with local_pool(len(todo)) as executor:
            return study(executor=executor, progress=progress)
    asked = Scenario(field="iwamizawa", headland_m=HEADLAND_M, clearance_m=CLEARANCE_M, tracks_only=True)
    site = prepare(replace(asked, strategies=(ROW,)))
    apart = prepare(replace(asked, turn="switch-back"))
    together, separate = pack(site), pack(apart)
    work = [(separate if candidate.jump else together, candidate, False) for candidate in todo]
    results = {todo[index]: one.result for index, one in outcomes(executor, work, progress)}
    tables: dict[str, list[StudyRow]] = {"6.1": [], "6.2": [], "6.3": []}
    for row in printed():
        tables[row.table].append(_row(row, results[row.candidate]))
    return Study({name: tuple(rows) for name, rows in tables.items()}, _claims(results), _assumptions(site))


def _row(row: Printed, result: PlanResult) -> StudyRow:
    time = result.time_s if result.feasible else None
    difference = None if time is None else 100.0 * (time / row.thesis_s - 1.0)
    note = row.note or result.remark or "" if result.feasible else f"not feasible: {result.reason}"
    return StudyRow(row.label, row.candidate.tractors, row.thesis_s, time, difference, note)


def _claims(results: dict[Candidate, PlanResult]) -> tuple[Claim, ...]:
    """Every claim of section 6.3 with its verdict from the simulation."""
    time = {candidate: result.time_s if result.feasible else None for candidate, result in results.items()}
    missing = [candidate for candidate, value in time.items() if value is None]
    if missing:
        names = ", ".join(f"{c.tractors} {c.strategy}" for c in missing)
        return (Claim("all rows can be driven", False, f"not feasible here: {names}"),)
    seconds = {candidate: float(value or 0.0) for candidate, value in time.items()}
    return (
        _faster_with_more(seconds),
        _eleven_slower(seconds),
        _one_cheapest(seconds),
        _one_cheapest_apart(seconds),
        _formation_beats_apart(seconds),
        _optimised_faster(seconds),
        _columns_alike(seconds),
    )


Seconds = dict[Candidate, float]


def _faster_with_more(time: Seconds) -> Claim:
    rows = [time[Candidate(ROW, count)] for count in COUNTS[:-1]]
    why = " > ".join(f"{value:.0f} s" for value in rows)
    holds = rows == sorted(rows, reverse=True)
    return Claim("from 1 to 9 tractors in formation, more tractors are faster", holds, why)


def _eleven_slower(time: Seconds) -> Claim:
    nine, eleven = time[Candidate(ROW, 9)], time[Candidate(ROW, 11)]
    why = f"both need 3 passes; 11 tractors take {eleven:.1f} s, 9 take {nine:.1f} s"
    return Claim("11 tractors are slower than 9", eleven > nine, why)


def _one_cheapest(time: Seconds) -> Claim:
    hours = {count: count * time[Candidate(ROW, count)] / 3600.0 for count in COUNTS}
    why = "tractor-hours in formation: " + ", ".join(f"{count}: {value:.2f}" for count, value in hours.items())
    return Claim("one tractor is cheapest per hectare (formations)", min(hours, key=lambda c: hours[c]) == 1, why)


def _one_cheapest_apart(time: Seconds) -> Claim:
    one, three = time[Candidate(APART, 1)] / 3600.0, 3 * time[Candidate(APART, 3)] / 3600.0
    why = (
        f"tractor-hours with wide turns: 1 alone: {one:.2f}, 3 on separate blocks: {three:.2f}; a block spares the "
        "turns to its neighbours, and driving in from the road is not counted"
    )
    return Claim("one tractor is also cheaper than 3 on separate blocks", one < three, why)


def _formation_beats_apart(time: Seconds) -> Claim:
    together, apart = time[Candidate(ROW, 3)], time[Candidate(APART, 3, jump=1)]
    wide = time[Candidate(APART, 3)]
    why = (
        f"in formation {together:.0f} s, separately with switch-backs {apart:.0f} s; separately, skipping tracks so "
        f"that U-turns fit, {wide:.0f} s"
    )
    return Claim("3 tractors in formation are faster than 3 working separately", together < apart, why)


def _optimised_faster(time: Seconds) -> Claim:
    plain, timed = time[Candidate(ROW, 5)], time[Candidate(TIMED, 5)]
    gain = 100.0 * (1.0 - timed / plain)
    why = f"{timed:.0f} s against {plain:.0f} s: {gain:.1f} % faster (thesis: 17.2 %)"
    return Claim("optimised waiting is at least 10 % faster than row by row", gain >= 10.0, why)


def _columns_alike(time: Seconds) -> Claim:
    row, col = time[Candidate(ROW, 5)], time[Candidate(COL, 5)]
    why = f"{col:.0f} s against {row:.0f} s: {col - row:+.0f} s (thesis: +37 s)"
    return Claim("col by col is within a minute of row by row", abs(col - row) < 60.0, why)


def _assumptions(site: Site) -> tuple[str, ...]:
    manner = site.manner
    return (
        f"Field 270 m x 70 m, implement 3 m, {len(site.layout.tracks)} tracks of {site.layout.tracks[0].length:.0f} m "
        f"evenly spaced over the full width; headlands of {HEADLAND_M:g} m at both ends lie inside the field.",
        f"{site.tractor.name}, 5 km/h on the tracks and in turns, accelerating at "
        f"{site.tractor.speed.max_acceleration_mps2} m/s2, {site.tractor.speed.shift_time_s} s to shift; planned "
        f"turning radius {manner.radius_m:.2f} m ({RADIUS_MARGIN:g} times that of full lock on soil).",
        f"Triangle of rows {manner.gap_m:g} m apart; followers keep the distance by Eq. 6.1.",
        f"The implement works {manner.tool_m:.1f} m behind the antenna: lifted and lowered at the headland line.",
        "Rows queue inside their tracks, the first 10 m before the headland line, and move up when the place in front "
        "is free. Row by row: released when the row before is at its place in formation. Col by col: released when the "
        "tractor before has finished its turn; the side the turn leads to goes before the other.",
        "Optimised: releases by constraint programming over the time each simulated turn occupies a stretch of "
        "headland, then simulated again; accepted without contact only.",
        "Separately: a block of 8 neighbouring tracks each, one after another with switch-backs, as the thesis says.",
        "Time runs from standstill on the headland until the last tractor has left its last track; nobody drives in "
        "from the road. No GNSS error.",
    )

