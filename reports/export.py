"""Results as JSON and CSV: fixed keys in a fixed order, six decimals, and null for what does not exist."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

from reports.plain import finite
from reports.results import PlanResult, Ranking, Study, StudyRow
from reports.wording import clearance

PLAN_KEYS = (
    "rank",
    "strategy",
    "tractors",
    "turn",
    "time_s",
    "tractor_time_s",
    "cost",
    "meets_deadline",
    "feasible",
    "worked_pct",
    "overlap_pct",
    "missed_m2",
    "largest_missed",
    "finished_s",
    "finished_cost",
    "trampled_m2",
    "outside_m",
    "excursion_m",
    "outside_outline_m",
    "turning_s",
    "waiting_s",
    "reversals",
    "min_clearance_m",
    "collisions",
    "order_gap_pct",
    "formation_pct",
    "reason",
    "on_pareto_front",
    "remark",
    "rounds",
    "headland_s",
    "transport_s",
    "ready_s",
    "done_s",
    "home_s",
    "finish_probability",
    "finish_probability_interval",
    "p50_s",
    "p80_s",
    "p95_s",
    "expected_cost",
    "paid_cost",
    "bound_s",
    "refills",
    "refilling_s",
)
INTERVAL_KEYS = ("low", "high")
PIECE_KEYS = ("m2", "lon", "lat", "x_m", "y_m")
CSV_KEYS = ("field", "width_m", "headland_m", "bearing_deg", "price_per_hour", "price_per_tractor")
DECIMALS = 6


def ranking_json(ranking: Ranking) -> str:
    """The ranking as JSON text with a trailing newline.

    Keys: ``field`` (``name``, ``area_ha``), ``seed``, ``plans`` (each with `PLAN_KEYS` and ``cells``, in the order of
    the ranking), ``best`` (one of them, or null), ``tractor_effects`` (values by id of the effects in the tractor file,
    the amounts of its rest under ``rest``), ``scenario`` (what was asked, by parameter), ``advice`` (a sentence),
    ``currency`` and ``draws``, ``unmet`` (a sentence where no plan meets the rain or the budget). Figures that are
    missing or not finite are null.
    """
    best = ranking.best
    return _text(
        {
            "field": {"name": ranking.field_name, "area_ha": ranking.area_ha},
            "seed": ranking.seed,
            "plans": [_with_cells(plan, ranking) for plan in ranking.plans],
            "best": None if best is None else _with_cells(best, ranking),
            "tractor_effects": ranking.tractor_effects,
            "scenario": ranking.scenario,
            "advice": ranking.advice,
            "currency": ranking.currency,
            "draws": ranking.draws,
            "unmet": ranking.unmet,
        }
    )


def _with_cells(plan: PlanResult, ranking: Ranking) -> dict[str, Any]:
    """An entry of a plan with the ``cells`` that its tracks lie in."""
    return {**plan_entry(plan), "cells": ranking.scenario.get("cells")}


def plan_entry(plan: PlanResult) -> dict[str, Any]:
    """One plan with the keys of `PLAN_KEYS`; ``min_clearance_m`` is None for one tractor.

    ``largest_missed`` has `PIECE_KEYS`: area, longitude and latitude (null for a field in local metres) and metres in
    the frame of the field; null where no piece is missed.
    """
    values: dict[str, Any] = {key: getattr(plan, key) for key in PLAN_KEYS} | {"min_clearance_m": clearance(plan)}
    if (piece := plan.largest_missed) is not None:
        values["largest_missed"] = {key: getattr(piece, key) for key in PIECE_KEYS}
    return {key: finite(value, DECIMALS) for key, value in values.items()}


def ranking_csv(ranking: Ranking) -> str:
    """The plans as CSV text: a header of `PLAN_KEYS` and `CSV_KEYS`, then one row per plan in the order of the ranking.

    `CSV_KEYS` are what was asked, the same on every row, so that tables of several fields can be put together.
    Missing values are empty cells, truth values ``true`` and ``false``, lines end in a newline alone. The largest
    missed piece has a column for each of its keys (``largest_missed_m2``), an interval one for each end
    (``finish_probability_interval_low``).
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow((*flat(dict.fromkeys(PLAN_KEYS)), *CSV_KEYS))
    asked = {**ranking.scenario, "field": ranking.field_name}
    same = [cell(finite(asked.get(key), DECIMALS)) for key in CSV_KEYS]
    for plan in ranking.plans:
        writer.writerow([*(cell(value) for value in flat(plan_entry(plan)).values()), *same])
    return buffer.getvalue()


def flat(entry: dict[str, Any]) -> dict[str, Any]:
    """An entry of a plan with its largest missed piece and its interval as values beside the others."""
    flat: dict[str, Any] = {}
    for key, value in entry.items():
        if key == "largest_missed":
            flat |= {f"{key}_{part}": (value or {}).get(part) for part in PIECE_KEYS}
        elif key == "finish_probability_interval":
            flat |= {f"{key}_{part}": end for part, end in zip(INTERVAL_KEYS, value or (None, None), strict=True)}
        else:
            flat[key] = value
    return flat


def facts_json(facts: dict[str, Any]) -> str:
    """Facts of a field as JSON text with a trailing newline, in the order given."""
    return _text(facts)


def study_json(study: Study) -> str:
    """The study as JSON text with a trailing newline: ``tables``, ``claims`` and ``assumptions``."""
    return _text(
        {
            "tables": {name: [_row(row) for row in rows] for name, rows in study.tables.items()},
            "claims": [{"claim": claim.claim, "holds": claim.holds, "why": claim.why} for claim in study.claims],
            "assumptions": list(study.assumptions),
        }
    )


def _row(row: StudyRow) -> dict[str, Any]:
    return {
        "tractors": row.tractors,
        "thesis_s": row.thesis_s,
        "time_s": row.time_s,
        "difference_pct": row.difference_pct,
        "label": row.label,
        "note": row.note,
    }


def _text(data: dict[str, Any]) -> str:
    return json.dumps(finite(data, DECIMALS), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def cell(value: Any) -> Any:
    return "" if value is None else str(value).lower() if isinstance(value, bool) else value
