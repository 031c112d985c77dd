"""The study of chapter 6 of the thesis: Tables 6.1 to 6.3 and its claims, under one set of assumptions."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import replace

import reports.plan.notebook  # noqa: F401  # how a study is shown
from planner.evaluation.candidates.evaluate import Candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import create_executor
from planner.pipeline.worker_tasks import Progress, group_candidates, iter_outcomes, pack_context
from planner.request.plan_request import MIN_CLEARANCE_M, PlanRequest
from reports.common.plan_results import PlanResult
from reports.trials.report import FleetStudy, ThesisClaim, ThesisTableRow
from vehicle.model.tractor import RADIUS_FACTOR

HEADLAND_M = 10.0
TRACTOR_COUNTS = (1, 3, 5, 7, 9, 11)
ROW_BY_ROW, OPTIMISED_ROWS = "row-by-row", "row-by-row-optimised"
COLUMN_BY_COLUMN, SPLIT_FIELD = "col-by-col", "split-field"
INCONSISTENT_NOTE = (
    "the thesis prints the row of Table 6.3 (5 tractors) here; its Table 6.1 gives 25:30 for 3 in formation"
)
ORDER_NOTE = (
    "tracks of a block are worked in the quickest order, where the thesis takes one after another with switch-backs"
)


def list_thesis_times() -> tuple[tuple[str, str, float, Candidate, str], ...]:
    """Every time printed in Tables 6.1, 6.2 and 6.3: table, label, seconds, the candidate it belongs to, and a note."""
    times = (74 * 60 + 35, 25 * 60 + 30, 20 * 60 + 53, 17 * 60 + 25, 12 * 60 + 30, 13 * 60 + 10)
    return (
        *(
            ("6.1", "1 tractor" if count == 1 else f"{count} tractors", float(time), Candidate(ROW_BY_ROW, count), "")
            for count, time in zip(TRACTOR_COUNTS, times, strict=True)
        ),
        ("6.2", "in formation", 1253.0, Candidate(ROW_BY_ROW, 3), INCONSISTENT_NOTE),
        ("6.2", "separately", 1290.0, Candidate(SPLIT_FIELD, 3), f"{INCONSISTENT_NOTE}; {ORDER_NOTE}"),
        ("6.3", "row by row", 1253.0, Candidate(ROW_BY_ROW, 5), ""),
        ("6.3", "row by row, waiting optimised", 1038.0, Candidate(OPTIMISED_ROWS, 5), ""),
        ("6.3", "col by col", 1290.0, Candidate(COLUMN_BY_COLUMN, 5), ""),
    )


def study(*, executor: Executor | None = None, progress: Progress | None = None) -> FleetStudy:
    """Simulate every row of the thesis's Tables 6.1 to 6.3 and judge its claims.

    Example:

        result = headland.study()           # some minutes
        result.claims[0].holds             # whether the simulation confirms it
        result.to_pandas()                 # a row per printed time: thesis_s, time_s, difference_pct

    `executor` and `progress` are as in `planner.plan`. Returns a FleetStudy: `tables`, `claims`, `assumptions`.
    """
    printed = list_thesis_times()
    candidates = list(dict.fromkeys([*(candidate for *_, candidate, _ in printed), Candidate(SPLIT_FIELD, 1)]))
    if executor is None:
        with create_executor(len(group_candidates(candidates))) as executor:
            return study(executor=executor, progress=progress)
    # The thesis keeps no clearance: its tractors must only not touch.
    request = PlanRequest(field="iwamizawa", headland_m=HEADLAND_M, clearance_m=MIN_CLEARANCE_M, no_headland=True)
    context = prepare_context(WorkOrder(replace(request, strategies=(ROW_BY_ROW,))))
    outcomes = iter_outcomes(executor, pack_context(context), candidates, progress)
    results = {candidates[index]: one.result for index, one in outcomes}
    tables: dict[str, list[ThesisTableRow]] = {"6.1": [], "6.2": [], "6.3": []}
    for table, label, thesis_s, candidate, note in printed:
        result = results[candidate]
        time = result.time_s if result.feasible else None
        difference = None if time is None else 100.0 * (time / thesis_s - 1.0)
        note = note or result.remark or "" if result.feasible else f"not feasible: {result.reason}"
        tables[table].append(ThesisTableRow(label, candidate.tractors, thesis_s, time, difference, note))
    return FleetStudy(
        {name: tuple(rows) for name, rows in tables.items()}, _judge_claims(results), _list_assumptions(context)
    )


def _judge_claims(results: dict[Candidate, PlanResult]) -> tuple[ThesisClaim, ...]:
    """Every claim of section 6.3 with its verdict from the simulation."""
    time = {candidate: result.time_s if result.feasible else None for candidate, result in results.items()}
    missing = [candidate for candidate, value in time.items() if value is None]
    if missing:
        names = ", ".join(f"{c.tractors} {c.strategy}" for c in missing)
        return (ThesisClaim("all rows can be driven", False, f"not feasible here: {names}"),)
    seconds = {candidate: float(value or 0.0) for candidate, value in time.items()}
    rows = {count: seconds[Candidate(ROW_BY_ROW, count)] for count in TRACTOR_COUNTS}
    hours = {count: count * row_s / 3600.0 for count, row_s in rows.items()}
    up_to_nine = [rows[count] for count in TRACTOR_COUNTS[:-1]]
    alone, apart = seconds[Candidate(SPLIT_FIELD, 1)], seconds[Candidate(SPLIT_FIELD, 3)]
    alone_h, apart_h = alone / 3600.0, 3 * apart / 3600.0
    plain, timed, col = rows[5], seconds[Candidate(OPTIMISED_ROWS, 5)], seconds[Candidate(COLUMN_BY_COLUMN, 5)]
    gain_pct = 100.0 * (1.0 - timed / plain)
    return (
        ThesisClaim(
            "from 1 to 9 tractors in formation, more tractors are faster",
            up_to_nine == sorted(up_to_nine, reverse=True),
            " > ".join(f"{value:.0f} s" for value in up_to_nine),
        ),
        ThesisClaim(
            "11 tractors are slower than 9",
            rows[11] > rows[9],
            f"both need 3 passes; 11 tractors take {rows[11]:.1f} s, 9 take {rows[9]:.1f} s",
        ),
        ThesisClaim(
            "one tractor is cheapest per hectare (formations)",
            min(hours, key=lambda count: hours[count]) == 1,
            "tractor-hours in formation: " + ", ".join(f"{count}: {value:.2f}" for count, value in hours.items()),
        ),
        ThesisClaim(
            "one tractor is also cheaper than 3 on separate blocks",
            alone_h < apart_h,
            f"tractor-hours with wide turns: 1 alone: {alone_h:.2f}, 3 on separate blocks: {apart_h:.2f}; separate "
            "blocks need no turns between them, and driving in from the road is not counted",
        ),
        ThesisClaim(
            "3 tractors in formation are faster than 3 working separately",
            rows[3] < apart,
            f"in formation {rows[3]:.0f} s, separately {apart:.0f} s; {ORDER_NOTE}",
        ),
        ThesisClaim(
            "optimised waiting is at least 10 % faster than row by row",
            gain_pct >= 10.0,
            f"{timed:.0f} s against {plain:.0f} s: {gain_pct:.1f} % faster (thesis: 17.2 %)",
        ),
        ThesisClaim(
            "col by col is within a minute of row by row",
            abs(col - plain) < 60.0,
            f"{col:.0f} s against {plain:.0f} s: {col - plain:+.0f} s (thesis: +37 s)",
        ),
    )


def _list_assumptions(context: PlanningContext) -> tuple[str, ...]:
    driving_rules, swaths, speed = context.driving_rules, context.layout.swaths, context.tractor.speed
    return (
        f"Field 270 m x 70 m, implement 3 m, {len(swaths)} tracks of {swaths[0].length_m:.0f} m evenly spaced over the "
        f"full width; headlands of {HEADLAND_M:g} m at both ends lie inside the field.",
        f"{context.tractor.name}, 5 km/h on the tracks and in turns, accelerating at "
        f"{speed.max_acceleration_mps2} m/s2, {speed.shift_time_s} s to shift; planned "
        f"turning radius {driving_rules.radius_m:.2f} m ({RADIUS_FACTOR:g} times that of full lock on soil).",
        f"Triangle of rows {driving_rules.gap_m:g} m apart; followers keep the distance by Eq. 6.1.",
        f"The implement works {driving_rules.tool_m:.1f} m behind the antenna: lifted and lowered at the headland "
        "line.",
        "Rows queue inside their tracks, the first 10 m before the headland line, and move up when the place in front "
        "is free. Row by row: released when the row before is at its place in formation. Col by col: released when the "
        "tractor before has finished its turn; the side the turn leads to goes before the other.",
        "Optimised: nobody queues; the scheduler of the plan lets each tractor leave as soon as its way is clear.",
        "Separately: a block of neighbouring tracks each, in the quickest order.",
        "Time runs from standstill on the headland until the last tractor has left its last track; nobody drives in "
        "from the road. No GNSS error.",
    )
