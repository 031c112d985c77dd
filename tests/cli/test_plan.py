"""`headland plan` from the outside: what it prints, writes and returns."""

import csv
import io
import json
import math
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.drawn_fields import write_farm, write_heights

pytestmark = pytest.mark.usefixtures("first_layout")

CONTRACT = [
    "rank", "strategy", "tractors", "turn", "time_s", "tractor_time_s", "cost", "meets_deadline", "feasible",
    "worked_pct", "overlap_pct", "outside_m", "turning_s", "waiting_s", "reversals", "min_clearance_m", "collisions",
]  # fmt: skip
TWO = ("--tractors", "1-2", "--strategies", "split-field,interleaved", "--processes", "1")
QUICK = ("--tractors", "1-2", "--strategies", "split-field", "--no-headland", "--processes", "1")
OLDER = '<!doctype html>\n<meta name="generator" content="Headland">an older page'
BEGINS = """
import sys
import planner.pipeline.planning as planning
from planner.cli.main import main
iter_outcomes = planning.iter_outcomes
def told(*arguments, **options):
    print("simulating", file=sys.stderr, flush=True)
    return iter_outcomes(*arguments, **options)
planning.iter_outcomes = told
main()
"""
"""The command, which says on standard error that it begins to simulate."""


@pytest.fixture
def answer(once: Run, small: Path) -> dict[str, Any]:
    outcome = once(
        "plan", small, "--local", *TWO, "--json", "--start", "8:00", "--deadline", "8:25", "--seed", "5", "--all"
    )
    assert outcome.status == 0, outcome.err
    found: dict[str, Any] = json.loads(outcome.out)
    return found


def test_json_keeps_its_contract(answer: dict[str, Any]) -> None:
    assert list(answer) == [
        "field", "seed", "plans", "best", "tractor_effects", "scenario", "advice", "currency", "samples",
        "prices_assumed", "unmet", "shortfalls", "parts", "pull", "remarks", "ground", "summary",
    ]  # fmt: skip
    assert answer["tractor_effects"] == {}
    assert answer["field"] == {"name": "small", "area_ha": 0.36}
    assert answer["seed"] == 5
    assert len(answer["plans"]) == 3
    for plan in (*answer["plans"], answer["best"]):
        assert set(CONTRACT) <= set(plan)
    assert answer["best"] in answer["plans"]
    assert [plan["rank"] for plan in answer["plans"]] == [1, 2, 3]
    times = [plan["p50_s"] + plan["finished_s"] - plan["time_s"] for plan in answer["plans"]]
    assert times == sorted(times)


def test_json_types(answer: dict[str, Any]) -> None:
    for plan in answer["plans"]:
        assert type(plan["feasible"]) is bool and type(plan["meets_deadline"]) is bool
        assert plan["meets_deadline"] == (plan["stated_end_s"] <= 1500)
        assert type(plan["rank"]) is type(plan["tractors"]) is type(plan["reversals"]) is int
        assert plan["collisions"] == 0
        assert (plan["min_clearance_m"] is None) == (plan["tractors"] == 1)


@pytest.mark.slow
def test_a_plan_on_heights_says_its_slopes_in_every_form(headland: Run, small: Path, tmp_path: Path) -> None:
    heights = write_heights(tmp_path / "hill.asc", lambda x, y: 100.0 + 0.08 * x, -40.0, 100.0)
    page, picture, saved = (tmp_path / f"plan.{end}" for end in ("html", "png", "json"))
    asked = ("plan", small, "--local", "--tractors", "1", "--strategies", "split-field", "--elevation", heights)
    outcome = headland(*asked, "--soil", "loam", "--html", page, "--png", picture, "--save", saved, "--json")
    assert outcome.status == 0, outcome.err
    told = json.loads(outcome.out)
    slopes = [abs(told["best"][name]["amount"]) for name in ("steepest_along", "steepest_across")]
    assert max(slopes) == pytest.approx(8.0, abs=0.2)
    assert told["best"]["fuel_l"] == pytest.approx(told["best"]["fuel_l_by_tractor"][0])
    assert told["scenario"]["soil"] == "loam" and heights.name in told["scenario"]["elevation"]
    assert any(text.startswith("The soil is loam at ") for text in told["ground"])
    assert "data:image/png;base64," in page.read_text() and picture.stat().st_size > 10_000
    heights.unlink()
    legs = headland("show", saved, "--json")
    assert legs.status == 0, legs.err
    steps = json.loads(legs.out)["tractors"][0]["legs"]
    assert sum(step["fuel_l"] for step in steps) == pytest.approx(told["best"]["fuel_l"], abs=0.3)
    assert max(abs(step["slope_across_pct"]) for step in steps) == pytest.approx(slopes[1], abs=0.1)


