"""The farm file: what it holds, where its defaults are from, what is refused, and what a plan takes from it."""

import tomllib
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.asked import asked
from planner.chance.settings import Chances as Laws
from planner.chance.settings import like
from planner.errors import HeadlandError, ScenarioError
from planner.farm import Chances, FarmFile, FarmImplement, FarmTractor, Prices, Times, Yard, example_farm, example_text
from planner.farm.file import farm_from, load_farm
from planner.farm.sources import GIVEN, farm_json, farm_sheet, values_of
from planner.farm.values import NONE_GIVEN, source_of
from planner.scenario import Scenario
from vehicle.datasheet import sheet_from, tractor_from
from vehicle.measured.answer.save import tractor_toml

SECTIONS = (FarmTractor, FarmImplement, Prices, Times, Chances, Yard)


def refusal(text: str) -> str:
    with pytest.raises(HeadlandError) as refused:
        farm_from(text, "farm.toml")
    return str(refused.value)


def test_the_example_is_a_farm() -> None:
    farm = example_farm()
    assert [tractor.name for tractor in farm.tractors] == ["Fendt 724", "EG105"]
    assert farm.tractor().machine().mass_kg == 8000.0
    assert farm.tractor("EG105").machine().name == "Yanmar EG105"
    assert farm.implement("sprayer").tractors == ("Fendt 724",)
    # 600 kg of seed at 180 kg a hectare.
    assert farm.implement("drill").area_per_load_m2 == pytest.approx(10_000.0 * 600.0 / 180.0)
    assert farm.implement("cultivator").area_per_load_m2 is None
    assert farm.implement("drill").speed_mps == pytest.approx(7.0 / 3.6)
    sections = set(FarmFile.model_fields) - {"learned"}  # what headland learn writes
    assert set(tomllib.loads(example_text())) == sections, "the example shows every section"


def test_an_empty_file_is_the_farm_of_the_defaults() -> None:
    farm = farm_from("", "empty.toml")
    assert farm == FarmFile()
    assert farm.tractor().machine().name == "Yanmar EG105" and farm.implement().width_m == 3.0
    assert farm.times.breaks_s == () and farm.times.shift_s == (None, None)
    assert {value.source for value in values_of(farm) if value.section in ("prices", "chances")} & {GIVEN} == set()


@pytest.mark.parametrize("section", SECTIONS)
def test_every_value_says_what_it_is_and_where_its_default_is_from(section: Any) -> None:
    for key, info in section.model_fields.items():
        if key in ("name", "sheet"):
            continue
        assert info.description, key
        assert source_of(section, key), key
        if info.default not in (None, ()):
            assert source_of(section, key) != NONE_GIVEN, f"{key} = {info.default} has no source"


def test_what_is_given_is_told_from_defaults() -> None:
    farm = farm_from("[prices]\nfuel_per_l = 1.5\n", "one.toml")
    told = {(value.section, value.key): (value.value, value.source) for value in values_of(farm)}
    assert told["prices", "fuel_per_l"] == (1.5, "given")
    assert told["prices", "interest_pct"] == (4.0, "assumed")
    assert farm_sheet(farm, "one.toml").words[-1].startswith("1 of ")
    assert '"fuel_per_l"' in farm_json(farm)


