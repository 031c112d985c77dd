"""`headland logs`: from a stick to files and a table; nothing is written over, and nothing half."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.works.conftest import STOP_S, TRACK_M, TRACKS

FARM = '[[implements]]\nname = "mower"\nwidth_m = 6.0\n'


def test_a_table_and_two_files_a_run(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    status, out, err = headland("logs", "import", taskdata, "-o", tmp_path / "new" / "runs")
    assert status == 0 and err.startswith("Wrote ") and err.endswith("TLG00001.json.\n") and err.count("\n") == 1
    for word in ("TLG00001", "2026-05-04", "Long acre", "0:03:30", "0.18"):
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
    assert status == 2 and out == "" and "exists already" in err
    assert (tmp_path / "runs" / "2026-05-04_Long-acre_TLG00001.csv").read_text() == "mine"
    assert headland(*words, "--force")[0] == 0
    assert {path: path.read_bytes() for path in (tmp_path / "runs").iterdir()} == before


def test_a_refusal_leaves_no_folder(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    (taskdata / "TLG00001.bin").unlink()
    status, out, err = headland("logs", "import", taskdata, "-o", tmp_path / "runs")
    assert status == 2 and out == "" and "TLG00001.bin is missing in the folder" in err
    assert not (tmp_path / "runs").exists()


def test_two_sticks_with_logs_of_one_name(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    status, _, _ = headland("logs", "import", taskdata, taskdata, "-o", tmp_path / "runs")
    assert status == 0 and len(list((tmp_path / "runs").glob("*.csv"))) == 2


@pytest.mark.slow
def test_learning_writes_where_it_is_told_to(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    headland("logs", "import", taskdata, taskdata, taskdata, "-o", tmp_path / "runs")
    farm, other = tmp_path / "farm.toml", tmp_path / "other.toml"
    farm.write_text(FARM)
    status, out, err = headland("learn", tmp_path / "runs", "--farm", farm, "-o", other)
    assert status == 0 and "Note" not in err and "implements.mower.speed_kmh" in out
    assert farm.read_text() == FARM and "speed_kmh = 7.2 " in other.read_text()
    status, _, err = headland("learn", tmp_path / "runs", "--farm", farm, "-o", other)
    assert status == 2 and "exists already" in err
    assert headland("learn", tmp_path / "runs", "--farm", farm)[0] == 0
    assert farm.read_text() == other.read_text()
    status, out, _ = headland("farm", "check", farm, "--json")
    (speed,) = (one for one in json.loads(out)["values"] if one["key"] == "speed_kmh")
    assert speed["source"].startswith("own logs: 7.2 (95 %")


def test_runs_of_one_name_in_two_folders_are_two(headland: Callable[..., Any], taskdata: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        headland("logs", "import", taskdata, "-o", tmp_path / name)
    (tmp_path / "farm.toml").write_text(FARM)
    words = ("learn", tmp_path / "one", tmp_path / "two", "--farm", tmp_path / "farm.toml", "--json")
    told = json.loads(headland(*words)[1])["learned"]
    assert all(len(one["runs"]) == 2 for one in told)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("compare", "plan.json", "nowhere"), "There is no file or folder"),
        (("compare", "plan.json", "."), "contains no imported run"),
        (("learn", "nowhere", "--farm", "farm.toml"), "There is no file or folder"),
        (("logs", "import", "nowhere", "-o", "runs"), "There is no file or folder"),
        (("logs", "example", "nowhere.json", "-o", "TASKDATA"), "There is no file"),
    ],
)
def test_refusals_are_one_sentence(
    headland: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "farm.toml").write_text(FARM)
    status, out, err = headland(*words)
    sentences = [line for line in err.splitlines() if not line.startswith("Compiling")]
    assert status == 2 and out == "" and len(sentences) == 1 and said in sentences[0] and sentences[0].endswith(".")
    assert [path.name for path in tmp_path.iterdir()] == ["farm.toml"]
