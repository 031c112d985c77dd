"""Learning: values of a known truth come back into the farm file, whose other bytes stay; plans use and cite them."""

import json
import math
import random
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fields.errors import HeadlandError
from planner.errors import RequestError
from planner.farm.inventory import load_farm
from planner.farm.value_sources import list_values
from planner.pipeline.farm_inputs import complete_request_by_farm
from planner.request.plan_request import PlanRequest
from planner.task_logs.farm_learning import TurnSpeedFit, append_block, learn_farm_values, remove_blocks, set_value
from planner.task_logs.log_import import import_runs
from planner.task_logs.observations import (
    compute_variation_coefficient,
    estimate_hourly_rate,
    estimate_share,
    estimate_statistic,
)
from tests.works.conftest import HEADER, TURN_S, WIDTH_M, WORK_MPS, binary, main_file
from vehicle.model.tractor import Implement, load_tractor

FARM = f"""# our farm, by hand
[[tractors]]
name = "EG105"   # the only one
file = "eg105"

[[implements]]   # comments stay where they are
name = "drill.3"
width_m = 3.0

[[implements]]
name = "mower"
width_m = {WIDTH_M}
operation = "mow"

# the end
[uncertainty]
turn_cv = 0.5    # a guess
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six runs of the drive by hand."""
    place = tmp_path_factory.mktemp("six")
    stick = place / "TASKDATA"
    stick.mkdir()
    names = [f"TLG{number:05d}" for number in range(1, 7)]
    (stick / "TASKDATA.XML").write_text(main_file("".join(f'<TLG A="{name}"/>' for name in names)))
    for name in names:
        (stick / f"{name}.xml").write_text(HEADER)
        (stick / f"{name}.bin").write_bytes(binary())
    folder = place / "runs"
    folder.mkdir()
    for name, text in import_runs([str(stick)]).files.items():
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def farm(tmp_path: Path) -> Path:
    path = tmp_path / "farm.toml"
    path.write_text(FARM)
    return path


@pytest.fixture(scope="module")
def lesson(runs: Path) -> Any:
    """What the farm learns from them."""
    path = runs.parent / "farm.toml"
    path.write_text(FARM)
    return learn_farm_values([runs], path)


def test_what_is_true_of_the_runs_is_learnt(lesson: Any) -> None:
    learnt = {one.key: one for one in lesson.values}
    speed = learnt["implements.mower.speed_kmh"]
    assert speed.value == pytest.approx(3.6 * WORK_MPS, abs=0.01) and speed.low == speed.high == speed.value
    assert len(speed.runs) == 6 and speed.done == "added"
    # Six runs of 210 s with one stop of 20 s each: 6 / (6 x 190 s) an hour.
    assert learnt["uncertainty.stops_per_hour"].value == pytest.approx(3600.0 / 190.0, rel=1e-3)
    assert learnt["uncertainty.stop_s"].value == 20.0
    assert "Too few events to learn turn_more_cv." in lesson.notes
    assert learnt["uncertainty.turn_cv"].value == 0.0


def test_the_turn_speed_makes_the_simulated_turn_last_as_long(lesson: Any) -> None:
    (turn,) = (one for one in lesson.values if one.key.endswith("turn_speed_kmh"))
    # A turn lasts from the last row at work, one step before the end of the track.
    assert turn.measured.startswith(f"{TURN_S + 1:.1f} s per turn over 1 track")
    simulated = TurnSpeedFit(load_tractor("eg105"), Implement(width_m=WIDTH_M), WORK_MPS, 1)
    assert simulated.simulate_turn_seconds(float(turn.value) / 3.6) == pytest.approx(TURN_S + 1, abs=0.2)


def test_every_other_byte_stays(lesson: Any) -> None:
    added = [line for line in lesson.text.splitlines() if line not in FARM.splitlines()]
    kept = [line for line in lesson.text.splitlines(keepends=True) if line in FARM.splitlines(keepends=True)]
    assert "".join(kept[: len(FARM.splitlines())]) == FARM
    assert all("own logs" in line or line.split(" = ")[0] in ("key", "value", "low", "high", "origin", "runs")
               or line == "[[learned]]" for line in added)  # fmt: skip
    before, after = tomllib.loads(FARM), tomllib.loads(lesson.text)
    assert after["implements"][0] == before["implements"][0] and after["tractors"] == before["tractors"]


