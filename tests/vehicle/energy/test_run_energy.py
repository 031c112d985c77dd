"""Energy of runs: closed forms on made records, conservation, and a plan that the loop drove."""

import dataclasses
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fields.arrays import Floats, Integers
from vehicle.energy.fuel import DieselEngine, ElectricDrive, compute_diesel_lph
from vehicle.energy.load import build_work_load
from vehicle.energy.run_energy import BRAKING, CAUSES, DRAFT, GRADE, ROLLING, SLIP, RunEnergy, compute_run_energy
from vehicle.energy.traction import compute_tractive_efficiency, solve_slip
from vehicle.missions.plan import SWATH, Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.model.soil import find_soil
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import BatteryParameters, Implement, load_tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import FINISHED, RECORD_COLUMNS, WAITING, WORKING
from vehicle.sim.world import World

EG105 = load_tractor("eg105")
GRAVITY_MPS2 = 9.80665
STEP_S = 0.1


def make_run(places: Floats, speeds: Floats, statuses: int | Integers = WORKING) -> SimulationRun:
    """A run of one tractor on one leg, from what its 10 Hz record holds."""
    record = np.zeros((len(places), 1, len(RECORD_COLUMNS)))
    record[:, 0, :2], record[:, 0, 4], record[:, 0, 6] = places, speeds, statuses
    leg = Leg(np.array([places[0], places[0] + [1.0, 0.0]]), 1.0, implement=True)
    return SimulationRun(
        plan=Plan((Mission((leg,)),)),
        outcome=DONE,
        time_s=np.arange(len(places)) * STEP_S,
        record=record,
        finish_s=np.array([(len(places) - 1) * STEP_S]),
        contacts=(),
        min_clearance_m=math.inf,
    )


def make_straight_run(speed_mps: float, seconds: float = 100.0, statuses: Any = WORKING) -> SimulationRun:
    metres = speed_mps * np.arange(round(seconds / STEP_S) + 1) * STEP_S
    return make_run(np.column_stack([metres, 0.0 * metres]), np.full(len(metres), speed_mps), statuses)


def make_hills() -> Terrain:
    """Rolling ground of 120 x 120 m, with slopes up to about 15 %."""
    east, north = np.meshgrid(np.linspace(-60, 60, 61), np.linspace(-60, 60, 61))
    return Terrain(-60.0, -60.0, 2.0, 3.0 * np.sin(east / 25.0) + 2.5 * np.cos(north / 18.0) + 0.02 * east)


def make_slope(grade: float) -> Terrain:
    """A plane that rises to the east."""
    east = np.linspace(-10.0, 500.0, 52)
    return Terrain(-10.0, -10.0, 10.0, np.tile(grade * east, (3, 1)))


def sum_work(energy: RunEnergy, cause: int) -> float:
    return float(energy.tractors[0].work_j[:, cause].sum())


def test_constant_speed_on_level_ground_by_hand() -> None:
    """200 m at 2 m/s in 100 s: draft and rolling by force times way, slip by tractive efficiency, litres by D497.7."""
    load = build_work_load(EG105, 3.0, "till", find_soil("firm"))
    energy = compute_run_energy(make_straight_run(2.0), EG105, load)
    weight_n, mobility = 3850.0 * GRAVITY_MPS2, load.mobility_number
    assert mobility is not None and load.rolling_share is not None
    draft_n = load.compute_draft_n(2.0)
    assert sum_work(energy, DRAFT) == pytest.approx(draft_n * 200.0)
    assert sum_work(energy, ROLLING) == pytest.approx(load.rolling_share * weight_n * 200.0)
    assert sum_work(energy, GRADE) == sum_work(energy, BRAKING) == 0.0
    slip = solve_slip(draft_n / weight_n, mobility, 0.3)
    axle_j = draft_n * 200.0 / compute_tractive_efficiency(slip, mobility)
    assert energy.tractors[0].work_j.sum() == pytest.approx(axle_j)
    share = axle_j / 100.0 / 0.86 / 77_000.0
    assert energy.fuel_l == pytest.approx(compute_diesel_lph(share, 0.9 * 77.0) * 100.0 / 3600.0)
    assert energy.co2_kg == pytest.approx(2.65 * (energy.fuel_l or 0.0)) and energy.energy_kwh is None


@given(st.floats(-0.1, 0.15), st.floats(0.5, 4.0))
def test_constant_speed_on_a_grade(grade: float, speed_mps: float) -> None:
    """Work against the slope is weight times rise; where it drives the tractor, the brakes take the rest."""
    load = WorkLoad(rolling_share=0.05, engine_power_w=77_000.0, driveline_efficiency=0.86)
    energy = compute_run_energy(make_straight_run(speed_mps, 20.0), EG105, load, make_slope(grade))
    metres, weight_n = speed_mps * 20.0, 3850.0 * GRAVITY_MPS2
    assert sum_work(energy, GRADE) == pytest.approx(weight_n * grade * metres, abs=1e-3)
    assert sum_work(energy, BRAKING) == pytest.approx(max(-(grade + 0.05), 0.0) * weight_n * metres, abs=1e-3)
    share = (grade + 0.05) * weight_n * speed_mps * (1.0 / 0.86 if grade > -0.05 else 0.86) / 77_000.0
    assert energy.total == pytest.approx(compute_diesel_lph(share, 0.9 * 77.0) * 20.0 / 3600.0, rel=1e-6)


