"""Sentences on the ground of a plan: its heights, its soil and what that bears, and how fuel is reckoned."""

from __future__ import annotations

from planner.evaluation.context import PlanningContext
from planner.evaluation.field_physics import split_soil_name
from planner.risk.costs import get_grid_factor
from reports.common.language import mark_text
from vehicle.energy.trafficability import compute_grip_at_work, compute_trafficability, describe_trafficability
from vehicle.model.soil import Soil
from vehicle.model.soil_water import MoistureEstimate
from vehicle.model.work_load import WorkLoad


def describe_ground(context: PlanningContext) -> tuple[str, ...]:
    """Heights, soil and load in sentences; nothing where the fuel is not known and the ground is level."""
    physics, sentences = context.physics, list[str]()
    elevation = physics.elevation
    if elevation is not None:
        sentences.append(
            f"Tractors drive on the heights of {elevation.source.rstrip('.')}: gravity, power, grip and cross slopes "
            "count."
        )
    if physics.soil is not None:
        sentences.append(_describe_soil(physics.soil))
    if physics.moisture is not None:
        sentences.append(_describe_estimate(physics.moisture, is_used=context.request.moisture_pct is None))
    if physics.soil is not None:
        sentences += [*_describe_grip(context, physics.soil), *_describe_trafficability(context, physics.soil)]
    if physics.fuel_load is not None:
        sentences.append(_describe_fuel(context, physics.fuel_load))
    elif context.tractor.battery is not None:
        sentences.append(
            f"What {context.request.operation} takes from the shaft is not known: charging is not planned, and whether "
            "the batteries last is not checked."
        )
    return tuple(sentences)


def _describe_soil(soil: Soil) -> str:
    name, moisture = soil.name, "" if soil.moisture_pct is None else f"{soil.moisture_pct:.3g}"
    what = mark_text(f"{name} at {moisture} % moisture") if moisture else name
    if soil.cone_index_kpa is None:
        return f"The soil is {what} ({soil.source})."
    interval = "" if soil.low_kpa is None or soil.high_kpa is None else f" ({soil.low_kpa:.0f} to {soil.high_kpa:.0f})"
    return f"The soil is {what}, cone index {soil.cone_index_kpa:.0f}{interval} kPa: {soil.source}."


def _describe_estimate(estimate: MoistureEstimate, *, is_used: bool) -> str:
    """What the rain of the last days makes of the moisture, and whether that counts."""
    rain = f"{estimate.rain_mm:.3g} mm of rain in the last {24 * estimate.days} hours"
    loss = f"an evapotranspiration of {estimate.et0_mm:.2g} mm a day"
    moisture, low, high = (f"{pct:.3g}" for pct in (estimate.moisture_pct, estimate.low_pct, estimate.high_pct))
    if is_used:
        return (
            f"{rain} and {loss} make the topsoil about {moisture} % moist ({low} to {high} %), by the balance of "
            "FAO-56 for bare soil."
        )
    return (
        f"{rain} and {loss} would make the topsoil about {moisture} % moist ({low} to {high} %), by the balance of "
        "FAO-56 for bare soil; the moisture that was given counts."
    )


def _describe_grip(context: PlanningContext, soil: Soil) -> list[str]:
    """What the soil gives to the tyres at work; nothing on a ground without a cone index."""
    load = context.physics.load
    assert load is not None  # a soil makes a load
    grip = compute_grip_at_work(context.tractor, load, soil, context.request.speed_mps)
    if grip is None:
        return []
    sides = (
        f"The soil holds tyres with at most {grip.side_limit:.2f} of their load ({grip.side_low:.2f} to "
        f"{grip.side_high:.2f}), of which work leaves driven ones {grip.side_at_work:.2f} against sliding sideways "
        "(Brixius 1987, friction circle)."
    )
    if load.compute_draft_n(context.request.speed_mps) == 0.0:
        return [sides]
    pull = (
        f"At work on level ground wheels slip by {100.0 * grip.slip:.0f} %, and {100.0 * grip.pulling_share:.0f} % of "
        "the power at the axles pulls."
    )
    return [pull, sides]


def _describe_trafficability(context: PlanningContext, soil: Soil) -> tuple[str, ...]:
    """From which moisture the soil is too wet on level ground; nothing for a soil of one moisture."""
    load = context.physics.load
    assert load is not None  # a soil makes a load
    path = split_soil_name(context.request.soil or soil.name)[1]
    limits = compute_trafficability(context.tractor, load, soil.name, speed_mps=context.request.speed_mps, path=path)
    return () if limits is None else describe_trafficability(limits, soil.name, soil.moisture_pct)


def _describe_fuel(context: PlanningContext, load: WorkLoad) -> str:
    """How the fuel comes about."""
    request = context.request
    rule = request.find_draft_rule()
    draft_kn = load.compute_draft_n(request.speed_mps) / 1000.0
    draft = (
        ""
        if rule is None
        else f"the draft of the {rule.implement}, {draft_kn:.1f} kN give or take {rule.range_pct:.0f} %, "
    )
    battery = context.tractor.battery
    if battery is not None:
        factor = get_grid_factor(context.cost_terms)
        return (
            f"Energy is that from batteries, {100.0 * battery.efficiency:.0f} % of it at the shaft of a motor of "
            f"{load.engine_power_w / 1000.0:.0f} kW, for {draft}rolling, starts and slopes; CO2 is {factor:g} kg per "
            "kWh from the grid."
        )
    return (
        f"Fuel is that of an engine of {load.engine_power_w / 1000.0:.0f} kW (ASABE D497.7) for {draft}rolling, starts "
        "and slopes."
    )
