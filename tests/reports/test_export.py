"""The JSON and CSV contracts."""

import csv
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.common.plan_records import Shortfall, UnworkedPiece
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.rendering import make_json_safe
from reports.plan.figures import CSV_KEYS, MEASURES, PLAN_KEYS, format_ranking_csv, format_ranking_json
from reports.trials.report import FleetStudy, format_study_json

STATED = ["stated_end_s", "stated_late_end_s", "stated_cost"]
CONTRACT = [  # that programs may rely on; more may come
    "rank", "strategy", "tractors", "turn", "time_s", "tractor_time_s", "cost", "meets_deadline", "feasible",
    "worked_pct", "overlap_pct", "missed_m2", "largest_missed", "finished_s", "finished_cost", "wheel_traffic_m2",
    "outside_m", "outside_along_m", "turning_s", "waiting_s", "reversals", "min_clearance_m", "collisions",
    "formation_pct", "reason", "on_pareto_front", "remark", "headland_passes", "headland_s",
    "transport_s", "ready_s", "done_s", "home_s", "finish_probability", "finish_probability_interval", "p50_s",
    "p80_s", "p95_s", "expected_cost", "paid_cost", "bound_s", "refills", "refilling_s", "folding_s", "over_finished_m",
    "over_finished_m2", "p50_done_s", "p95_done_s", "fuel_l", *STATED, "headland_order", "fuel_l_per_ha",
    "energy_kwh", "co2_kg", "fuel_l_by_tractor", "energy_kwh_by_tractor", "steepest_along", "steepest_across",
    "rollover", "energy_kwh_per_ha", "charges", "charging_s", "spared_m2", "left_out_m2",
    "keeps_clearance", "is_simulated",
]  # fmt: skip
PIECE = [f"largest_missed_{key}" for key in ("m2", "lon", "lat", "x_m", "y_m")]
INTERVAL = [f"finish_probability_interval_{end}" for end in ("low", "high")]
SLOPES = ("steepest_along", "steepest_across", "rollover")
PARTS = {"largest_missed": PIECE, "finish_probability_interval": INTERVAL} | {
    name: [f"{name}_{key}" for key in ("amount", "tractor", "lon", "lat", "x_m", "y_m")] for name in SLOPES
}
COLUMNS = [column for key in CONTRACT for column in PARTS.get(key, [key])]


def no_constant(name: str) -> float:
    raise AssertionError(f"{name} is not JSON")


def test_keys_and_order(ranking: PlanRanking) -> None:
    data = json.loads(format_ranking_json(ranking), parse_constant=no_constant)
    assert list(data) == [
        "field", "seed", "plans", "best", "tractor_effects", "scenario", "advice", "currency", "samples",
        "prices_assumed", "unmet", "shortfalls", "parts", "pull", "remarks", "ground", "summary",
    ]  # fmt: skip
    assert data["scenario"] == {} and data["unmet"] is None
    assert data["field"] == {"name": "Iwamizawa", "area_ha": 1.89}
    assert data["seed"] == 7
    for plan in [*data["plans"], data["best"]]:
        assert [key for key in plan if key in CONTRACT] == CONTRACT, "old keys stay, in their order"
        assert list(plan) == [*PLAN_KEYS, "cells"]


