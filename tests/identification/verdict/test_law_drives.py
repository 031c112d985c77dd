"""The drive that tells laws apart, and the one that shows a side that was not driven to."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from tests.identification.residual_models import build_programme_model
from vehicle.identification.cause_selection.selection import CauseSelection
from vehicle.identification.diagnosis.results import LIKELY, NAMED, NOT_VISIBLE, Finding
from vehicle.identification.fit.residual_fit import make_empty_fit
from vehicle.identification.verdict.law_drives import choose_law_drive, choose_side_drive
from vehicle.identification.verdict.law_findings import mark_one_sided


def build_finding(status: str, name: str = "steering_gain") -> Finding:
    return Finding(name, status, {"ratio": 1.1}, {"ratio": (1.08, 1.12)}, 1.0, None, 0.02, "", "path", "words")


@pytest.fixture(scope="module")
def right_hand() -> CauseSelection:
    """A circle to the right at two speeds."""
    model = build_programme_model("two-speeds", {})
    return CauseSelection(model, make_empty_fit(model), (), 12.0)


def test_without_laws_there_is_no_drive() -> None:
    assert choose_law_drive(SimpleNamespace(laws=())) is None  # type: ignore[arg-type]


@pytest.mark.parametrize("status", [NAMED, LIKELY])
def test_a_gain_of_one_side_is_told_with_the_drive_to_the_other(right_hand: CauseSelection, status: str) -> None:
    finding = build_finding(status)
    (told,) = mark_one_sided([finding], right_hand.residual_model.dataset)
    assert "to the right, so it is not known to the left" in told.exchange and "0.909" in told.exchange
    assert replace(told, exchange="") == finding
    drive = choose_side_drive(right_hand, [told])
    assert drive is not None and drive.decides and drive.separates == ("steering_gain", "steering_asymmetry")
    assert "both sides" in drive.description or "to the left" in drive.description


def test_other_findings_need_no_side(right_hand: CauseSelection) -> None:
    others = [build_finding(NOT_VISIBLE), build_finding(NAMED, "understeer")]
    assert mark_one_sided(others, right_hand.residual_model.dataset) == others
    assert choose_side_drive(right_hand, others) is None
    both = build_programme_model("circles", {})
    assert mark_one_sided([build_finding(NAMED)], both.dataset) == [build_finding(NAMED)]


def test_bends_to_one_side_leave_the_antenna_as_uncertain_as_a_leaning_body(right_hand: CauseSelection) -> None:
    finding = build_finding(NAMED, "antenna_right")
    finding = replace(finding, value={"distance_m": 0.2}, interval={"distance_m": (0.18, 0.22)})
    (told,) = mark_one_sided([finding], right_hand.residual_model.dataset)
    assert told.interval == {"distance_m": pytest.approx((0.165, 0.235))}
    both = build_programme_model("circles", {})
    assert mark_one_sided([finding], both.dataset) == [finding]
