"""One model of a plan request: names, types, defaults, limits and helps of the command line and the API are its own."""

import inspect
from dataclasses import fields
from fractions import Fraction
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from planner.cli.common.options import get_option_name
from planner.cli.field import field
from planner.cli.plan import plan
from planner.errors import RequestError, strip_unit
from planner.request.options import list_options
from planner.request.plan_options import PLAN_OPTIONS
from planner.request.plan_request import PlanRequest
from planner.service.jobs.input_files import PLAN_JOB_MODEL

OPTIONS = {option.name: option for option in PLAN_OPTIONS}


def get_help(parameter: inspect.Parameter) -> str:
    """The help text of a parameter of a command."""
    return str(get_args(parameter.annotation)[1].help)


def test_the_command_has_every_option_with_its_default_help_and_panel() -> None:
    parameters = inspect.signature(plan).parameters
    for name, option in OPTIONS.items():
        if name in ("field", "width"):  # plan takes several of them
            continue
        assert parameters[name].default == option.default, name
        assert get_help(parameters[name]) == option.format_help(get_option_name), name
        assert get_args(parameters[name].annotation)[1].rich_help_panel == option.panel, name


def test_the_command_field_takes_its_options_from_the_same_model() -> None:
    parameters = inspect.signature(field).parameters
    shared = OPTIONS.keys() & parameters.keys() - {"field"}
    assert {"width", "headland", "bearing", "cell_bearing", "margin", "farm", "implement", "guidance_line"} <= shared
    for name in shared:
        assert (parameters[name].default, get_help(parameters[name])) == (
            OPTIONS[name].default, OPTIONS[name].format_help(get_option_name),
        )  # fmt: skip


def test_the_api_has_every_option_with_its_default_and_help() -> None:
    model: type[BaseModel] = PLAN_JOB_MODEL
    assert model.model_fields.keys() == OPTIONS.keys() | {"name"}
    properties: dict[str, Any] = model.model_json_schema()["properties"]
    for name, option in OPTIONS.items():
        assert model.model_fields[name].default == option.default, name
        assert properties[name]["description"] == option.format_help(strip_unit, for_api=True), name
    assert (properties["width"]["minimum"], properties["width"]["maximum"]) == (0.5, 100.0)
    assert properties["objective"]["enum"] == ["fastest", "cheapest", "surest", "fuel", None]


def test_no_help_names_an_option_in_the_words_of_others() -> None:
    for option in OPTIONS.values():
        assert "--" not in option.format_help(strip_unit, for_api=True) and "{" not in option.format_help(
            get_option_name
        )


def test_no_options_are_the_request_of_nothing() -> None:
    assert PlanRequest.from_options({}) == PlanRequest()
    defaults = {option.name: option.default for option in list_options(PlanRequest)}
    assert PlanRequest.from_options(defaults) == PlanRequest()


def test_texts_are_read() -> None:
    given = {
        "field": "denmark", "width": 6.0, "tractors": "1-3", "speed_kmh": 7.2, "start": "07:30", "deadline": "17:00",
        "bearing": 45.0, "headland_last": True, "entrance": "9.5,56.2", "gnss_table": "rtk.csv",
    }  # fmt: skip
    request = PlanRequest.from_options(given)
    assert (request.width_m, request.tractors, request.headland_order) == (6.0, (1, 2, 3), "last")
    assert request.speed_mps == pytest.approx(2.0) and request.entrance == (9.5, 56.2)
    assert (request.start_s, request.deadline_s) == (27000, 61200)
    assert request.gnss and request.gnss_table == "rtk.csv"


def test_the_shift_starts_the_work_where_no_start_is_given() -> None:
    assert PlanRequest.from_options({"deadline": "17:00"}, shift_s=21600).start_s == 21600
    assert PlanRequest.from_options({"deadline": "17:00", "start": "08:00"}, shift_s=21600).start_s == 28800


def test_first_and_last_exclude_each_other() -> None:
    with pytest.raises(RequestError, match="exclude each other"):
        PlanRequest.from_options({"headland_first": True, "headland_last": True})


def test_every_parameter_is_an_option() -> None:
    assert {option.parameter for option in list_options(PlanRequest)} == {each.name for each in fields(PlanRequest)}


@pytest.mark.parametrize(("name", "meant"), [("widht_m", "width_m"), ("width", "width_m"), ("speed_kph", "speed_kmh")])
def test_parameters_that_there_are_not_are_refused_with_the_nearest_one(name: str, meant: str) -> None:
    with pytest.raises(RequestError, match=f"no parameter '{name}' .did you mean '{meant}'.*guide options") as refusal:
        PlanRequest(**{name: 3.0})  # type: ignore[arg-type]
    assert refusal.value.parameter == name


@pytest.mark.parametrize("stem", ["speed", "turn_speed", "min_speed", "max_speed"])
def test_speeds_are_taken_in_both_units_but_not_in_both_at_once(stem: str) -> None:
    working = {"min_speed": {"speed_mps": 2.0}}.get(stem, {})
    request = PlanRequest(**working, **{f"{stem}_kmh": 5.4})  # type: ignore[arg-type]
    assert getattr(request, f"{stem}_mps") == pytest.approx(1.5)
    assert eval(repr(request)) == request
    with pytest.raises(RequestError, match=f"{stem}_kmh and {stem}_mps are the same in two units; leave out one"):
        PlanRequest(**{f"{stem}_kmh": 5.4, f"{stem}_mps": 1.5})  # type: ignore[arg-type]


@pytest.mark.parametrize("value", ["fast", True, (5.0,)])
def test_a_speed_that_is_no_number_is_refused_by_the_name_it_was_given(value: Any) -> None:
    with pytest.raises(RequestError, match=r"^speed_kmh is .*; give a number") as refusal:
        PlanRequest(speed_kmh=value)  # type: ignore[call-arg]
    assert refusal.value.parameter == "speed_kmh"


@pytest.mark.parametrize("name", ["speed_kmh", "speed_mps"])
@pytest.mark.parametrize("value", [10**400, -Fraction(10**400, 3)])
def test_a_speed_too_large_for_a_float_is_refused(name: str, value: Any) -> None:
    with pytest.raises(RequestError, match=f"^{name} has too many digits; use 1e.18 at most") as refusal:
        PlanRequest(**{name: value})
    assert refusal.value.parameter == name


@pytest.mark.parametrize("names", [("speed_kmh", "turn_speed_kmh"), ("turn_speed_kmh", "speed_kmh")])
def test_of_two_faults_the_first_given_is_refused(names: tuple[str, str]) -> None:
    with pytest.raises(RequestError) as refusal:
        PlanRequest(**dict.fromkeys(names, "fast"))  # type: ignore[arg-type]
    assert refusal.value.parameter == names[0]
