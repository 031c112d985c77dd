"""Rankings, facts of a field and the fleet study as JSON and CSV: fixed keys in a fixed order, six decimals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from typing import Any

from reports.common.plan_results import FieldPartPlan, PlanRanking, PlanResult
from reports.common.rendering import (
    EXPORT_DECIMALS,
    format_csv,
    format_csv_cell,
    format_json,
    make_json_safe,
    pick_values,
)
from reports.plan.answer import write_answer
from reports.plan.figures import FIGURES, FIRST_CSV_KEYS, PIECE_KEYS, PLAN_KEYS
from reports.plan.shortfall_wording import describe_shortfall, question_pull

CSV_KEYS = (
    "field", "width_m", "headland_m", "bearing_deg", "price_per_hour", "price_per_tractor", "area_ha", "corners",
)  # fmt: skip


def format_ranking_json(ranking: PlanRanking) -> str:
    """The ranking as JSON text with a trailing newline.

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
    return format_json(build_ranking_entry(ranking), EXPORT_DECIMALS, is_ascii=False)


def build_ranking_entry(ranking: PlanRanking) -> dict[str, Any]:
    """The ranking with the keys of `format_ranking_json`."""

    def build_entry(plan: PlanResult) -> dict[str, Any]:
        return {**build_plan_entry(plan), "cells": ranking.scenario.get("cells")}

    best, pull = ranking.best, ranking.pull
    shortfalls = [{"kind": one.kind, "sentence": describe_shortfall(ranking, one)} for one in ranking.shortfalls]
    unmet = " ".join(one["sentence"] for one in shortfalls if one["kind"] != "late")
    return {
        "field": {"name": ranking.field_name, "area_ha": ranking.area_ha},
        "seed": ranking.seed,
        "plans": [build_entry(plan) for plan in ranking.plans],
        "best": None if best is None else build_entry(best),
        **pick_values(ranking, ("tractor_effects", "scenario", "advice", "currency", "samples", "prices_assumed")),
        "unmet": unmet or None,
        "shortfalls": shortfalls,
        "parts": [build_part_entry(part) for part in ranking.parts],
        "pull": None
        if pull is None
        else {
            **make_json_safe(pull, 2),
            "questioned": pull.is_questioned,
            "feasible": not pull.is_infeasible,
            "question": question_pull(pull) or None,
        },
        "remarks": list(ranking.field_remarks),
        "ground": list(ranking.ground_sentences),
        "summary": write_answer(ranking).list_sentences(),
    }


def build_part_entry(part: FieldPartPlan) -> dict[str, Any]:
    """A part of the field that is cut off, with its own plan."""
    return {
        "number": part.number,
        "ground": make_json_safe(pick_values(part.ground, PIECE_KEYS), EXPORT_DECIMALS),
        "neck": make_json_safe(pick_values(part.neck, PIECE_KEYS), EXPORT_DECIMALS),
        "neck_width_m": round(part.neck_width_m, 2),
        "plan": None if part.plan is None else build_plan_entry(part.plan),
        "reason": part.reason,
    }


def build_plan_entry(plan: PlanResult) -> dict[str, Any]:
    """One plan with the keys of `PLAN_KEYS`; ``min_clearance_m`` is None for one tractor.

    ``stated_end_s`` (the end of field work by the clock), ``stated_late_end_s`` (in 95 % of the samples) and
    ``stated_cost`` are the figures that every report states.

    ``largest_missed`` has `PIECE_KEYS`: area, degrees (null for a field in local metres) and metres of the field; it is
    null where nothing is missed. ``steepest_along``, ``steepest_across`` (percent) and ``rollover`` (degrees left) have
    `SLOPE_KEYS`; they are null on level ground.
    """
    entry = {}
    for key in PLAN_KEYS:
        value = FIGURES[key].get_value(plan)
        value = pick_values(value, FIGURES[key].parts) if is_dataclass(value) else value
        entry[key] = make_json_safe(value, EXPORT_DECIMALS)
    return entry


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


def flatten_entry(entry: dict[str, Any]) -> dict[str, Any]:
    """The entry of a plan with a key for each value of its places and each end of its interval.

    Values by tractor are one text, separated by spaces.
    """
    flattened: dict[str, Any] = {}
    for key, value in entry.items():
        parts = FIGURES[key].parts if key in FIGURES else ()
        if parts:
            values = value.values() if isinstance(value, dict) else value or [None] * len(parts)
            flattened |= {f"{key}_{part}": one for part, one in zip(parts, values, strict=True)}
        else:
            flattened[key] = (" ".join(map(str, value)) or None) if isinstance(value, list) else value
    return flattened


def format_facts_json(facts: dict[str, Any]) -> str:
    """Facts of a field as JSON text with a trailing newline, in the order given."""
    return format_json(facts, EXPORT_DECIMALS, is_ascii=False)
