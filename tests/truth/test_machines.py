"""What all machines must do alike: circles of the measured radius, and every effect at its size where it belongs."""

import ast
import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from tests.truth import body, fifth, fifth_body, fourth, fourth_body, rolling, third_body
from tests.truth.cases import TruthCase
from tests.truth.drives import Drive, constant, drive, stairs
from tests.truth.effects import Effects
from tests.truth.ground import EG105, find_point, measured_curvature
from tests.truth.model import Truth
from tests.truth.recorder import Instruments
from tests.truth.second import EXACT as EXACT_RECEIVER
from tests.truth.second import TRACTORS, Second
from tests.truth.sensors import PERFECT
from tests.truth.third import Third

Array = np.ndarray
PACE, BEARING, G = 1.4, math.radians(70.0), 9.80665
LIBRARIES = {"numpy", "pandas", "numba", "math", "dataclasses", "collections", "typing", "functools", "__future__",
             "sys", "pathlib"}  # fmt: skip


class Ride(NamedTuple):
    """Rows of a drive: time (s), place of the centre of mass (m), heading (rad), speed (m/s), wheel sensor (deg)."""

    time_s: Array
    east: Array
    north: Array
    heading: Array
    speed: Array
    sensor: Array

    def find_bend(self, from_s: float = 12.0, turned: float = 6.0) -> float:
        """Mean curvature of the way from a time on (1/m), for a turn at most (rad)."""
        rows = self.time_s >= from_s
        rows &= np.abs(self.heading - self.heading[np.argmax(rows)]) <= turned
        course = np.unwrap(np.arctan2(np.diff(self.east[rows]), np.diff(self.north[rows])))
        way = np.hypot(np.diff(self.east[rows]), np.diff(self.north[rows]))
        return float((course[-1] - course[0]) / (way.sum() - 0.5 * (way[0] + way[-1])))


def ride_first(effects: Effects, run: Drive) -> Ride:
    trace = Truth(effects, 3, soil_deg_per_s=0.0, instruments=PERFECT).trace(run)
    return Ride(
        trace.time_s,
        *trace.find_point(body.REAR, 0.0),
        trace.column(body.HEADING),
        trace.speed_mps,
        trace.column(body.ACTUATOR),
    )


def ride_second(effects: Effects, run: Drive, tractor: str = "eg105") -> Ride:
    rolled = Second(effects, 3, tractor, roughness=0.0, receiver=EXACT_RECEIVER).roll(run)
    return Ride(rolled.time_s, *rolled.find_point(rolling.REAR_TO_MASS_M, 0.0), rolled.column(rolling.HEADING),
                rolled.speed_mps, rolled.column(rolling.WHEEL))  # fmt: skip


def ride_third(effects: Effects, run: Drive, seed: int = 3) -> Ride:
    track = Third(TruthCase("clean", seed, effects), Instruments(), 0.0).track(run)
    columns = (track.column(place) for place in (third_body.HEADING, third_body.AHEAD, third_body.WHEEL))
    return Ride(track.time_s, *track.find_point(1.1, 0.0), *columns)


def ride_fourth(effects: Effects, run: Drive, **fields: object) -> Ride:
    drawn = fourth.draw_run(TruthCase("clean", 3, effects, **fields), run, 0, quiet=True)  # type: ignore[arg-type]
    rows = drawn.rows
    mass = find_point(*rows[:, :3].T, 1.1, 0.0)
    return Ride(drawn.time_s, *mass, *(rows[:, k] for k in (2, fourth_body.SPEED, fourth_body.MOTOR)))


def ride_articulated(effects: Effects, run: Drive) -> Ride:
    return ride_fourth(effects, run, outside={"articulated": {"here": 1.0}})


def lay_drive(run: Drive) -> Array:
    """A drive as parts of the fifth reference, one for each tenth of a second."""
    time = np.arange(0.0, run.duration_s, 0.1)
    none = np.zeros(len(time))
    return np.column_stack([none, time + 0.1, run.steering(time), none, run.speed(time), run.implement(time),
                            none + 1.0])  # fmt: skip


def ride_fifth(effects: Effects, run: Drive) -> Ride:
    rows = fifth.drive_run(TruthCase("clean", 3, effects), lay_drive(run), math.degrees(BEARING), 0, quiet=True)
    mass = find_point(*rows[:, :3].T, fifth_body.REAR, 0.0)
    return Ride(0.005 * np.arange(len(rows)), *mass, *(rows[:, k] for k in (2, fifth_body.SPEED, fifth_body.MOTOR)))


RIDES: dict[str, Callable[[Effects, Drive], Ride]] = {
    "first": ride_first, "second": ride_second, "third": ride_third, "fourth": ride_fourth, "fifth": ride_fifth,
}  # fmt: skip
NEAR = {"first": 5e-3, "second": 3e-3, "third": 0.02, "fourth": 0.02, "fifth": 0.02}
FAST = {"first": (20.0, 3.0), "second": (20.0, 3.0), "third": (20.0, 2.8), "fourth": (26.0, 2.4),
        "fifth": (26.0, 2.4)}  # fmt: skip
