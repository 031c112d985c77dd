"""Every page has one style, prints, and hides nothing without a hint."""

import re

import pytest

from reports.common.plan_records import PlanDrive
from reports.common.plan_results import PlanRanking
from reports.common.rendering import render_template
from reports.diagnosis.page import render_diagnosis_page
from reports.diagnosis.replay import build_replay_table, format_replay_json, render_replay_page
from reports.plan.ranking_page import render_plan_page
from reports.trials.report import render_trials_page
from tests.printing import print_text
from tests.reports.test_diagnosis import NAMED, diagnosis, in_model
from vehicle.identification.diagnosis.results import ReplayResult
from vehicle.identification.replay.horizon_errors import HorizonError
from vehicle.trials.sheets.sheet import ExperimentSheet, TextTable, ThesisComparison

REPLAYED = ReplayResult(
    "run & 1",
    "EG105",
    ("steering_offset", "discrepancy_model"),
    {1.0: HorizonError(0.5, 0.6, float("nan")), 5.0: HorizonError(1.25, 2.5, 0.11)},
    (),
    3,
)


@pytest.fixture
def pages(ranking: PlanRanking, drive: PlanDrive) -> dict[str, str]:
    table = TextTable("Radii", ("Steering", "Radius"), (("25", "5.1 m"),))
    sheets = [
        ExperimentSheet(name, name, (), (ThesisComparison("e", "q", "m", 5.0, 5.1),), (), (table,)) for name in "ab"
    ]
    return {
        "plan": render_plan_page(ranking, drive),
        "trials": render_trials_page(sheets),
        "diagnosis": render_diagnosis_page(diagnosis(in_model("steering_offset", NAMED, 1.0))),
        "replay": render_replay_page(REPLAYED),
    }


def test_one_style_for_all(pages: dict[str, str]) -> None:
    styles = {name: page.split("<style>")[1].split("</style>")[0] for name, page in pages.items()}
    common = styles["plan"][: styles["plan"].index("@page")]
    assert len(common) > 3000
    for name, style in styles.items():
        assert style.startswith(common), name
        assert style.count("prefers-color-scheme: dark") == 1 and style.count(":root {") == 2
        assert style.count("{") == style.count("}")


def test_every_table_scrolls_in_a_frame_that_keys_reach_and_a_reader_is_told_of(pages: dict[str, str]) -> None:
    for name, page in pages.items():
        for at in (match.start() for match in re.finditer("<table", page)):
            frame = page[page[:at].rindex("<div") :]
            assert re.match(r'<div class="[^"]*scroll[^"]*" tabindex="0" role="region" aria-label="', frame), name
        assert "@media print" in page and "width=device-width" in page
        assert re.findall(r"(?:src|href)=[\"'](?!data:|#)", page) == []


def test_a_replay_says_how_far_it_is_off() -> None:
    page = render_replay_page(REPLAYED, ["a remark <b>"])
    assert "run &amp; 1 against EG105" in page and "a remark &lt;b&gt;" in page
    assert "Over pieces of 5 s the simulation is off by 1.2 cm across and 2.5 cm along the way, and its" in page
    effects = "steering offset (steering_offset) and discrepancy model (discrepancy_model)"
    assert f"Effects in the tractor file: {effects}." in page
    assert '"heading_deg": null' in format_replay_json(REPLAYED) and "NaN" not in format_replay_json(REPLAYED)


@pytest.mark.parametrize("width", [20, 40, 60, 80, 120, 200])
def test_a_replay_table_cuts_no_figure(width: int) -> None:
    text = print_text(build_replay_table(REPLAYED), width)
    assert max(map(len, text.splitlines())) <= width
    for figure in ("0.5", "0.6", "1.2", "2.5", "0.11"):
        assert re.search(rf"(?<![\d.]){figure}( |$)", text, flags=re.M)


def test_values_are_escaped_and_a_missing_one_is_an_error() -> None:
    from jinja2 import UndefinedError

    with pytest.raises(UndefinedError):
        render_template("trial.html.j2", {"title": "a"})
