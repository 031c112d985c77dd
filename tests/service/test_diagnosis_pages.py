"""The diagnosis in a browser: paths that are played, bars that are as high as the errors, and the sample log."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, ViewportSize

from planner.pipeline.replays import build_evidence
from reports.diagnosis.page import render_diagnosis_page
from tests.reports.test_diagnosis import diagnosis
from tests.reports.test_diagnosis_logs import FAULTY, HARMFUL, LATE
from tests.service.accessibility import find_violations
from tests.service.fake_service import Made
from tests.service.watching import WatchedPage, find_overflow, until
from vehicle.identification.diagnosis.results import NextDrive, ReplayEvidence
from vehicle.identification.logs.reader import read_log
from vehicle.model.tractor import EffectSetting, load_tractor

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def evidence() -> ReplayEvidence:
    """The sample log replayed by the tractor as it is and by one that understeers as that of the log."""
    tractor = load_tractor("eg105")
    found = {"understeer": EffectSetting(value={"deg_per_mps2": 2.06})}
    return build_evidence([read_log("sample")], tractor, tractor.model_copy(update={"effects": found}), "soil")


@pytest.fixture(scope="module")
def report(
    evidence: ReplayEvidence, browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Page, list[str]]]:
    path: Path = tmp_path_factory.mktemp("report") / "report.html"
    shown = replace(HARMFUL, evidence=evidence, faults=FAULTY.faults, columns=LATE.columns, hints=LATE.hints)
    path.write_text(render_diagnosis_page(shown), encoding="utf-8")
    page, said = browser.new_page(), list[str]()
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: said.append(request.url) if not request.url.startswith("file:") else None)
    page.goto(path.as_uri())
    yield page, said
    page.close()


@pytest.mark.parametrize(
    ("title", "name"), [("over driving time", "time"), ("by speed", "speed"), ("by wheel angle", "angle")]
)
@pytest.mark.parametrize(("words", "kind"), [("Across", "cross"), ("Along", "along")])
def test_every_bin_has_two_bars_as_high_as_its_errors(
    report: tuple[Page, list[str]], evidence: ReplayEvidence, title: str, name: str, words: str, kind: str
) -> None:
    bins = getattr(evidence, {"time": "over_time", "speed": "by_speed", "angle": "by_angle"}[name])
    bars: list[dict[str, Any]] = report[0].eval_on_selector_all(
        f"figure:has(figcaption:text-is('{words} the path, {title}, cm')) rect",
        """(all) => all.map((one) => ({ when: one.className.baseVal, value: Number(one.dataset.value),
          height: one.getBoundingClientRect().height }))""",
    )
    assert len(bars) == 2 * len(bins.rows) > 8
    for when in ("before", "after"):
        mine, errors = [one for one in bars if one["when"] == when], getattr(bins, f"{kind}_{when}_cm")
        assert [one["value"] for one in mine] == pytest.approx(errors, abs=1e-3)
        scale = max(one["height"] for one in bars) / max(one["value"] for one in bars)
        assert [one["height"] for one in mine] == pytest.approx(scale * errors, abs=0.5)


def test_the_slider_plays_both_paths_against_the_measured_one(
    report: tuple[Page, list[str]], evidence: ReplayEvidence
) -> None:
    page, said = report
    path = evidence.paths[0]
    slider = page.get_by_label("Time on this path")
    for share in (0.5, 1.0):
        slider.evaluate(f"(one) => {{ one.value = {1000 * share}; one.dispatchEvent(new Event('input')); }}")
        row = int(np.searchsorted(path.time_s - path.time_s[0], share * (path.time_s[-1] - path.time_s[0]) + 1e-6)) - 1
        gaps = [np.linalg.norm(line[row] - path.measured_m[row]) for line in (path.before_m, path.after_m)]
        said_m = [float(one) for one in re.findall(r"([\d.]+) m ", page.inner_text("#paths output"))]
        assert said_m == pytest.approx(gaps, abs=0.03)
        dots = page.eval_on_selector_all(
            "#paths svg",
            """(all) => all.map((one) => [...one.querySelectorAll("circle")]
              .map(({ cx, cy }) => [cx.baseVal.value, cy.baseVal.value]))""",
        )
        assert [np.hypot(*np.subtract(*pair)) for pair in dots] == pytest.approx(gaps, abs=0.03)
    assert gaps[0] > 4 * gaps[1], "the correction brings the path back"
    page.click("#paths button:text-is('Play')")
    until(page, lambda: 0 < float(slider.input_value()) < 1000)
    page.click("#paths button:text-is('Pause')")
    assert said == [], said


@pytest.mark.parametrize("width", [390, 768, 1280])
def test_the_report_fits_the_window(report: tuple[Page, list[str]], width: int) -> None:
    report[0].set_viewport_size(ViewportSize(width=width, height=844))
    assert find_overflow(report[0]) == []
    first, second = (report[0].locator("#paths svg").nth(number).bounding_box() for number in (0, 1))
    assert first is not None and second is not None and first["x"] + first["width"] <= second["x"], "side by side"


def test_the_sample_log_is_diagnosed_and_a_result_is_titled_with_what_was_asked(
    watched: WatchedPage, pages: tuple[str, Made]
) -> None:
    page, made = watched.open("/diagnose"), pages[1]
    made.requests.clear()
    page.click("text=Try it with a sample log")
    page.wait_for_function("() => location.hash === '#/diagnose/made'")
    assert ("diagnoses", {"logs": ["sample"]}) in made.requests
    asked = {"logs": ["run-1", "run-2"], "tractor": "mine", "ground": "asphalt"}
    old = {"id": "old", "status": "done", "name": "north", "request": asked}
    page.route("**/api/v1/diagnoses/old", lambda route: route.fulfill(json=old))
    watched.open("/diagnose/old")
    page.wait_for_selector("text=What does the simulation of mine on asphalt get wrong in run-1, run-2?")
    assert "emonstration" not in page.inner_text("main")
    page.unroute("**/api/v1/diagnoses/old")


def test_runs_are_held_out_where_that_was_chosen(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    page, made = watched.open("/diagnose"), pages[1]
    made.requests.clear()
    page.check("main .tile input >> nth=0")
    page.select_option("select[name=holdout]", "auto")
    page.get_by_role("button", name="Diagnose", exact=True).click()
    page.wait_for_function("() => location.hash === '#/diagnose/made'")
    ((kind, request),) = made.requests
    assert kind == "diagnoses" and request["holdout"] == ["auto"] and len(request["logs"]) == 1
    watched.well()


def test_the_report_says_what_began_before_what_is_wrong_and_is_accessible(report: tuple[Page, list[str]]) -> None:
    text = report[0].inner_text("main")
    places = [text.index(part) for part in ("the wheel does not follow", "held for up to 2 s", "The wheels stand")]
    assert places == sorted(places)
    assert report[0].locator("p.fault").count() == 1
    assert report[0].get_by_role("region", name="Error of each run", exact=True).locator("tr").count() == 4
    assert find_violations(report[0]) == []


def test_the_sample_log_is_replayed_in_the_browser(watched: WatchedPage) -> None:
    page = watched.page
    rows = [{"time_s": 0.1 * k, "easting_m": 0.2 * k, "northing_m": 0.0} for k in range(50)]
    text = "\n".join([",".join(rows[0]), *(",".join(map(str, row.values())) for row in rows)])
    page.route("**/api/v1/logs/sample", lambda route: route.fulfill(body=text, content_type="text/csv"))
    watched.open("/replay")
    page.click("text=Try it with a sample log")
    page.wait_for_selector(".player")
    page.unroute("**/api/v1/logs/sample")
    watched.well()


def test_the_drive_to_do_next_has_a_button_that_saves_its_plan(watched: WatchedPage) -> None:
    page = watched.page
    job = {"id": "doubt", "status": "done", "name": "x", "request": {"logs": ["run-1"]}, "results": ["next-drive.json"]}
    causes = ["side_slip", "understeer"]
    drive = {"words": "Drive there and back.", "decides": True, "separates": causes, "seconds": 40.0}
    page.route("**/api/v1/diagnoses/doubt", lambda route: route.fulfill(json=job))
    page.route("**/doubt/results/result.json", lambda route: route.fulfill(json={"next_drive": drive}))
    page.route("**/doubt/results/next-drive.json", lambda route: route.fulfill(json={"format_version": 1}))
    watched.open("/diagnose/doubt")
    page.wait_for_selector("text=Drive there and back. It decides between side slip and understeer; 40\u00a0s.")
    with page.expect_download() as saving:
        page.click("text=Save the plan of this drive")
    assert saving.value.suggested_filename == "next-drive.json"
    page.unroute_all()
    watched.well()


def test_the_report_saves_the_plan_of_the_next_drive_by_itself(browser: Browser, tmp_path: Path) -> None:
    drive = NextDrive("circles", "Drive circles.", 40.0, ("side_slip", "understeer"), 9.0)
    plan = '{"format_version": 1, "notes": "50 % \u2013 \\"x\\" & <y>"}'
    path = tmp_path / "report.html"
    path.write_text(render_diagnosis_page(diagnosis(next_drive=drive, next_drive_plan=plan)), encoding="utf-8")
    page = browser.new_page()
    page.goto(path.as_uri())
    with page.expect_download() as saving:
        page.click("text=Save the plan of this drive")
    assert Path(saving.value.path()).read_text(encoding="utf-8") == plan
    page.close()
