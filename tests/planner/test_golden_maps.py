"""Maps of ten awkward fields, worked by two tractors, beside stored ones: a change is seen, and can be reviewed.

A stored map (tests/planner/golden) has the figures of a plan and a coarse picture of the field: R worked on a round
alone, T on a track alone, B on both, a dot where ground is missed, a space outside. To renew them all, run

    HEADLAND_GOLDEN=write python -m pytest -n 0 tests/planner/test_golden_maps.py

and look at what git shows as changed before it is committed. What must hold whatever the maps show is tested apart.
"""

import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely

from planner.evaluation.candidates.evaluate import Candidate, Outcome, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.coverage import measure_coverage
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.evaluation.ground.unworked_area import find_unworked_areas
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from tests.planner.excursions import measure_excursion_m
from tests.planner.shapes import SHAPES

GOLDEN = Path(__file__).parent / "golden"
WRITE = os.environ.get("HEADLAND_GOLDEN") == "write"
ACROSS, UP = 60, 30
NOT_OF_THE_LAYOUT = ("margin", "cut off by")
TOLD_M2 = 5.0  # smaller pieces of missed ground are not listed
OTHER_MARKS = 36  # of 1800: points at the very edge of a swath may fall either way on another machine, 17 were seen

SELDOM = ("star", "two ponds", "U", "comb", "triangle")
"""Shapes that take longest and have others of their kind among those that are left."""
SHOWN = [pytest.param(name, marks=pytest.mark.matrix if name in SELDOM else ()) for name in SHAPES]


def lay_out(name: str) -> PlanningContext:
    return prepare_context(WorkOrder(PlanRequest(field=name, no_headland=False), SHAPES[name]))


site_of = cache(lay_out)


@cache
def planned(name: str) -> tuple[PlanningContext, Outcome]:
    return site_of(name), simulate_candidate(site_of(name), Candidate("split-field", 2))


def summary(name: str) -> list[str]:
    """The lines of a stored map."""
    site, tried = planned(name)
    rings = [
        str(sum(one.number == k for one in site.headland_passes)) for k in range(1, site.layout.headland_passes + 1)
    ]
    lines = [
        f"field: {name}, {site.layout.field.area_m2:.0f} m2",
        f"cells: {len(site.layout.cells)}",
        f"tracks: {len(site.layout.swaths)}",
        f"rounds: {site.layout.headland_passes} (lines {', '.join(rings)})",
        f"feasible: {'yes' if tried.result.feasible else 'no'}",
    ]
    if not tried.result.feasible or tried.run is None:
        return lines
    missed = measure_coverage(tried.run, site).unworked_pieces
    told = [f"{piece.area:.0f}" for piece in missed if piece.area >= TOLD_M2]
    lines.append(f"worked_pct: {tried.result.worked_pct:.1f}")
    lines.append(f"missed pieces of {TOLD_M2:g} m2 and more: {', '.join(told) or 'none'}")
    return [*lines, *raster(site, tried)]


def raster(site: PlanningContext, tried: Outcome) -> Iterator[str]:
    """The field as `UP` lines of `ACROSS` marks, north up."""
    assert tried.run is not None
    swept = compute_swept_area(tried.run, site)
    on_round, on_track = (
        shapely.union_all(swept.ground[swept.on_headland_pass == flag], grid_size=1e-6) for flag in (1, 0)
    )
    boundary = site.layout.field.boundary
    west, south, east, north = boundary.bounds
    x = west + (np.arange(ACROSS) + 0.5) / ACROSS * (east - west)
    y = north - (np.arange(UP) + 0.5) / UP * (north - south)
    points = shapely.points(*np.meshgrid(x, y))
    inside, rounds, swaths = (shapely.intersects(ground, points) for ground in (boundary, on_round, on_track))
    marks = np.where(inside, np.array([".", "R", "T", "B"])[rounds + 2 * swaths], " ")
    for row in marks:
        yield "".join(row).rstrip()


def place(name: str) -> Path:
    return GOLDEN / f"{name.replace(' ', '-')}.txt"


def other_marks(one: list[str], two: list[str]) -> int:
    """Marks by which two pictures differ."""
    return sum(
        a != b
        for first, second in zip(one, two, strict=True)
        for a, b in zip(first.ljust(ACROSS), second.ljust(ACROSS), strict=True)
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", SHOWN)
def test_the_map_is_the_stored_one(name: str) -> None:
    now = summary(name)
    if WRITE:
        place(name).write_text("\n".join(now) + "\n", encoding="utf-8")
    stored = place(name).read_text(encoding="utf-8").removesuffix("\n").split("\n")
    heads = [[line for line in lines if ": " in line] for lines in (stored, now)]
    assert heads[1] == heads[0], "renew the map if that is meant: HEADLAND_GOLDEN=write"
    count = len(heads[0])
    assert other_marks(stored[count:], now[count:]) <= OTHER_MARKS, "\n".join(["now:", *now])


def test_there_is_a_map_of_every_shape_and_no_other() -> None:
    assert {path.name for path in GOLDEN.iterdir()} == {place(name).name for name in SHAPES}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHOWN)
def test_what_holds_whatever_the_map_shows(name: str) -> None:
    site, tried = planned(name)
    result = tried.result
    assert result.feasible and tried.run is not None, result.reason
    worked = measure_coverage(tried.run, site)
    # Union and difference of the same swaths: what is worked and what is missed are the field.
    assert worked.worked_m2 + worked.unworked_m2 == pytest.approx(worked.field_m2, rel=1e-3)
    assert sum(piece.area for piece in worked.unworked_pieces) <= worked.unworked_m2 * (1 + 1e-9)
    assert result.worked_pct is not None and result.worked_pct >= 95.0, "none is narrower than the implement"
    assert result.collisions == 0 and tried.run.contacts == ()
    assert measure_excursion_m(tried.run, site) < 0.5


@pytest.mark.parametrize("name", SHOWN)
def test_ground_is_covered_as_laid_or_has_a_reason(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of any layout, so that none is timed."""
    monkeypatch.setattr("planner.evaluation.preparation.choose_quickest_index", lambda *_: 0)
    site = lay_out(name)
    ground = site.layout.field.workable_region
    under = shapely.intersection(get_site_moves(site).covered_ground, ground, grid_size=1e-6).area
    # What obstacles and their margin take is no ground of the field;
    # reasons of less than a square metre are not told.
    left = sum(one.area_m2 for one in find_unworked_areas(site) if not one.reason.startswith(NOT_OF_THE_LAYOUT))
    assert under + left == pytest.approx(ground.area, abs=5.0)