def test_without_a_deadline_there_is_no_verdict(headland: Run, small: Path) -> None:
    one = ("--tractors", "1", "--strategies", "split-field", "--no-headland")
    (plan,) = json.loads(headland("plan", small, "--local", *one, "--json").out)["plans"]
    assert plan["meets_deadline"] is None
    assert plan["cost"] == pytest.approx(plan["time_s"] / 3600 * 40, abs=1e-5)


@pytest.mark.slow
def test_a_deadline_that_no_plan_meets(headland: Run, small: Path) -> None:
    words = ("plan", small, "--local", *QUICK, "--start", "8:00", "--deadline", "8:05", "--json")
    outcome = headland(*words)
    answer = json.loads(outcome.out)
    times = [plan["stated_end_s"] for plan in answer["plans"]]
    assert outcome.status == 3 and answer["best"]["stated_end_s"] == min(times)
    assert not any(plan["meets_deadline"] for plan in answer["plans"])
    late = math.ceil((min(times) - 300) / 60)
    assert f"the best is {late} min late. In time with --start 07:{60 - late:02d}." in outcome.err
    earlier = headland(*words[:-5], "--start", f"7:{60 - late:02d}", "--deadline", "8:05", "--json")
    assert earlier.status == 0 and json.loads(earlier.out)["best"]["meets_deadline"] is True
    night = headland(*words[:-5], "--start", "23:50", "--deadline", "0:50", "--json")
    assert night.status == 0 and json.loads(night.out)["best"]["meets_deadline"] is True


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--rain", "8:05"), "No plan finishes before the rain; the closest is 0:"),
        (("--rain", "8:02=50,8:04=50"), "No plan finishes before the rain: the surest does in 0 % of the samples."),
        (("--budget", "1.5"), "No plan is within the budget of 1.50 EUR; the cheapest costs "),
    ],
)
def test_what_no_plan_meets_is_3_with_the_closest_plan(
    headland: Run, small: Path, options: tuple[str, ...], words: str
) -> None:
    outcome = headland("plan", small, "--local", *QUICK, "--samples", "200", "--start", "8:00", *options)
    assert outcome.status == 3 and len(outcome.sentences) == 1 and outcome.err.startswith(words)
    assert words in " ".join(outcome.out.split()) and "tractor" in outcome.out
    assert max(map(len, outcome.out.splitlines())) <= 80


@pytest.mark.slow
def test_csv_says_what_json_says(headland: Run, once: Run, small: Path) -> None:
    plans = json.loads(once("plan", small, "--local", *QUICK, "--json").out)["plans"]
    rows = list(csv.DictReader(io.StringIO(headland("plan", small, "--local", *QUICK, "--csv").out)))
    assert len(rows) == len(plans)
    for row, plan in zip(rows, plans, strict=True):
        assert set(CONTRACT) <= set(row)
        assert row["strategy"] == plan["strategy"] and int(row["tractors"]) == plan["tractors"]
        assert float(row["time_s"]) == plan["time_s"] and row["feasible"] == "true"
        assert row["meets_deadline"] == ""


