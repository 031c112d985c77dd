"""Fuel, electricity and slopes in tables, sentences, exports, the page and the map."""

import base64
import csv
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from reports.common.language import Reader, use_reader
from reports.common.plan_records import DriverLeg, PlanDrive, Relief
from reports.plan.answer import write_answer
from reports.plan.figures import format_ranking_csv, format_ranking_json
from reports.plan.leg_list import format_leg_lists_json
from reports.plan.map_data import build_page_map
from reports.plan.map_figure import build_legend_entries, draw_plan_map, render_png
from reports.plan.plan_wording import describe_energy, describe_physics, format_energy, format_rate
from reports.plan.ranking_page import render_plan_page
from reports.plan.ranking_table import build_answer_table, build_ranking_table, choose_first_plans
from tests.printing import print_text
from tests.reports.screen_cases import DEADLINE, DEFAULT, FUEL

BEST = FUEL.best


def print_table(width: int = 200) -> str:
    return print_text(build_ranking_table(FUEL), width)


def test_the_answer_and_explain_say_the_litres() -> None:
    assert BEST.tractors == 2
    assert write_answer(FUEL).decision.endswith(", 32 l") and not write_answer(DEADLINE).decision.endswith(" l")
    text = " ".join(print_table().split())
    assert "The best plan burns 32 l of fuel, 8.1 l/ha: 84 kg of CO2. By tractor: 16.0 l and 16.0 l." in text
    assert "Steepest along the drive: 8 % at latitude 56.20000, longitude 9.50000" in text
    assert "across it: 5 % at x 30 m, y 90 m." in text and "31 degrees are left" in text
    assert "The soil is loam at 22 % moisture." in text and "Fuel l" in print_table()
    assert "Fuel" not in print_text(build_ranking_table(DEADLINE), 200)


def test_gallons_by_acre_and_kilowatt_hours() -> None:
    assert BEST is not None
    with use_reader(Reader("en", "us")):
        assert (format_energy(BEST), format_rate(BEST)) == ("8 gal", "0.9 gal/ac")
    electric = replace(BEST, fuel_l=None, fuel_l_per_ha=None, co2_kg=17.7, fuel_l_by_tractor=None, energy_kwh=84.4,
                           energy_kwh_per_ha=21.5)  # fmt: skip
    assert format_energy(electric) == "84 kWh"
    sentence = "The best plan takes 84 kWh from the batteries, 21.5 kWh/ha: 18 kg of CO2 from the grid."
    assert describe_energy(electric) == [sentence]
    assert describe_physics(DEADLINE) == []


def test_the_first_table_has_fuel_where_a_seventh_column_fits() -> None:
    plans = choose_first_plans(FUEL)
    assert len(build_answer_table(FUEL, plans).columns) == 7
    simulated = replace(FUEL, plans=tuple(replace(one, fuel_l=31.0) for one in DEFAULT.plans if one.feasible))
    table = build_answer_table(simulated, choose_first_plans(simulated))
    assert [column.heading for column in table.columns][4:] == ["Cost EUR", "Fuel l", "Worked %"]
    assert table.rows[0][5] == "31.0"


def test_exports_have_figures_and_places() -> None:
    told = json.loads(format_ranking_json(FUEL))
    assert told["best"]["fuel_l_by_tractor"] == [16.0, 16.0] and told["ground"] == list(FUEL.ground_sentences)
    assert told["best"]["steepest_along"] == {
        "amount": -8.4, "tractor": 1, "lon": 9.5, "lat": 56.2, "x_m": 30.0, "y_m": 40.0,
    }  # fmt: skip
    assert json.loads(format_ranking_json(DEADLINE))["best"]["rollover"] is None
    (row, *_) = csv.DictReader(io.StringIO(format_ranking_csv(FUEL)))
    assert row["steepest_across_amount"] == "5.2" and row["steepest_across_lon"] == ""
    assert row["fuel_l_by_tractor"] == " ".join(["16.0"] * int(row["tractors"]))


def test_the_page_has_columns_facts_and_sentences() -> None:
    page = render_plan_page(FUEL, None).replace("\N{NO-BREAK SPACE}", " ")
    heads = re.findall(r'<button type="button">([^<]*)</button></th>', page)
    assert {"Fuel l", "Fuel l/ha", "CO2 kg", "Along %", "Across %"} <= {
        head.replace("\N{SOFT HYPHEN}", "") for head in heads
    }
    assert "32 l, 8.1 l/ha" in page and "Nearest to rolling over" in page
    assert "Fuel l" not in render_plan_page(DEADLINE, None)


def test_legs_have_what_they_use_and_climb() -> None:
    leg = DriverLeg("track", 1, "", 0.0, 60.0, 80.0, 1.0, 2.0, fuel_l=0.251, slope_along_pct=-8.444)
    (entry,) = json.loads(format_leg_lists_json([[leg]], {}))["tractors"][0]["legs"]
    assert (entry["fuel_l"], entry["slope_along_pct"], entry["slope_across_pct"]) == (0.25, -8.44, None)


@pytest.fixture
def hilly(drive: PlanDrive) -> PlanDrive:
    """A drive on heights that rise to the north-east, whose slope faces away from the light."""
    west, south = drive.boundary.min(axis=0)
    east, north = drive.boundary.max(axis=0)
    shade = np.linspace(0.2, 0.9, 12).reshape(3, 4)
    line = np.array([[west, south], [east, north]])
    return replace(drive, relief=Relief(shade, (west, south, east, north), ((10.0, line),), 0.5))


def test_the_page_shades_the_field(hilly: PlanDrive) -> None:
    drawn = build_page_map({"one": hilly})["relief"]
    assert drawn["words"] == "contours every 0.5 m" and drawn["contours"].startswith("M")
    content = base64.b64decode(drawn["picture"].partition(",")[2])
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    rows = np.asarray(Image.open(io.BytesIO(content)))
    assert rows.shape == (3, 4) and rows.dtype == np.uint8
    assert rows[0].tolist() == np.rint(255 * hilly.relief.shade[2]).tolist(), "north is on top"  # type: ignore[union-attr]
    assert (drawn["width"], drawn["height"]) == pytest.approx(
        100.0 * (hilly.boundary.max(axis=0) - hilly.boundary.min(axis=0)), abs=1.0
    )


def test_the_picture_shades_the_field_and_says_so(hilly: PlanDrive, drive: PlanDrive) -> None:
    labels = [entry.get_label() for entry in build_legend_entries(hilly)]
    assert "contours every 0.5 m" in labels
    assert render_png(draw_plan_map(hilly)) != render_png(draw_plan_map(drive))
