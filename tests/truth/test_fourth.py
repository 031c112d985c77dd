"""The fourth reference against closed forms, the clocks of its messages, and that each cause changes what it should."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tests.truth import fourth, fourth_body
from tests.truth.cases import ColumnClock, Fault, Law, TruthCase
from tests.truth.drives import Drive, constant, drive, stairs
from tests.truth.fourth_messages import EXACT, choose_messages
from tests.truth.ground import EG105, measure_curvature, measured_curvature

pytestmark = pytest.mark.matrix
"""In CI nothing is diagnosed by this reference, which takes long to compile."""

PACE = 5.0 / 3.6
ANGLES = (-30.0, -12.0, -3.0, 3.0, 12.0, 30.0)


def hold(angle_deg: float, speed: float = PACE, tool: float = 0.0, seconds: float = 26.0) -> Drive:
    return drive("held", seconds, constant(angle_deg), speed, tool, bearing_deg=70.0)


def drive_case(effects: dict[str, dict[str, float]], run: Drive, **fields: object) -> fourth.Drawn:
    return fourth.draw_run(TruthCase("clean", 3, effects, **fields), run, 0, quiet=True)  # type: ignore[arg-type]


def find_curvature(drawn: fourth.Drawn, machine: str = "eg105", from_s: float = 12.0) -> float:
    return measure_curvature(drawn.rows[int(from_s / fourth.ROW_S) :], fourth.MASS_POINT_M[machine])


def find_law(angle_deg: float) -> float:
    return measured_curvature(angle_deg, EG105)


@pytest.mark.parametrize("angle", ANGLES)
def test_circles_have_the_measured_radius(angle: float) -> None:
    c, p = (0.4457377, 1.199) if angle > 0.0 else (0.3081049, 1.285)
    wanted = math.copysign(c * abs(angle) ** p / 118.4, angle)
    assert find_curvature(drive_case({}, hold(angle))) == pytest.approx(wanted, rel=5e-3)
    bent = find_curvature(drive_case({}, hold(angle), outside={"articulated": {"here": 1.0}}), "articulated")
    assert bent == pytest.approx(wanted, rel=1e-2)


@pytest.mark.parametrize("speed", [0.85, 2.2])
def test_circles_hardly_change_with_speed(speed: float) -> None:
    """Front and rear tyres are nearly alike, so a tractor without a fault turns the same at every pace."""
    for angle in (-12.0, 12.0):
        assert find_curvature(drive_case({}, hold(angle, speed))) == pytest.approx(find_law(angle), rel=0.03)


def test_a_drive_is_the_same_with_half_the_stiffness_of_its_step() -> None:
    """The way driven is that of speed and heading: what stiff springs add in between is small."""
    drawn = drive_case({}, hold(12.0))
    heading, speed = drawn.rows[:, fourth_body.HEADING], drawn.rows[:, fourth_body.SPEED]
    way = np.cumsum(speed) * fourth.ROW_S
    turned = (heading[-1] - heading[2400]) / (way[-1] - way[2400])
    rear = find_law(12.0) / math.sqrt(1.0 - (1.1 * find_law(12.0)) ** 2)
    assert turned == pytest.approx(rear, rel=0.02)


def test_straight_ahead_is_straight_and_at_the_commanded_speed() -> None:
    drawn = drive_case({}, hold(0.0))
    heading, bearing = drawn.rows[:, fourth_body.HEADING], math.radians(70.0)
    assert np.abs(heading - bearing).max() < 1e-9
    assert drawn.rows[-1, fourth_body.SPEED] == pytest.approx(PACE, rel=5e-3)


def test_every_effect_on_the_path_has_its_size() -> None:
    offset = find_curvature(drive_case({"steering_offset": {"angle_deg": -2.0}}, hold(0.0)))
    assert offset == pytest.approx(find_law(-2.0), rel=0.01)
    for angle in (-12.0, 12.0):
        gain = find_curvature(drive_case({"steering_gain": {"ratio": 1.1}}, hold(angle)))
        side = find_curvature(drive_case({"steering_asymmetry": {"ratio": 0.9}}, hold(angle)))
        assert gain == pytest.approx(1.1 * find_law(angle), rel=0.01)
        assert side == pytest.approx((0.9 if angle < 0.0 else 1.0) * find_law(angle), rel=0.01)
    draft = find_curvature(drive_case({"implement_side_draft": {"curvature_per_m": -0.006}}, hold(0.0, tool=1.0)))
    assert draft == pytest.approx(-0.006, rel=0.02)
    spoilt = find_curvature(drive_case({"grip_drift": {"per_minute": -0.3}}, hold(12.0)))
    assert spoilt == pytest.approx((1.0 - 0.3 * 20.5 / 60.0) * find_law(12.0), rel=0.02)


def test_soft_front_tyres_steer_less_the_faster() -> None:
    for speed, angle in ((1.4, 14.0), (2.2, 14.0)):
        plain, soft = (find_curvature(drive_case(effects, hold(angle, speed))) for effects in
                       ({}, {"understeer": {"deg_per_mps2": 2.0}}))  # fmt: skip
        less = 2.0 * soft * speed**2
        assert soft / plain == pytest.approx(find_law(angle - less) / find_law(angle), rel=0.02)


def test_tyres_slide_at_their_limit() -> None:
    drawn = drive_case({"side_slip": {"limit_g": 0.08}}, hold(30.0, 2.2))
    side = np.abs(drawn.rows[3000:, fourth_body.SIDE])
    free = np.abs(drive_case({}, hold(30.0, 2.2)).rows[3000:, fourth_body.SIDE])
    assert 0.9 * 0.08 * 9.81 < side.mean() < 1.08 * 0.08 * 9.81 < free.mean()


def test_ground_that_slides_carries_the_machine_down() -> None:
    """Downhill is to the right of the bearing: a share of every metre, while the heading stays."""
    drawn = drive_case({"cross_slope_drift": {"ratio": 0.03, "bearing_deg": 160.0}}, hold(0.0))
    rows, bearing = drawn.rows[1500:], math.radians(70.0)
    east, north = (rows[-1, k] - rows[0, k] for k in (fourth_body.EAST, fourth_body.NORTH))
    aside = east * math.cos(bearing) - north * math.sin(bearing)
    along = east * math.sin(bearing) + north * math.cos(bearing)
    assert aside / along == pytest.approx(0.03, rel=0.03)


def test_speed_is_lost_by_slip_and_late_by_its_lag() -> None:
    for effects, tool, share in (
        ({"wheel_slip": {"ratio": 0.08}}, 0.0, 0.92),
        ({"implement_slip": {"ratio": 0.1}}, 1.0, 0.9),
    ):
        drawn = drive_case(effects, hold(0.0, tool=tool))
        assert drawn.rows[-1, fourth_body.SPEED] == pytest.approx(share * PACE, rel=0.003)
    up = drive("up", 20.0, constant(0.0), stairs((8.0, 1.2), (12.0, 1.5)), bearing_deg=0.0)
    for lag, wanted in ((0.0, 0.35), (1.2, 1.2)):
        speed = drive_case({"speed_lag": {"time_s": lag}}, up).rows[:, fourth_body.SPEED]
        late = np.sum(1.5 - speed[1600:3600]) * fourth.ROW_S / 0.3
        assert late == pytest.approx(wanted, abs=0.12)


def find_wheel(size: float, effects: dict[str, dict[str, float]]) -> tuple[np.ndarray, np.ndarray]:
    drawn = drive_case(effects, drive("step", 8.0, stairs((2.0, 0.0), (6.0, size))))
    return drawn.time_s - 2.0, drawn.rows[:, fourth_body.MOTOR]


@pytest.mark.parametrize("lag", [0.1, 0.35])
def test_a_small_step_follows_the_lag(lag: float) -> None:
    seconds, wheel = find_wheel(3.0, {"steering_lag": {"time_s": lag}})
    assert seconds[np.flatnonzero(wheel >= 3.0 * (1.0 - math.exp(-1.0)))[0]] == pytest.approx(lag, abs=0.02)
    assert wheel[-1] == pytest.approx(3.0, abs=0.12)


@pytest.mark.parametrize("rate", [16.0, 8.0])
def test_a_large_step_goes_at_the_rate_and_dead_time_is_a_shift(rate: float) -> None:
    seconds, wheel = find_wheel(24.0, {"steering_rate": {"rate_deg_per_s": rate}})
    low, high = (seconds[np.flatnonzero(wheel >= angle)[0]] for angle in (4.0, 20.0))
    assert 16.0 / (high - low) == pytest.approx(rate, rel=0.03)
    _, late = find_wheel(24.0, {"steering_rate": {"rate_deg_per_s": rate}, "steering_dead_time": {"time_s": 0.25}})
    assert np.abs(late[450:1500] - wheel[400:1450]).max() < 0.2


def test_dead_band_and_play() -> None:
    _, wheel = find_wheel(0.8, {"steering_deadband": {"angle_deg": 1.0}})
    assert np.abs(wheel).max() == 0.0
    wave = drive("wave", 30.0, lambda time: 5.0 * np.sin(0.5 * time))
    rows = drive_case({"steering_backlash": {"angle_deg": 1.5}}, wave).rows[3000:]
    assert np.ptp(rows[:, fourth_body.MOTOR]) - np.ptp(rows[:, fourth_body.WHEEL]) == pytest.approx(1.5, abs=0.02)


def log_exact(run: Drive, **fields: object) -> pd.DataFrame:
    return fourth.log_run(TruthCase("clean", 3, **fields), run, 0, EXACT)  # type: ignore[arg-type]


BEND = drive(
    "bend", 30.0, stairs((10.0, 0.0), (10.0, 10.0), (10.0, -10.0)), stairs((15.0, 1.4), (15.0, 2.0)), bearing_deg=30.0
)


CELLS = {"position": ("easting_m", "northing_m"), "speed": ("speed_mps",), "steering": ("steering_deg",),
         "heading": ("heading_deg",)}  # fmt: skip


@pytest.mark.parametrize(("column", "names"), CELLS.items())
def test_a_column_is_late_early_or_held_and_no_other_is(column: str, names: tuple[str, ...]) -> None:
    plain = log_exact(BEND)
    for clock, rows in ((ColumnClock(delay_s=0.3), 3), (ColumnClock(offset_s=-0.2), -2)):
        moved = log_exact(BEND, columns={column: clock})
        for name in ("easting_m", "northing_m", "speed_mps", "steering_deg", "heading_deg"):
            shift = rows if name in names else 0
            now, then = moved[name].to_numpy()[20:280], plain[name].to_numpy()[20 - shift : 280 - shift]
            assert np.abs(now - then).max() < 2e-3
    held = log_exact(BEND, columns={column: ColumnClock(hold_s=0.5)})[names[0]].to_numpy()
    assert np.mean(np.diff(held[120:280]) == 0.0) >= 0.75


def test_the_low_pass_and_the_scale_of_a_column() -> None:
    plain = log_exact(BEND)
    slow = log_exact(BEND, columns={"steering": ColumnClock(filter_s=0.6)})["steering_deg"].to_numpy()
    late = np.sum(plain["steering_deg"].to_numpy()[95:195] - slow[95:195]) * 0.1 / 10.0
    assert late == pytest.approx(0.6, abs=0.03)
    high = log_exact(BEND, columns={"speed": ColumnClock(scale=1.07)})["speed_mps"]
    assert np.abs(high - 1.07 * plain["speed_mps"]).max() < 2e-3


def test_messages_come_at_their_pace() -> None:
    rows, rng = np.arange(0.0, 60.0, 0.1), np.random.default_rng(0)
    old = rows - choose_messages(rows, 0.05, ColumnClock(hold_s=2.0, hold_jitter=0.1, delay_s=0.3), EXACT, rng)
    assert old[40:].min() >= 0.3 - 1e-6 and old[40:].max() <= 0.3 + 2.2 + 0.01
    assert old[40:].mean() == pytest.approx(1.3, abs=0.15)
    drifting = rows - choose_messages(rows, 0.05, ColumnClock(drift_s_per_min=0.2), EXACT, rng)
    assert drifting[-1] - drifting[10] == pytest.approx(0.2, abs=0.06)


def test_laws_govern_their_parameter() -> None:
    tool = drive("tool", 30.0, constant(10.0), 1.4, stairs((15.0, 0.0), (15.0, 1.0)), bearing_deg=0.0)
    law = Law("steering_gain", "by_implement", {"lifted": 1.0, "working": 0.8})
    drawn = drive_case({}, tool, laws=(law,))
    gains = drawn.parameters[[1000, 5000], fourth_body.P_GAIN]
    assert tuple(gains) == (1.0, 0.8)
    drifts = drive_case({}, tool, laws=(Law("steering_offset", "over_minutes", {"start": 1.0, "per_minute": 4.0}),))
    assert drifts.parameters[4000, fourth_body.P_OFFSET] == pytest.approx(1.0 + 4.0 * 20.0 / 60.0)
    bent = drive_case({}, BEND, laws=(Law("steering_gain", "by_side", {"left": 0.9, "right": 1.2}),))
    assert {0.9, 1.2} == set(bent.parameters[[3500, 5500], fourth_body.P_GAIN])


def test_faults_begin_and_end() -> None:
    fault = Fault("steering_loose", 0, 11.0, 21.0)
    wheel = drive_case({}, BEND, faults=(fault,)).rows[:, fourth_body.MOTOR]
    assert abs(wheel[4100] - 10.0) < 0.2 and wheel[5900] < 0.0
    stuck = drive_case({}, BEND, faults=(Fault("steering_stuck", 0, 5.0, None, {"side": -1.0}),))
    assert stuck.rows[-1, fourth_body.MOTOR] == -fourth_body.LOCK_DEG
    frozen = log_exact(BEND, faults=(Fault("position_frozen", 0, 8.0, 12.0),))["easting_m"].to_numpy()
    assert np.ptp(frozen[81:119]) == 0.0 and np.ptp(frozen[125:140]) > 0.5
    feedback = log_exact(BEND, faults=(Fault("wheel_sensor_frozen", 0, 8.0),))["steering_deg"].to_numpy()
    assert np.ptp(feedback[81:]) == 0.0


def test_the_autosteer_comes_to_its_line_and_sees_late() -> None:
    line = drive("line", 40.0, stairs((15.0, 0.8), (25.0, 0.0)), 1.4, bearing_deg=90.0, closed_loop=True)
    drawn = drive_case({}, line)
    north = drawn.rows[0, fourth_body.NORTH] - drawn.rows[:, fourth_body.NORTH]
    assert north[2700] == pytest.approx(0.8, abs=0.06) and abs(north[-700]) < 0.06
    aside = drive_case({"antenna_right": {"distance_m": 0.3}}, line)
    north = aside.rows[0, fourth_body.NORTH] - aside.rows[:, fourth_body.NORTH]
    assert north[-700] == pytest.approx(-0.3, abs=0.06)


def test_logs_are_decided_by_their_seed() -> None:
    case = TruthCase("clean", 11, programme="one_speed")
    one, two, other = (fourth.make_fourth_logs(one) for one in (case, case, replace(case, seed=12)))
    assert all(a.equals(b) for a, b in zip(one, two, strict=True))
    assert not any(a.equals(b) for a, b in zip(one, other, strict=True))
    assert one[0].attrs["name"] == "bends_0" and np.isfinite(one[0].to_numpy(float)).all()
