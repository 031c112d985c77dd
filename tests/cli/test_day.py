"""`headland day`: a small farm with two fields, by hand; refusals; the same bytes with and without a cache."""

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planner.pipeline.planning import plan
from planner.request.plan_request import PlanRequest
from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused
from tests.drawn_fields import rectangle

pytestmark = pytest.mark.usefixtures("first_layout")

FARM = """
[[tractors]]
name = "Carrier"
file = "eg105"
count = 3

[[implements]]
name = "harrow"
width_m = 6.0
speed_kmh = 8.0

[[implements]]
name = "drill"
width_m = 6.0
operation = "sow"

[prices]
per_hour = 36.0
supervision_share = 0.0

[times]
shift_start = "08:00"
shift_end = "18:00"
breaks = ["08:10-08:40"]
road_speed_kmh = 36.0
unfold_s = 60.0
fold_s = 30.0

[uncertainty]
speed_cv = 0.0
job_cv = 0.0
slip_cv = 0.0
turn_cv = 0.0
turn_more_cv = 0.0
stops_per_hour = 0.0
breakdown_hours = 0.0
start_delay_s = 0.0
"""
DAY = """
farm = "farm.toml"
strategies = ["split-field"]

[[fields]]
name = "near"
file = "small.geojson"
local = true
value_per_ha = 1000.0

[[fields]]
name = "far"
file = "small.geojson"
local = true
value_per_ha = 1000.0

[[fleets]]
name = "one"
count = 1
implement = "harrow"

[[roads]]
between = ["yard", "near"]
km = 3.6

[[roads]]
between = ["yard", "far"]
km = 7.2

[[roads]]
between = ["near", "far"]
km = 4.5
"""


