"""`--entrance`, entrances of files, and the farm's day, on the command line."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused

pytestmark = pytest.mark.usefixtures("first_layout")

PLAN = ("--local", "--tractors", "2", "--strategies", "split-field", "--processes", "1")
FARM = """
[times]
unfold_s = 60.0
fold_s = 90.0
shift_start = "07:00"
shift_end = "12:00"
"""


def planned(told: Any) -> dict[str, Any]:
    assert told.status == 0, told.err
    return dict(json.loads(told.out)["plans"][0])


@pytest.mark.slow
def test_an_entrance_on_the_command_line_is_driven_to(headland: Run, small: Path, tmp_path: Path) -> None:
    """The ways take time; saved and shown again each tractor's list begins and ends at the entrance."""
    plain = planned(headland("plan", small, *PLAN, "--json"))
    saved = tmp_path / "plan.json"
    gated = planned(headland("plan", small, *PLAN, "--json", "--entrance", "22,-3", "--save", saved))
    assert plain["done_s"] == plain["time_s"] and plain["transport_s"] is None and plain["home_s"] is None
    assert 10.0 < gated["time_s"] - plain["time_s"] < 300.0 and 5.0 < gated["time_s"] - gated["done_s"] < 200.0
    lists = json.loads(headland("show", saved, "--json").out)["tractors"]
    kinds = [[leg["kind"] for leg in each["legs"] if leg["kind"] != "wait"] for each in lists]
    assert all((own[0], own[-1]) == ("enter", "leave") for own in kinds)
    assert "from the entrance to" in headland("show", saved).out


@pytest.mark.parametrize("command", ["plan", "field"])
@pytest.mark.parametrize(("entrance", "words"), [
    ("22,-80", "80 m outside;"), ("22,40", "22 m inside,"), ("22", "is not a place"), ("nan,3", "two numbers"),
])  # fmt: skip
def test_entrances_that_cannot_be_used_are_refused(
    headland: Run, small: Path, command: str, entrance: str, words: str
) -> None:
    assert_refused(headland(command, small, "--local", "--entrance", entrance), words, "--entrance")


def test_the_day_of_a_farm_is_told_in_lines(headland: Run, small: Path, tmp_path: Path) -> None:
    farm = tmp_path / "farm.toml"
    farm.write_text(FARM, encoding="utf-8")
    words = ("plan", small, *PLAN, "--tractors", "1", "--no-headland", "--farm", farm, "--transport-width", "2.5")
    result = planned(headland(*words, "--json"))
    assert result["transport_s"] == pytest.approx(150.0) and result["ready_s"] == 60.0
    assert result["done_s"] == pytest.approx(60.0 + result["time_s"], abs=1e-3)
    late = headland(*words, "--start", "11:55", "--deadline", "10:00", "--samples", "0", "--explain")
    text = " ".join(late.out.split())
    assert "The deadline at 10:00 is taken as the next day's: the start is at 11:55." in text
    assert "The shift ends at 12:00 before the work is done; it continues at 07:00 next day." in text
    assert "field work from 11:56 to 07:" in text
