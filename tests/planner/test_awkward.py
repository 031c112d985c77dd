"""Awkward fields on which fleets of every strategy must find a plan."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from planner import farm as farm_room
from planner.evaluation.candidates.evaluate import Candidate, compute_candidate_figures, simulate_candidate
from planner.evaluation.context import PlanningContext, prepare_context
from planner.evaluation.ground.coverage import measure_excursion_m
from planner.evaluation.repair.turn_repair import replace_turns
from planner.farm.inventory import load_farm
from planner.pipeline.farm_inputs import complete_request_by_farm
from planner.request.plan_request import PlanRequest
from strategies.registry import STRATEGIES
from tests.examples import seldom
from tests.planner.shapes import SHAPES
from vehicle.missions.plan import Leg, LegGate, Mission, Plan


@cache
def site_of(name: str) -> PlanningContext:
    return prepare_context(PlanRequest(field=name, no_headland=False), SHAPES[name])


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["split-field", *seldom(*sorted(set(STRATEGIES) - {"split-field"}))])
def test_a_strip_of_few_lines_is_worked_by_two(strategy: str) -> None:
    """Evenly shared out its lines would be nearer to each other than machines are wide: nobody could pass."""
    result = compute_candidate_figures(site_of("thin strip"), Candidate(strategy, 2))
    assert result.feasible, result.reason
    assert result.worked_pct is not None and result.worked_pct > 99.0


@pytest.mark.slow
def test_turns_too_tight_to_follow_are_driven_another_way() -> None:
    """Arcs as tight as the tractor drives, to and fro: it comes out of them aside, and once outside the field."""
    farm = load_farm(str(Path(farm_room.__file__).parent / "example.toml"))
    wanted = PlanRequest(field="netherlands", tractors=(2,), strategies=("split-field",))
    found = complete_request_by_farm(wanted, farm, ("field", "tractors", "strategies"), implement_name="drill")
    site = prepare_context(found.request, tractor=found.tractor, implement=found.implement)
    evaluation = simulate_candidate(site, Candidate("split-field", 2))
    assert evaluation.result.feasible and evaluation.run is not None, evaluation.result.reason
    assert measure_excursion_m(evaluation.run, site) < 0.5


def leg(metres: float, *gates: LegGate, wait: bool = False) -> Leg:
    return Leg(np.array([[0.0, 0.0], [metres, 0.0]]), 1.0, gates=gates, may_wait=wait)


def test_gates_name_the_same_places_when_a_turn_has_other_legs() -> None:
    """Legs 1 and 2 of the first tractor become three; who waited for one of them waits for the end of the turn."""
    held = LegGate(1, 0, 4.0)
    one = Mission((leg(10.0), leg(2.0, wait=True), leg(3.0, held), leg(20.0), leg(8.0, wait=True)))
    two = Mission((leg(5.0, LegGate(0, 0, 7.0)), leg(5.0, LegGate(0, 2, 1.0)), leg(5.0, LegGate(0, 4, 6.0))))
    new = replace_turns(Plan((one, two)), {(0, 1, 3): (leg(4.0), leg(5.0), leg(6.0))})
    lengths = [each.length_m for each in new.missions[0].legs]
    assert lengths == [10.0, 4.0, 5.0, 6.0, 20.0, 8.0]
    assert [each.may_wait for each in new.missions[0].legs] == [False, True, False, False, False, True]
    assert [each.gates for each in new.missions[0].legs] == [(), (held,), (), (), (), ()]
    ((first,), (turn,), (later,)) = (each.gates for each in new.missions[1].legs)
    assert (first, later) == (LegGate(0, 0, 7.0), LegGate(0, 5, 6.0))
    assert turn.leg == 3 and turn.after_m == pytest.approx(6.0, abs=0.3)
