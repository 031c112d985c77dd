"""Laws of parameters in findings."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vehicle.identification.diagnosis.results import EQUIVALENT, LIKELY, NAMED, NOT_VISIBLE, Finding
from vehicle.identification.laws.bases import RunClock
from vehicle.identification.laws.settle import SettledLaw
from vehicle.identification.laws.sides import SideLaw
from vehicle.identification.laws.words import describe_law
from vehicle.identification.thresholds import WORTH_OF_WHEEL_PCT
from vehicle.identification.verdict import law_findings
from vehicle.identification.verdict.law_findings import (
    GAIN_TERMS,
    _compare_with_gain_by_speed,
    _tell_sides,
    describe_offset_at_work,
    leave_out_stand_ins,
    list_law_terms,
)
from vehicle.identification.verdict.named_causes import ExplainedCase
from vehicle.model.tractor import load_tractor


@pytest.mark.parametrize("kind", sorted(GAIN_TERMS))
def test_a_law_of_the_gain_is_saved_by_its_term(kind: str) -> None:
    law = SimpleNamespace(found=SimpleNamespace(kind=kind, effect_id="steering_gain"))
    other = SimpleNamespace(found=SimpleNamespace(kind=kind, effect_id="steering_offset"))
    assert list_law_terms(SimpleNamespace(laws=(law, other))) == {GAIN_TERMS[kind]}  # type: ignore[arg-type]
    assert not list_law_terms(SimpleNamespace(laws=(other,)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "selected", "kept"),
    [("by_speed", (), ["wheel_slip"]), ("by_speed", ("understeer",), ["understeer", "wheel_slip"]),
     ("by_angle", (), ["understeer", "wheel_slip"])],
)  # fmt: skip
def test_understeer_has_no_name_where_it_stands_in_for_a_gain_by_speed(
    kind: str, selected: tuple[str, ...], kept: list[str]
) -> None:
    law = SimpleNamespace(found=SimpleNamespace(kind=kind, effect_id="steering_gain"))
    selection: Any = SimpleNamespace(laws=(law,), selection=SimpleNamespace(effect_ids=frozenset(selected)))
    case: Any = SimpleNamespace()
    explained = leave_out_stand_ins(ExplainedCase(case, ["understeer", "wheel_slip"], None, frozenset()), selection)
    assert explained.names == kept and explained.law_terms == {GAIN_TERMS[kind]}


@pytest.mark.parametrize(
    ("worth_pct", "sure_ids", "before", "status"),
    [
        (WORTH_OF_WHEEL_PCT + 1.0, {"steering_rate"}, NOT_VISIBLE, NAMED),
        (WORTH_OF_WHEEL_PCT + 1.0, {"steering_rate"}, LIKELY, NAMED),
        (WORTH_OF_WHEEL_PCT + 1.0, (), NOT_VISIBLE, LIKELY),
        (WORTH_OF_WHEEL_PCT - 1.0, {"steering_rate"}, NOT_VISIBLE, LIKELY),
    ],
)
def test_two_sides_have_a_name_where_they_remove_as_much_of_the_wheel_angle_error_as_a_name_must(
    worth_pct: float, sure_ids: Any, before: str, status: str
) -> None:
    """One value for both sides raises errors and has no name, although each side is slow."""
    finding = Finding("steering_rate", before, None, None, None, None, 4.0, "deg/s", "command to wheel", "")
    told = _tell_sides(finding, SideLaw("steering_rate", 20.0, 9.0, 500.0, worth_pct), sure_ids)
    assert told.status == status and told.law is not None
    assert told.law.values == {"right": 20.0, "left": 9.0}


@pytest.mark.parametrize(
    ("before", "is_clear", "after"),
    [(NOT_VISIBLE, True, NAMED), (NOT_VISIBLE, False, LIKELY), (LIKELY, False, LIKELY), (NAMED, False, NAMED)],
)
def test_a_law_hardly_above_the_least_that_matters_gives_no_name(
    before: str, is_clear: bool, after: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: Any = SimpleNamespace(kind="by_implement", effect_id="steering_gain", alternatives=(), is_clear=is_clear)
    law = SettledLaw(found, 1.0, np.array([-0.1]), np.array([0.05]), 1.0, 0.02, 0.9, 1.0)
    for name in ("compute_law_values", "describe_law", "describe_alternatives"):
        monkeypatch.setattr(law_findings, name, lambda *_, name=name: {} if name == "compute_law_values" else "")
    finding = Finding("steering_gain", before, None, None, None, None, None, "", "", "")
    (told,) = law_findings._add_settled_law([finding], law, None, (), load_tractor("eg105"))  # type: ignore[arg-type]
    assert told.status == after


@pytest.mark.parametrize(
    ("effect_id", "kind", "status"),
    [
        ("clock_offset_speed", "over_minutes", EQUIVALENT),
        ("clock_offset_speed", "by_run", NAMED),
        ("position_delay", "over_minutes", EQUIVALENT),
        ("position_delay", "by_run", NAMED),
    ],
)
def test_which_of_two_clocks_runs_away_does_not_show(
    effect_id: str, kind: str, status: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: Any = SimpleNamespace(kind=kind, effect_id=effect_id, alternatives=(), is_clear=True)
    law = SettledLaw(found, 0.4, np.array([-0.3]), np.array([0.1]), 0.25, 0.1, 0.1, 0.4)
    for name in ("compute_law_values", "describe_law", "describe_alternatives"):
        monkeypatch.setattr(law_findings, name, lambda *_, name=name: {} if name == "compute_law_values" else "")
    statuses = {effect_id: NAMED, "clock_offset_position": NOT_VISIBLE}
    before = [Finding(name, one, None, None, None, None, None, "s", "", "") for name, one in statuses.items()]
    speed, position = law_findings._add_settled_law(before, law, None, (), load_tractor("eg105"))  # type: ignore[arg-type]
    assert speed.status == status
    assert position.status == (EQUIVALENT if status == EQUIVALENT else NOT_VISIBLE)


def test_a_side_draft_tells_the_wheel_angle_that_looks_like_it() -> None:
    """1 / 143 m is what a wheelbase of 2.5 m turns at 1 degree: tan(1 deg) / 2.5 m = 0.00698 / m."""
    value, interval = {"curvature_per_m": -0.00698}, {"curvature_per_m": (-0.008, -0.006)}
    draft = Finding("implement_side_draft", NAMED, value, interval, None, None, 0.001, "1/m", "implement working", "")
    silent = replace(draft, status=NOT_VISIBLE, value=None, interval=None)
    told, untouched = describe_offset_at_work([draft, silent], 2.5)
    assert told.exchange == (
        "a steering_offset of 1.0 deg to the left that acts only while the implement works would look nearly the same"
    )
    assert untouched is silent


@pytest.mark.parametrize(("status", "is_told"), [(NAMED, True), (LIKELY, True), (NOT_VISIBLE, False)])
def test_an_understeer_tells_the_gain_by_speed_that_looks_like_it(status: str, is_told: bool) -> None:
    value, interval = {"deg_per_mps2": 2.0}, {"deg_per_mps2": (1.5, 2.5)}
    finding = Finding("understeer", status, value, interval, None, None, 0.1, "", "lateral acceleration", "")
    told = _compare_with_gain_by_speed(finding)
    assert told.status == status
    assert ("a steering_gain that changes with the speed would look the same" in told.exchange) == is_told


@pytest.mark.parametrize(("runs", "status"), [(6, EQUIVALENT), (8, NAMED)])
def test_a_swing_of_few_runs_may_be_values_by_run(runs: int, status: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found: Any = SimpleNamespace(kind="over_day", effect_id="steering_offset", alternatives=(), is_clear=True)
    law = SettledLaw(found, 0.0, np.array([1.0, 0.5]), np.array([0.1, 0.1]), 0.2, 0.1, -1.0, 1.4)
    for name in ("compute_law_values", "describe_law"):
        monkeypatch.setattr(law_findings, name, lambda *_, name=name: {} if name == "compute_law_values" else "")
    finding = Finding("steering_offset", NOT_VISIBLE, None, None, None, None, None, "deg", "", "")
    names = tuple(f"run{number}" for number in range(runs))
    (told,) = law_findings._add_settled_law([finding], law, None, names, load_tractor("eg105"))  # type: ignore[arg-type]
    assert told.status == status
    assert told.equivalent_to == (("steering_offset:by_run",) if status == EQUIVALENT else ())


@pytest.mark.parametrize(
    ("lowest_s", "words"), [(1200.0, "; it is lowest at 1200 s of the logs' clock."), (7885.0, ".")]
)
def test_a_swing_is_lowest_at_a_time_that_its_logs_reach(lowest_s: float, words: str) -> None:
    found: Any = SimpleNamespace(kind="over_day", effect_id="steering_gain")
    law = SettledLaw(found, 1.0, np.array([0.1, 0.0]), np.array([0.0, 0.0]), 1.0, 0.0, 0.94, 1.13)
    clock = RunClock(np.array([0.0, 900.0, 2400.0]), 300.0, has_order=True)
    told = describe_law(law, {"lowest_s": lowest_s}, ("a", "b", "c"), clock)
    assert told == f"The steering gain swings between 0.94 and 1.13 over the day{words}"
