"""The fifth reference against closed forms, its drivers against arcs, its instruments against what they add."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.truth import fifth, fifth_body, fifth_cases
from tests.truth.cases import Law, TruthCase
from tests.truth.fifth_drivers import HOLD, PERSON, PURSUE, STANLEY, lay_parts
from tests.truth.fifth_sensors import draw_markov, follow_play, swing_rows
from tests.truth.ground import EG105, measure_curvature, measured_curvature

pytestmark = pytest.mark.matrix
"""In CI nothing is diagnosed by this reference, which takes long to compile."""


def bend_of(rows: np.ndarray, from_s: float) -> float:
    return measure_curvature(rows[int(from_s / 0.005) :], fifth_body.REAR)


def find_law(angle_deg: float) -> float:
    return measured_curvature(angle_deg, EG105)


Part = tuple[float, float, float, float, float, float]
PACE = 1.4


def hold(angle_deg: float, speed: float = PACE, tool: float = 0.0) -> Part:
    return (HOLD, 22.0, angle_deg, 0.0, speed, tool)


def drive(effects: dict[str, dict[str, float]], *parts: Part, **fields: object) -> np.ndarray:
    case = TruthCase("clean", 3, effects, **fields)  # type: ignore[arg-type]
    return fifth.drive_run(case, lay_parts(*parts), 70.0, 0, quiet=True)


def find_bend(effects: dict[str, dict[str, float]], *parts: Part) -> float:
    return bend_of(drive(effects, *parts), 12.0)


@pytest.mark.parametrize("angle_deg", [2.0, 8.0, 20.0])
def test_a_slow_circle_has_the_radius_of_its_geometry(angle_deg: float) -> None:
    """Ackermann: the rear axle's middle at wheelbase / tan(angle), the centre of mass a little further out."""
    rows = fifth.drive_alone(math.radians(angle_deg), 0.4, 26.0)
    radius = math.hypot(fifth_body.BASE / math.tan(math.radians(angle_deg)), fifth_body.REAR)
    assert bend_of(rows, 12.0) * radius == pytest.approx(1.0, rel=2e-3)


def test_a_drive_of_half_as_fast_a_circle_slips_a_quarter() -> None:
    """What tyres lose grows with the square of speed: alike in front and behind, it stays below a hundredth."""
    bends = [bend_of(fifth.drive_alone(0.2, speed, 30.0), 16.0) for speed in (0.3, 1.1, 2.2)]
    slow, fast = (1.0 - bend / bends[0] for bend in bends[1:])
    assert 0.0 < fast < 0.01 and slow / fast == pytest.approx(0.25, abs=0.06)


@pytest.mark.parametrize("angle_deg", [-24.0, -10.0, 4.0, 16.0])
def test_circles_have_the_measured_radius(angle_deg: float) -> None:
    wheel = drive({}, hold(angle_deg))[-1, fifth_body.MOTOR]
    assert abs(wheel - angle_deg) < 0.12  # the dead band
    assert find_bend({}, hold(angle_deg)) == pytest.approx(find_law(wheel), rel=5e-3)
    back = find_bend({}, hold(angle_deg, -0.85))
    assert -back == pytest.approx(find_law(wheel), rel=1e-2)


def test_energy_and_speed_are_sane() -> None:
    """No speed beyond the command, none gained while the drive is at rest, and none left at a halt."""
    rows = drive({}, hold(0.0), (HOLD, 10.0, 15.0, 0.0, 0.0, 0.0))
    speed = rows[:, fifth_body.SPEED]
    assert speed.max() < 1.03 * PACE and speed[4300] == pytest.approx(PACE, rel=5e-3)
    assert np.all(np.diff(speed[4400:4900:20]) < 1e-3) and abs(speed[-1]) < 0.01
    assert np.isfinite(rows).all() and np.abs(rows[:, fifth_body.ROLL]).max() < 0.05


