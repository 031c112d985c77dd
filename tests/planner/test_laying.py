"""Which layout a field is planned with: what is asked for stays, and what is open is what one tractor does soonest."""

import math
from typing import Any

import pytest
import shapely

from fields import Field, lay_tracks
from planner.candidates.evaluate import Candidate, evaluate
from planner.laying import LEAST_GAIN, finish_s, layouts
from planner.scenario import Scenario
from planner.site import Site, prepare
from strategies.registry import STRATEGIES

L = Field("L", shapely.Polygon([(0, 0), (120, 0), (120, 55), (50, 55), (50, 140), (0, 140)]))
RECTANGLE = Field("r", shapely.box(0, 0, 200, 60))


def site_on(field: Field, **asked: Any) -> Site:
    return prepare(Scenario(field="f", **{"tracks_only": False, **asked}), field)


@pytest.fixture(scope="module")
def in_cells() -> Site:
    return site_on(L)


@pytest.fixture(scope="module")
def one_bearing(in_cells: Site) -> Site:
    """The plain layout beside it: the best single bearing in as many rounds as turns need."""
    return site_on(L, bearing_deg=layouts(in_cells.scenario, L, 9.0)[0].bearing_deg, headland_m=9.0)


def test_an_l_is_worked_in_cells(in_cells: Site, one_bearing: Site) -> None:
    assert len(in_cells.layout.cells) > 1 == len(one_bearing.layout.cells)
    assert finish_s(in_cells.job(1)) < (1.0 - LEAST_GAIN) * finish_s(one_bearing.job(1))


def test_the_choice_holds_when_it_is_driven(in_cells: Site, one_bearing: Site) -> None:
    with_cells, without = (evaluate(site, Candidate("split-field", 1)) for site in (in_cells, one_bearing))
    assert with_cells.feasible and without.feasible
    assert with_cells.finished_s is not None and without.finished_s is not None
    assert with_cells.finished_s < without.finished_s
    assert with_cells.worked_pct is not None and with_cells.worked_pct > 99.0


def test_headings_are_those_of_the_cells(in_cells: Site) -> None:
    for track, heading in headings(in_cells):
        bearing = in_cells.layout.bearing_of(track)
        assert abs((heading - bearing + 1.0) % math.pi - 1.0) < 1e-9


def headings(site: Site) -> list[tuple[Any, float]]:
    """Every track with the angle of the leg that works it."""
    by_place = {(track.line, track.piece): track for track in site.layout.tracks}
    plan = STRATEGIES["split-field"].build(site.job(1))
    told = []
    for leg in plan.missions[0].legs:
        if leg.implement:
            (x0, y0), (x, y) = leg.points[0], leg.points[-1]
            told.append((by_place[leg.task.number, leg.task.piece], math.atan2(y - y0, x - x0)))
    assert {track for track, _ in told} == set(site.layout.tracks)
    return told


class TestAskedFor:
    def test_a_bearing_is_that_of_the_only_cell(self) -> None:
        site = site_on(L, bearing_deg=30.0)
        assert len(site.layout.cells) == 1 and site.layout.bearing_deg == pytest.approx(30.0)

    def test_a_headland_is_as_many_rounds(self) -> None:
        assert {layout.rounds for layout in layouts(Scenario(tracks_only=False, headland_m=6.0), L, 6.0)} == {2}

    def test_one_round_more_is_compared_where_nothing_is_asked_for(self) -> None:
        assert {layout.rounds for layout in layouts(Scenario(tracks_only=False), RECTANGLE, 8.5)} == {3, 4}

    def test_tracks_alone_are_as_they_are_laid(self) -> None:
        (only,) = layouts(Scenario(tracks_only=True), L, 9.0)
        assert only.tracks == lay_tracks(L, 3.0, 9.0).tracks

    def test_what_is_sown_is_not_turned_on(self) -> None:
        assert all(len(one.cells) == 1 for one in layouts(Scenario(tracks_only=False, operation="sow"), L, 9.0))

    def test_both_asked_for_leave_one_layout(self) -> None:
        assert len(layouts(Scenario(tracks_only=False, headland_m=9.0, bearing_deg=0.0), L, 9.0)) == 1


def test_many_tracks_are_laid_by_estimate() -> None:
    """Nothing is searched, and no other number of rounds is tried."""
    (only,) = layouts(Scenario(tracks_only=False), Field("big", shapely.box(0, 0, 500, 900)), 9.0)
    assert only.rounds == 3 and len(only.tracks) > 125
