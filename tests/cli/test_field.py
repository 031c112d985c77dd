"""`headland field`: figures of a field before any plan."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def facts(headland: Callable[..., Any], small: Path) -> dict[str, Any]:
    outcome = headland("field", small, "--local", "--json")
    assert outcome.status == 0, outcome.err
    found: dict[str, Any] = json.loads(outcome.out)
    return found


def test_figures_of_a_rectangle(facts: dict[str, Any]) -> None:
    # 45 m by 80 m, worked along the long side: 15 lines of 3 m, shortened by the headland at both ends.
    assert (facts["name"], facts["area_ha"], facts["holes"]) == ("small", 0.36, 0)
    assert facts["tracks"] == facts["most_tractors"] == 15
    assert facts["interrupted_tracks"] == 0
    assert math.isclose(math.sin(math.radians(facts["bearing_deg"])), 0, abs_tol=1e-6)
    length = 80 - 2 * facts["headland_m"]
    assert facts["longest_track_m"] == facts["shortest_track_m"] == pytest.approx(length, abs=0.1)
    assert facts["track_length_m"] == pytest.approx(15 * length, abs=0.5)


def test_turns_over_more_tracks_are_no_slower_once_a_u_turn_fits(facts: dict[str, Any]) -> None:
    seconds = {int(lines): value for lines, value in facts["turns"]["seconds_over_tracks"].items()}
    fitting = math.ceil(2 * facts["turning_radius_m"] / 3)
    assert seconds[fitting] < seconds[1]
    assert all(0 < value < 120 for value in seconds.values())


@pytest.mark.parametrize("name", ["iwamizawa", "denmark", "netherlands", "sweden"])
def test_samples_are_described(headland: Callable[..., Any], name: str) -> None:
    outcome = headland("field", name)
    assert outcome.status == 0 and outcome.err == ""
    assert name in outcome.out and "Area (ha)" in outcome.out


def test_a_wider_headland_shortens_tracks_and_lets_more_omegas_fit(
    headland: Callable[..., Any], small: Path, facts: dict[str, Any]
) -> None:
    wide = json.loads(headland("field", small, "--local", "--json", "--headland", "16").out)
    assert wide["longest_track_m"] == pytest.approx(48, abs=0.1)
    over = "fits_percent_of_ends_over_tracks"
    # 14 pairs of neighbours, two ways, two ends; an omega from an outer track swings out over the side of the field.
    narrow_pct, wide_pct = (one["turns"][over]["1"]["omega"] for one in (facts, wide))
    assert narrow_pct < wide_pct == pytest.approx(100 * 52 / 56, abs=0.05)
    # Neighbouring tracks are nearer than a U-turn is wide; the third is not.
    assert "u" not in wide["turns"][over]["1"] and wide["turns"][over]["3"]["u"] == 100.0


def test_turns_that_a_plan_uses_are_said_to_fit(headland: Callable[..., Any]) -> None:
    fits = json.loads(headland("field", "netherlands", "--json").out)["turns"]
    words = ("plan", "netherlands", "--tractors", "2", "--strategies", "split-field", "--processes", "1", "--json")
    used = {kind for plan in json.loads(headland(*words).out)["plans"] for kind in plan["turn"].split("+")}
    said = {kind for kinds in fits["fits_percent_of_ends_over_tracks"].values() for kind in kinds}
    assert used <= said
    assert fits["omega_fits"] == ("omega" in said)


def test_where_no_turn_fits_the_estimate_stands_apart(headland: Callable[..., Any], small: Path) -> None:
    # In 4 m behind a cultivator no turn of radius 4.3 m has room; where a plan goes a long way round instead, it
    # reckons with two full circles at turn speed.
    words = ("field", small, "--local", "--headland", "4")
    found = json.loads(headland(*words, "--json").out)
    circle = 2 * math.pi * found["turning_radius_m"] / (5 / 3.6)
    estimates = found["turns"]["estimated_seconds_where_no_turn_fits"]
    assert found["turns"]["seconds_over_tracks"] == {}
    assert set(estimates) >= {"1", "2"}
    assert all(value == pytest.approx(2 * circle, abs=0.1) for value in estimates.values())
    assert "Estimated seconds where no turn fits: 1: " in " ".join(headland(*words).out.split())


def test_where_every_turn_fits_nothing_is_estimated(facts: dict[str, Any]) -> None:
    assert facts["turns"]["estimated_seconds_where_no_turn_fits"] == {}


def test_the_map_is_a_picture(headland: Callable[..., Any], small: Path, tmp_path: Path) -> None:
    outcome = headland("field", small, "--local", "--png", tmp_path / "map.png")
    assert outcome.status == 0
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    assert [path.name for path in tmp_path.iterdir()] == ["map.png"]


def test_obstacles_are_told_and_cut_out(headland: Callable[..., Any], tmp_path: Path) -> None:
    square = {"type": "Polygon", "coordinates": [[[0, 0], [60, 0], [60, 100], [0, 100], [0, 0]]]}
    pole = {"type": "Point", "coordinates": [30, 50]}

    def saved(**properties: Any) -> Path:
        features = [
            {"type": "Feature", "properties": {}, "geometry": square},
            {"type": "Feature", "properties": {"role": "obstacle", **properties}, "geometry": pole},
        ]
        place = tmp_path / "pole.geojson"
        place.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
        return place

    # A circle is drawn with 64 corners: 32 r^2 sin(2 pi / 64) is 7.06 m2 for 1.5 m, 3.14 m2 for 1 m.
    told = json.loads(headland("field", saved(radius_m=1.5, name="mast"), "--local", "--json", "--margin", "0.5").out)
    assert told["obstacles"] == ["mast: 7.06 m2"] and told["holes"] == 1 and told["interrupted_tracks"] == 0
    assert told["area_ha"] == pytest.approx(0.6 - 1e-4 * math.pi * 2.0**2, abs=1e-4)
    outcome = headland("field", saved(kind="tree"), "--local")
    assert outcome.status == 0 and "tree: 3.14 m2" in outcome.out and outcome.err == ""
    outcome = headland("plan", saved(radius_m=70), "--local")
    assert outcome.status == 2 and "Obstacles with a margin (--margin) of 0.3 m leave 0 m2" in outcome.sentences[0]
    outcome = headland("field", saved(), "--local")
    assert outcome.status == 2 and "has no 'radius_m'" in outcome.sentences[0]
