"""A ranking of plans in sentences: the plan to take, what it leaves, how sure it is, its energy and slopes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from reports.common.language import translate, translate_count, translate_sentence
from reports.common.plan_records import SlopePlace, UnworkedPiece
from reports.common.plan_results import FieldPartPlan, PlanRanking, PlanResult, is_dearer
from reports.common.wording import (
    FIELD_AREA,
    LEAST_COST,
    VOLUME,
    format_area,
    format_deadline,
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
from reports.plan.shortfall_wording import explain_no_plan, list_shortfall_sentences

SAME_TIME_S = 0.5  # a smaller difference is not mentioned
WIDE_HALF_INTERVAL = 0.015  # of a probability: whole percents would be more exact than the samples
LEAST_UNWORKED_M2 = 0.5  # less reads as nothing
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
    pairs = [(plan.expected_cost, plan.paid_cost) for plan in list_feasible(ranking)]
    return any(expected is not None and paid is not None and expected - paid >= LEAST_COST for expected, paid in pairs)


def format_unworked(plan: PlanResult) -> str | None:
    """The unworked area of a plan: ``0.83 ha (17 %)``; None where there is none, or it is not known."""
    if plan.missed_m2 is None or plan.missed_m2 < LEAST_UNWORKED_M2:
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


def list_feasible(ranking: PlanRanking) -> list[PlanResult]:
    """The feasible plans, in the order of the ranking."""
    return [plan for plan in ranking.plans if plan.feasible]


def list_refused(ranking: PlanRanking) -> list[PlanResult]:
    """The infeasible plans, in the order of the ranking."""
    return [plan for plan in ranking.plans if not plan.feasible]


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


def describe_ranking(ranking: PlanRanking) -> list[str]:
    """The answer in a few sentences: the plan to take, who meets the deadline, what is fastest and cheapest."""
    best = ranking.best
    if best is None:
        return [explain_no_plan(ranking)]
    plans = list_feasible(ranking)
    priced = [plan for plan in plans if plan.cost is not None]
    cheapest = min(priced, key=lambda plan: plan.ranked_cost, default=None)
    best_is_cheapest = len(priced) > 1 and cheapest is not None and cheapest.ranked_cost == best.ranked_cost
    fastest = min((plan for plan in plans if plan.time_s is not None), key=lambda plan: plan.ranked_s, default=best)
    result = _describe_plan_result(ranking, best)
    details = [*ranking.day_sentences, *_describe_unworked(ranking, best)]
    if ranking.shortfalls:
        sentences = [
            *list_shortfall_sentences(ranking),
            *_list_money_sentences(ranking),
            translate("The best of them: {result}.", result=result),
            *details,
        ]
    else:
        sentences = [*_list_money_sentences(ranking), translate("Best plan: {result}.", result=result), *details]
        sentences += _describe_deadline(ranking, best, best_is_cheapest)
    sentences += [describe_part(part) for part in ranking.parts]
    if ranking.cut_off_m2 and not ranking.parts:
        sentences.append(f"Obstacles cut off {format_area(ranking.cut_off_m2)} of the field, which no plan works.")
    others = {}
    if fastest is not best and fastest.ranked_s != best.ranked_s:
        others[translate("Fastest")] = fastest
    if cheapest is not None and cheapest is not best and not best_is_cheapest:
        others[translate("Cheapest")] = cheapest
    if len(others) == 2 and fastest is cheapest:
        others = {translate("Fastest and cheapest"): fastest}
    sentences += [f"{name}: {_describe_plan_result(ranking, plan)}." for name, plan in others.items()]
    if best_is_cheapest and not best.meets_deadline:
        best_too = translate("The best plan is also the cheapest.")
        sentences.append(translate("This plan is also the cheapest.") if ranking.shortfalls else best_too)
    return sentences


def _describe_plan_result(ranking: PlanRanking, plan: PlanResult) -> str:
    """Who, how long by the time driven and the clock (named where it is not that of the last tractor's end), cost."""
    unworked, end_s = format_unworked(plan), plan.stated_end_s
    clock = format_end_clock(ranking, end_s)
    driven_s = plan.stated_s if clock else end_s
    is_done = abs(driven_s - end_s) < SAME_TIME_S
    when = format_duration(driven_s)
    if clock and is_done:
        when = translate("{time} (at {clock})", time=when, clock=clock)
    elif clock:
        when = translate("{time} (field work done at {clock})", time=when, clock=clock)
    done = translate("done in {time}", time=when) if is_done else translate("driven in {time}", time=when)
    if plan.charges:
        done += translate_count(" with {count} stop to charge", " with {count} stops to charge", plan.charges)
    elif plan.refills:
        done += translate(" with {stops}", stops=count_service_stops(ranking, plan.refills))
    elif plan.refills is not None:
        done += translate(" with no stops to unload") if ranking.unloads else translate(" with no refills")
    leaves = None if unworked is None else translate("leaves {area} unworked", area=unworked)
    tractors = name_fleet(plan)
    name = translate("{tractors}, {strategy}, turns {turn}", tractors=tractors, strategy=plan.strategy, turn=plan.turn)
    left_out = None if plan.left_out_m2 is None else describe_left_out(plan.left_out_m2)
    money = format_money(plan.stated_cost, ranking.currency)
    cost = None if plan.stated_cost is None else translate("cost {cost}", cost=money)
    return ", ".join(part for part in (name, done, cost, leaves, left_out) if part)


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


def _list_money_sentences(ranking: PlanRanking) -> list[str]:
    """With samples: what the costs include, how that of the best plan is made up, and what its times are."""
    sentences, best = [] if ranking.samples is None else [*ranking.money_sentences], ranking.best
    if best is not None and best.expected_cost is not None and best.paid_cost is not None:
        loss = best.expected_cost - best.paid_cost
        amounts = (best.expected_cost, best.paid_cost, loss)
        whole, paid, lost = (format_money(value, ranking.currency) for value in amounts)
        if loss >= LEAST_COST:
            sentences.append(
                f"Of the cost of the best plan ({whole}) {paid} is paid and {lost} is expected loss on late ground."
            )
    if best is not None and best.p50_s is not None:
        undelayed = format_duration(best.time_s)
        sentences.append(
            "Times are medians of the samples; without late starts, stops and breakdowns the best plan takes "
            f"{undelayed}."
        )
    return sentences


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
    return plan.spoilt_m2 if (plan.spoilt_m2 or 0.0) >= LEAST_UNWORKED_M2 else None


def _describe_unworked(ranking: PlanRanking, plan: PlanResult) -> list[str]:
    """What it takes to finish the ground that a plan leaves or spoils, and where the largest piece left is."""
    due_m2, spoilt_m2 = plan.due_missed_m2, get_spoilt_m2(plan)
    is_missed = due_m2 >= LEAST_UNWORKED_M2
    grounds = []
    if is_missed and plan.spared_m2 >= LEAST_UNWORKED_M2:
        grounds.append(translate("the {area} of it that was to be worked", area=format_area(due_m2)))
    elif is_missed:
        grounds.append(translate("the missed {area}", area=format_area(due_m2)))
    if spoilt_m2 is not None:
        grounds.append(translate("the {area} spoilt by wheels", area=format_area(spoilt_m2)))
    sentences = []
    if grounds and plan.finished_s is not None:
        added = format_time_span(plan.finishing_s)
        clock = format_end_clock(ranking, plan.stated_finished_end_s)
        done = translate(" (field work done at {clock})", clock=clock) if clock else ""
        added_cost = 0.0 if plan.finished_cost is None else plan.finished_cost - (plan.cost or 0.0)
        cost = [format_money(added_cost, ranking.currency)] if added_cost >= LEAST_COST else []
        is_late = ranking.allowed_s is not None and plan.stated_finished_end_s > ranking.allowed_s
        late = translate(", too late for the deadline") if plan.meets_deadline and is_late else ""
        extra = join_list([f"{added}{done}", *cost])
        values = {"ground": join_list(grounds), "extra": extra + late}
        sentences.append(
            translate("At the plan's own rate, without ways there, finishing {ground} adds {extra}.", **values)
        )
    if plan.largest_missed is not None and is_missed:
        piece = plan.largest_missed
        sentences.append(f"The largest missed piece, {format_area(piece.m2)}, is at {format_ground_place(piece)}.")
    return sentences


def _describe_deadline(ranking: PlanRanking, best: PlanResult, best_is_cheapest: bool) -> list[str]:
    """Who meets the deadline, if anybody, and that the best plan is the cheapest of those or of all plans."""
    judged = [plan for plan in list_feasible(ranking) if plan.meets_deadline is not None]
    if not any(plan.meets_deadline for plan in judged):
        return []
    name = translate("The deadline ({clock})", clock=format_deadline(ranking))
    meeting = sorted({plan.tractors for plan in judged if plan.meets_deadline})
    late = sorted({plan.tractors for plan in judged} - set(meeting))
    missed = translate(", not with {counts}", counts=join_list(late, "or")) if late else ""
    counts = translate("{counts} tractors", counts=join_list(meeting, "or"))
    who = {"name": name, "tractors": format_tractor_count(1) if meeting == [1] else counts, "missed": missed}
    text = "{name} can be met with {tractors}{missed}; the best plan is the cheapest of them."
    if len(judged) == 1:
        text = "{name} can be met with {tractors}{missed}."
    elif ranking.chosen is not None:
        text = "{name} can be met with {tractors}{missed}, in half of the samples or more."
    elif is_dearer(best, min((plan for plan in judged if plan.meets_deadline), key=lambda plan: plan.ranked_cost)):
        text = (
            "{name} can be met with {tractors}{missed}; the best plan is the cheapest that could finish the field by "
            "then."
        )
    elif best_is_cheapest:
        text = "{name} can be met with {tractors}{missed}; the best plan is the cheapest of all."
    return [translate(text, **who)]


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
