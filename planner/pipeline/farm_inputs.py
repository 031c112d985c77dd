"""A plan request completed by a farm file to a work order: tractor, implement, prices, times and uncertainty."""

from __future__ import annotations

import os
from collections.abc import Collection, Container, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from fields.units import MPS_PER_KMH
from planner.errors import RequestError, attach_parameter, mark_parameter
from planner.evaluation.work_order import WorkOrder
from planner.farm.inventory import FarmFile, load_farm
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.value_sources import find_unchanged_learned_values
from planner.request.options import list_options
from planner.request.plan_request import PlanRequest
from planner.risk.costs import CostTerms, compute_hourly_rates
from vehicle.energy.draft import TILL
from vehicle.model.tractor import list_tractor_names


@dataclass(frozen=True)
class GivenOptions:
    """The options of a plan and its farm by name, as a command or the API is given them; None is the same as not given.

    Of what a farm sets, the options of `given_names` win over it, and over a saved plan among what is `done`; of its
    machines those `without` are left out.
    """

    values: Mapping[str, Any]
    given_names: Collection[str]
    done: tuple[str, ...] = ()
    without: tuple[int, ...] = ()

    @cached_property
    def farm(self) -> FarmFile | None:
        """The farm that the options name; raises HeadlandError."""
        name = self.values.get("farm")
        return None if name is None else load_farm(name)

    def build_request(self, **others: Any) -> PlanRequest:
        """The request of the options, with `others` in their place; a deadline counts from the shift of the farm.

        Where a saved plan goes on, it is the request of that with the options that are given, and a deadline counts
        from when it is left. Raises HeadlandError.
        """
        values = {**self.values, **others}
        start_s = None if self.continued is None else self.continued.request.start_s
        if start_s is None and values.get("deadline") is not None and self.farm is not None:
            start_s = self.farm.times.shift_span_s[0]
        request = PlanRequest.from_options(values, shift_s=start_s)
        if self.continued is None:
            return request
        names = {*self.given_names} | ({"field"} if "fields" in self.given_names else set())
        given = {option.parameter for option in list_options(PlanRequest) if option.name in names}
        from planner.pipeline.going_on import keep_parameters

        return keep_parameters(self.continued, request, given)

    @cached_property
    def continued(self) -> WorkOrder | None:
        """What the saved plan asked for that goes on, if there is one among what is done; raises HeadlandError."""
        if not self.done:
            return None
        from planner.pipeline.going_on import read_continued_order

        return read_continued_order(self.done, self.without)

    def build_order(self, request: PlanRequest) -> WorkOrder:
        """The request completed by the farm; raises HeadlandError."""
        implement = self.values.get("implement")
        if self.farm is None and implement is not None:
            raise RequestError(
                f"{mark_parameter('implement')} {implement!r} names an implement of a farm file; add "
                f"{mark_parameter('farm')} or leave it out."
            )
        given = {  # of what a farm file may set
            option.parameter
            for option in list_options(PlanRequest)
            if option.from_farm and option.name in self.given_names
        }
        if self.continued is not None:
            given |= {"tractors", "start_s"}
        order = complete_request_by_farm(request, self.farm, given, implement_name=implement)
        if self.continued is not None:
            from planner.pipeline.going_on import equip_order

            is_farm = self.farm is not None
            keeps_tractor = not is_farm and "tractor" not in given
            order = equip_order(self.continued, order, keeps_tractor=keeps_tractor, is_from_farm=is_farm)
        simulates_all = bool(self.values.get("all"))
        return replace(order, done=self.done, without=self.without, simulates_all=simulates_all)


def complete_request_by_farm(
    request: PlanRequest,
    farm: FarmFile | None,
    given_parameters: Collection[str] = (),
    *,
    implement_name: str | None = None,
) -> WorkOrder:
    """Complete a request by tractor, count, width, speeds, operation and prices of a farm; its shift gives the start.

    The `given_parameters` of the request stay as they are; a given `tractor` may be the name of one of the farm's.
    Without `implement_name` the first implement that fits is used. Raises RequestError, VehicleError.
    """
    if farm is None:
        return WorkOrder(request)
    farm_tractor = _select_tractor(request, farm, given_parameters, implement_name)
    requested = max(request.tractors)
    if farm_tractor is not None and "tractors" in given_parameters and requested > farm_tractor.count:
        raise RequestError(
            f"{mark_parameter('tractors')} asks for {requested}, and the farm has {farm_tractor.count} x "
            f"{farm_tractor.name}; ask for {farm_tractor.count} at most, or change its count in the farm file."
        )
    operation = request.operation if "operation" in given_parameters else None
    farm_implement = _select_implement(farm, farm_tractor, implement_name, operation)
    given_parameters = {*given_parameters, "start_s"} if request.start_s is not None else given_parameters
    if request.headland_order is not None or request.no_headland or "operation" in given_parameters:
        given_parameters = {*given_parameters, "headland_order"}
    is_other_work = operation not in (None, farm_implement.operation or TILL)
    if "draft" in given_parameters or is_other_work:  # another implement than the farm's
        given_parameters = {*given_parameters, "draft", "depth_cm"}
    farm_values = {
        key: value
        for key, value in _list_farm_values(farm, farm_tractor, farm_implement).items()
        if key not in given_parameters and value is not None
    }
    sized_implement = farm_implement.simulated_implement
    if "width_m" in given_parameters:
        sized_implement = sized_implement.model_copy(update={"width_m": request.width_m, "frame_width_m": None})
    price_fields = {"price_per_hour": "per_hour", "price_per_tractor": "transport_per_tractor"}
    prices = {own: getattr(request, name) for name, own in price_fields.items() if name in given_parameters}
    terms = CostTerms(
        farm.prices.model_copy(update=prices),
        farm_tractor,
        farm_implement,
        learned_notes=_describe_learned_values(farm, farm_implement),
    )
    return WorkOrder(
        replace(request, **farm_values),
        tractor=None if farm_tractor is None else farm_tractor.origin,
        implement=sized_implement,
        uncertainty=farm.uncertainty,
        cost_terms=terms,
        supply=farm_implement.build_supply(farm.times.refill_s),
        times=farm.times,
        yard=farm.yard,
    )


