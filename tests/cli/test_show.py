"""`headland show`: a saved plan driven again, told leg by leg."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused

pytestmark = pytest.mark.usefixtures("first_layout")

WORDS = ("--local", "--tractors", "2", "--strategies", "split-field", "--processes", "1", "--json")


Saved = tuple[Path, dict[str, Any]]


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> list[Saved]:
    """The saved plan, once it is made."""
    return []


@pytest.fixture
def saved(small: Path, tmp_path_factory: pytest.TempPathFactory, headland: Run, kept: list[Saved]) -> Saved:
    """A saved plan, and what was said of it when it was made."""
    if not kept:
        place = tmp_path_factory.mktemp("show") / "plan.json"
        made = headland("plan", small, *WORDS, "--save", place, "--start", "08:00")
        assert made.status == 0, made.err
        kept.append((place, json.loads(made.out)["best"]))
    return kept[0]


@pytest.mark.slow
def test_a_saved_plan_driven_again_takes_as_long(headland: Run, saved: Saved) -> None:
    place, best = saved
    outcome = headland("show", place, "--json")
    assert outcome.status == 0 and outcome.err == ""
    told = json.loads(outcome.out)
    assert (told["field"], told["strategy"], told["start"]) == (told["field"], "split-field", "08:00")
    assert told["time_s"] == pytest.approx(best["time_s"], abs=1e-6)
    ends = [own["legs"][-1]["from_s"] + own["legs"][-1]["seconds"] for own in told["tractors"]]
    assert max(ends) == pytest.approx(best["time_s"], abs=0.11)
    assert {leg["headland_pass"] for own in told["tractors"] for leg in own["legs"]} >= set(
        range(1, best["headland_passes"] + 1)
    )


@pytest.mark.slow
def test_the_table_fits_and_tells_times_of_day(headland: Run, saved: Saved) -> None:
    outcome = headland("show", saved[0])
    lines = outcome.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert sum(line.startswith("Tractor ") for line in lines) == 2
    first = next(line for line in lines if line.split()[:1] == ["1"])
    assert "8:00:00" in first.split() and ("round 1, side" in first or "track " in first)


def test_one_tractor_alone(headland: Run, saved: Saved) -> None:
    assert "Tractor 2" in (out := headland("show", saved[0], "--tractor", "2").out) and "Tractor 1:" not in out
    assert_refused(headland("show", saved[0], "--tractor", "3"), "--tractor is 3; the plan has tractors 1 to 2.")


def changed(place: Path, folder: Path, **values: Any) -> Path:
    data = json.loads(place.read_text())
    data.update(values)
    other = folder / "changed.json"
    other.write_text(json.dumps(data))
    return other


def test_what_cannot_be_shown_is_one_sentence(headland: Run, saved: Saved, small: Path, tmp_path: Path) -> None:
    place, _ = saved
    scenario = json.loads(place.read_text())["scenario"]
    for path, words in (
        (tmp_path / "none.json", "There is no file"),
        (small, "has no 'format_version'"),
        (changed(place, tmp_path, scenario={}), "has no scenario"),
    ):
        assert_refused(headland("show", path), words)
    for entry, words in (
        ({"strange": 1}, "'strange', which is unknown"),
        ({"tractor": "gone.toml"}, "gone.toml"),
        ({"tractor": "Fendt 724"}, "an older Headland that saved no machines; plan again"),
        ({"width_m": -1.0}, "--width"),
        ({"width_m": "wide"}, "--width is 'wide'"),
    ):
        assert_refused(headland("show", changed(place, tmp_path, scenario={**scenario, **entry})), words)


def test_a_plan_in_which_tractors_touch_is_remarked_on(headland: Run, saved: Saved, tmp_path: Path) -> None:
    data = json.loads(saved[0].read_text())
    # Two towards each other, their lines 2.4 m apart: implements of 3 m graze each other where they meet.
    leg = {**data["tractors"][0][0], "points_m": [[10.0, 40.0], [40.0, 40.0]], "gates": [], "implement": True}
    other = {**leg, "points_m": [[40.0, 42.4], [10.0, 42.4]]}
    outcome = headland("show", changed(saved[0], tmp_path, tractors=[[leg], [other]]))
    assert outcome.status == 0
    assert [line.split(" after ")[0] for line in outcome.sentences] == ["Note: Tractors 1 and 2 collide"]
    assert "Tractor 1: 1 leg, " in outcome.out


def test_a_plan_that_stops_on_its_way_is_refused(headland: Run, saved: Saved, tmp_path: Path) -> None:
    data = json.loads(saved[0].read_text())
    # Both wait for the end of the other's last leg.
    for me, other in ((0, 1), (1, 0)):
        last = len(data["tractors"][other]) - 1
        data["tractors"][me][0]["gates"] = [{"tractor": other, "leg": last, "after_m": 0.0}]
    outcome = headland("show", changed(saved[0], tmp_path, tractors=data["tractors"]))
    assert_refused(outcome, "is not driven to its end (stall)")
