"""What is said of the fuel or electricity of a plan, and of the slopes it drives."""

from __future__ import annotations

from collections.abc import Sequence

from reports.common.language import translate
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.wording import FIELD_AREA, NO_VALUE, VOLUME, format_number, join_list
from reports.plan.plan_wording import format_ground_place


def format_energy(plan: PlanResult) -> str:
    """``31 l`` of fuel or ``84 kWh``; "" where it is not known."""
    if plan.fuel_l is not None:
        return VOLUME.format(plan.fuel_l)
    return "" if plan.energy_kwh is None else f"{format_number(plan.energy_kwh, 0)} kWh"


def name_energy_column(plans: Sequence[PlanResult]) -> str:
    """The heading of the column of fuel or electricity."""
    if any(plan.energy_kwh is not None for plan in plans):
        return translate("Energy {unit}", unit="kWh")
    return translate("Fuel {unit}", unit=VOLUME.unit)


def format_energy_cell(plan: PlanResult) -> str:
    """The figure of a plan without its unit."""
    value = VOLUME.convert(plan.fuel_l) if plan.energy_kwh is None else plan.energy_kwh
    return NO_VALUE if value is None else format_number(value, 1)


def format_rate(plan: PlanResult) -> str:
    """Fuel or electricity by area: ``7.9 l/ha`` or ``31.0 kWh/ha``."""
    if plan.energy_kwh_per_ha is not None:
        return f"{format_number(FIELD_AREA.convert_rate(plan.energy_kwh_per_ha), 1)} kWh/{FIELD_AREA.unit}"
    if plan.fuel_l_per_ha is None:
        return ""
    rate = FIELD_AREA.convert_rate(VOLUME.convert(plan.fuel_l_per_ha))
    return f"{format_number(rate, 1)} {VOLUME.unit}/{FIELD_AREA.unit}"


def describe_energy(plan: PlanResult | None) -> list[str]:
    """The fuel or electricity of a plan, and that of its tractors where there are several."""
    energy = "" if plan is None else format_energy(plan)
    if plan is None or not energy:
        return []
    values = {"energy": energy, "rate": format_rate(plan), "co2": format_number(plan.co2_kg, 0)}
    if plan.fuel_l is None:
        sentences = [
            translate(
                "The best plan takes {energy} from the batteries, {rate}: {co2} kg of CO2 from the grid.", **values
            )
        ]
    else:
        sentences = [translate("The best plan burns {energy} of fuel, {rate}: {co2} kg of CO2.", **values)]
    shares = plan.fuel_l_by_tractor or plan.energy_kwh_by_tractor or ()
    if len(shares) > 1:
        unit = "kWh" if plan.fuel_l is None else VOLUME.unit
        amounts = shares if plan.fuel_l is None else [VOLUME.convert(share) or 0.0 for share in shares]
        listed = join_list([f"{format_number(amount, 1)} {unit}" for amount in amounts])
        sentences.append(translate("By tractor: {amounts}.", amounts=listed))
    return sentences


def describe_slopes(plan: PlanResult | None) -> list[str]:
    """The steepest places of a plan, and how near its tractors come to rolling over."""
    if plan is None or plan.steepest_along is None or plan.steepest_across is None:
        return []
    along, across = plan.steepest_along, plan.steepest_across
    sentences = [
        translate(
            "Steepest along the drive: {along} % at {along_place}; across it: {across} % at {across_place}.",
            along=format_number(abs(along.amount), 0),
            along_place=format_ground_place(along),
            across=format_number(abs(across.amount), 0),
            across_place=format_ground_place(across),
        )
    ]
    if plan.rollover is not None:
        degrees = format_number(plan.rollover.amount, 0)
        place = format_ground_place(plan.rollover)
        sentences.append(
            translate("Nearest to rolling over: {degrees} degrees are left at {place}.", degrees=degrees, place=place)
        )
    return sentences


def describe_physics(ranking: PlanRanking) -> list[str]:
    """Energy and slopes of the best plan, then heights, soil and how the fuel is reckoned."""
    best = ranking.best
    return [*describe_energy(best), *describe_slopes(best), *ranking.ground_sentences]