def _describe_learned_values(farm: FarmFile, farm_implement: FarmImplement) -> tuple[str, ...]:
    """Values of the implement and of the uncertainty that come from the farm's own logs, in words."""
    prefixes = (f"implements.{farm_implement.name}.", "uncertainty.")
    return tuple(
        f"{one.key.split('.')[-1]} {one.format_with_interval()}"
        for one in find_unchanged_learned_values(farm)
        if one.key.startswith(prefixes)
    )


def _select_tractor(
    request: PlanRequest, farm: FarmFile, given_parameters: Container[str], implement_name: str | None
) -> FarmTractor | None:
    """The tractor by its name, or the first that the implement fits."""
    if "tractor" in given_parameters:
        if request.tractor in list_tractor_names() or os.path.lexists(request.tractor):
            return next((each for each in farm.tractors if each.name == request.tractor), None)
        return farm.get_tractor(request.tractor)
    farm_implement = None if implement_name is None else farm.get_implement(implement_name)
    return next(each for each in farm.tractors if farm_implement is None or farm.is_compatible(each, farm_implement))


def _select_implement(
    farm: FarmFile, farm_tractor: FarmTractor | None, implement_name: str | None, operation: str | None
) -> FarmImplement:
    """The implement by its name, or the first that fits the tractor and, if one does, the operation."""
    fitting = [each for each in farm.implements if farm_tractor is None or farm.is_compatible(farm_tractor, each)]
    of_operation = [each for each in fitting if (each.operation or TILL) == operation] if operation is not None else []
    if implement_name is None:
        return (of_operation or fitting)[0]
    farm_implement = farm.get_implement(implement_name)
    if farm_tractor is not None and farm_implement not in fitting:
        raise RequestError(
            f"The implement {farm_implement.name!r} does not fit the tractor {farm_tractor.name!r} by the farm file; "
            "use one of: "
            f"{', '.join(each.name for each in fitting)}, or a tractor out of: {', '.join(farm_implement.tractors)}.",
            parameter="implement",
        )
    if operation is not None and farm_implement.operation not in (None, operation):
        others = f", or name {' or '.join(each.name for each in of_operation)}" if of_operation else ""
        raise RequestError(
            f"{mark_parameter('implement')} {farm_implement.name!r} is there to {farm_implement.operation}, and "
            f"{mark_parameter('operation')} is {operation}; leave out {mark_parameter('operation')}{others}.",
            parameter="implement",
        )
    return farm_implement


def compute_price_per_hour(farm: FarmFile, farm_tractor: FarmTractor | None, farm_implement: FarmImplement) -> float:
    """Cost of one working hour of a tractor with its implement and its share of supervision."""
    prices = farm.prices
    supervision = prices.supervision_share * prices.supervision_per_hour
    if prices.per_hour is not None:
        return prices.per_hour + supervision
    with attach_parameter("tractor"):
        efficiency = None if farm_tractor is None else farm_tractor.find_motor_efficiency()
    hourly = compute_hourly_rates(prices, farm_tractor, farm_implement, efficiency)
    return hourly.rates_without_fuel + hourly.fuel_at_work + supervision


def _list_farm_values(
    farm: FarmFile, farm_tractor: FarmTractor | None, farm_implement: FarmImplement
) -> dict[str, Any]:
    """Parameters of a request from the farm; None for those it leaves open."""
    speeds_kmh = {
        "speed_mps": farm_implement.speed_kmh,
        "turn_speed_mps": farm_implement.turn_speed_kmh,
        "min_speed_mps": farm_implement.min_speed_kmh,
        "max_speed_mps": farm_implement.max_speed_kmh,
    }
    return {
        "width_m": farm_implement.width_m,
        **{name: None if speed_kmh is None else speed_kmh * MPS_PER_KMH for name, speed_kmh in speeds_kmh.items()},
        "operation": farm_implement.operation,
        "draft": farm_implement.draft,
        "depth_cm": farm_implement.depth_cm,
        "headland_order": farm_implement.headland,
        "tractors": None if farm_tractor is None else tuple(range(1, farm_tractor.count + 1)),
        "price_per_hour": compute_price_per_hour(farm, farm_tractor, farm_implement),
        "price_per_tractor": farm.prices.transport_per_tractor,
        "start_s": farm.times.shift_span_s[0],
    }
