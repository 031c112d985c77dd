"""The fourth reference against closed forms, the clocks of its messages, and that each cause changes what it should."""

import math

import numpy as np
import pytest

from tests.truth import fourth, fourth_body
from tests.truth.cases import ColumnClock, Law, TruthCase
from tests.truth.drives import Drive, constant, drive, stairs
from tests.truth.fourth_messages import EXACT, choose_messages
from tests.truth.ground import EG105, measure_curvature, measured_curvature
from tests.truth.laws import P_GAIN, P_OFFSET

pytestmark = pytest.mark.matrix
"""In CI nothing is diagnosed by this reference, which takes long to compile."""

PACE = 5.0 / 3.6


def hold(angle_deg: float, speed: float = PACE, tool: float = 0.0, seconds: float = 26.0) -> Drive:
    return drive("held", seconds, constant(angle_deg), speed, tool, bearing_deg=70.0)


def drive_case(effects: dict[str, dict[str, float]], run: Drive, **fields: object) -> fourth.Drawn:
    return fourth.draw_run(TruthCase("clean", 3, effects, **fields), run, 0, quiet=True)  # type: ignore[arg-type]


def find_curvature(drawn: fourth.Drawn, machine: str = "eg105", from_s: float = 12.0) -> float:
    return measure_curvature(drawn.rows[int(from_s / fourth.ROW_S) :], fourth.MASS_POINT_M[machine])


def find_law(angle_deg: float) -> float:
    return measured_curvature(angle_deg, EG105)


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


BEND = drive(
    "bend", 30.0, stairs((10.0, 0.0), (10.0, 10.0), (10.0, -10.0)), stairs((15.0, 1.4), (15.0, 2.0)), bearing_deg=30.0
)


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
    gains = drawn.parameters[[1000, 5000], P_GAIN]
    assert tuple(gains) == (1.0, 0.8)
    drifts = drive_case({}, tool, laws=(Law("steering_offset", "over_minutes", {"start": 1.0, "per_minute": 4.0}),))
    assert drifts.parameters[4000, P_OFFSET] == pytest.approx(1.0 + 4.0 * 20.0 / 60.0)
    bent = drive_case({}, BEND, laws=(Law("steering_gain", "by_side", {"left": 0.9, "right": 1.2}),))
    assert {0.9, 1.2} == set(bent.parameters[[3500, 5500], P_GAIN])


def test_the_autosteer_comes_to_its_line_and_sees_late() -> None:
    line = drive("line", 40.0, stairs((15.0, 0.8), (25.0, 0.0)), 1.4, bearing_deg=90.0, closed_loop=True)
    drawn = drive_case({}, line)
    north = drawn.rows[0, fourth_body.NORTH] - drawn.rows[:, fourth_body.NORTH]
    assert north[2700] == pytest.approx(0.8, abs=0.06) and abs(north[-700]) < 0.06
    aside = drive_case({"antenna_right": {"distance_m": 0.3}}, line)
    north = aside.rows[0, fourth_body.NORTH] - aside.rows[:, fourth_body.NORTH]
    assert north[-700] == pytest.approx(-0.3, abs=0.06)
