"""Learning: values of a known truth come back into the farm file, whose other bytes stay; plans use and cite them."""

from __future__ import annotations

import json
import math
import random
import tomllib
from pathlib import Path

import numpy as np
import pytest

from fields.errors import HeadlandError
from planner.asked import asked
from planner.errors import ScenarioError
from planner.farm import load_farm
from planner.farm.sources import values_of
from planner.scenario import Scenario
from planner.works.estimates import estimate, mean, rate, share, variation
from planner.works.importing import imported
from planner.works.learning import learn
from planner.works.toml_edit import with_block, with_value, without_blocks
from planner.works.turning import TurnSpeed
from tests.works.conftest import HEADER, TURN_S, WIDTH_M, WORK_MPS, binary, main_file
from vehicle.tractor import Implement, load_tractor

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
[chances]
turn_cv = 0.5    # a guess
"""


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Six runs of the drive by hand."""
    stick = tmp_path / "TASKDATA"
    stick.mkdir()
    names = [f"TLG{number:05d}" for number in range(1, 7)]
    (stick / "TASKDATA.XML").write_text(main_file("".join(f'<TLG A="{name}"/>' for name in names)))
    for name in names:
        (stick / f"{name}.xml").write_text(HEADER)
        (stick / f"{name}.bin").write_bytes(binary())
    folder = tmp_path / "runs"
    folder.mkdir()
    for name, text in imported([str(stick)]).files.items():
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def farm(tmp_path: Path) -> Path:
    path = tmp_path / "farm.toml"
    path.write_text(FARM)
    return path


def test_what_is_true_of_the_runs_is_learnt(runs: Path, farm: Path) -> None:
    lesson = learn([runs], farm)
    learnt = {one.key: one for one in lesson.taught}
    speed = learnt["implements.mower.speed_kmh"]
    assert speed.value == pytest.approx(3.6 * WORK_MPS, abs=0.01) and speed.low == speed.high == speed.value
    assert len(speed.runs) == 6 and speed.done == "added"
    # Six runs of 190 s with one stop of 20 s each: 6 / (6 x 170 s) an hour.
    assert learnt["chances.stops_per_hour"].value == pytest.approx(3600.0 / 170.0, rel=1e-3)
    assert learnt["chances.stop_s"].value == 20.0
    assert "Too few events to learn turn_more_cv." in lesson.notes
    assert learnt["chances.turn_cv"].value == 0.0


def test_the_turn_speed_makes_the_simulated_turn_last_as_long(runs: Path, farm: Path) -> None:
    (turn,) = (one for one in learn([runs], farm).taught if one.key.endswith("turn_speed_kmh"))
    # A turn lasts from the last row at work, one step before the end of the track.
    assert turn.measured.startswith(f"{TURN_S + 1:.1f} s a turn over 1 track")
    simulated = TurnSpeed(load_tractor("eg105"), Implement(width_m=WIDTH_M), WORK_MPS, 1)
    assert simulated.seconds(float(turn.value) / 3.6) == pytest.approx(TURN_S + 1, abs=0.2)


def test_every_other_byte_stays(runs: Path, farm: Path) -> None:
    lesson = learn([runs], farm)
    added = [line for line in lesson.text.splitlines() if line not in FARM.splitlines()]
    kept = [line for line in lesson.text.splitlines(keepends=True) if line in FARM.splitlines(keepends=True)]
    assert "".join(kept[: len(FARM.splitlines())]) == FARM
    assert all("own logs" in line or line.split(" = ")[0] in ("key", "value", "low", "high", "told", "runs")
               or line == "[[learned]]" for line in added)  # fmt: skip
    before, after = tomllib.loads(FARM), tomllib.loads(lesson.text)
    assert after["implements"][0] == before["implements"][0] and after["tractors"] == before["tractors"]


