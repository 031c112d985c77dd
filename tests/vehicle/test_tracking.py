"""How well tractors keep to their path: straight on, after an offset, in turns, in reverse."""

import math
from typing import Any

import numpy as np
import pytest
from shapely import LineString, Point

from vehicle.missions.plan import Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import (
    GuidanceParameters,
    Implement,
    SteeringParameters,
    Tractor,
    list_tractor_names,
    load_tractor,
)
from vehicle.sim.world import World, simulate

SPEED = 5.0 / 3.6
# Eq. 2.8 switched off: the wheels stand at the command one step later.
IMMEDIATE = SteeringParameters(dead_band_deg=0.0, switch_deg=180.0, rate_deg_per_s=1e4, lag_s=1.0 / 60.0)


def offset_run(tractor: Tractor, plan: Plan, offset: float, turn_deg: float = 0.0, eases: bool = True) -> SimulationRun:
    """The plan with its first tractor moved to its left (m) and turned clockwise at the start."""
    world = World(plan, tractor, Implement())
    if not eases:
        world.models["lateral_ease"] = math.inf
    body = world.bodies[0]
    left = body.angle + 0.5 * math.pi
    body.position = (body.position.x + offset * math.cos(left), body.position.y + offset * math.sin(left))
    body.angle -= math.radians(turn_deg)
    return world.run()


@pytest.mark.parametrize("name", list_tractor_names())
@pytest.mark.parametrize("bearing_deg", [0.0, 90.0, 203.0])
def test_a_straight_line_is_driven_to_the_centimetre(build: Any, name: str, bearing_deg: float) -> None:
    end = 100.0 * np.array([math.sin(math.radians(bearing_deg)), math.cos(math.radians(bearing_deg))])
    plan = build.plan([build.leg((0, 0), end, kind="track")])
    run = offset_run(load_tractor(name), plan, 0.3, 2.0)
    line = LineString([(0, 0), 1.1 * end])
    apart = np.array([line.distance(Point(x, y)) for x, y in run.record[:, 0, :2]])
    assert apart[0] == pytest.approx(0.3, abs=0.01)
    assert (apart[np.hypot(*run.record[:, 0, :2].T) > 50.0] < 0.01).all()


def test_on_the_line_the_wheels_stand_still(build: Any, eg105: Tractor) -> None:
    run = offset_run(eg105, build.plan([build.leg((0, 0), (0, 40), kind="track")]), 0.0)
    assert np.abs(run.record[:, 0, 0]).max() < 1e-9
    assert np.abs(run.record[:, 0, 3]).max() < 1e-9


@pytest.mark.parametrize("offset", [1.0, -1.0])
@pytest.mark.parametrize("kind", ["track", "turn"])
def test_a_step_of_one_metre(build: Any, eg105: Tractor, offset: float, kind: str) -> None:
    """Converges, with no overshoot beyond what the steering system of Eq. 2.8 adds, and no chatter afterwards."""
    plan = build.plan([build.leg((0, 0), (0, 80), kind=kind)])
    run = offset_run(eg105, plan, offset)
    ideal = offset_run(eg105.model_copy(update={"steering": IMMEDIATE}), plan, offset)
    error, best = (math.copysign(1.0, offset) * -r.record[:, 0, 0] for r in (run, ideal))
    assert error[0] == pytest.approx(1.0)
    # At 16 deg/s the wheels need about 1.3 s for 21 deg, in which the tractor drives 1.8 m.
    assert -error.min() <= max(-best.min(), 0.0) + 0.12
    settled = run.record[:, 0, 1] > 30.0
    assert np.abs(error[settled]).max() < 0.01
    assert float(np.degrees(np.ptp(run.record[settled, 0][:, 3]))) < 1.0
    changes = np.diff(np.sign(np.round(np.degrees(run.record[settled, 0, 3]), 2)))
    assert (changes != 0).sum() < 10, "no chatter on the wheel"


