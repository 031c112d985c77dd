"""The page: complete, escaped, self-contained, and true to the figures it was given."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

from fields.arrays import Floats
from reports.common.plan_records import PlanDrive
from reports.common.plan_results import PlanRanking
from reports.common.wording import NO_BREAK, format_duration
from reports.plan.drive_geometry import Viewport
from reports.plan.map_data import MOST_FIRST_KNOTS, MOST_OTHER_KNOTS, PATH_TOLERANCE_M, build_page_map, build_time_bars
from reports.plan.ranking_page import build_time_chart, render_plan_page

VOID = {"meta", "input", "br", "wbr", "link", "img"}


class Outline(HTMLParser):
    """Tags with attributes, and the balance of what is opened and closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        """What a reader sees."""
        return "".join(self.words).replace(NO_BREAK, " ")


def no_constant(name: str) -> float:
    raise AssertionError(f"{name} is not JSON")


def told(text: str) -> list[dict[str, Any]]:
    """The plans that the script of the page draws."""
    data = re.search(r'<script type="application/json" id="drive">(.*?)</script>', text, flags=re.S)
    assert data
    return json.loads(data.group(1), parse_constant=no_constant)  # type: ignore[no-any-return]


def unpacked(lane: dict[str, Any]) -> tuple[Floats, Floats]:
    """Samples (k,) and metres (k, 2), y down, of the knots of a lane."""
    knots = np.cumsum(np.array(lane["knots"]).reshape(-1, 3), axis=0)
    return knots[:, 0], knots[:, 1:] / 100.0


def drives(ranking: PlanRanking, drive: PlanDrive) -> dict[tuple[str, int], PlanDrive]:
    """A drive for every plan that works; each waits longer than the one before."""
    plans = [plan for plan in ranking.plans if plan.feasible]
    return {
        (plan.strategy, plan.tractors): replace(
            drive,
            title=f"plan {number}",
            xy=tuple(np.vstack([np.repeat(xy[:1], 10 * number, axis=0), xy]) for xy in drive.xy),
            status=tuple(np.concatenate([np.full(10 * number, 3), status]) for status in drive.status),
        )
        for number, plan in enumerate(plans)
    }


def test_tags_are_balanced(ranking: PlanRanking, drive: PlanDrive, still_drive: PlanDrive) -> None:
    """For a drive of one moment on a field without tracks, too."""
    pages = [render_plan_page(ranking, one) for one in (drive, still_drive, None)]
    for page in (*pages, render_plan_page(replace(ranking, plans=()), None)):
        assert Outline(page).open == []
    assert [plan["end"] for plan in told(pages[1])] == [0.0]


def test_nothing_is_asked_of_the_outside(ranking: PlanRanking, drive: PlanDrive) -> None:
    page = render_plan_page(ranking, drive)
    assert "http" not in page
    assert "url(" not in page
    assert "import" not in page
    for tag, attributes in Outline(page).tags:
        assert tag not in {"link", "img", "iframe", "object", "embed"}
        assert not {"src", "href", "srcset", "action"} & set(attributes)


def test_names_are_escaped(ranking: PlanRanking, drive: PlanDrive) -> None:
    evil = '<b>"x"</script>\'&'
    plans = tuple(replace(plan, strategy=evil, turn=evil, reason=evil) for plan in ranking.plans)
    page = render_plan_page(
        replace(ranking, field_name=evil, plans=plans, deadline=evil, assumptions=(evil,)), replace(drive, title=evil)
    )
    assert "<b>" not in page
    outline = Outline(page)
    assert outline.open == []
    assert page.count("</script>") == 2
    assert outline.text.count(evil) >= 10


def test_table_has_every_feasible_plan_with_values_to_sort_by(ranking: PlanRanking) -> None:
    page = render_plan_page(ranking, None)
    body = page[page.index('<table id="plans">') : page.index("</table>")]
    rows = re.findall(r"<tr[^>]*>(<td.*?)</tr>", body)
    values = [re.findall(r'data-v="([^"]*)"', row) for row in rows]
    assert [row[0] for row in values] == ["3", "5", "4", "1", "2", "6"], "the best, the front, then by rank"
    assert [float(row[3]) for row in values] == [1712.4, 4475.0, 3725.0, 1253.0, 1290.0, 5012.0]
    assert [row[6] for row in values] == ["1", "0", "0", "1", "1", "0"], "in time or not"
    assert {len(row) for row in values} == {body.count('<th scope="col"')}
    assert {row.count(' extra"') for row in rows} == {len(values[0]) - 7}, "seven columns are seen at first"
    assert [index for index, row in enumerate(re.findall(r"<tr[^>]*><td", body)) if "best" in row] == [0]


