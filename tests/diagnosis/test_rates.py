"""No name flips when the same drives are logged more slowly, held, interpolated or with jittering clocks."""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import pandas as pd
import pytest

from tests.diagnosis.hiding import eg105
from tests.truth.drives import three_speeds_programme
from tests.truth.second import second_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import EQUIVALENT, LIKELY, NAMED, Diagnosis, Finding
from vehicle.identification.logs.reader import build_log

Change = Callable[[pd.DataFrame], pd.DataFrame]
TOLD = (NAMED, LIKELY, EQUIVALENT)
HIDDEN = {
    "nothing": {},
    "steering_offset": {"steering_offset": {"angle_deg": 1.5}},
    "gnss_latency": {"gnss_latency": {"time_s": 0.3}},
}


def thin(rate_hz: float) -> Change:
    """Only every so many rows of a log of 10 Hz."""
    return lambda frame: frame.iloc[:: round(10.0 / rate_hz)].reset_index(drop=True)


def refresh(names: Sequence[str], every_s: float, lines: bool = False) -> Change:
    """Columns that are refreshed every so often, and repeated or interpolated in between."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        time = frame.time_s.to_numpy()
        rows = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], every_s)))
        number = np.searchsorted(rows, np.arange(len(time)), side="right") - 1
        columns = {}
        for name in names:
            values = frame[name].to_numpy()
            columns[name] = np.interp(time, time[rows], values[rows]) if lines else values[rows][number]
        return frame.assign(**columns)

    return change


def jitter(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows stamped up to 35 ms off, as by a busy logger."""
    rng = np.random.default_rng(len(frame))
    return frame.assign(time_s=frame.time_s + rng.uniform(-0.035, 0.035, len(frame)))


CHANGES: dict[str, Change] = {
    "5 Hz": thin(5.0),
    "2 Hz": thin(2.0),
    "wheel angle held": refresh(["steering_deg"], 0.5),
    "wheel angle interpolated": refresh(["steering_deg"], 0.5, lines=True),
    "speed held": refresh(["speed_mps"], 1.0),
    "steering held": refresh(["steering_deg", "steering_command_deg"], 0.5),
    "jitter": jitter,
}


@lru_cache
def frames_of(name: str) -> tuple[pd.DataFrame, ...]:
    return tuple(second_logs(HIDDEN[name], 31, three_speeds_programme()))


def diagnose(frames: Sequence[pd.DataFrame]) -> Diagnosis:
    return diagnose_logs([build_log(frame, frame.attrs["name"]) for frame in frames], eg105(), "soil")


@lru_cache
def diagnose_unchanged(name: str) -> Diagnosis:
    return diagnose(frames_of(name))


def overlaps(one: Finding, other: Finding) -> bool:
    """Whether two intervals of the same effect have values in common."""
    assert one.interval is not None and other.interval is not None
    return all(
        low <= other.interval[key][1] and other.interval[key][0] <= high for key, (low, high) in one.interval.items()
    )


def check_no_flip(name: str, change: Change) -> None:
    """Nothing is named that was not told before, and values move by no more than their intervals."""
    before = {one.id: one for one in diagnose_unchanged(name).findings if one.status in TOLD}
    changed = []
    for frame in frames_of(name):
        other = change(frame)
        other.attrs["name"] = frame.attrs["name"]
        changed.append(other)
    after = diagnose(changed)
    by_id = {one.id: one for one in after.findings}
    assert set(after.named) <= set(before) | set(HIDDEN[name])
    for told in set(after.named) & set(before):
        assert overlaps(before[told], by_id[told]), told


@pytest.mark.matrix
@pytest.mark.parametrize("change", ["5 Hz", "wheel angle held"])
def test_offset_does_not_flip(change: str) -> None:
    check_no_flip("steering_offset", CHANGES[change])


@pytest.mark.matrix
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", ["nothing", "gnss_latency"])
def test_no_name_flips(name: str, change: str) -> None:
    check_no_flip(name, CHANGES[change])
