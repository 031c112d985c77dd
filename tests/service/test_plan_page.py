"""The table of a plan on its page: the plan to take first, eight columns, the rest on request, one cost."""

from __future__ import annotations

import pytest

from tests.service.watching import WatchedPage

COST = "18"  # 3 tractors x 470 s / 80, as it is stated: the expected cost, in whole units from 10 on


def test_the_plan_to_take_is_first_with_the_cost_of_the_figures(watched: WatchedPage) -> None:
    page = watched.open("/plan/old")
    page.wait_for_selector("text=Plans, best first")
    table = page.locator("[aria-label='Ranked plans']")
    heads = [head for head in table.locator("th").all_inner_texts() if head]
    assert len([each for each in table.locator("th").all() if each.is_visible()]) <= 8
    first = dict(zip(heads, table.locator("tbody tr").first.locator("td").all_inner_texts(), strict=False))
    assert (first["Tractors"], first["Strategy"], first["Cost"], first["In time %"]) == ("3", "split-field", COST, "93")
    assert "chosen" in (table.locator("tbody tr").first.get_attribute("class") or "")
    figures = page.locator("dl").first.inner_text()
    assert f"Cost\n{COST}" in figures and "In time\n93\xa0%" in figures
    watched.well()


def test_more_columns_are_shown_on_request(watched: WatchedPage) -> None:
    page = watched.open("/plan/old")
    page.wait_for_selector("text=Plans, best first")
    table = page.locator("[aria-label='Ranked plans']")
    assert not table.locator("th:has-text('Turning')").is_visible()
    page.click("text=All columns")
    assert table.locator("th:has-text('Turning')").is_visible()
    assert page.locator("button:has-text('All columns')").get_attribute("aria-pressed") == "true"
    page.click("text=All columns")
    assert not table.locator("th:has-text('Turning')").is_visible()
    watched.well()


@pytest.mark.slow
def test_what_was_not_tried_is_not_called_impossible(watched: WatchedPage) -> None:
    page = watched.open("/plan/old")
    page.wait_for_selector("text=Plans, best first")
    assert page.locator("summary:has-text('not possible')").inner_text() == "1 plan not possible, with the reason"
    assert page.locator("text=1 plan not simulated, as others are faster even in their best case.").is_visible()
    watched.well()
