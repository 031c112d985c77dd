"""Cases of the fourth and the fifth reference as they are drawn, and what these references import."""

import pytest

from tests.truth import fifth, fifth_cases, fourth, fourth_cases
from tests.truth.cases import KINDS, Fault, Law, TruthCase
from tests.truth.effects import NEUTRAL


@pytest.mark.parametrize("seed", [1, 2])
def test_a_seed_of_the_fourth_has_all_kinds_and_other_draws_than_the_next(seed: int) -> None:
    cases = fourth_cases.draw_fourth_cases(seed)
    assert {case.kind for case in cases} == set(KINDS) and 38 <= len(cases) <= 60
    assert len({case.seed for case in cases}) == len(cases)
    assert cases == fourth_cases.draw_fourth_cases(seed) != fourth_cases.draw_fourth_cases(seed + 10)
    assert [case for case in cases if case.kind == "law"] == fourth_cases.draw_fourth_cases(seed, ["law"])
    assert all(case.wanted <= case.allowed for case in cases)
    assert len(fourth_cases.OUTSIDE) >= 10


def test_every_kind_of_cause_of_the_fourth_is_drawn_and_known() -> None:
    cases = [case for seed in range(40) for case in fourth_cases.draw_fourth_cases(seed)]
    assert {name for case in cases if case.kind == "effect" for name in case.effects} == set(NEUTRAL)
    assert {name for case in cases for name in case.outside} == set(fourth_cases.OUTSIDE)
    assert len({(law.effect, law.kind) for case in cases for law in case.laws}) >= 11
    for case in cases:
        fourth.build_parameters(case)


def test_unseen_runs_have_the_truth_without_what_befell_single_runs() -> None:
    law = Law("steering_gain", "by_run", {"run": 2.0, "value": 0.8, "other": 1.0})
    case = TruthCase("odd_run", 4, laws=(law,), faults=(Fault("steering_loose", 1, 5.0),))
    unseen = fourth.make_unseen_case(case, 5)
    assert unseen.faults == () and unseen.laws[0].values == {"value": 1.0} and unseen.seed == 5


def test_a_seed_of_the_fifth_has_all_kinds_and_three_have_all_causes() -> None:
    cases = [case for seed in range(6) for case in fifth_cases.draw_fifth_cases(seed)]
    assert {case.kind for case in cases} == set(KINDS) and len({case.seed for case in cases}) == len(cases)
    assert {name for case in cases[: len(cases) // 2] for name in case.outside} == set(fifth_cases.OUTSIDE)
    effects = [case for seed in range(20) for case in fifth_cases.draw_fifth_cases(seed, ["effect"])]
    assert {name for case in effects for name in case.effects} == set(NEUTRAL)
    assert cases[: len(cases) // 6] == fifth_cases.draw_fifth_cases(0)
    assert all(case.wanted <= case.allowed for case in cases)
    for case in cases:
        fifth.build_parameters(case)
    with pytest.raises(ValueError, match="unknown"):
        fifth.build_parameters(TruthCase("outside", 1, outside={"gremlins": {}}))
