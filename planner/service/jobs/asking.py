"""A request as what planning takes; called in the folder where the files of the request lie."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from planner.errors import ScenarioError, named
from planner.parameters import OF_REQUEST

if TYPE_CHECKING:
    from planner.asked import Asked

OF_FIELD, BESIDE = ("field", "width"), ("farm", "implement", "all")
DEFAULT_FIELD, DEFAULT_WIDTH_M = "iwamizawa", 3.0


def asked_of(values: Mapping[str, Any]) -> Asked:
    """The question of a plan request with what its farm has for it; raises HeadlandError as the command line does."""
    from planner.asked import as_it_is, asked
    from planner.farm import load_farm
    from planner.request import PlanRequest

    farm, implement = values.get("farm"), values.get("implement")
    own = None if farm is None else load_farm(farm)
    if own is None and implement is not None:
        raise ScenarioError(
            f"{named('implement')} {implement!r} is one of a farm file; give {named('farm')} or leave it out.",
            parameter="implement",
        )
    options = {name: value for name, value in values.items() if name not in (*OF_FIELD, *BESIDE)}
    shift_s = None if own is None or values.get("before") is None else own.times.shift_s[0]
    field, width_m = values.get("field", DEFAULT_FIELD), values.get("width", DEFAULT_WIDTH_M)
    scenario = PlanRequest(**options).scenario(field, width_m, shift_s)
    if own is None:
        return as_it_is(scenario)
    given = frozenset(OF_REQUEST[name] for name in OF_REQUEST if name in values)
    return asked(scenario, own, given, implement=implement)


def check_plan(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a plan request that cannot be asked: all it names is read, the width held against it."""
    from fields.errors import about
    from fields.guidance import bearing_along
    from fields.layout import check_width
    from fields.read import read_field
    from planner.outlook import stakes_of
    from planner.refill import supplied
    from planner.site import gnss_errors

    wanted = asked_of(values)
    scenario = wanted.scenario
    with about("rain"):
        stakes_of(scenario)
    with about("gnss_table"):
        gnss_errors(scenario)
    with about("field"):
        field = read_field(scenario.field, local=scenario.local, crs=scenario.crs, swap=scenario.swap)
        check_width(field, scenario.width_m)
        if scenario.along is not None:
            bearing_along(field.lines, scenario.along, f"'{field.name}'")
    with about("refill"):
        supplied(scenario, field, wanted.supply)


def check_day(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a day that cannot be asked."""
    from fields.errors import about
    from planner.day import load_day

    with about("day"):
        load_day(values["day"], farm=values.get("farm"), rain=values.get("rain"), certainty_pct=values.get("certainty"))


def check_diagnosis(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a tractor, a ground, a conversion or an effect that is none.

    The logs are read when the job is done.
    """
    from fields.errors import about
    from vehicle.ground import ground_index
    from vehicle.measured.answer.demo import draw_hidden
    from vehicle.measured.logs.reading import fix_set
    from vehicle.tractor import as_tractor

    machine = as_tractor(values["tractor"])
    with about("ground"):
        ground_index(values.get("ground", "soil"))
    with about("fixes"):
        fix_set(values.get("fix", ()))
    with about("hide"):
        draw_hidden(1, machine, values.get("hide"))


CHECKS: dict[str, Callable[[Mapping[str, Any]], None]] = {
    "plan": check_plan,
    "day": check_day,
    "diagnosis": check_diagnosis,
}
"""What is checked of a request before it becomes a job, by kind."""
