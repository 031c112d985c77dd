"""`headland farm`, and plans with the machines and prices of a farm."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused

pytestmark = pytest.mark.usefixtures("first_layout")

FARM = """
[[tractors]]
name = "Carrier"
count = 1
[tractors.sheet]
wheelbase_m = 1.6
width_m = 1.5
turning_radius_m = 2.6

[[implements]]
name = "harrow"
width_m = 4.0
hitch_m = 1.0
speed_kmh = 6.0

[[implements]]
name = "drill"
width_m = 3.0
operation = "sow"
tractors = ["Carrier"]

[prices]
per_hour = 30.0
supervision_share = 0.0
transport_per_tractor = 5.0
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one farm file to work in."""
    (tmp_path / "farm.toml").write_text(FARM, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def asked(told: Any) -> dict[str, Any]:
    assert told.status == 0, told.err
    return dict(json.loads(told.out)["scenario"])


@pytest.mark.parametrize("command", ["farm", "day"])
def test_the_example_is_printed_and_written_alike(headland: Run, folder: Path, command: str) -> None:
    printed = headland(command, "example").out
    made = headland(command, "new", "mine.toml")
    assert made.status == 0 and (folder / "mine.toml").read_text(encoding="utf-8") == printed
    assert headland(command, "new", "mine.toml").status == 2
    assert headland(command, "new", "mine.toml", "--force").status == 0


def test_the_example_of_a_farm_is_checked(headland: Run, folder: Path) -> None:
    headland("farm", "new", "mine.toml")
    told, whole = headland("farm", "check", "mine.toml"), headland("farm", "check", "mine.toml", "--explain").out
    assert told.status == 0 and "2 x Fendt 724: 8000 kg" in " ".join(told.out.split())
    assert len(told.out.splitlines()) <= 24 and "--explain" in told.out and "fuel_per_l" not in told.out
    assert "fuel_per_l" in whole and whole.count("[prices]") == 1


def test_the_check_gives_every_value_with_its_source(headland: Run, folder: Path) -> None:
    content = json.loads(headland("farm", "check", "farm.toml", "--json").out)
    assert content["tractors"][0]["name"] == "Carrier" and content["implements"] == ["harrow", "drill"]
    told = {(value["section"], value["key"]): value for value in content["values"]}
    assert told["prices", "per_hour"]["source"] == "given" and told["prices", "per_hour"]["value"] == 30.0
    assert told["times", "refill_s"]["source"].startswith("assumed")
    assert all(value["source"] for value in content["values"])


def test_a_plan_is_made_with_the_farms_machines(headland: Run, folder: Path, small: Path) -> None:
    words = ("plan", small, "--local", "--farm", "farm.toml", "--strategies", "split-field", "--json")
    scenario = asked(headland(*words, "--no-headland"))
    assert (scenario["tractor"], scenario["width_m"]) == ("Carrier", 4.0)
    assert scenario["speed_kmh"] == pytest.approx(6.0)
    assert (scenario["price_per_hour"], scenario["price_per_tractor"]) == (30.0, 5.0)
    other = asked(headland(*words, "--no-headland", "--implement", "drill", "--width", 3.5, "--price-per-hour", 10))
    assert (other["width_m"], other["operation"], other["price_per_hour"]) == (3.5, "sow", 10.0)
    assert scenario["radius_m"] == pytest.approx(other["radius_m"])  # that of the tractor, on soil


def test_a_plan_of_a_farm_is_shown_as_it_was_driven_and_its_shift_is_the_start(
    headland: Run, folder: Path, small: Path
) -> None:
    other = FARM.replace("hitch_m = 1.0", "hitch_m = 1.6") + '\n[times]\nshift_start = "07:30"\n'
    (folder / "farm.toml").write_text(other, encoding="utf-8")
    words = ("plan", small, "--local", "--farm", "farm.toml", "--strategies", "split-field", "--no-headland")
    made = headland(*words, "--deadline", "12:00", "--samples", "100", "--json", "--save", "plan.json")
    assert made.status == 0, made.err
    content = json.loads(made.out)
    assert (content["scenario"]["start"], content["scenario"]["deadline"]) == ("07:30", "12:00")
    saved = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    assert saved["scenario"]["machines"]["implement"]["hitch_m"] == 1.6
    shown = json.loads(headland("show", "plan.json", "--json").out)
    assert shown["time_s"] == pytest.approx(content["best"]["time_s"], abs=1e-9)
    saved["scenario"]["machines"]["tractor"] = None
    (folder / "plan.json").write_text(json.dumps(saved), encoding="utf-8")
    refused = headland("show", "plan.json")
    assert refused.status == 2 and "save the plan again" in refused.err


def test_the_headline_names_the_farms_machines(headland: Run, folder: Path, small: Path) -> None:
    told = headland("plan", small, "--local", "--farm", "farm.toml", "--strategies", "split-field", "--no-headland")
    assert told.out.splitlines()[0] == "small, 0.36 ha, Carrier, harrow 4 m, 6 km/h"


def test_a_field_is_looked_at_with_the_farms_machines(headland: Run, folder: Path, small: Path) -> None:
    told = headland("field", small, "--local", "--farm", "farm.toml", "--json")
    plain = headland("field", small, "--local", "--width", 4.0, "--json")
    own, thesis = (json.loads(each.out)["turning_radius_m"] for each in (told, plain))
    assert own < thesis


def test_a_tractor_of_the_farm_is_checked_by_its_name(headland: Run, folder: Path) -> None:
    told = headland("tractor", "check", "Carrier", "--farm", "farm.toml", "--json")
    assert told.status == 0 and json.loads(told.out)["holds_together"] is True


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("plan", "--farm", "none.toml"), "There is no file 'none.toml'"),
        (("plan", "--implement", "harrow"), "add --farm or leave it out"),
        (("plan", "--farm", "farm.toml", "--implement", "harow"), "did you mean 'harrow'?"),
        (
            ("plan", "--farm", "farm.toml", "--implement", "drill", "--operation", "mow"),
            "--implement 'drill' is there to sow, and --operation is mow; leave out --operation.",
        ),
        (("plan", "--farm", "farm.toml", "--tractor", "Carier"), "did you mean 'Carrier'?"),
        (("plan", "--farm", "farm.toml", "--tractors", "1-3"), "--tractors asks for 3, and the farm has 1 x Carrier"),
        (("plan", "--farm", "farm.toml", "--save", "farm.toml"), "would overwrite the farm file"),
        (("plan", "--farm", "bad.toml"), "prices.fuel_per_l = -1.0: give a number from 0"),
        (("farm", "check", "bad.toml"), "uncertainty.speed_cw is not known (did you mean 'speed_cv'?)"),
        (("farm", "new", "farm.json"), "name the file farm.toml"),
        (("tractor", "check", "Fendt", "--farm", "farm.toml"), "no tractor 'Fendt'"),
    ],
)
def test_bad_input_is_one_sentence(headland: Run, folder: Path, arguments: tuple[str, ...], words: str) -> None:
    (folder / "bad.toml").write_text("[prices]\nfuel_per_l = -1.0\n[uncertainty]\nspeed_cw = 1\n", encoding="utf-8")
    told = headland(*arguments)
    assert_refused(told, words)
    assert (folder / "farm.toml").read_text(encoding="utf-8") == FARM
