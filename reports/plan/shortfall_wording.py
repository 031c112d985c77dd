"""What keeps the best plan from being a recommendation, in sentences, and whether its implement can be pulled."""

from __future__ import annotations

import math

from reports.common.language import translate, translate_sentence
from reports.common.plan_results import PlanRanking, PullFigures, Shortfall
from reports.common.units import format_speed, format_width
from reports.common.wording import format_deadline, format_number, join_list

CULTIVATOR, DRILL = "cultivator", "drill"


def list_shortfall_sentences(ranking: PlanRanking) -> list[str]:
    """What the best plan lacks of what was asked for, the most serious first; empty for a recommendation."""
    return [describe_shortfall(ranking, one) for one in ranking.shortfalls]


def describe_shortfall(ranking: PlanRanking, shortfall: Shortfall) -> str:
    """What the best plan lacks, in a sentence or two."""
    if shortfall.kind == "pull":
        return question_pull(ranking.pull)
    if shortfall.kind == "late":
        late = math.ceil((ranking.missed_by_s or 0.0) / 60.0)
        return translate(
            "No plan is done by {deadline}; the best is {late} min late.",
            deadline=format_deadline(ranking),
            late=late,
        )
    return translate_sentence(shortfall.sentence)


def question_pull(pull: PullFigures | None, *, suggests_options: bool = True) -> str:
    """Asks whether the tractor can pull the implement where it seems too weak, or says that it cannot; else ""."""
    if pull is None or not pull.is_questioned:
        return ""
    needs, ways = _describe_power(pull), _list_ways(pull, suggests_options)
    if not pull.is_infeasible:
        if not ways:
            return translate("{needs}: check it.", needs=needs)
        return translate("{needs}: check it, or try {ways}.", needs=needs, ways=join_list(ways, "or"))
    sentences = [translate("Not feasible at this speed. {needs}.", needs=needs)]
    sentences.append(
        translate("Feasible: {ways}.", ways=join_list(ways, "or")) if ways else translate("Use a stronger tractor.")
    )
    if pull.is_assumed and suggests_options:
        sentences.append(
            translate("A drill is assumed; --draft names another implement.")
            if pull.implement == DRILL
            else translate("A cultivator is assumed; --draft names another implement.")
        )
    return " ".join(sentences)


def _list_ways(pull: PullFigures, suggests_options: bool) -> list[str]:
    """The speed and the width that the tractor can pull, with the options that ask for them."""
    ways = []
    if pull.possible_speed_kmh is not None:
        option = f" (--speed-kmh {pull.possible_speed_kmh:g})" if suggests_options else ""
        ways.append(_format_speed(pull.possible_speed_kmh) + option)
    if pull.possible_width_m is not None:
        option = f" (--width {pull.possible_width_m:g})" if suggests_options else ""
        ways.append(format_width(pull.possible_width_m) + option)
    return ways


def _describe_power(pull: PullFigures) -> str:
    """What the implement needs and the tractor has, without a full stop."""
    figures = {
        "width": format_width(round(pull.width_m, 1)),
        "needed": format_number(pull.needed_kw, 0),
        "speed": _format_speed(pull.speed_kmh),
        "available": format_number(pull.available_kw, 0),
    }
    if pull.implement == DRILL:
        return translate(
            "The {width} drill needs about {needed} kW at the drawbar at {speed}; this tractor has about "
            "{available} kW", **figures)  # fmt: skip
    if pull.implement == CULTIVATOR:
        return translate(
            "The {width} cultivator needs about {needed} kW at the drawbar at {speed}; this tractor has about "
            "{available} kW", **figures)  # fmt: skip
    return translate(
        "The implement of {width} needs about {needed} kW at the drawbar at {speed}; this tractor has about "
        "{available} kW", **figures)  # fmt: skip


def _format_speed(speed_kmh: float) -> str:
    return format_speed(speed_kmh / 3.6).replace(".0 ", " ")