def test_values_of_ones_own_stay_unless_asked(runs: Path, farm: Path) -> None:
    first = learn([runs], farm)
    (turns,) = (one for one in first.taught if one.key == "chances.turn_cv")
    assert turns.done == "kept 0.5" and "turn_cv = 0.5    # a guess" in first.text
    farm.write_text(first.text)
    again = learn([runs], farm)
    assert again.text == first.text  # what was learnt is learnt anew
    forced = learn([runs], farm, replace_given=True)
    assert tomllib.loads(forced.text)["chances"]["turn_cv"] == 0.0
    farm.write_text(first.text.replace("speed_kmh = 7.2 ", "speed_kmh = 8.0 "))
    (speed,) = (one for one in learn([runs], farm).taught if one.key == "implements.mower.speed_kmh")
    assert speed.done == "kept 8"


def test_plans_use_and_cite_it(runs: Path, farm: Path) -> None:
    farm.write_text(learn([runs], farm).text)
    own = load_farm(farm)
    question = asked(Scenario(field="iwamizawa"), own, implement="mower")
    assert question.scenario.speed_mps == pytest.approx(WORK_MPS)
    assert question.chances is not None and question.chances.stop_s == 20.0
    assert question.terms is not None
    assert any(words.startswith("speed_kmh 7.2 (95 %: 7.2 to 7.2), median") for words in question.terms.learned)
    other = asked(Scenario(field="iwamizawa"), own, implement="drill.3")
    assert other.terms is not None and not any("speed_kmh" in words for words in other.terms.learned)
    cited = {(value.section, value.key): value.source for value in values_of(own)}
    assert cited["implements mower", "speed_kmh"].startswith("own logs: 7.2 (95 %")
    assert cited["chances", "turn_cv"] == "given"
    farm.write_text(farm.read_text().replace("stop_s = 20.0 ", "stop_s = 30.0 "))
    cited = {(value.section, value.key): value.source for value in values_of(load_farm(farm))}
    assert cited["chances", "stop_s"] == "given"  # changed by hand, so the logs are no source of it


def test_a_ranking_tells_what_its_farm_learnt(runs: Path, farm: Path) -> None:
    from planner.planning import with_machines
    from reports.results import Ranking

    farm.write_text(learn([runs], farm).text)
    question = asked(Scenario(field="iwamizawa"), load_farm(farm), implement="mower")
    told = with_machines(Ranking("iwamizawa", 1.0, 1, ()), question.terms)
    assert any(words.startswith("speed_kmh 7.2") for words in told.scenario["learned"])
    assert [f"From the farm's own logs: {words}." for words in told.scenario["learned"]] == list(told.assumptions)
    plain = with_machines(Ranking("iwamizawa", 1.0, 1, ()), None)
    assert plain.assumptions == () and "learned" not in plain.scenario


def test_the_order_of_the_headland_is_asked_for_unless_another_is(farm: Path) -> None:
    farm.write_text(FARM.replace('operation = "mow"', 'operation = "mow"\nheadland = "last"'))
    own = load_farm(farm)
    assert asked(Scenario(), own, implement="mower").scenario.headland_orders == ("last",)
    first = Scenario(headland_order="first")
    assert asked(first, own, implement="mower").scenario.headland_orders == ("first",)
    assert asked(Scenario(tracks_only=True), own, implement="mower").scenario.headland_orders == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (FARM.replace(f"width_m = {WIDTH_M}", "width_m = 9.0"), "no implement like that"),
        (FARM.replace("width_m = 3.0", f"width_m = {WIDTH_M}"), "several implements like that"),
        ("chances = {turn_cv = 0.5}\n" + FARM.split("# the end")[0], "write it as a table under [chances]"),
        (FARM.split("[[implements]]")[0], "names no implement"),
    ],
)
def test_what_cannot_be_learnt_is_told(runs: Path, farm: Path, text: str, words: str) -> None:
    farm.write_text(text)
    with pytest.raises(ScenarioError) as refusal:
        learn([runs], farm)
    assert words in str(refusal.value)