@pytest.mark.parametrize("soil", ["firm", "mud"])
def test_over_a_closed_lap_the_slope_gives_back_what_it_took(soil: str) -> None:
    """Twice round a circle over hills, at a speed that changes and ends as it began.

    What the engine put into the axles is the change of kinetic energy, here none, and the losses.
    """
    load = build_work_load(EG105, 3.0, "till", find_soil(soil))
    angles = np.linspace(0.0, 4.0 * math.pi, 2401)
    places = 40.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    speeds = np.append(np.hypot(*np.diff(places, axis=0).T) / STEP_S, 0.0) * (1.0 + 0.2 * np.sin(angles))
    speeds[-1] = speeds[0]
    energy = compute_run_energy(make_run(places, speeds), EG105, load, make_hills())
    work = energy.tractors[0].work_j[0]
    assert abs(work[GRADE]) < 1e-6 * 3850.0 * GRAVITY_MPS2
    assert abs(work[CAUSES.index("acceleration")]) < 1e-6
    losses = work[ROLLING] + work[DRAFT] + work[SLIP] + work[BRAKING]
    assert energy.tractors[0].work_j.sum(axis=1)[0] == pytest.approx(losses, rel=1e-9)
    assert (work[SLIP] > 0.0) == (soil == "firm")
    level = compute_run_energy(make_run(places, speeds), EG105, load)
    assert energy.total >= level.total


def test_a_start_and_a_stop_cost_the_braking() -> None:
    """From standstill to 3 m/s and back without losses: m v^2 / 2 goes into the brakes."""
    speeds = np.concatenate([np.linspace(0.0, 3.0, 51), np.linspace(3.0, 0.0, 51)[1:]])
    metres = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * STEP_S)])
    load = WorkLoad(rolling_share=0.0, engine_power_w=77_000.0)
    energy = compute_run_energy(make_run(np.column_stack([metres, 0.0 * metres]), speeds), EG105, load)
    assert energy.tractors[0].work_j.sum(axis=1)[0] == pytest.approx(0.5 * 3850.0 * 9.0)
    assert sum_work(energy, BRAKING) == pytest.approx(0.5 * 3850.0 * 9.0)


def test_waiting_idles_and_after_the_end_nothing_is_taken() -> None:
    load = WorkLoad(engine_power_w=77_000.0)
    statuses = np.where(np.arange(1001) < 600, WAITING, FINISHED)
    energy = compute_run_energy(make_straight_run(0.0, statuses=statuses), EG105, load)
    engine = DieselEngine(77_000.0)
    assert energy.total == pytest.approx(60.0 * engine.idle_rate) == energy.tractors[0].idle.sum()
    assert energy.tractors[0].work_j.sum() == 0.0


def test_a_battery() -> None:
    load = WorkLoad(rolling_share=0.05, engine_power_w=77_000.0, driveline_efficiency=0.86)
    run = make_straight_run(2.0)
    electric = compute_run_energy(run, EG105, load, source=ElectricDrive(BatteryParameters(capacity_kwh=80.0)))
    push_w = 0.05 * 3850.0 * GRAVITY_MPS2 * 2.0
    assert electric.energy_kwh == pytest.approx((push_w / 0.86 / 0.85 + 500.0) * 100.0 / 3.6e6)
    assert electric.fuel_l is None and electric.co2_kg is None and electric.unit == "kWh"


@given(st.floats(0.0, 20_000.0), st.floats(1.0, 10_000.0))
def test_fuel_grows_with_draft(draft_n: float, more_n: float) -> None:
    run = make_straight_run(1.5, 5.0)
    less, energy = (
        compute_run_energy(
            run, EG105, WorkLoad((pull, 0.0, 0.0), engine_power_w=77e3, mobility_number=60.0, rolling_share=0.057)
        )
        for pull in (draft_n, draft_n + more_n)
    )
    assert energy.total > less.total and sum_work(energy, SLIP) > sum_work(less, SLIP)


@pytest.mark.slow
@pytest.mark.parametrize("grade", [0.0, 0.05])
def test_the_loop_gives_the_wheels_the_power_that_is_reckoned(grade: float) -> None:
    """An engine too weak for its set speed: where its speed is steady, the axles take all of its power."""
    load = dataclasses.replace(
        build_work_load(EG105, 3.0, "till", find_soil("firm")), engine_power_w=22_000.0, draft_n=(8000.0, 0.0, 0.0)
    )
    ends = [[0.0, 0.0], [60.0, 0.0], [160.0, 0.0], [170.0, 0.0]]
    legs = tuple(Leg(np.array(pair), 3.0, implement=True, task=LegTask(SWATH)) for pair in pairwise(ends))
    terrain = make_slope(grade)
    run = World(Plan((Mission(legs),)), EG105, Implement(), terrain=terrain, load=load).run(max_time_s=600.0)
    assert run.outcome == DONE
    energy = compute_run_energy(run, EG105, load, terrain)
    seconds = float((run.get_leg_numbers(0) == 1).sum()) * STEP_S
    assert 100.0 / seconds < 2.5
    assert energy.tractors[0].work_j.sum(axis=1)[1] / seconds == pytest.approx(load.axle_power_w, rel=1e-3)
