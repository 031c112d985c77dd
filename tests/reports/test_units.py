"""Units of the United States beside metric ones: conversions by hand, and what a screen shows."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.common import wording as units
from reports.common.language import US, Reader, use_reader
from reports.plan.many_fields import build_many_fields_screen
from reports.plan.ranking_table import build_first_screen
from tests.printing import print_text
from tests.reports.screen_cases import RANKINGS, build_records

AMERICAN = Reader(units=US)


def test_metric_figures() -> None:
    assert [units.format_width(3.0), units.format_width(2.55)] == ["3 m", "2.55 m"]
    assert [units.format_area(999.4), units.format_area(12_345.0)] == ["999 m2", "1.23 ha"]
    assert [units.VOLUME.format(31.4), units.SPEED.format(5.4, 1), units.FIELD_AREA.format(1.889, 2)] == [
        "31 l", "5.4 km/h", "1.89 ha",
    ]  # fmt: skip
    assert units.FIELD_AREA.format(math.nan) == "-"


def test_figures_of_the_united_states() -> None:
    """One foot is 0.3048 m, an acre 43,560 square feet, a mile 5280 feet, a gallon 231 cubic inches of 0.0254 m."""
    with use_reader(AMERICAN):
        assert units.format_width(3.0) == "9.8 ft"
        assert units.format_area(43_560 * 0.3048**2 * 2.5) == "2.50 ac"
        assert units.format_area(100 * 0.3048**2) == "100 ft2"
        assert units.FIELD_AREA.format(1.0, 2) == "2.47 ac"
        assert units.VOLUME.format(1000 * 231 * 0.0254**3 * 8) == "8 gal"
        assert units.SPEED.format(5280 * 0.3048 * 4 / 1000, 1) == "4.0 mph"
        assert units.FIELD_AREA.convert_rate(100.0) == pytest.approx(40.468564224)


@given(value=st.floats(0.0, 1e6))
def test_conversions_are_proportional(value: float) -> None:
    pairs = ((units.SMALL_AREA, 0.09290304), (units.VOLUME, 3.785411784), (units.FIELD_AREA, 0.40468564224))
    for quantity, unit in pairs:
        assert quantity.convert(value) == value and quantity.convert(None) is None
        with use_reader(AMERICAN):
            assert quantity.convert(value) == pytest.approx(value / unit) and quantity.convert(None) is None


def test_first_screens_are_in_units_of_the_reader() -> None:
    ranking = RANKINGS["rain"] if "rain" in RANKINGS else next(iter(RANKINGS.values()))
    metric = print_text(build_first_screen(ranking), 100)
    with use_reader(AMERICAN):
        text = print_text(build_first_screen(ranking), 100)
        many = print_text(build_many_fields_screen(build_records()), 100)
    assert f"{ranking.area_ha / 0.40468564224:.2f} ac" in text and " ha" not in text and " m," not in text
    assert f"{ranking.area_ha:.2f} ha" in metric and " ft" not in metric
    assert "/ac)" in many and "/ha" not in many
