"""An order that cannot be driven is followed by others before a candidate is refused."""

from dataclasses import replace
from typing import Any

import pytest

from planner.evaluation.candidates import evaluate
from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.candidates.figures import CandidateRun
from planner.evaluation.candidates.variants import OTHER_ORDER_REMARK, list_other_orders
from planner.evaluation.context import PlanningContext
from strategies.path_planning.errors import StrategyError
from strategies.program.field_job import FieldJob
from strategies.registry import STRATEGIES

MET = "tractors 1 and 2 meet"
Tried = list[tuple[tuple[int, ...], int | None]]


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Let only an order with these turned tractors be driven, or refuse all; the orders that were tried in turn."""

    def only(turned: tuple[int, ...] | None, *, refused: bool = False) -> Tried:
        orders: Tried = []

        def run(site: PlanningContext, strategy: Any, job: FieldJob, incumbent: Any) -> CandidateRun:
            orders.append((job.reversed_tractors, job.jump))
            if refused:
                raise StrategyError(f"refused {len(orders)}")
            return CandidateRun(None, None if job.reversed_tractors == turned else MET, "U", None)  # type: ignore[arg-type]

        monkeypatch.setattr(evaluate, "_run_job", run)
        return orders

    return only


def test_other_orders_are_tried_until_one_can_be_driven(small_site: PlanningContext, tried: Any) -> None:
    orders = tried((1,))
    run = run_candidate(small_site, Candidate("split-field", 3))
    assert orders == [((), None), ((0, 1, 2), None), ((1,), None)]
    assert run.reason is None and run.remark == OTHER_ORDER_REMARK


def test_an_order_that_can_be_driven_is_the_only_one(small_site: PlanningContext, tried: Any) -> None:
    orders = tried(())
    run = run_candidate(small_site, Candidate("interleaved", 2))
    assert orders == [((), None)] and run.remark is None


def test_where_none_can_be_driven_the_first_says_why(small_site: PlanningContext, tried: Any) -> None:
    orders = tried(None)
    assert run_candidate(small_site, Candidate("split-field", 2)).reason == MET
    assert orders == [((), None), ((0, 1), None), ((1,), None), ((), 1)]
    refusals = tried(None, refused=True)
    with pytest.raises(StrategyError, match="refused 1"):
        run_candidate(small_site, Candidate("interleaved", 2))
    assert len(refusals) == 3


def test_formations_and_loads_keep_their_orders(small_site: PlanningContext, tried: Any) -> None:
    job = replace(small_site.build_job(2), supply=object())  # type: ignore[arg-type]
    assert list(list_other_orders(STRATEGIES["interleaved"], job)) == []
    assert [each.jump for each in list_other_orders(STRATEGIES["split-field"], job)] == [1]
