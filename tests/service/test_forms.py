"""Days and farms as forms: text and values are two views of one thing, and each fault has its place."""

import re
import tomllib
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel
from starlette.testclient import TestClient

from planner.day.input_file import DayField, DayFile, DayFleet, DayRoad
from planner.farm.inventory import FarmFile
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.random_inputs import UncertaintySettings
from planner.farm.settings import FarmPrices, FarmTimes, Yard, read_example_text
from planner.service.jobs.input_files import OPTIONS_BY_NAME
from planner.service.pages.static_files import STATIC_FOLDER
from planner.service.sandbox.readings import read_day_form, read_farm_form
from strategies.names import STRATEGY_NAMES
from tests.examples import count_examples
from tests.service.conftest import Shared
from tests.service.test_library import add, add_field
from vehicle.datasheet.sheet import Datasheet

DAY = read_example_text("day")


def change(client: TestClient, kind: str, text: str, *changes: tuple[list[Any], Any]) -> Any:
    """The form after changes of (path, value)."""
    body = {"text": text, "changes": [{"path": path, "value": value} for path, value in changes]}
    answer = client.post(f"/api/v1/forms/{kind}", json=body)
    assert answer.status_code == 200, answer.text
    return answer.json()


def find_fault(form: Any, *path: str | int) -> str:
    """The sentence at a place; fails where there is none."""
    sentence: str = next(each["sentence"] for each in form["faults"] if each["path"] == list(path))
    return sentence


@pytest.mark.parametrize(("kind", "text"), [("day", DAY), ("farm", read_example_text("farm"))])
def test_the_example_is_a_form_without_faults_and_nothing_is_stored(shared: Shared, kind: str, text: str) -> None:
    client, _ = shared
    form = client.get(f"/api/v1/forms/{kind}").json()
    assert form["text"] == text and form["faults"] == [] and form["values"] == tomllib.loads(text)
    assert form["choices"]["tractor"] == ["Fendt 724", "EG105"]
    assert change(client, kind, text) == form
    store: Any = client.app.state.store  # type: ignore[attr-defined]
    assert store.blobs.list_paths() == []


def test_values_are_set_added_and_removed_and_comments_stay(shared: Shared) -> None:
    client, _ = shared
    form = change(
        client, "day", DAY, (["start"], "06:30"), (["fields", 0, "name"], "Große \"Breite\"\n"), (["rain"], None),
        (["fields", 3], {"file": "denmark"}), (["fields", 3, "windows"], ["08:00-12:00", "13:00-14:00"]),
        (["roads", 0], None), (["fleets", 0, "count"], 1), (["certainty_pct"], 80),
    )  # fmt: skip
    values = tomllib.loads(form["text"])
    assert values == form["values"] and form["faults"] == []
    assert values["start"] == "06:30" and "rain" not in values and values["certainty_pct"] == 80
    assert values["fields"][0]["name"] == 'Große "Breite"\n' and values["fleets"][0]["count"] == 1
    assert values["fields"][3] == {"file": "denmark", "windows": ["08:00-12:00", "13:00-14:00"]}
    assert not values.get("roads")
    kept = [line.partition("#")[2] for line in DAY.splitlines() if "#" in line and "percent" not in line]
    assert all(comment in form["text"] for comment in kept if "straight line" not in comment)
    farm = change(
        client, "farm", "", (["tractors", 0], {"name": "red"}), (["tractors", 0, "sheet", "wheelbase_m"], 2.5)
    )
    assert tomllib.loads(farm["text"]) == {"tractors": [{"name": "red", "sheet": {"wheelbase_m": 2.5}}]}


def test_a_bad_value_is_told_of_at_its_place(shared: Shared) -> None:
    client, _ = shared
    form = change(
        client, "day", DAY, (["start"], "25:00"), (["fields", 1, "windows"], ["9-12 o'clock"]),
        (["roads", 0, "km"], -3), (["fleets", 1, "count"], 0), (["fields", 2, "file"], None),
    )  # fmt: skip
    assert "25:00" in find_fault(form, "start") and "hours" in find_fault(form, "fields", 1, "windows", 0)
    assert find_fault(form, "roads", 0, "km").startswith("-3") and "0 to 1000" in find_fault(form, "roads", 0, "km")
    assert "1 to" in find_fault(form, "fleets", 1, "count")
    assert find_fault(form, "fields", 2, "file") == "Give a field file or sample."
    assert all(each["sentence"].endswith(".") for each in form["faults"]) and len(form["faults"]) == 5