@pytest.mark.slow
def test_values_of_ones_own_stay_unless_asked(runs: Path, farm: Path, lesson: Any) -> None:
    (turns,) = (one for one in lesson.values if one.key == "uncertainty.turn_cv")
    assert turns.done == "kept 0.5" and "turn_cv = 0.5    # a guess" in lesson.text
    farm.write_text(lesson.text)
    again = learn_farm_values([runs], farm)
    assert again.text == lesson.text  # what was learnt is learnt anew
    forced = learn_farm_values([runs], farm, replace_given=True)
    assert tomllib.loads(forced.text)["uncertainty"]["turn_cv"] == 0.0
    farm.write_text(lesson.text.replace("speed_kmh = 7.2 ", "speed_kmh = 8.0 "))
    (speed,) = (one for one in learn_farm_values([runs], farm).values if one.key == "implements.mower.speed_kmh")
    assert speed.done == "kept 8"


def test_plans_use_and_cite_it(farm: Path, lesson: Any) -> None:
    farm.write_text(lesson.text)
    own = load_farm(farm)
    question = complete_request_by_farm(PlanRequest(field="iwamizawa"), own, implement_name="mower")
    assert question.request.speed_mps == pytest.approx(WORK_MPS)
    assert question.uncertainty is not None and question.uncertainty.stop_s == 20.0
    assert question.cost_terms is not None
    notes = question.cost_terms.learned_notes
    assert any(words.startswith("speed_kmh 7.2 (95 %: 7.2 to 7.2), median") for words in notes)
    other = complete_request_by_farm(PlanRequest(field="iwamizawa"), own, implement_name="drill.3")
    assert other.cost_terms is not None and not any("speed_kmh" in words for words in other.cost_terms.learned_notes)
    cited = {(value.section, value.key): value.source for value in list_values(own)}
    assert cited["implements mower", "speed_kmh"].startswith("own logs: 7.2 (95 %")
    assert cited["uncertainty", "turn_cv"] == "given"
    farm.write_text(farm.read_text().replace("stop_s = 20.0 ", "stop_s = 30.0 "))
    cited = {(value.section, value.key): value.source for value in list_values(load_farm(farm))}
    assert cited["uncertainty", "stop_s"] == "given"  # changed by hand, so the logs are no source of it


def test_a_ranking_tells_what_its_farm_learnt(farm: Path, lesson: Any) -> None:
    from planner.pipeline.planning import add_machine_names
    from reports.common.plan_results import PlanRanking

    farm.write_text(lesson.text)
    question = complete_request_by_farm(PlanRequest(field="iwamizawa"), load_farm(farm), implement_name="mower")
    told = add_machine_names(PlanRanking("iwamizawa", 1.0, 1, ()), question.cost_terms)
    assert any(words.startswith("speed_kmh 7.2") for words in told.scenario["learned"])
    assert [f"From the farm's own logs: {words}." for words in told.scenario["learned"]] == list(told.assumptions)
    plain = add_machine_names(PlanRanking("iwamizawa", 1.0, 1, ()), None)
    assert plain.assumptions == () and "learned" not in plain.scenario


def test_the_order_of_the_headland_is_asked_for_unless_another_is(farm: Path) -> None:
    farm.write_text(FARM.replace('operation = "mow"', 'operation = "mow"\nheadland = "last"'))
    own = load_farm(farm)
    assert complete_request_by_farm(PlanRequest(), own, implement_name="mower").request.headland_orders == ("last",)
    first = PlanRequest(headland_order="first")
    assert complete_request_by_farm(first, own, implement_name="mower").request.headland_orders == ("first",)
    assert (
        complete_request_by_farm(PlanRequest(no_headland=True), own, implement_name="mower").request.headland_orders
        == ()
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (FARM.replace(f"width_m = {WIDTH_M}", "width_m = 9.0"), "no implement of this width"),
        (FARM.replace("width_m = 3.0", f"width_m = {WIDTH_M}"), "several implements of this width"),
        ("uncertainty = {turn_cv = 0.5}\n" + FARM.split("# the end")[0], "write it as a table under [uncertainty]"),
        (FARM.split("[[implements]]")[0], "has no implement"),
    ],
)
def test_what_cannot_be_learnt_is_told(runs: Path, farm: Path, text: str, words: str) -> None:
    farm.write_text(text)
    with pytest.raises(RequestError) as refusal:
        learn_farm_values([runs], farm)
    assert words in str(refusal.value)


def test_a_farm_file_that_is_not_there_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"no farm file .*none\.toml'; .*headland farm new"):
        learn_farm_values([str(tmp_path)], tmp_path / "none.toml")
    assert not (tmp_path / "none.toml").exists()


