"""The sixth reference does what it says: circles, effects one by one, its logger, its cases."""

import numpy as np
import pytest

from tests.truth import sixth, sixth_cases
from tests.truth.cases import KINDS, Law, TruthCase
from tests.truth.effects import NEUTRAL, Effects
from tests.truth.sixth_body import MAST

pytestmark = pytest.mark.slow  # the first test compiles the machine, which takes some seconds


def drive(effects: Effects, plan: object, **more: object) -> np.ndarray:
    case = TruthCase("clean", 3, effects, **more)  # type: ignore[arg-type]
    return sixth.drive_plan(case, np.array(plan, dtype=float), np.empty((0, 4)), quiet=True)


def hold(effects: Effects, angle: float, speed: float, tool: float = 0.0, **more: object) -> np.ndarray:
    return drive(effects, [[angle, speed, tool]] * 220, **more)


def find_bend(*arguments: object, **more: object) -> float:
    """Curvature (1/m) of the last 8 s of a held command."""
    end = hold(*arguments, **more)[-1600:]  # type: ignore[arg-type]
    return float((end[-1, 2] - end[0, 2]) / np.hypot(np.diff(end[:, 0]), np.diff(end[:, 1])).sum())


def test_laws_and_outsiders_act() -> None:
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


def test_logs_are_as_long_and_full_as_said_and_two_seeds_have_all_effects() -> None:
    logs = sixth.make_sixth_logs(TruthCase("clean", 5, programme="nearest"))
    assert all(60.0 <= np.ptp(one["time_s"]) <= 120.0 and one.notna().mean().min() > 0.34 for one in logs)
    cases = sixth_cases.draw_sixth_cases(2) + sixth_cases.draw_sixth_cases(3, KINDS)
    assert {name for case in cases if case.kind == "effect" and case.wanted for name in case.effects} == set(NEUTRAL)
    assert 46 <= len(cases) == len({case.seed for case in cases}) and all(one.wanted <= one.allowed for one in cases)
    assert min(sixth.make_run(case, 2)["speed_mps"].max() for case in cases) > 1.0
