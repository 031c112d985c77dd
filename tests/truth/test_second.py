"""The second reference against closed forms, and that each effect changes what it should and nothing else."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.examples import draw_seed
from tests.truth import rolling
from tests.truth.drives import Drive, constant, drive, stairs, three_speeds_programme, triangle
from tests.truth.effects import CLEAR_SIZES, NEUTRAL
from tests.truth.second import EXACT, STEP_S, TRACTORS, Rolled, Second, second_logs
from tests.truth.signals import draw_coloured

PACE = 5.0 / 3.6
SIDES = [(name, angle) for name in TRACTORS for angle in (-30.0, -12.0, -3.0, 3.0, 12.0, 30.0)]


def quiet(effects: dict[str, dict[str, float]] | None = None, tractor: str = "eg105") -> Second:
    return Second(effects or {}, 0, tractor, roughness=0.0, receiver=EXACT)


def clear(name: str) -> dict[str, dict[str, float]]:
    return {name: CLEAR_SIZES[name]}


def held(angle_deg: float, speed: float = PACE, tool: float = 0.0, seconds: float = 40.0) -> Drive:
    return drive("held", seconds, constant(angle_deg), speed, tool, bearing_deg=70.0)


def mass_curvature(rolled: Rolled, after_s: float = 12.0, until_s: float = 1e9) -> float:
    """Curvature of the way of the centre of mass by the circle through three of its places."""
    rows = np.flatnonzero((rolled.time_s >= after_s) & (rolled.time_s <= until_s))
    east, north = rolled.point(rolling.REAR_TO_MASS_M, 0.0)
    a, b, c = (np.array([east[row], north[row]]) for row in (rows[0], rows[len(rows) // 2], rows[-1]))
    one, two = b - a, c - a
    area = one[1] * two[0] - one[0] * two[1]
    return float(2.0 * area / (np.hypot(*one) * np.hypot(*(c - b)) * np.hypot(*two)))


def law(tractor: str, angle_deg: float) -> float:
    curve = TRACTORS[tractor]
    c, p = (curve.right_c, curve.right_p) if angle_deg > 0.0 else (curve.left_c, curve.left_p)
    return math.copysign(c * abs(angle_deg) ** p / 118.4, angle_deg)


@pytest.mark.parametrize(("tractor", "angle"), SIDES)
def test_circles_have_the_measured_radius(tractor: str, angle: float) -> None:
    bend = law(tractor, angle)
    rolled = quiet(tractor=tractor).roll(held(angle))
    most = 12.0 + 2.0 / (abs(bend) * PACE)  # less than half a turn, or the three places say little
    assert mass_curvature(rolled, until_s=most) == pytest.approx(bend, rel=2e-3)


@pytest.mark.parametrize("tractor", TRACTORS)
def test_the_programme_reaches_a_friction_limit_of_the_clear_size_on_both_sides(tractor: str) -> None:
    for run in three_speeds_programme()[2:4]:
        rolled = quiet(tractor=tractor).roll(run)
        most = np.max(np.abs(rolled.speed_mps * rolled.column(rolling.YAW_RATE)))
        assert most > CLEAR_SIZES["side_slip"]["limit_g"] * rolling.GRAVITY


def test_the_programme_is_steady_in_the_step_of_integration() -> None:
    """A kinematic tractor must end where its heading says: the way is the integral of the speed along the heading."""
    rolled = quiet().roll(three_speeds_programme()[2])
    heading, speed = rolled.column(rolling.HEADING), rolled.speed_mps
    for axis, share in ((rolling.EAST, np.sin(heading)), (rolling.NORTH, np.cos(heading))):
        along = speed * share
        way = 0.5 * STEP_S * float(np.sum(along[1:] + along[:-1]))
        assert rolled.states[-1, axis] - rolled.states[0, axis] == pytest.approx(way, abs=1e-3)


def test_straight_ahead_is_straight() -> None:
    rolled = quiet().roll(held(0.0))
    east, north = rolled.point(0.0, 0.0)
    across = (east - east[0]) * math.cos(math.radians(70.0)) - (north - north[0]) * math.sin(math.radians(70.0))
    assert np.abs(across).max() < 1e-9
    assert rolled.column(rolling.WAY)[-1] == pytest.approx(40.0 * PACE - 0.5 * PACE**2 / 0.7, abs=0.7)


def wheel_after(size: float, name: str | None = None, **value: float) -> tuple[np.ndarray, np.ndarray]:
    """Seconds since a step of the command, and the wheel angle (deg)."""
    effects = {} if name is None else {name: value}
    rolled = quiet(effects).roll(drive("step", 8.0, stairs((1.0, 0.0), (7.0, size))))
    return rolled.time_s - 1.0, rolled.column(rolling.WHEEL)


@pytest.mark.parametrize("lag", [0.1, 0.35])
def test_a_small_step_follows_the_lag(lag: float) -> None:
    seconds, wheel = wheel_after(3.0, "steering_lag", time_s=lag)
    near = seconds[np.flatnonzero(wheel >= 3.0 * (1.0 - math.exp(-1.0)))[0]]
    assert near == pytest.approx(lag, abs=0.02)


@pytest.mark.parametrize("rate", [16.0, 8.0])
def test_a_large_step_goes_at_the_rate(rate: float) -> None:
    seconds, wheel = wheel_after(24.0, "steering_rate", rate_deg_per_s=rate)
    low, high = (seconds[np.flatnonzero(wheel >= angle)[0]] for angle in (4.0, 20.0))
    assert 16.0 / (high - low) == pytest.approx(rate, rel=0.02)
    assert wheel[-1] == pytest.approx(24.0, abs=0.11) and wheel.max() < 24.2


def test_dead_time_is_a_shift() -> None:
    _, plain = wheel_after(12.0)
    _, late = wheel_after(12.0, "steering_dead_time", time_s=0.25)
    assert np.allclose(late[50:], plain[:-50], atol=1e-9)


def test_dead_band_lets_small_commands_pass_unseen() -> None:
    rolled = quiet(clear("steering_deadband")).roll(drive("stairs", 12.0, stairs((4.0, 0.0), (4.0, 0.8), (4.0, 3.0))))
    wheel = rolled.column(rolling.WHEEL)
    assert np.abs(wheel[:1599]).max() == 0.0
    assert 3.0 - wheel[-1] == pytest.approx(0.9, abs=0.15)


def test_play_opens_between_the_sensor_and_the_path() -> None:
    """With play b the heading swings by as much as the amplitude less b / 2 would give, and late."""
    wave = drive("wave", 56.0, triangle(3.0, 14.0), PACE)
    swing = []
    for effects in ({}, clear("steering_backlash")):
        rolled = quiet(effects).roll(wave)
        rate = rolled.column(rolling.YAW_RATE)[4000:]
        swing.append(float(np.ptp(rate)))
    wanted = (law("eg105", 2.25) - law("eg105", -2.25)) / (law("eg105", 3.0) - law("eg105", -3.0))
    assert swing[1] / swing[0] == pytest.approx(wanted, rel=0.03)


def test_steering_effects_scale_and_shift_the_curve() -> None:
    offset = quiet({"steering_offset": {"angle_deg": -2.0}}).roll(held(0.0))
    assert mass_curvature(offset) == pytest.approx(law("eg105", -2.0), rel=3e-3)
    for angle in (-12.0, 12.0):
        until = 12.0 + 2.0 / (abs(law("eg105", angle)) * PACE)
        for name, factor in (("steering_gain", 1.08), ("steering_asymmetry", 1.10 if angle < 0.0 else 1.0)):
            rolled = quiet(clear(name)).roll(held(angle))
            assert mass_curvature(rolled, until_s=until) == pytest.approx(factor * law("eg105", angle), rel=3e-3)


def test_tyres_give_way_at_their_limit_and_not_before() -> None:
    for speed, share in ((3.0, 1.0), (0.8, None)):
        rolled = quiet(clear("side_slip")).roll(held(20.0, speed))
        pull = abs(rolled.column(rolling.YAW_RATE)[-1]) * speed
        if share is not None:
            assert pull == pytest.approx(0.08 * 9.80665, rel=0.02)
        else:
            free = quiet().roll(held(20.0, speed)).column(rolling.YAW_RATE)[-1] * speed
            assert pull == pytest.approx(free, rel=1e-3)


def test_understeer_takes_its_angle() -> None:
    rolled = quiet(clear("understeer")).roll(held(12.0, 2.0, seconds=30.0))
    rate = float(rolled.column(rolling.YAW_RATE)[-1])
    left = 12.0 - 2.0 * 2.0 * rate
    bend = law("eg105", left)
    assert rate == pytest.approx(2.0 * bend / math.sqrt(1.0 - (1.1 * bend) ** 2), rel=2e-3)


@pytest.mark.parametrize(("bearing", "right"), [(160.0, 1.0), (340.0, -1.0), (70.0, 0.0)])
def test_a_slope_carries_the_tractor_down(bearing: float, right: float) -> None:
    rolled = quiet({"cross_slope_drift": {"ratio": 0.03, "bearing_deg": bearing}}).roll(held(0.0))
    east, north = rolled.point(0.0, 0.0)
    across = (east - east[0]) * math.cos(math.radians(70.0)) - (north - north[0]) * math.sin(math.radians(70.0))
    assert across[-1] == pytest.approx(right * 0.03 * rolled.column(rolling.WAY)[-1], abs=1e-6)


def test_the_implement_acts_only_while_it_works() -> None:
    for name in ("implement_side_draft", "implement_slip"):
        up = [quiet(effects).log(held(4.0)) for effects in ({}, clear(name))]
        pd.testing.assert_frame_equal(*up)
    assert mass_curvature(quiet(clear("implement_side_draft")).roll(held(0.0, tool=1.0))) == pytest.approx(0.006, 3e-3)
    slip = quiet(clear("implement_slip")).roll(held(0.0, tool=1.0))
    assert slip.speed_mps[-1] == pytest.approx(0.9 * PACE, rel=1e-4)
    assert quiet(clear("wheel_slip")).roll(held(0.0)).speed_mps[-1] == pytest.approx(0.92 * PACE, rel=1e-4)


@pytest.mark.parametrize("lag", [0.6, 1.2, 2.0])
def test_speed_lag_is_the_way_that_is_lost(lag: float) -> None:
    """Lags in a row that are T together lose T times a change of speed on the way, whatever their order."""
    run = drive("faster", 40.0, constant(0.0), stairs((20.0, 1.0), (20.0, 1.2)), bearing_deg=0.0)
    way = quiet({"speed_lag": {"time_s": lag}}).roll(run).column(rolling.WAY)
    lost = 1.2 * 20.0 - float(way[-1] - way[round(20.0 / STEP_S)])
    assert lost / 0.2 == pytest.approx(lag, abs=0.05)


def test_the_drive_line_keeps_its_limits() -> None:
    rolled = quiet().roll(drive("go", 20.0, constant(0.0), stairs((10.0, 2.2), (10.0, 0.0))))
    pull, speed = rolled.column(rolling.ACCELERATION), rolled.speed_mps
    assert np.abs(pull).max() <= 0.7 + 1e-9
    assert np.abs(np.diff(pull)).max() / STEP_S <= 2.5 + 1e-6
    assert speed.max() < 2.2 * 1.03 and abs(speed[-1]) < 5e-3


def test_grip_changes_where_and_when_it_should() -> None:
    run = held(12.0, seconds=56.0)
    plain = quiet().roll(run)
    inside = {"grip_patch": {"ratio": 0.7, "east_m": 0.0, "north_m": 0.0, "radius_m": 200.0}}
    outside = {"grip_patch": {"ratio": 0.7, "east_m": 600.0, "north_m": 0.0, "radius_m": 200.0}}
    late = 12.0 + 2.0 / (law("eg105", 12.0) * PACE)
    assert mass_curvature(quiet(inside).roll(run), until_s=late) == pytest.approx(0.7 * law("eg105", 12.0), rel=3e-3)
    assert np.array_equal(quiet(outside).roll(run).states, plain.states)
    # The rear axle's curvature stands for the mass's: a tenth more makes a little more than a tenth.
    rate = [quiet(effects).roll(run).column(rolling.YAW_RATE)[-1] for effects in ({}, clear("grip_drift"))]
    assert rate[1] / rate[0] == pytest.approx(1.0 + 0.10 * 56.0 / 60.0, rel=0.01)


def test_the_receiver_is_moved_late_and_biased_as_said() -> None:
    run = three_speeds_programme()[2]
    plain = quiet().log(run)
    heading = np.radians(plain.heading_deg)
    for name, turn in (("antenna_forward", 0.0), ("antenna_right", 0.5 * math.pi)):
        moved, away = quiet(clear(name)).log(run), CLEAR_SIZES[name]["distance_m"]
        assert np.allclose(moved.easting_m - plain.easting_m, away * np.sin(heading + turn), atol=2e-3)
        assert np.allclose(moved.northing_m - plain.northing_m, away * np.cos(heading + turn), atol=2e-3)
    late = quiet(clear("gnss_latency")).log(run)
    assert np.allclose(late.easting_m[2:], plain.easting_m[:-2], atol=2e-3)
    assert np.array_equal(late.speed_mps, plain.speed_mps)
    turned = quiet(clear("heading_bias")).log(run)
    assert np.allclose((turned.heading_deg - plain.heading_deg) % 360.0, 1.5)


PLACE, PATH = {"easting_m", "northing_m"}, {"easting_m", "northing_m", "heading_deg"}
CHANGES = {
    **dict.fromkeys(set(CLEAR_SIZES), PATH),
    **dict.fromkeys(("steering_dead_time", "steering_lag", "steering_rate"), PATH | {"steering_deg"}),
    "steering_deadband": PATH | {"steering_deg"},
    **dict.fromkeys(("cross_slope_drift", "antenna_forward", "antenna_right"), PLACE),
    **dict.fromkeys(("wheel_slip", "implement_slip", "speed_lag"), PATH | {"speed_mps"}),
    "heading_bias": {"heading_deg"},
}


@pytest.mark.parametrize("name", sorted(CHANGES))
def test_an_effect_changes_its_columns_and_no_other(name: str) -> None:
    weave = stairs((6.0, 0.0), (8.0, 3.0), (8.0, -10.0), (8.0, 1.0), (8.0, 15.0))
    run = drive("weave", 38.0, weave, 2.2, 1.0, bearing_deg=70.0)
    plain, changed = (Second(effects, seed=5).log(run) for effects in ({}, clear(name)))
    assert {column for column in plain if not np.array_equal(plain[column], changed[column])} == CHANGES[name]


def test_neutral_effects_hide_nothing_and_seeds_fix_the_log() -> None:
    seed = draw_seed()
    runs = three_speeds_programme()[6:]
    first, again, neutral, other = (
        second_logs(effects, number, runs)
        for effects, number in (({}, seed), ({}, seed), (NEUTRAL, seed), ({}, seed + 1))
    )
    for one, two, three, four in zip(first, again, neutral, other, strict=True):
        pd.testing.assert_frame_equal(one, two)
        pd.testing.assert_frame_equal(one, three)
        assert not np.array_equal(one.easting_m, four.easting_m)


def test_instruments_and_ground_are_as_noisy_as_they_say() -> None:
    memory = draw_coloured(np.random.default_rng(1), 20000, 1.0, -1.0 / math.log(0.8))
    assert np.std(memory) == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(memory[:-1], memory[1:])[0, 1] == pytest.approx(0.8, abs=0.02)
    run = held(0.0)
    turns = [math.degrees(np.ptp(Second({}, seed, receiver=EXACT).roll(run).column(rolling.HEADING)[[0, -1]]))
             for seed in range(40)]  # fmt: skip
    # A curvature s remembered over L turns the heading by s sqrt(2 L d) on a way d.
    wanted = math.degrees(0.002 * math.sqrt(2.0 * 0.8 * 40.0 * PACE))
    assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(wanted, rel=0.35)
    frame, exact = (replaced.log(run) for replaced in (Second({}, 3, roughness=0.0), quiet()))
    assert np.std(np.diff(frame.speed_mps[60:])) == pytest.approx(0.015 * math.sqrt(2.0), rel=0.15)
    assert np.abs(np.diff(frame.time_s) - 0.1).max() < 0.025 and np.allclose(np.diff(exact.time_s), 0.1)


def test_the_closed_loop_keeps_to_its_line() -> None:
    run = three_speeds_programme()[7]
    rolled = quiet().roll(run)
    aside = -(rolled.column(rolling.EAST) - rolled.column(rolling.EAST)[0])  # driving south, right is west
    for moment, offset in ((13.9, 0.6), (29.9, -0.8), (43.9, 0.7)):
        assert aside[round(moment / STEP_S)] == pytest.approx(offset, abs=0.12)


def test_only_what_it_can_hide_is_hidden() -> None:
    with pytest.raises(ValueError, match="cannot hide wind_drift"):
        Second({"wind_drift": {"speed_mps": 0.1, "bearing_deg": 0.0}})
    with pytest.raises(ValueError, match="effect 'grip' is unknown"):
        Second({"grip": {"ratio": 0.5}}).log(held(0.0))


def test_it_shares_no_way_of_making_a_drive_with_the_first_reference() -> None:
    for name in ("rolling.py", "second.py"):
        text = (Path(__file__).parent / name).read_text(encoding="utf-8")
        assert "tests.truth.model import" not in text and "tests.truth.body" not in text
        assert "tests.truth.sensors" not in text
