"""Hundreds of damaged files for every reader: each is read or refused in one sentence, never anything else."""

import os
import random
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely

from fields.errors import HeadlandError
from planner.task_logs.formats.isoxml_logs import parse_time_log
from planner.task_logs.log_import import import_runs, read_task_logs
from planner.task_logs.runs.phases import summarise_run
from planner.task_logs.runs.run_files import load_imported_run
from planner.task_logs.runs.run_records import project_run
from tests.fields.farm_files import agopengps
from tests.fields.test_fuzz_forms import damaged, ends_well
from tests.works.conftest import HEADER, binary, main_file
from tests.works.test_other_forms import MAPPING, csv_lines, write_points

CASES = int(os.environ.get("HEADLAND_TEST_CASES", "200"))
"""What is damaged is the same every time; HEADLAND_TEST_CASES damages more."""
MEMORY = Path("/dev/shm")
ROWS = 60
NUMBERS = (0, 1, 0x7F, 0x80, 0xFF)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder in memory where there is one: thousands of files take long on some disks."""
    if not os.access(MEMORY, os.W_OK):
        yield tmp_path
        return
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        monkeypatch.setattr(tempfile, "tempdir", folder)
        yield Path(folder)


@pytest.fixture
def stick(taskdata: Path, place: Path) -> Path:
    """A TASKDATA folder with the drive, in memory."""
    return Path(shutil.copytree(taskdata, place / "TASKDATA"))


def damaged_bytes(data: bytes, draw: random.Random, records: list[int]) -> bytes:
    """Bytes with one to four of their records or numbers changed, doubled, exchanged or cut."""
    for _ in range(draw.randint(1, 4)):
        kind, at = draw.randrange(5), draw.choice(records)
        if kind == 0:
            data = data[: draw.randrange(len(data) + 1)]
        elif kind == 1:
            data = data[:at] + bytes([draw.choice(NUMBERS)]) * draw.randint(1, 6) + data[at + 4 :]
        elif kind == 2:
            data = data[:at] + data[at : at + draw.randint(1, 60)] + data[at:]
        elif kind == 3:
            place = draw.randrange(len(data)) if data else 0
            data = data[:place] + bytes([draw.randrange(256)]) + data[place + 1 :]
        else:
            data = data[:at] + data[at + draw.randint(1, 30) :]
    return data


def survey(read: Callable[[int], object], cases: int = CASES) -> None:
    """Every case ends well, and some of both kinds come up, or the damage is of the wrong size."""
    good = sum(ends_well(lambda number=number: read(number), HeadlandError) for number in range(cases))  # type: ignore[misc]
    assert 0.01 * cases < good < 0.99 * cases


def starts(data: bytes) -> list[int]:
    """Where records of a binary time log begin, and a few places in each."""
    found, place = [], 0
    while place + 16 <= len(data):
        found += [place, place + 4, place + 6, place + 15, place + 16]
        place += 16 + 5 * data[place + 15]
    return found


def test_binary_time_logs(stick: Path) -> None:
    draw, whole = random.Random(20263), binary()
    whole = whole[: starts(whole)[5 * ROWS]]
    places = starts(whole)

    def read(number: int) -> None:
        (stick / "TLG00001.bin").write_bytes(damaged_bytes(whole, draw, places))
        for run in read_task_logs(str(stick)).runs:
            told = summarise_run(project_run(run))
            assert np.isfinite([told.seconds, told.placed_m, *told.by_kind_s.values()]).all()
            assert sum(told.by_kind_s.values()) == pytest.approx(told.seconds)

    survey(read)


def test_headers_of_time_logs() -> None:
    draw, whole = random.Random(20264), binary()[:2000]
    survey(lambda number: parse_time_log(damaged(HEADER, draw).encode(errors="replace"), whole, "x"))


def test_task_files(stick: Path) -> None:
    draw, whole = random.Random(20265), main_file()
    data = binary()
    (stick / "TLG00001.bin").write_bytes(data[: starts(data)[5 * ROWS]])

    def read(number: int) -> None:
        (stick / "TASKDATA.XML").write_text(damaged(whole, draw), errors="replace")
        import_runs([str(stick)])

    survey(read)


@pytest.mark.parametrize("ending", [".dbf", ".shp"])
def test_shapefiles_of_points(place: Path, ending: str) -> None:
    draw, path = random.Random(20266), write_points(place, most=30).with_suffix(ending)
    whole = path.read_bytes()
    places = [*range(0, 200, 4), *range(200, len(whole), 97)]

    def read(number: int) -> None:
        path.write_bytes(damaged_bytes(whole, draw, places))
        for run in read_task_logs(str(path.with_suffix(".shp"))).runs:
            summarise_run(project_run(run))

    survey(read, CASES // 2)


def test_recorded_paths(place: Path) -> None:
    draw, folder = random.Random(20267), agopengps(place)
    whole = "$RecPath\n20\n" + "\n".join(f"{place},{2 * place},0.5,7.2,{place % 5 > 0}" for place in range(12))

    def read(number: int) -> None:
        (folder / "RecPath.txt").write_text(damaged(whole, draw))
        for run in read_task_logs(str(folder)).runs:
            summarise_run(project_run(run))

    survey(read)


def test_csv_files_and_mappings(place: Path) -> None:
    draw = random.Random(20268)
    lines = "\n".join(csv_lines().split("\n")[:30])
    log, mapping = place / "log.csv", place / "map.toml"

    mapping.write_text(MAPPING)

    def read(number: int) -> None:
        if number < CASES // 2:
            log.write_text(damaged(lines, draw))
        else:
            mapping.write_text(damaged(MAPPING, draw))
        if number == CASES // 2:
            log.write_text(lines)
        read_task_logs(str(log), str(mapping))

    survey(read)


def test_files_of_runs(stick: Path, place: Path) -> None:
    draw = random.Random(20269)
    data = binary()
    (stick / "TLG00001.bin").write_bytes(data[: starts(data)[5 * ROWS]])
    (log, text), (about, told) = sorted(import_runs([str(stick)]).files.items())
    lines = "\n".join(text.split("\n")[:30])

    (place / about).write_text(told)

    def read(number: int) -> None:
        if number < CASES // 2:
            (place / log).write_text(damaged(lines, draw))
        else:
            (place / about).write_text(damaged(told, draw))
        if number == CASES // 2:
            (place / log).write_text(lines)
        run = load_imported_run(place / log)
        summarise_run(run)
        assert run.outline is None or isinstance(run.outline, shapely.Polygon)

    survey(read)