def test_values_put_into_text() -> None:
    text = "# top\r\n[a]\r\nx = 1 # one\r\n\r\n# about b\r\n[b]\r\ny = 2\r\n"
    assert set_value(text, "a", None, "x", "3.0", "c") == text.replace("x = 1 # one", "x = 3.0  # c")
    assert set_value(text, "a", None, "z", "3.0", "c") == text.replace("# one\r\n", "# one\r\nz = 3.0  # c\r\n")
    assert set_value(text, "c", None, "z", "3.0", "c") == text + "\r\n[c]\r\nz = 3.0  # c\r\n"
    for heading in ("[ a ]\n", '["a"]\n', " [a]\n"):
        assert set_value(heading, "a", None, "z", "3.0", "c") == f"{heading}z = 3.0  # c\n"
    assert set_value("[[ b ]]\n", "b", 0, "z", "3.0", "c") == "[[ b ]]\nz = 3.0  # c\n"
    block = append_block(text, "learned", {"key": 'a "b"\\', "runs": ["x", "y"], "low": 1.0})
    assert tomllib.loads(block)["learned"] == [{"key": 'a "b"\\', "runs": ["x", "y"], "low": 1.0}]
    assert remove_blocks(block, "learned", {'a "b"\\'}) == text
    assert remove_blocks(block, "learned", {"other"}) == block


def test_texts_come_back_from_a_farm_file() -> None:
    for words in ("a \U000e0001 b", 'tab\t"quoted"', "line\nend"):
        assert tomllib.loads(append_block("", "learned", {"key": words}))["learned"][0]["key"] == words


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    draw = np.random.default_rng(5)
    inside = 0
    for _ in range(60):
        runs = {str(run): 10.0 + draw.normal(0.0, 1.0) + draw.normal(0.0, 2.0, 20) for run in range(20)}
        found = estimate_statistic(runs, np.mean, 5)
        assert found is not None and found.events == 400
        inside += found.low <= 10.0 <= found.high
    assert 50 <= inside <= 60  # 95 % of 60 are 57, with a deviation of 1.7; a bootstrap of few runs is a little narrow


def test_estimates_by_hand() -> None:
    assert compute_variation_coefficient(np.array([1.0, 3.0])) == pytest.approx(math.sqrt(2.0) / 2.0)
    assert estimate_statistic({"a": np.array([1.0])}, np.mean, 2) is None
    one = estimate_hourly_rate({"a": (0, 2.0)})
    # None in two hours: up to -ln(0.025) / 2 an hour.
    assert one is not None and (one.value, one.low) == (0.0, 0.0) and one.high == pytest.approx(-math.log(0.025) / 2.0)
    found = estimate_share(18, tuple(map(str, range(18))))
    z = 1.959964
    assert found.high == pytest.approx(1.0) and found.low == pytest.approx(18.0 / (18.0 + z * z))


def test_farm_files_of_all_kinds_are_kept_or_refused(farm: Path) -> None:
    """Five hundred damaged farm files: what comes out reads back with just the learnt values changed, or is refused."""
    from planner.task_logs.farm_learning import _check_edit, _insert_learned_values
    from reports.task_logs.run_results import LearnedOutcome
    from tests.fields.test_fuzz_forms import damaged

    draw, good = random.Random(20270), 0
    for _ in range(500):
        text = damaged(FARM, draw)
        try:
            from planner.farm.inventory import parse_farm

            own = parse_farm(text, "x", farm.parent)
            key = f"implements.{own.implements[-1].name}.speed_kmh"
            if "implements" not in own.model_fields_set:
                continue
            taught = [
                LearnedOutcome(key, 6.5, 6.0, 7.0, "m", "", ("r",)),
                LearnedOutcome("uncertainty.stop_s", 9.0, 8.0, 10.0, "m", "", ()),
            ]
            edited, told = _insert_learned_values(text, own, taught, replace_given=True)
            _check_edit(edited, "x", farm.parent, own, told)
        except HeadlandError as refusal:
            assert "\n" not in str(refusal).rstrip()
            continue
        good += 1
        assert tomllib.loads(edited)["uncertainty"]["stop_s"] == 9.0
    assert 10 < good < 490


def test_json_of_what_was_taught(lesson: Any) -> None:
    from reports.task_logs.report import format_learned_json

    told = json.loads(format_learned_json(lesson.values, lesson.notes))
    assert [one["key"] for one in told["learned"]] == [one.key for one in lesson.values]
