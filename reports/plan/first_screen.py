"""The first screen of a ranking for a terminal: the answer, a short table, and what to type next.

At 80 columns it has at most 20 lines, of which at most five stand before the table.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rich.console import Group, RenderableType
from rich.text import Text

from fields.errors import shorten_middle
from reports.common.language import mark_text, translate, translate_count
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.text_tables import AnswerLines, FittedTable, format_sentence
from reports.common.units import FIELD_AREA
from reports.common.wording import parse_start_time
from reports.plan.answer import write_answer
from reports.plan.figures import SCREEN_DROPS, build_figure_table, choose_figures
from reports.plan.plan_wording import describe_machines, list_feasible, list_refused

MOST_ROWS, LEAST_ROWS = 6, 5
MOST_COLUMNS = 7
_MOST_NAME_LETTERS = 40
_MORE_HINT = mark_text("a wider window or --explain shows more")


def build_first_screen(ranking: PlanRanking, *, shows_all: bool = False, with_next: bool = True) -> RenderableType:
    """What to do in a few lines, the plans to choose from in a table, and what to type next.

    The table holds the best plan, then the Pareto front, then others as they are ranked: few, or all with `shows_all`.
    """
    plans = choose_first_plans(ranking, math.inf if shows_all else MOST_ROWS)
    answer, title = write_answer(ranking), ""
    certainty = " ".join(filter(None, (answer.work, answer.certainty)))
    must = (answer.verdict, answer.decision) if answer.verdict else (answer.decision, certainty)
    others = (certainty, answer.alternatives) if answer.verdict else (answer.alternatives,)
    faults = (answer.question, *answer.faults) if answer.question else answer.faults
    if not ranking.shortfalls:
        name = shorten_middle(ranking.field_name, _MOST_NAME_LETTERS)
        title = ", ".join(filter(None, (name, FIELD_AREA.format(ranking.area_ha, 2), describe_machines(ranking))))
    parts: list[RenderableType] = [AnswerLines(tuple(filter(None, must)), others, faults, title)]
    if plans:
        parts += [
            Text(""),
            build_answer_table(ranking, plans),
            format_sentence(write_legend(ranking, plans), style="dim"),
        ]
    parts += [format_sentence(text, style="dim") for text in count_other_plans(ranking, plans)]
    if with_next:
        parts += [] if plans else [Text("")]
        parts += [format_sentence(text, style="dim") for text in _suggest_commands(ranking)]
    return Group(*parts)


def choose_first_plans(ranking: PlanRanking, most: float = MOST_ROWS) -> list[PlanResult]:
    """The best plan, then the Pareto front from few tractors to many, then others until there are a few rows."""
    plans, best = list_feasible(ranking), ranking.best
    front = sorted(
        (plan for plan in plans if plan.on_pareto_front and plan is not best), key=lambda plan: plan.tractors
    )
    first = [*([best] if best else []), *front]
    others = [plan for plan in plans if all(plan is not each for each in first)]
    if math.isinf(most):
        return [*first, *others]
    return [*first[: int(most)], *others[: max(LEAST_ROWS - len(first), 0)]]


def build_answer_table(ranking: PlanRanking, plans: Sequence[PlanResult]) -> FittedTable:
    """The table of some plans, in at most seven columns; those that hold the answer are dropped last."""
    figures = {figure.key: figure for figure in choose_figures(ranking, plans, SCREEN_DROPS)}
    if late := figures.get("stated_late_end_s"):
        has_start = parse_start_time(ranking.start) is not None
        heading = translate("95 % by") if has_start else translate("95 % in")
        figures |= {late.key: replace(late, heading=heading)}
        del figures["waiting_s"]
    if len(figures) > MOST_COLUMNS:
        figures = {key: figure for key, figure in figures.items() if key not in ("fuel_l", "energy_kwh")}
    shows_front = _is_front_part(plans)

    def mark_count(plan: PlanResult) -> str:
        star = ("*" if plan.on_pareto_front else " ") if shows_front else ""
        return f"{'>' if plan is ranking.best else ''}{plan.tractors}{star}"

    return build_figure_table(ranking, plans, list(figures.values()), SCREEN_DROPS, mark_count, _MORE_HINT)


def _is_front_part(plans: Sequence[PlanResult]) -> bool:
    """Whether some of the plans are on the Pareto front and some are not; a mark on all would tell nothing."""
    return len({plan.on_pareto_front for plan in plans}) > 1


def write_legend(ranking: PlanRanking, plans: Sequence[PlanResult]) -> str:
    """What the marks in the table mean, and what its times and costs are."""
    best = ranking.best
    mark = translate("> recommended") if ranking.is_recommended else translate("> the best, but no recommendation")
    alike = [plan for plan in plans if best is not None and plan.tractors == best.tractors]
    if best is not None and any((plan.time_s or math.inf) < (best.time_s or 0.0) for plan in alike):
        mark = translate("{mark}, as ground left counts", mark=mark)
    has_samples = any(plan.p50_s is not None for plan in plans)
    figures = (
        translate("times are medians, costs are means")
        if has_samples
        else translate("times and costs are as simulated")
    )
    front = [translate("* the fastest with so many tractors or fewer")] if _is_front_part(plans) else []
    return f"{'; '.join([mark, *front, figures])}."


def count_other_plans(ranking: PlanRanking, plans: Sequence[PlanResult]) -> list[str]:
    """How many plans the table leaves out, were refused, or were not simulated."""
    refused = list_refused(ranking)
    not_simulated = sum(not plan.is_simulated for plan in refused)
    hidden = len(list_feasible(ranking)) - len(plans)
    counts = [
        translate_count("{count} more plan", "{count} more plans", hidden) if hidden else "",
        translate("{count} refused", count=len(refused) - not_simulated) if len(refused) > not_simulated else "",
        translate("{count} not simulated as others are better", count=not_simulated) if not_simulated else "",
    ]
    listed = ", ".join(filter(None, counts))
    return [translate("Not shown: {counts}.", counts=listed)] if listed and ranking.best is not None else []


def _suggest_commands(ranking: PlanRanking) -> list[str]:
    if ranking.best is None:
        return [translate("Add --explain (all reasons), --html plan.html (map of the places that fail).")]
    first = translate("Add --explain (why and how), --html plan.html (map), --save plan.json (drive).")
    if ranking.samples or ranking.start:
        return [first]
    return [first, translate("Add --start 13:00 --deadline 17:00 to know how sure and how cheap it can be.")]
