"""`diagnose` and `replay` as a user meets them: logs are never overwritten, and what was not used is told."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused, contents

REFUSED = [
    ("diagnose run.html --html run.html", "run.html would overwrite the log run.html; choose another file"),
    ("diagnose run.html --html ./run.html", "would overwrite the log"),
    ("diagnose run.cs? run.toml --save run.toml", "would overwrite the log run.toml"),
    ("diagnose r*.html --html run.html", "would overwrite the log"),
    ("diagnose run.csv --html run.csv", "run.csv would overwrite"),
    ("diagnose run.csv --save run.csv", "run.csv would overwrite"),
    ("replay run.png --png run.png", "would overwrite the log"),
    ("replay run.html --html run.html", "would overwrite the log"),
    ("replay run.csv --png run.csv", "run.csv would overwrite"),
    ("diagnose --demo --seed -1", "--seed -1 is negative; use 0 or more"),
    ("diagnose run.csv --seed 3", "--seed 3 needs the demonstration; add --demo"),
    ("diagnose run.csv --hide side_slip", "--hide side_slip needs the demonstration; add --demo"),
    ("diagnose --demo --fix time-ms", "--fix converts log files; leave it out with --demo"),
    ("diagnose --demo --column time_s=Zeit", "--column converts log files; leave it out with --demo"),
    ("diagnose run.csv --column time_s=Zeit", "run has no column 'Zeit' for --column time_s=Zeit (it has: time_s,"),
    ("diagnose run.csv --column time=time_s --column time_s=speed_mps", "contradicts the unit of that column (mps)"),
    ("replay run.csv --mapping run.csv", "The mapping 'run.csv' is not TOML"),
    ("replay run.csv --mapping run.html --html run.html", "The mapping 'run.html' is not TOML"),
    ("diagnose run.csv --demo", "either log files or --demo"),
    ("diagnose", "either log files or --demo"),
    ("diagnose x*.csv", "x*.csv matches no file"),
    ("diagnose sample --holdout other", "'other' is none of the runs (sample_log)"),
    (
        "diagnose sample --save-soil north",
        "--save-soil north needs the moisture of the logs; add --moisture, in % of dry",
    ),
    ("diagnose sample --save-soil north --moisture 101", "--moisture 101 is no moisture of a soil"),
    ("diagnose sample --moisture 20", "--moisture 20 is that of a soil; add --save-soil or leave out --moisture."),
    ("diagnose sample --crs EPSG:32632", "--crs EPSG:32632 needs heights; add --elevation or leave out --crs."),
    ("diagnose sample --elevation nowhere.tif", "There is no file of heights 'nowhere.tif'"),
    ("replay nowhere.csv", "nowhere.csv does not exist"),
    ("replay run.*", "run.* does not exist"),
    ("replay run.csv --fix km", "the fixes are: time-ms"),
]


def log(rows: int = 400) -> pd.DataFrame:
    """Six seconds at rest and then straight to the north-east at 1.4 m/s."""
    time = np.arange(rows) / 20.0
    speed = np.clip(time - 6.0, 0.0, 1.4)
    way = np.cumsum(speed) / 20.0 * np.sqrt(0.5)
    return pd.DataFrame({
        "time_s": time, "easting_m": np.round(10.0 + way, 3), "northing_m": np.round(20.0 + way, 3),
        "heading_deg": 45.0, "speed_mps": speed, "steering_command_deg": 0.0,
    })  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a log under several endings."""
    for name in ("run.csv", "run.html", "run.png", "run.toml"):
        log().to_csv(tmp_path / name, index=False)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("words", "sentence"), REFUSED)
def test_refused_in_one_sentence_and_nothing_touched(headland: Run, folder: Path, words: str, sentence: str) -> None:
    before = contents(folder)
    assert_refused(headland(*words.split(" ")), sentence)
    assert contents(folder) == before


def test_a_replay_tells_what_it_left_out(headland: Run, folder: Path) -> None:
    frame = log().rename(columns={"speed_mps": "speed_ms"})
    frame.loc[[30, 40], "heading_deg"] = np.nan
    frame.to_csv("run.csv", index=False)
    text = " ".join(headland("replay", "run.csv").out.split())
    assert "run: column 'speed_ms' is unknown and was ignored; map it to speed_mps" in text
    assert "run: 2 rows left out: heading_deg missing or not a number (first in line 32)." in text
    assert "No commanded speed was logged, so the measured speed was replayed and none is simulated." in text
    found = json.loads(headland("replay", "run.csv", "--json").out)
    assert found["rows_gated"] == 2 and len(found["notes"]) == 3