@pytest.mark.slow
def test_the_table_names_the_best_and_the_cheapest(headland: Run, once: Run, small: Path) -> None:
    outcome = headland("plan", small, "--local", *QUICK)
    best = json.loads(once("plan", small, "--local", *QUICK, "--json").out)["best"]
    assert outcome.status == 0 and outcome.err == ""
    assert best["tractors"] == 1 and "\n1 tractor: done in " in outcome.out, "a second saves too little"
    minutes, seconds = divmod(round(best["time_s"]), 60)
    assert f"{minutes}:{seconds:02d}" in outcome.out
    assert max(len(line) for line in outcome.out.splitlines()) <= 100


@pytest.mark.slow
def test_files_are_written_and_valid(headland: Run, small: Path, tmp_path: Path) -> None:
    page, picture, plan_file = tmp_path / "p.html", tmp_path / "p.png", tmp_path / "p.json"
    page.write_text(OLDER)
    files = ("--html", page, "--png", picture, "--save", plan_file)
    outcome = headland("plan", small, "--local", *TWO, "--no-headland", *files, "--json")
    assert outcome.status == 0, outcome.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.html", "p.json", "p.png"]
    text = page.read_text()
    assert text.lstrip().lower().startswith("<!doctype html>") and text.rstrip().endswith("</html>")
    assert not re.search(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//""", text), "the page loads something"
    assert all(word in text for word in ("split-field", "interleaved", "small"))
    assert picture.read_bytes().startswith(b"\x89PNG\r\n\x1a\n") and picture.stat().st_size > 5000
    from vehicle.missions.plan_file import parse_plan
    from vehicle.model.tractor import Implement, load_tractor
    from vehicle.sim.world import simulate

    best = json.loads(outcome.out)["best"]
    plan = parse_plan(plan_file.read_text(encoding="utf-8"))
    assert plan.tractors == best["tractors"] and plan.notes.strategy == best["strategy"]
    run = simulate(plan, load_tractor("eg105"), Implement(width_m=3.0))
    assert run.duration_s == pytest.approx(best["time_s"], abs=1e-5)


@pytest.mark.slow
def test_options_reach_the_simulation(headland: Run, small: Path) -> None:
    def best(*options: str, rounds: tuple[str, ...] = ("--no-headland",)) -> dict[str, Any]:
        alone = ("--tractors", "1", "--strategies", "split-field", "--processes", "1")
        base = ("plan", small, "--local", *alone, *rounds, "--json")
        found: dict[str, Any] = json.loads(headland(*base, *options).out)["best"]
        return found

    plain = best()
    assert best("--speed-kmh", "8")["time_s"] < plain["time_s"]
    assert best("--width", "4")["time_s"] < plain["time_s"]
    assert best("--headland", "14")["time_s"] != plain["time_s"]
    assert best(rounds=())["worked_pct"] > plain["worked_pct"]
    assert best("--bearing", "90")["time_s"] != plain["time_s"]
    assert best("--turn", "omega", "--headland", "14")["turn"].split("+")[0] in ("omega", "u")
    assert best("--tractor", "mr1000a")["time_s"] != plain["time_s"]
    assert best("--price-per-hour", "80", "--price-per-tractor", "3")["cost"] == pytest.approx(2 * plain["cost"] + 3)


@pytest.mark.slow
def test_a_part_of_a_collection_can_be_chosen(headland: Run, tmp_path: Path) -> None:
    place = write_farm(tmp_path / "farm.geojson", west=(0, 40, 70), east=(100, 40, 70))
    outcome = headland("plan", f"{place}#east", "--local", "--tractors", "1", "--no-headland", "--json")
    assert outcome.status == 0, outcome.err
    assert json.loads(outcome.out)["field"]["name"] == "east"


def begun(*arguments: str, **options: Any) -> subprocess.Popen[str]:
    """A process of the command that has begun to simulate plans, and knows no answer."""
    rules = ("-W", "error", "-W", "ignore::ResourceWarning")  # a signal may come between open and with, in any library
    words, pipe = [sys.executable, *rules, "-c", BEGINS, *arguments], subprocess.PIPE
    environment = {**os.environ, "HEADLAND_CACHE": os.devnull}
    process = subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True, env=environment, **options)
    assert process.stderr is not None
    assert any(line == "simulating\n" for line in process.stderr)
    return process


