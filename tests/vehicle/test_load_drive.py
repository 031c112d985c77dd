"""Driving on terrain and with a load, against closed forms: power on a grade, cross slopes, energy, brakes, stalls."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fields.arrays import Floats
from tests.vehicle.bits import assert_same_bits
from tests.vehicle.test_pymunk_bridge import assert_same, gated
from vehicle.energy.traction import compute_net_traction, solve_slip
from vehicle.errors import VehicleError
from vehicle.missions.plan import Leg, LegTask, Mission, Plan
from vehicle.model.ground import GROUNDS
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Implement, Tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import DT_S, REC_SPEED
from vehicle.sim.calibration import build_identity_table
from vehicle.sim.compile import build_ground_records, build_model_record
from vehicle.sim.incremental import IncrementalSimulator
from vehicle.sim.load_terms import refine_slip
from vehicle.sim.world import World, simulate

GRAVITY_MPS2 = 9.80665
MASS_KG, ROLLING = 3850.0, 0.06
WEIGHT_N = MASS_KG * GRAVITY_MPS2
REACH_M, SPACING_M = 200.0, 5.0

PLOUGH = WorkLoad(
    draft_n=(4000.0, 900.0, 150.0), implement_mass_kg=900.0, rolling_share=0.065, engine_power_w=77_000.0,
    driveline_efficiency=0.86, mobility_number=40.0, centre_height_m=1.0,
)  # fmt: skip


def build_terrain(height: Callable[[Floats, Floats], Floats]) -> Terrain:
    """A height as a function of x and y, within REACH_M of the origin."""
    places = np.arange(-REACH_M, REACH_M + 1.0, SPACING_M)
    return Terrain(-REACH_M, -REACH_M, SPACING_M, height(*np.meshgrid(places, places)))


def tilt(to_east: float, to_north: float) -> Terrain:
    """A plane with these slopes."""
    return build_terrain(lambda x, y: to_east * x + to_north * y)


HILLS = build_terrain(lambda x, y: 3.0 * np.sin(x / 40.0) * np.cos(y / 30.0) + 0.02 * y)


def build_line(*points: tuple[float, float], speed_mps: float = 2.0) -> Plan:
    """One tractor works along a polyline."""
    leg = Leg(np.array(points), speed_mps, implement=True, task=LegTask("track"))
    return Plan((Mission((leg,)),))


NORTH = build_line((0.0, -150.0), (0.0, 150.0))


def drive(plan: Plan, tractor: Tractor, terrain: Terrain | None = None, load: WorkLoad | None = None, **options: Any):  # type: ignore[no-untyped-def]
    """The run of a plan."""
    return simulate(plan, tractor, Implement(), terrain=terrain, load=load, **options)


def get_end_speed(run: Any, seconds: float) -> float:
    """Speed at a time (m/s)."""
    return float(run.record[round(10 * seconds), 0, REC_SPEED])


def solve_terminal_speed(power_w: float, grade: float, mobility: float | None) -> float:
    """Speed at which an axle's power is used up: torque over rolling radius times the speed of the wheels."""
    net_share = grade  # of a wheel that carries all the weight
    if mobility is None:
        return power_w / (WEIGHT_N * (grade + ROLLING))
    slips = np.linspace(0.0, 0.3, 300_001)
    envelope = 0.88 * (1.0 - math.exp(-0.1 * mobility))
    net = envelope * (1.0 - np.exp(-7.5 * slips)) - 1.0 / mobility - 0.5 * slips / math.sqrt(mobility)
    slip = float(slips[np.searchsorted(net, net_share)])
    gross = net_share + 1.0 / mobility + 0.04 + 0.5 * slip / math.sqrt(mobility)
    return power_w * (1.0 - slip) / (WEIGHT_N * gross)


@pytest.mark.parametrize("mobility", [None, 40.0, 15.0])
@pytest.mark.parametrize("grade", [0.05, 0.12])
def test_speed_on_a_grade_is_what_power_allows(eg105: Tractor, grade: float, mobility: float | None) -> None:
    rolling = ROLLING if mobility is None else 1.0 / mobility + 0.04
    load = WorkLoad(engine_power_w=10_000.0, driveline_efficiency=0.8, mobility_number=mobility, rolling_share=rolling)
    run = drive(NORTH, eg105, tilt(0.0, grade), load, max_time_s=60.0)
    assert get_end_speed(run, 59.0) == pytest.approx(solve_terminal_speed(8000.0, grade, mobility), rel=1e-4)


