"""The check against driven days reads time logs as they are written, and predicts what it says."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from planner.farm.settings import FarmTimes
from tests.benchmarks.campaigns import METRES_PER_DEGREE, campaigns, checks, fitted, lines, read_jobs, read_log

HEADER = '<TIM A="" D="4"><PTN A="" B="" D=""/><DLV A="0043" B="" C="DET-1"/><DLV A="0054" B="" C="DET-1"/></TIM>'
TIMES = FarmTimes(fold_s=100.0, unfold_s=50.0, road_speed_kmh=36.0, road_factor=1.5)


def record(at_s: float, north_m: float, values: int) -> bytes:
    """One record at so many metres north of the equator, with so many values."""
    days, rest = divmod(at_s, 86_400.0)
    place = round(north_m / METRES_PER_DEGREE * 1e7)
    told = b"".join(struct.pack("<Bi", number, 7 * number) for number in range(values))
    return struct.pack("<IHiiBB", round(rest * 1000), int(days), place, 0, 3, values) + told


def write(folder: Path, tasks: list[list[tuple[float, float, float]]]) -> Path:
    """Tasks with logs, each from one moment to another at one place."""
    number, told = 0, []
    for logs in tasks:
        names = []
        for begins, ends, north in logs:
            number += 1
            names.append(f'<TLG A="TLG{number:05d}" C="1"/>')
            (folder / f"TLG{number:05d}.xml").write_text(HEADER)
            parts = [record(begins, north, 2), record(0.5 * (begins + ends), north, 0), record(ends, north, 1)]
            (folder / f"TLG{number:05d}.bin").write_bytes(b"".join(parts))
        told.append(f"<TSK A='TSK{len(told)}'>{''.join(names)}</TSK>")
    (folder / "TASKDATA.XML").write_text(f"<ISO11783_TaskData>{''.join(told)}</ISO11783_TaskData>")
    return folder


def test_a_log_is_read_as_it_was_written(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, [[(90_000.5, 90_100.25, 1000.0)]]) / "TLG00001")
    assert (log.begins_s, log.ends_s) == (90_000.5, 90_100.25)
    assert log.first[0] * METRES_PER_DEGREE == pytest.approx(1000.0, abs=0.01) and log.first == log.last
    (tmp_path / "TLG00001.xml").write_text(HEADER.replace('PTN A=""', 'PTN A="5"'))
    with pytest.raises(ValueError, match="no time or position"):
        read_log(tmp_path / "TLG00001")


def test_a_campaign_by_hand(tmp_path: Path) -> None:
    """1000 + 500 s on two fields 2 km apart: 100 + 50 + 2000 x 1.5 / 10 = 450 s of change, 600 s were taken."""
    first = [[(0.0, 400.0, 0.0), (500.0, 1000.0, 0.0)], [(1600.0, 2100.0, 2000.0)]]
    later = [[(90_000.0, 90_100.0, 0.0)], [(90_300.0, 90_400.0, 1000.0)], [(90_900.0, 91_000.0, 4000.0)]]
    folder = write(tmp_path, first + later)
    found = campaigns(read_jobs(folder))
    assert [len(jobs) for jobs in found] == [2, 3]
    one, other = checks(folder, TIMES)
    assert (one.jobs, one.measured_s, one.on_fields_s) == (2, 2100.0, 1500.0)
    assert one.predicted_s == pytest.approx(1950.0, abs=0.1)
    assert fitted([found[1]]) == pytest.approx((50.0, 0.15), rel=1e-4), "200 s over 1 km, 500 s over 3 km"
    assert one.fitted_s == pytest.approx(1500.0 + 50.0 + 0.15 * 2000.0, abs=0.1)
    assert other.ways_s == pytest.approx(150.0 * 2 + 4000.0 * 0.15, abs=0.1)
    assert other.best_ways_s == pytest.approx(other.ways_s, abs=1.0) and other.gap_pct == 0.0
    assert len(list(lines([one, other]))) == 3
