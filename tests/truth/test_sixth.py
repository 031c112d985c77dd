"""The sixth reference does what it says: circles, effects one by one, its logger, its cases."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.truth import sixth, sixth_cases
from tests.truth.cases import KINDS, Law, TruthCase
from tests.truth.effects import NEUTRAL, Effects
from tests.truth.sixth_body import MAST, SENSOR, SPEED

pytestmark = pytest.mark.slow  # the first test compiles the machine, which takes some seconds
LAW = tomllib.loads((Path(__file__).parents[2] / "vehicle/data/eg105.toml").read_text("utf-8"))["radius"]["soil"]


def drive(effects: Effects, plan: object, **more: object) -> np.ndarray:
    case = TruthCase("clean", 3, effects, **more)  # type: ignore[arg-type]
    return sixth.drive_plan(case, np.array(plan, dtype=float), np.empty((0, 4)), quiet=True)


def hold(effects: Effects, angle: float, speed: float, tool: float = 0.0, **more: object) -> np.ndarray:
    return drive(effects, [[angle, speed, tool]] * 220, **more)


def find_bend(*arguments: object, **more: object) -> float:
    """Curvature (1/m) of the last 8 s of a held command."""
    end = hold(*arguments, **more)[-1600:]  # type: ignore[arg-type]
    return float((end[-1, 2] - end[0, 2]) / np.hypot(np.diff(end[:, 0]), np.diff(end[:, 1])).sum())


def follow_law(angle: float) -> float:
    """Curvature (1/m) of the tractor file at a wheel angle (deg)."""
    factor, power = LAW["right" if angle > 0 else "left"]
    return math.copysign(factor * abs(angle) ** power / 118.4, angle)


@pytest.mark.parametrize("angle", [-27.0, -15.0, -5.0, 5.0, 15.0, 27.0])
def test_circles_have_the_radius_of_the_file(angle: float) -> None:
    assert find_bend({}, angle, 0.8) == pytest.approx(follow_law(hold({}, angle, 0.8)[-1, SENSOR]), rel=0.012)
    assert find_bend({}, angle, 1.8) == pytest.approx(find_bend({}, angle, 0.8), rel=0.015)


def test_effects_of_the_steering_geometry_show() -> None:
    assert find_bend({"steering_offset": {"angle_deg": -3.0}}, 0.0, 1.0) == pytest.approx(follow_law(-3.0), rel=0.02)
    for name, values, left, right in (
        ("steering_gain", {"ratio": 1.1}, 1.1, 1.1), ("steering_asymmetry", {"ratio": 1.1}, 1.1, 1.0),
        ("grip_patch", {"ratio": 0.8, "radius_m": 90.0}, 0.8, 0.8), ("grip_drift", {"per_minute": -0.3}, 0.91, 0.91),
        ("steering_backlash", {"angle_deg": 2.0}, follow_law(-11) / follow_law(-12), follow_law(11) / follow_law(12)),
    ):  # fmt: skip
        for angle, factor in ((-12.0, left), (12.0, right)):
            bent = find_bend({name: values}, angle, 1.0) / find_bend({}, angle, 1.0)
            assert bent == pytest.approx(factor, rel=4e-3)
    assert find_bend({"side_slip": {"limit_g": 0.07}}, 18.0, 2.8) * 2.8**2 / 9.81 == pytest.approx(0.07, rel=0.05)
    bend = find_bend({"understeer": {"deg_per_mps2": 2.5}}, 12.0, 2.5)
    assert bend == pytest.approx(follow_law(12.0 - 2.5 * bend * 2.5**2), rel=0.02)


def test_effects_of_the_steering_motion_show() -> None:
    def rise(name: str, key: str, value: float, size: float = 20.0) -> np.ndarray:
        return drive({name: {key: value}}, [[size * (k >= 20), 1.0, 0.0] for k in range(60)])[:, SENSOR]

    start = [np.argmax(rise("steering_dead_time", "time_s", late) > 0.5) * 0.005 - 2.0 for late in (0.0, 0.3)]
    assert start == pytest.approx([0.05, 0.35], abs=0.02)
    angle = rise("steering_rate", "rate_deg_per_s", 8.0)
    assert 10.0 / (np.argmax(angle > 15.0) - np.argmax(angle > 5.0)) / 0.005 == pytest.approx(8.0, rel=0.03)
    assert rise("steering_deadband", "angle_deg", 1.5)[-1] == pytest.approx(18.5, abs=0.2)
    for lag in (0.1, 0.5):
        rows = np.argmax(rise("steering_lag", "time_s", lag, 4.0) > 4.0 * (1.0 - math.exp(-1.0)))
        assert rows * 0.005 - 2.0 == pytest.approx(lag, abs=0.03)


def test_side_draft_and_slip_come_with_the_implement() -> None:
    draft: Effects = {"implement_side_draft": {"curvature_per_m": 0.006}}
    assert [find_bend(draft, 0.0, 1.5, tool) for tool in (1.0, 0.0)] == pytest.approx([0.006, 0.0], abs=2e-4)
    for name, up, down in (("steering_gain", 2.0, 2.0), ("wheel_slip", 1.8, 1.8), ("implement_slip", 2.0, 1.8)):
        driven = [hold({name: {"ratio": 0.1}}, 0.0, 2.0, tool)[-1, SPEED] for tool in (0.0, 1.0)]
        assert driven == pytest.approx([up, down], rel=5e-3)
    slow = [np.argmax(hold({"speed_lag": {"time_s": lag}}, 0.0, 1.0)[:, SPEED] > 0.63) * 0.005 for lag in (0.0, 1.5)]
    assert slow[0] < 1.2 and 1.45 < slow[1] < 2.0


def test_a_slope_drags_sideways_and_laws_and_outsiders_act() -> None:
    rows = hold({"cross_slope_drift": {"ratio": 0.04, "bearing_deg": 0.0}}, 0.0, 1.5)
    way, north, east = rows[-1, :2] - rows[1000, :2], math.cos(rows[0, 2]), math.sin(rows[0, 2])
    assert (way[0] * north - way[1] * east) / np.hypot(*way) == pytest.approx(-0.04 * east, abs=1e-3)
    law = Law("steering_gain", "by_speed", {"at_0": 1.2, "per_mps": -0.1})
    assert find_bend({}, 12.0, 1.0, laws=(law,)) > 1.08 * find_bend({}, 12.0, 2.0, laws=(law,))
    sway = {"mast_sway": {"m_per_mps2": 0.1, "hertz": 0.8}}
    assert -0.09 < hold({}, 12.0, 2.5, outside=sway)[-1, MAST] < -0.02
    for values in ({"crosswind": {"force_n": 6000.0, "bearing_deg": 90.0}}, {"soft_tyre": {"moment_nm": 1500.0}},
                   {"steering_hunt": {"angle_deg": 2.0, "period_s": 3.0}}):  # fmt: skip
        assert np.hypot(*(hold({}, 0.0, 2.0, outside=values) - hold({}, 0.0, 2.0))[-2000:, :2].T).max() > 0.2


@pytest.mark.parametrize("programme", sixth.PROGRAMMES)
def test_the_log_has_the_antenna_late_and_off_and_the_heading_biased(programme: str) -> None:
    def log(name: str = "antenna_right", key: str = "distance_m", value: float = 0.0) -> np.ndarray:
        frame = sixth.make_run(TruthCase("clean", 8, {name: {key: value}}, programme=programme), 1)
        return frame[["easting_m", "northing_m", "heading_deg", "speed_mps"]].dropna().to_numpy()[100:]

    plain, cos, sin = log(), np.cos(np.radians(log()[:, 2])), np.sin(np.radians(log()[:, 2]))
    late = np.hypot(*(plain - log("gnss_latency", "time_s", 0.3))[:, :2].T)
    ahead, right = log("antenna_forward", value=0.5) - plain, log(value=-0.2) - plain
    for values, size in ((late / plain[:, 3], 0.3), (ahead[:, 0] * sin + ahead[:, 1] * cos, 0.5),
                         (right[:, 0] * cos - right[:, 1] * sin, -0.2),
                         (log("heading_bias", "angle_deg", 2.0)[:, 2] - plain[:, 2], 2.0)):  # fmt: skip
        assert np.median(values) == pytest.approx(size, abs=0.015)


def test_a_seed_repeats_its_logs_and_two_have_all_effects() -> None:
    logs, again, other = (sixth.make_sixth_logs(TruthCase("clean", k, programme="nearest")) for k in (5, 5, 6))
    assert [one.to_csv() for one in logs] == [one.to_csv() for one in again] and not logs[0].equals(other[0])
    assert all(60.0 <= np.ptp(one["time_s"]) <= 120.0 and one.notna().mean().min() > 0.34 for one in logs)
    cases = sixth_cases.draw_sixth_cases(2) + sixth_cases.draw_sixth_cases(3, KINDS)
    assert {name for case in cases if case.kind == "effect" and case.wanted for name in case.effects} == set(NEUTRAL)
    assert 46 <= len(cases) == len({case.seed for case in cases}) and all(one.wanted <= one.allowed for one in cases)
    assert min(sixth.make_run(case, 2)["speed_mps"].max() for case in cases) > 1.0