def test_contradictions_are_told_of_where_their_names_are(shared: Shared) -> None:
    client, token = shared
    form = change(client, "day", DAY, (["fleets", 0, "tractor"], "Deutz"))
    assert "has no tractor 'Deutz'" in find_fault(form, "fleets", 0, "tractor")
    form = change(client, "day", DAY, (["fleets", 0, "count"], 9))
    assert "the farm only 2" in find_fault(form)
    form = change(client, "day", DAY, (["fields", 1, "file"], "nowhere"), (["farm"], "gone.toml"))
    assert "no field 'nowhere'" in find_fault(form, "fields", 1, "file") and "no farm 'gone'" in find_fault(
        form, "farm"
    )
    assert add_field(client, token, "nowhere").status_code == 201
    farm = read_example_text("farm").replace("EG105", "robot").encode()
    assert add(client, token, "farms", "gone.toml", farm).status_code == 201
    form = change(client, "day", form["text"])
    assert form["choices"]["tractor"] == ["Fendt 724", "robot"]
    assert "has no tractor 'EG105'" in find_fault(form, "fleets", 1, "tractor")
    assert change(client, "day", form["text"], (["fleets", 1, "tractor"], "robot"))["faults"] == []
    farm_form = change(client, "farm", farm.decode(), (["tractors", 1, "file"], "gone.toml"))
    assert "no tractor 'gone'" in find_fault(farm_form, "tractors", 1, "file")
    form = change(client, "day", DAY, (["fields", 0, "elevation"], "hill.tif"), (["rain"], "wet.csv"))
    assert "no elevation 'hill'" in find_fault(form, "fields", 0, "elevation")
    assert "no table 'wet'" in find_fault(form, "rain") and len(form["faults"]) == 2
    for kind, name in (("fields", "nowhere"), ("farms", "gone")):
        assert client.delete(f"/api/v1/{kind}/{name}", headers=token).status_code == 204


@pytest.mark.parametrize(
    "text",
    ["a = ", "[[fields]]\nfile = 1\nfile = 2", "x" * 5, "a = " + "[" * 40 + "]" * 40, "=", "\x00", "a.b = 1\na = 2"],
)
def test_a_text_that_is_not_toml_is_told_of(shared: Shared, text: str) -> None:
    client, _ = shared
    form = change(client, "day", text)
    assert form["text"] == text and form["values"] == {} and "not TOML" in find_fault(form)
    answer = client.post("/api/v1/forms/day", json={"text": text, "changes": [{"path": ["start"], "value": "07:00"}]})
    assert answer.status_code == 422 and "Correct the text first" in answer.json()["error"]


@pytest.mark.parametrize(
    "path", [["fields", 7], ["fields", "name"], ["start", "x"], ["fields", 9, "name"], ["yard", 0], ["start", 0]]
)
def test_a_change_without_a_place_is_refused(shared: Shared, path: list[Any]) -> None:
    client, _ = shared
    body = {"text": DAY.replace("[yard]", 'start = "1"\n[yard]', 0), "changes": [{"path": path, "value": "x"}]}
    answer = client.post("/api/v1/forms/day", json=body)
    assert answer.status_code == 422 and answer.json()["error"].endswith("."), answer.text


def test_odd_values_do_not_break_the_answer(shared: Shared) -> None:
    client, _ = shared
    form = change(
        client, "day", "a = inf\nb = nan\nc = 2026-05-01\nfields = 3\nfleets = [[1]]\n[yard]\nlon = 07:00:00\n"
    )
    assert form["values"]["a"] == "inf" and form["values"]["c"] == "2026-05-01" and form["faults"]
    form = change(client, "day", 'fields = [{file = "denmark"}]\n', (["fields", 0, "name"], "x"))
    assert form["values"] == {"fields": [{"file": "denmark", "name": "x"}]}


