"""The page: complete, escaped, self-contained, and true to the figures it was given."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from reports.drawing import MOST_SAMPLES, Viewport, bar_rows, front_picture, map_picture
from reports.errors import ReportError
from reports.page import plan_page
from reports.results import Drive, Ranking

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


def animation(text: str) -> dict[str, object]:
    found = re.search(r'<script type="application/json" id="drive">(.*?)</script>', text, flags=re.S)
    assert found
    return json.loads(found.group(1))  # type: ignore[no-any-return]


def test_remarks_are_written_below_the_table(ranking: Ranking) -> None:
    noted = replace(ranking, plans=(replace(ranking.plans[0], remark="it waits <for> nobody"), *ranking.plans[1:]))
    assert "row-by-row with 5: it waits &lt;for&gt; nobody." in plan_page(noted, None)


def test_tags_are_balanced(ranking: Ranking, drive: Drive) -> None:
    for page in (plan_page(ranking, drive), plan_page(ranking, None), plan_page(replace(ranking, plans=()), None)):
        assert Outline(page).open == []


def test_nothing_is_asked_of_the_outside(ranking: Ranking, drive: Drive) -> None:
    page = plan_page(ranking, drive)
    assert "http" not in page
    assert "url(" not in page
    assert "import" not in page
    for tag, attributes in Outline(page).tags:
        assert tag not in {"link", "img", "iframe", "object", "embed"}
        assert not {"src", "href", "srcset", "action"} & set(attributes)


def test_names_are_escaped(ranking: Ranking, drive: Drive) -> None:
    evil = '<b>"x"</script>\'&'
    plans = tuple(replace(plan, strategy=evil, turn=evil, reason=evil) for plan in ranking.plans)
    page = plan_page(
        replace(ranking, field_name=evil, plans=plans, before=evil, assumptions=(evil,)), replace(drive, title=evil)
    )
    assert "<b>" not in page
    outline = Outline(page)
    assert outline.open == []
    assert page.count("</script>") == 2
    assert "".join(outline.words).count(evil) >= 10


def test_same_input_same_page(ranking: Ranking, drive: Drive) -> None:
    assert plan_page(ranking, drive) == plan_page(ranking, drive)


def test_table_has_every_feasible_plan_with_values_to_sort_by(ranking: Ranking) -> None:
    page = plan_page(ranking, None)
    body = page[page.index('<table id="plans">') : page.index("</table>")]
    rows = re.findall(r"<tr[^>]*>(<td.*?)</tr>", body)
    values = [re.findall(r'data-v="([^"]*)"', row) for row in rows]
    assert [row[0] for row in values] == ["1", "2", "3", "4", "5", "6"]
    assert [float(row[4]) for row in values] == [1253.0, 1290.0, 1712.4, 3725.0, 4475.0, 5012.0]
    assert [row[-1] for row in values] == ["1", "1", "1", "0", "0", "0"], "in time or not"
    assert {len(row) for row in values} == {body.count('<th scope="col"')} == {18}
    assert [index for index, row in enumerate(re.findall(r"<tr[^>]*><td", body)) if "best" in row] == [2]


def test_page_says_what_matters(ranking: Ranking, drive: Drive) -> None:
    words = "".join(Outline(plan_page(ranking, drive)).words)
    for part in ("Best plan: 3 tractors", "can be met with 3 or 5", "Refused: 4 plans", "Tractors 2 and 3 touch.",
                 "Working width 3.00 m.", "Seed 7", "28:32", "deadline 1:00:00", drive.title):  # fmt: skip
        assert part in words


def test_without_a_drive_there_is_no_map(ranking: Ranking) -> None:
    page = plan_page(ranking, None)
    assert 'id="map"' not in page
    assert 'id="drive"' not in page


def test_nothing_feasible(ranking: Ranking) -> None:
    page = plan_page(replace(ranking, plans=ranking.plans[6:]), None)
    assert "No plan works: all 4 were refused" in page
    assert '<table id="plans">' not in page


def test_bad_drive_is_refused(ranking: Ranking, drive: Drive) -> None:
    with pytest.raises(ReportError, match="step_s"):
        plan_page(ranking, replace(drive, step_s=-1.0))


def test_animation_gives_the_positions_back(ranking: Ranking, drive: Drive) -> None:
    data = map_picture(drive)["animation"]
    assert animation(plan_page(ranking, drive)) == data
    assert data["step"] == 1.0, "two samples of half a second"
    for entry, xy, status in zip(data["tractors"], drive.xy, drive.status, strict=True):
        places = np.cumsum(np.array(entry["moves"]).reshape(-1, 2), axis=0) / 100.0
        kept = np.minimum(np.arange(len(places)) * 2, len(xy) - 1)
        expected = (xy[kept] - xy[0]) * (1.0, -1.0)
        assert places - places[0] == pytest.approx(expected, abs=0.011)
        assert entry["status"] == "".join(str(value) for value in status[kept])
    assert data["end"] == max(drive.finish_s)


def test_lines_round_trip_to_the_centimetre() -> None:
    points = np.array([[1.0, 9.0], [2.5, 9.0], [2.5, 9.001], [-3.25, 7.5]])
    assert Viewport(0.0, 10.0).line(points) == "M100 100l150 0 -575 150"
    assert Viewport(0.0, 10.0).line(points[:1], closed=True) == "M100 100z"


def test_map_lanes_draw_the_worked_length(drive: Drive) -> None:
    for lane, xy, status in zip(map_picture(drive)["lanes"], drive.xy, drive.status, strict=True):
        steps = np.hypot(*np.diff(xy, axis=0).T)
        drawn = 0.0
        for piece in lane["work"]:
            moves = np.array([int(n) for n in piece["d"].split("l")[1].split()]).reshape(-1, 2)
            drawn += float(np.hypot(*moves.T).sum()) / 100.0
        assert drawn == pytest.approx(float(steps[status[1:] == 1].sum()), rel=1e-3)
        seconds = sum(piece["to"] - piece["from"] for piece in lane["work"])
        assert seconds == pytest.approx(float((status == 1).sum()) * drive.step_s)


def test_bars_share_the_longest(drive: Drive) -> None:
    rows = bar_rows(drive)
    totals = np.array([sum(drive.seconds[name][number] for name in drive.seconds) for number in range(3)])
    shares = [sum(part["share"] for part in row["parts"]) for row in rows]
    assert shares == pytest.approx(totals / totals.max() * 100, abs=0.01)


def test_front_is_drawn_to_scale(ranking: Ranking) -> None:
    front = front_picture(ranking)
    assert front is not None
    box, zero = front["box"], front["times"][0]["y"]
    assert zero == box.north
    scale = (zero - front["deadline"]["y"]) / 3600.0
    times = sorted(plan.time_s for plan in ranking.plans if plan.feasible and plan.time_s)
    assert sorted((zero - point["y"]) / scale for point in front["points"]) == pytest.approx(times, abs=15.0)
    assert all(box.west < point["x"] < box.east and box.south < point["y"] <= box.north for point in front["points"])


def test_deadline_is_drawn_at_the_seconds_allowed_and_only_then(ranking: Ranking) -> None:
    later = front_picture(replace(ranking, allowed_s=5000.0, start=None, before=None))
    assert later is not None
    assert later["deadline"]["text"] == "deadline 1:23:20"
    free = front_picture(replace(ranking, allowed_s=None))
    assert free is not None
    assert free["deadline"] is None


def test_no_point_of_the_front_hides_another(ranking: Ranking) -> None:
    twins = tuple(replace(ranking.plans[0], strategy=name) for name in "abcd")
    front = front_picture(replace(ranking, plans=twins))
    assert front is not None
    assert len({(point["x"], point["y"]) for point in front["points"]}) == 4


def test_a_large_noisy_drive_stays_below_two_megabytes(ranking: Ranking) -> None:
    rng = np.random.default_rng(4)
    rows, along = 190, np.arange(10.0, 410.0, 0.7)
    lines = [np.column_stack([along if k % 2 else along[::-1], np.full(len(along), 1.5 + 3 * k)]) for k in range(rows)]
    xy = np.vstack(lines) + rng.normal(0.0, 0.08, (rows * len(along), 2))
    seconds = {"working": (float(len(xy)),)} | dict.fromkeys(("turning", "waiting", "reversing"), (0.0,))
    tracks = np.array([[[10.0, 1.5 + 3 * k], [410.0, 1.5 + 3 * k]] for k in range(rows)])
    boundary = np.array([[0.0, 0.0], [420.0, 0.0], [420.0, 570.0], [0.0, 570.0]])
    big = Drive("24 ha", boundary, (), tracks, 3.0, 1.0, (xy,), (np.ones(len(xy), dtype=np.int64),), (1.0,), seconds)
    assert len(plan_page(ranking, big).encode()) < 2_000_000
    samples = [len(entry["status"]) for entry in map_picture(big)["animation"]["tractors"]]
    assert sum(samples) <= MOST_SAMPLES + len(samples)


def test_a_drive_of_one_moment_on_a_field_without_tracks(ranking: Ranking, drive: Drive) -> None:
    still = replace(
        drive,
        tracks=np.empty((0, 2, 2)),
        holes=(),
        entrance=None,
        xy=tuple(xy[:1] for xy in drive.xy),
        status=tuple(status[:1] for status in drive.status),
    )
    page = plan_page(ranking, still)
    assert Outline(page).open == []
    assert animation(page)["end"] == 0.0


def test_points_stay_nearest_their_own_count(ranking: Ranking) -> None:
    plans = tuple(
        replace(ranking.plans[0], strategy=name, tractors=count) for count in range(1, 12) for name in "abcdefgh"
    )
    front = front_picture(replace(ranking, plans=plans))
    assert front is not None
    columns = np.array([tick["x"] for tick in front["counts"]])
    for point in front["points"]:
        left = columns[columns <= point["x"]].max()
        assert point["text"].startswith(f"{int(np.searchsorted(columns, left)) + 1} x ")
        assert point["x"] - left < 0.6 * (columns[1] - columns[0])
