"""The simulated robot: it drives as the world does, legs as they are released, and by remote commands."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.twin.conftest import hook
from vehicle.errors import MissionError, VehicleError
from vehicle.missions.plan import Leg, Mission, Plan
from vehicle.model.tractor import Implement, load_tractor
from vehicle.sim.world import World
from vehicle.twin.robot_tractor import AUTOMATIC, REMOTE, STOPPED, RobotTractor
from vehicle.twin.step_motion import TractorNoise


def stepper(**more: object) -> RobotTractor:
    made = RobotTractor(hook(), load_tractor("eg105"), Implement(), **more)  # type: ignore[arg-type]
    made.base_legs = 3
    return made


def test_it_drives_as_the_world_does_bit_for_bit() -> None:
    run = World(Plan((hook(),)), load_tractor("eg105"), Implement()).run()
    one = stepper()
    for row in range(len(run.record)):
        one.advance(row / 10.0)
        assert one.body[:3].tolist() == run.record[row, 0, :3].tolist()
    one.advance(one.time_s + 0.2)
    assert one.state.done and one.state.leg == 2


def test_it_stands_at_the_end_of_what_is_released_and_rolls_on_when_there_is_more() -> None:
    one = RobotTractor(hook(), load_tractor("eg105"), Implement())
    assert one.advance(5.0).leg_m == 0.0 and one.state.speed_mps == 0.0
    one.base_legs = 1
    for step in range(60, 300):
        one.advance(step / 10.0)
    assert (one.state.leg, one.state.speed_mps) == (0, 0.0) and one.state.leg_m == pytest.approx(15.0, abs=0.2)
    one.base_legs = 3
    speeds = [abs(one.advance(30.0 + step / 10.0).speed_mps) for step in range(400)]
    assert one.state.done and min(speeds[50:200]) > 1.0, "it does not stop between released legs"


def test_a_limit_a_halt_and_a_hand_at_the_wheel() -> None:
    one = stepper()
    one.speed_limit_mps = 0.5
    assert one.advance(6.0).speed_mps == pytest.approx(0.5, abs=0.02)
    one.halt()
    assert one.advance(9.0).speed_mps == pytest.approx(0.0, abs=0.01) and one.state.mode == STOPPED
    one.drive_remotely(math.radians(20.0), -0.8)
    one.advance(16.0)
    assert one.state.mode == REMOTE and one.state.speed_mps == pytest.approx(-0.8, abs=0.02)
    assert one.state.wheel_angle_rad == pytest.approx(math.radians(20.0), abs=math.radians(0.2))
    one.drive_automatically()
    assert one.advance(16.5).mode == AUTOMATIC


def test_the_way_it_is_asked_for_does_not_change_the_drive() -> None:
    """Soil and guidance errors belong to steps, not to calls."""
    often, seldom = stepper(noise=TractorNoise(), seed=5), stepper(noise=TractorNoise(), seed=5)
    for step in range(1, 101):
        often.advance(step / 10.0)
    seldom.advance(10.0)
    assert often.body.tolist() == seldom.body.tolist()
    assert often.body.tolist() != stepper(noise=TractorNoise(), seed=6).body.tolist()


def test_instruments_are_off_by_what_is_hidden_in_them() -> None:
    one = stepper(hidden_effects={"antenna_right": 0.5, "heading_bias": 2.0})
    one.drive_remotely(0.0, 1.0)
    shown, true = one.advance(4.0), one.true_state
    # Heading north, right is east; a compass too far to the right shows less of the mathematical angle.
    assert (shown.x_m - true.x_m, shown.y_m - true.y_m) == pytest.approx((0.5, 0.0), abs=1e-3)
    assert math.degrees(shown.heading_rad - true.heading_rad) == pytest.approx(-2.0)
    with pytest.raises(VehicleError, match="is unknown"):
        stepper(hidden_effects={"steering_ofset": 1.0})


def test_a_new_mission_keeps_what_was_driven() -> None:
    one = stepper()
    one.advance(20.0)
    assert one.state.leg == 1
    legs = hook().legs
    end = replace(legs[2], points=np.array([[-8.0, 23.0], [-15.0, 23.0]]))
    one.replace_mission(Mission((*legs[:2], end)))
    for step in range(201, 500):
        one.advance(step / 10.0)
    assert one.state.done and one.state.x_m == pytest.approx(-15.0, abs=0.2)
    with pytest.raises(MissionError, match="differs in leg 0"):
        one.replace_mission(Mission((replace(legs[0], points=legs[0].points + 1.0), *legs[1:])))


@pytest.mark.parametrize("leg, leg_m", [(0, 4.0), (1, 6.0), (2, 0.0), (2, 10.0)])
def test_begun_midway_it_stands_where_one_that_drove_there_is_and_ends_where_that_ends(leg: int, leg_m: float) -> None:
    whole, late = stepper(), stepper()
    late.place_on_leg(leg, leg_m)
    place = late.state
    assert (place.leg, place.leg_m, place.speed_mps) == (leg, pytest.approx(leg_m), 0.0)
    apart = []
    while not whole.state.done:
        whole.advance(whole.time_s + 0.1)
        apart.append(math.hypot(whole.state.x_m - place.x_m, whole.state.y_m - place.y_m))
    assert min(apart) < 0.25
    sides = []
    while not late.state.done:
        late.advance(late.time_s + 0.1)
        sides.append((late.state.leg, abs(float(late._states[0]["lateral"]))))
    assert sides[0][0] == leg and max(side for _, side in sides) < 0.3
    assert math.hypot(whole.state.x_m - late.state.x_m, whole.state.y_m - late.state.y_m) < 0.1


def test_one_that_begins_where_it_was_beside_a_leg_finds_back_to_it_in_reverse_too() -> None:
    turn = np.array([[math.sin(a), 1.0 - math.cos(a)] for a in np.linspace(0.0, 1.2, 25)]) * 10.0
    for gear, bearing in ((1, 1.0), (-1, 1.0 + math.pi)):
        one = RobotTractor(Mission((Leg(turn, 1.0, gear),)), load_tractor("eg105"), Implement())
        one.base_legs = 1
        x, y = 10.0 * math.sin(0.5), 10.0 - 10.0 * math.cos(0.5)
        one.place_on_leg(0, 5.0, (x - 0.3, y + 0.3, 0.5 + bearing - 1.0))
        there = one.state
        assert (there.x_m, there.y_m, there.leg_m) == pytest.approx((x - 0.3, y + 0.3, 5.0))
        assert math.remainder(there.heading_rad - (0.5 + bearing - 1.0), 2 * math.pi) == pytest.approx(0.0)
        one.advance(12.0)
        assert one.state.done and math.dist((one.state.x_m, one.state.y_m), turn[-1]) < 0.6


def test_it_begins_on_a_leg_that_reverses_and_on_none_that_is_not_there() -> None:
    back = Mission((Leg(np.array([[0.0, 0.0], [0.0, 12.0]]), 1.0), Leg(np.array([[0.0, 12.0], [0.0, 2.0]]), 1.0, -1)))
    one = RobotTractor(back, load_tractor("eg105"), Implement())
    one.base_legs = 2
    one.place_on_leg(1, 4.0)
    assert one.state.y_m == pytest.approx(8.0) and one.state.heading_rad == pytest.approx(0.5 * math.pi)
    one.advance(20.0)
    assert one.state.done and one.state.y_m == pytest.approx(2.0, abs=0.3)
    with pytest.raises(MissionError, match="no leg 2"):
        one.place_on_leg(2, 0.0)
