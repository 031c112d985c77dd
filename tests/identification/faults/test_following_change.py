"""Wheels that follow less from a moment on are a fault; those that always did, or wherever they go so, are not."""

import numpy as np
import pandas as pd
import pytest

from vehicle.identification.faults.following_change import FollowingChange, find_following_changes
from vehicle.identification.faults.steering_evidence import STEP_S, SteeringEvidence, follow_command
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Array, Log

TIME = STEP_S * np.arange(900, dtype=np.float64)


def follow_with_gap(command: Array, gap_deg: Array) -> Array:
    """The wheel that follows at 16 deg/s as long as it is further from its command than a gap (k,)."""
    wheel, fine_s = np.zeros(len(command)), 0.01
    for row in range(1, len(command)):
        angle = wheel[row - 1]
        for _ in range(round(STEP_S / fine_s)):
            apart = command[row - 1] - angle
            angle += np.clip(apart, -16.0 * fine_s, 16.0 * fine_s) if abs(apart) > gap_deg[row] else 0.0
        wheel[row] = angle
    return wheel


def build_segment(seed: int, gap_deg: Array, slow_from: int = 900, pace: float = 1.4) -> SteeringEvidence:
    """A drive of 90 s with a new command every 3 s, at 16 deg/s, and at 4 deg/s from row `slow_from` on."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(8.0, 20.0, 30) * np.where(np.arange(30) % 2, 1.0, -1.0), 30)
    wheel = follow_with_gap(command, gap_deg)
    if slow_from < 900:
        wheel[slow_from:] = follow_command(command[slow_from:], 0.1, 4.0, 0.1, float(wheel[slow_from - 1]))
    wheel += 0.05 * rng.standard_normal(900)
    usual, nothing = follow_command(command, 0.1, 16.0, 0.15), np.full(900, np.nan)
    return SteeringEvidence(
        TIME, np.full(900, pace), nothing, command, wheel, command, command, usual, 0.0, True, nothing, nothing
    )


def build_plain_log(name: str, implement: Array | None = None) -> Log:
    columns = {
        "time_s": TIME,
        "easting_m": 1.4 * TIME,
        "northing_m": 9.0 * np.sin(0.1 * TIME),
        "steering_deg": -5.0 * np.sin(0.1 * TIME),
    }
    if implement is not None:
        columns["implement"] = implement
    return build_log(pd.DataFrame(columns), name, check=False)


def find(*segments: SteeringEvidence, implement: Array | None = None) -> list[list[FollowingChange]]:
    logs = [build_plain_log(f"run{run}", implement if run == len(segments) - 1 else None) for run in
            range(len(segments))]  # fmt: skip
    return [found for parts in find_following_changes(logs, [[one] for one in segments]) for found in parts]


TIGHT, SINCE_40_S = np.full(900, 0.1), np.arange(900) >= 400


def test_a_gap_that_begins_is_found_with_its_onset_to_the_end() -> None:
    found = find(*(build_segment(seed, TIGHT) for seed in range(3)), build_segment(9, np.where(SINCE_40_S, 5.0, 0.1)))
    assert found[:3] == [[], [], []] and len(found[3]) == 1
    assert found[3][0].first * STEP_S == pytest.approx(40.0, abs=3.5) and found[3][0].last == 899


def test_a_valve_that_becomes_slow_is_found_with_its_onset_to_the_end() -> None:
    found = find(*(build_segment(seed, TIGHT) for seed in range(3)), build_segment(9, TIGHT, slow_from=400))
    assert found[:3] == [[], [], []] and len(found[3]) == 1
    assert found[3][0].first * STEP_S == pytest.approx(40.0, abs=3.5) and found[3][0].last == 899


def test_gaps_of_all_runs_and_of_all_of_a_run_and_those_that_grow_are_none() -> None:
    good, coarse = [build_segment(seed, TIGHT) for seed in range(3)], np.full(900, 5.0)
    assert not any(find(*(build_segment(seed, coarse) for seed in range(4))))
    assert not any(find(*good, build_segment(9, coarse)))
    assert not any(find(*good, build_segment(9, np.linspace(0.1, 8.0, 900))))
    assert not any(find(*(build_segment(seed, np.where(SINCE_40_S, 5.0, 0.1)) for seed in range(4))))


def test_a_gap_with_an_implement_that_works_in_no_other_run_is_not_told() -> None:
    segments = [*(build_segment(seed, TIGHT) for seed in range(3)), build_segment(9, np.where(SINCE_40_S, 5.0, 0.1))]
    assert any(find(*segments)) and not any(find(*segments, implement=SINCE_40_S.astype(float)))