def test_columns_say_what_they_hold_and_remarks_stand_below_them(ranking: PlanRanking) -> None:
    first, *rest = ranking.plans
    plans = replace(first, remarks=("it waits <for> nobody",)), *rest
    machines = {"tractor": "Carrier", "implement": "harrow", "width_m": 4.0}
    page = render_plan_page(replace(ranking, plans=plans, scenario=machines), None)
    titles = re.findall(r'<th scope="col" title="([^"]+)"', page)
    for words in (
        "Smallest distance between two tractors",
        "Of the field, worked more than once",
        "Share of the field",
    ):
        assert any(title.startswith(words) for title in titles), words
    assert "1.89 ha, Carrier, harrow 4 m" in page
    assert "row-by-row with 5: it waits &lt;for&gt; nobody." in page


def test_page_says_what_matters(ranking: PlanRanking, drive: PlanDrive) -> None:
    page = render_plan_page(ranking, drive)
    words = Outline(page).text
    for part in ("3 tractors, split-field: done 08:29", "can be met with 3 or 5", "Refused: 4 plans",
                 "Tractors 2 and 3 touch.", "Working width 3.00 m.", "Seed 7", "0:28:32", "deadline 09:00",
                 drive.title):  # fmt: skip
        assert part in words
    assert "Colli\N{SOFT HYPHEN}sions" in page and "Rever\N{SOFT HYPHEN}sals" in page, "for narrow paper"
    assert "not worked" not in words and "Unworked:" not in words and "to finish" not in words
    assert told(page)[0]["missed"] == {"ground": "", "hatch": "", "largest": None}, "where nothing is missed"


def test_without_a_drive_there_is_no_map_and_without_a_plan_no_table(ranking: PlanRanking) -> None:
    page = render_plan_page(ranking, None)
    assert 'id="map"' not in page and 'id="drive"' not in page
    page = render_plan_page(replace(ranking, plans=ranking.plans[6:]), None)
    assert "No plan works: all 4 were refused" in Outline(page).text and '<table id="plans">' not in page


def test_the_script_knows_place_and_manner_of_every_tractor_at_every_moment(
    ranking: PlanRanking, drive: PlanDrive
) -> None:
    (plan,) = told(render_plan_page(ranking, drive))
    assert (plan["step"], plan["end"], plan["title"]) == (drive.step_s, max(drive.finish_s), drive.title)
    for lane, xy, status in zip(plan["lanes"], drive.xy, drive.status, strict=True):
        sample, places = unpacked(lane)
        at = np.arange(len(xy))
        read = np.column_stack([np.interp(at, sample, places[:, k]) for k in (0, 1)])
        off = (read - read[0]) * (1.0, -1.0) - (xy - xy[0])
        assert np.hypot(*off.T).max() < PATH_TOLERANCE_M + 0.02, "knots are rounded to centimetres"
        stretch = np.maximum(np.searchsorted(sample, at) - 1, 0)
        assert [int(lane["status"][n]) for n in stretch[1:]] == status[1:].tolist()
    assert np.array(plan["seconds"]).T.tolist() == [list(drive.seconds[name]) for name in drive.seconds]


def test_every_plan_of_the_table_can_be_chosen_for_the_map(ranking: PlanRanking, drive: PlanDrive) -> None:
    every = drives(ranking, drive)
    best = ranking.best
    page = render_plan_page(ranking, every[best.strategy, best.tractors], every)
    plans = told(page)
    assert [plan["title"] for plan in plans] == ["plan 2", "plan 0", "plan 1", "plan 3", "plan 5"], (
        "the best first; of two plans with one key the drive is of both"
    )
    assert plans[0]["name"] == "3. split-field, 3 tractors, switch-back, 0:28:32"
    menu = page[page.index('<select id="plan">') :].split("</select>")[0]
    assert re.findall(r"<option [^>]*>(.*?)</option>", menu) == [plan["name"] for plan in plans]
    picks = re.findall(r'class="pick" data-plan="(\d+)" aria-label="Show plan (\d) on the map"', page)
    assert {rank: plans[int(place)]["title"] for place, rank in picks} == {
        "1": "plan 0", "2": "plan 1", "3": "plan 2", "4": "plan 3", "5": "plan 5", "6": "plan 5",
    }  # fmt: skip
    ends = [plan["end"] for plan in plans]
    assert ends == [max(len(xy) - 1 for xy in every[key].xy) * drive.step_s for key in _keys(every, plans)]


