"""Pages as a browser lays them out: on a small screen, on paper, and when used."""

import re
from collections.abc import Callable
from dataclasses import replace
from html import escape, unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from reports.common.plan_records import PlanDrive
from reports.common.plan_results import PlanRanking
from reports.plan.ranking_page import render_plan_page
from reports.trials.report import render_trials_page
from vehicle.trials.sheets.sheet import ExperimentSheet, TextTable, ThesisComparison

pytestmark = pytest.mark.slow
Ask = Callable[[str, int, str], Any]


@pytest.fixture(scope="module")
def tab(browser: Browser) -> Page:
    return browser.new_page()


@pytest.fixture
def ask(tab: Page, tmp_path: Path) -> Ask:
    """What an expression comes to in a page shown `width` points wide; the page is its `doc`."""

    def answer(page: str, width: int, expression: str) -> Any:
        frame = tmp_path / "frame.html"
        frame.write_text(
            f'<!doctype html><iframe style="border:0;width:{width}px;height:900px" srcdoc="{escape(page)}"></iframe>',
            encoding="utf-8",
        )
        tab.goto(frame.as_uri())
        return tab.evaluate(
            "() => { const shown = document.querySelector('iframe'), doc = shown.contentDocument, "
            f"view = shown.contentWindow; return (() => {{ {expression} }})(); }}"
        )

    return answer


def pages_on_paper(tab: Page, tmp_path: Path, page: str) -> int:
    source = tmp_path / "page.html"
    source.write_text(page, encoding="utf-8")
    tab.goto(source.as_uri())
    return len(re.findall(rb"/Type\s*/Page\b", tab.pdf(prefer_css_page_size=True)))


@pytest.fixture
def usual(ranking: PlanRanking) -> PlanRanking:
    """As many plans as a usual scenario has."""
    plans = [
        replace(ranking.plans[n % 6], strategy=name, tractors=count, rank=n + 1)
        for n, (count, name) in enumerate(
            (count, name) for count in range(1, 7) for name in ("split-field", "row-by-row-optimised", "interleaved")
        )
    ]
    return replace(ranking, plans=(*plans, *ranking.plans[6:]))


