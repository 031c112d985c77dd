"""`headland logs`: from a stick to files and a table; nothing is written over, and nothing half."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from planner.main import main
from tests.works.conftest import STOP_S, TRACK_M, TRACKS


@pytest.fixture
def headland(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, str, str]]:
    """Run the command in this process: status, what it prints, what it says on standard error."""

    def run(*words: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["headland", *map(str, words)])
        capfd.readouterr()
        status = 0
        try:
            main()
        except SystemExit as end:
            status = int(end.code or 0)
        printed = capfd.readouterr()
        return status, printed.out, printed.err

    return run


def test_a_table_and_two_files_a_run(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    status, out, err = headland("logs", "import", taskdata, "-o", tmp_path / "new" / "runs")
    assert (status, err) == (0, "")
    for word in ("TLG00001", "2026-05-04", "Long acre", "0:03:10", "0.18"):
        assert word in out, out
    assert len(list((tmp_path / "new" / "runs").iterdir())) == 2


def test_figures_as_json(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    status, out, _ = headland("logs", "import", taskdata, "-o", tmp_path / "runs", "--json")
    (run,) = json.loads(out)["runs"]
    assert status == 0
    assert (run["lifts"], run["turns"], run["stops"], run["stops_s"]) == (TRACKS, TRACKS - 1, 1, STOP_S)
    assert run["active_m"] == pytest.approx(TRACKS * TRACK_M, abs=0.01)
    assert run["file"] == "2026-05-04_Long-acre_TLG00001.csv"


def test_nothing_is_written_over_unless_asked(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    words = ("logs", "import", taskdata, "-o", tmp_path / "runs")
    assert headland(*words)[0] == 0
    before = {path: path.read_bytes() for path in (tmp_path / "runs").iterdir()}
    (tmp_path / "runs" / "2026-05-04_Long-acre_TLG00001.csv").write_text("mine")
    status, out, err = headland(*words)
    assert status == 2 and out == "" and "is there already" in err
    assert (tmp_path / "runs" / "2026-05-04_Long-acre_TLG00001.csv").read_text() == "mine"
    assert headland(*words, "--force")[0] == 0
    assert {path: path.read_bytes() for path in (tmp_path / "runs").iterdir()} == before


def test_a_refusal_leaves_no_folder(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    (taskdata / "TLG00001.bin").unlink()
    status, out, err = headland("logs", "import", taskdata, "-o", tmp_path / "runs")
    assert status == 2 and out == "" and "TLG00001.bin is not in the folder" in err
    assert not (tmp_path / "runs").exists()


def test_two_sticks_with_logs_of_one_name(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    status, _, _ = headland("logs", "import", taskdata, taskdata, "-o", tmp_path / "runs")
    assert status == 0 and len(list((tmp_path / "runs").glob("*.csv"))) == 2


def test_diagnosis_says_that_such_logs_lack_steering(
    headland: Callable[..., Any], taskdata: Path, tmp_path: Path
) -> None:
    headland("logs", "import", taskdata, "-o", tmp_path / "runs")
    status, out, err = headland("diagnose", tmp_path / "runs" / "*.csv")
    assert status == 2 and out == "" and "has no column steering_command_deg or steering_deg" in err
