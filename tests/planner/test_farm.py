"""The farm file: what it holds, where its defaults are from, what is refused, and what a plan takes from it."""

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fields.documents.reader import read_field
from planner.day.input_file import load_day
from planner.errors import FieldError, HeadlandError, RequestError
from planner.farm.inventory import FarmFile, load_example_farm, load_farm, parse_farm
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.random_inputs import UncertaintySettings
from planner.farm.settings import NONE_GIVEN, FarmPrices, FarmTimes, Yard, get_default_source, read_example_text
from planner.farm.value_sources import GIVEN, build_farm_sheet, format_farm_json, list_values
from planner.pipeline.farm_inputs import complete_request_by_farm
from planner.request.plan_request import PlanRequest
from tests.test_structure import ROOT
from vehicle.datasheet.build import build_tractor
from vehicle.datasheet.sheet import build_datasheet
from vehicle.model.tractor import load_tractor
from vehicle.model.tractor_writer import format_tractor_toml

SECTIONS = (FarmTractor, FarmImplement, FarmPrices, FarmTimes, UncertaintySettings, Yard)
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


def refusal(text: str) -> str:
    with pytest.raises(HeadlandError) as refused:
        parse_farm(text, "farm.toml")
    return str(refused.value)


def test_the_example_is_a_farm() -> None:
    farm = load_example_farm()
    assert [tractor.name for tractor in farm.tractors] == ["Fendt 724", "EG105"]
    assert farm.get_tractor().build_tractor().mass_kg == 8000.0
    assert farm.get_tractor("EG105").build_tractor().name == "Yanmar EG105"
    assert farm.get_implement("sprayer").tractors == ("Fendt 724",)
    # 600 kg of seed at 180 kg a hectare.
    assert farm.get_implement("drill").area_per_load_m2 == pytest.approx(10_000.0 * 600.0 / 180.0)
    assert farm.get_implement("cultivator").area_per_load_m2 is None
    assert farm.get_implement("drill").speed_kmh == 7.0
    sections = set(FarmFile.model_fields) - {"learned"}  # what headland learn writes
    assert set(tomllib.loads(read_example_text("farm"))) == sections, "the example shows every section"


def test_an_empty_file_is_the_farm_of_the_defaults() -> None:
    farm = parse_farm("", "empty.toml")
    assert farm == FarmFile()
    assert farm.get_tractor().build_tractor().name == "Yanmar EG105" and farm.get_implement().width_m == 3.0
    assert farm.times.break_spans_s == () and farm.times.shift_span_s == (None, None)
    assert {value.source for value in list_values(farm) if value.section in ("prices", "uncertainty")} & {
        GIVEN
    } == set()


@pytest.mark.parametrize("section", SECTIONS)
def test_every_value_says_what_it_is_and_where_its_default_is_from(section: Any) -> None:
    for key, info in section.model_fields.items():
        if key in ("name", "sheet"):
            continue
        assert info.description, key
        assert get_default_source(section, key), key
        if info.default not in (None, ()):
            assert get_default_source(section, key) != NONE_GIVEN, f"{key} = {info.default} has no source"


def test_what_is_given_is_told_from_defaults() -> None:
    farm = parse_farm("[prices]\nfuel_per_l = 1.5\n", "one.toml")
    told = {(value.section, value.key): (value.value, value.source) for value in list_values(farm)}
    assert told["prices", "fuel_per_l"] == (1.5, "given")
    assert told["prices", "interest_pct"] == (4.0, "assumed")
    assert build_farm_sheet(farm, "one.toml").words[-1].startswith("1 of ")
    assert '"fuel_per_l"' in format_farm_json(farm)