"""Angles (deg) and speeds (m/s) at which a clear friction limit is exceeded, and no machine spins."""
SLOW = ("fourth", "fifth")
"""Machines that take long to compile, and by which CI diagnoses nothing."""
machines = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.matrix if name in SLOW else ()) for name in RIDES]
)


def hold(angle_deg: float, speed: float = PACE, tool: float = 0.0, seconds: float = 28.0) -> Drive:
    return drive("held", seconds, constant(angle_deg), speed, tool, bearing_deg=math.degrees(BEARING))


def find_law(angle_deg: float) -> float:
    return float(measured_curvature(angle_deg, EG105))


def bend(name: str, effects: Effects, *held: float) -> float:
    return RIDES[name](effects, hold(*held)).find_bend()


@pytest.mark.parametrize("angle", [-27.0, -12.0, -3.0, 3.0, 12.0, 27.0])
@machines
def test_circles_have_the_measured_radius(name: str, angle: float) -> None:
    ride = RIDES[name]({}, hold(angle))
    near = {"fourth": 5e-3, "fifth": 5e-3}.get(name, 2e-3)
    assert ride.sensor[-1] == pytest.approx(angle, abs=0.12)  # the dead band
    assert ride.find_bend() == pytest.approx(find_law(ride.sensor[-1]), rel=near)


@pytest.mark.parametrize(("angle", "ride"), [(-12.0, ride_articulated), (12.0, ride_articulated)])
@pytest.mark.matrix
def test_an_articulated_machine_turns_as_measured(angle: float, ride: Callable[[Effects, Drive], Ride]) -> None:
    assert ride({}, hold(angle)).find_bend() == pytest.approx(find_law(angle), rel=1e-2)


@pytest.mark.parametrize("angle", [-12.0, 12.0])
def test_the_other_tractor_and_two_driven_wheels_turn_as_measured(angle: float) -> None:
    other = ride_second({}, hold(angle), "mr1000a").find_bend()
    assert other == pytest.approx(measured_curvature(angle, TRACTORS["mr1000a"]), rel=2e-3)
    assert ride_third({}, hold(angle), 4).find_bend() == pytest.approx(find_law(angle), rel=2e-3)


@machines
def test_straight_ahead_is_straight_and_at_the_commanded_speed(name: str) -> None:
    ride = RIDES[name]({}, hold(0.0))
    assert np.abs(ride.heading - ride.heading[0]).max() < 1e-6
    assert ride.speed[-1] == pytest.approx(PACE, rel=5e-3)


@machines
def test_effects_of_the_wheels_have_their_sizes(name: str) -> None:
    assert bend(name, {"steering_offset": {"angle_deg": -2.0}}, 0.0) == pytest.approx(find_law(-2.0), rel=NEAR[name])
    for angle in (-12.0, 12.0):
        plain = bend(name, {}, angle)
        for effect, values, factor in (
            ("steering_gain", {"ratio": 1.1}, 1.1),
            ("steering_asymmetry", {"ratio": 0.9}, 0.9 if angle < 0.0 else 1.0),
            ("grip_patch", {"ratio": 0.7, "radius_m": 200.0}, 0.7),
            ("grip_patch", {"ratio": 0.7, "east_m": 900.0, "radius_m": 200.0}, 1.0),
        ):
            assert bend(name, {effect: values}, angle) / plain == pytest.approx(factor, rel=6e-3)
    grown = RIDES[name]({"grip_drift": {"per_minute": -0.3}}, hold(12.0)).find_bend(20.0, 1.0) / find_law(12.0)
    assert grown == pytest.approx(1.0 - 0.3 * 22.5 / 60.0, rel=0.03)
    for speed in (0.85, 2.2):
        draft = bend(name, {"implement_side_draft": {"curvature_per_m": -0.006}}, 0.0, speed, 1.0)
        assert draft == pytest.approx(-0.006, rel=2 * NEAR[name])
    lifted = bend(name, {"implement_side_draft": {"curvature_per_m": -0.006}}, 0.0, 2.2)
    assert lifted == pytest.approx(0.0, abs=2e-4)


def find_pull(ride: Ride) -> float:
    """Lateral acceleration (g) of a held command."""
    return abs(ride.find_bend()) * float(np.mean(ride.speed[ride.time_s >= 12.0])) ** 2 / G


@machines
def test_effects_of_lateral_acceleration_have_their_sizes(name: str) -> None:
    soft, plain = (bend(name, effects, 14.0, 2.2) for effects in ({"understeer": {"deg_per_mps2": 2.0}}, {}))
    assert soft / plain == pytest.approx(find_law(14.0 - 2.0 * soft * 2.2**2) / find_law(14.0), rel=NEAR[name])
    limit: Effects = {"side_slip": {"limit_g": 0.08}}
    angle, speed = FAST[name]
    for side in (-1.0, 1.0):
        slid, free = (find_pull(RIDES[name](effects, hold(side * angle, speed))) for effects in (limit, {}))
        assert slid == pytest.approx(0.08, rel=0.1 if name != "second" else 0.02) and free > 0.09
    assert bend(name, limit, 5.0, 0.8) == pytest.approx(bend(name, {}, 5.0, 0.8), rel=0.03)


