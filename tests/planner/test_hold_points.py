"""Tasks and hold points of real plans agree with what the implement alone shows."""

from typing import Any

import pytest

from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.candidates.line_programme import sketch_plans
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from planner.traffic.giving_way import _build_passage_gate, _build_turn_end_gate
from strategies.registry import STRATEGIES
from tests.planner.shapes import SHAPES
from vehicle.missions.plan import Mission, Plan


class Guess:
    """Where a tractor holds, guessed from nothing but where the implement is down."""

    def __init__(self, mission: Mission) -> None:
        self.down = [leg.implement for leg in mission.legs]
        self.lengths = [leg.length_m for leg in mission.legs]
        self.last = len(self.down) - 1

    def hold(self, leg: int) -> int:
        """The last segment of the pass, or the first leg of all."""
        while leg > 0:
            ends = self.down[leg] and (leg == self.last or not self.down[leg + 1])
            if ends and self.down[leg - 1]:
                return leg
            leg -= 1
        return 0

    def turned(self, leg: int) -> int:
        """The last leg before the next track."""
        while leg < self.last and self.down[leg]:
            leg += 1
        while leg < self.last and not self.down[leg + 1]:
            leg += 1
        return leg

    def past(self, leg: int, metres: float) -> tuple[int, float]:
        """Leg and distance so far on, but not beyond the turn."""
        turning = not self.down[leg]
        while leg < self.last and metres > self.lengths[leg] and not (turning and self.down[leg + 1]):
            metres -= self.lengths[leg]
            leg += 1
            turning = turning or not self.down[leg]
        return leg, round(max(0.0, min(metres, self.lengths[leg] - 0.2)), 6)


@pytest.fixture(scope="module")
def plans(wide_site: Any) -> list[Plan]:
    """Plans of every strategy, and some on a field with a notch."""
    notched = prepare_context(WorkOrder(PlanRequest(field="U", no_headland=True), SHAPES["U"]))
    return [
        *(sketch_plans(wide_site, one, count)[0].compose().plan for one in STRATEGIES.values() for count in (1, 4)),
        *(sketch_plans(notched, STRATEGIES[name], 3)[0].compose().plan for name in ("split-field", "interleaved")),
    ]


def test_tractors_may_wait_where_the_implement_shows_it(plans: list[Plan]) -> None:
    for plan in plans:
        for mission in plan.missions:
            for leg in range(len(mission.legs)):
                last = next((index for index in range(leg, 0, -1) if mission.legs[index].may_wait), 0)
                assert last == Guess(mission).hold(leg)


@pytest.mark.parametrize("metres", [0.0, 3.0, 10.0, 60.0, 1000.0])
def test_gates_past_a_place_and_past_a_turn(plans: list[Plan], metres: float) -> None:
    for plan in plans:
        for tractor, mission in enumerate(plan.missions):
            guess = Guess(mission)
            for leg in range(len(mission.legs)):
                past, turned = (
                    _build_passage_gate(plan, tractor, leg, metres, 0.0),
                    _build_turn_end_gate(plan, tractor, leg),
                )
                assert (past.leg, past.after_m) == guess.past(leg, metres)
                assert turned.leg == guess.turned(leg)


def test_tractors_give_way_at_hold_points_only(wide_site: Any) -> None:
    for name, tractors in (("interleaved", 5), ("split-field", 4)):
        written = sketch_plans(wide_site, STRATEGIES[name], tractors)[0].compose().plan
        driven = run_candidate(wide_site, Candidate(name, tractors)).run.plan
        for before, after in zip(written.missions, driven.missions, strict=True):
            for a, b in zip(before.legs, after.legs, strict=True):
                assert len(b.gates) == len(a.gates) or b.may_wait
