"""Laws of parameters hidden in truth that others made are told with their kind."""

import pytest

from tests.diagnosis.log_sets import list_sets
from tests.diagnosis.records import build_record
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
    one = next(one for one in list_sets(reference, seed) if f" law {law} {programme} " in one.key)
    said = {finding["id"]: finding for finding in build_record(one)["said"]}
    effect, kind = law.split(":")
    assert (said[effect]["status"], said[effect]["law"]["kind"]) == (NAMED, kind)
    if kind == "by_side":
        assert said[effect]["law"]["values"] == pytest.approx(one.case.laws[0].values, rel=0.1)
