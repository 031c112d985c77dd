"""What is asked of a diagnosis, on a share of the sets of every reference: `pytest -m matrix -s` prints the table.

All sets of many seeds are `python -m tests.benchmarks.diagnosis --all`.
"""

from fractions import Fraction

import pytest

from tests.diagnosis import tally
from tests.diagnosis.log_sets import LogSet, list_sets
from tests.diagnosis.records import build_record
from tests.diagnosis.tally import Measure, format_tables, tally_records
from tests.examples import draw_seed
from tests.truth.cases import Law
from tests.truth.drawing import build_case
from vehicle.identification.diagnosis.results import NAMED

SHARE = Fraction(1, 3)
LEAST: dict[str, dict[Measure, float]] = {
    "first": {tally.CLEAR: 0.80, tally.INSIDE: 0.90, tally.REST: 0.80, tally.HINT: 0.75, tally.CLEAN: 1.0},
    "demo": {tally.CLEAR: 0.95, tally.CLEAN: 1.0},
    "second": {tally.CLEAR: 0.80, tally.INSIDE: 0.90},
    "varied": {},
}
NEVER = (tally.ERRORS, tally.FALSE, tally.REFUTED_TRUE, tally.FLIPS)


@pytest.mark.matrix
@pytest.mark.parametrize("reference", LEAST)
def test_what_is_asked_holds(reference: str) -> None:
    counted = tally_records(build_record(one) for one in list_sets(reference, draw_seed(), SHARE))
    print("\n".join([*format_tables(counted), *counted.complaints]))
    assert not [what.words for what in NEVER if counted.get(what).right]
    missed = [
        what.words
        for what, least in LEAST[reference].items()
        if counted.get(what).of and counted.get(what).share < least
    ]
    assert not missed


@pytest.mark.matrix
@pytest.mark.parametrize(
    "law",
    [
        # The rate is not in the fit of the residuals: the wheel angle alone shows it.
        Law("steering_rate", "by_side", {"left": 16.0, "right": 8.0}),
        # Runs of one bend each are unlike the others, as the gain was another one when they were driven.
        Law("steering_gain", "over_day", {"mean": 1.0, "amplitude": 0.14, "period_s": 1400.0, "phase_deg": 22.4}),
    ],
)
def test_the_law_of_a_parameter_is_told_with_its_kind(law: Law) -> None:
    case = build_case("law", 3251, laws=(law,), programme="three_speeds")
    said = next(one for one in build_record(LogSet("third", case))["said"] if one["id"] == law.effect)
    assert (said["status"], said["law"]["kind"]) == (NAMED, law.kind)
    if law.kind == "by_side":
        assert said["law"]["values"] == pytest.approx(law.values, rel=0.1)
