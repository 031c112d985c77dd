"""Moisture after rain: the balance of FAO-56 by hand, its limits, and the soil that follows."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import seldom
from vehicle.model.soil import find_soil, get_soil_rows, load_soils
from vehicle.model.soil_water import (
    SoilWater,
    build_estimated_soil,
    compute_depletions,
    estimate_moisture,
    find_soil_water,
)

TEXTURES = sorted(name for name, rows in load_soils().items() if len(rows) > 1)
WATER = SoilWater(field_capacity=0.30, wilting_point=0.12, saturation=0.45, density=1.45)
TEW_MM, REW_MM = 0.24 * 150.0, 0.24 * 40.0
Days = list[tuple[float, float]]
DAYS = st.lists(st.tuples(st.floats(0.0, 60.0), st.floats(0.0, 8.0)), min_size=1, max_size=20)


def deplete(days: Days, start_share: float) -> float:
    rains, et0s = zip(*days, strict=True)
    return compute_depletions(rains, et0s, WATER, 0.15, start_share)[0]


def test_the_first_stage_dries_at_the_full_rate() -> None:
    """From field capacity, 1.2 x 3 mm a day while less than REW is gone: two days take 7.2 mm."""
    assert deplete([(0.0, 3.0)] * 2, 0.0) == pytest.approx(7.2)


def test_the_second_stage_falls_off_exponentially() -> None:
    """Beyond REW what is left of TEW shrinks by the factor 1 - 1.2 ET0 / (TEW - REW) a day."""
    factor = 1.0 - 1.2 * 3.0 / (TEW_MM - REW_MM)
    assert TEW_MM - deplete([(0.0, 3.0)] * 5, 0.5) == pytest.approx(0.5 * TEW_MM * factor**5)


def test_rain_refills_and_the_surplus_drains() -> None:
    depletion_mm, drained_mm = compute_depletions([50.0], [0.0], WATER, 0.15, 0.5)
    assert depletion_mm == 0.0 and drained_mm == pytest.approx(50.0 - 0.5 * TEW_MM)


@given(DAYS, st.floats(0.0, 1.0), st.integers(0, 19), st.floats(0.1, 30.0))
def test_depletion_stays_within_its_limits_and_more_rain_never_dries(
    days: Days, start: float, number: int, more_mm: float
) -> None:
    plain = deplete(days, start)
    assert 0.0 <= plain <= TEW_MM
    number %= len(days)
    wetter = [(rain + more_mm * (n == number), et0) for n, (rain, et0) in enumerate(days)]
    warmer = [(rain, et0 + 0.5 * (n == number)) for n, (rain, et0) in enumerate(days)]
    assert deplete(wetter, start) <= plain + 1e-9 and deplete(warmer, start) >= plain - 1e-9


@pytest.mark.parametrize("name", TEXTURES)
def test_the_table_of_soils_says_how_much_water_there_is(name: str) -> None:
    """FAO-56, table 19: TEW of a layer of 10 cm is 6 mm (sand) to 29 mm (clay). Saturated soil has all pores full."""
    water = find_soil_water(get_soil_rows(name))
    assert 5.5 <= 100.0 * water.evaporable_share <= 31.0
    assert water.saturation + water.density / 2.65 == pytest.approx(1.0)
    assert water.convert_to_moisture_pct(0.0, 0.15) == pytest.approx(find_soil(name).moisture_pct)


@pytest.mark.parametrize("name", [*list(TEXTURES)[::3], *seldom(*list(TEXTURES)[1::3], *list(TEXTURES)[2::3])])
@given(days=DAYS)
def test_an_estimate_is_a_moisture_of_the_soil_within_its_interval(name: str, days: Days) -> None:
    rows = get_soil_rows(name)
    rains, et0s = [rain for rain, _ in days], [(et0, 0.8 * et0, 1.2 * et0) for _, et0 in days]
    estimate = estimate_moisture(rows, rains, et0s)
    assert (rows[0].moisture_pct or 0.0) <= estimate.low_pct <= estimate.moisture_pct <= estimate.high_pct
    assert estimate.high_pct <= (rows[-1].moisture_pct or 0.0) + 1e-9
    assert estimate.days == len(days) and estimate.rain_mm == pytest.approx(math.fsum(rains))
    soil = build_estimated_soil(rows, estimate)
    assert soil.low_kpa is not None and soil.cone_index_kpa is not None and soil.high_kpa is not None
    assert soil.low_kpa <= soil.cone_index_kpa * (1 + 1e-9) and soil.cone_index_kpa <= soil.high_kpa * (1 + 1e-9)


def test_a_wet_week_leaves_field_capacity_and_what_fell_last_may_not_have_drained() -> None:
    rows = get_soil_rows("loam")
    estimate = estimate_moisture(rows, [15.0] * 7, [(0.0, 0.0, 0.0)] * 7)
    assert estimate.moisture_pct == estimate.low_pct == pytest.approx(18.7)
    assert estimate.high_pct == pytest.approx(
        18.7 + 100.0 * 15.0 / (1000.0 * 0.10 * find_soil_water(rows).density), 1e-6
    )
