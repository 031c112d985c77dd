"""What has no timetable in one order of tracks is not driven in the orders turned from it, where a rival is known."""

from dataclasses import replace
from typing import Any, cast

import pytest
import shapely

from fields import Field
from planner.candidates.beaten import Rival
from planner.candidates.bounds import least_s, pace_of
from planner.candidates.evaluate import Candidate, CandidateRun, run_candidate, simulated
from planner.candidates.other_orders import Untimed
from planner.outlook import stakes_of
from planner.scenario import Scenario
from planner.site import Site, prepare
from planner.yielding.giving_way import Rules, Scheduled
from strategies.headland.rounds import FIRST, LAST
from strategies.record import Refined
from vehicle.missions import Plan
from vehicle.run import Run

BOTH, EVERY_SECOND = (0, 1), (1,)


@pytest.fixture(scope="module")
def round_site() -> Site:
    """60 m by 90 m with its headland worked."""
    return prepare(Scenario(), Field("drawn", shapely.box(0, 0, 60, 90)))


class Driven:
    """Orders and plans that would have been driven, who gets a timetable, and whether all get home alone."""

    def __init__(self, timed: tuple[str, ...] = (LAST,)) -> None:
        self.timed, self.home = timed, True
        self.plans: list[tuple[Any, Plan]] = []

    def meets(self, *given: Any) -> CandidateRun:
        job, plan, give_way = given[2], given[3].plan, given[5]
        self.plans.append((job.jump or job.turned, plan))
        give_way(plan, 1.0)
        return CandidateRun(cast(Run, None), "tractors meet", "none", None)

    def schedule(self, plan: Plan, rules: Rules, _: float) -> Scheduled | None:
        if plan.notes["headland"] in self.timed:
            return Scheduled(plan, 1.0, 1.0)
        if self.home:
            rules.untimed.append(plan)
        return None

    def orders(self, headland: str) -> list[Any]:
        """The orders in which the rounds were driven like this, each once."""
        return list(dict.fromkeys(order for order, plan in self.plans if plan.notes["headland"] == headland))


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> Driven:
    """In all plans tractors meet, and those with the rounds first have no timetable."""
    found = Driven()
    monkeypatch.setattr("planner.candidates.evaluate._run_plan", found.meets)
    monkeypatch.setattr("planner.candidates.evaluate.giving_way", found.schedule)
    return found


SLOW = Rival("split-field", 1200.0)
"""Slower than all plans, but for those with one tractor alone on the rounds."""


def leasts(site: Site, plans: list[tuple[Any, Plan]]) -> dict[tuple[Any, str], list[float]]:
    """The least times of plans, by their order and whether the rounds are first, in the order they are driven."""
    pace = pace_of(site.tractor, site.implement, site.manner.radius_m)
    found: dict[tuple[Any, str], list[float]] = {}
    for order, plan in plans:
        found.setdefault((order, plan.notes["headland"]), []).append(least_s(plan, pace))
    return found


def test_rounds_first_are_not_driven_in_turned_orders(round_site: Site, driven: Driven) -> None:
    run_candidate(round_site, Candidate("interleaved", 2))
    least = leasts(round_site, driven.plans)
    driven.plans.clear()
    told = simulated(round_site, Candidate("interleaved", 2), SLOW).result
    again, out = leasts(round_site, driven.plans), [least[order, FIRST][0] for order in (BOTH, EVERY_SECOND)]
    assert again[(), FIRST] == least[(), FIRST] and (BOTH, FIRST) not in again
    assert again[EVERY_SECOND, FIRST] == least[EVERY_SECOND, FIRST][1:], "which came by another passage"
    for order in ((), BOTH, EVERY_SECOND):
        assert again[order, LAST] == least[order, LAST][:-1], "one alone is beaten"
    alone_s = min(least[order, LAST][-1] for order in ((), BOTH, EVERY_SECOND))
    assert told.bound_s == pytest.approx(min(out), abs=1e-3)
    assert told.reason == (
        f"rounds first (at least {min(out):.0f} s) found no timetable in one order of tracks and were not driven in "
        f"others; otherwise at least {alone_s:.0f} s, split-field takes {SLOW.seconds:.0f} s"
    )


def test_with_no_rival_every_order_is_driven(round_site: Site, driven: Driven) -> None:
    run_candidate(round_site, Candidate("interleaved", 2))
    assert driven.orders(FIRST) == driven.orders(LAST) == [(), BOTH, EVERY_SECOND]


def driven_beside(site: Site, driven: Driven, strategy: str = "interleaved") -> list[Any]:
    """The orders in which the rounds are driven first beside a slow rival."""
    simulated(site, Candidate(strategy, 2), SLOW)
    return driven.orders(FIRST)


def test_tracks_one_after_another_are_another_matter(round_site: Site, driven: Driven) -> None:
    assert 1 in driven_beside(round_site, driven, "split-field")


def test_where_a_timetable_was_found_every_order_is_driven(round_site: Site, driven: Driven) -> None:
    driven.timed = (FIRST, LAST)
    assert driven_beside(round_site, driven) == [(), BOTH, EVERY_SECOND]


def test_where_one_does_not_get_home_alone_every_order_is_driven(round_site: Site, driven: Driven) -> None:
    driven.home = False
    assert driven_beside(round_site, driven) == [(), BOTH, EVERY_SECOND]


def test_where_money_decides_every_order_is_driven(round_site: Site, driven: Driven) -> None:
    asked = replace(round_site.scenario, prefer="cheapest")
    assert driven_beside(replace(round_site, scenario=asked, stakes=stakes_of(asked)), driven) == [
        (), BOTH, EVERY_SECOND
    ]  # fmt: skip


def test_only_the_same_passage_is_left_out(round_site: Site) -> None:
    untimed = Untimed(lambda plan: float(plan.notes["least"]))
    rounds = [Refined(Plan((), {"headland": order, "least": least})) for order, least in ((LAST, 5), (FIRST, 9))]
    job = replace(round_site.job(2), turned=BOTH)
    untimed.note(0, [rounds[0].plan])
    assert untimed.left_out(job, 0, rounds) == [] and untimed.told is None
    untimed.note(0, [rounds[1].plan])
    assert untimed.left_out(round_site.job(2), 0, rounds) == untimed.left_out(job, 1, rounds) == []
    assert untimed.left_out(job, 0, rounds) == [rounds[1]] and untimed.least_s == 9.0
    assert Untimed().left_out(job, 0, rounds) == []
