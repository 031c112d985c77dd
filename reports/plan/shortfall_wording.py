"""What keeps plans from being taken, in sentences: shortfalls of the best, a weak tractor, why plans were refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from reports.common.language import translate, translate_sentence
from reports.common.plan_records import PullFigures, Shortfall, ShortfallKind
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.wording import format_deadline, format_number, format_speed, format_width, group_alike, join_list

NOT_SIMULATED = "Not simulated"


def list_shortfall_sentences(ranking: PlanRanking) -> list[str]:
    """What the best plan lacks of what was asked for, the most serious first; empty for a recommendation."""
    return [describe_shortfall(ranking, one) for one in ranking.shortfalls]


def describe_shortfall(ranking: PlanRanking, shortfall: Shortfall) -> str:
    """What the best plan lacks, in a sentence or two."""
    if shortfall.kind == "pull":
        return question_pull(ranking.pull)
    if shortfall.kind == "late":
        late = math.ceil((ranking.missed_by_s or 0.0) / 60.0)
        sentence = translate(
            "No plan is done by {deadline}; the best is {late} min late.", deadline=format_deadline(ranking), late=late
        )
        return f"{sentence} {translate_sentence(shortfall.sentence)}".rstrip()
    return translate_sentence(shortfall.sentence)


def describe_lacks(plan: PlanResult, *, suggests_options: bool = True) -> dict[ShortfallKind, str]:
    """What an estimated plan lacks of what was asked for, a sentence each, the most serious first."""
    sentences: dict[ShortfallKind, str] = {
        "pull": question_pull(plan.pull, suggests_options=suggests_options),
        "worked": translate(
            "Too little of the ground is worked, {worked} % in all.", worked=format_number(plan.worked_pct, 1)
        ),
        "late": translate("It is not done in time."),
    }
    return {kind: sentences[kind] for kind in plan.lacks}


def question_pull(pull: PullFigures | None, *, suggests_options: bool = True) -> str:
    """Asks whether the tractor can pull the implement where it seems too weak, or says that it cannot; else ""."""
    if pull is None or not pull.is_questioned:
        return ""

    width = format_width(round(pull.width_m, 1))
    if pull.implement == "drill":
        subject = translate("The {width} drill", width=width)
    elif pull.implement == "cultivator":
        subject = translate("The {width} cultivator", width=width)
    else:
        subject = translate("The implement of {width}", width=width)
    needs = translate(
        "{subject} needs about {needed} kW at the drawbar at {speed}; this tractor has about {available} kW",
        subject=subject,
        needed=format_number(pull.needed_kw, 0),
        speed=format_speed(pull.speed_kmh),
        available=format_number(pull.available_kw, 0),
    )
    ways = []  # the speed and the width that the tractor can pull, with the options that ask for them
    if (speed_kmh := pull.possible_speed_kmh) is not None:
        ways.append(format_speed(speed_kmh) + (f" (--speed-kmh {speed_kmh:g})" if suggests_options else ""))
    if (width_m := pull.possible_width_m) is not None:
        ways.append(format_width(width_m) + (f" (--width {width_m:g})" if suggests_options else ""))
    if not pull.is_infeasible:
        if not ways:
            return translate("{needs}: check it.", needs=needs)
        return translate("{needs}: check it, or try {ways}.", needs=needs, ways=join_list(ways, "or"))
    sentences = [translate("Not feasible at this speed."), translate("{needs}.", needs=needs)]
    sentences.append(
        translate("Feasible: {ways}.", ways=join_list(ways, "or")) if ways else translate("Use a stronger tractor.")
    )
    if pull.is_assumed and suggests_options:
        sentences.append(
            translate("A drill is assumed; --draft names another implement.")
            if pull.implement == "drill"
            else translate("A cultivator is assumed; --draft names another implement.")
        )
    return " ".join(sentences)


@dataclass(frozen=True)
class RefusalGroup:
    """Plans that were refused for the same reason, figures apart.

    `reason` is that of the first plan; `has_similar_reasons` says whether figures differ among the plans.
    """

    reason: str
    plans: tuple[PlanResult, ...]
    has_similar_reasons: bool

    @property
    def members(self) -> str:
        """Which plans were refused: ``row-by-row (omega) with 5 and 7; split-field (u) with 1``."""
        counts: dict[tuple[str, str], list[int]] = {}
        for plan in self.plans:
            counts.setdefault((plan.strategy, plan.turn), []).append(plan.tractors)
        return "; ".join(f"{name} ({turn}) with {join_list(sorted(set(n)))}" for (name, turn), n in counts.items())


def group_refusals(plans: Sequence[PlanResult]) -> list[RefusalGroup]:
    """Infeasible plans grouped by reason, most frequent first; reasons that differ only in figures are one."""
    groups = group_alike((plan, (plan.reason or "no reason was given").strip()) for plan in plans)
    return [
        RefusalGroup(group[0][1], tuple(plan for plan, _ in group), len({reason for _, reason in group}) > 1)
        for group in sorted(groups, key=len, reverse=True)
    ]


def split_refused(ranking: PlanRanking) -> dict[str, list[PlanResult]]:
    """The infeasible plans by what happened to them, under its heading."""
    refused = [plan for plan in ranking.plans if not plan.feasible]
    return {
        "Refused": [plan for plan in refused if plan.is_simulated],
        NOT_SIMULATED: [plan for plan in refused if not plan.is_simulated],
    }


def explain_no_plan(ranking: PlanRanking) -> str:
    """Why no plan works, in a sentence: how many were refused, and how many for the reason that follows.

    A reason of formations alone is told last: the other strategies that it sends the reader to were refused as well.
    """
    count = len(ranking.plans)
    if not count:
        return translate("No plan was tried: allow at least one strategy, turn and number of tractors.")
    first = min(group_refusals(ranking.plans), key=lambda group: all(plan.in_formation for plan in group.plans))
    same_count = len(first.plans)
    same = translate("one") if same_count == 1 else same_count
    if count == 1:
        refused = translate("the only one was refused because")
    elif count == 2:
        refused = translate("both were refused, {same} of them because", same=same)
        refused = translate("both were refused because") if same_count == count else refused
    elif same_count == count:
        refused = translate("all {count} were refused because", count=count)
    else:
        refused = translate("all {count} were refused, {same} of them because", count=count, same=same)
    values = {"refused": refused, "reason": translate_sentence(first.reason.rstrip("."))}
    if first.has_similar_reasons:
        return translate("No plan works: {refused}: {reason} (figures of the first).", **values)
    return translate("No plan works: {refused}: {reason}.", **values)