class TestPlan:
    def test_a_usual_plan_prints_on_two_pages(
        self, usual: PlanRanking, drive: PlanDrive, tab: Page, tmp_path: Path
    ) -> None:
        assert pages_on_paper(tab, tmp_path, render_plan_page(usual, drive)) <= 2

    def test_a_small_screen_scrolls_inside_and_has_a_large_map(
        self, usual: PlanRanking, drive: PlanDrive, ask: Ask
    ) -> None:
        read = ask(render_plan_page(usual, drive), 400, """
            const box = (name) => doc.querySelector(name).getBoundingClientRect();
            return { page: doc.documentElement.scrollWidth, map: box("#map").height, wide: box("#map").width,
              around: doc.querySelector("#map").parentNode.clientWidth,
              table: doc.querySelector("#plans").scrollWidth, room: doc.querySelector("#plans").parentNode.clientWidth,
              hint: view.getComputedStyle(doc.querySelector(".hint")).display,
              shade: view.getComputedStyle(doc.querySelector("#plans").parentNode).backgroundImage };
        """)  # fmt: skip
        assert read["page"] <= 400, "the page itself does not scroll sideways"
        assert read["map"] >= 200 and read["wide"] > read["around"], "a wide map scrolls in its frame"
        assert read["table"] > read["room"] and read["hint"] == "block" and "gradient" in read["shade"]

    def test_a_wide_screen_shows_all_of_the_map_and_fills_the_card_of_the_chart(
        self, usual: PlanRanking, drive: PlanDrive, ask: Ask
    ) -> None:
        read = ask(render_plan_page(usual, drive), 1280, """
            const box = (name) => doc.querySelector(name).getBoundingClientRect();
            return { page: doc.documentElement.scrollWidth, map: box("#map").width,
              around: doc.querySelector("#map").parentNode.clientWidth, card: box(".split").width,
              filled: box(".split .legend").right - box(".chart").left,
              hint: view.getComputedStyle(doc.querySelector(".hint")).display };
        """)  # fmt: skip
        assert read["page"] <= 1280 and read["map"] == pytest.approx(read["around"], abs=1)
        assert read["filled"] > 0.93 * read["card"] and read["hint"] == "none"

    def test_the_map_is_zoomed_in_a_frame_that_keeps_its_size(
        self, usual: PlanRanking, drive: PlanDrive, ask: Ask
    ) -> None:
        read = ask(render_plan_page(usual, drive), 700, """
            const map = doc.querySelector("#map"), frame = map.parentNode, said = [];
            const tell = () => said.push([map.getBoundingClientRect().width, frame.clientHeight, frame.scrollLeft]);
            const press = (name) => { doc.querySelector(`[aria-label="${name}"]`).click(); tell(); };
            tell();
            ["Zoom in", "Zoom in", "Zoom out", "Show the whole field"].forEach(press);
            for (let k = 0; k < 9; k++) press("Zoom in");
            return said;
        """)  # fmt: skip
        widths, heights = [one[0] for one in read], [one[1] for one in read]
        assert widths[1:5] == pytest.approx([widths[0] * by for by in (1.5, 2.25, 1.5, 1.0)], rel=0.01)
        assert widths[-1] == pytest.approx(8 * widths[0], rel=0.01), "no larger than that"
        assert max(heights) - min(heights) <= 16, "but for a bar to scroll with"
        assert read[2][2] > read[1][2] > read[0][2], "its middle stays in the middle"

    def test_it_starts_at_the_beginning_plays_and_changes_plans(
        self, ranking: PlanRanking, drive: PlanDrive, ask: Ask
    ) -> None:
        other = replace(drive, title="the other plan", xy=drive.xy[:1], status=drive.status[:1], finish_s=(1.0,),
                        seconds={name: values[:1] for name, values in drive.seconds.items()})  # fmt: skip
        page = render_plan_page(ranking, drive, {("row-by-row", 5): other})
        read = ask(page, 900, """
            const text = (name) => doc.getElementById(name).textContent;
            const tell = () => ({
              clock: text("clock"), phase: text("phase"), shown: text("shown"), fleet: text("fleet"),
              ahead: doc.querySelectorAll("#lanes .ahead").length, lines: doc.querySelectorAll("#lanes path").length,
              marks: doc.querySelectorAll("#marks g").length, rows: doc.querySelectorAll("#times tbody tr").length });
            const said = [tell()];
            const slider = doc.getElementById("time");
            slider.value = slider.max;
            slider.dispatchEvent(new view.Event("input"));
            said.push(tell());
            doc.querySelector('.pick[data-plan="1"]').click();
            said.push(tell());
            return said;
        """)  # fmt: skip
        start, end, chosen = read
        assert start["clock"] == "0:00:00" and start["phase"].startswith("At the start")
        assert start["fleet"].count("at the start") == 3 == start["marks"] == start["rows"]
        assert start["ahead"] >= 0.8 * (start["lines"] - 6), "all but live lines and arrows are still faint"
        whole = round(max(drive.finish_s))
        assert end["clock"] == f"0:{whole // 60:02d}:{whole % 60:02d}" and end["phase"].startswith("All done")
        assert end["ahead"] == 0 and end["fleet"].count("done") == 3
        assert chosen["shown"] == "the other plan" and chosen["clock"] == "0:00:00"
        assert chosen["marks"] == chosen["rows"] == 1

    def test_lists_of_legs_follow_the_plan_and_the_time(
        self, ranking: PlanRanking, listed_drive: PlanDrive, ask: Ask
    ) -> None:
        start = replace(ranking, start="08:00")
        other = replace(listed_drive, title="the other plan", steps=tuple(own[1:] for own in listed_drive.steps))
        page = render_plan_page(start, listed_drive, {("row-by-row", 5): other})
        read = ask(page, 900, """
            const tell = () => [...doc.querySelectorAll("#cards table")].map((one) =>
              [...one.rows].map((row) => [...row.cells].map((cell) => cell.textContent).join("|")));
            const said = [tell()];
            const slider = doc.getElementById("time");
            slider.value = 100;
            slider.dispatchEvent(new view.Event("input"));
            said.push([...doc.querySelectorAll("#cards .now")].map((row) => row.cells[1].textContent));
            said.push(doc.getElementById("fleet").textContent);
            doc.querySelector('.pick[data-plan="1"]').click();
            said.push(tell());
            return said;
        """)  # fmt: skip
        written = re.findall(r"<table>\s*<thead>(.*?)</table>", page, flags=re.S)
        made, now, fleet, chosen = read
        for table, source in zip(made, written, strict=True):
            rows = re.findall(r"<tr>(.*?)</tr>", source, flags=re.S)
            cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in rows]
            plain = ["|".join(unescape(re.sub(r"<[^>]*>", "", cell)) for cell in row) for row in cells]
            assert table == plain, "the script makes the lists that stand in the page"
        assert now == [f"track {number}, eastwards" for number in (1, 9, 17)]
        assert all(words in fleet for words in now)
        assert [len(table) for table in chosen] == [4, 4, 4] and "the other plan" in chosen[0][0]

    def test_a_table_of_plans_fits_letter_paper(self, usual: PlanRanking, drive: PlanDrive, ask: Ask) -> None:
        # Letter less margins of 12 mm is 725 points wide. A page that always looks as printed can be measured.
        plans = tuple(replace(plan, cost=123456.78, turn="switch-back+omega") for plan in usual.plans)
        page = render_plan_page(replace(usual, plans=plans), drive).replace("@media print", "@media all")
        read = ask(page, 725, """
            return [doc.documentElement.scrollWidth, doc.querySelector("#plans").scrollWidth];
        """)  # fmt: skip
        assert max(read) <= 725

    def test_every_tractor_has_a_sheet_of_its_own(
        self, usual: PlanRanking, listed_drive: PlanDrive, tab: Page, tmp_path: Path
    ) -> None:
        assert pages_on_paper(tab, tmp_path, render_plan_page(usual, listed_drive)) == 2 + len(listed_drive.steps)

    def test_the_hatching_is_that_of_the_plan_shown(
        self, leaving: PlanRanking, open_drive: PlanDrive, drive: PlanDrive, ask: Ask
    ) -> None:
        page = render_plan_page(leaving, open_drive, {("row-by-row", 5): replace(drive, title="the other plan")})
        read = ask(page, 900, """
            const tell = () => [...doc.querySelectorAll("#missed path")].map((one) => one.getAttribute("d").length)
              .concat(doc.getElementById("largest").textContent);
            const said = [tell()];
            for (const number of [1, 0]) {
              doc.querySelector(`.pick[data-plan="${number}"]`).click();
              said.push(tell());
            }
            return said;
        """)  # fmt: skip
        assert read[0][:2] > [10, 100] and read[0][2] == "590 m2 missed here, 690 m2 in all"
        assert read[1:] == [[0, 0, ""], read[0]]

    def test_all_that_can_be_used_is_reached_by_keyboard(self, usual: PlanRanking, drive: PlanDrive, ask: Ask) -> None:
        assert ask(render_plan_page(usual, drive), 900, """
            return [...doc.querySelectorAll("button, input, select, .scroll")].filter(
              (one) => one.tabIndex < 0 && !one.disabled).length;
        """) == 0  # fmt: skip