def _keys(every: dict[tuple[str, int], PlanDrive], plans: list[dict[str, Any]]) -> list[tuple[str, int]]:
    by_title = {drive.title: key for key, drive in every.items()}
    return [by_title[plan["title"]] for plan in plans]


def test_the_map_begins_at_the_start_and_can_be_played(ranking: PlanRanking, drive: PlanDrive) -> None:
    page = render_plan_page(ranking, drive)
    slider = next(attributes for tag, attributes in Outline(page).tags if attributes.get("type") == "range")
    assert (slider["value"], float(slider["max"] or 0)) == ("0", max(drive.finish_s))
    assert "stage(0);" in page and "seek(0);" in page and "At the start" in page
    assert page.index('id="play"') < page.index('<svg id="map"'), "in sight before the map"


def test_tracks_have_numbers_and_worked_stretches_a_direction(drive: PlanDrive) -> None:
    picture = build_page_map({"a": drive})
    west = [label for label in picture["labels"] if label["x"] < picture["width"] / 2]
    assert {int(label["text"]) for label in west} <= set(range(1, 24)) and len(west) >= 6
    heights = sorted(label["y"] for label in west)
    assert min(np.diff(heights)) >= 2.2 * picture["unit"], "they do not lie over each other"
    low = min(west, key=lambda label: label["y"])
    assert int(low["text"]) > 20, "tracks are counted from the south, where y is largest"
    for lane in picture["plans"][0]["lanes"]:
        heads = re.findall(r"M(\d+) (\d+)l(-?\d+) (-?\d+) (-?\d+) (-?\d+)z", lane["arrows"])
        assert heads and lane["arrows"].count("M") == len(heads)
        _, places = unpacked(lane)
        worked = np.array(list(lane["status"])) == "1"
        for tip_x, tip_y, back, *_ in [[int(part) for part in head] for head in heads]:
            steps = np.flatnonzero(worked & (np.abs(places[1:, 1] * 100 - tip_y) < 10))
            west, east = places[steps[0], 0], places[steps[-1] + 1, 0]
            assert (east - west) * back < 0, "the tip lies ahead of the corners behind it"
            assert min(west, east) < tip_x / 100 < max(west, east)


def test_lines_round_trip_to_the_centimetre() -> None:
    points = np.array([[1.0, 9.0], [2.5, 9.0], [2.5, 9.001], [-3.25, 7.5]])
    assert Viewport(0.0, 10.0).format_path(points) == "M100 100l150 0 -575 150"
    assert Viewport(0.0, 10.0).format_path(points[:1], is_closed=True) == "M100 100z"


def test_map_lanes_draw_the_worked_length(drive: PlanDrive) -> None:
    for lane, xy, status in zip(build_page_map({"a": drive})["lanes"], drive.xy, drive.status, strict=True):
        steps = np.hypot(*np.diff(xy, axis=0).T)
        for manner, codes in (("work", (1,)), ("back", (4,)), ("turn", (0, 2, 3))):
            drawn = 0.0
            for piece in lane[manner].split("M")[1:]:
                if "l" in piece:
                    moves = np.array([int(n) for n in piece.split("l")[1].split()]).reshape(-1, 2)
                    drawn += float(np.hypot(*moves.T).sum()) / 100.0
            assert drawn == pytest.approx(float(steps[np.isin(status[1:], codes)].sum()), rel=0.01)


def test_bars_share_the_longest(drive: PlanDrive) -> None:
    rows = build_time_bars(drive)
    totals = np.array([sum(drive.seconds[name][number] for name in drive.seconds) for number in range(3)])
    shares = [sum(part["share"] for part in row["parts"]) for row in rows]
    assert shares == pytest.approx(totals / totals.max() * 100, abs=0.01)


