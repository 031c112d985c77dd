"""A ranking for a terminal: its first screen (the answer, a short table, what to type next), then all of its plans.
Plain text survives a pipe and an ASCII console.

At 80 columns the first screen has at most 23 lines below its title, of which at most eight stand before the table.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rich.console import Group, RenderableType
from rich.text import Text

from fields.errors import shorten_middle
from reports.common.language import mark_text, translate, translate_count
from reports.common.plan_results import PlanRanking, PlanResult, find_deciding_reason
from reports.common.text_tables import AnswerLines, FittedTable, format_bullet, format_sentence, format_title
from reports.common.wording import FIELD_AREA, format_width, has_start_time, join_list
from reports.plan.answer import write_answer
from reports.plan.figures import COUNT_DROPS, SCREEN_DROPS, TABLE_DROPS, Figure, build_figure_table, choose_figures
from reports.plan.plan_wording import (
    BY_COUNT_HELP,
    UNWORKED_HELP,
    describe_defaults,
    describe_machines,
    describe_simulated_effects,
    list_plan_remarks,
)
from reports.plan.shortfall_wording import NOT_SIMULATED, group_refusals, split_refused

MOST_ROWS, LEAST_ROWS = 6, 5
MOST_COLUMNS = 7
SAME_TIME_S = 0.5  # a smaller difference is not mentioned
_MOST_NAME_LETTERS = 40
_MORE_HINT = mark_text("a wider window or --explain shows more")
_ALL_HINT = "a wider window or --json shows all"


def build_first_screen(
    ranking: PlanRanking,
    *,
    shows_all: bool = False,
    with_next: bool = True,
    has_page: bool = False,
    has_plan: bool = False,
) -> RenderableType:
    """What to do in a few lines, the plans to choose from in a table, and what to type next.

    The table holds the best plan, then the Pareto front, then others as they are ranked: few, or all with `shows_all`.
    Without what is next it is the head of an explanation, and nothing is shortened. A page and a plan that are written
    anyhow are not suggested.
    """
    answer, name = write_answer(ranking), shorten_middle(ranking.field_name, _MOST_NAME_LETTERS)
    plans = choose_first_plans(ranking, math.inf if shows_all else MOST_ROWS)
    title = ", ".join(filter(None, (name, FIELD_AREA.format(ranking.area_ha, 2), describe_machines(ranking))))
    must = filter(None, (answer.verdict, answer.decision, answer.question, answer.conditions))
    others = tuple(filter(None, (answer.rule, answer.alternatives)))
    parts: list[RenderableType] = [AnswerLines(tuple(must), others, answer.faults, title, is_whole=not with_next)]
    if plans:
        parts += [Text(""), build_answer_table(ranking, plans)]
    if not with_next:
        return Group(*parts)
    hints = [_suggest_outputs(bool(plans), has_page, has_plan)]
    if ranking.best is not None and plans and not ranking.samples and not ranking.start:
        hints.append(translate("Add --start 13:00 --deadline 17:00 to know how sure and how cheap it can be."))
    hints += describe_defaults(ranking.scenario.get("defaults") or {})
    parts += [] if plans else [Text("")]
    return Group(*parts, *(format_sentence(text, style="dim") for text in hints))


def _suggest_outputs(is_feasible: bool, has_page: bool, has_plan: bool) -> str:
    """Options that tell more, without those that were given."""
    if not is_feasible:
        parts = [translate("--explain (all reasons)")]
        parts += [] if has_page else [translate("--html plan.html (map of the places that fail)")]
    else:
        parts = [translate("--explain (why and how)")]
        parts += [] if has_page else [translate("--html plan.html (map)")]
        parts += [] if has_plan else [translate("--save plan.json (drive)")]
    return translate("Add {options}.", options=", ".join(parts))


def choose_first_plans(ranking: PlanRanking, most: float = MOST_ROWS) -> list[PlanResult]:
    """The best plan, then those to take with other numbers of tractors, then others until there are a few rows.

    Numbers of tractors are those beside that of the best and those of the Pareto front, as many as have room.
    """
    plans, best = ranking.eligible, ranking.best
    if best is None or not plans:
        return []
    front = {plan.tractors for plan in plans if plan.on_pareto_front}
    to_take = [*ranking.neighbours, *(plan for count, plan in ranking.by_count.items() if count in front)]
    first = [best]
    for plan in to_take:
        first += [plan] if len(first) < most and all(plan is not each for each in first) else []
    others = [plan for plan in plans if all(plan is not each for each in first)]
    shown = [*first[:1], *sorted(first[1:], key=lambda plan: plan.tractors)]
    return [*shown, *(others if math.isinf(most) else others[: max(LEAST_ROWS - len(first), 0)])]


def choose_plan_per_count(ranking: PlanRanking) -> list[PlanResult]:
    """The plan to take with every number of tractors that has a cost from samples, fewest first."""
    return [plan for plan in ranking.by_count.values() if plan.expected_cost is not None]


def build_answer_table(ranking: PlanRanking, plans: Sequence[PlanResult]) -> FittedTable:
    """The table of some plans, in at most seven columns; those that hold the answer are dropped last.

    Below it are what it means and what it leaves out.
    """
    figures = {figure.key: figure for figure in choose_figures(ranking, plans, SCREEN_DROPS)}
    if late := figures.get("stated_late_end_s"):
        has_start = has_start_time(ranking)
        heading = translate("95 % by") if has_start else translate("95 % in")
        figures |= {late.key: replace(late, heading=heading)}
        del figures["waiting_s"]
    kept = sorted(figures, key=SCREEN_DROPS.__getitem__)[:MOST_COLUMNS]
    figures = {key: figure for key, figure in figures.items() if key in kept}
    shown = list(figures.values())
    notes = (write_legend(ranking, plans), *count_other_plans(ranking, plans))
    return build_figure_table(ranking, plans, shown, SCREEN_DROPS, _MORE_HINT, notes, stars=_shows_front(plans))


def write_legend(ranking: PlanRanking, plans: Sequence[PlanResult]) -> str:
    """What the marks in the table mean, and what its times and costs are.

    The first has what decided against quicker plans with as many tractors, where one reason holds for all.
    """
    best = ranking.best
    mark = translate("> recommended") if ranking.is_recommended else translate("> the best, but no recommendation")
    if best is not None and ranking.chosen is None:  # samples decide by cost, or by what was asked for
        limit_s = best.stated_end_s - SAME_TIME_S
        quicker = [plan for plan in plans if plan.tractors == best.tractors and plan.stated_end_s < limit_s]
        reasons = {find_deciding_reason(best, plan) for plan in quicker}
        reason = reasons.pop() if len(reasons) == 1 else None
        if reason is not None:
            mark += f", {translate(reason, distance=format_width(ranking.scenario['clearance_m']))}"
    has_samples = any(plan.p50_s is not None for plan in plans)
    figures = (
        translate("times are medians, costs are means")
        if has_samples
        else translate("times and costs are as simulated, without late starts, stops and breakdowns")
    )
    front = [translate("* the fastest with so many tractors or fewer")] if _shows_front(plans) else []
    return f"{'; '.join([mark, *front, figures])}."


def _shows_front(plans: Sequence[PlanResult]) -> bool:
    """Whether some of the plans are on the Pareto front and some are not; a mark on all would tell nothing."""
    return len({plan.on_pareto_front for plan in plans}) > 1


def count_other_plans(ranking: PlanRanking, plans: Sequence[PlanResult]) -> list[str]:
    """How many plans the table leaves out, were refused, or were not simulated for which reason."""
    refused, pruned = split_refused(ranking).values()
    near_count = sum(not plan.keeps_clearance for plan in pruned)
    worse_count = len(pruned) - near_count
    hidden = len(ranking.eligible) - len(plans)
    counts = [translate_count("{count} more plan", "{count} more plans", hidden)] if hidden else []
    if refused:
        counts.append(translate("{count} refused", count=len(refused)))
    if near_count:
        values = {"near": near_count, "distance": format_width(ranking.scenario["clearance_m"])}
        text = translate(
            "{count} not simulated as others are better, {near} as tractors may come nearer than {distance} (--all)",
            count=worse_count,
            **values,
        )
        near_only = translate("{near} other plans, whose tractors may come nearer than {distance} (--all)", **values)
        counts.append(text if worse_count else near_only)
    elif worse_count:
        counts.append(translate("{count} not simulated as others are better (--all)", count=worse_count))
    listed = ", ".join(counts)
    return [translate("Not shown: {counts}.", counts=listed)] if listed and plans else []


def build_ranking_table(ranking: PlanRanking, most_plans: int | None = 20) -> RenderableType:
    """What a ranking says beyond its first screen: sentences, all plans, remarks, and what was refused and why.

    The table holds the `most_plans` fastest plans (all when None), the best plan and the Pareto front.
    """
    plans = ranking.eligible
    shown = [
        plan
        for place, plan in enumerate(plans)
        if most_plans is None or place < most_plans or plan.on_pareto_front or plan is ranking.best
    ]
    parts: list[RenderableType] = [*map(format_sentence, write_answer(ranking).details)]
    if shown:
        figures = choose_figures(ranking, shown, TABLE_DROPS, is_brief=True)
        notes = _list_table_notes(ranking, shown, figures)
        parts += [Text(""), build_figure_table(ranking, shown, figures, TABLE_DROPS, _ALL_HINT, notes, stars=True)]
        counted = choose_plan_per_count(ranking)
        if len(counted) > 1:
            figures = choose_figures(ranking, counted, COUNT_DROPS, is_brief=True)
            parts += [Text(""), format_title(f"By number of tractors, money in {ranking.currency}")]
            parts.append(build_figure_table(ranking, counted, figures, COUNT_DROPS, _ALL_HINT, (BY_COUNT_HELP,)))
    effects = describe_simulated_effects(ranking)
    remarks = [*ranking.check_sentences, *([effects] if effects else [])]
    parts += [format_sentence(text, style="dim") for text in remarks]
    by_heading = split_refused(ranking)
    for heading, plans_without in by_heading.items():
        parts += _list_refusal_reasons(heading, plans_without)
    parts += [format_sentence("--all simulates these too.", style="dim")] if by_heading[NOT_SIMULATED] else []
    return Group(*parts)


def _list_table_notes(ranking: PlanRanking, shown: Sequence[PlanResult], figures: Sequence[Figure]) -> list[str]:
    """What the marks and columns of the table mean, what is not in it, and remarks on its plans."""
    legend = translate("Times are h:mm:ss. * no plan with as few tractors is faster (Pareto front).")
    legend += f" {translate('> best plan.')}" if ranking.best else ""
    legend += f" {translate(UNWORKED_HELP)}" if any(figure.key == "missed_m2" for figure in figures) else ""
    hidden = len(ranking.eligible) - len(shown)
    if hidden:
        legend += " " + translate_count(
            "{count} slower plan is not shown; --all shows every plan.",
            "{count} slower plans are not shown; --all shows every plan.",
            hidden,
        )
    headings_by_note: dict[str, list[str]] = {}
    for figure in figures:
        if figure.note:
            heading = translate(figure.heading).removesuffix(" m")
            headings_by_note.setdefault(translate(figure.note), []).append(heading)
    explained = "; ".join(f"{join_list(headings)}: {note}" for note, headings in headings_by_note.items())
    has_risk = any(plan.expected_cost is not None for plan in shown)
    money = [] if has_risk else [f"{text[:-1]}, in {ranking.currency}." for text in ranking.money_sentences]
    return [legend, f"{explained}.", *money, *list_plan_remarks(shown)]


def _list_refusal_reasons(heading: str, plans: list[PlanResult]) -> list[RenderableType]:
    if not plans:
        return []
    parts: list[RenderableType] = [
        Text(""),
        format_title(f"{heading}: {len(plans)} plan{'s' if len(plans) > 1 else ''}"),
    ]
    for refusal in group_refusals(plans):
        similar_note = " (figures of the first)" if refusal.has_similar_reasons else ""
        parts.append(format_bullet(f"{len(refusal.plans)} x  {refusal.reason}{similar_note}"))
        parts.append(format_sentence(refusal.members, style="dim", indent=4))
    return parts