class TestProcess:
    @pytest.mark.matrix
    def test_the_default_field_with_warnings_as_errors(self, headland_process: Run) -> None:
        outcome = headland_process("plan", "--tractors", "1", "--strategies", "split-field", "--json")
        assert outcome.status == 0, outcome.err
        assert json.loads(outcome.out)["field"] == {"name": "iwamizawa", "area_ha": 1.89}

    @pytest.mark.slow
    @pytest.mark.skipif(os.name != "posix", reason="needs a signal")
    def test_interrupting_ends_with_130_and_leaves_the_old_file(self, small: Path, tmp_path: Path) -> None:
        page = tmp_path / "page.html"
        page.write_text(OLDER)
        with begun("plan", str(small), "--local", *QUICK, "--html", str(page)) as process:
            process.send_signal(signal.SIGINT)
            out, complaint = process.communicate(timeout=240)
        assert process.returncode == 130
        assert out == "" and "Traceback" not in complaint and len(complaint.splitlines()) <= 1
        assert page.read_text() == OLDER
        assert [path.name for path in tmp_path.iterdir()] == ["page.html"]

    @pytest.mark.matrix
    @pytest.mark.skipif(os.name != "posix", reason="needs a group of processes")
    def test_interrupting_all_processes_is_one_sentence(self) -> None:
        words = ("plan", "netherlands", "--tractors", "1-6", "--processes", "2")
        with begun(*words, start_new_session=True) as process:
            os.killpg(process.pid, signal.SIGINT)
            out, complaint = process.communicate(timeout=240)
        assert process.returncode == 130 and out == ""
        assert complaint.strip() == "Error: Interrupted; nothing was written."


def test_a_strategy_named_twice_is_tried_once(headland: Run, small: Path) -> None:
    twice = ("--tractors", "1", "--no-headland", "--strategies", "split-field,split-field")
    assert len(json.loads(headland("plan", small, "--local", *twice, "--json").out)["plans"]) == 1


@pytest.mark.slow
def test_effects_of_the_tractor_file_are_told(headland: Run, small: Path, tmp_path: Path) -> None:
    from vehicle.model.tractor import DiscrepancyModel, EffectSetting, load_tractor
    from vehicle.model.tractor_writer import format_tractor_toml

    found = {"steering_offset": EffectSetting(value={"angle_deg": 1.25})}
    rest = DiscrepancyModel(amounts={"angle_by_speed": 0.3}, speed_mps=(0.0, 3.0), angle_deg=(-30.0, 30.0))
    machine = tmp_path / "mine.toml"
    page = tmp_path / "plan.html"
    words = "Simulated with what measured logs showed of this tractor: steering offset (steering_offset): 1.25 deg"
    for one, last in ((rest, "; a discrepancy model."), (rest.model_copy(update={"on": False}), ".")):
        extended = load_tractor("eg105").model_copy(update={"effects": found, "discrepancy_model": one})
        machine.write_text(format_tractor_toml(extended), encoding="utf-8")
        base = ("plan", small, "--local", *QUICK, "--tractors", "1", "--tractor", machine)
        told = " ".join(headland(*base, "--explain", "--html", page).out.split())
        assert words + last in told
        assert words + last in page.read_text(encoding="utf-8")
        effects = json.loads(headland(*base, "--json").out)["tractor_effects"]
        seen = {"discrepancy_model": {"angle_by_speed": 0.3}} if one.on else {}
        assert effects == {"steering_offset": {"angle_deg": 1.25}} | seen
    assert "measured logs" not in headland(*base[:-2], "--explain").out