def step(name: str, effect: str, values: dict[str, float], size: float) -> tuple[Array, Array]:
    """Seconds since a step of the command, and the wheel sensor (deg)."""
    ride = RIDES[name]({effect: values}, drive("step", 9.0, stairs((3.0, 0.0), (6.0, size)), bearing_deg=70.0))
    return ride.time_s - 3.0, ride.sensor


@machines
def test_effects_of_the_valve_have_their_sizes(name: str) -> None:
    for lag in (0.1, 0.35):
        seconds, wheel = step(name, "steering_lag", {"time_s": lag}, 3.0)
        assert seconds[np.argmax(wheel >= 3.0 * (1.0 - math.exp(-1.0)))] == pytest.approx(lag, abs=0.045)
    for rate in (16.0, 8.0):
        seconds, wheel = step(name, "steering_rate", {"rate_deg_per_s": rate}, 24.0)
        low, high = (seconds[np.argmax(wheel >= angle)] for angle in (4.0, 18.0))
        assert 14.0 / (high - low) == pytest.approx(rate, rel=0.045)
        assert wheel[-1] == pytest.approx(24.0, abs=0.12) and wheel.max() < 24.3
    seconds, plain = step(name, "steering_dead_time", {"time_s": 0.0}, 12.0)
    _, late = step(name, "steering_dead_time", {"time_s": 0.25}, 12.0)
    shift = round(0.25 / (seconds[1] - seconds[0]))
    assert np.abs(late[shift:] - plain[:-shift]).max() < 0.25
    assert np.abs(step(name, "steering_deadband", {"angle_deg": 1.0}, 0.8)[1]).max() == 0.0
    assert 1.0 < step(name, "steering_deadband", {"angle_deg": 1.0}, 2.5)[1][-1] < 2.5


@machines
def test_play_takes_its_half_on_both_sides(name: str) -> None:
    """Behind a play of b, wheels that come from the middle stand b / 2 short of the sensor."""
    for side in (-1.0, 1.0):
        turn = drive("turn", 28.0, stairs((4.0, 0.0), (24.0, side * 12.0)), PACE, bearing_deg=70.0)
        loose = RIDES[name]({"steering_backlash": {"angle_deg": 1.5}}, turn)
        reached = loose.sensor[-1] - side * 0.75
        assert loose.find_bend(16.0) == pytest.approx(find_law(reached), rel=NEAR[name])


@machines
def test_speed_is_lost_by_slip_and_late_by_its_lag(name: str) -> None:
    for effect, up, down in (("wheel_slip", 0.92, 0.92), ("implement_slip", 1.0, 0.92)):
        for tool, share in ((0.0, up), (1.0, down)):
            ride = RIDES[name]({effect: {"ratio": 0.08}}, hold(0.0, PACE, tool))
            assert ride.speed[-1] == pytest.approx(share * PACE, rel=6e-3)
    change = drive("change", 40.0, constant(0.0), stairs((20.0, 1.4), (20.0, 1.6)), bearing_deg=70.0)
    lates = []
    for lag in (0.0, 1.2):
        ride = RIDES[name]({"speed_lag": {"time_s": lag}}, change)
        rows = (ride.time_s >= 20.0) & (ride.time_s < 38.0)
        lates.append(float(np.sum(1.6 - ride.speed[rows])) * (ride.time_s[1] - ride.time_s[0]) / 0.2)
    assert 0.1 < lates[0] < 0.6 and 1.1 < lates[1] < 1.9


@machines
def test_a_slope_carries_aside_by_its_ratio(name: str) -> None:
    for bearing in (160.0, 340.0, 30.0):
        ride = RIDES[name]({"cross_slope_drift": {"ratio": 0.03, "bearing_deg": bearing}}, hold(0.0))
        rows, turn = ride.time_s > 10.0, float(ride.heading[0])
        east, north = ride.east[rows][[0, -1]], ride.north[rows][[0, -1]]
        aside, along = ((east[1] - east[0]) * math.cos(turn) - (north[1] - north[0]) * math.sin(turn),
                        (east[1] - east[0]) * math.sin(turn) + (north[1] - north[0]) * math.cos(turn))  # fmt: skip
        assert aside / along == pytest.approx(0.03 * math.sin(math.radians(bearing) - turn), abs=2e-3)


def test_references_import_nothing_that_they_test() -> None:
    """Libraries and each other, and the first two references nothing of each other's bodies and instruments."""
    for path in Path(__file__).parent.glob("*.py"):
        if path.stem.startswith("test_"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert all(one.split(".")[0] in LIBRARIES or one.startswith("tests.truth") for one in names), path.name
            if path.stem in ("second", "rolling") or path.stem.startswith(("third", "fourth", "fifth")):
                assert not {f"tests.truth.{one}" for one in ("model", "body", "sensors")} & set(names), path.name
