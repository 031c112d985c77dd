"""The study of chapter 6: every printed row, every claim with a verdict; and `headland study` from the outside."""

import json

import pytest

from planner.pipeline.thesis_study import list_thesis_times, study
from reports.trials.report import FleetStudy, ThesisTableRow, format_study_json
from tests.cli.conftest import Run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def result() -> FleetStudy:
    return study()


def row(result: FleetStudy, table: str, label: str) -> ThesisTableRow:
    return next(row for row in result.tables[table] if row.label == label)


@pytest.mark.matrix
def test_every_printed_time_has_its_row(result: FleetStudy) -> None:
    assert {name: [r.tractors for r in rows] for name, rows in result.tables.items()} == {
        "6.1": [1, 3, 5, 7, 9, 11],
        "6.2": [3, 3],
        "6.3": [5, 5, 5],
    }
    # 1:14:35, 25:30, 20:53, 17:25, 12:30, 13:10; then 20:53 and 21:30; then 20:53, 17:18 and 21:30.
    assert [r.thesis_s for r in result.tables["6.1"]] == [4475, 1530, 1253, 1045, 750, 790]
    assert [r.thesis_s for r in result.tables["6.2"]] == [1253, 1290]
    assert [r.thesis_s for r in result.tables["6.3"]] == [1253, 1038, 1290]
    assert len(list_thesis_times()) == 11


def test_every_row_was_driven_and_its_difference_is_right(result: FleetStudy) -> None:
    for r in (r for rows in result.tables.values() for r in rows):
        assert r.time_s is not None, r.note
        assert r.difference_pct == pytest.approx(100 * (r.time_s - r.thesis_s) / r.thesis_s)


def test_more_tractors_are_faster_up_to_nine_and_eleven_slower(result: FleetStudy) -> None:
    time = {r.tractors: r.time_s or 0.0 for r in result.tables["6.1"]}
    assert time[1] > time[3] > time[5] > time[7] > time[9]
    assert time[11] > time[9]


def test_one_tractor_is_cheapest(result: FleetStudy) -> None:
    hours = {r.tractors: r.tractors * (r.time_s or 0.0) for r in result.tables["6.1"]}
    assert min(hours, key=lambda count: hours[count]) == 1


def test_same_plan_same_time_in_different_tables(result: FleetStudy) -> None:
    assert row(result, "6.2", "in formation").time_s == row(result, "6.1", "3 tractors").time_s
    assert row(result, "6.3", "row by row").time_s == row(result, "6.1", "5 tractors").time_s


def test_every_claim_has_a_verdict_that_agrees_with_the_rows(result: FleetStudy) -> None:
    assert len(result.claims) >= 6
    for claim in result.claims:
        assert isinstance(claim.holds, bool) and claim.claim and any(c.isdigit() for c in claim.why)
    verdict = {claim.claim: claim.holds for claim in result.claims}
    together, apart = (r.time_s or 0.0 for r in result.tables["6.2"])
    plain, timed = (row(result, "6.3", label).time_s for label in ("row by row", "row by row, waiting optimised"))
    assert verdict["3 tractors in formation are faster than 3 working separately"] == (together < apart)
    assert verdict["11 tractors are slower than 9"]
    assert verdict["optimised waiting is at least 10 % faster than row by row"] == (timed <= 0.9 * plain)


def test_the_row_the_thesis_contradicts_says_so(result: FleetStudy) -> None:
    assert "Table 6.1" in row(result, "6.2", "in formation").note


def test_the_assumptions_are_sentences(result: FleetStudy) -> None:
    assert len(result.assumptions) >= 5
    assert all(sentence.endswith(".") for sentence in result.assumptions)
    assert any("24 tracks" in sentence for sentence in result.assumptions)


def test_json_keeps_its_contract(headland: Run, result: FleetStudy, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the same study: that processes change no plan is tested with the executors."""
    monkeypatch.setattr("planner.pipeline.thesis_study.study", lambda **_: result)
    outcome = headland("study", "--json")
    assert outcome.status == 0 and outcome.err == ""
    assert outcome.out == format_study_json(result)
    answer = json.loads(outcome.out)
    assert list(answer) == ["tables", "claims", "assumptions"]
    assert {name: len(rows) for name, rows in answer["tables"].items()} == {"6.1": 6, "6.2": 2, "6.3": 3}
    for rows in answer["tables"].values():
        for row in rows:
            assert {"tractors", "thesis_s", "time_s", "difference_pct"} <= set(row)
            assert row["time_s"] > 0 and abs(row["difference_pct"]) < 100
    for claim in answer["claims"]:
        assert set(claim) == {"claim", "holds", "why"}
        assert type(claim["holds"]) is bool and claim["why"]
