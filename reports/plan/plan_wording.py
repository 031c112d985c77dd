"""A ranking of plans in sentences: the plan to take, what it leaves, how sure it is, its energy and slopes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from reports.common.language import translate, translate_count, translate_sentence
from reports.common.plan_records import SlopePlace, UnworkedPiece
from reports.common.plan_results import FieldPartPlan, PlanRanking, PlanResult
from reports.common.wording import (
    FIELD_AREA,
    LEAST_COST,
    LEAST_WHOLE,
    VOLUME,
    format_area,
    format_duration,
    format_effect_values,
    format_effect_with_id,
    format_end_clock,
    format_money,
    format_number,
    format_percent,
    format_speed,
    format_time_span,
    format_tractor_count,
    format_width,
    group_alike,
    join_list,
)

WIDE_HALF_INTERVAL = 0.015  # of a probability: whole percents would be more exact than the samples
UNWORKED_HELP = (
    "Unworked: ground that no implement worked; ranks include the time to finish it at each plan's own rate."
)
BY_COUNT_HELP = (
    "Median time and 95 %: field work takes no longer in half and in 95 % of the samples, with late starts, stops and "
    "breakdowns."
)


def format_in_time_probability(plan: PlanResult) -> str:
    """The probability of being in time in percent, a range where samples are few; a dash when it is not known."""
    interval = format_wide_interval(plan)
    return format_percent(plan.finish_probability) if interval is None else "-".join(interval)


def format_wide_interval(plan: PlanResult) -> list[str] | None:
    """The ends of the interval of the probability of being in time in percent; None where there are samples enough."""
    interval = plan.finish_probability_interval
    if interval is None or interval[1] - interval[0] <= 2.0 * WIDE_HALF_INTERVAL:
        return None
    return [f"{100.0 * end:.0f}" for end in interval]


def has_late_ground_loss(ranking: PlanRanking) -> bool:
    """Whether late ground adds an expected loss to what is paid."""
    pairs = [(plan.expected_cost, plan.paid_cost) for plan in ranking.eligible]
    return any(expected is not None and paid is not None and expected - paid >= LEAST_COST for expected, paid in pairs)


def format_unworked(plan: PlanResult) -> str | None:
    """The unworked area of a plan: ``0.83 ha (17 %)``; None where there is none, or it is not known."""
    if plan.missed_m2 is None or plan.missed_m2 < LEAST_WHOLE:
        return None
    if plan.worked_pct is None:
        return format_area(plan.missed_m2)
    share = (100.0 - plan.worked_pct) * plan.missed_m2 / (plan.missed_m2 + (plan.left_out_m2 or 0.0))
    percent = "under 0.1" if share < 0.05 else format_number(share, 1 if share < 10 else 0)
    return f"{format_area(plan.missed_m2)} ({percent} %)"


def describe_left_out(left_out_m2: float) -> str:
    """``644 m2 left out as asked``."""
    return translate("{area} left out as asked", area=format_area(left_out_m2))


def format_ground_place(piece: UnworkedPiece | SlopePlace) -> str:
    """Where a place of the field is: latitude and longitude, or metres for a field in local metres."""
    if piece.lat is None or piece.lon is None:
        return f"x {piece.x_m:.0f} m, y {piece.y_m:.0f} m"
    return translate("latitude {lat}, longitude {lon}", lat=f"{piece.lat:.5f}", lon=f"{piece.lon:.5f}")


def get_clearance_m(plan: PlanResult) -> float | None:
    """Smallest distance between two tractors in metres; None for a single one."""
    value = plan.min_clearance_m
    return None if plan.tractors < 2 or value is None or not math.isfinite(value) else value


def list_plan_remarks(plans: Sequence[PlanResult]) -> list[str]:
    """Remarks on feasible plans, each once with its plans: ``row-by-row-optimised with 2 and 3: ... .``

    Where plans of several strategies, or with other figures, have the same remark, it has the number of plans.
    """
    sentences = []
    for members in group_alike((plan, part) for plan in plans for part in plan.remarks):
        first, remark = members[0]
        has_one_text = all(part == remark for _, part in members)
        if has_one_text and all(plan.strategy == first.strategy for plan, _ in members):
            counts = join_list(sorted({plan.tractors for plan, _ in members}))
            values = {"strategy": first.strategy, "counts": counts, "remark": translate_sentence(remark)}
            sentences.append(translate("{strategy} with {counts}: {remark}.", **values))
        else:
            example = "" if has_one_text else f", such as {first.strategy} with {first.tractors}"
            sentences.append(f"{len(members)} plans{example}: {remark}.")
    return sentences


def describe_machines(ranking: PlanRanking) -> str | None:
    """Tractor, implement (by its name in the farm file), width and working speed; None if unknown."""
    scenario = ranking.scenario
    if "tractor" not in scenario or "width_m" not in scenario:
        return None
    implement = scenario.get("implement") or translate("implement")
    texts = [scenario["tractor"], f"{implement} {format_width(scenario['width_m'])}"]
    return ", ".join(texts + ([format_speed(scenario["speed_kmh"])] if "speed_kmh" in scenario else []))


def describe_defaults(defaults: Mapping[str, Any]) -> list[str]:
    """Which values that nobody gave were planned with, as options that would change them; empty without any."""
    texts = {name: value if isinstance(value, str) else f"{value:g}" for name, value in defaults.items()}
    options = " ".join(f"--{name.replace('_', '-')} {text}" for name, text in texts.items())
    return [translate("Planned with the defaults {options}.", options=options)] if options else []


def describe_simulated_effects(ranking: PlanRanking) -> str | None:
    """Which effects of the tractor file were simulated, a sentence; None when it has none."""
    parts = [
        f"{format_effect_with_id(name)}: {format_effect_values(name, values)}"
        for name, values in ranking.tractor_effects.items()
        if name != "discrepancy_model"
    ]
    if "discrepancy_model" in ranking.tractor_effects:
        parts.append("a discrepancy model")
    return f"Simulated with what measured logs showed of this tractor: {'; '.join(parts)}." if parts else None


def describe_part(part: FieldPartPlan) -> str:
    """Where a part of the field is, what cuts it off, what would pass, and its own plan."""
    way = "no way leads there within the field"
    if part.neck_width_m > 0.0:
        place = format_ground_place(part.neck)
        way = f"the way there is {part.neck_width_m:.1f} m wide at {place}; narrower machines would pass"
    own = f"On its own no plan works: {(part.reason or '').rstrip('.')}."
    if part.plan is not None:
        worked = "" if part.plan.worked_pct is None else f", {part.plan.worked_pct:.1f} % worked"
        time = format_duration(part.plan.time_s)
        own = f"Planned on its own (part {part.number}) it takes {time}{worked}; tractors go round by road."
    return f"{format_area(part.ground.m2)} at {format_ground_place(part.ground)} are cut off: {way}. {own}"


def name_fleet(plan: PlanResult) -> str:
    """``2 tractors``, or where one has nothing to do ``1 tractor (tractor 2 rests)``."""
    text = format_tractor_count(plan.tractors - len(plan.resting))
    if not plan.resting:
        return text
    numbers = join_list(plan.resting)
    rest = translate_count("tractor {numbers} rests", "tractors {numbers} rest", len(plan.resting), numbers=numbers)
    return f"{text} ({rest})"


def count_service_stops(ranking: PlanRanking, count: int) -> str:
    """``3 refills``; ``3 stops to unload`` where implements collect."""
    if ranking.unloads:
        return translate_count("{count} stop to unload", "{count} stops to unload", count)
    return translate_count("{count} refill", "{count} refills", count)


def get_spoilt_m2(plan: PlanResult) -> float | None:
    """The ground that wheels spoil, where it is more than nothing."""
    return plan.spoilt_m2 if (plan.spoilt_m2 or 0.0) >= LEAST_WHOLE else None


def describe_share(plan: PlanResult) -> str:
    """``98.4 % worked``."""
    return translate("{share} % worked", share=format_number(plan.worked_pct, 1))


def describe_largest_piece(plan: PlanResult) -> tuple[str, str]:
    """The largest piece that a plan leaves of what was to be worked: area and reason, and its place; "" without any.

    The place stands in the first sentence where no reason is known.
    """
    piece = plan.largest_missed
    if piece is None or plan.due_missed_m2 < LEAST_WHOLE:
        return "", ""
    area, place = format_area(piece.m2), format_ground_place(piece)
    if not piece.reason:
        return translate("The largest piece left, {area}, is at {place}.", area=area, place=place), ""
    reason = translate_sentence(piece.reason)
    return (
        translate("The largest piece left is {area} ({reason}).", area=area, reason=reason),
        translate("The largest piece left is at {place}.", place=place),
    )


def describe_finishing(ranking: PlanRanking, plan: PlanResult) -> list[str]:
    """What it takes to finish the ground that a plan leaves or spoils."""
    due_m2, spoilt_m2, grounds = plan.due_missed_m2, get_spoilt_m2(plan), []
    if due_m2 >= LEAST_WHOLE and plan.spared_m2 >= LEAST_WHOLE:
        grounds.append(translate("the {area} of it that was to be worked", area=format_area(due_m2)))
    elif due_m2 >= LEAST_WHOLE:
        grounds.append(translate("the missed {area}", area=format_area(due_m2)))
    if spoilt_m2 is not None:
        grounds.append(translate("the {area} spoilt by wheels", area=format_area(spoilt_m2)))
    if not grounds or plan.finished_s is None:
        return []
    clock = format_end_clock(ranking, plan.stated_finished_end_s)
    done = translate(" (field work done at {clock})", clock=clock) if clock else ""
    cost = [format_money(plan.finishing_cost, ranking.currency)] if plan.finishing_cost >= LEAST_COST else []
    extra = join_list([format_time_span(plan.finishing_s) + done, *cost])
    text = "At the plan's own rate, without ways there, finishing {ground} adds {extra}."
    return [translate(text, ground=join_list(grounds), extra=extra)]


def format_energy(plan: PlanResult) -> str:
    """``31 l`` of fuel or ``84 kWh``; "" where it is not known."""
    if plan.fuel_l is not None:
        return VOLUME.format(plan.fuel_l)
    return "" if plan.energy_kwh is None else f"{format_number(plan.energy_kwh, 0)} kWh"


def name_energy_column(is_electric: bool) -> str:
    """The heading of the column of fuel or electricity."""
    return translate("Energy {unit}", unit="kWh") if is_electric else translate("Fuel {unit}", unit=VOLUME.unit)


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