def test_a_set_speed_is_held_where_power_and_brakes_allow(eg105: Tractor) -> None:
    for grade in (0.12, -0.12):
        run = drive(NORTH, eg105, tilt(0.0, grade), PLOUGH)
        speeds = run.record[100:1400, 0, REC_SPEED]
        assert run.outcome == "done" and np.abs(speeds - 2.0).max() < 0.01, grade


def test_slip_is_that_of_the_pull(eg105: Tractor) -> None:
    """Net traction is the draft at 2 m/s over the weight of tractor and implement, all of it on driven wheels."""
    world = World(NORTH, eg105, Implement(), load=PLOUGH)
    world.run(max_time_s=60.0)
    pull = (4000.0 + 2.0 * 900.0 + 4.0 * 150.0) / ((MASS_KG + 900.0) * GRAVITY_MPS2)
    slip = float(world.program.states["wheel_slip"][0])
    assert 0.02 < slip < 0.05
    assert compute_net_traction(slip, 40.0) == pytest.approx(pull, rel=1e-3)


@pytest.mark.parametrize("mobility", [1.5, 3.0, 4.2])
@pytest.mark.parametrize("share", [-0.5, 0.3, 0.9, 1.0, 1.5])
def test_slip_leaves_that_of_the_best_pull_on_very_soft_ground(eg105: Tractor, mobility: float, share: float) -> None:
    """There one more N of thrust takes any slip; `share` of the best gain over a wheel without slip is asked for."""
    load = replace(PLOUGH, mobility_number=mobility, rolling_share=0.04 + 1.0 / mobility)
    model = np.array([build_model_record(eg105, Implement(), load)]).view(np.recarray)[0]
    ground = build_ground_records(load).view(np.recarray)[0]
    gain = share * float(model.best_gain)
    thrust = (gain + float(ground.rolling) - 1.0 / mobility) * float(model.driven_weight)
    slip = float(model.max_slip)
    for _ in range(8):
        slip = float(refine_slip.py_func(slip, thrust, model, ground))  # type: ignore[attr-defined]
    found = solve_slip(gain - 1.0 / mobility, mobility, PLOUGH.max_slip)
    assert slip == pytest.approx(max(found, 0.0), abs=1e-4)  # where the curve is flat, found to 2e-5


@pytest.mark.parametrize("slope", [0.1, -0.15])
def test_across_a_slope_tractor_and_wheels_stand_at_the_angles_of_the_tyres(eg105: Tractor, slope: float) -> None:
    """Both axles hold their share of m g times the slope; side friction is 0.15 and 0.20 of the load per degree.

    The front tyres then slip by slope / 0.15, the rear ones by slope / 0.20 degrees. Without a turn the body crabs by
    the angle of the rear tyres, uphill, and the wheels stand at the difference.
    """
    exact = eg105.model_copy(update={"steering": eg105.steering.model_copy(update={"dead_band_deg": 0.0})})
    world = World(NORTH, exact, Implement(), terrain=tilt(slope, 0.0))
    world.tables = np.array([[build_identity_table(exact.max_steering_deg)] * len(GROUNDS)])
    run = world.run(max_time_s=120.0)
    _, _, angle, steering = run.record[-1, 0, :4]
    assert 90.0 - math.degrees(angle) == pytest.approx(slope / 0.20, rel=0.02)
    assert math.degrees(steering) == pytest.approx(slope / 0.15 - slope / 0.20, rel=0.03)
    assert np.abs(run.record[300:, 0, 0]).max() < 0.05  # guidance keeps it on its line


def test_a_tractor_that_stands_across_a_slope_stays(eg105: Tractor) -> None:
    legs = (
        Leg(np.array([[0.0, 0.0], [0.0, 20.0]]), 2.0),
        Leg(np.array([[0.0, 20.0], [0.0, 40.0]]), 2.0, stand_s=300.0),
    )
    run = drive(Plan((Mission(legs),)), eg105, tilt(0.2, 0.1))
    still = run.record[run.get_statuses(0) == 5, 0][50:, :3]
    assert len(still) > 2500 and run.outcome == "done"
    assert np.abs(still - still[0]).max() < 2e-3


@pytest.mark.parametrize(("slope", "heading"), [(0.25, (0.0, 1.0)), (0.25, (1.0, 0.0))])
def test_the_margin_of_a_tractor_on_a_plane(eg105: Tractor, slope: float, heading: tuple[float, float]) -> None:
    """Half a track of 0.9 m and a centre of mass 1 m up: 42.0 degrees, less those of the slope across the path."""
    end = (100.0 * heading[0], 100.0 * heading[1])
    run = drive(build_line((0.0, 0.0), end), eg105, tilt(slope, 0.0))
    across = math.atan(slope * heading[1])
    assert math.degrees(run.roll_over[0].margin_rad) == pytest.approx(
        math.degrees(math.atan(0.9) - across), abs=0.4 if across else 1e-6
    )


