"""Sentences beside a diagnosis."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.analytic_drives import circle, log
from vehicle.identification.diagnosis.log_notes import describe_clocks, describe_logs
from vehicle.identification.replay.drive_segments import build_dataset


def said(found: dict[str, dict[str, float] | None], *seconds: float) -> list[str]:
    """What is said of clocks, of logs that last so long, where values were found of some effects."""
    logs: Any = [SimpleNamespace(time_s=np.array([5.0, 5.0 + one]), used=np.ones(2, dtype=bool)) for one in seconds]
    answer: Any = SimpleNamespace(findings=[SimpleNamespace(id=name, value=value) for name, value in found.items()])
    return describe_clocks(logs, answer)


def test_a_time_from_short_logs_takes_one_clock_for_granted() -> None:
    late: dict[str, dict[str, float] | None] = {"gnss_latency": {"time_s": 0.2}, "steering_dead_time": None}
    (told,) = said(late, 60.0, 180.0)
    assert told.startswith("1 of 2 logs are too short (under 100 s)") and "result for gnss_latency assumes" in told
    (told,) = said({**late, "steering_dead_time": {"time_s": 0.1}}, 60.0)
    assert told.startswith("The log is too short") and "gnss_latency and steering_dead_time" in told


@pytest.mark.parametrize("found", [{"gnss_latency": None}, {"steering_offset": {"angle_deg": 1.0}}])
def test_without_a_time_nothing_is_said_of_clocks(found: dict[str, dict[str, float] | None]) -> None:
    assert said(found, 60.0) == [] and said({"gnss_latency": {"time_s": 0.2}}, 180.0) == []


def test_a_log_without_heading_is_said_also_where_the_part_has_none_of_it() -> None:
    logs: Any = [log(circle(0.0)), log(circle(0.0).drop(columns="heading_deg"))]
    course = build_dataset(logs[:1])
    said_of = [[line for line in describe_logs(some, course) if "heading" in line] for some in (logs[:1], logs)]
    assert said_of == [[], ["Some logs have no heading; the course of the positions is used instead."]]