@pytest.mark.parametrize("driver", [PURSUE, STANLEY, PERSON])
@pytest.mark.parametrize("bend", [0.0, 0.02, -0.02])
def test_drivers_come_to_their_arc(driver: float, bend: float) -> None:
    parts = lay_parts((HOLD, 1.0, 0.0, 0.0, 0.0, 0.0), (driver, 30.0, 0.5, bend, PACE, 0.0))
    rows = fifth.drive_run(TruthCase("clean", 3), parts, 90.0, 0)[200:]
    x, y = rows[:, fifth_body.EAST] - rows[0, fifth_body.EAST], rows[0, fifth_body.NORTH] - rows[:, fifth_body.NORTH]
    off = 1.0 / bend - np.copysign(np.hypot(x, y - 1.0 / bend), bend) if bend else y
    assert np.abs(off[3000:-600] - 0.5).max() < (0.25 if driver == PERSON else 0.12)


def test_the_ground_and_an_axle_that_stands_askew_carry_the_tractor_aside() -> None:
    rows = drive({"cross_slope_drift": {"ratio": 0.03, "bearing_deg": 160.0}}, hold(0.0))[2000:]
    east, north = (rows[-1, k] - rows[0, k] for k in (fifth_body.EAST, fifth_body.NORTH))
    way = math.atan2(east, north) - math.radians(70.0)
    assert math.tan(way) == pytest.approx(0.03, rel=0.03)
    askew = (
        find_bend({}, hold(0.0)),
        bend_of(drive({}, hold(0.0), outside={"crab_axle": {"run": 0.0, "angle_deg": 1.0}}), 12.0),
    )
    assert askew[1] - askew[0] == pytest.approx(-math.radians(1.0) / fifth_body.BASE, rel=0.03)


def test_laws_govern() -> None:
    law = Law("steering_gain", "by_side", {"left": 0.8, "right": 1.0})
    left = bend_of(drive({}, hold(-12.0), laws=(law,)), 12.0)
    assert left == pytest.approx(0.8 * find_bend({}, hold(-12.0)), rel=0.01)


def test_instruments_swing_stick_and_wander_as_their_formulas() -> None:
    step = np.concatenate([np.zeros(10), np.ones(6000)])
    swung = swing_rows(step, 0.6, 0.1)
    assert swung.max() == pytest.approx(1.0 + math.exp(-math.pi * 0.1 / math.sqrt(0.99)), abs=0.02)
    assert follow_play(np.array([0.0, 2.0, 1.5, 0.0]), 1.0).tolist() == [0.0, 1.5, 1.5, 0.5]
    walk = draw_markov(np.random.default_rng(1), 4_000_000, 60.0)
    assert walk.std() == pytest.approx(1.0, abs=0.15)
    assert np.corrcoef(walk[:-12000], walk[12000:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.15)


def test_every_cause_outside_changes_a_log() -> None:
    parts = lay_parts(
        (HOLD, 8.0, 0.0, 0.0, PACE, 0.0), (HOLD, 8.0, 20.0, 0.0, 0.85, 1.0), (HOLD, 8.0, -9.0, 0, 2.2, 1.0)
    )
    assert set(fifth_cases.OUTSIDE) == {*fifth.OUTSIDE_BODY, *fifth.OUTSIDE_SENSORS} and len(fifth_cases.OUTSIDE) >= 12
    for name in fifth_cases.OUTSIDE:
        drawn = fifth_cases.draw_outside_case(name, np.random.default_rng(2), 4)
        spoilt = {key: {**values, "run": 3.0} if "run" in values else values for key, values in drawn.outside.items()}
        cases = (replace(drawn, outside={}, rate_hz=10.0), replace(drawn, outside=spoilt, rate_hz=10.0))
        plain, other = (fifth.log_run(case, "run", parts, 70.0, 3).to_numpy(float) for case in cases)
        assert other.shape == plain.shape and np.abs(other - plain).max() > 0.02, name
