"""A request as what planning takes; called in the folder where the files of the request lie."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from planner.errors import ScenarioError, named
from planner.parameters import OF_REQUEST
from planner.service.jobs.requests import PlanRequest

if TYPE_CHECKING:
    from planner.asked import Asked

AS_THEY_ARE = (
    "field", "local", "turn", "tractor", "price_per_hour", "price_per_tractor", "operation", "corners", "tracks_only",
    "draws", "rain", "prefer", "refill", "budget", "gnss", "seed",
)  # fmt: skip
IN_UNITS = {
    "width": "width_m", "headland": "headland_m", "bearing": "bearing_deg", "radius": "radius_m",
    "clearance": "clearance_m", "margin": "margin_m",
}  # fmt: skip


def asked_of(values: Mapping[str, Any]) -> Asked:
    """The question of a plan request with what its farm has for it; raises HeadlandError as the command line does."""
    from planner.asked import as_it_is, asked
    from planner.farm import load_farm
    from planner.scenario import Scenario

    request = PlanRequest.model_validate(values)
    farm = None if request.farm is None else load_farm(request.farm)
    if farm is None and request.implement is not None:
        raise ScenarioError(
            f"{named('implement')} {request.implement!r} is one of a farm file; give {named('farm')} or leave it out.",
            parameter="implement",
        )
    shift_s = None if farm is None or request.before is None else farm.times.shift_s[0]
    scenario = Scenario(**_parameters(request, shift_s))
    if farm is None:
        return as_it_is(scenario)
    given = frozenset(OF_REQUEST[name] for name in OF_REQUEST if name in values)
    return asked(scenario, farm, given, implement=request.implement)


def _parameters(request: PlanRequest, shift_s: int | None) -> dict[str, Any]:
    """Parameters of a scenario; `shift_s` is the start of a farm's shift where a deadline counts from it."""
    from planner.scenario import KMH, parse_cell_bearings, parse_counts, parse_place, parse_strategies

    turns = request.turn_speed_kmh
    return {
        **{name: getattr(request, name) for name in AS_THEY_ARE},
        **{parameter: getattr(request, name) for name, parameter in IN_UNITS.items()},
        "tractors": parse_counts(request.tractors),
        "strategies": parse_strategies(request.strategies),
        "speed_mps": request.speed_kmh * KMH,
        "turn_speed_mps": None if turns is None else turns * KMH,
        "start_s": _clock(request.start, "start_s", shift_s),
        "before_s": _clock(request.before, "before_s"),
        "headland_order": _order(request.headland_first, request.headland_last),
        "cell_bearings": parse_cell_bearings(request.cell_bearing),
        "entrance": None if request.entrance is None else parse_place(request.entrance, "entrance"),
    }


def _clock(text: str | None, parameter: str, otherwise: int | None = None) -> int | None:
    from planner.scenario import parse_clock

    return otherwise if text is None else parse_clock(text, parameter)


def _order(first: bool, last: bool) -> str | None:
    if first and last:
        raise ScenarioError(
            f"{named('headland_first')} and {named('headland_last')} exclude each other; leave out one of them."
        )
    return "first" if first else "last" if last else None


def check_plan(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a plan request that cannot be asked; the field is read when the job is done."""
    asked_of(values)


def check_day(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a day that cannot be asked."""
    from planner.day import load_day

    load_day(values["day"], farm=values.get("farm"), rain=values.get("rain"))


def check_diagnosis(values: Mapping[str, Any]) -> None:
    """Raise HeadlandError for a tractor that is none; the logs are read when the job is done."""
    from vehicle.tractor import as_tractor

    as_tractor(values["tractor"])


CHECKS: dict[str, Callable[[Mapping[str, Any]], None]] = {
    "plan": check_plan,
    "day": check_day,
    "diagnosis": check_diagnosis,
}
"""What is checked of a request before it becomes a job, by kind."""