@pytest.mark.parametrize("offset", [1.5, -2.5])
def test_larger_steps_converge_thanks_to_the_lateral_limit(build: Any, eg105: Tractor, offset: float) -> None:
    plan = build.plan([build.leg((0, 0), (0, 120), kind="track")])

    def measure_error_m(run: SimulationRun) -> float:
        return float(np.abs(run.record[run.record[:, 0, 1] > 80.0, 0, 0]).max())

    assert measure_error_m(offset_run(eg105, plan, offset)) < 0.01
    plain = eg105.model_copy(update={"guidance": GuidanceParameters(lateral_limit_m=100.0)})
    assert measure_error_m(offset_run(plain, plan, offset, eases=False)) > 0.1, "Eq. 2.5 as printed weaves on"


@pytest.mark.parametrize("side", [1, -1])
def test_a_half_circle_is_driven_within_a_third_of_a_metre(
    build: Any, eg105: Tractor, implement: Implement, side: int
) -> None:
    centre = (side * 4.5, 30.0)
    start, end = (180, 0) if side > 0 else (0, 180)
    legs = [
        build.leg((0, 0), (0, 30), kind="track"),
        build.arc(centre, 4.5, start, end),
        build.leg((side * 9, 30), (side * 9, 0), kind="track"),
    ]
    run = simulate(build.plan(legs), eg105, implement)
    path = LineString(np.concatenate([leg.points for leg in legs]))
    apart = np.array([path.distance(Point(x, y)) for x, y in run.record[:, 0, :2]])
    assert apart[run.record[:, 0, 1] > 10.0].max() < 0.35
    back = (run.record[:, 0, 5] == 2) & (run.record[:, 0, 1] < 15.0) & (run.record[:, 0, 1] > 1.0)
    assert apart[back].max() < 0.03


@pytest.mark.parametrize("offset", [0.4, -0.4])
def test_reversing_finds_its_line(build: Any, eg105: Tractor, offset: float) -> None:
    """In reverse the rear axle is guided; it weaves in on its path, less by half every 17 m or so."""
    plan = build.plan([build.leg((0, 0), (0, 70), gear=-1, speed_mps=1.0, kind="turn")])
    run = offset_run(eg105, plan, offset)
    angle = run.record[:, 0, 2]
    rear = run.record[:, 0, :2] - 1.1 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    assert run.outcome == "done" and run.record[:, 0, 4].min() < -0.9
    assert abs(rear[0, 0]) == pytest.approx(0.4, abs=1e-6)
    assert np.abs(rear[rear[:, 1] > 50.0, 0]).max() < 0.02


def test_mirrored_paths_are_driven_as_mirror_images_where_the_radii_are(build: Any, eg105: Tractor) -> None:
    """With the same measured radius on both sides, left and right differ by rounding only."""
    law = eg105.radius["soil"]
    even = eg105.model_copy(update={"radius": {"soil": law.model_copy(update={"left": law.right})}})
    runs = []
    for side in (1, -1):
        points = np.array([[0, 0], [0, 10], [side * 2, 20], [side * 2, 30], [-side * 3, 45]], dtype=float)
        runs.append(simulate(build.plan([build.leg(*points)]), even, Implement()))
    right, left = (run.record[:, 0] for run in runs)
    assert runs[0].duration_s == runs[1].duration_s
    assert np.abs(right[:, 0] + left[:, 0]).max() < 1e-6
    assert np.abs(right[:, 1] - left[:, 1]).max() < 1e-6


@pytest.mark.parametrize("turn_deg", [37.0, 180.0])
def test_turning_the_whole_plan_turns_the_run(
    build: Any, eg105: Tractor, implement: Implement, turn_deg: float
) -> None:
    legs = build.two_passes()
    cosine, sine = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    turn = np.array([[cosine, sine], [-sine, cosine]])
    turned = [build.leg(*(leg.points @ turn + np.array([500.0, -200.0])), task=leg.task) for leg in legs]
    plain = simulate(build.plan(legs), eg105, implement)
    moved = simulate(build.plan(turned), eg105, implement)
    assert moved.duration_s == pytest.approx(plain.duration_s, abs=0.1001)
    rows = min(len(plain.record), len(moved.record))
    expected = plain.record[:rows, 0, :2] @ turn + np.array([500.0, -200.0])
    assert np.hypot(*(moved.record[:rows, 0, :2] - expected).T).max() < 0.01
