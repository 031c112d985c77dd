"""Faults that begin in a run are found, at their onset and by their name; nothing else is one."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from tests.identification.fault_logs import START_S, clean_frames, clean_logs, degrade, freeze, ignore_commands, rows_of
from tests.truth.drives import three_speeds_programme
from tests.truth.second import second_logs
from vehicle.identification.diagnosis.log_notes import list_onset_faults
from vehicle.identification.diagnosis.onsets import _find_likely_rows, find_onset_spans, mark_onset_faults
from vehicle.identification.diagnosis.search import ADD_NATS
from vehicle.identification.faults.steering_evidence import STEP_S
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log, LogFault


def build_logs(changed: dict[str, pd.DataFrame]) -> list[Log]:
    return list((clean_logs() | {name: build_log(frame, name) for name, frame in changed.items()}).values())


def build_unread_logs(changed: dict[str, pd.DataFrame], monkeypatch: pytest.MonkeyPatch) -> list[Log]:
    """Logs of which the reader has not looked for faults of columns."""
    assert not any(log.faults for log in clean_logs().values())
    monkeypatch.setattr("vehicle.identification.logs.reader.find_column_faults", lambda columns, name: [])
    return build_logs(changed)


def list_faults(logs: list[Log]) -> list[LogFault]:
    return [fault for log in mark_onset_faults(logs) for fault in log.faults]


def stick(frame: pd.DataFrame, from_s: float) -> pd.DataFrame:
    """Wheels that run to the right at 15 deg/s and stay at 26 deg; the path follows them."""
    frame, rows = frame.copy(), rows_of(frame, from_s, None)
    before = rows[0] - 1
    seconds = (frame.time_s[rows] - frame.time_s[before]).to_numpy()
    wheel = np.minimum(frame.steering_deg[before] + 15.0 * seconds, 26.0)
    pace, step_s = frame.speed_mps[rows].to_numpy(), np.diff(frame.time_s[rows], prepend=frame.time_s[before])
    heading = frame.heading_deg[before] + np.degrees(np.cumsum(pace * np.tan(np.radians(wheel)) / 2.4 * step_s))
    for name, share in (("easting_m", np.sin), ("northing_m", np.cos)):
        frame.loc[rows, name] = frame[name][before] + np.cumsum(pace * share(np.radians(heading)) * step_s)
    frame.loc[rows, "steering_deg"] = np.round(wheel + 0.04 * np.sin(37.0 * seconds), 2)
    frame.loc[rows, "heading_deg"] = heading % 360.0
    return frame


@pytest.mark.parametrize("kind", ["wheel", "linkage", "no sensor"])
@pytest.mark.parametrize(("name", "from_s", "to_s"), [("waves", 20.0, None), ("there", 15.0, 31.0)])
def test_steering_that_stops_following_is_found(name: str, from_s: float, to_s: float | None, kind: str) -> None:
    logs = build_logs({name: ignore_commands(clean_frames()[name], from_s, to_s, kind == "linkage")})
    if kind == "no sensor":
        logs = [replace(log, steering_deg=None) for log in logs]
    faults = list_faults(logs)
    assert {(fault.id, fault.run) for fault in faults} == {("steering_loose", name)}
    assert faults[0].from_s - START_S == pytest.approx(from_s, abs=5.0)


def test_wheels_that_run_away_are_stuck() -> None:
    faults = list_faults(build_logs({"left": stick(clean_frames()["left"], 22.0)}))
    assert [(fault.id, fault.run, fault.to_s) for fault in faults] == [("steering_stuck", "left", None)]
    assert faults[0].from_s - START_S == pytest.approx(22.0, abs=2.0) and faults[0].between_s is None


@pytest.mark.parametrize(
    ("column", "name", "from_s", "to_s", "expected"),
    [
        ("heading_deg", "steps", 15.0, 20.0, "heading_frozen"), ("heading_deg", "waves", 10.0, None, "heading_frozen"),
        ("speed_mps", "steps", 10.0, None, "speed_frozen"),
        ("steering_deg", "waves", 21.0, 35.0, "wheel_sensor_frozen"),
    ],
)  # fmt: skip
def test_what_the_reader_of_one_log_does_not_see_freeze_is_found_beside_other_runs(
    column: str, name: str, from_s: float, to_s: float | None, expected: str
) -> None:
    logs = build_logs({name: freeze(clean_frames()[name], (column,), from_s, to_s)})
    faults = list_faults(logs)
    assert not any(log.faults for log in logs)
    assert [(fault.id, fault.run) for fault in faults] == [(expected, name)]
    assert faults[0].from_s - START_S == pytest.approx(from_s, abs=1.0)
    end_s = None if faults[0].to_s is None else faults[0].to_s - START_S
    assert end_s == (None if to_s is None else pytest.approx(to_s, abs=2.0))


def test_a_lost_fix_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    logs = build_unread_logs({"right": degrade(clean_frames()["right"], 20.0, 34.0, 0.8, 5)}, monkeypatch)
    faults = list_faults(logs)
    assert [(fault.id, fault.run) for fault in faults] == [("position_lost", "right")]
    assert faults[0].from_s - START_S == pytest.approx(20.0, abs=3.0)


def test_what_the_reader_found_is_not_told_again() -> None:
    logs = build_logs({"steps": freeze(clean_frames()["steps"], ("heading_deg",), 21.0, 35.0)})
    assert [fault.id for fault in list_faults(logs)] == ["heading_frozen"]


@pytest.mark.parametrize(
    ("effect", "field", "value"),
    [("steering_backlash", "angle_deg", 4.0), ("side_slip", "limit_g", 0.08), ("steering_gain", "ratio", 0.8)],
)
def test_healthy_logs_have_no_fault(effect: str, field: str, value: float) -> None:
    frames = second_logs({effect: {field: value}}, 71, three_speeds_programme())
    logs = [build_log(frame, frame.attrs["name"]) for frame in frames]
    assert list_faults(logs) == []


def test_rows_of_a_fault_are_left_out_and_told() -> None:
    before = build_logs({"waves": ignore_commands(clean_frames()["waves"], 20.0, None, False)})
    after = {log.name: log for log in mark_onset_faults(before)}["waves"]
    last_s = float(after.time_s[after.used][-1])
    fault = after.faults[0]
    assert last_s < (fault.between_s[0] if fault.between_s else fault.from_s) <= START_S + 21.0
    assert after.gated[-1].rule.startswith("steering loose") and np.all(after.segment[~after.used] == -1)
    said = list_onset_faults([after])
    assert said[0].to_s is None and "the wheels do not follow" in said[0].words


def test_a_run_without_rows_left_gives_its_fault_to_another() -> None:
    changed = {"waves": ignore_commands(clean_frames()["waves"], 0.0, None, False)}
    logs = mark_onset_faults(build_logs(changed))
    assert all(log.rows_used for log in logs) and {fault.run for log in logs for fault in log.faults} <= {"waves"}


def test_a_span_is_where_the_sum_of_nats_is_largest() -> None:
    nats = np.full(600, -1.0 * STEP_S)
    nats[200:300], nats[250:260], nats[300:320] = 3.0 * STEP_S, -2.0 * STEP_S, 0.0
    ((rows, total, reach),) = _find_likely_rows(nats)
    assert (rows.start, rows.stop) == (200, 300) and total == pytest.approx(25.0) and total > ADD_NATS
    assert 175 <= reach.start < 200 and 320 < reach.stop <= 345
    assert _find_likely_rows(0.3 * nats) == []


def test_spans_of_a_run_do_not_overlap() -> None:
    logs = build_logs({"steps": ignore_commands(clean_frames()["steps"], 15.0, 40.0, True)})
    spans = sorted(find_onset_spans(logs), key=lambda span: (span.run, span.first_s))
    assert all(a.run < b.run or a.last_s < b.first_s for a, b in pairwise(spans))