@given(
    names=st.lists(st.text(st.characters(blacklist_categories=["Cs"]), max_size=30), min_size=1, max_size=4),
    km=st.floats(0, 1000),
)
@settings(max_examples=count_examples(25))
def test_what_a_form_writes_it_reads(names: list[str], km: float) -> None:
    changes: list[Any] = []
    for position, name in enumerate(names):
        changes += [{"path": ["roads", position], "value": {"km": km}}]
        changes += [{"path": ["roads", position, "between"], "value": [name, "yard"]}]
    text = read_day_form("# kept\n", changes)["text"]
    assert text.startswith("# kept\n")
    assert tomllib.loads(text) == {"roads": [{"km": km, "between": [name, "yard"]} for name in names]}
    emptied = read_farm_form(text, [{"path": ["roads", 0], "value": None} for _ in names])["text"]
    assert not tomllib.loads(emptied).get("roads")


def test_the_pages_ask_for_every_option_of_a_plan_and_for_keys_that_files_of_days_and_farms_have() -> None:
    scripts = STATIC_FOLDER / "js"
    text = "".join((scripts / name).read_text() for name in ("planoptions.js", "trackmap.js", "pages/plan.js"))
    words = set(re.findall(r"\w+", text))
    assert [name for name in OPTIONS_BY_NAME if name not in words] == []
    layouts = (scripts / "layouts.js").read_text()
    asked = {key.split(".")[-1] for key in re.findall(r'\["([a-z_]+(?:\.[a-z_]+)?)", "[A-Z]', layouts)}
    machines: list[type[BaseModel]] = [FarmTractor, FarmImplement, Datasheet]
    sections: list[type[BaseModel]] = [FarmPrices, FarmTimes, UncertaintySettings, Yard]
    models: list[type[BaseModel]] = [DayFile, DayField, DayFleet, DayRoad, FarmFile, *machines, *sections]
    assert asked - {name for model in models for name in model.model_fields} == set() and len(asked) > 60


def test_the_form_of_a_plan_has_every_option_with_its_label_and_unit_and_every_strategy(shared: Shared) -> None:
    form = shared[0].get("/api/v1/forms/plan").json()
    labels, options, strategies = form["labels"], form["options"], form["strategies"]
    assert set(OPTIONS_BY_NAME) <= set(labels) and set(options) == set(OPTIONS_BY_NAME)
    units = {
        name: option.limits.unit for name, option in OPTIONS_BY_NAME.items() if option.limits and option.limits.unit
    }
    assert [name for name, unit in units.items() if not labels[name].endswith(f", {unit}")] == [] and len(units) > 10
    assert not [label for label in labels.values() if label.startswith("-") or "_" in label], "no names of programs"
    rows = re.findall(r'\["(\w+)", \{', (STATIC_FOLDER / "js" / "planoptions.js").read_text())
    assert set(rows) <= set(labels) and len(rows) > 35
    kinds = {name: options[name]["kind"] for name in ("width", "part", "all", "obstacle", "deadline", "turn")}
    assert list(kinds.values()) == ["number", "number", "check", "list", "text", "choice"]
    assert options["turn"]["choices"] == ["auto", "u", "omega", "switch-back"]
    assert options["objective"]["choices"] == ["", "fastest", "cheapest", "surest", "fuel"]
    assert tuple(strategies) == STRATEGY_NAMES
    assert all(label.startswith(f"{name}: ") for name, label in strategies.items())


def test_a_refusal_comes_with_the_labels_of_the_form_too(shared: Shared) -> None:
    client, token = shared
    answer = client.post("/api/v1/plans", json={"headland": 6.0, "headland_passes": 2}, headers=token)
    rule = "{} is its depth, and {} says in how many passes it is worked; leave out one of them."
    assert answer.status_code == 422 and answer.json() == {
        "error": rule.format("headland", "headland_passes"),
        "parameter": "headland",
        "labelled": rule.format("\u201cHeadland depth, m\u201d", "\u201cPasses on the headland\u201d"),
    }
