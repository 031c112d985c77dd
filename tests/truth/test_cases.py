"""Cases as references draw them: by the seed, of all kinds and causes, and laws as their table says."""

from collections.abc import Callable

import pytest

from tests.truth import fifth, fourth, sixth, sixth_body, third_outside
from tests.truth.cases import KINDS, Fault, Law, TruthCase
from tests.truth.effects import NEUTRAL
from tests.truth.laws import encode_law, evaluate_law
from tests.truth.menus import MENUS, draw_reference
from tests.truth.third import Third, make_third_logs

TAKE: dict[str, Callable[[TruthCase], object]] = {
    "third": Third, "fourth": fourth.build_parameters, "fifth": fifth.build_parameters, "sixth": sixth.build_parameters,
}  # fmt: skip
OUTSIDE = {"third": {*third_outside.OUTSIDE_CAUSES}, "fifth": {*fifth.OUTSIDE_BODY, *fifth.OUTSIDE_SENSORS},
           "fourth": {*fourth.OUTSIDE_PARAMETERS, *fourth.OUTSIDE_INSTRUMENTS, "articulated"},
           "sixth": {name for name, _ in sixth_body.OUTSIDE_KEYS}}  # fmt: skip


@pytest.mark.parametrize("name", MENUS)
def test_a_seed_has_all_kinds_and_some_seeds_all_effects_and_causes(name: str) -> None:
    cases, counts = draw_reference(name, 2), MENUS[name].counts
    assert {case.kind for case in cases} == ({*KINDS} if name != "sixth" else {*counts} - {"faint"})
    assert len({case.seed for case in cases}) == len(cases) == sum(counts.values())
    assert cases == draw_reference(name, 2) != draw_reference(name, 12)
    assert [case for case in cases if case.kind == "law"] == draw_reference(name, 2, ["law"])
    many = [case for seed in range(40) for case in draw_reference(name, seed)]
    assert all(case.wanted <= case.allowed for case in many)
    assert {effect for case in many if case.kind == "effect" for effect in case.effects} == set(NEUTRAL)
    assert {cause for case in many for cause in case.outside} == OUTSIDE[name]
    for case in many:
        TAKE[name](case)
    with pytest.raises(ValueError, match="gremlins"):
        TAKE[name](TruthCase("outside", 1, outside={"gremlins": {}}))


def test_a_kind_that_is_unknown_is_refused() -> None:
    with pytest.raises(ValueError, match="kind 'moon'"):
        draw_reference("third", 1, ("moon",))


def test_a_programme_that_is_unknown_is_refused() -> None:
    for make in (make_third_logs, fourth.make_fourth_logs, fifth.make_fifth_logs, sixth.make_sixth_logs):
        with pytest.raises(ValueError, match="programme 'moon'"):
            make(TruthCase("clean", 1, programme="moon"))


def test_unseen_runs_have_the_truth_without_what_befell_single_runs() -> None:
    law = Law("steering_gain", "by_run", {"run": 2.0, "value": 0.8, "other": 1.0})
    case = TruthCase("odd_run", 4, laws=(law,), faults=(Fault("steering_loose", 1, 5.0),))
    unseen = fourth.make_unseen_case(case, 5)
    assert unseen.faults == () and unseen.laws[0].values == {"value": 1.0} and unseen.seed == 5


@pytest.mark.parametrize(
    ("kind", "values", "here", "expected"),
    [
        ("over_minutes", {"start": 1.0, "per_minute": 0.2}, {"time": 90.0}, 1.3),
        ("over_day", {"mean": 1.0, "amplitude": 0.1, "period_s": 400.0, "phase_deg": 0.0}, {"day": 100.0}, 1.1),
        ("by_place", {"at_origin": 1.0, "per_m_east": 0.01, "per_m_north": -0.02}, {"east": 5.0, "north": 3.0}, 0.99),
        ("by_place", {"inside": 0.7, "outside": 1.0, "east_m": 5.0, "north_m": 0.0, "radius_m": 4.0}, {"east": 6.0},
         0.7),
        ("by_implement", {"lifted": 1.0, "working": 2.0}, {"down": 1.0}, 2.0),
        ("by_side", {"left": 9.0, "right": 20.0}, {"side": -1.0}, 9.0),
        ("by_angle", {"at_0": 0.9, "at_27": 1.17}, {"angle": -18.0}, 1.08),
        ("by_speed", {"at_0": 1.0, "per_mps": 0.1}, {"speed": -2.0}, 1.2),
        ("by_run", {"run": 0.0, "value": 0.85, "other": 1.0}, {}, 0.85),
    ],
)  # fmt: skip
def test_laws_are_what_their_table_says(
    kind: str, values: dict[str, float], here: dict[str, float], expected: float
) -> None:
    law = encode_law(Law("steering_gain", kind, values), 0, 0)
    names = ("time", "day", "east", "north", "down", "side", "angle", "speed")
    assert evaluate_law(law, *(here.get(name, 0.0) for name in names)) == pytest.approx(expected)