def test_a_page_of_experiments_scrolls_inside_on_a_small_screen(ask: Ask) -> None:
    table = TextTable("Radii", tuple(f"Heading {k}" for k in range(12)), (tuple("1234.5678" for _ in range(12)),))
    rows = tuple(
        ThesisComparison(f"4.1 kinematic {k} deg", "turning radius", "m", 5.0, 5.1, "a note") for k in range(50)
    )
    page = render_trials_page(
        [ExperimentSheet("a", "Circles", ("Words.",), rows, (), (table,)), ExperimentSheet("b", "B", (), rows)]
    )
    read = ask(page, 400, "return [doc.documentElement.scrollWidth, doc.querySelectorAll('.scroll').length];")
    assert read[0] <= 400 and read[1] >= 3


@pytest.mark.slow
def test_the_map_of_a_tall_field_is_whole_on_a_small_screen(ranking: PlanRanking, drive: PlanDrive, ask: Ask) -> None:
    def turned(points: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(points[..., ::-1])

    tall = replace(drive, boundary=turned(drive.boundary), holes=(), swaths=turned(drive.swaths), entrance=None,
                   xy=tuple(map(turned, drive.xy)))  # fmt: skip
    read = ask(render_plan_page(ranking, tall), 400, """
        const map = doc.querySelector("#map"), box = map.getBoundingClientRect();
        return [box.width, map.parentNode.clientWidth, box.height];
    """)  # fmt: skip
    assert read[0] == pytest.approx(read[1], abs=1) and read[2] >= 200