def test_all_faults_are_told_at_once() -> None:
    said = refusal(
        '[[tractors]]\nname = "one"\nsheep = 3\n[[implements]]\nname = "plough"\nwidth_m = -3.0\n'
        "[prices]\nfuel_per_litre = 1\ninterest_pct = -1.0\nyears = true\n[times]\nunfold_s = \"long\"\n[chances]\n"
        "speed_cb = 1\nturn_cv = inf\n[yard]\nlon = 3.0\n"
    )
    for words in (
        "tractors.one.sheep is not known", "implements.plough.width_m = -3.0: give a number from 0.1",
        "prices.fuel_per_litre is not known (did you mean 'fuel_per_l'?)", "prices.interest_pct = -1", "prices.years",
        "times.unfold_s = 'long': give a number", "chances.speed_cb is not known (did you mean 'speed_cv'?)",
        "chances.turn_cv = inf", "yard: lat is missing beside lon",
    ):  # fmt: skip
        assert words in said, said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nonsense = [", "is not TOML"),
        ('[tractors]\nname = "one"', "two brackets"),
        ("tractors = []", "tractors is empty"),
        ("tractors = 3", "give a list in brackets"),
        ("[[tractors]]\ncount = 2", "lacks tractors no. 1.name (in quotes)"),
        ('[[tractors]]\nname = "a"\n[[tractors]]\nname = "a"', "tractors has 'a' twice"),
        ('[[tractors]]\nname = "a"\ncount = 0', "tractors.a.count = 0"),
        ('[[tractors]]\nname = "a"\nwheelbase_m = 3.0', "belongs under sheet"),
        ('[[tractors]]\nname = "a"\nfile = "none.toml"', "'a' of the farm file farm.toml: The tractor 'none.toml'"),
        ('[[tractors]]\nname = "a"\nfile = "eg105"\nsheet = {wheelbase_m = 2.4, width_m = 2.0, turning_radius_m = 4.0}',
         "has a file and a sheet"),
        ('[[tractors]]\nname = "a"\nsheet = {wheelbase_m = 2.4}', "lacks tractors.a.sheet.width_m (width over all, m"),
        ('[[tractors]]\nname = "a"\nsheet = {wheelbase_m = 2.4, width_m = 25.5, turning_radius_m = 4.0}', "2.55"),
        ('[[implements]]\nname = "i"\ncapacity = 3.0', "has capacity but no rate_per_m2 (l or kg per m2, usually"),
        ('[[implements]]\nname = "i"\nrate_per_m2 = 3.0', "has rate_per_m2 but no capacity"),
        ('[[implements]]\nname = "i"\noperation = "mulch"', "use 'till', 'sow'"),
        ('[[implements]]\nname = "i"\ntractors = ["EG10"]', "no tractor of the farm"),
        ('[[tractors]]\nname = "a"\n[[tractors]]\nname = "b"\n[[implements]]\nname = "i"\ntractors = ["a"]',
         "no implement fits the tractor 'b'"),
        ('[[implements]]\nname = "i"\nwidth_m = 3.0\nframe_width_m = 9.0', "more than twice its width"),
        ('[times]\nbreaks = ["12"]', "write for instance '12:00-12:30'"),
        ('[times]\nbreaks = ["12:45-12:00"]', "lasts 23.2 h; use 12 h or less, the earlier time first"),
        ('[times]\nshift_start = "7:00"\nshift_end = "9:00"\nbreaks = ["6:00-8:00", "8:00-9:30"]', "leave nothing"),
        ('[times]\nshift_start = "25:00"', "is not a time of day"),
        ("prizes = 3", "did you mean 'prices'?"),
        ('[prices]\ncurrency = ""', "prices.currency = '': give a text that is not empty"),
        ('[prices]\ncurrency = "pounds sterling"', "give a text of at most 12 letters"),
        ("fuel_per_l = 3", "belongs under [prices]"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_sentence_with_the_fix(text: str, words: str) -> None:
    said = refusal(text)
    assert words in said and said.endswith(".") and "\n" not in said


def test_times_past_midnight_are_of_the_next_day() -> None:
    times = Times(shift_start="18:00", shift_end="02:30", breaks=("23:45-00:15", "20:00-20:30"))
    assert times.shift_s == (18 * 3600, (24 + 2) * 3600 + 1800)
    assert times.breaks_s == ((20 * 3600, 20 * 3600 + 1800), (23 * 3600 + 2700, 24 * 3600 + 900))
    assert Times(shift_start="07:00", shift_end="19:00").shift_s == (7 * 3600, 19 * 3600)


def test_files_of_tractors_are_looked_for_beside_the_farm(tmp_path: Path) -> None:
    sheet = sheet_from({"wheelbase_m": 2.78, "width_m": 2.55, "turning_radius_m": 5.5})
    (tmp_path / "fendt.toml").write_text(tractor_toml(tractor_from("Fendt 724", sheet)), encoding="utf-8")
    place = tmp_path / "farm.toml"
    place.write_text('[[tractors]]\nname = "F"\nfile = "fendt.toml"\n', encoding="utf-8")
    farm = load_farm(place)
    assert farm.tractor("F").machine().wheelbase_m == pytest.approx(2.78)
    assert farm.tractor("F").origin == str(tmp_path / "fendt.toml")


def test_chances_are_the_settings_of_the_draws() -> None:
    assert set(Chances.model_fields) == {each.name for each in fields(Laws)}
    assert like(farm_from("", "empty.toml").chances) == Laws()
    assert like(farm_from("[chances]\nstop_durations_s = [5.0, 120]", "one.toml").chances).stop_durations_s == (5, 120)


PLAIN = """
[prices]
first_year_value = 0.5
later_year_value = 1.0
implement_first_year_value = 0.5
implement_later_year_value = 1.0
interest_pct = 0.0
insurance_pct = 0.0
repair_factor = 0.0
implement_repair_factor = 0.0
fuel_per_l = 1.0
fuel_l_per_kwh = 0.25
work_load = 0.5
oil_share = 0.0
supervision_per_hour = 20.0
supervision_share = 0.25
years = 10.0
hours_per_year = 600.0
implement_hours_per_year = 200.0
[[tractors]]
name = "T"
price = 60000.0
power_kw = 80.0
[[implements]]
name = "I"
price = 20000.0
"""


def test_the_price_of_an_hour_by_hand() -> None:
    # Half the price goes over 6,000 and 2,000 hours: 5 and 5. Fuel: 80 kW, half of it, a quarter litre: 10. People: 5.
    found = asked(Scenario(), farm_from(PLAIN, "plain.toml"))
    assert found.scenario.price_per_hour == pytest.approx(25.0)
    flat = farm_from(PLAIN.replace("[prices]", "[prices]\nper_hour = 30.0"), "flat.toml")
    assert asked(Scenario(), flat).scenario.price_per_hour == pytest.approx(35.0)
    assert asked(Scenario(), flat, {"price_per_hour"}).scenario.price_per_hour == 40.0


def test_a_plan_takes_machines_speeds_and_prices_from_the_farm() -> None:
    found = asked(Scenario(), example_farm(), implement="drill")
    scenario = found.scenario
    assert (scenario.width_m, scenario.operation, scenario.tractors) == (3.0, "sow", (1, 2))
    assert scenario.speed_mps == pytest.approx(7.0 / 3.6) and scenario.turn_speed_mps == pytest.approx(5.0 / 3.6)
    assert scenario.price_per_tractor == 8.0
    assert found.own is not None and found.own.name == "Fendt 724" and found.implement is not None
    assert found.implement.hitch_m == 1.4


def test_what_is_given_wins_over_the_farm() -> None:
    scenario = Scenario(width_m=4.0, speed_mps=1.0, tractor="EG105", tractors=(3,), operation="harvest")
    given_here = {"width_m", "speed_mps", "tractor", "tractors", "operation"}
    found = asked(scenario, example_farm(), given_here, implement="drill")
    expected = replace(scenario, turn_speed_mps=5.0 * (1.0 / 3.6), price_per_tractor=8.0, start_s=7 * 3600)
    expected = replace(expected, price_per_hour=found.scenario.price_per_hour)
    assert found.scenario == expected
    assert found.tractor == "eg105" and found.implement is not None and found.implement.width_m == 4.0


def test_a_tractor_that_is_not_the_farms_may_be_named_by_its_file() -> None:
    found = asked(Scenario(tractor="mr1000a"), example_farm(), {"tractor"})
    assert found.own is None and found.tractor is None and found.scenario.tractor == "mr1000a"


def test_machines_that_do_not_go_together_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"does not fit the tractor 'EG105'.*use one of: cultivator, drill"):
        asked(Scenario(tractor="EG105"), example_farm(), {"tractor"}, implement="sprayer")
    with pytest.raises(ScenarioError, match=r"no implement 'spryer' \(did you mean 'sprayer'"):
        asked(Scenario(), example_farm(), implement="spryer")
    with pytest.raises(ScenarioError, match="no tractor 'Fent'"):
        asked(Scenario(tractor="Fent"), example_farm(), {"tractor"})


@given(st.dictionaries(st.sampled_from(sorted(Prices.model_fields)), st.floats(-1e3, 1e3), max_size=6))
def test_prices_are_taken_as_they_are_or_refused_by_name(values: dict[str, float]) -> None:
    text = "[prices]\n" + "".join(f"{key} = {value!r}\n" for key, value in values.items())
    try:
        farm = farm_from(text, "farm.toml")
    except ScenarioError as refused:
        assert any(f"prices.{key}" in str(refused) for key in values)
    else:
        assert all(getattr(farm.prices, key) == value for key, value in values.items())
