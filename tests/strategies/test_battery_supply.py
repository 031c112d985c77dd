"""Batteries as a supply: how much is charged at each stop, how long that takes, and how many stops there are."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies.rules.battery_supply import CHANGE, CHARGE, ESTIMATE_MARGIN, BatterySupply
from strategies.rules.supply import Supply
from strategies.service_stops.tour_stops import TourNeeds, choose_stops
from vehicle.energy.fuel import ElectricDrive
from vehicle.energy.run_energy import LegMeter
from vehicle.missions.plan import REFILL, Leg
from vehicle.model.tractor import BatteryParameters, load_tractor
from vehicle.model.work_load import WorkLoad

EG105 = load_tractor("eg105")


def build_supply(trip_kwh: float = 0.0, change_s: float | None = None) -> BatterySupply:
    """40 kWh to use, charged with 20 kW in 3 minutes per kWh, and 90 s to connect."""
    drive = ElectricDrive(
        BatteryParameters(
            capacity_kwh=50.0, charger_kw=20.0, reserve=0.2, connect_s=90.0, change_s=change_s, standby_w=0.0
        )
    )
    meter = LegMeter(EG105, WorkLoad(rolling_share=0.1, engine_power_w=77_000.0), drive)
    return BatterySupply(40.0 - 2.0 * trip_kwh, 0.001, drive.stop_s, meter=meter, turn_kwh=0.01, trip_kwh=trip_kwh)


def test_a_charge_is_what_the_work_to_the_next_stop_needs() -> None:
    """40, then 30, then 10 kWh from a battery of 40: 30 and 10 are charged, and at the place 2 are for the ways."""
    assert build_supply().list_amounts([40.0, 30.0, 10.0]) == pytest.approx([30.0, 10.0])
    assert build_supply().list_amounts([25.0, 20.0]) == pytest.approx([5.0])
    assert build_supply().list_amounts([30.0]) == []
    by_place = build_supply(trip_kwh=2.0)
    assert by_place.list_amounts([36.0, 30.0, 10.0]) == pytest.approx([32.0, 12.0]), "left with 2, back with 4"
    assert build_supply(change_s=300.0).list_amounts([25.0, 20.0, 40.0]) == pytest.approx([25.0, 20.0])


def test_how_long_a_stop_takes() -> None:
    assert build_supply().compute_stop_s(10.0) == pytest.approx(90.0 + 1800.0)
    assert build_supply(change_s=300.0).compute_stop_s(10.0) == 300.0
    assert build_supply().estimate_stop_s(100.0) == pytest.approx(90.0 + 60.0 * 180.0 / 2.0), "two stops for 60 kWh"
    assert (build_supply().service, build_supply(change_s=9.0).service, Supply(1.0, 1.0, 1.0).service) == (
        CHARGE, CHANGE, REFILL,
    )  # fmt: skip


@given(st.lists(st.floats(0.1, 36.0), min_size=1, max_size=8), st.floats(0.0, 2.0), st.booleans())
def test_no_battery_goes_below_its_reserve_or_above_full(loads: list[float], trip: float, is_changed: bool) -> None:
    supply = build_supply(trip, 300.0 if is_changed else None)
    level = supply.usable_kwh
    for number, (load, amount) in enumerate(zip(loads, [*supply.list_amounts(loads), 0.0], strict=True)):
        level -= load + trip * ((number > 0) + (number < len(loads) - 1))
        assert level >= -1e-9
        level += amount
        assert level <= supply.usable_kwh + 1e-9
    if not is_changed and trip == 0.0 and all(load > 20.0 for load in loads):
        charged = math.fsum(supply.list_amounts(loads))
        assert charged == pytest.approx(max(math.fsum(loads) - supply.usable_kwh, 0.0), abs=1e-9)


@pytest.mark.parametrize("pieces", [7, 8, 9, 16, 17, 40])
def test_stops_are_as_few_as_can_be(pieces: int) -> None:
    """Pieces of 5 kWh, eight to a battery: ceil(5 n / 40) loads."""
    supply = build_supply()
    needs = TourNeeds([5.0] * pieces, [0.0] * pieces, [0.0] * (pieces + 1), [0.0] * (pieces + 1))
    costs_s = [supply.estimate_stop_s(5.0 * pieces)] * pieces
    found = choose_stops(needs, costs_s, supply.capacity, lambda gap, later_s: 0.0)
    assert found is not None and len(found) == math.ceil(5.0 * pieces / 40.0) - 1


def test_ways_between_work_count_as_well() -> None:
    """A leg of 100 m rolls with a tenth of the weight; driveline 1, motor 0.85."""
    leg = Leg(np.array([[0.0, 0.0], [100.0, 0.0]]), 1.0)
    supply = build_supply()
    expected = (0.1 * EG105.mass_kg * 9.80665 * 100.0 + 0.5 * EG105.mass_kg) / 0.85 / 3.6e6
    assert supply.compute_legs_need([leg, leg], 3.0) == pytest.approx(2.0 * (1.0 + ESTIMATE_MARGIN) * expected)
    assert Supply(1.0, 1.0, 1.0).compute_legs_need([leg, leg], 3.0) == 0.0, "nothing is spread there"
