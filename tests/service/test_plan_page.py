"""The form of a plan, its progress and its table: the tractor is named, no second is silent, every tab may plan."""

import re
from typing import Any

import pytest
from playwright.sync_api import Page

from planner.service.jobs import job_runs, workers
from planner.service.settings import ServiceSettings
from tests.service.fake_service import CONTROL
from tests.service.watching import WatchedPage, needs_browser

pytestmark = pytest.mark.slow
COST = "18"  # 3 tractors x 470 s / 80, as it is stated: the expected cost, in whole units from 10 on


def open_plan(watched: WatchedPage) -> Page:
    page = watched.open("/plan/old")
    page.wait_for_selector("text=Plans, best first")
    return page


@needs_browser
def test_the_plan_to_take_is_first_with_the_cost_of_the_figures(watched: WatchedPage) -> None:
    page = open_plan(watched)
    table = page.locator("[aria-label='Ranked plans']")
    heads = [head for head in table.locator("th").all_inner_texts() if head]
    assert len([each for each in table.locator("th").all() if each.is_visible()]) <= 8
    first = dict(zip(heads, table.locator("tbody tr").first.locator("td").all_inner_texts(), strict=False))
    assert (first["Tractors"], first["Strategy"], first["Cost"], first["In time %"]) == ("3", "split-field", COST, "93")
    assert "chosen" in (table.locator("tbody tr").first.get_attribute("class") or "")
    figures = page.locator("dl").first.inner_text()
    assert f"Cost\n{COST}" in figures and "In time\n93\xa0%" in figures
    watched.well()


@needs_browser
def test_more_columns_are_shown_on_request(watched: WatchedPage) -> None:
    page = open_plan(watched)
    table = page.locator("[aria-label='Ranked plans']")
    assert not table.locator("th:has-text('Turning')").is_visible()
    page.click("text=All columns")
    assert table.locator("th:has-text('Turning')").is_visible()
    assert page.locator("button:has-text('All columns')").get_attribute("aria-pressed") == "true"
    page.click("text=All columns")
    assert not table.locator("th:has-text('Turning')").is_visible()
    watched.well()


@needs_browser
def test_what_was_not_tried_is_not_called_impossible(watched: WatchedPage) -> None:
    page = open_plan(watched)
    assert page.locator("summary:has-text('not possible')").inner_text() == "1 plan not possible, with the reason"
    assert page.locator("text=1 plan not simulated, as others are estimated to be faster.").is_visible()
    assert page.locator("text=1 plan not simulated, as tractors may come nearer than 0.5").is_visible()
    watched.well()


@needs_browser
def test_the_tractor_is_named_first_in_form_and_answer(watched: WatchedPage) -> None:
    page = watched.open("/plan")
    page.wait_for_selector("form section:first-child p:text-is('Yanmar EG105')")
    assert page.locator("form h2").first.inner_text() == "Tractor"
    page = open_plan(watched)
    assert page.locator("h1").inner_text().startswith("Yanmar EG105: ")
    watched.well()


LONGEST_SILENCE = """() => new Promise((done) => {
  const clock = () => performance.now(), shown = (one) => one.offsetParent && one.textContent.trim();
  let first = null, silent = clock(), silence = 0;
  const begin = silent, words = new Set();
  const look = () => {
    const places = "main .panel [role=status]:not(.lead), main .page > .soft:only-child";
    const said = [...document.querySelectorAll(places)].filter(shown).map((one) => one.textContent);
    if (said.length) { first ??= clock() - begin; silent = null; said.forEach((text) => words.add(text)); }
    else silence = Math.max(silence, clock() - (silent ??= clock()));
    if (document.querySelector("[aria-label='Ranked plans']")) return done({ first, silence, words: [...words] });
    requestAnimationFrame(look);
  };
  document.querySelector("form button.main").click();
  look();
})"""
"""Milliseconds from the click to the first text of progress, the longest without any, and the texts."""


@needs_browser
def test_progress_is_shown_within_a_second_of_the_click_and_never_stops(watched: WatchedPage, pages: Any) -> None:
    page, made = watched.open("/plan"), pages[1]
    page.wait_for_selector("text=Run the plan")
    made.polls = 0
    seen = page.evaluate(LONGEST_SILENCE)
    assert seen["first"] < 1000 and seen["silence"] < 1000, seen
    shares = [each for each in seen["words"] if re.fullmatch(r"Simulating plans: [12] of 3, (33|67)\xa0%", each)]
    assert "Checking what was asked" in seen["words"] and shares, seen
    watched.well()


@needs_browser
def test_a_second_tab_may_plan_until_the_token_is_forgotten(watched: WatchedPage) -> None:
    first = watched.open("/plan")
    second = first.context.new_page()
    second.goto(f"{watched.base}#/plan")
    second.wait_for_selector("text=Run the plan")
    assert second.evaluate("sessionStorage.getItem('headland-token')") == CONTROL
    assert second.locator("text=You can look at everything here").count() == 0
    second.goto(f"{watched.base}#/access")
    second.click("text=Forget it")
    first.wait_for_function("() => sessionStorage.getItem('headland-token') === null")
    second.close()


def test_a_worker_without_a_job_loads_what_the_first_one_needs(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    heard = list[str]()
    jobs = iter([None, None, "a job"])

    def claim(*_: Any) -> Any:
        heard.append("claim")
        return next(jobs)

    monkeypatch.setattr("signal.signal", lambda *_: None)  # a worker ignores Ctrl-C, this process does not
    monkeypatch.setattr(workers, "_claim_next_job", claim)
    monkeypatch.setattr(workers, "end_with_service", lambda: None)
    monkeypatch.setattr(workers, "run_and_store_job", lambda *_: heard.append("run"))
    monkeypatch.setattr(job_runs, "load_job_libraries", lambda: heard.append("load"))
    with pytest.raises(StopIteration):
        workers.run_worker(ServiceSettings(data=tmp_path), "w")
    assert heard == ["claim", "load", "claim", "claim", "run", "claim"]
