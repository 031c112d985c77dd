"""Formations driven on fields with notches and holes, and what a plan tells of them."""

import json
from typing import Any

import pytest
from shapely import Polygon, affinity, box

from fields import Field
from planner.evaluation.candidates.evaluate import Candidate, Outcome, simulate_candidate
from planner.evaluation.candidates.line_programme import sketch_plans
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.ranking import rank_plans
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import PlanResult
from reports.plan.figures import format_ranking_json
from strategies.path_planning.errors import SOLITARY_STRATEGIES
from strategies.registry import STRATEGIES
from vehicle.missions.run import DONE, SimulationRun

pytestmark = pytest.mark.slow

FORMATIONS = ("row-by-row", "row-by-row-optimised", "col-by-col")
SHAPES = {
    "L": Polygon([(0, 0), (110, 0), (110, 70), (45, 70), (45, 150), (0, 150)]),
    "comb": Polygon(
        [
            (0, 0),
            (120, 0),
            (120, 130),
            (85, 130),
            (85, 60),
            (70, 60),
            (70, 130),
            (36, 130),
            (36, 60),
            (24, 60),
            (24, 120),
            (0, 120),
        ]
    ),
    "hole": box(0, 0, 90, 160).difference(box(36, 60, 54, 90)),
    "slanted": Polygon([(0, 0), (160, 60), (160, 170), (20, 110)]),
}


def site_of(name: str, shape: Polygon, bearing_deg: float | None = 0.0) -> PlanningContext:
    return prepare_context(
        WorkOrder(PlanRequest(field=name, bearing_deg=bearing_deg, no_headland=True), Field(name, shape))
    )


@pytest.fixture(scope="module")
def sites() -> dict[str, PlanningContext]:
    return {name: site_of(name, shape) for name, shape in SHAPES.items()}


def drive(site: PlanningContext, strategy: str, tractors: int) -> tuple[PlanResult, SimulationRun]:
    """The figures and the run of a candidate that can be driven."""
    found: Outcome = simulate_candidate(site, Candidate(strategy, tractors))
    assert found.run is not None, found.result.reason
    return found.result, found.run


@pytest.mark.parametrize(("shape", "strategy", "tractors"), [
    pytest.param(shape, strategy, tractors, marks=() if (place + turn + tractors) % 2 == 0 else pytest.mark.matrix)
    for place, shape in enumerate(SHAPES) for turn, strategy in enumerate(FORMATIONS) for tractors in (2, 3)
])  # fmt: skip
def test_every_formation_can_be_driven(sites: Any, shape: str, strategy: str, tractors: int) -> None:
    result, run = drive(sites[shape], strategy, tractors)
    assert result.reason is None and run.outcome == DONE and not run.contacts
    share = run.plan.notes.formation_pct
    assert 50.0 < share <= 100.0
    assert ("in formation" in (result.remark or "")) == (share < 100.0)


@pytest.mark.parametrize(("shape", "tractors"), [("L", 2), ("comb", 3)])
def test_a_mirrored_field_takes_as_long(sites: Any, shape: str, tractors: int) -> None:
    """About: orders are searched, and a search that sees the field the other way round may end in another one."""
    mirrored = site_of(shape, affinity.scale(SHAPES[shape], -1, 1, origin=(0, 0)))
    times = [drive(site, "col-by-col", tractors)[1].duration_s for site in (sites[shape], mirrored)]
    assert times[1] == pytest.approx(times[0], rel=0.12)


def test_optimised_releases_are_never_slower(sites: Any) -> None:
    for name in ("L", "slanted"):
        plain, timed = (drive(sites[name], each, 3)[1] for each in FORMATIONS[:2])
        assert timed.duration_s <= plain.duration_s


def test_what_formations_share_does_not_depend_on_who_asks_first() -> None:
    found = []
    for names in (FORMATIONS, FORMATIONS[::-1]):
        site = site_of("comb", SHAPES["comb"])
        found.append({name: sketch_plans(site, STRATEGIES[name], 2)[0].compose().programme.tours for name in names})
    assert found[0] == found[1]
    assert found[0]["col-by-col"] == found[0]["row-by-row-optimised"]


def test_the_share_is_a_figure_of_formations_only(sites: Any) -> None:
    site = sites["hole"]
    results = [simulate_candidate(site, Candidate(name, 2)).result for name in ("col-by-col", "interleaved")]
    plans = {plan["strategy"]: plan for plan in json.loads(format_ranking_json(rank_plans(site, results)))["plans"]}
    assert plans["col-by-col"]["formation_pct"] == results[0].measured["formation_pct"] is not None
    assert plans["interleaved"]["formation_pct"] is None


def test_where_no_round_fits_the_refusal_says_what_would_help() -> None:
    # Four teeth of two tracks on a spine too shallow for tracks of its own: nowhere lie three side by side.
    teeth = [box(20 * k, 0, 20 * k + 6, 100) for k in range(4)]
    comb = Polygon(box(0, -8, 66, 0).union(teeth[0]).union(teeth[1]).union(teeth[2]).union(teeth[3]).exterior)
    found = simulate_candidate(site_of("teeth", comb), Candidate("row-by-row", 3))
    assert found.run is None
    assert found.result.reason.startswith("A formation of 3 tractors needs 3 tracks of at least")
    assert found.result.reason.endswith("use fewer tractors, or split-field or interleaved.")


def test_advice_names_the_strategies_without_a_formation() -> None:
    solitary = [name for name, strategy in STRATEGIES.items() if strategy.formation is None]
    assert " or ".join(solitary) == SOLITARY_STRATEGIES
