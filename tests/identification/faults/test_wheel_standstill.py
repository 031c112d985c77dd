"""Wheels that stand still at commands that were followed before are a fault; those of a dead band are not."""

import numpy as np
import pytest

from vehicle.identification.faults.steering_evidence import STEP_S, SteeringEvidence, follow_command
from vehicle.identification.faults.wheel_standstill import Standstill, find_faulty_standstills, measure_unrest
from vehicle.identification.logs.schema import Array

TIME = STEP_S * np.arange(900)


def build_segment(seed: int, size_deg: float, still: slice | None = None, band_deg: float = 0.0) -> SteeringEvidence:
    """A drive of 90 s with a new command every 4 s; the wheels stand in the rows `still`, and inside a dead band."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-size_deg, size_deg, 23), 40)[:900]
    followed, wheel = command.copy(), np.empty(900)
    for row in range(1, 900):
        moves = abs(command[row] - followed[row - 1]) > band_deg
        followed[row] = command[row] if moves else followed[row - 1]
    wheel = follow_command(followed, 0.1, 16.0, 0.15)
    if still is not None:
        wheel[still] = wheel[still.start]
    wheel = np.round(wheel + 0.03 * rng.standard_normal(900), 2)
    usual, nothing = follow_command(command, 0.1, 16.0, 0.15), np.full(900, np.nan)
    pace = np.full(900, 1.4)
    return SteeringEvidence(TIME, pace, nothing, command, wheel, command, command, usual, 0.0, True, nothing, nothing)


def find(*segments: SteeringEvidence) -> list[list[Standstill]]:
    return [found for parts in find_faulty_standstills([[segment] for segment in segments]) for found in parts]


@pytest.mark.parametrize("size_deg", [2.5, 8.0, 25.0])
@pytest.mark.parametrize("first_s", [22.0, 45.0])
def test_wheels_that_stop_are_found_with_their_onset(size_deg: float, first_s: float) -> None:
    first = round(first_s / STEP_S)
    found = find(build_segment(1, size_deg), build_segment(2, size_deg, slice(first, first + 250)))
    assert found[0] == [] and len(found[1]) == 1
    assert TIME[found[1][0].first] <= first_s + 0.3 and found[1][0].shown * STEP_S >= first_s
    assert 0.5 * (found[1][0].first + found[1][0].shown) * STEP_S == pytest.approx(first_s, abs=5.0)
    assert found[1][0].last * STEP_S == pytest.approx(first_s + 25.0, abs=4.5)


@pytest.mark.parametrize("band_deg", [0.0, 0.5, 1.5, 2.5])
def test_a_dead_band_is_no_fault_even_in_one_run_alone(band_deg: float) -> None:
    with_band = [build_segment(seed, 4.0, None, band_deg) for seed in range(3)]
    assert not any(find(*with_band)) and not any(find(build_segment(5, 4.0), build_segment(6, 4.0), with_band[0]))


def test_a_wire_that_comes_loose_now_and_then_is_found_each_time() -> None:
    loose: list[slice] = [slice(200, 300), slice(420, 520), slice(700, 800)]
    segment = build_segment(3, 15.0)
    wheel: Array = np.array(segment.wheel)
    for part in loose:
        wheel[part] = wheel[part.start]
    assert segment.wheel is not None
    segment.wheel[:] = wheel
    found = find(build_segment(4, 15.0), build_segment(7, 15.0), segment)
    assert not found[0] and not found[1] and len(found[2]) == len(loose)


def test_wheels_that_nobody_steers_and_a_tractor_that_stands_show_nothing() -> None:
    still = build_segment(8, 8.0, slice(0, 900))
    assert not any(find(still))
    parked = build_segment(9, 8.0, slice(300, 600))
    parked.pace[290:610] = 0.0
    assert not any(find(parked, build_segment(10, 8.0)))


def disturb(segment: SteeringEvidence, seed: int) -> SteeringEvidence:
    """The same with a hand that holds on to the wheel: 1 deg, slowly to and fro."""
    rng, hand = np.random.default_rng(seed), 0.0
    assert segment.wheel is not None
    for row in range(900):
        hand += -hand * STEP_S / 4.0 + np.sqrt(2.0 * STEP_S / 4.0) * rng.standard_normal()
        segment.wheel[row] += hand
    return segment


def test_wheels_that_a_hand_disturbs_show_no_standstill_by_less_than_it_does() -> None:
    calm = [build_segment(seed, 8.0) for seed in range(4)]
    unrest_deg = measure_unrest([disturb(build_segment(seed, 8.0), seed) for seed in range(4)])
    assert measure_unrest(calm) < 0.5 and unrest_deg == pytest.approx(4.0, rel=0.35) and measure_unrest([]) == 0.0
    still = [[calm[0]], [build_segment(5, 2.5, slice(400, 700))]]
    assert any(find_faulty_standstills(still)[1]) and not any(find_faulty_standstills(still, unrest_deg)[1])
