"""Small logs drawn by hand: what is in them is known."""

from pathlib import Path

import numpy as np
import pytest

from planner.pipeline.example_logs import DDI_COLUMNS, encode_records
from tests.cli.conftest import built, headland  # noqa: F401
from tests.fields.farm_files import METRE_EAST, METRE_NORTH, place

WIDTH_M, WORK_MPS = 6.0, 2.0
TRACK_M, STOP_S, TURN_S = 100, 20, 20
TRACKS = 3

_NAMED = "".join(f'<DLV A="{name}" B="" C="DET-1"/>' for name in DDI_COLUMNS)
HEADER = f'<TIM A="" D="4"><PTN A="" B="" D=""/>{_NAMED}</TIM>'


def drive() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three tracks of 100 m north and south, 6 m apart, at 2 m/s and once a second; half circles of 20 s between them.

    After the first half of the second track the machine stands for 20 s, at work. Seconds (n,), metres (n, 2), state.
    """
    xy, works = [], []
    for track in range(TRACKS):
        up = track % 2 == 0
        along = np.arange(0.0, TRACK_M, WORK_MPS)
        for metre in along if up else TRACK_M - along:
            xy.append((track * WIDTH_M, metre))
            works.append(True)
            if track == 1 and metre == TRACK_M / 2:
                xy += [xy[-1]] * STOP_S
                works += [True] * STOP_S
        if track < TRACKS - 1:
            turn = np.linspace(0.0, np.pi, TURN_S, endpoint=False)
            middle = (track + 0.5) * WIDTH_M
            side = 1.0 if up else -1.0
            for angle in turn:
                x = middle - 0.5 * WIDTH_M * np.cos(angle)
                y = (TRACK_M if up else 0.0) + side * 0.5 * WIDTH_M * np.sin(angle)
                xy.append((x, y))
                works.append(False)
    xy.append((2 * WIDTH_M, float(TRACK_M)))
    works.append(False)
    return np.arange(len(xy), dtype=float), np.array(xy), np.array(works)


def lonlat(xy: np.ndarray) -> np.ndarray:
    latitude, longitude = place(0, 0)
    return np.column_stack([longitude + xy[:, 0] * METRE_EAST, latitude + xy[:, 1] * METRE_NORTH])


def values(time_s: np.ndarray, xy: np.ndarray, works: np.ndarray) -> np.ndarray:
    """What a device sends, in the order of COLUMNS."""
    steps = np.concatenate([[0.0], np.hypot(*np.diff(xy, axis=0).T)])
    before = np.concatenate([[False], works[:-1]])
    lasts = np.concatenate([[0.0], np.diff(time_s)])
    active, idle = np.cumsum(steps * before), np.cumsum(steps * ~before)
    table = (
        np.full(len(steps), 1e3 * WIDTH_M), active * WIDTH_M, 1e3 * active, 1e3 * idle, np.cumsum(lasts * before),
        np.cumsum(lasts * ~before), works, 1e3 * np.concatenate([steps[1:], [0.0]]),
    )  # fmt: skip
    return np.rint(np.column_stack(table)).astype(np.int64)


def binary() -> bytes:
    """The drive as a binary time log."""
    time_s, xy, works = drive()
    return encode_records(time_s, lonlat(xy), values(time_s, xy, works))


def main_file(logs: str = '<TLG A="TLG00001"/>') -> str:
    """A task on a field of 30 by 110 metres, whose area the file says."""
    corners = ((-6, -5), (24, -5), (24, 105), (-6, 105))
    points = "".join('<PNT A="2" C="{:.9f}" D="{:.9f}"/>'.format(*place(*corner)) for corner in corners)
    return (
        '<?xml version="1.0" encoding="UTF-8"?><ISO11783_TaskData VersionMajor="4">'
        f'<PFD A="PFD1" C="Long acre" D="3300"><PLN A="1"><LSG A="1">{points}</LSG></PLN></PFD>'
        f'<TSK A="TSK1" B="mow" E="PFD1">{logs}</TSK></ISO11783_TaskData>'
    )


@pytest.fixture
def taskdata(tmp_path: Path) -> Path:
    """A TASKDATA folder with the drive."""
    folder = tmp_path / "TASKDATA"
    folder.mkdir()
    (folder / "TASKDATA.XML").write_text(main_file())
    (folder / "TLG00001.xml").write_text(HEADER)
    (folder / "TLG00001.bin").write_bytes(binary())
    return folder