def test_the_reference_names_the_keys_of_a_plan() -> None:
    page = (Path(__file__).parents[2] / "planner/guide/reference.md").read_text(encoding="utf-8")
    table = page.split("## Keys of a plan")[1].split("\n\n")[1]
    named = [key for row in table.splitlines()[2:] for key in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert {*CONTRACT} <= {*named} <= {*PLAN_KEYS} and len({*named}) == len(named)


def test_every_plan_has_the_cells_of_its_tracks_and_without_a_plan_best_is_null(ranking: PlanRanking) -> None:
    cells = [{"number": 1, "bearing_deg": 75.0, "area_m2": 900.0, "swaths": 4}]
    lacking = (Shortfall("rain", "No plan finishes before the rain."),)
    data = json.loads(format_ranking_json(replace(ranking, scenario={"cells": cells}, shortfalls=lacking)))
    assert all(plan["cells"] == cells for plan in [*data["plans"], data["best"]])
    assert data["unmet"] == "No plan finishes before the rain."
    assert json.loads(format_ranking_json(replace(ranking, plans=ranking.plans[6:])))["best"] is None


def test_values_survive(ranking: PlanRanking) -> None:
    data = json.loads(format_ranking_json(ranking))
    for plan, entry in zip(ranking.plans, data["plans"], strict=True):
        for key in (one for one in CONTRACT if one not in STATED):
            value = plan.measured.get(key) if key in MEASURES else getattr(plan, key)
            if key != "min_clearance_m":
                assert entry[key] == (pytest.approx(value, abs=5e-7) if isinstance(value, float) else value)
    assert data["best"] == data["plans"][2] and data["plans"][0]["formation_pct"] == 12.5
    assert data["plans"][0]["min_clearance_m"] == 2.345679, "rounded to six decimals"
    assert data["plans"][4]["min_clearance_m"] is None, "one tractor has nobody to be clear of"


def test_advice_and_what_it_is_of_survive(ranking: PlanRanking) -> None:
    sure = replace(
        ranking.plans[0], finish_probability=0.97, finish_probability_interval=(0.966, 0.973), p50_s=3000.5,
        expected_cost=128.9,
    )  # fmt: skip
    told = replace(ranking, plans=(sure,), currency="EUR", samples=10_000)
    data = json.loads(format_ranking_json(told), parse_constant=no_constant)
    advice = " ".join(f"{each.rstrip('.')}." for each in data["summary"])
    assert (data["advice"], data["currency"], data["samples"]) == (advice, "EUR", 10_000)
    entry = data["plans"][0]
    assert (entry["finish_probability"], entry["finish_probability_interval"]) == (0.97, [0.966, 0.973])
    (row,) = csv.DictReader(io.StringIO(format_ranking_csv(told)))
    told_csv = [row[key] for key in (*INTERVAL, "p50_s", "p80_s", "expected_cost")]
    assert told_csv == ["0.966", "0.973", "3000.5", "", "128.9"]


floats = st.one_of(st.none(), st.floats(), st.floats(allow_nan=False, allow_infinity=False).map(np.float64))


@given(floats, floats)
def test_any_float_gives_json(time_s: float | None, cost: float | None) -> None:
    plan = PlanResult("s", 2, "u", True, None, 1, time_s, None, cost)
    text = format_ranking_json(PlanRanking("f", 1.0, 0, (plan,)))
    entry = json.loads(text, parse_constant=no_constant)["plans"][0]
    for value, key in ((time_s, "time_s"), (cost, "cost")):
        if value is None or not math.isfinite(value):
            assert entry[key] is None
        else:
            assert entry[key] == pytest.approx(value, abs=5.1e-7, rel=1e-12)
            assert str(entry[key]) != "-0.0"


def test_text_ends_once_and_repeats(ranking: PlanRanking, study: FleetStudy) -> None:
    for form, what in ((format_ranking_json, ranking), (format_study_json, study)):
        text = form(what)
        assert text == form(what) and text.endswith("}\n") and not text.endswith("\n\n")


def test_csv_has_one_row_per_plan(ranking: PlanRanking) -> None:
    rows = list(csv.reader(io.StringIO(format_ranking_csv(ranking))))
    assert rows[0][:5] == ["field", "strategy", "tractors", "turn", "width_m"], "names first"
    printed = ["stated_end_s", "stated_late_end_s", "stated_cost", "worked_pct", "finish_probability"]
    assert rows[0][5:10] == printed, "then the figures of the printed table"
    assert {*COLUMNS, *CSV_KEYS} <= {*rows[0]} and len(set(rows[0])) == len(rows[0])
    assert " ".join(CSV_KEYS) == (
        "field width_m headland_m bearing_deg price_per_hour price_per_tractor area_ha corners"
    )
    assert len(rows) == 1 + len(ranking.plans)
    assert {len(row) for row in rows} == {len(rows[0])}


def test_every_row_says_what_was_asked(ranking: PlanRanking) -> None:
    scenario = {"field": "x.geojson#2", "width_m": 3.0, "headland_m": 8.5, "bearing_deg": 90.0, "price_per_hour": 40.0,
                "price_per_tractor": math.nan, "corners": "round", "seed": 7}  # fmt: skip
    asked = replace(ranking, scenario=scenario)
    told = json.loads(format_ranking_json(asked), parse_constant=no_constant)["scenario"]
    assert told == scenario | {"price_per_tractor": None}
    values = ["Iwamizawa", "3.0", "8.5", "90.0", "40.0", "", str(ranking.area_ha), "round"]
    for row in csv.DictReader(io.StringIO(format_ranking_csv(asked))):
        assert [row[key] for key in CSV_KEYS] == values


def test_csv_and_json_tell_the_same(ranking: PlanRanking) -> None:
    plans = json.loads(format_ranking_json(ranking))["plans"]
    rows = list(csv.DictReader(io.StringIO(format_ranking_csv(ranking))))
    for row, plan in zip(rows, plans, strict=True):
        told = {key: "" if plan.get(key) is None else str(plan[key]) for key in COLUMNS}
        said = {key: text.lower() if text in ("True", "False") else text for key, text in told.items()}
        assert {key: row[key] for key in COLUMNS} == said
    assert (rows[0]["meets_deadline"], rows[3]["meets_deadline"], rows[6]["meets_deadline"]) == ("true", "false", "")
    assert rows[9]["reason"] == "The field has 8 swaths, too few for 11 tractors.", "the comma is quoted"


def test_what_is_left_open_has_a_place(leaving: PlanRanking) -> None:
    plans = json.loads(format_ranking_json(leaving))["plans"]
    for entry, row in zip(plans, csv.DictReader(io.StringIO(format_ranking_csv(leaving))), strict=True):
        if entry["feasible"]:
            piece = {"m2": 1200.0, "lon": 141.75, "lat": 43.2, "x_m": 131.4, "y_m": 64.6}
            assert entry["largest_missed"] == piece and list(entry["largest_missed"]) == list(piece)
            assert [float(row[key]) for key in PIECE] == list(piece.values())
            assert entry["missed_m2"] == pytest.approx(18_900 * (1 - entry["worked_pct"] / 100))
            assert (entry["wheel_traffic_m2"], entry["outside_m"], entry["outside_along_m"]) == (12.4, 1.2, 31.2)
        else:
            assert entry["largest_missed"] is None and {row[key] for key in PIECE} == {""}
    local = replace(leaving, plans=(replace(leaving.plans[0], largest_missed=UnworkedPiece(5.0, 1.0, 2.0)),))
    (entry,) = json.loads(format_ranking_json(local))["plans"]
    (row,) = csv.DictReader(io.StringIO(format_ranking_csv(local)))
    assert entry["largest_missed"] == {"m2": 5.0, "lon": None, "lat": None, "x_m": 1.0, "y_m": 2.0}
    assert [row[key] for key in PIECE] == ["5.0", "", "", "1.0", "2.0"]


def test_study(study: FleetStudy) -> None:
    data = json.loads(format_study_json(study), parse_constant=no_constant)
    assert list(data) == ["tables", "claims", "assumptions"]
    assert list(data["tables"]) == ["6.1", "6.2", "6.3"]
    row = data["tables"]["6.1"][0]
    assert list(row) == ["label", "tractors", "thesis_s", "time_s", "difference_pct", "note"]
    assert list(row.values()) == ["one tractor", 1, 4475.0, 4612.5, 3.0726, ""]
    assert data["tables"]["6.2"][0]["time_s"] is None
    assert [claim["holds"] for claim in data["claims"]] == [True, False]
    assert data["assumptions"] == list(study.assumptions)


def test_plain_values_hold_nothing_that_json_lacks() -> None:
    value = {1: (math.inf, np.float64(-0.0)), "a": np.array([[1.5, np.nan]]), "b": np.int64(3), "c": True, "d": None}
    plain = {"1": [None, 0.0], "a": [[1.5, None]], "b": 3, "c": True, "d": None}
    assert make_json_safe(value) == plain
    assert json.dumps(make_json_safe(value, 6), allow_nan=False) == json.dumps(plain)
