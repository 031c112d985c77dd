"""`headland plan` with an implement that carries something."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused
from tests.drawn_fields import feature, point, rectangle, write_features

pytestmark = pytest.mark.usefixtures("first_layout")

FARM = """
[[implements]]
name = "spreader"
width_m = 3.0
capacity = 400.0
rate_per_m2 = 0.3
[[implements]]
name = "harrow"
width_m = 3.0
[times]
refill_s = 60.0
"""


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, headland: Run) -> Run:
    """`headland plan` on 60 m by 90 m with a farm that has a spreader."""
    (tmp_path / "farm.toml").write_text(FARM, encoding="utf-8")
    field = feature(rectangle(0, 0, 60, 90))
    write_features(tmp_path / "field.geojson", field, feature(point(0, 0), role="refill"))
    monkeypatch.chdir(tmp_path)
    same = ("--local", "--farm", "farm.toml", "--strategies", "split-field", "--tractors", "1", "--processes", "1")
    return lambda *options: headland("plan", "field.geojson", *same, "--no-headland", *options)


@pytest.mark.slow
def test_a_plan_tells_its_refills_where_they_are_asked_for(plan: Run) -> None:
    told = plan("--refill", "headland", "--save", "plan.json", "--html", "plan.html", "--png", "plan.png", "--json")
    assert told.status == 0, told.err
    answer = json.loads(told.out)
    best = answer["best"]
    assert best["refills"] > 1
    assert best["refilling_s"] == pytest.approx(60.0 * best["refills"], abs=0.2 * best["refills"])
    assert (answer["scenario"]["refill"], answer["scenario"]["capacity"]) == ("headland", 400.0)
    saved = json.loads(Path("plan.json").read_text())
    assert len(saved["notes"]["refills"]) == best["refills"]
    for one in saved["notes"]["refills"]:
        assert saved["tractors"][one["tractor"] - 1][one["leg"]]["stand_s"] == 60.0
        assert 0.0 < one["amount"] <= 400.0
    page = Path("plan.html").read_text()
    assert "refilling" in page and "Refills" in page and "refill 3" in page


@pytest.mark.slow
def test_the_place_of_the_field_file_is_used_and_another_wins(plan: Run) -> None:
    told = plan("--json")
    answer = json.loads(told.out)
    assert told.status == 0 and "not used" not in told.err.lower() and "refills" in " ".join(answer["summary"])
    assert answer["scenario"]["refill"] == "0.00,0.00 m"
    assert json.loads(plan("--json", "--refill", "60,90").out)["scenario"]["refill"] == "60.00,90.00 m"


def test_an_implement_that_carries_nothing_is_not_refilled(plan: Run) -> None:
    answer = json.loads(plan("--implement", "harrow", "--json").out)
    assert answer["best"]["refills"] is None and answer["best"]["refilling_s"] is None
    assert "capacity" not in answer["scenario"]
    told = plan("--implement", "harrow")
    assert "refill" not in told.out.lower()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--refill", "gate"), "--refill 'gate' is not a place; write headland, tender or x,y in metres"),
        (("--refill", "500,0"), "The place to refill or charge lies 440 m from the field"),
        (("--implement", "harrow", "--refill", "tender"), "no implement carries anything"),
    ],
)
def test_bad_requests_are_one_sentence(plan: Run, options: tuple[str, ...], words: str) -> None:
    told = plan(*options)
    assert_refused(told, words)