def test_a_turn_takes_its_lateral_acceleration_from_the_margin(build: Any, eg105: Tractor) -> None:
    """Level ground, a circle of 12 m at 3 m/s: the largest speed times turning rate over g, usually v^2 / (R g)."""
    tractor = eg105.model_copy(update={"speed": eg105.speed.model_copy(update={"max_lateral_mps2": 5.0})})
    way = [build.arc((12.0, 0.0), 12.0, 180.0, -100.0, speed_mps=3.0)]
    world = World(build.plan(way), tractor, Implement(), load=WorkLoad(centre_height_m=0.8))
    run = world.run()
    turns = np.abs(np.gradient(np.unwrap(run.record[:, 0, 2]), run.time_s) * run.record[:, 0, REC_SPEED])
    found = run.roll_over[0]
    assert math.tan(math.atan(0.9 / 0.8) - found.margin_rad) == pytest.approx(turns.max() / GRAVITY_MPS2, rel=0.02)
    assert np.median(turns) == pytest.approx(9.0 / 12.0, rel=0.03)


def test_a_tractor_rolls_over_a_slope_with_its_energy(eg105: Tractor) -> None:
    """Without drive, brakes and rolling resistance it swings in a valley: speed and height give one another."""
    free = eg105.model_copy(update={"speed": eg105.speed.model_copy(update={"max_drive_n": 0.001})})
    valley = build_terrain(lambda x, y: 0.002 * y**2)
    plan = build_line((0.0, -60.0), (0.0, 60.0), speed_mps=20.0)
    run = drive(plan, free, valley, WorkLoad(rolling_share=0.0), max_time_s=40.0)
    energy = 0.5 * run.record[:, 0, REC_SPEED] ** 2 + GRAVITY_MPS2 * valley.compute_heights(run.record[:, 0, :2])
    assert run.record[:, 0, REC_SPEED].max() > 5.0
    assert np.abs(energy / energy[0] - 1.0).max() < 0.004
    assert energy[-50:].mean() == pytest.approx(energy[:50].mean(), rel=1e-3)


def measure_work_j(plan: Plan, tractor: Tractor, terrain: Terrain | None, load: WorkLoad) -> tuple[float, float, float]:
    """Work of the driven wheels over a plan, of that the work against the slope alone, and all the climbing (J)."""
    world = World(plan, tractor, Implement(), terrain=terrain, load=load)
    work: list[tuple[float, float]] = []
    mass = float(world.models["mass"][0])

    def note(_: float) -> None:
        state = world.program.states[0]
        ahead = state["slope_east"] * math.cos(state["angle"]) + state["slope_north"] * math.sin(state["angle"])
        metres = float(state["forward"]) * DT_S
        work.append((float(state["thrust"]) * metres, mass * GRAVITY_MPS2 * float(ahead) * metres))

    run = world.run(chunk_s=DT_S, progress=note)
    assert run.outcome == "done"
    total, climbed = np.array(work).T
    return float(total.sum()), float(climbed.sum()), float(np.maximum(climbed, 0.0).sum())


def test_a_closed_lap_on_hills_takes_no_work_for_climbing(build: Any, eg105: Tractor) -> None:
    lap = build.plan([build.arc((0.0, 0.0), 15.0, 180.0, -180.0, speed_mps=2.5)])
    load = WorkLoad(rolling_share=0.05)
    level, none, _ = measure_work_j(lap, eg105, None, load)
    hilly, climbed, all_climbs = measure_work_j(lap, eg105, HILLS, load)
    assert none == 0.0 and all_climbs > 30_000.0
    assert climbed == pytest.approx(0.0, abs=0.01 * all_climbs)
    assert hilly == pytest.approx(level, abs=0.02 * all_climbs)


def turn_plan(plan: Plan) -> Plan:
    """A quarter turn to the left."""
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
    return Plan((Mission(tuple(replace(leg, points=leg.points @ quarter) for leg in plan.missions[0].legs)),))


def test_a_plane_turned_with_its_plan_is_driven_the_same(build: Any, eg105: Tractor) -> None:
    plan = build.plan(build.two_passes())
    run = drive(plan, eg105, tilt(0.08, 0.06), PLOUGH)
    turned = drive(turn_plan(plan), eg105, tilt(-0.06, 0.08), PLOUGH)
    level = drive(plan, eg105, None, PLOUGH)
    assert turned.finish_s == pytest.approx(run.finish_s, abs=1e-9)
    assert np.abs(turned.record[:, 0, 0] + run.record[:, 0, 1]).max() < 1e-6
    assert np.abs(turned.record[:, 0, 1] - run.record[:, 0, 0]).max() < 1e-6
    rows = min(len(level.record), len(run.record))
    assert np.abs(level.record[:rows, 0, :2] - run.record[:rows, 0, :2]).max() > 5e-3  # the slope does act


