"""Soils: the grounds of the thesis, textures against the formulas they come from, and tables of users."""

import math
import statistics
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.errors import VehicleError
from vehicle.model.ground import TYRE_GROUNDS, get_tyres
from vehicle.model.soil import find_soil, get_soil_rows, load_soils

KPA_PER_PSI, DIAL_KPA = 6.895, 2068.0
TEXTURES = {name for name, rows in load_soils().items() if len(rows) > 1}
# Clay (%), dry bulk density (kg/m3) and the a and b of Frankenstein and Koenig's class (SM, ML, CL).
FORMULAS = {
    "sandy loam": (10, 1490, 8.749, -1.1949),
    "loam": (20, 1470, 10.225, -1.565),
    "clay loam": (35, 1410, 10.998, -1.848),
}


def compute_cone_indices_kpa(name: str, moisture_pct: float) -> tuple[float, float, float]:
    """Collins 1971, Frankenstein and Koenig 2004 (ERDC SR-04-1) and Witney et al. 1984, capped at the dial."""
    clay, density, a, b = FORMULAS[name]
    water = math.log(moisture_pct)
    collins = KPA_PER_PSI * math.exp(4.605 + (2.123 + 0.008 * clay - 0.693 * water) / (0.149 + 0.002 * clay))
    koenig = KPA_PER_PSI * math.exp(a + b * water)
    ratio = clay / (100.0 - clay)
    witney = 15.92 * ratio * math.exp(-0.08 * moisture_pct) + 2.58e-5 * density * math.exp(math.pi / (1.0 + ratio))
    capped = sorted(min(value, DIAL_KPA) for value in (collins, koenig, 1000.0 * witney))
    return capped[0], statistics.median(capped), capped[2]


@pytest.mark.parametrize("ground", TYRE_GROUNDS)
def test_grounds_of_the_thesis_are_rows(ground: str) -> None:
    soil = find_soil(ground)
    assert soil.ground == ground and soil.cone_index_kpa is None and "thesis" in soil.source
    assert soil.rolling_share == get_tyres(ground, "nonlinear").rolling_resistance


@pytest.mark.parametrize("name", sorted(FORMULAS))
def test_rows_are_the_middle_of_three_formulas(name: str) -> None:
    for row in get_soil_rows(name):
        assert row.moisture_pct is not None and "Collins" in row.source
        # Moistures are rounded to 0.1 %, of which Collins' formula makes up to 6 %.
        expected = compute_cone_indices_kpa(name, row.moisture_pct)
        assert (row.low_kpa, row.cone_index_kpa, row.high_kpa) == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("name", sorted(FORMULAS))
def test_between_rows_values_follow_the_formulas(name: str) -> None:
    """Halfway, within 15 %: half of the 30 % by which the formulas differ among each other."""
    rows = get_soil_rows(name)
    for drier, wetter in pairwise(rows):
        assert drier.moisture_pct is not None and wetter.moisture_pct is not None
        middle_pct = 0.5 * (drier.moisture_pct + wetter.moisture_pct)
        soil = find_soil(name, middle_pct)
        assert soil.cone_index_kpa == pytest.approx(compute_cone_indices_kpa(name, middle_pct)[1], rel=0.15)
        assert f"between {drier.moisture_pct:g} and {wetter.moisture_pct:g} % moisture" in soil.source


@given(st.sampled_from(sorted(TEXTURES)), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_wetter_soil_is_never_firmer(name: str, first: float, second: float) -> None:
    rows = get_soil_rows(name)
    low, high = rows[0].moisture_pct or 0.0, rows[-1].moisture_pct or 0.0
    drier, wetter = (find_soil(name, low + share * (high - low)) for share in sorted((first, second)))
    for soil in (drier, wetter):
        assert soil.cone_index_kpa and soil.low_kpa and soil.high_kpa
        assert soil.low_kpa <= soil.cone_index_kpa <= soil.high_kpa
    assert (wetter.cone_index_kpa or 0.0) <= (drier.cone_index_kpa or 0.0) + 1e-9


def test_a_line_is_hit_exactly_and_field_capacity_is_usual() -> None:
    usual = find_soil("loam")
    assert usual.moisture_pct == 18.7 and usual.cone_index_kpa == 1947.0
    exact, wettest = find_soil("loam", 18.7), find_soil("loam", 30.4)
    assert exact == usual and wettest.cone_index_kpa == 817.0 and wettest.high_kpa == 908.0
    assert len(TEXTURES) == 9 and {find_soil(name).draft for name in TEXTURES} == {"coarse", "medium", "fine"}


def test_an_own_table_is_interpolated_with_the_error_of_measurements(tmp_path: Path) -> None:
    path = tmp_path / "soils.csv"
    lines = "name,moisture_pct,cone_index_kpa,draft,clay_pct", "home,30,400,fine", "home,20,900,fine,"
    path.write_text("\n".join(lines), encoding="utf-8")  # empty or not there is left out
    soil = find_soil("home", 25.0, path)
    assert soil.cone_index_kpa == pytest.approx(600.0) and soil.draft == "fine"  # the geometric mean
    assert (soil.low_kpa, soil.high_kpa) == pytest.approx((420.0, 780.0))
    with pytest.raises(VehicleError, match="'home' has 2 lines by moisture; say how wet it is, from 20 to 30 %"):
        find_soil("home", None, path)


@pytest.mark.parametrize(("name", "moisture_pct", "sentence"), [
    ("lom", None, r"The soil 'lom' is unknown \(did you mean 'loam'\?\); use one of: asphalt, soil, mud"),
    ("loam", 60.0, "The moisture 60 % is outside of what is known of the soil 'loam'; give one from 9.1 to 30.4 %."),
    ("mud", 20.0, "The soil 'mud' is the same at any moisture; leave out the moisture or name a texture."),
])  # fmt: skip
def test_what_is_not_known_is_refused(name: str, moisture_pct: float | None, sentence: str) -> None:
    with pytest.raises(VehicleError, match=sentence):
        find_soil(name, moisture_pct)


@pytest.mark.parametrize(("text", "sentence"), [
    ("name,cone_index_kpa\na,wet\n", "not a soil: cone_index_kpa = 'wet': give a number from 10 to 20000"),
    ("name,moisture_pct\na,20\n", "Line 2 of .* is not a soil: give either cone_index_kpa or ground."),
    ("name,ground\na,ice\n", "the ground 'ice' is unknown; use one of: asphalt, soil, mud"),
    ("name,cone_index_kpa,low_kpa\na,500,600\n", "cone_index_kpa 500 lies outside of low_kpa to high_kpa"),
    ("name,cone_index_kpa\na,500\na,600\n", "The soil 'a' has 2 lines; give each another moisture_pct"),
    ("name,cone_index_kpa,colour\na,500,red\n", "colour is not known"),
    ('name,cone_index_kpa\n"' + "a" * 140_000 + '",500\n', "is not a CSV file .field larger than field limit"),
    ("name,cone_index_kpa,moisture_pct\na,500,120\n", "moisture_pct = '120': give a number from 0 to 100"),
])  # fmt: skip
def test_a_fault_of_an_own_table_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "soils.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(VehicleError, match=sentence) as caught:
        load_soils(path)
    assert str(caught.value).count("\n") == 0
