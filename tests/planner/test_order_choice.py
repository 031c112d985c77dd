"""Headland first or last: which of two sketched plans is driven, and which of two driven ones is taken."""

from types import SimpleNamespace
from typing import Any

import pytest

from planner.evaluation.candidates import evaluate, line_programme
from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.candidates.figures import CandidateRun
from planner.evaluation.candidates.line_programme import SketchedPlan, sketch_plans
from strategies.registry import STRATEGIES
from vehicle.missions.plan import Plan

CONTEXT: Any = SimpleNamespace(
    request=SimpleNamespace(headland_orders=("first", "last")), time_share=SimpleNamespace(check=lambda: None)
)


class FakeDriver:
    """Drives as long as was composed, and what is composed as long as it waits."""

    def __init__(self, *_: object) -> None:
        self.driven: list[str] = []

    def measure_alone_s(self, plan: Any) -> list[float]:
        return [plan.alone_s]

    def drive(self, composed: Any) -> Any:
        self.driven.append(composed.order)
        run: Any = SimpleNamespace(duration_s=composed.driven_s, plan=Plan(()))
        return CandidateRun(run, None, composed.order)


def sketch(order: str, sketched_s: float, driven_s: float, apart: list[SketchedPlan] | None = None) -> SketchedPlan:
    composed: Any = SimpleNamespace(
        order=order, plan=SimpleNamespace(alone_s=sketched_s), driven_s=driven_s, least_s=[sketched_s],
        left_factor=1.0, compose_anew=None,
    )  # fmt: skip
    return SketchedPlan(order, [sketched_s], lambda: composed, None if apart is None else lambda: apart)


@pytest.mark.parametrize(
    ("first_s", "last_s", "order"),
    [(1000.0, 1001.0, "last"), (1000.0, 1019.9, "last"), (1000.0, 1020.1, "first"), (1000.0, 999.0, "last")],
)
def test_the_headland_comes_first_only_where_that_gains_more_than_the_error_of_the_model(
    monkeypatch: pytest.MonkeyPatch, first_s: float, last_s: float, order: str
) -> None:
    seconds, driver = {"first": first_s, "last": last_s}, FakeDriver()
    monkeypatch.setattr(
        line_programme, "_choose_sketcher", lambda *_: lambda order: sketch(order, seconds[order], seconds[order])
    )
    sketches = sketch_plans(CONTEXT, STRATEGIES["split-field"], 2)
    assert [one.order for one in sketches] == [order, *({"first", "last"} - {order})]
    monkeypatch.setattr(evaluate, "FleetDriver", lambda *_: driver)
    monkeypatch.setattr(evaluate, "drive_composed", lambda _, driver, composed: driver.drive(composed))
    monkeypatch.setattr(evaluate, "_check_run", lambda _, driven: driven)
    plain = [sketch(name, seconds[name], seconds[name]) for name in ("first", "last")]
    assert run_candidate(CONTEXT, Candidate("split-field", 2), plain).turns == order
    waiting = [sketch("last", 1000.0, 1030.0), sketch("first", 1000.0, 1000.0)]
    assert run_candidate(CONTEXT, Candidate("split-field", 2), waiting).turns == "first"
    short = [sketch("last", 1000.0, 1019.0), sketch("first", 1000.0, 1000.0)]
    driver.driven.clear()
    assert run_candidate(CONTEXT, Candidate("split-field", 2), short).turns == "last"
    assert driver.driven == ["last"], "the other promises no more than the error"


def test_where_tractors_wait_each_way_to_keep_them_apart_is_weighed_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    driver = FakeDriver()
    monkeypatch.setattr(evaluate, "FleetDriver", lambda *_: driver)
    monkeypatch.setattr(evaluate, "drive_composed", lambda _, driver, composed: driver.drive(composed))
    monkeypatch.setattr(evaluate, "_check_run", lambda _, driven: driven)
    ways = [sketch("as before", 2500.0, 2500.0), sketch("blocks", 1100.0, 1100.0), sketch("stretches", 1200.0, 1200.0)]
    for driven_s, order, driven in ((2000.0, "blocks", ["free", "blocks"]), (1005.0, "free", ["free"])):
        driver.driven.clear()
        free = sketch("free", 1000.0, driven_s, ways)
        assert run_candidate(CONTEXT, Candidate("split-field", 2), [free]).turns == order
        assert driver.driven == driven