def test_front_is_drawn_to_scale_with_a_deadline_that_there_is(ranking: PlanRanking) -> None:
    front = build_time_chart(ranking)
    frame, axis, zero = front["frame"], front["axis"], front["times"][0][0]
    assert zero == axis.first and front["deadline"]["text"] == "deadline 09:00"
    scale = (zero - front["deadline"]["y"]) / 3600.0
    times = sorted(plan.time_s for plan in ranking.plans if plan.feasible and plan.time_s)
    assert sorted((zero - point["y"]) / scale for point in front["points"]) == pytest.approx(times, abs=15.0)
    assert all(frame.left < point["x"] < frame.right for point in front["points"])
    assert all(axis.last < point["y"] <= axis.first for point in front["points"])
    later = build_time_chart(replace(ranking, allowed_s=5000.0, start=None, deadline=None))
    assert later["deadline"]["text"] == "deadline 1:23:20"
    assert build_time_chart(replace(ranking, allowed_s=None))["deadline"] is None


def test_ground_that_is_not_worked_is_hatched_on_the_map_and_told(leaving: PlanRanking, open_drive: PlanDrive) -> None:
    page = render_plan_page(leaving, open_drive)
    words = Outline(page).text
    for part in ("The largest piece left, 0.12 ha, is at", "not worked by the plan shown",
                 "590 m2 missed here, 690 m2 in all", "Time to finish, h:mm",
                 "Unworked: ground that no implement worked", "Unworked0.19 ha (10 %)",
                 "Wheel traffic off the headland12 m2",
                 "Farthest outside1.20 m"):  # fmt: skip
        assert part in words.replace("\n", "").replace("  ", ""), part
    (plan,) = told(page)
    assert plan["missed"]["ground"].count("z") == 3
    assert f'<path class="hatch" d="{plan["missed"]["hatch"]}"/>' in page, "drawn without the script, too"
    lines = re.findall(r"M(\d+) (\d+)l(-?\d+) (-?\d+)", plan["missed"]["hatch"])
    length = sum(np.hypot(float(x), float(y)) for _, _, x, y in lines) / 100
    assert length * 0.011 * 273.0 == pytest.approx(600 - 10 + 100, rel=0.03), "one line for so many metres of width"


def test_the_front_shows_the_time_to_finish(leaving: PlanRanking) -> None:
    plain = build_time_chart(replace(leaving, plans=tuple(replace(p, time_s=p.finished_s) for p in leaving.plans)))
    front = build_time_chart(leaving)
    assert [point["y"] for point in front["points"]] == [point["y"] for point in plain["points"]]
    assert front["points"][-1]["text"] == "5 x row-by-row, omega: 0:20:53, to finish 0:26:06"


@pytest.mark.slow
def test_a_large_noisy_drive_stays_below_two_megabytes(ranking: PlanRanking) -> None:
    rng = np.random.default_rng(4)
    rows, along = 95, np.arange(10.0, 410.0, 0.7)
    lines = [np.column_stack([along if k % 2 else along[::-1], np.full(len(along), 1.5 + 3 * k)]) for k in range(rows)]
    xy = np.vstack(lines) + rng.normal(0.0, 0.08, (rows * len(along), 2))
    seconds: dict[str, tuple[float, ...]] = dict.fromkeys(("turning", "waiting", "reversing"), (0.0,))
    seconds["working"] = (float(len(xy)),)
    tracks = np.array([[[10.0, 1.5 + 3 * k], [410.0, 1.5 + 3 * k]] for k in range(rows)])
    boundary = np.array([[0.0, 0.0], [420.0, 0.0], [420.0, 285.0], [0.0, 285.0]])
    big = PlanDrive(
        "12 ha", boundary, (), tracks, 3.0, 1.0, (xy,), (np.ones(len(xy), dtype=np.int64),), (1.0,), seconds
    )
    plans = [replace(ranking.plans[0], strategy=f"s{number}", rank=number + 1) for number in range(12)]
    many = {(plan.strategy, plan.tractors): big for plan in plans}
    crowded = replace(ranking, plans=tuple(plans))
    page = render_plan_page(crowded, big, many)
    assert len(page.encode()) < 2_000_000
    knots = [sum(len(lane["status"]) + 1 for lane in plan["lanes"]) for plan in told(page)]
    assert len(knots) == 12 and knots[0] <= MOST_FIRST_KNOTS and sum(knots[1:]) <= MOST_OTHER_KNOTS


