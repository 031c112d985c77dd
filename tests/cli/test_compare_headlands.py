"""`headland compare-headlands`: one line per way, what fits on 80 columns, JSON, CSV, page, and bad input."""

import csv
import io
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from planner.evaluation.work_order import WorkOrder
from planner.pipeline.many_fields import compare_ways
from reports.plan.comparison import Comparison
from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused
from tests.drawn_fields import write_farm

pytestmark = pytest.mark.usefixtures("first_layout")

QUICK = ("--local", "--tractors", "1", "--processes", "1", "--bearing", "90")
WAYS = ("--corners", "square,round", "--headland-order", "last", "--headland-passes", "3")


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rectangles in local metres: 40 m by 30 m and 36 m by 30 m."""
    place = tmp_path_factory.mktemp("farm") / "farm.geojson"
    return write_farm(place, north=(0, 40, 30), south=(400, 36, 30))


@pytest.fixture(scope="module")
def kept() -> dict[str, Comparison]:
    """Comparisons by their orders."""
    return {}


@pytest.fixture
def compared_once(monkeypatch: pytest.MonkeyPatch, kept: dict[str, Comparison]) -> None:
    """What was compared before by the same orders is not compared again, as its output is what is tested."""

    def compare(orders: Sequence[WorkOrder], *more: Any, with_maps: bool) -> Comparison:
        key = str((orders, with_maps))
        if key not in kept:
            kept[key] = compare_ways(orders, *more, with_maps=with_maps)
        return kept[key]

    monkeypatch.setattr("planner.pipeline.many_fields.compare_ways", compare)


def mask_figures(line: str) -> str:
    """The line with `#` for every figure, so that it stays the same on any machine."""
    return re.sub(r"\s+", " ", re.sub(r"\+?\d[\d.:]*", "#", line)).strip()


@pytest.mark.slow
@pytest.mark.usefixtures("compared_once")
def test_first_screen_at_80_columns(headland: Run, farm: Path) -> None:
    outcome = headland("compare-headlands", f"{farm}#*", *QUICK, *WAYS)
    lines = outcome.out.splitlines()
    assert outcome.status == 0 and outcome.err == "" and max(map(len, lines)) <= 80
    assert re.match(r"Worth it on 2 fields \(0\.23 ha\): (square|round) corners, headland last, 3 passes: ", lines[0])
    head = next(index for index, line in enumerate(lines) if line.startswith("Headland "))
    headings = sorted(" ".join(lines[head - 2 : head + 1]).split())  # in three lines all columns have room
    expected = "Headland EUR/ha More h/year l/year EUR/year Missed m2 Overlap m2 Driven over m2"
    assert headings == sorted(expected.split(" "))
    rows = [mask_figures(line) for line in lines[head + 1 : head + 3]]
    assert sorted(rows, key=lambda row: "best" not in row) == rows
    assert {row.split(",")[0] for row in rows} == {"square", "round"}
    for row in rows:
        assert re.fullmatch(r"(square|round), last, # passes # (best|#) # # # # # #", row), row
    assert lines[head + 4].split()[:4] == ["Field", "Best", "headland", "Saves"]
    assert [line.split()[0] for line in lines[head + 5 : head + 7]] == ["north", "south"]
    assert len(lines) <= 24


@pytest.mark.slow
@pytest.mark.usefixtures("compared_once")
def test_json_csv_and_page_say_the_same(headland: Run, farm: Path, tmp_path: Path) -> None:
    page = tmp_path / "headlands.html"
    asked = ("compare-headlands", f"{farm}#*", *QUICK, *WAYS, "--operations-per-year", "3")
    told = json.loads(headland(*asked, "--json", "--html", page).out)
    outcome = headland(*asked, "--csv")
    rows = list(csv.DictReader(io.StringIO(outcome.out)))
    assert [(row["field"], row["corners"], row["headland_order"], row["headland_passes"]) for row in rows] == [
        (field, corners, "last", "3") for field in ("north", "south") for corners in ("square", "round")
    ]
    assert [row["area_ha"] for row in rows] == ["0.12", "0.12", "0.108", "0.108"]
    for row, entry in zip(rows, told["fields"], strict=True):
        assert float(row["time_s"]) == entry["plan"]["time_s"] and float(row["cost"]) == entry["plan"]["cost"]
        assert row["corners"] == entry["corners"] and entry["refusal"] is None
    assert {one["corners"] for one in told["totals"]} == {"square", "round"}
    assert told["best"] == {
        "corners": told["totals"][0]["corners"], "headland_order": "last", "headland_passes": 3, "width_m": 3.0,
    }  # fmt: skip
    for one in told["totals"]:
        mine = [row for row in rows if row["corners"] == one["corners"]]
        assert one["cost"] == pytest.approx(sum(float(row["cost"]) for row in mine))
        assert one["cost_per_ha"] == pytest.approx(sum(float(row["finished_cost"]) for row in mine) / 0.228)
        assert one["fields"] == 2 and one["area_ha"] == pytest.approx(0.228)
        for year, single, scale in (("hours", "time_s", 3600.0), ("fuel_l", "fuel_l", 1.0), ("cost", "cost", 1.0)):
            summed = 3.0 * sum(float(row[single]) for row in mine) / scale
            assert one[f"{year}_per_year"] == pytest.approx(summed, rel=1e-4), year
    text = page.read_text(encoding="utf-8")
    assert text.count("<svg") == 4 and "src=" not in text and "<script" not in text
    assert " ".join(told["answer"][0].split()[:3]) in text.replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.slow
def test_few_passes_are_worked_line_by_line_and_compared(headland: Run, farm: Path) -> None:
    outcome = headland("compare-headlands", f"{farm}#south", *QUICK, "--corners", "round", "--headland-passes", "1,3",
                       "--headland-order", "last")  # fmt: skip
    assert outcome.status == 0
    words = " ".join(outcome.out.split())
    assert "Worth it on south (0.11 ha): round corners, headland last, 3 passes" in words and "1 pass" in words
    assert outcome.sentences == [
        "Note: One headland pass is 3 m deep, and turns need 8.5 m (3 passes): where they do not fit, they lead over "
        "tracks."
    ]


def test_a_lost_file_is_refused_and_an_empty_one_named_among_others(headland: Run, farm: Path, tmp_path: Path) -> None:
    for names in ([tmp_path / "lost.geojson"], [f"{farm}#north", tmp_path / "lost.geojson"]):
        assert_refused(headland("compare-headlands", *names, *QUICK), "There is no field file")
    (tmp_path / "empty.geojson").touch()
    outcome = headland("compare-headlands", tmp_path / "empty.geojson", f"{farm}#north", *QUICK, *WAYS)
    assert outcome.status == 3 and "Worth it on north" in outcome.out
    told = " ".join(outcome.out.split())
    assert "empty.geojson: every way: " in told and "is empty; save it again" in told


@pytest.mark.slow
def test_widths_are_compared(headland: Run, farm: Path) -> None:
    options = (*QUICK, "--corners", "round", "--headland-order", "last")
    lines = headland("compare-headlands", f"{farm}#south", *options, "--width", "2.5,3").out.splitlines()
    rows = [line for line in lines if line.startswith("round, last, ")]
    assert sorted(re.sub(r".* passes, ([\d.]+ m) .*", r"\1", row) for row in rows) == ["2.5 m", "3 m"]
    assert lines[0].startswith("Worth it on south (0.11 ha): round corners, ") and max(map(len, lines)) <= 80


def test_a_deadline_that_is_missed_is_said(headland: Run, farm: Path) -> None:
    outcome = headland("compare-headlands", f"{farm}#south", *QUICK, "--corners", "round", "--headland-order", "last",
                       "--start", "8:00", "--deadline", "8:02", "--samples", "100")  # fmt: skip
    assert outcome.status == 3
    assert "It is no recommendation on south (deadline, rain, budget, share worked or pull)." in " ".join(
        outcome.out.split()
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--corners", "sharp"), "--corners 'sharp' is unknown; use one or more of"),
        (("--corners", "square,,round"), "--corners '' is unknown"),
        (("--corners", "squar"), "did you mean 'square'"),
        (("--headland-order", "never"), "--headland-order 'never' is unknown; use one or more of first, last"),
        (("--headland-passes", "0"), "--headland-passes '0' is not a list of numbers from 1 to 50"),
        (("--headland-passes", "3-1"), "write for instance 2, 1-3 or 1,2,4"),
        (("--headland-passes", "two"), "--headland-passes 'two' is not a list"),
        (("--headland-passes", "999999999999"), "is not a list of numbers"),
        (("--no-headland",), "No such option"),
        (("--width", "3,,6"), "--width '3,,6' is not a width"),
        (("--width", "3,0"), "working width (--width) is 0 m; use 0.5 to 100 m"),
        (("--operations-per-year", "0"), "--operations-per-year is 0; use 1 to 366."),
        (("--operations-per-year", "1" + "0" * 400), "use 1 to 366"),
        (("--json", "--csv"), "choose one"),
        (("--html", "page.txt"), "does not end in .html"),
        (("--html", "farm.html.geojson"), "does not end in .html"),
        (("--tractors", "0"), "0 tractors cannot be planned"),
    ],
)
def test_bad_input_is_one_sentence_before_any_work(
    headland: Run, farm: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], words: str
) -> None:
    monkeypatch.setattr("planner.cli.comparisons.warm_up", lambda: pytest.fail("something was computed"))
    monkeypatch.chdir(farm.parent)
    outcome = headland("compare-headlands", "farm.geojson#north", "--local", *options)
    assert_refused(outcome, words)
