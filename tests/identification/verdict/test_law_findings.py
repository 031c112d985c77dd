"""Laws of parameters in findings."""

from types import SimpleNamespace
from typing import Any

import pytest

from vehicle.identification.verdict.law_findings import GAIN_TERMS, leave_out_stand_ins, list_law_terms
from vehicle.identification.verdict.named_causes import ExplainedCase


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