@pytest.fixture
def folder(tmp_path: Path, small: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with farm, day and field to work in."""
    (tmp_path / "farm.toml").write_text(FARM, encoding="utf-8")
    (tmp_path / "day.toml").write_text(DAY, encoding="utf-8")
    (tmp_path / "small.geojson").write_text(small.read_text())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def planned(headland: Run, text: str, *options: str) -> dict[str, Any]:
    Path("other.toml").write_text(text, encoding="utf-8")
    told = headland("day", "other.toml", "--json", "--processes", 1, *options)
    assert told.status == 0, told.err
    return dict(json.loads(told.out))


@pytest.mark.slow
def test_two_fields_by_hand(headland: Run, folder: Path) -> None:
    """360 s of road and 60 s of unfolding, a break from 08:10, work, 30 + 450 + 60 s to the other field, work, home."""
    told = planned(headland, DAY)
    near, far = told["jobs"]
    assert (near["field"], far["field"], told["not_done"], told["gap_pct"]) == ("near", "far", [], 0.0)
    assert (near["machine"], near["strategy"], near["tractors"]) == ("one", "split-field", 1)
    work = math.ceil(near["time_s"])
    assert far["time_s"] == near["time_s"], "two fields of one shape"
    begins = 8 * 3600 + 360 + 60
    assert near["leaves_s"] == 8 * 3600 and near["start_s"] == begins
    assert begins + work > 8 * 3600 + 600, "the break falls into the first field"
    assert abs(near["end_s"] - (begins + work + 1800)) <= 1
    assert far["start_s"] == near["end_s"] + 30 + 450 + 60
    assert abs(far["end_s"] - (far["start_s"] + work)) <= 1
    assert told["machines"][0]["home_s"] == far["end_s"] + 30 + 720
    assert told["machines"][0]["km"] == pytest.approx(3.6 + 4.5 + 7.2)
    assert near["cost"] == pytest.approx(0.01 * near["time_s"], rel=0.01)
    ways = 0.01 * (360 + 60 + 30 + 450 + 60 + 30 + 720)
    assert told["machines"][0]["road_cost"] == pytest.approx(ways) and near["lost_cost"] == far["lost_cost"] == 0.0
    assert told["cost"] == pytest.approx(near["cost"] + far["cost"] + ways)
    assert near["finish_probability"] == far["finish_probability"] == 1.0


@pytest.mark.slow
def test_a_window_and_the_rain_turn_the_order_round(headland: Run, folder: Path) -> None:
    """Near is done at 08:45:29 at the latest, far is begun at 08:54:29 then; the other way round far is done first."""
    window = DAY.replace('name = "far"', 'name = "far"\nwindows = ["08:00-08:55"]')
    assert [job["field"] for job in planned(headland, window)["jobs"]] == ["far", "near"]
    dry = planned(headland, DAY)
    wet = planned(headland, DAY, "--rain", "08:58")
    assert [job["end_s"] for job in wet["jobs"]] == [job["end_s"] for job in dry["jobs"]]
    assert [job["finish_probability"] for job in wet["jobs"]] == [1.0, 0.0]
    run = plan(
        PlanRequest(
            field=str(folder / "small.geojson"), local=True, width_m=6.0, speed_mps=8.0 / 3.6, tractors=(1,),
            strategies=("split-field",), samples=0,
        )
    ).run  # fmt: skip
    assert run.duration_s == pytest.approx(wet["jobs"][1]["time_s"], abs=0.1)
    steps_m = np.hypot(*np.diff(run.get_poses(0)[:, :2], axis=0).T)
    at_work = np.array([leg.implement for leg in run.plan.missions[0].legs])[run.get_leg_numbers(0)[1:]]
    undone = run.time_s[1:] > 8 * 3600 + 58 * 60 - wet["jobs"][1]["start_s"]
    lost = 360.0 * steps_m[at_work & undone].sum() / steps_m[at_work].sum()
    assert wet["cost"] - dry["cost"] == pytest.approx(lost, rel=0.05), "0.36 ha of 1000 each, by the share left to work"


@pytest.mark.parametrize("rain", ["", 'rain = "09:00"'])
def test_the_money_of_a_day_adds_up(headland: Run, folder: Path, rain: str) -> None:
    """Work, ways, lost ground and a field that is not worth its way."""
    poor = (
        DAY.replace("value_per_ha = 1000.0", "value_per_ha = 1.0", 1)
        + DAY[DAY.index("[[fields]]") :]
        .split("[[fields]]")[2]
        .split("[[fleets]]")[0]
        .replace('name = "far"', '[[fields]]\nname = "beside"')
        .lstrip()
    )
    text = poor.replace('farm = "farm.toml"', f'farm = "farm.toml"\n{rain}') + "".join(
        f'\n[[roads]]\nbetween = ["beside", "{place}"]\nkm = 5.0\n' for place in ("near", "far", "yard")
    )
    told = planned(headland, text)
    lost = sum(job["lost_cost"] for job in told["jobs"])
    assert len(told["jobs"]) == 2 and len(told["not_done"]) == 1 and (lost > 1.0) == bool(rain)
    parts = [job["cost"] for job in told["jobs"]] + [fleet["road_cost"] for fleet in told["machines"]]
    parts += [lost] + [one["cost"] for one in told["not_done"]]
    assert min(parts) >= 0.0 and told["cost"] == pytest.approx(sum(parts), abs=1e-5)
    assert "Road of one" in headland("day", "other.toml", "--explain", "--processes", 1).out


@pytest.mark.slow
@pytest.mark.parametrize(("brought", "by_hour"), [
    pytest.param("\n".join(brought), by_hour, marks=() if len(brought) == 2 * by_hour else pytest.mark.matrix)
    for brought in ((), ("transport_per_tractor = 8.0",), ("transport_per_km = 0.5",),
                    ("transport_per_tractor = 8.0", "transport_per_km = 0.5"))
    for by_hour in (True, False)
])  # fmt: skip
def test_one_field_costs_what_its_plan_does(headland: Run, folder: Path, brought: str, by_hour: bool) -> None:
    """Two tractors from the yard to one field and back, on their own wheels or by lorry, and nothing varies."""
    own = "" if by_hour else "supervision_per_hour = 20.0\n"
    farm = FARM.replace("supervision_share = 0.0", f"supervision_share = 0.5\n{brought}\n{own}")
    farm = farm if by_hour else farm.replace("per_hour = 36.0\n", "", 1)
    Path("farm.toml").write_text(farm + "\n[yard]\nlon = 9.0\nlat = 56.02\n", encoding="utf-8")
    Path("one.geojson").write_text(json.dumps(rectangle(9.0, 56.0, 0.0007, 0.0007)), encoding="utf-8")
    day = planned(headland, (
        'farm = "farm.toml"\nstrategies = ["split-field"]\n[[fields]]\nname = "one"\nfile = "one.geojson"\n'
        'value_per_ha = 1000.0\n[[fleets]]\nname = "two"\ncount = 2\nimplement = "harrow"\n'
    ), "--cache", "kept")  # fmt: skip
    told = headland(
        "plan", "one.geojson", "--farm", "farm.toml", "--implement", "harrow", "--tractors", 2, "--strategies",
        "split-field", "--json", "--samples", 100, "--processes", 1,
    )  # fmt: skip
    assert told.status == 0, told.err
    assert day["cost"] == pytest.approx(json.loads(told.out)["best"]["paid_cost"], abs=1e-4)


def test_what_does_not_pay_is_left(headland: Run, folder: Path) -> None:
    poor = DAY.replace("value_per_ha = 1000.0", "value_per_ha = 1.0", 2)
    told = headland("day", "day.toml", "--json")
    assert told.status == 0
    Path("poor.toml").write_text(poor, encoding="utf-8")
    refused = headland("day", "poor.toml", "--json")
    content = json.loads(refused.out)
    assert refused.status == 3 and content["jobs"] == [] and len(content["not_done"]) == 2
    assert "the closest is near: doing it costs" in refused.err
    half = DAY.replace("value_per_ha = 1000.0", "value_per_ha = 1.0", 1)
    left = planned(headland, half)["not_done"]
    assert [one["field"] for one in left] == ["near"] and left[0]["cost"] == pytest.approx(0.36)


def test_what_is_put_off_costs_as_much_later(headland: Run, folder: Path) -> None:
    """0.36 ha at 10 bring 3.60, less than the work costs; put off, the 3.60 are lost and the work remains."""
    brings = DAY.replace("value_per_ha = 1000.0", "value_per_ha = 10.0").replace("7.2", "0.0").replace("3.6", "0.0")
    Path("brings.toml").write_text(brings, encoding="utf-8")
    assert headland("day", "brings.toml").status == 3
    loses = planned(headland, brings.replace("value_per_ha", "loss_per_ha"))
    (done,), (left,) = loses["jobs"], loses["not_done"]
    assert 3.6 < done["cost"] < 7.0
    assert left["cost"] == pytest.approx(3.6 + done["cost"], abs=1e-6)


def test_a_day_that_is_too_short_says_what_comes_closest(headland: Run, folder: Path) -> None:
    short = DAY.replace('farm = "farm.toml"', 'farm = "farm.toml"\nlight = "08:00-08:20"')
    Path("short.toml").write_text(short, encoding="utf-8")
    told = headland("day", "short.toml")
    assert told.status == 3 and "near: even if one goes there first, it is" in told.err
    assert len(told.sentences) == 1 and "No field can be done on this day." in told.out


def test_two_fleets_share_the_work(headland: Run, folder: Path) -> None:
    two = DAY + '\n[[fleets]]\nname = "two"\ncount = 2\nimplement = "harrow"\n'
    hurry = two.replace('farm = "farm.toml"', 'farm = "farm.toml"\nrain = "08:58"')
    told = planned(headland, hurry)
    assert {job["machine"] for job in told["jobs"]} == {"one", "two"}
    assert {job["tractors"] for job in told["jobs"]} == {1, 2}


def test_a_night_ends_on_the_next_day(headland: Run, folder: Path) -> None:
    night = DAY.replace('farm = "farm.toml"', 'farm = "farm.toml"\nstart = "23:00"').replace(
        'name = "far"', 'name = "far"\nwindows = ["00:30-04:00"]'
    )
    told = planned(headland, night)
    assert [job["field"] for job in told["jobs"]] == ["near", "far"]
    assert told["jobs"][1]["start_s"] == 24 * 3600 + 1800
    shown = headland("day", "other.toml", "--processes", 1).out
    assert " 00:30+1 " in shown and " next day (95 % by 00:" in shown


@pytest.mark.slow
def test_same_bytes_with_and_without_a_cache(headland: Run, folder: Path) -> None:
    words = ("day", "day.toml", "--json", "--processes", 1, "--cache")
    fresh = headland(*words, folder / "a")
    assert fresh.status == 0 and len(list((folder / "a").iterdir())) == 1, "two fields of one shape are simulated once"
    again, anew = headland(*words, folder / "a"), headland(*words, folder / "b")
    assert fresh.out == again.out == anew.out
    for broken in (folder / "a").iterdir():
        broken.write_text(broken.read_text()[:100])
    assert headland(*words, folder / "a").out == fresh.out


def test_tables_pages_and_pictures(headland: Run, folder: Path) -> None:
    told = headland("day", "day.toml", "--html", "day.html", "--png", "day.png", "--map", "map.png")
    assert told.status == 0 and "All 2 fields are done by" in told.out and "08:07" in told.out
    assert "There is no map" in told.err, "nobody placed anything"
    page = (folder / "day.html").read_text()
    assert "By machine" in page and "data:image/svg+xml" in page and "http://" not in page and "https://" not in page
    assert (folder / "day.png").read_bytes()[:4] == b"\x89PNG" and not (folder / "map.png").exists()
    rows = list(csv.DictReader(io.StringIO(headland("day", "day.toml", "--csv").out)))
    assert [row["field"] for row in rows] == ["near", "far"] and rows[0]["machine"] == "one"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "near"', 'name = "near"\nwindows = ["12:00-09:00"]', "'12:00-09:00' closes before it opens"),
        ('name = "near"', 'name = "near"\nwindows = ["noon"]', "'noon' is not a range of hours"),
        ('name = "near"', 'name = "near"\nwindows = ["25:00-26:00"]', "is not a time of day"),
        ('name = "near"', 'name = "near"\nimplement = "drill"', "no fleet fits 'near', which requires the implement"),
        ('name = "near"', 'name = "near"\noperation = "sow"', "no fleet fits 'near', which requires the operation"),
        ('name = "near"', 'name = "near"\nimplement = "dril"', "did you mean 'drill'?"),
        ('name = "near"', 'name = "near"\nloss_per_ha = 3.0', "value_per_ha and loss_per_ha cannot be given together"),
        ('name = "near"', 'name = "far"', "two fields have the name 'far'"),
        ('name = "near"', 'name = "yard"', "is called 'yard', which is the name of the yard"),
        (
            'name = "near"',
            'name = "near"\nobstacles = ["900,900"]',
            "(obstacles in the day file) lies",
        ),
        ('name = "near"', 'name = "near"\nignored = ["7"]', "ignored in the day file '7' names no obstacle"),
        ('file = "small.geojson"', 'file = "none.geojson"', "There is no field file 'none.geojson'"),
        ("value_per_ha = 1000.0", "value_per_ha = -1.0", "value_per_ha = -1.0: give a number from 0"),
        ('name = "one"', 'name = "one"\ntractor = "Carier"', "did you mean 'Carrier'?"),
        ("count = 1", "count = 4", "the fleets have 4 x Carrier in total, but the farm only 3"),
        ("km = 4.5", "km = -4.5", "km = -4.5: give a number from 0"),
        ('between = ["near", "far"]', 'between = ["near", "fart"]', "not one of its fields (did you mean 'far'?)"),
        (
            'between = ["near", "far"]',
            'between = ["yard", "far"]',
            "is given twice, as 7.2 km and 4.5 km; keep one of them",
        ),
        ('between = ["near", "far"]\nkm = 4.5', 'between = ["yard", "far"]\nkm = 7.2', "'near' and 'far' is missing"),
        ("[[fleets]]", "[fleets]", "write its keys under the heading [[fleets]]"),
        ('farm = "farm.toml"', 'farm = "none.toml"', "There is no file"),
        ('farm = "farm.toml"', 'farm = "farm.toml"\nrain = "wet"', "rain in the day file 'wet' is none of"),
        ('farm = "farm.toml"', 'farm = "farm.toml"\nstart = "7"', "is not a time of day"),
        ('farm = "farm.toml"', 'farm = "farm.toml"\nlight = "20:00-19:00"', "closes before it opens"),
        ('name = "near"', 'name = "near"\nwindows = ["18:00-07:00"]', "write the earlier time first"),
        ('["split-field"]', '["split-feld"]', "did you mean 'split-field'?"),
        ('["split-field"]', "[]", "strategies is empty"),
        ('farm = "farm.toml"', 'farm = "farm.toml"\nhurry = true', "hurry is not known"),
        ("[[fleets]]", "[[fleet]]", "it lacks fleets"),
        ('name = "near"', 'name = "near"\nwindows = "12:00-13:00"', "give a list in brackets."),
        ('name = "near"', 'name = "near"\nlon = 4.0', "lon and lat belong together; give both in degrees, or neither."),
        ('between = ["near", "far"]', 'between = ["far"]', "a road has two ends, not 1; give two names."),
    ],
)
def test_bad_input_is_one_sentence(headland: Run, folder: Path, old: str, new: str, words: str) -> None:
    (folder / "bad.toml").write_text(DAY.replace(old, new, 1), encoding="utf-8")
    told = headland("day", "bad.toml")
    assert_refused(told, words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.toml",), "There is no file 'none.toml'"),
        (("empty.toml",), "'empty.toml' is empty; give a day file (TOML)"),
        (("lists.toml",), "write its keys under the heading [[fields]]"),
        (("bare.toml",), "fields is empty"),
        (("open.toml",), "The day has no start"),
        (("day.toml", "--json", "--csv"), "choose one"),
        (("day.toml", "--samples", "0"), "--samples is 0"),
        (("day.toml", "--cache", "farm.toml"), "is a file"),
        (("day.toml", "--html", "day.toml"), "day.toml would overwrite the day file"),
        (("day.toml", "--png", "day.html"), "name the file day.png"),
        (("day.toml", "--farm", "none.toml"), "There is no file"),
        (("day.toml", "--processes", "0"), "--processes is 0"),
        (("day.toml", "--certainty", "30"), "--certainty is 30; use 50 to 99 percent"),
    ],
)
def test_bad_options_are_one_sentence(headland: Run, folder: Path, arguments: tuple[str, ...], words: str) -> None:
    texts = {
        "empty": "", "lists": 'fields = ["x"]\nfleets = []\n', "bare": "fields = []\nfleets = []\n",
        "open": '[[fields]]\nfile = "sweden"\n[[fleets]]\nname = "a"\n',
    }  # fmt: skip
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    told = headland("day", *arguments)
    assert_refused(told, words)
