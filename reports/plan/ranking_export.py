"""Rankings, facts of a field and the fleet study as JSON and CSV: fixed keys in a fixed order, six decimals."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from reports.common.plan_results import (
    FieldPartPlan,
    PlanRanking,
    PlanResult,
    PullFigures,
    get_stated_cost,
    get_stated_end_s,
    get_stated_late_end_s,
)
from reports.common.rendering import make_json_safe
from reports.common.study_results import FleetStudy, ThesisTableRow
from reports.plan.answer import write_answer
from reports.plan.plan_wording import get_clearance_m
from reports.plan.shortfall_wording import describe_shortfall, question_pull

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
    "wheel_traffic_m2",
    "outside_m",
    "outside_along_m",
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
    "headland_passes",
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
    "over_finished_m",
    "over_finished_m2",
    "p50_done_s",
    "p95_done_s",
    "fuel_l",
    "stated_end_s",
    "stated_late_end_s",
    "stated_cost",
    "headland_order",
    "fuel_l_per_ha",
    "energy_kwh",
    "co2_kg",
    "fuel_l_by_tractor",
    "energy_kwh_by_tractor",
    "steepest_along",
    "steepest_across",
    "rollover",
    "energy_kwh_per_ha",
    "charges",
    "charging_s",
)
SLOPE_KEYS = ("amount", "tractor", "lon", "lat", "x_m", "y_m")
PLACE_KEYS = ("steepest_along", "steepest_across", "rollover")
LISTS_BY_TRACTOR = ("fuel_l_by_tractor", "energy_kwh_by_tractor")
INTERVAL_KEYS = ("low", "high")
UNWORKED_PIECE_KEYS = ("m2", "lon", "lat", "x_m", "y_m")
CSV_KEYS = (
    "field",
    "width_m",
    "headland_m",
    "bearing_deg",
    "price_per_hour",
    "price_per_tractor",
    "area_ha",
    "corners",
)
FIRST_CSV_KEYS = (
    "field", "strategy", "tractors", "turn", "width_m", "stated_end_s", "stated_late_end_s", "stated_cost",
    "worked_pct", "finish_probability", "meets_deadline", "fuel_l", "energy_kwh", "waiting_s", "rank", "feasible",
    "reason",
)  # fmt: skip
"""What a plan is of, the figures of the printed table, and why there are none."""
EXPORT_DECIMALS = 6


def format_ranking_json(ranking: PlanRanking) -> str:
    """The ranking of `build_ranking_entry` as JSON text with a trailing newline."""
    return _format_json(build_ranking_entry(ranking))


def build_ranking_entry(ranking: PlanRanking) -> dict[str, Any]:
    """The ranking as plain values for JSON.

    Keys: ``field`` (``name``, ``area_ha``), ``seed``, ``plans`` (each with `PLAN_KEYS` and ``cells``, in the order of
    the ranking), ``best`` (one of them, or null), ``tractor_effects`` (values by id of the effects in the tractor file,
    amounts of its discrepancy model under ``discrepancy_model``), ``scenario`` (the request, by parameter), ``advice``
    (a sentence), ``currency``, ``samples``, ``prices_assumed`` (nobody gave prices), ``shortfalls`` (what keeps the
    best plan from being a recommendation: ``kind`` pull, worked, rain, budget or late, and ``sentence``), ``unmet``
    (these sentences but for late; null without any),
    ``parts`` (further parts of a divided field: number, ground, neck, neck_width_m, plan, reason) ``changes``
    (found to work where no plan does), ``pull`` (power at the drawbar that the implement needs and the tractor has,
    ``questioned`` if it is too little, ``feasible`` unless it is too little for the lightest such implement; null if
    unknown), ``remarks`` (on the field file), ``ground`` (sentences on
    heights, soil and fuel) and ``summary`` (the answer in a few sentences, as it is printed).
    Figures that are missing or not finite are null.
    """
    best = ranking.best
    shortfalls = [{"kind": one.kind, "sentence": describe_shortfall(ranking, one)} for one in ranking.shortfalls]
    unmet = " ".join(one["sentence"] for one in shortfalls if one["kind"] != "late")
    entry: dict[str, Any] = make_json_safe(
        {
            "field": {"name": ranking.field_name, "area_ha": ranking.area_ha},
            "seed": ranking.seed,
            "plans": [_build_entry_with_cells(plan, ranking) for plan in ranking.plans],
            "best": None if best is None else _build_entry_with_cells(best, ranking),
            "tractor_effects": ranking.tractor_effects,
            "scenario": ranking.scenario,
            "advice": ranking.advice,
            "currency": ranking.currency,
            "samples": ranking.samples,
            "prices_assumed": ranking.prices_assumed,
            "unmet": unmet or None,
            "shortfalls": shortfalls,
            "parts": [build_part_entry(part) for part in ranking.parts],
            "pull": _build_pull_entry(ranking.pull),
            "remarks": list(ranking.field_remarks),
            "ground": list(ranking.ground_sentences),
            "summary": write_answer(ranking).list_sentences(),
        },
        EXPORT_DECIMALS,
    )
    return entry


def _build_pull_entry(pull: PullFigures | None) -> dict[str, Any] | None:
    """What the implement needs and the tractor has at the drawbar, and whether that is questioned."""
    if pull is None:
        return None
    figures = {name: make_json_safe(value, 2) for name, value in asdict(pull).items()}
    return {
        **figures,
        "questioned": pull.is_questioned,
        "feasible": not pull.is_infeasible,
        "question": question_pull(pull) or None,
    }


def build_part_entry(part: FieldPartPlan) -> dict[str, Any]:
    """A part of the field that is cut off, with its own plan."""
    places = {
        name: {key: make_json_safe(getattr(place, key), EXPORT_DECIMALS) for key in UNWORKED_PIECE_KEYS}
        for name, place in (("ground", part.ground), ("neck", part.neck))
    }
    return {
        "number": part.number,
        **places,
        "neck_width_m": round(part.neck_width_m, 2),
        "plan": None if part.plan is None else build_plan_entry(part.plan),
        "reason": part.reason,
    }


def _build_entry_with_cells(plan: PlanResult, ranking: PlanRanking) -> dict[str, Any]:
    """The entry of a plan, with the ``cells`` of the field."""
    return {**build_plan_entry(plan), "cells": ranking.scenario.get("cells")}


def build_plan_entry(plan: PlanResult) -> dict[str, Any]:
    """One plan with the keys of `PLAN_KEYS`; ``min_clearance_m`` is None for one tractor.

    ``stated_end_s`` (the end of field work by the clock), ``stated_late_end_s`` (in 95 % of the samples) and
    ``stated_cost`` are the figures that every report states.

    ``largest_missed`` has `UNWORKED_PIECE_KEYS`: area, degrees (null for a field in local metres) and metres of the
    field; it is null where nothing is missed. ``steepest_along``, ``steepest_across`` (percent) and ``rollover``
    (degrees left) have `SLOPE_KEYS`; they are null on level ground.
    """
    stated = {
        "stated_end_s": get_stated_end_s(plan) if plan.feasible else None,
        "stated_late_end_s": get_stated_late_end_s(plan),
        "stated_cost": get_stated_cost(plan),
        "min_clearance_m": get_clearance_m(plan),
    }
    values: dict[str, Any] = {key: stated.get(key, getattr(plan, key, None)) for key in PLAN_KEYS}
    if (piece := plan.largest_missed) is not None:
        values["largest_missed"] = {key: getattr(piece, key) for key in UNWORKED_PIECE_KEYS}
    for name in PLACE_KEYS:
        if (place := getattr(plan, name)) is not None:
            values[name] = {key: getattr(place, key) for key in SLOPE_KEYS}
    return {key: make_json_safe(value, EXPORT_DECIMALS) for key, value in values.items()}


def format_ranking_csv(ranking: PlanRanking) -> str:
    """The plans as CSV text: a header of `list_csv_columns`, then one row per plan in the order of the ranking.

    `CSV_KEYS` are of the request, the same on every row, so that tables of several fields can be joined.
    Missing values are empty cells, truth values ``true`` and ``false``, lines end in a newline alone. The largest
    missed piece has a column for each of its keys (``largest_missed_m2``), an interval one for each end
    (``finish_probability_interval_low``).
    """
    columns = list_csv_columns()
    request_values = {**ranking.scenario, "field": ranking.field_name, "area_ha": ranking.area_ha}
    rows = (build_csv_row(build_plan_entry(plan), request_values, columns) for plan in ranking.plans)
    return format_csv([columns, *rows])


def list_csv_columns() -> list[str]:
    """The columns of plans as CSV: `FIRST_CSV_KEYS`, then the other keys of plan and request."""
    names = [*flatten_entry(dict.fromkeys(PLAN_KEYS)), *CSV_KEYS]
    return [*FIRST_CSV_KEYS, *(name for name in names if name not in FIRST_CSV_KEYS)]


def build_csv_row(entry: Mapping[str, Any], request_values: Mapping[str, Any], columns: Sequence[str]) -> list[Any]:
    """The cells of a plan, an entry with `PLAN_KEYS`, and of its request."""
    of_request = {key: make_json_safe(request_values.get(key), EXPORT_DECIMALS) for key in CSV_KEYS}
    values = {**of_request, **flatten_entry({key: entry.get(key) for key in PLAN_KEYS})}
    return [format_csv_cell(values[name]) for name in columns]


def format_csv(rows: Iterable[Sequence[Any]]) -> str:
    """Rows as CSV text."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def flatten_entry(entry: dict[str, Any]) -> dict[str, Any]:
    """The entry of a plan with a key for each value of its places and each end of its interval.

    Values by tractor are one text, separated by spaces.
    """
    flattened: dict[str, Any] = {}
    for key, value in entry.items():
        if key == "largest_missed":
            flattened |= {f"{key}_{part}": (value or {}).get(part) for part in UNWORKED_PIECE_KEYS}
        elif key in PLACE_KEYS:
            flattened |= {f"{key}_{part}": (value or {}).get(part) for part in SLOPE_KEYS}
        elif key in LISTS_BY_TRACTOR:
            flattened[key] = " ".join(map(str, value or ())) or None
        elif key == "finish_probability_interval":
            flattened |= {f"{key}_{part}": end for part, end in zip(INTERVAL_KEYS, value or (None, None), strict=True)}
        else:
            flattened[key] = value
    return flattened


def format_facts_json(facts: dict[str, Any]) -> str:
    """Facts of a field as JSON text with a trailing newline, in the order given."""
    return _format_json(facts)


def format_study_json(study: FleetStudy) -> str:
    """The study as JSON text with a trailing newline: ``tables``, ``claims`` and ``assumptions``."""
    return _format_json(
        {
            "tables": {name: [build_study_row(row) for row in rows] for name, rows in study.tables.items()},
            "claims": [{"claim": claim.claim, "holds": claim.holds, "why": claim.why} for claim in study.claims],
            "assumptions": list(study.assumptions),
        }
    )


def build_study_row(row: ThesisTableRow) -> dict[str, Any]:
    """One row of a table of the study."""
    return {
        "tractors": row.tractors,
        "thesis_s": row.thesis_s,
        "time_s": row.time_s,
        "difference_pct": row.difference_pct,
        "label": row.label,
        "note": row.note,
    }


def _format_json(data: dict[str, Any]) -> str:
    return json.dumps(make_json_safe(data, EXPORT_DECIMALS), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def format_csv_cell(value: Any) -> Any:
    return "" if value is None else str(value).lower() if isinstance(value, bool) else value
