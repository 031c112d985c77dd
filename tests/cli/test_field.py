"""`headland field`: figures of a field before any plan."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.drawn_fields import feature, line, point, rectangle, ring, write_features
from tests.examples import seldom

pytestmark = pytest.mark.usefixtures("first_layout")


@pytest.fixture
def facts(once: Run, small: Path) -> dict[str, Any]:
    outcome = once("field", small, "--local", "--json", "--no-headland")
    assert outcome.status == 0, outcome.err
    found: dict[str, Any] = json.loads(outcome.out)
    return found


def test_figures_of_a_rectangle(facts: dict[str, Any]) -> None:
    # 45 m by 80 m, worked along the long side: 15 lines of 3 m, shortened by the headland at both ends.
    assert (facts["name"], facts["area_ha"], facts["holes"]) == ("small", 0.36, 0)
    assert facts["swaths"] == facts["max_tractors"] == 15
    assert facts["interrupted_swaths"] == 0
    assert math.isclose(math.sin(math.radians(facts["bearing_deg"])), 0, abs_tol=1e-6)
    length = 80 - 2 * facts["headland_m"]
    assert facts["longest_swath_m"] == facts["shortest_swath_m"] == pytest.approx(length, abs=0.1)
    assert facts["swath_length_m"] == pytest.approx(15 * length, abs=0.5)


def test_turns_over_more_tracks_are_no_slower_once_a_u_turn_fits(facts: dict[str, Any]) -> None:
    seconds = {int(lines): value for lines, value in facts["turns"]["turn_s_by_swaths"].items()}
    fitting = math.ceil(2 * facts["turning_radius_m"] / 3)
    assert seconds[fitting] < seconds[1]
    assert all(0 < value < 120 for value in seconds.values())


@pytest.mark.parametrize("name", ["iwamizawa", *seldom("denmark", "netherlands"), "sweden"])
def test_samples_are_described(headland: Run, name: str) -> None:
    outcome = headland("field", name)
    assert outcome.status == 0 and outcome.err == ""
    assert name in outcome.out and "Area (ha)" in outcome.out


def test_a_wider_headland_shortens_tracks_and_lets_more_omegas_fit(
    headland: Run, small: Path, facts: dict[str, Any]
) -> None:
    wide = json.loads(headland("field", small, "--local", "--json", "--no-headland", "--headland", "16").out)
    assert wide["longest_swath_m"] == pytest.approx(48, abs=0.1)
    over = "fitting_pct_by_swaths"
    # From an outer track too, as an omega may go straight on before it swings out.
    narrow_pct, wide_pct = (one["turns"][over]["1"]["omega"] for one in (facts, wide))
    assert narrow_pct < wide_pct == pytest.approx(100.0)
    # The third track is farther off than a U-turn is wide.
    assert wide["turns"][over]["3"]["u"] == 100.0


def test_turns_that_a_plan_uses_are_said_to_fit(headland: Run) -> None:
    fits = json.loads(headland("field", "netherlands", "--json", "--no-headland").out)["turns"]
    words = ("plan", "netherlands", "--tractors", "2", "--strategies", "split-field", "--processes", "1")
    words = (*words, "--no-headland", "--json")
    used = {kind for plan in json.loads(headland(*words).out)["plans"] for kind in plan["turn"].split("+")}
    said = {kind for kinds in fits["fitting_pct_by_swaths"].values() for kind in kinds}
    assert used <= said
    assert fits["omega_fits"] == ("omega" in said)


def test_where_no_turn_fits_the_estimate_stands_apart(headland: Run, small: Path) -> None:
    # In 4 m behind a cultivator no turn of radius 4.3 m has room; where a plan goes a long way round instead, it
    # reckons with two full circles at turn speed.
    words = ("field", small, "--local", "--no-headland", "--headland", "4")
    found = json.loads(headland(*words, "--json").out)
    circle = 2 * math.pi * found["turning_radius_m"] / (5 / 3.6)
    estimates = found["turns"]["estimated_turn_s_by_swaths"]
    assert found["turns"]["turn_s_by_swaths"] == {}
    assert set(estimates) >= {"1", "2"}
    assert all(value == pytest.approx(2 * circle, abs=0.1) for value in estimates.values())
    text = headland(*words).out
    assert "Estimated: two full circles, where no turn fits." in text
    row = next(line.split() for line in text.split("\nTurns\n")[1].splitlines() if line.split()[:1] == ["1"])
    assert row[-1] == f"{estimates['1']:.6g}"


def test_where_every_turn_fits_nothing_is_estimated(facts: dict[str, Any]) -> None:
    assert facts["turns"]["estimated_turn_s_by_swaths"] == {}


def test_obstacles_are_told_and_cut_out(headland: Run, tmp_path: Path) -> None:

    def saved(**properties: Any) -> Path:
        pole = feature(point(30, 50), role="obstacle", **properties)
        return write_features(tmp_path / "pole.geojson", feature(rectangle(0, 0, 60, 100)), pole)

    # A circle is drawn with 64 corners: 32 r^2 sin(2 pi / 64) is 7.06 m2 for 1.5 m, 3.14 m2 for 1 m.
    words = ("--local", "--json", "--no-headland", "--margin", "0.5")
    told = json.loads(headland("field", saved(radius_m=1.5, name="mast"), *words).out)
    (mast,) = told["obstacles"]
    assert (mast["name"], mast["area_m2"], mast["radius_m"], mast["margin_m"]) == ("mast", 7.06, 1.5, 0.5)
    assert (mast["x_m"], mast["y_m"], mast["lon"]) == (30.0, 50.0, None)
    assert told["holes"] == 1 and told["interrupted_swaths"] == 0 and mast["bypassed"]
    # What the margin takes of the field: circles of 2 m and 1.5 m, one less the other.
    (taken,) = [one for one in told["unworked"] if "margin" in one["reason"]]
    assert taken["area_m2"] == pytest.approx(math.pi * (2.0**2 - 1.5**2), abs=0.1) and taken["pieces"] == 1
    assert told["area_ha"] == pytest.approx(0.6 - 1e-4 * math.pi * 1.5**2, abs=1e-4)
    outcome = headland("field", saved(kind="tree"), "--local")
    assert outcome.status == 0 and outcome.err == ""
    assert "tree" in (row := next(line for line in outcome.out.splitlines() if " 3.14 " in line)) and "0.3" in row
    outcome = headland("plan", saved(radius_m=70), "--local")
    assert outcome.status == 2 and "Obstacles with a margin (--margin) of 0.3 m leave 0 m2" in outcome.sentences[0]
    outcome = headland("field", saved(), "--local")
    assert outcome.status == 2 and "has no 'radius_m'" in outcome.sentences[0]


def left_open(told: dict[str, Any]) -> dict[str, float]:
    return {one["reason"].split(",")[0].split(" (")[0]: one["area_m2"] for one in told["unworked"]}


def test_rounds_are_told_with_their_lengths(headland: Run, small: Path) -> None:
    told = json.loads(headland("field", small, "--local", "--json", "--corners", "square").out)
    count = told["headland_m"] / 3
    # Round k of a rectangle runs (k - 1/2) widths inside it: 2 (45 + 80) - 8 (3 k - 1.5).
    lengths = [2 * (45 + 80) - 8 * 3 * (k - 0.5) for k in range(1, round(count) + 1)]
    assert [one["length_m"] for one in told["headland_passes"]] == pytest.approx(lengths, abs=0.1)
    assert {(one["rings"], one["lines"], one["corners"]) for one in told["headland_passes"]} == {(1, 0, 4)}
    # A side ends 4.5 m before the edge ahead, as far as nose and implement are apart: 3 m of it is under the next side.
    (tips,) = told["unworked"]
    assert tips["area_m2"] == pytest.approx(4 * 3 * (4.5 - 3), abs=0.5) and tips["pieces"] == 4
    assert told["covered_pct"] == pytest.approx(100.0 - tips["area_m2"] / 36.0, abs=0.01)


def test_a_headland_for_turning_is_told_as_left(facts: dict[str, Any]) -> None:
    assert facts["headland_passes"] == [] and facts["cells"][0]["swaths"] == 15
    assert left_open(facts) == {"headland": pytest.approx(2 * 45 * facts["headland_m"], abs=1.0)}
    assert facts["unworked"][0]["pieces"] == 2
    assert facts["covered_pct"] == pytest.approx(100 * (1 - 2 * facts["headland_m"] / 80), abs=0.05)


@pytest.mark.slow
def test_what_is_too_narrow_or_cut_off_is_told_apart(headland: Run, tmp_path: Path) -> None:
    # A block of 60 m by 100 m, a spur of 2 m by 30 m, and behind a neck of 2 m by 10 m a piece of 20 m by 20 m.
    outline = ring(
        (0, 0), (60, 0), (60, 10), (70, 10), (70, 0), (90, 0), (90, 20), (70, 20), (70, 12), (60, 12),
        (60, 60), (90, 60), (90, 62), (60, 62), (60, 100), (0, 100),
    )  # fmt: skip
    place = write_features(tmp_path / "drawn.geojson", feature(outline))
    told = left_open(json.loads(headland("field", place, "--local", "--json").out))
    # The spur takes the machine, half a metre over its edges, up to where its nose meets the end.
    assert told["narrower than the implement"] == pytest.approx(2 * 4.5, abs=1.5)
    assert told["cut off: no passage as wide as the machines"] == pytest.approx(400.0, abs=1.0)
    text = headland("field", place, "--local").out
    assert "headland passes do not cover" in text and "narrower than the implement (3 m)" in " ".join(text.split())


def test_pieces_behind_an_obstacle_are_told(headland: Run, tmp_path: Path) -> None:
    ditch = feature(line((-5, 80), (65, 80)), role="obstacle", width_m=2.0)
    place = write_features(tmp_path / "ditch.geojson", feature(rectangle(0, 0, 60, 100)), ditch)
    told = json.loads(headland("field", place, "--local", "--json").out)
    # North of the ditch are 60 m by 19 m; the margin takes 0.3 m on either side of it.
    behind = {why: area for why, area in left_open(told).items() if "obstacles" in why}
    swing = behind.pop("beside obstacles: room beyond the margin for machines swinging out in turns")
    assert 0.0 < swing < 60 * 1.0, "on the side that is worked"
    assert behind["cut off by obstacles"] == pytest.approx(60 * 18.7, abs=25)
    assert sum(behind.values()) == pytest.approx(60 * 19 + 60 * 0.3, abs=1.0)
    assert (told["obstacles"][0]["width_m"], told["obstacles"][0]["radius_m"]) == (2.0, None)


def test_turns_stand_in_a_table(headland: Run, small: Path, facts: dict[str, Any]) -> None:
    lines = headland("field", small, "--local", "--no-headland").out.splitlines()
    assert max(map(len, lines)) <= 80
    rows = [line.split() for line in lines[lines.index("Turns") + 2 :] if line[:1] == " " and line.strip()[0].isdigit()]
    turns = facts["turns"]
    assert [row[0] for row in rows] == list(turns["fitting_pct_by_swaths"])
    assert [float(row[-1]) for row in rows] == pytest.approx(list(turns["turn_s_by_swaths"].values()))


def test_ground_that_a_ditch_cuts_off_is_told_and_drawn(headland: Run, tmp_path: Path) -> None:
    """A ditch of 1.5 m across 100 m by 60 m, 30 m from the left; a margin of 0.3 m is kept to it."""
    ditch = feature(line((30, -5), (30, 65)), role="obstacle", kind="ditch")
    place = write_features(tmp_path / "cut.geojson", feature(rectangle(0, 0, 100, 60)), ditch)
    picture = tmp_path / "cut.png"
    outcome = headland("field", place, "--local", "--json", "--png", picture)
    told = json.loads(outcome.out)
    assert told["cut_off_m2"] == pytest.approx((30 - 0.75 - 0.3) * 60, abs=0.1)
    assert "Obstacles cut off 1737 m2" in outcome.err
    (row,) = [one for one in told["unworked"] if one["reason"] == "cut off by obstacles"]
    assert row["area_m2"] == pytest.approx(told["cut_off_m2"], rel=0.02)
    assert picture.stat().st_size > 10_000


def test_obstacles_are_added_and_left_out(headland: Run, small: Path, tmp_path: Path) -> None:
    mast = feature(point(20.0, 40.0), name="Strommast")
    marked = write_features(tmp_path / "marked.geojson", feature(json.loads(small.read_text())), mast)
    words = ("field", marked, "--local", "--json", "--no-headland")
    with_mast = headland(*words)
    assert "(1) pylon 'Strommast', radius 3 m. To leave one out" in " ".join(with_mast.err.split())
    (obstacle,) = json.loads(with_mast.out)["obstacles"]
    assert (obstacle["number"], obstacle["kind"], obstacle["radius_m"]) == (1, "pylon", 3.0)
    other = headland(*words, "--ignore", "strommast", "--obstacle", "10,60,2", "--obstacle", "30,20")
    assert [one["radius_m"] for one in json.loads(other.out)["obstacles"]] == [2.0, 1.0]
    assert "Left out as asked, so machines drive there" in other.err
    for more, expected in (
        (("--ignore", "Baum"), "--ignore 'Baum' names no obstacle of field"),
        (("--obstacle", "500,20"), "The obstacle 500,20 (--obstacle) lies"),
        (("--obstacle", "x"), "--obstacle 'x' is not a place"),
    ):
        refused = headland(*words, *more)
        assert refused.status == 2 and expected in refused.err and refused.err.count("\n") == 1