def test_all_faults_are_told_at_once() -> None:
    said = refusal(
        '[[tractors]]\nname = "one"\nsheep = 3\n[[implements]]\nname = "plough"\nwidth_m = -3.0\n'
        '[prices]\nfuel_per_litre = 1\ninterest_pct = -1.0\nyears = true\n[times]\nunfold_s = "long"\n[uncertainty]\n'
        "speed_cb = 1\nturn_cv = inf\n[yard]\nlon = 3.0\n"
    )
    for words in (
        "tractors.one.sheep is not known", "implements.plough.width_m = -3.0: give a number from 0.1",
        "prices.fuel_per_litre is not known (did you mean 'fuel_per_l'?)", "prices.interest_pct = -1", "prices.years",
        "times.unfold_s = 'long': give a number", "uncertainty.speed_cb is not known (did you mean 'speed_cv'?)",
        "uncertainty.turn_cv = inf", "yard: lat is missing beside lon",
    ):  # fmt: skip
        assert words in said, said


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nonsense = [", "is not TOML"),
        ('[tractors]\nname = "one"', "write its keys under the heading [[tractors]]"),
        ("tractors = []", "tractors is empty"),
        ("tractors = [3]", "tractors no. 1 = 3: write its keys under the heading [[tractors]]"),
        ("[[tractors]]\ncount = 2", "lacks tractors no. 1.name (in quotes)"),
        ('[[tractors]]\nname = "a"\n[[tractors]]\nname = "a"', "tractors has 'a' twice"),
        ('[[tractors]]\nname = "a"\ncount = 0', "tractors.a.count = 0"),
        ('[[tractors]]\nname = "a"\nwheelbase_m = 3.0', "belongs under sheet"),
        ('[[tractors]]\nname = "a"\nfile = "none.toml"', "'a' of the farm file farm.toml: The tractor 'none.toml'"),
        ('[[tractors]]\nname = "a"\nfile = "eg105"\nsheet = {wheelbase_m = 2.4, width_m = 2.0, turning_radius_m = 4.0}',
         "has both a file and a sheet"),
        ('[[tractors]]\nname = "a"\nsheet = {wheelbase_m = 2.4}', "lacks tractors.a.sheet.width_m (width over all, m"),
        ('[[tractors]]\nname = "a"\nsheet = {wheelbase_m = 2.4, width_m = 25.5, turning_radius_m = 4.0}', "2.55"),
        ('[[implements]]\nname = "i"\ncapacity = 3.0', "has capacity but no rate_per_m2 (l or kg per m2, usually"),
        ('[[implements]]\nname = "i"\nrate_per_m2 = 3.0', "has rate_per_m2 but no capacity"),
        ('[[implements]]\nname = "i"\noperation = "mulch"', "use 'till', 'sow'"),
        ('[[implements]]\nname = "i"\ntractors = ["EG10"]', "not a tractor of the farm"),
        ('[[tractors]]\nname = "a"\n[[tractors]]\nname = "b"\n[[implements]]\nname = "i"\ntractors = ["a"]',
         "no implement fits the tractor 'b'"),
        ('[[implements]]\nname = "i"\nwidth_m = 3.0\nframe_width_m = 9.0', "more than twice its width"),
        ('[times]\nbreaks = ["12"]', "write for instance '08:00-12:00'"),
        ('[times]\nbreaks = ["12:45-12:00"]', "lasts 23.2 h; use 12 h or less, with the earlier time first"),
        (
            '[times]\nshift_start = "7:00"\nshift_end = "9:00"\nbreaks = ["6:00-8:00", "8:00-9:30"]',
            "take its whole shift",
        ),
        ('[times]\nshift_start = "25:00"', "is not a time of day"),
        ("[chances]\nspeed_cv = 0.1", "is now [uncertainty]; rename it"),
        ("prizes = 3", "did you mean 'prices'?"),
        ('[prices]\ncurrency = ""', "prices.currency = '': give a text that is not empty"),
        ('[prices]\ncurrency = "pounds sterling"', "give a text of at most 12 characters"),
        ("fuel_per_l = 3", "belongs under [prices]"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_sentence_with_the_fix(text: str, words: str) -> None:
    said = refusal(text)
    assert words in said and said.endswith(".") and "\n" not in said


def test_times_past_midnight_are_of_the_next_day() -> None:
    times = FarmTimes(shift_start="18:00", shift_end="02:30", breaks=("23:45-00:15", "20:00-20:30"))
    assert times.shift_span_s == (18 * 3600, (24 + 2) * 3600 + 1800)
    assert times.break_spans_s == ((20 * 3600, 20 * 3600 + 1800), (23 * 3600 + 2700, 24 * 3600 + 900))
    assert FarmTimes(shift_start="07:00", shift_end="19:00").shift_span_s == (7 * 3600, 19 * 3600)


def test_files_of_tractors_are_looked_for_beside_the_farm(tmp_path: Path) -> None:
    sheet = build_datasheet({"wheelbase_m": 2.78, "width_m": 2.55, "turning_radius_m": 5.5})
    (tmp_path / "fendt.toml").write_text(format_tractor_toml(build_tractor("Fendt 724", sheet)), encoding="utf-8")
    place = tmp_path / "farm.toml"
    place.write_text('[[tractors]]\nname = "F"\nfile = "fendt.toml"\n', encoding="utf-8")
    farm = load_farm(place)
    assert farm.get_tractor("F").build_tractor().wheelbase_m == pytest.approx(2.78)
    assert farm.get_tractor("F").origin == str(tmp_path / "fendt.toml")


def test_an_uncertainty_is_read_and_the_others_are_as_usual() -> None:
    assert parse_farm("", "empty.toml").uncertainty == UncertaintySettings()
    uncertainty = parse_farm("[uncertainty]\nstop_durations_s = [5.0, 120]\nspeed_cv = 0.3", "one.toml").uncertainty
    assert uncertainty == UncertaintySettings(stop_durations_s=(5.0, 120.0), speed_cv=0.3)


def test_the_price_of_an_hour_by_hand() -> None:
    # Half the price goes over 6,000 and 2,000 hours: 5 and 5. Fuel: 80 kW, half of it, a quarter litre: 10. People: 5.
    found = complete_request_by_farm(PlanRequest(), parse_farm(PLAIN, "plain.toml"))
    assert found.request.price_per_hour == pytest.approx(25.0)
    flat = parse_farm(PLAIN.replace("[prices]", "[prices]\nper_hour = 30.0"), "flat.toml")
    assert complete_request_by_farm(PlanRequest(), flat).request.price_per_hour == pytest.approx(35.0)
    assert (
        complete_request_by_farm(PlanRequest(price_per_hour=40.0), flat, {"price_per_hour"}).request.price_per_hour
        == 40.0
    )


def test_a_plan_takes_machines_speeds_and_prices_from_the_farm() -> None:
    found = complete_request_by_farm(PlanRequest(), load_example_farm(), implement_name="drill")
    scenario = found.request
    assert (scenario.width_m, scenario.operation, scenario.tractors) == (3.0, "sow", (1, 2))
    assert scenario.speed_mps == pytest.approx(7.0 / 3.6) and scenario.turn_speed_mps == pytest.approx(5.0 / 3.6)
    assert scenario.price_per_tractor == 8.0
    assert found.cost_terms.tractor.name == "Fendt 724"
    assert found.implement.hitch_m == 1.4


def test_what_is_given_wins_over_the_farm() -> None:
    scenario = PlanRequest(width_m=4.0, speed_mps=1.0, tractor="EG105", tractors=(3,), operation="harvest")
    given_here = {"width_m", "speed_mps", "tractor", "tractors", "operation"}
    drill = load_example_farm().get_implement("drill").model_copy(update={"operation": None})
    farm = load_example_farm().model_copy(update={"implements": (drill,)})
    found = complete_request_by_farm(scenario, farm, given_here, implement_name="drill")
    expected = replace(scenario, turn_speed_mps=5.0 * (1.0 / 3.6), price_per_tractor=8.0, start_s=7 * 3600)
    expected = replace(expected, price_per_hour=found.request.price_per_hour)
    assert found.request == expected
    assert found.tractor == "eg105" and found.implement.width_m == 4.0


def test_a_tractor_that_is_not_the_farms_may_be_named_by_its_file() -> None:
    found = complete_request_by_farm(PlanRequest(tractor="mr1000a"), load_example_farm(), {"tractor"})
    assert found.cost_terms.tractor is None
    assert found.tractor is None and found.request.tractor == "mr1000a"


def test_machines_that_do_not_go_together_are_refused() -> None:
    with pytest.raises(RequestError, match=r"does not fit the tractor 'EG105'.*use one of: cultivator, drill"):
        complete_request_by_farm(
            PlanRequest(tractor="EG105"), load_example_farm(), {"tractor"}, implement_name="sprayer"
        )
    with pytest.raises(RequestError, match=r"no implement 'spryer' \(did you mean 'sprayer'"):
        complete_request_by_farm(PlanRequest(), load_example_farm(), implement_name="spryer")
    with pytest.raises(RequestError, match="no tractor 'Fent'"):
        complete_request_by_farm(PlanRequest(tractor="Fent"), load_example_farm(), {"tractor"})


@given(st.dictionaries(st.sampled_from(sorted(FarmPrices.model_fields)), st.floats(-1e3, 1e3), max_size=6))
def test_prices_are_taken_as_they_are_or_refused_by_name(values: dict[str, float]) -> None:
    text = "[prices]\n" + "".join(f"{key} = {value!r}\n" for key, value in values.items())
    try:
        farm = parse_farm(text, "farm.toml")
    except RequestError as refused:
        assert any(f"prices.{key}" in str(refused) for key in values)
    else:
        assert all(getattr(farm.prices, key) == value for key, value in values.items())


@pytest.mark.parametrize(
    ("read", "kind", "file", "key"),
    [
        (load_farm, "farm", "planner/day/example.toml", "light"),
        (load_day, "day", "planner/farm/example.toml", "implements"),
        (load_farm, "farm", "vehicle/data/eg105.toml", "mass_kg"),
        (load_tractor, "tractor", "planner/farm/example.toml", "prices"),
        (load_tractor, "tractor", "pyproject.toml", "project"),
    ],
)
def test_a_file_of_another_kind_is_refused_by_what_it_holds(
    read: Callable[[Path], object], kind: str, file: str, key: str
) -> None:
    with pytest.raises(HeadlandError, match=rf"The {kind} file .* is of another kind: it holds .*{key}.*; name anoth"):
        read(ROOT / file)


def test_a_misspelt_heading_makes_no_file_of_another_kind() -> None:
    with pytest.raises(RequestError, match=r"prises is not known \(did you mean 'prices'\?\)"):
        parse_farm("[prises]\nfuel_per_l = 1.0\n", "farm.toml")


def test_settings_are_no_field() -> None:
    with pytest.raises(FieldError, match="is TOML, as files of tractors, farms and days are, but fields are read from"):
        read_field(ROOT / "planner/day/example.toml")


@pytest.mark.parametrize(("operation", "name"), [("sow", "drill"), ("spray", "sprayer"), ("mow", "cultivator")])
def test_the_implement_is_the_first_of_the_operation_where_one_is_given(operation: str, name: str) -> None:
    farm = load_example_farm()
    order = complete_request_by_farm(PlanRequest(operation=operation), farm, {"operation"})
    assert order.cost_terms is not None and order.cost_terms.implement == farm.get_implement(name)
    assert order.request.operation == operation


def test_an_empty_file_is_no_farm(tmp_path: Path) -> None:
    (tmp_path / "farm.toml").write_text("\n")
    with pytest.raises(RequestError, match=r"'.*farm\.toml' is empty; give a farm file"):
        load_farm(tmp_path / "farm.toml")
