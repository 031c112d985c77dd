"""What each body has of its own, against closed forms: loads, tyres, drive lines, drivers, and causes outside."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.truth import fifth, fifth_body, fourth, rolling, sixth, sixth_body, third_body
from tests.truth import third_run as run
from tests.truth.cases import Fault, Law, TruthCase
from tests.truth.drawing import draw_outside_case
from tests.truth.drives import constant, drive, stairs, three_speeds_programme
from tests.truth.effects import CLEAR_SIZES
from tests.truth.fifth_drivers import HOLD, PERSON, PURSUE, STANLEY, lay_parts
from tests.truth.fifth_outside import follow_play, swing_rows
from tests.truth.ground import EG105, measure_curvature, measured_curvature
from tests.truth.menus import FIFTH, THIRD
from tests.truth.recorder import Instruments
from tests.truth.second import EXACT, TRACTORS, Second
from tests.truth.test_machines import PACE, RIDES, hold
from tests.truth.third import Third, draw_waves
from tests.truth.third_drives import PROGRAMMES

matrix = pytest.mark.matrix
"""In CI nothing is diagnosed by the fourth and the fifth reference, which take long to compile."""
machines = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=matrix if name == "fourth" else ()) for name in ("first", "second", "fourth")]
)
LINE = drive("line", 40.0, stairs((15.0, 0.8), (25.0, 0.0)), PACE, bearing_deg=90.0, closed_loop=True)


@machines
def test_a_closed_loop_comes_to_its_line(name: str) -> None:
    """Driving east, right is south."""
    ride = RIDES[name]({}, LINE)
    aside = ride.north[0] - ride.north
    assert aside[np.searchsorted(ride.time_s, 14.8)] == pytest.approx(0.8, abs=0.12)
    assert aside[np.searchsorted(ride.time_s, 38.0)] == pytest.approx(0.0, abs=0.08)


# --- second --------------------------------------------------------------------------------------------------------


def quiet(tractor: str = "eg105") -> Second:
    return Second({}, 0, tractor, roughness=0.0, receiver=EXACT)


@pytest.mark.parametrize("tractor", TRACTORS)
def test_the_programme_reaches_a_friction_limit_of_the_clear_size_on_both_sides(tractor: str) -> None:
    for turn in three_speeds_programme()[2:4]:
        rolled = quiet(tractor).roll(turn)
        most = np.max(np.abs(rolled.speed_mps * rolled.column(rolling.YAW_RATE)))
        assert most > CLEAR_SIZES["side_slip"]["limit_g"] * rolling.GRAVITY


def test_the_ground_turns_as_much_as_it_says() -> None:
    """A curvature s remembered over L turns the heading by s sqrt(2 L d) on a way d."""
    turns = [math.degrees(np.ptp(Second({}, seed, receiver=EXACT).roll(hold(0.0)).column(rolling.HEADING)[[0, -1]]))
             for seed in range(40)]  # fmt: skip
    wanted = math.degrees(0.002 * math.sqrt(2.0 * 0.8 * 28.0 * PACE))
    assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(wanted, rel=0.35)


# --- third ---------------------------------------------------------------------------------------------------------


def hide(**hidden: object) -> Third:
    """A tractor on ground without ridges, logged exactly; `hidden` are further fields of its case."""
    return Third(TruthCase("mixed", 3, **hidden), Instruments(), 0.0)  # type: ignore[arg-type]


def test_wheels_torn_off_their_linkage_go_straight_while_the_sensor_moves() -> None:
    weave = drive("weave", 56.0, lambda time: 12.0 * np.sin(time / 2.2), 1.6, bearing_deg=30.0)
    torn = hide(faults=(Fault("steering_loose", 0, 20.0, None, {"linkage": 1.0}),)).track(weave)
    assert np.ptp(torn.column(third_body.WHEEL)[torn.time_s > 21.0]) > 15.0
    late = torn.states[torn.time_s > 26.0]
    assert np.abs(late[:, third_body.YAW_RATE] / late[:, third_body.AHEAD]).max() < 2e-3


def test_a_follower_keeps_to_its_line_and_heeds_a_lost_position() -> None:
    line = PROGRAMMES["closed"]()[0]
    kept = hide().log(line)
    times = kept["time_s"].to_numpy() - kept["time_s"].iloc[0]
    aside = (kept["easting_m"] - kept["easting_m"].iloc[0]).to_numpy() - line.steering(times)
    settled = np.concatenate([aside[(times > end - 2.0) & (times < end)] for end in (12.0, 26.0, 40.0)])
    assert np.abs(settled).max() < 0.15
    fault = Fault("position_lost", 0, 20.0, None, {"mode": 2.0})
    assert np.ptp(hide(faults=(fault,)).log(line)["northing_m"].to_numpy()[times > 20.2]) == 0.0


@matrix
@pytest.mark.parametrize("name", sorted(THIRD.outside))
def test_every_cause_outside_the_catalogue_changes_a_log(name: str) -> None:
    case = draw_outside_case(THIRD, name, np.random.default_rng(2))
    index = round(case.outside[name].get("run", 5.0 if name == "steering_stiction" else 6.0))
    track = PROGRAMMES["three_speeds"]()[index]
    plain, other = (Third(each).log(track, index) for each in (replace(case, outside={}), case))
    places = [plain[axis].to_numpy() - other[axis].to_numpy() for axis in ("easting_m", "northing_m")]
    assert np.hypot(*places).max() > 0.05


def test_ground_is_the_same_at_the_same_place() -> None:
    waves = draw_waves(7, 1.0)
    there, back = (run.find_rut(3.0, -2.0, heading, waves) for heading in (0.4, 0.4 + math.pi))
    assert there == pytest.approx(-back) and there != run.find_rut(3.5, -2.0, 0.4, waves)
    spread = [run.find_rut(east, north, 0.0, waves) for east in np.arange(0, 60, 0.7) for north in (0.0, 9.0, 21.0)]
    assert 0.001 < np.std(spread) < 0.008


# --- fourth --------------------------------------------------------------------------------------------------------


@matrix
def test_laws_govern_their_parameter() -> None:
    tool = drive("tool", 30.0, constant(10.0), 1.4, stairs((15.0, 0.0), (15.0, 1.0)), bearing_deg=0.0)
    bend = drive("bend", 30.0, stairs((10.0, 0.0), (10.0, 10.0), (10.0, -10.0)), 1.4, bearing_deg=30.0)
    for turn, law, rows, expected in (
        (tool, Law("steering_gain", "by_implement", {"lifted": 1.0, "working": 0.8}), (1000, 5000), (1.0, 0.8)),
        (tool, Law("steering_offset", "over_minutes", {"start": 1.0, "per_minute": 4.0}), (4000,), (7.0 / 3.0,)),
        (bend, Law("steering_gain", "by_side", {"left": 0.9, "right": 1.2}), (3500, 5500), (1.2, 0.9)),
    ):
        drawn = fourth.draw_run(TruthCase("law", 3, laws=(law,)), turn, 0, quiet=True)
        place = {"steering_gain": 1, "steering_offset": 0}[law.effect]
        assert tuple(drawn.parameters[list(rows), place]) == pytest.approx(expected)


# --- fifth ---------------------------------------------------------------------------------------------------------

Part = tuple[float, float, float, float, float, float]


def keep(angle_deg: float, speed: float = PACE) -> Part:
    return (HOLD, 22.0, angle_deg, 0.0, speed, 0.0)


def drive_fifth(*parts: Part, **fields: object) -> np.ndarray:
    return fifth.drive_run(TruthCase("clean", 3, **fields), lay_parts(*parts), 70.0, 0, quiet=True)  # type: ignore[arg-type]


def find_bend(rows: np.ndarray, from_s: float = 12.0) -> float:
    return measure_curvature(rows[int(from_s / 0.005) :], fifth_body.REAR)


@matrix
def test_reverse_circles_and_an_axle_that_stands_askew() -> None:
    assert -find_bend(drive_fifth(keep(10.0, -0.85))) == pytest.approx(measured_curvature(10.0, EG105), rel=1e-2)
    askew = drive_fifth(keep(0.0), outside={"crab_axle": {"run": 0.0, "angle_deg": 1.0}})
    turned = find_bend(askew) - find_bend(drive_fifth(keep(0.0)))
    assert turned == pytest.approx(-math.radians(1.0) / fifth_body.BASE, rel=0.03)


@matrix
@pytest.mark.parametrize("driver", [PURSUE, STANLEY, PERSON])
@pytest.mark.parametrize("bend", [0.0, 0.02, -0.02])
def test_drivers_come_to_their_arc(driver: float, bend: float) -> None:
    parts = lay_parts((HOLD, 1.0, 0.0, 0.0, 0.0, 0.0), (driver, 30.0, 0.5, bend, PACE, 0.0))
    rows = fifth.drive_run(TruthCase("clean", 3), parts, 90.0, 0)[200:]
    x, y = rows[:, fifth_body.EAST] - rows[0, fifth_body.EAST], rows[0, fifth_body.NORTH] - rows[:, fifth_body.NORTH]
    off = 1.0 / bend - np.copysign(np.hypot(x, y - 1.0 / bend), bend) if bend else y
    assert np.abs(off[3000:-600] - 0.5).max() < (0.25 if driver == PERSON else 0.12)


@matrix
def test_masts_swing_and_sensors_stick_as_their_formulas() -> None:
    swung = swing_rows(np.concatenate([np.zeros(10), np.ones(6000)]), 0.6, 0.1)
    assert swung.max() == pytest.approx(1.0 + math.exp(-math.pi * 0.1 / math.sqrt(0.99)), abs=0.02)
    assert follow_play(np.array([0.0, 2.0, 1.5, 0.0]), 1.0).tolist() == [0.0, 1.5, 1.5, 0.5]


@matrix
def test_every_cause_outside_of_the_fifth_changes_a_log() -> None:
    parts = lay_parts(
        (HOLD, 8.0, 0.0, 0.0, PACE, 0.0), (HOLD, 8.0, 20.0, 0.0, 0.85, 1.0), (HOLD, 8.0, -9.0, 0, 2.2, 1.0)
    )
    for name in FIFTH.outside:
        drawn = replace(draw_outside_case(FIFTH, name, np.random.default_rng(2)), seed=4)
        spoilt = {key: {**values, "run": 3.0} if "run" in values else values for key, values in drawn.outside.items()}
        cases = (replace(drawn, outside={}, rate_hz=10.0), replace(drawn, outside=spoilt, rate_hz=10.0))
        plain, other = (fifth.log_run(case, "run", parts, 70.0, 3).to_numpy(float) for case in cases)
        assert other.shape == plain.shape and np.abs(other - plain).max() > 0.02, name


# --- sixth ---------------------------------------------------------------------------------------------------------


def drive_sixth(angle: float, speed: float, **fields: object) -> np.ndarray:
    case = TruthCase("clean", 3, **fields)  # type: ignore[arg-type]
    return sixth.drive_plan(case, np.array([[angle, speed, 0.0]] * 220), np.empty((0, 4)), quiet=True)


@pytest.mark.slow  # compiles the machine, which takes some seconds
def test_laws_and_outsiders_act() -> None:
    law = Law("steering_gain", "by_speed", {"at_0": 1.2, "per_mps": -0.1})
    slow, fast = (measure_curvature(drive_sixth(12.0, speed, laws=(law,))[-1600:], 0.0) for speed in (1.0, 2.0))
    assert slow > 1.08 * fast
    sway = {"mast_sway": {"m_per_mps2": 0.1, "hertz": 0.8}}
    assert -0.09 < drive_sixth(12.0, 2.5, outside=sway)[-1, sixth_body.MAST] < -0.02
    for values in ({"crosswind": {"force_n": 6000.0, "bearing_deg": 90.0}}, {"soft_tyre": {"moment_nm": 1500.0}},
                   {"steering_hunt": {"angle_deg": 2.0, "period_s": 3.0}}):  # fmt: skip
        assert np.hypot(*(drive_sixth(0.0, 2.0, outside=values) - drive_sixth(0.0, 2.0))[-2000:, :2].T).max() > 0.2


@pytest.mark.slow
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


@pytest.mark.slow
def test_logs_of_the_sixth_are_as_long_and_full_as_said() -> None:
    logs = sixth.make_sixth_logs(TruthCase("clean", 5, programme="nearest"))
    assert all(60.0 <= np.ptp(one["time_s"]) <= 120.0 and one.notna().mean().min() > 0.34 for one in logs)