def test_what_a_refusal_of_columns_suggests_reads_the_log(headland: Run, folder: Path) -> None:
    """The options of the sentence are copied, then written into a mapping file; both replay as the log of our names."""
    expected = headland("replay", "run.csv", "--json").out
    names = ["Zeit", "X [m]", "Y [m]", "Kurs (°)", "v [m/s]", "Lenkwinkel Soll"]
    log().set_axis(names, axis=1).to_csv("run.csv", index=False, sep=";", decimal=",", encoding="cp1252")
    refused = headland("replay", "run.csv")
    (sentence,) = refused.sentences
    assert refused.status == 2 and "no column time_s, easting_m, northing_m, steering_command_deg or" in sentence
    options = shlex.split(sentence.partition(", add ")[2].removesuffix("."))
    assert headland("replay", "run.csv", *options, "--json").out == expected
    lines = [f"{key} = '{name}'" for key, _, name in (pair.partition("=") for pair in options[1::2])]
    Path("columns.toml").write_text("\n".join(lines), encoding="utf-8")
    assert headland("replay", "run.csv", "--mapping", "columns.toml", "--json").out == expected


def test_a_replay_draws_a_speed_only_where_it_simulated_one(headland: Run, folder: Path) -> None:
    from planner.pipeline.replays import replay
    from reports.diagnosis.replay import draw_replay

    def labels(frame: pd.DataFrame) -> list[list[str]]:
        frame.to_csv("run.csv", index=False)
        found = replay("run.csv").replayed
        return [[text.get_text() for text in axes.get_legend().get_texts()] for axes in draw_replay(found).axes[:3]]

    path, wheel, speed = labels(log())
    assert path == ["measured", "simulated, aligned with the first 5 s", "start"] and wheel == [
        "commanded",
        "simulated",
    ]
    assert speed == ["measured, replayed: no command was logged"]
    assert labels(log().assign(speed_command_mps=1.4))[2] == ["measured", "commanded", "simulated"]


def test_a_run_that_starts_at_rest_is_laid_on_by_its_heading(folder: Path) -> None:
    """Six seconds at rest: the noise of the positions must not turn the picture."""
    from planner.pipeline.replays import replay

    rng = np.random.default_rng(4)
    frame = log(800)
    for column in ("easting_m", "northing_m"):
        frame[column] += 0.01 * rng.standard_normal(len(frame))
    frame.to_csv("run.csv", index=False)
    (stretch,) = replay("run.csv").replayed.segments
    driven = stretch.antenna[-1] - stretch.antenna[0]
    assert np.degrees(np.arctan2(driven[0], driven[1])) == pytest.approx(45.0, abs=1.0)
    assert np.hypot(*(stretch.antenna[0] - [stretch.measured.east[0], stretch.measured.north[0]])) < 0.05


@pytest.mark.slow
def test_a_replay_page_stands_alone_and_holds_the_remarks(headland: Run, folder: Path) -> None:
    log().assign(comment="<b>").to_csv("run.csv", index=False)
    assert headland("replay", "run.csv", "--html", "page.html", "--png", "picture.png").status == 0
    text = (folder / "page.html").read_text(encoding="utf-8")
    assert "column &#39;comment&#39; is unknown and was ignored" in text and "<b>" not in text
    assert not re.search(r"""(?:src|href)=["'](?!data:|#)""", text)
    assert (folder / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_a_replay_drives_with_the_rest_of_the_tractor_file(headland: Run, folder: Path) -> None:
    from importlib import resources

    text = (resources.files("vehicle") / "data" / "eg105.toml").read_text(encoding="utf-8")
    rest = (
        "\n[discrepancy_model]\non = {}\nspeed_mps = [0.0, 3.0]\nangle_deg = [-35.0, 35.0]\n"
        "amounts = {{ angle_by_speed = 2.0 }}\n"
    )
    found = []
    for on in ("true", "false"):
        (folder / "my.toml").write_text(text + rest.format(on), encoding="utf-8")
        found.append(json.loads(headland("replay", "run.csv", "--tractor", "my.toml", "--json").out))
    assert [one["effects"] for one in found] == [["discrepancy_model"], []]
    assert found[0]["error"]["5"]["cross_cm"] > 10.0 * found[1]["error"]["5"]["cross_cm"]
