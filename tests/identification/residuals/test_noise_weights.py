"""Noise told from logs, against noise that was put there."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.identification.analytic_drives import QUIET, circle, course, course_of, measured, rig
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.residuals.noise_floor import (
    _draw_unknown_turns,
    add_instrument_noise,
    add_soil_noise,
    draw_coloured_noise,
)
from vehicle.identification.residuals.noise_weights import (
    DROWNED_SHARE,
    FEWEST_DIFFERENCES,
    SpanEstimate,
    _estimate_soil,
    _find_known_turns,
    _select_least,
    estimate_first_noise,
    estimate_soil_and_speed_noise,
    estimate_white_noise,
)
from vehicle.identification.residuals.unknown_turns import (
    ANGLE_FIRST,
    COMMAND_FIRST,
    LEAST_UNKNOWN_SHARE,
    compute_integrated_variance,
    compute_most_unknown_turns,
    compute_unknown_turns,
    estimate_unknown_turns,
)

SOIL_TURNS_SHARE = 0.3  # of the most that is unknown
LONG = ((150.0, 0.0, 1.0, 0.0),)


@pytest.mark.parametrize("uneven", [False, True])
def test_white_noise_on_a_parabola(uneven: bool) -> None:
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.05, 0.15, 5000) if uneven else np.full(5000, 0.1))
    smooth = 3.0 + 2.0 * time - 0.01 * time**2
    assert estimate_white_noise(time, smooth + 0.02 * rng.standard_normal(5000)) == pytest.approx(0.02, rel=0.05)
    assert estimate_white_noise(time, smooth) < 1e-6


def test_the_first_noise_is_that_of_positions_and_headings() -> None:
    rng = np.random.default_rng(4)
    frame = circle(0.02, 120.0)
    for name, size in (("easting_m", 0.015), ("northing_m", 0.015), ("heading_deg", 0.2)):
        frame[name] += size * rng.standard_normal(len(frame))
    noise = estimate_first_noise(course(frame))
    assert noise.position == pytest.approx(0.015, rel=0.1)
    assert noise.heading == pytest.approx(math.radians(0.2), rel=0.1)
    unseen = estimate_first_noise(course(frame.drop(columns="heading_deg")))
    assert unseen.heading > 100.0, "a heading that was not measured says nothing"


def test_coloured_noise_has_unit_size_and_the_memory_it_is_given() -> None:
    drawn = draw_coloured_noise(np.random.default_rng(5), np.full(40000, 0.8))
    assert drawn.std() == pytest.approx(1.0, rel=0.05)
    assert float(drawn[:-1] @ drawn[1:]) / float(drawn @ drawn) == pytest.approx(0.8, abs=0.02)


def test_soil_turns_and_keeps_the_way() -> None:
    """Rough ground changes the direction of every step, not its length; no soil changes nothing."""
    states = np.zeros((600, 5))
    states[:, 0], states[:, 4] = 0.025 * np.arange(600), 1.5
    assert np.array_equal(add_soil_noise(QUIET, states, np.random.default_rng(1)), states)
    rough = add_soil_noise(replace(QUIET, soil=0.01), states, np.random.default_rng(1))
    steps = np.diff(rough[:, :2], axis=0)
    assert np.hypot(*steps.T) == pytest.approx(np.full(599, 0.025))
    assert np.arctan2(steps[:, 1], steps[:, 0]) == pytest.approx(rough[:-1, 2])
    assert np.abs(rough[:, 2]).max() > 0.001


def test_instruments_have_the_noise_they_are_given() -> None:
    quiet = measured(LONG)
    states = np.column_stack([np.zeros((9000, 4)), np.full(9000, 1.5)])
    noise = replace(QUIET, position=0.02, heading=0.003)
    shown = add_instrument_noise(rig(), noise, quiet, states, {}, np.random.default_rng(2))[0]
    assert shown.east.std() == pytest.approx(0.02, rel=0.1) and shown.heading.std() == pytest.approx(0.003, rel=0.1)
    assert abs(float(shown.north.mean())) < 0.005


@pytest.mark.parametrize("soil", [0.0015, 0.004])
def test_soil_is_told_from_quick_turns(soil: float) -> None:
    """What is drawn with a soil is told to have it: the closed form of the variance of second differences."""
    noise = replace(QUIET, soil=soil, heading=1e-4, position=1e-3)
    runs = course_of(*(measured(LONG, noise, seed=run, run=run) for run in range(4)))
    told = estimate_soil_and_speed_noise(runs, rig(), estimate_first_noise(runs), {})
    assert told.soil == pytest.approx(soil, rel=0.2)
    assert told.position == estimate_first_noise(runs).position


def test_a_span_that_instruments_drown_tells_nothing_of_the_soil() -> None:
    """The least of those that tell; where none does, the longest, in which instruments have the smallest part."""
    drowned, clear = DROWNED_SHARE + 0.01, DROWNED_SHARE - 0.01
    assert _select_least([SpanEstimate(1.0, drowned), SpanEstimate(3.0, clear), SpanEstimate(2.0, clear)]) == 2.0
    assert _select_least([SpanEstimate(1.0, drowned), SpanEstimate(2.0, drowned), SpanEstimate(3.0, drowned)]) == 3.0


def test_noisy_headings_do_not_pass_for_smooth_soil() -> None:
    """At 10 Hz and 0.12 degrees the instruments make up three quarters of what is seen over a second."""
    noise = replace(QUIET, soil=0.0025, heading=0.0021, position=0.01)
    for seed in range(3):
        runs = course_of(*(measured(LONG, noise, seed=10 * seed + run, run=run) for run in range(4)))
        assert estimate_soil_and_speed_noise(runs, rig(), estimate_first_noise(runs), {}).soil == pytest.approx(
            0.0025, rel=0.25
        )


def test_headings_made_of_positions_tell_no_soil() -> None:
    noise = replace(QUIET, soil=0.004, heading=1e-4, position=1e-3)
    seen = [measured(LONG, noise, seed=run, run=run) for run in range(4)]
    some = course_of(*seen[:2], *(replace(one, heading_measured=False) for one in seen[2:]))
    none = course_of(*(replace(one, heading_measured=False) for one in seen))
    assert (
        estimate_soil_and_speed_noise(none, rig(), estimate_first_noise(none), {}).soil
        == estimate_first_noise(none).soil
        == 0.0025
    )
    assert estimate_soil_and_speed_noise(some, rig(), estimate_first_noise(some), {}).soil == pytest.approx(
        0.004, rel=0.2
    )


def test_a_drive_too_short_leaves_the_noise_as_it_was() -> None:
    runs = course_of(measured(((6.0, 0.0, 1.0, 0.0),)))
    noise = replace(QUIET, soil=0.123)
    assert estimate_soil_and_speed_noise(runs, rig(), noise, {}) == noise


def knotted(every: int) -> tuple[DriveSegment, np.ndarray, list[tuple[int, int]]]:
    """A drive whose wheel angle was measured in every so many rows, turns whose rate changes by 0.1 rad/s in each gap,
    and the gaps."""
    shown = measured(((30.0, 5.0, 1.0, 0.0),))
    is_knot = np.arange(shown.rows) % every == 0
    is_knot[-1] = True
    knots = np.flatnonzero(is_knot)
    rates = np.interp(np.arange(shown.rows), knots, 0.05 * (-1.0) ** np.arange(len(knots)))
    gaps = [(int(first), int(last)) for first, last in pairwise(knots)]
    shown = replace(shown, wheel=rates.copy(), measured_rows={"angle": is_knot})
    return shown, rates[:-1] * np.diff(shown.time), gaps


def test_turns_are_unknown_as_if_wheels_move_at_any_time_between_two_measured_angles() -> None:
    """Steps at times drawn evenly over a second, against the line from one rate to the next: r T / sqrt(12)."""
    variances = compute_unknown_turns(*knotted(10))
    moments = np.random.default_rng(3).uniform(0.0, 1.0, 20_000)
    drawn = 0.05 * moments - 0.05 * (1.0 - moments)
    assert float(variances[10:20].sum()) == pytest.approx(np.var(drawn), rel=0.03)


@pytest.mark.parametrize("is_even", [True, False])
def test_headings_tell_how_evenly_wheels_moved(is_even: bool) -> None:
    """Where headings turn as simulated, little is unknown; where each gap is off by the deviation of steps, all is."""
    segment, turns, gaps = knotted(10)
    most = compute_unknown_turns(segment, turns, gaps)
    off = np.zeros(segment.rows - 1)
    for number, (first, last) in enumerate(gaps):
        off[first] = (-1.0) ** number * np.sqrt(most[first:last].sum())
    heading = np.append(0.0, np.cumsum(turns if is_even else turns + off))
    shown = replace(segment, heading=heading)
    (found,) = estimate_unknown_turns(course_of(shown), [turns], QUIET, ("angle", "command"))
    assert found == pytest.approx((LEAST_UNKNOWN_SHARE if is_even else 1.0) * most, rel=1e-6)
    every_row = replace(shown, measured_rows={})
    both = estimate_unknown_turns(course_of(shown, every_row), [turns] * 2, QUIET, ANGLE_FIRST)
    assert np.array_equal(both[0], found) and not both[1].any()
    assert not estimate_unknown_turns(course_of(every_row), [turns], QUIET, ("angle", "command"))[0].any()


def test_what_the_soil_turns_is_not_unknown_as_well() -> None:
    """Headings missed by no more than the soil turns leave nothing unknown of the wheels."""
    segment, turns, gaps = knotted(10)
    most, rng = compute_unknown_turns(segment, turns, gaps), np.random.default_rng(6)
    pushes = np.sqrt(most.mean() * SOIL_TURNS_SHARE) * rng.standard_normal(len(turns))
    shown = replace(segment, heading=np.append(0.0, np.cumsum(turns + pushes)))
    runs = course_of(shown)
    soil = math.sqrt(SOIL_TURNS_SHARE * float(most[:10].sum()) / compute_integrated_variance(1.0))
    without, known = (
        estimate_unknown_turns(runs, [turns], replace(QUIET, soil=one), ANGLE_FIRST)[0][0] / most[0]
        for one in (0.0, soil)
    )
    assert without == pytest.approx(SOIL_TURNS_SHARE, rel=0.5) and known < 0.5 * without


def test_a_column_that_stands_still_leaves_nothing_unknown_however_long() -> None:
    segment, turns, _ = knotted(10)
    rows = np.arange(segment.rows)
    standing = replace(
        segment, wheel=np.where(rows < 100, 0.0, 0.1), measured_rows={"angle": np.isin(rows, (0, 99, 109, 299))}
    )
    (variances,) = compute_most_unknown_turns(course_of(standing), [turns * (1.0 + rows[:-1])], ANGLE_FIRST)
    assert np.flatnonzero(variances).tolist() == [*range(99, 109)]


def test_what_a_slow_column_leaves_unknown_is_no_soil() -> None:
    """Second differences in which wheels move by guess do not count; where wheels always move, the least unknown do."""
    rng = np.random.default_rng(7)
    unknown = np.where(np.arange(900) % 3 == 0, 0.0, 4e-4)
    turn = 0.005 * rng.standard_normal(900) + np.sqrt(unknown) * rng.standard_normal(900)
    pace = np.full(900, 1.2)
    alone = _estimate_soil(turn[unknown == 0.0], unknown[unknown == 0.0], pace[unknown == 0.0], 0.001, 2.0)
    assert _estimate_soil(turn, unknown, pace, 0.001, 2.0) == alone
    assert alone.value < 0.5 * _estimate_soil(turn, np.zeros(900), pace, 0.001, 2.0).value
    assert len(_find_known_turns(turn, unknown + 1.0)) == FEWEST_DIFFERENCES


def test_wheels_that_follow_later_miss_a_part_of_the_turn_in_the_next_gap() -> None:
    """A command that was seen to change in one gap, and wheels that turn the tractor in the one after."""
    segment = knotted(10)[0]
    rates = np.where(np.arange(segment.rows) < 110, 0.0, 0.1)
    obeyed = np.interp(np.arange(segment.rows), (99, 109), (0.0, 0.1))[:-1] * np.diff(segment.time)
    late = rates[:-1] * np.diff(segment.time)
    command = np.interp(np.arange(segment.rows), (99, 109), (0.0, 0.1))
    readings = np.isin(np.arange(segment.rows), (0, 99, 109, 119, segment.rows - 1))
    heading = np.append(0.0, np.cumsum(obeyed))
    shown = replace(segment, command=command, heading=heading, measured_rows={"command": readings})
    runs = course_of(shown)
    (found,) = estimate_unknown_turns(runs, [late], QUIET, COMMAND_FIRST, [obeyed])
    (unseen,) = estimate_unknown_turns(runs, [late], QUIET, COMMAND_FIRST)
    assert found[99:109].sum() == pytest.approx((heading[119] - late[:119].sum()) ** 2, rel=0.1)
    assert np.flatnonzero(found).tolist() == [*range(99, 109)] and not unseen.any()


def test_each_gap_turns_by_its_standard_deviation_to_a_drawn_side() -> None:
    """Two gaps of 1 s, the second begins with uneven rows, and then a column that stands still."""
    steps_s = np.array([0.1] * 10 + [0.05, 0.15] + [0.1] * 8 + [0.1] * 5)
    variances = np.array([4e-4] * 10 + [9e-4] * 10 + [0.0] * 5) * steps_s
    ends = np.array([_draw_unknown_turns(variances, steps_s, np.random.default_rng(seed)) for seed in range(40)])
    first, second, last = (np.diff(ends[:, [0, 10, 20, 25]], axis=1)).T
    assert np.abs(first) == pytest.approx(np.full(40, 0.02)) and np.abs(second) == pytest.approx(np.full(40, 0.03))
    assert not last.any() and len({*np.sign(first)}) == len({*np.sign(first * second)}) == 2
    assert np.abs(ends[:, 5]) == pytest.approx(np.full(40, 0.01))
    assert not _draw_unknown_turns(np.zeros(25), steps_s, np.random.default_rng(1)).any()
