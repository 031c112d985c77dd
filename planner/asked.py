"""A farm in place of what the scenario of a plan leaves open."""

from __future__ import annotations

import os
from collections.abc import Collection, Container
from dataclasses import dataclass, replace
from typing import Any

from planner.chance.settings import Chances, like
from planner.errors import ScenarioError, named
from planner.farm.file import FarmFile
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.prices import Prices
from planner.farm.sources import learned_in_use
from planner.farm.times import Times, Yard
from planner.price.cost import Terms
from planner.price.machine import rates
from planner.scenario import Scenario
from strategies.supply import Supply
from vehicle.tractor import Implement, Tractor, tractor_names


@dataclass(frozen=True)
class Asked:
    """A scenario with the values of a farm, and the machines to plan it with (`tractor`: an object or a file).

    `own` is the farm's kind of tractor, None where the scenario names another; `mounted` is the farm's
    implement; `terms` and `chances` are its prices and laws, `supply` is what the implement carries, `times` and `yard`
    what makes up its day. Without a farm all are None.
    """

    scenario: Scenario
    tractor: Tractor | str | None
    implement: Implement | None
    own: FarmTractor | None
    mounted: FarmImplement | None
    terms: Terms | None = None
    chances: Chances | None = None
    supply: Supply | None = None
    times: Times | None = None
    yard: Yard | None = None


def as_it_is(scenario: Scenario) -> Asked:
    """A scenario without a farm."""
    return Asked(scenario, None, None, None, None)


def asked(
    scenario: Scenario, farm: FarmFile, given: Collection[str] = (), *, implement: str | None = None
) -> Asked:
    """Tractor, count, width, speeds, operation and prices of a farm for a scenario; its shift gives the start.

    Parameters of the scenario that are `given` stay as they are; a `tractor` that is given may name one of the farm's.
    Without the name of an implement the first that fits is taken. Raises ScenarioError, VehicleError.
    """
    own = _own(scenario, farm, given, implement)
    if own is not None and "tractors" in given:
        _check_count(own, max(scenario.tractors))
    mounted = _mounted(farm, own, implement)
    given = {*given, "start_s"} if scenario.start_s is not None else given
    if scenario.headland_order is not None or scenario.tracks_only or "operation" in given:
        given = {*given, "headland_order"}
    found = {key: value for key, value in _values(farm, own, mounted).items() if key not in given and value is not None}
    bar = mounted.mounted
    if "width_m" in given:
        bar = bar.model_copy(update={"width_m": scenario.width_m, "frame_width_m": None})
    terms = Terms(_prices(scenario, farm, given), own, mounted, learned=_learned(farm, mounted))
    return Asked(
        replace(scenario, **found), None if own is None else own.origin, bar, own, mounted, terms,
        like(farm.chances), mounted.supply(farm.times.refill_s), farm.times, farm.yard,
    )  # fmt: skip


def _learned(farm: FarmFile, mounted: FarmImplement) -> tuple[str, ...]:
    """What own logs taught of the implement and of chance, in words."""
    own = (f"implements.{mounted.name}.", "chances.")
    return tuple(f"{one.key.split('.')[-1]} {one.words()}" for one in learned_in_use(farm) if one.key.startswith(own))


def _prices(scenario: Scenario, farm: FarmFile, given: Container[str]) -> Prices:
    """The prices of the farm, but for those that were given."""
    names = {"price_per_hour": "per_hour", "price_per_tractor": "transport_per_tractor"}
    return farm.prices.model_copy(
        update={own: getattr(scenario, name) for name, own in names.items() if name in given}
    )


def _own(scenario: Scenario, farm: FarmFile, given: Container[str], implement: str | None) -> FarmTractor | None:
    """The kind of tractor: by its name, or the first that the implement fits."""
    if "tractor" in given:
        if scenario.tractor in tractor_names() or os.path.lexists(scenario.tractor):
            return next((each for each in farm.tractors if each.name == scenario.tractor), None)
        return farm.tractor(scenario.tractor)
    wanted = None if implement is None else farm.implement(implement)
    return next(each for each in farm.tractors if wanted is None or farm.fits(each, wanted))


def _check_count(own: FarmTractor, most: int) -> None:
    """Refuse more tractors than the farm has of the kind."""
    if most > own.count:
        raise ScenarioError(
            f"{named('tractors')} asks for {most}, and the farm has {own.count} x {own.name}; ask for {own.count} at "
            "most, or change its count in the farm file."
        )


def _mounted(farm: FarmFile, own: FarmTractor | None, name: str | None) -> FarmImplement:
    if name is None:
        return next(each for each in farm.implements if own is None or farm.fits(own, each))
    found = farm.implement(name)
    if own is not None and not farm.fits(own, found):
        fitting = [each.name for each in farm.implements if farm.fits(own, each)]
        raise ScenarioError(
            f"The implement {found.name!r} does not fit the tractor {own.name!r} by the farm file; use one of: "
            f"{', '.join(fitting)}, or a tractor out of: {', '.join(found.tractors)}.",
            parameter="implement",
        )
    return found


def price_per_hour(farm: FarmFile, own: FarmTractor | None, mounted: FarmImplement) -> float:
    """What one tractor with its implement costs in an hour at work, with who looks after it."""
    prices = farm.prices
    people = prices.supervision_share * prices.supervision_per_hour
    if prices.per_hour is not None:
        return prices.per_hour + people
    hourly = rates(prices, own, mounted)
    return hourly.machine + hourly.fuel_at_work + people


def _values(farm: FarmFile, own: FarmTractor | None, mounted: FarmImplement) -> dict[str, Any]:
    """Parameters of a scenario by the farm; None for what it leaves open."""
    return {
        "width_m": mounted.width_m,
        "speed_mps": mounted.speed_mps,
        "turn_speed_mps": mounted.turn_speed_mps,
        "operation": mounted.operation,
        "headland_order": mounted.headland,
        "tractors": None if own is None else tuple(range(1, own.count + 1)),
        "price_per_hour": price_per_hour(farm, own, mounted),
        "price_per_tractor": farm.prices.transport_per_tractor,
        "start_s": farm.times.shift_s[0],
    }
