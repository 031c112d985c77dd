"""The table of errors on unseen runs: a model offered that raises an error is told, and ends with another status."""

from pathlib import Path

import pytest

from tests.benchmarks import unseen
from tests.benchmarks.unseen import LogSet, UnseenRow, format_row, list_third_sets, main
from vehicle.identification.diagnosis.results import HoldoutResult
from vehicle.identification.replay.horizon_errors import HorizonError


def make_row(after_cm: float, is_offered: bool = True) -> UnseenRow:
    """A set whose error over 5 s was 5 cm, and 4 cm of it along the path."""
    before, after = ({5.0: HorizonError(cross, 4.0, 0.5)} for cross in (3.0, after_cm))
    return UnseenRow(
        "set", ("understeer",), is_offered, True, HoldoutResult(("run",), before, after, after_cm < 3.0), 1.0
    )


def test_a_model_that_is_offered_and_worse_is_told() -> None:
    assert not make_row(1.0).is_worse and not make_row(3.0).is_worse
    assert make_row(9.0).is_worse and not make_row(9.0, is_offered=False).is_worse


def test_rows_have_distances_where_there_are_pieces() -> None:
    assert format_row(make_row(0.0)) == "| set | understeer | - | 5.0 -> 4.0 | - | yes |"
    assert format_row(make_row(3.0)).endswith("| unchanged |")
    assert format_row(make_row(9.0)).endswith("| yes, WORSE |")
    assert format_row(make_row(9.0, is_offered=False)).endswith("| no |")


@pytest.mark.parametrize(("after_cm", "status"), [(1.0, 0), (9.0, 1)])
def test_the_status_says_whether_something_offered_is_worse(
    after_cm: float, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(unseen, "list_third_sets", lambda seed: iter([None]))
    monkeypatch.setattr(unseen, "measure_set", lambda one: make_row(after_cm))
    assert main(["--parts", "third"]) == status
    assert f"1 models offered that change the tractor, {status} of them worse" in capsys.readouterr().out


def test_a_folder_without_logs_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = Path(__file__).parents[1] / "diagnosis" / "data" / "dart.toml"
    assert main(["--parts", "real", "--logs", str(tmp_path), str(file), "asphalt"]) == 2
    assert f"There is no log in {tmp_path}" in capsys.readouterr().err


@pytest.mark.slow
def test_unseen_runs_are_other_runs_of_the_same_truth() -> None:
    first: LogSet = next(list_third_sets(71))
    assert [log.name for log in first.logs] == [log.name for log in first.unseen_logs]
    for log, other in zip(first.logs, first.unseen_logs, strict=True):
        assert log.easting_m[0] != other.easting_m[0]
