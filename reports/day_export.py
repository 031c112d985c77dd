"""A day as JSON and CSV: fixed keys in a fixed order, six decimals, and null for what does not exist."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

from reports.day_results import DayJob, DayResult
from reports.plain import finite

JOB_KEYS = (
    "field", "machine", "strategy", "tractors", "start_s", "end_s", "finish_probability",
    "finish_probability_interval", "p50_end_s", "p95_end_s", "leaves_s", "km", "time_s", "cost", "lost_cost",
    "area_ha", "worked_pct", "refills",
)  # fmt: skip
NOT_DONE_KEYS = ("field", "area_ha", "cost", "reason")
FLEET_KEYS = ("name", "words", "leaves_s", "home_s", "km", "ways_cost")
CSV_KEYS = (
    "field", "machine", "strategy", "tractors", "start_s", "end_s", "finish_probability", "p50_end_s", "p95_end_s",
    "leaves_s", "km", "time_s", "cost", "lost_cost", "area_ha", "reason",
)  # fmt: skip
_DECIMALS = 6


def day_json(result: DayResult) -> str:
    """The day as JSON text with a trailing newline.

    Keys: ``jobs`` (each with `JOB_KEYS`, fleet after fleet in the order they work), ``not_done`` (`NOT_DONE_KEYS`),
    ``gap_pct``, ``advice``, ``machines`` (`FLEET_KEYS`), ``cost`` (the sum of ``cost`` and ``lost_cost`` of the jobs,
    ``ways_cost`` of the machines and ``cost`` of what is not done), ``finish_probability`` (of all jobs),
    ``currency``, ``draws``, ``seed``, ``start_s``, ``end_s``, ``remarks``, ``certainty_pct`` (null: mean times).
    Times are seconds of the day that begins the work, above 86,400 past midnight.
    """
    content = {
        "jobs": [_job(job) for job in result.jobs],
        "not_done": [{key: getattr(one, key) for key in NOT_DONE_KEYS} for one in result.not_done],
        "gap_pct": result.gap_pct,
        "advice": result.advice,
        "machines": [{key: getattr(one, key) for key in FLEET_KEYS} for one in result.fleets],
        "cost": result.cost,
        "finish_probability": result.all_probability,
        "currency": result.currency,
        "draws": result.draws,
        "seed": result.seed,
        "start_s": result.start_s,
        "end_s": result.end_s,
        "remarks": result.remarks,
        "certainty_pct": result.certainty_pct,
    }
    return json.dumps(finite(content, _DECIMALS), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def day_csv(result: DayResult) -> str:
    """A row per field as CSV text: those that are done fleet after fleet, then those that are left with the reason."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(CSV_KEYS)
    left = [{key: getattr(one, key) for key in NOT_DONE_KEYS} for one in result.not_done]
    for row in (*(_job(job) for job in result.jobs), *left):
        values = (finite(row.get(key), _DECIMALS) for key in CSV_KEYS)
        writer.writerow(["" if value is None else value for value in values])
    return buffer.getvalue()


def _job(job: DayJob) -> dict[str, Any]:
    return {key: getattr(job, key) for key in JOB_KEYS}