STUCK = {
    "power": (tilt(0.0, 0.1), WorkLoad(engine_power_w=900.0), 0.1),
    "grip": (tilt(0.0, 0.2), WorkLoad(mobility_number=5.0, rolling_share=0.24), 0.2),
    "drive force": (None, WorkLoad(draft_n=(16_000.0, 0.0, 0.0)), 0.0),
    "brakes": (tilt(0.0, -0.9), WorkLoad(mobility_number=6.0, rolling_share=0.21), -0.9),
}


@pytest.mark.parametrize(("lacking", "slow"), [*((lacking, False) for lacking in STUCK), ("grip", True)])
def test_a_tractor_that_cannot_go_on_is_named_with_place_and_reason(eg105: Tractor, lacking: str, slow: bool) -> None:
    terrain, load, grade = STUCK[lacking]
    run = drive(NORTH, eg105, terrain, load, slow=slow)
    stall = run.stall
    assert run.outcome == "stall" and stall is not None and len(run.record) < 200
    assert (stall.lacking, stall.tractor, stall.leg) == (lacking, 0, 0)
    assert stall.grade == pytest.approx(grade, abs=1e-9)
    assert stall.needed_n > stall.available_n > 0.0
    assert math.dist((stall.x_m, stall.y_m), run.record[-1, 0, :2]) < 0.5


def test_a_load_of_nothing_changes_nothing(build: Any, eg105: Tractor) -> None:
    plan = gated(build)
    run, other = drive(plan, eg105, load=WorkLoad(), max_time_s=90.0), drive(plan, eg105, max_time_s=90.0)
    assert np.abs(run.record - other.record).max() < 1e-9
    assert run.finish_s == pytest.approx(other.finish_s, nan_ok=True)


@pytest.mark.parametrize("load", [None, PLOUGH])
def test_the_compiled_loop_drives_hills_as_plain_pymunk_does(build: Any, eg105: Tractor, load: WorkLoad | None) -> None:
    fast, slow = (drive(gated(build), eg105, HILLS, load, max_time_s=40.0, slow=slow) for slow in (False, True))
    assert_same(fast, slow)
    assert len(fast.roll_over) == 3 and fast.roll_over[0].margin_rad < math.atan(0.9) - 0.01


def test_a_changed_plan_on_hills_is_driven_as_in_a_new_world(build: Any, eg105: Tractor, implement: Implement) -> None:
    """Continued from a snapshot, with slip, slopes and margins of the first part."""
    simulator = IncrementalSimulator(eg105, implement, stop_clearance_m=0.5, terrain=HILLS, load=PLOUGH)
    first = [build.leg((0, -150), (0, 0), kind="track", implement=True), build.leg((0, 0), (0, 100))]
    later = [first[0], build.leg((0, 0), (0, 60))]
    for legs in (first, later):
        run = simulator.simulate(build.plan(legs), 400.0)
        world = World(build.plan(legs), eg105, implement, terrain=HILLS, load=PLOUGH)
        new = world.run(stop_clearance_m=0.5, max_time_s=400.0)
        assert_same_bits(run, new)
    assert simulator.resumed_at_s == 60.0


def test_paths_beyond_the_heights_are_refused(eg105: Tractor) -> None:
    with pytest.raises(VehicleError, match=r"heights go from \(-200, -200\) to \(200, 200\) m; keep the paths there"):
        World(build_line((0.0, 0.0), (0.0, 210.0)), eg105, Implement(), terrain=tilt(0.1, 0.0))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"draft_n": (1.0, 2.0)}, "three forces"),
        ({"draft_n": (-1.0, 0.0, 0.0)}, "three forces"),
        ({"engine_power_w": 0.0}, "power of the engine is 0 W; give 1 to inf W"),
        ({"driven_share": 1.2}, "give 0.05 to 1"),
        ({"mobility_number": math.nan}, "mobility number is nan"),
        ({"mobility_number": 10.0}, "that of each ground, and a soil with the mobility number 10 takes 0.1 alone"),
        ({"mobility_number": 4.0, "rolling_share": 0.2}, "is 0.2 of the weight, and a soil with .* takes 0.25 alone"),
        ({"centre_height_m": 20.0}, "give 0.01 to 10 m"),
    ],
)
def test_loads_that_nothing_can_have_are_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(VehicleError, match=words):
        WorkLoad(**values)