def test_a_farm_file_that_is_not_there_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"no farm file .*none\.toml' to put it in; .*headland farm new"):
        learn([str(tmp_path)], tmp_path / "none.toml")
    assert not (tmp_path / "none.toml").exists()


def test_values_put_into_text() -> None:
    text = "# top\r\n[a]\r\nx = 1 # one\r\n\r\n# about b\r\n[b]\r\ny = 2\r\n"
    assert with_value(text, "a", None, "x", "3.0", "c") == text.replace("x = 1 # one", "x = 3.0  # c")
    assert with_value(text, "a", None, "z", "3.0", "c") == text.replace("# one\r\n", "# one\r\nz = 3.0  # c\r\n")
    assert with_value(text, "c", None, "z", "3.0", "c") == text + "\r\n[c]\r\nz = 3.0  # c\r\n"
    block = with_block(text, "learned", {"key": 'a "b"\\', "runs": ["x", "y"], "low": 1.0})
    assert tomllib.loads(block)["learned"] == [{"key": 'a "b"\\', "runs": ["x", "y"], "low": 1.0}]
    assert without_blocks(block, "learned", {'a "b"\\'}) == text
    assert without_blocks(block, "learned", {"other"}) == block


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    draw = np.random.default_rng(5)
    inside = 0
    for _ in range(60):
        runs = {str(run): 10.0 + draw.normal(0.0, 1.0) + draw.normal(0.0, 2.0, 20) for run in range(20)}
        found = estimate(runs, mean, 5)
        assert found is not None and found.events == 400
        inside += found.low <= 10.0 <= found.high
    assert 50 <= inside <= 60  # 95 % of 60 are 57, with a deviation of 1.7; a bootstrap of few runs is a little narrow


def test_estimates_by_hand() -> None:
    assert variation(np.array([1.0, 3.0])) == pytest.approx(math.sqrt(2.0) / 2.0)
    assert estimate({"a": np.array([1.0])}, mean, 2) is None
    one = rate({"a": (0, 2.0)})
    # None in two hours: up to -ln(0.025) / 2 an hour.
    assert one is not None and (one.value, one.low) == (0.0, 0.0) and one.high == pytest.approx(-math.log(0.025) / 2.0)
    found = share(18, tuple(map(str, range(18))))
    z = 1.959964
    assert found.high == pytest.approx(1.0) and found.low == pytest.approx(18.0 / (18.0 + z * z))


def test_farm_files_of_all_kinds_are_kept_or_refused(runs: Path, farm: Path) -> None:
    """A thousand damaged farm files: what comes out reads back with just the learnt values changed, or is refused."""
    from planner.works.learning import _check, _edited
    from reports.work_results import Taught
    from tests.fields.test_fuzz_forms import damaged

    draw, good = random.Random(20270), 0
    for _ in range(1_000):
        text = damaged(FARM, draw)
        try:
            from planner.farm.file import farm_from

            own = farm_from(text, "x", farm.parent)
            key = f"implements.{own.implements[-1].name}.speed_kmh"
            if "implements" not in own.model_fields_set:
                continue
            taught = [
                Taught(key, 6.5, 6.0, 7.0, "m", "", ("r",)),
                Taught("chances.stop_s", 9.0, 8.0, 10.0, "m", "", ()),
            ]
            edited, told = _edited(text, own, taught, replace_given=True)
            _check(edited, "x", farm.parent, own, told)
        except HeadlandError as refusal:
            assert "\n" not in str(refusal).rstrip()
            continue
        good += 1
        assert tomllib.loads(edited)["chances"]["stop_s"] == 9.0
    assert 20 < good < 980


def test_json_of_what_was_taught(runs: Path, farm: Path) -> None:
    from reports.work_taught import taught_json

    lesson = learn([runs], farm)
    told = json.loads(taught_json(lesson.taught, lesson.notes))
    assert [one["key"] for one in told["learned"]] == [one.key for one in lesson.taught]
