"""Kilowatt-hours of legs from forces and lengths by hand, and electric tractor files."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from vehicle.energy.fuel import DieselEngine, ElectricDrive, build_power_source
from vehicle.energy.load import build_work_load
from vehicle.energy.run_energy import LegMeter, build_leg_meter, compute_run_energy
from vehicle.errors import VehicleError
from vehicle.missions.plan import SWATH, Leg, LegTask, Mission, Plan
from vehicle.model.ground import GROUNDS, find_ground_index
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import BatteryParameters, Implement, Tractor, load_tractor
from vehicle.model.tractor_writer import format_tractor_toml
from vehicle.model.work_load import WorkLoad
from vehicle.records import GRAVITY_MPS2
from vehicle.sim.world import simulate
from vehicle.trials.sheets.tractor_check import describe_electric_drive

BATTERY = BatteryParameters(capacity_kwh=100.0, charger_kw=40.0, connect_s=60.0, reserve=0.2, standby_w=0.0)
J_PER_KWH = 3.6e6


def build_electric_tractor(battery: BatteryParameters = BATTERY) -> Tractor:
    """An EG105 with a battery."""
    return load_tractor("eg105").model_copy(update={"drive": "electric", "battery": battery})


def build_meter(draft_n: float, share: float, terrain: Terrain | None = None) -> LegMeter:
    load = WorkLoad(draft_n=(draft_n, 0.0, 0.0), rolling_share=share, driveline_efficiency=0.8, engine_power_w=77_000.0)
    meter = build_leg_meter(build_electric_tractor(), load, terrain)
    assert meter is not None
    return meter


def test_a_lap_takes_force_by_length_over_efficiencies() -> None:
    """A square of 400 m against 9 kN of draft and 5 % of the weight: F s / (0.8 x 0.85), and one start."""
    square = Leg(np.array([[0, 0], [100, 0], [100, 100], [0, 100], [0, 0]], dtype=float), 2.0, implement=True)
    meter = build_meter(9000.0, 0.05)
    force_n = 9000.0 + 0.05 * 3850.0 * GRAVITY_MPS2
    start_j = 0.5 * 3850.0 * 2.0**2
    expected = (force_n * 400.0 + start_j) / (0.8 * 0.85) / J_PER_KWH
    assert meter.compute_leg_kwh(square) == pytest.approx(expected, rel=1e-12)
    straight = meter.compute_straight_kwh(400.0, 2.0, True, "soil")
    assert straight == pytest.approx(expected, rel=1e-12)
    raised = meter.compute_straight_kwh(400.0, 2.0, False, "soil")
    assert straight - raised == pytest.approx(9000.0 * 400.0 / (0.8 * 0.85) / J_PER_KWH, rel=1e-9)


def test_a_lap_over_a_hill_takes_no_less_than_on_level_ground() -> None:
    """Where the draft outweighs the fall the hill takes nothing over a lap; with brakes it takes more."""
    heights = Terrain(-10.0, -10.0, 10.0, 0.02 * np.add.outer(np.zeros(13), np.arange(13) * 10.0))
    loop = Leg(np.array([[0, 0], [100, 0], [0, 0]], dtype=float), 2.0, implement=True)
    pulling, level = build_meter(9000.0, 0.05, heights), build_meter(9000.0, 0.05)
    assert pulling.compute_leg_kwh(loop) == pytest.approx(level.compute_leg_kwh(loop), rel=1e-6)
    steep = Terrain(-10.0, -10.0, 10.0, 10.0 * heights.heights_m)
    braked = build_meter(0.0, 0.05, steep).compute_leg_kwh(loop)
    assert braked > 1.5 * build_meter(0.0, 0.05).compute_leg_kwh(loop)


def test_the_simulated_drive_takes_what_the_meter_says() -> None:
    tractor = build_electric_tractor()
    load = build_work_load(tractor, 3.0, "till")
    leg = Leg(np.array([[0.0, 0.0], [150.0, 0.0]]), 1.4, implement=True, task=LegTask(SWATH))
    run = simulate(Plan((Mission((leg,)),)), tractor, Implement(), max_time_s=300.0)
    energy = compute_run_energy(run, tractor, load)
    meter = build_leg_meter(tractor, load, None)
    assert meter is not None and energy.energy_kwh is not None
    assert energy.unit == "kWh" and energy.fuel_l is None
    assert meter.compute_leg_kwh(leg) == pytest.approx(energy.energy_kwh, rel=0.02)


def test_charging_and_changing() -> None:
    """20 kWh at 40 kW take half an hour, and a minute to connect; a change takes the same for any amount."""
    drive = build_power_source(build_electric_tractor(), 77_000.0)
    assert isinstance(drive, ElectricDrive) and drive.usable_kwh == pytest.approx(80.0)
    assert drive.compute_charge_s(20.0) == pytest.approx(1860.0)
    changed = build_power_source(build_electric_tractor(BATTERY.model_copy(update={"change_s": 600.0})), 77_000.0)
    assert isinstance(changed, ElectricDrive) and changed.compute_charge_s(20.0) == 600.0
    assert isinstance(build_power_source(load_tractor("eg105"), 77_000.0), DieselEngine)
    assert build_leg_meter(load_tractor("eg105"), WorkLoad(engine_power_w=77_000.0), None) is None


@pytest.mark.parametrize("battery", [BATTERY, BATTERY.model_copy(update={"change_s": 600.0})])
def test_an_electric_file_reads_back_as_it_was(battery: BatteryParameters, tmp_path: Path) -> None:
    tractor = build_electric_tractor(battery)
    path = tmp_path / "electric.toml"
    path.write_text(format_tractor_toml(tractor), encoding="utf-8")
    assert load_tractor(path) == tractor
    assert tomllib.loads(path.read_text(encoding="utf-8"))["drive"] == "electric"
    assert ("change_s" in path.read_text(encoding="utf-8")) == (battery.change_s is not None)


def test_a_check_names_battery_and_charging() -> None:
    """80 kWh at 85 % give 77 kW for 0.88 h; the charger takes 2 h, and a minute to connect."""
    text = describe_electric_drive(build_electric_tractor())
    assert text == (
        "Electric: 80 of 100 kWh can be used, enough for 0.9 h at the full 77 kW of the motor; charging that takes "
        "2.0 h at 40 kW."
    )
    changed = describe_electric_drive(build_electric_tractor(BATTERY.model_copy(update={"change_s": 600.0})))
    assert changed.endswith("; changing the battery takes 10 min.")
    assert describe_electric_drive(load_tractor("eg105")) == ""


@pytest.mark.parametrize(("old", "new", "sentence"), [
    ("[battery]\n", "[batery]\n", "batery is not known (did you mean 'battery'?)"),
    ("capacity_kwh = 100.0", "capacity_kwh = 0.0", "battery.capacity_kwh = 0.0: give a number from 0.1 to 10000"),
    ("capacity_kwh = 100.0\n", "", "it lacks battery.capacity_kwh (kWh that the full battery holds"),
    ("reserve = 0.2", "reserve = 1.0", "battery.reserve = 1.0: give a number from 0 to 0.9"),
    ("charger_kw = 40.0", 'charger_kw = "40"', "battery.charger_kw = '40': give a number from 0.1 to 10000"),
    ('drive = "electric"', 'drive = "diesel"', 'add drive = "electric", or remove [battery]'),
    ('drive = "electric"', 'drive = "steam"', "drive = 'steam': use 'diesel' or 'electric'"),
    ("fuel_points = []", "fuel_points = [[31.0, 10.5], [46.0, 13.6]]", "burns no fuel; remove fuel_points"),
])  # fmt: skip
def test_a_wrong_file_is_refused_in_one_sentence(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    text = format_tractor_toml(build_electric_tractor())
    assert old in text
    path = tmp_path / "electric.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(VehicleError) as caught:
        load_tractor(path)
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(("section", "sentence"), [
    ("battery", 'drive = "electric" needs a section [battery] with capacity_kwh; add it'),
    ("engine", 'drive = "electric" needs the power of the motor; add power_kw under [engine]'),
])  # fmt: skip
def test_a_missing_section_is_named(tmp_path: Path, section: str, sentence: str) -> None:
    path = tmp_path / "electric.toml"
    path.write_text(format_tractor_toml(build_electric_tractor().model_copy(update={section: None})), encoding="utf-8")
    with pytest.raises(VehicleError) as caught:
        load_tractor(path)
    assert sentence in str(caught.value)


def test_rolling_alone_is_that_of_the_ground() -> None:
    """Without a soil a meter rolls on the ground of each leg."""
    load = WorkLoad(driveline_efficiency=0.8, engine_power_w=77_000.0)
    meter = build_leg_meter(build_electric_tractor(), load, None)
    assert meter is not None
    for ground in ("asphalt", "soil"):
        share = GROUNDS[find_ground_index(ground)].rolling_resistance
        work_j = share * 3850.0 * GRAVITY_MPS2 * 1000.0 + 0.5 * 3850.0
        assert meter.compute_straight_kwh(1000.0, 1.0, False, ground) == pytest.approx(work_j / 0.68 / J_PER_KWH)
    assert math.isclose(meter.drive.usable_kwh, 80.0)
