"""`headland plan` of several fields and widths: one table, kept answers, what does not go together."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused
from tests.drawn_fields import write_farm

pytestmark = pytest.mark.usefixtures("first_layout")

WHOLE = ("--local", "--tractors", "1", "--strategies", "split-field", "--processes", "1")
QUICK = (*WHOLE, "--no-headland")


@pytest.fixture
def farm(tmp_path: Path) -> Path:
    """Two fields of local metres and one that is too small for any plan."""
    return write_farm(tmp_path / "farm.geojson", north=(0, 70, 40), tiny=(200, 3, 3), south=(400, 60, 50))


@pytest.mark.slow
def test_one_table_of_all_fields_and_widths(headland: Run, farm: Path) -> None:
    outcome = headland("plan", f"{farm}#*", *WHOLE, "--width", "3,4", "--csv")
    rows = list(csv.DictReader(io.StringIO(outcome.out)))
    places = [(row["requested_field"].rpartition("#")[2], row["width_m"]) for row in rows]
    assert places == [(name, width) for name in ("north", "tiny", "south") for width in ("3.0", "4.0")]
    assert outcome.status == 3  # one of them has no plan
    assert "Note: 3,4 are two widths, 3 m and 4 m; write 3.4 for one." in " ".join(outcome.err.split())
    for row in rows:
        whole = row["requested_field"].endswith("tiny") or None not in row.values()
        assert whole and (row["feasible"] == "true") == (not row["requested_field"].endswith("tiny"))
    assert "at least 100 m2" in rows[2]["reason"]
    assert [(row["area_ha"], row["corners"]) for row in rows if row["feasible"] == "true"] == [
        ("0.28", "auto"), ("0.28", "auto"), ("0.3", "auto"), ("0.3", "auto"),
    ]  # fmt: skip
    assert {row["headland_order"] for row in rows if row["feasible"] == "true"} <= {"first", "last"}
    alone = headland("plan", f"{farm}#south", *WHOLE, "--width", "4", "--csv")
    (same,) = csv.DictReader(io.StringIO(alone.out))
    assert {key: rows[5][key] for key in same} == same


@pytest.mark.slow
def test_answers_that_are_kept_are_not_worked_out_again(
    headland: Run, farm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "kept.jsonl"
    asked = ("plan", f"{farm}#*", *QUICK, "--checkpoint", kept, "--json")
    first = headland(*asked)
    lines = kept.read_text(encoding="utf-8")
    assert [record["refusal"] is None for record in json.loads(first.out)["fields"]] == [True, False, True]

    kept.write_text("".join(lines.splitlines(keepends=True)[:2]) + '{"key": "cut o', encoding="utf-8")
    again = headland(*asked)
    assert again.out == first.out and kept.read_text(encoding="utf-8") == lines

    monkeypatch.setattr("planner.pipeline.many_fields.answer_order", lambda *_: pytest.fail("worked out again"))
    assert headland(*asked).out == first.out
    assert kept.read_text(encoding="utf-8") == lines


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: text.replace('"time_s": ', '"time_s": 1', 1), "Line 1 of {keep} (--checkpoint) was changed"),
        (lambda text: text.replace('"plans": [', '"plans": [[', 1), "Line 1 of {keep} (--checkpoint) is not an answer"),
        (lambda text: text + "[" * 100_000 + "\n", "is not an answer of Headland"),
        (lambda text: text + "[]\n", "is not an answer of Headland"),
        (lambda text: text + "what somebody else wrote", "is not an answer of Headland"),
        (lambda text: "a diary without a line end", "Line 1 of {keep} (--checkpoint) is not an answer"),
        (lambda text: "\udcff" + text, "not a text file in UTF-8"),
    ],
)
def test_a_damaged_file_of_answers_is_refused_before_anything_is_printed(
    headland: Run, farm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: Any, words: str
) -> None:
    keep = tmp_path / "kept.jsonl"
    asked = ("plan", f"{farm}#north", *QUICK, "--checkpoint", keep, "--csv")
    assert headland(*asked).status == 0
    damaged = damage(keep.read_text(encoding="utf-8")).encode("utf-8", "surrogateescape")
    keep.write_bytes(damaged)
    monkeypatch.setattr("planner.cli.plan.warm_up", lambda: pytest.fail("something was computed"))
    assert_refused(headland(*asked), words.format(keep=keep))
    assert keep.read_bytes() == damaged


def test_names_with_any_line_end_are_kept(headland: Run, farm: Path, tmp_path: Path) -> None:
    odd = tmp_path / "odd\u2028place.geojson"
    odd.write_bytes(farm.read_bytes())
    asked = ("plan", f"{odd}#north", *QUICK, "--checkpoint", tmp_path / "kept.jsonl", "--json")
    assert headland(*asked).out == headland(*asked).out != ""


@pytest.mark.slow
def test_the_table_for_people_names_what_has_no_plan(headland: Run, farm: Path) -> None:
    outcome = headland("plan", f"{farm}#*", *QUICK, "--explain")
    assert outcome.out.startswith("3 m: 2 of 3 fields, 0.58 ha, ") and "Without a plan: 1 of 3" in outcome.out
    (total,) = [line.split() for line in outcome.out.splitlines() if line.startswith("Total ")]
    assert total[1:3] == ["0.58", "3"]  # 70 x 40 and 60 x 50 m
    assert max(map(len, outcome.out.splitlines())) <= 80


@pytest.mark.slow
def test_a_page_shows_every_field_from_kept_answers_too(headland: Run, farm: Path, tmp_path: Path) -> None:
    """Answers kept without maps are computed again for a page; kept with maps they give the same page."""
    kept, page = tmp_path / "kept.jsonl", tmp_path / "fields.html"
    asked = ("plan", f"{farm}#*", *QUICK, "--checkpoint", kept, "--json")
    plain = headland(*asked)
    assert headland(*asked, "--html", page).out == plain.out
    text = page.read_text(encoding="utf-8")
    assert text.count("<svg") == 2 and "at least 100 m2" in text
    assert 'src="http' not in text and "<script" not in text
    before = text
    assert headland(*asked, "--html", page).status == 3 and page.read_text(encoding="utf-8") == before
    totals = json.loads(plain.out)["totals"]
    best = [record["ranking"]["best"] for record in json.loads(plain.out)["fields"] if record["ranking"]]
    assert len(totals) == 1 and totals[0]["fields"] == 2 and totals[0]["area_ha"] == pytest.approx(0.58)
    for key in ("time_s", "cost", "missed_m2", "over_finished_m2"):
        assert totals[0][key] == pytest.approx(sum(plan[key] for plan in best), abs=1e-5)  # both are rounded


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--html", "page.txt"), "does not end in .html"),
        (("--png", "map.png"), "is for one field"),
        (("--save", "plan.json"), "is for one field"),
        (("--width", "3,x"), "is not a width"),
        (("--width", "3,-1"), "use 0.5 to 100 m"),
        (("--checkpoint", "answers.csv"), "does not end in .jsonl"),
        (("--cluster", "nowhere"), "no Dask scheduler at 'nowhere'"),
    ],
)
def test_what_does_not_go_together_is_one_sentence(
    headland: Run, farm: Path, options: tuple[str, ...], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("planner.pipeline.executors.PATIENCE_S", 0.5)
    monkeypatch.chdir(farm.parent)
    local = () if "--cluster" not in options else ("--local", "--tractors", "1")
    outcome = headland("plan", "farm.geojson#*", *(local or QUICK), *options)
    assert_refused(outcome, words)