def test_points_hide_no_other_and_stay_nearest_their_own_count(ranking: PlanRanking) -> None:
    plans = tuple(
        replace(ranking.plans[0], strategy=name, tractors=count) for count in range(1, 12) for name in "abcdefgh"
    )
    front = build_time_chart(replace(ranking, plans=plans))
    assert len({(point["x"], point["y"]) for point in front["points"]}) == len(plans)
    columns = np.array([*front["counts"].values()])
    for point in front["points"]:
        left = columns[columns <= point["x"]].max()
        assert point["text"].startswith(f"{int(np.searchsorted(columns, left)) + 1} x ")
        assert point["x"] - left < 0.6 * (columns[1] - columns[0])


def test_rounds_cells_and_obstacles_are_on_the_map(
    ranking: PlanRanking, listed_drive: PlanDrive, drive: PlanDrive
) -> None:
    picture = build_page_map({"a": listed_drive})
    assert [one["tint"] for one in picture["headland_passes"]] == [1, 0] and picture["pass_width"] == 300
    assert [label["text"] for label in picture["headland_pass_labels"]] == ["R1", "R2"]
    told_cells = [label["text"].replace("\N{DEGREE SIGN}", " degrees") for label in picture["cell_labels"]]
    assert told_cells == ["cell 1: 90 degrees", "cell 2: 12 degrees"]
    assert picture["cells"].count("z") == 2 and picture["obstacles"].count("z") == 1
    assert {label["text"][-1] for label in picture["labels"]} == {"a"}
    lanes = picture["plans"][0]["lanes"]
    assert [sorted({int(text) for _, _, text in lane["numbers"]}) for lane in lanes] == [[1, 2], [2], [2]], (
        "rows of lists"
    )
    assert all(lane["arrows"].count("M") == len(lane["numbers"]) for lane in lanes)
    bare = build_page_map({"a": drive})
    assert (bare["headland_passes"], bare["cells"], bare["obstacles"], bare["cell_labels"]) == ([], "", "", [])
    said, plain = (Outline(render_plan_page(ranking, one)).text for one in (listed_drive, drive))
    for words in ("headland passes, R1", "cells, with the direction", "obstacles", "rows of the lists of legs"):
        assert words in said and words not in plain


def test_every_tractor_has_a_list_of_its_legs(
    ranking: PlanRanking, listed_drive: PlanDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = render_plan_page(replace(ranking, start="23:59"), listed_drive)
    cards = re.findall(r'aria-label="Legs of tractor (\d)">\s*<table>(.*?)</table>', text, flags=re.S)
    assert [number for number, _ in cards] == ["1", "2", "3"]
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr><td.*?</tr>", cards[1][1])]
    assert rows[0] == ["1", "wait for tractor 1", "23:59:00", "", "0:20"]
    assert rows[1] == ["2", "track 9, eastwards", "23:59:20", "240", "2:40"]
    assert rows[2][:3] == ["3", "omega over 1 track to track 10", "0:02:00"]
    assert cards[1][1].count("<thead>") == 1 and "<thead>" in cards[1][1], "headings that paper repeats"
    assert told(text)[0]["lanes"][1]["legs"][1] == [20.0, 160.0, "240", "track 9, eastwards", 20.0]
    monkeypatch.setattr("reports.plan.map_data.MOST_LISTED_LEGS", 17)
    plans = {("row-by-row", 5): replace(listed_drive, title="the other plan")}
    listed = [bool(plan["lanes"][0]["legs"]) for plan in told(render_plan_page(ranking, listed_drive, plans))]
    assert listed == [True, False], "nine steps each are more than a page holds"


def test_refills_are_marked_where_they_are_done(ranking: PlanRanking, drive: PlanDrive) -> None:
    stood = np.array(drive.status[0])
    stood[100:160] = 5
    seconds = {**drive.seconds, "refilling": (60 * drive.step_s, 0.0, 0.0)}
    text = render_plan_page(ranking, replace(drive, status=(stood, *drive.status[1:]), seconds=seconds))
    lanes = told(text)[0]["lanes"]
    assert [len(lane["refills"]) for lane in lanes] == [1, 0, 0]
    assert lanes[0]["refills"][0][2] == format_duration(60 * drive.step_s)
    assert ">refill</li>" in text and ">refill</li>" not in render_plan_page(ranking, drive)
