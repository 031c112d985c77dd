"""Lists of legs: words, tables that fit a terminal, JSON with fixed keys."""

import json

import pytest

from reports.common.plan_records import DriverLeg
from reports.plan.leg_list import (
    build_leg_tables,
    describe_leg,
    format_leg_heading,
    format_leg_lists_json,
    format_leg_rows,
)
from tests.printing import print_text

KEYS = ["number", "words", "kind", "from_s", "clock_s", "seconds", "pause_s", "length_m", "swath", "headland_pass",
        "part", "bearing_deg", "over_swaths", "shape", "for_tractors", "reversing_m", "over_finished",
        "over_finished_m", "over_standing", "over_standing_m",
        "fuel_l", "energy_kwh", "slope_along_pct", "slope_across_pct"]  # fmt: skip
WORDS = (
    "round 2, side 3, northwards", "corner to side 4, backing up", "round 2, side 4, all round", "way to track 14",
    "wait for tractors 1 and 3", "track 14b, north-eastwards", "track 14b, the rest", "U over 2 tracks to track 16",
    "omega over 1 track to track 15", "switch-back to round 3, side 1", "on to round 3, side 1", "continue", "wait",
)  # fmt: skip


def step(kind: str, number: int | None = None, part: str = "", *, at: float = 0.0, **more: object) -> DriverLeg:
    return DriverLeg(kind, number, part, at, 90.0, 123.4, 1.0, 2.0, **more)  # type: ignore[arg-type]


STEPS = (
    step("round", 2, "3", is_headland_pass=True, bearing_deg=350.0),
    step("corner", 2, "4", is_headland_pass=True, shape="switch-back", at=90.0),
    step("round", 2, "4", is_headland_pass=True, at=180.0),
    step("way", 14, at=270.0),
    step("wait", for_tractors=(1, 3), at=360.0),
    step("track", 14, "b", bearing_deg=46.0, at=450.0),
    step("track", 14, "b", bearing_deg=46.0, continues=True, at=540.0),
    step("turn", 16, over_swaths=2, shape="u", at=630.0),
    step("turn", 15, over_swaths=1, shape="omega", at=720.0),
    step("turn", 3, "1", is_headland_pass=True, shape="switch-back", at=810.0),
    step("turn", 3, "1", is_headland_pass=True, shape="u", continues=True, at=900.0),
    step("drive", at=990.0),
    step("wait", at=1080.0),
)


@pytest.mark.parametrize(("one", "words"), [*zip(STEPS, WORDS, strict=True)])
def test_words(one: DriverLeg, words: str) -> None:
    assert describe_leg(one) == words


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"reversing_m": 12.4}, "way to track 14, reversing 12 m"),
        ({"reversing_m": 0.2}, "way to track 14"),
        ({"pause_s": 1800.0}, "way to track 14, with a break of 0:30:00"),
        ({"over_finished": ("3",)}, "way to track 14, over finished track 3"),
        ({"over_finished": ("3", "4a", "headland")}, "way to track 14, over finished tracks 3 and 4a and headland"),
        ({"over_finished": ("3", "4", "5", "6")}, "way to track 14, over finished 4 tracks"),
        ({"over_standing": ("7", "headland")}, "way to track 14, over uncut track 7 and headland"),
        (
            {"over_finished": ("headland",), "reversing_m": 7.0},
            "way to track 14, reversing 7 m, over finished headland",
        ),
    ],
)
def test_a_way_says_how_and_over_what_it_leads(more: dict[str, object], words: str) -> None:
    assert describe_leg(step("way", 14, **more)) == words


@pytest.mark.parametrize(("one", "words"), [
    (step("turn", 3, over_swaths=1, shape="switch-back", reversing_m=6.0), "switch-back over 1 track to track 3"),
    (step("turn", 3, over_swaths=1, shape="switch-back", reversing_m=30.0),
     "switch-back over 1 track to track 3, reversing 30 m"),
    (step("wait", for_tractors=(1, 2, 3)), "wait for tractors 1, 2 and 3"),
    (step("wait", for_tractors=(1, 2, 3, 4, 6)), "wait for 5 tractors"),
])  # fmt: skip
def test_only_a_long_reverse_is_said_and_many_that_are_waited_for_are_counted(one: DriverLeg, words: str) -> None:
    assert describe_leg(one) == words


def printed(width: int = 80, **options: object) -> str:
    return print_text(build_leg_tables("Field", (STEPS, STEPS[:2]), **options), width)  # type: ignore[arg-type]


def test_a_table_per_tractor_fits_eighty_columns() -> None:
    lines = printed().splitlines()
    assert max(map(len, lines)) <= 80
    assert "Tractor 1: 13 legs, 1.6 km, 0:19:30 on the field" in lines
    assert "Tractor 2: 2 legs, 0.2 km, 0:03:00 on the field" in lines
    row = next(line for line in lines if "U over 2" in line)
    assert row.split() == ["8", "U", "over", "2", "tracks", "to", "track", "16", "0:10:30", "123", "1:30"]
    wait = next(line for line in lines if "wait for" in line)
    assert wait.split()[-2:] == ["0:06:00", "1:30"], "a wait has no metres"


def test_one_tractor_alone_and_times_of_day() -> None:
    text = printed(only_tractor=2, start="23:59")
    assert "Tractor 1" not in text and "time of day" in text
    assert [line.split()[-3] for line in text.splitlines() if " side" in line] == ["23:59:00", "0:00:30"]


@pytest.mark.parametrize("width", [30, 44, 60])
def test_no_figure_is_cut_where_it_is_narrow(width: int) -> None:
    text = printed(width)
    assert max(map(len, text.splitlines())) <= width
    assert "0:10:30" in text and text.count("123") >= 11


def test_keys_of_json_and_their_order() -> None:
    text = format_leg_lists_json((STEPS, STEPS[:2]), {"field": "f"}, only_tractor=1)
    told = json.loads(text)
    assert text.endswith("}\n") and list(told) == ["field", "tractors"]
    assert [own["tractor"] for own in told["tractors"]] == [1]
    legs = told["tractors"][0]["legs"]
    assert all(list(leg) == KEYS for leg in legs) and [leg["number"] for leg in legs] == list(range(1, 14))
    first, turn = legs[0], legs[7]
    assert [first[key] for key in ("swath", "headland_pass", "part", "bearing_deg")] == [None, 2, "3", 350.0]
    assert [turn[key] for key in ("swath", "headland_pass", "over_swaths", "shape")] == [16, None, 2, "u"]
    assert legs[4]["for_tractors"] == [1, 3] and legs[11]["shape"] is None


def test_rows_of_fixed_pitch_stand_in_columns() -> None:
    rows = format_leg_rows(STEPS)
    assert len({len(row) for row in rows}) == 1 and len(rows) == 14
    assert rows[8].startswith("  8 U over 2 tracks") and rows[8].endswith(" 1:30")
    assert format_leg_heading(3, ()) == "Tractor 3: 0 legs, 0.0 km, 0:00:00 on the field"
