"""Laws of parameters hidden in truth that others made are told with their kind."""

import pytest

from tests.diagnosis.foreign_sets import build_record, draw_cases, name_case
from vehicle.identification.diagnosis.results import NAMED


@pytest.mark.matrix
@pytest.mark.parametrize(
    ("reference", "seed", "law", "programme"),
    [
        # The rate is not in the fit of the residuals: the wheel angle alone shows it.
        ("fourth", 101003, "steering_rate:by_side", "drawn"),
        # Two runs of one bend each are unlike the others, as the gain was another one when they were driven.
        ("fourth", 101000, "steering_gain:over_day", "drawn"),
    ],
)
def test_the_law_of_a_parameter_is_told_with_its_kind(reference: str, seed: int, law: str, programme: str) -> None:
    case = next(
        case for case in draw_cases(reference, seed, ["law"]) if f" {law} {programme} " in name_case(reference, case)
    )
    said = {one["id"]: one for one in build_record(reference, case)["said"]}
    effect, kind = law.split(":")
    assert (said[effect]["status"], said[effect]["law"]["kind"]) == (NAMED, kind)
    if kind == "by_side":
        assert said[effect]["law"]["values"] == pytest.approx(case.laws[0].values, rel=0.1)
