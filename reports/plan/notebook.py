"""Rankings, single plans and drives in a notebook: in short, as a fragment, as a table and drawn."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from fields.errors import escape_controls, shorten_middle
from reports.common import palette
from reports.common.drawing_sizes import COLUMN_INCHES
from reports.common.plan_records import PlanDrive
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.rendering import (
    FIGURE_INCHES,
    NOT_DRAWN,
    ResultView,
    build_view,
    encode_picture,
)
from reports.common.text_tables import build_plain_table, render_fragment
from reports.common.wording import format_duration, format_number, format_price, format_tractor_count
from reports.plan.answer import write_answer
from reports.plan.drive_geometry import compute_extent
from reports.plan.figures import build_plan_entry, flatten_entry, format_ranking_csv, format_ranking_json
from reports.plan.map_figure import build_legend_entries, draw_map_layers, escape_figure_formula
from reports.plan.map_labels import count_tracks
from reports.plan.other_plans import name_plan
from reports.plan.plan_wording import describe_machines
from reports.plan.ranking_page import render_plan_page
from reports.plan.ranking_table import build_answer_table, choose_first_plans

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

MOST_ROWS = 12  # of plans in a fragment; to_pandas has all
MOST_TITLE_CHARS = 80  # above a drawing
LEAST_MAP_INCHES = 3.0  # width of a map, and its least height
Files = Mapping[str, Callable[[], str | bytes]]


@build_view.register
def build_ranking_view(
    ranking: PlanRanking, picture: Callable[[], PlanDrive] | None = None, files: Files | None = None
) -> ResultView:
    """A ranking: its answer, the table of its plans, and a map of the best one or of the field where no plan works.

    Without a `picture` it is drawn as time by number of tractors; `files` are by default those that need no drive.
    """

    def summarise() -> str:
        answer = write_answer(ranking)
        decision = f"{answer.decision}." if answer.decision else ""
        sentences = " ".join(filter(None, (answer.verdict, decision, answer.work, answer.certainty)))
        return f"{ranking.field_name}, {format_number(ranking.area_ha, 2)} ha. {sentences}"

    def render() -> str:
        """Answer, map, and the table of the first screen with its legend; the best plan is the first row."""
        area, tables = f"{format_number(ranking.area_ha, 2)} ha", []
        heading = ", ".join(filter(None, (ranking.field_name, area, describe_machines(ranking))))
        drawing = None if picture is None else _encode_map(picture())
        if ranking.eligible:
            tables.append(build_answer_table(ranking, choose_first_plans(ranking, MOST_ROWS)))
        sentences = write_answer(ranking).list_sentences()
        return render_fragment(heading, sentences, tables, drawing, "Map of the field and the best plan")

    def tabulate() -> DataFrame:
        """A row per plan with the columns, order and values of the CSV."""
        import pandas as pd

        types = dict.fromkeys(("field", "strategy", "turn", "reason", "remark"), "str")
        text = io.StringIO(format_ranking_csv(ranking))
        return pd.read_csv(text, dtype=types, keep_default_na=False, na_values=[""])

    def draw(axes: Axes) -> None:
        if picture is None:
            _draw_times(axes, ranking)
        else:
            drive = picture()
            draw_drive(axes, drive, f"{ranking.field_name}: {drive.title}")

    return ResultView(
        summary=summarise,
        html=render,
        table=tabulate,
        draw=draw if picture is not None or ranking.eligible else None,
        not_drawn=f"{NOT_DRAWN}, as no plan works.",
        figure_inches=FIGURE_INCHES if picture is None else (COLUMN_INCHES, COLUMN_INCHES),
        files=files
        or {
            ".csv": lambda: format_ranking_csv(ranking),
            ".json": lambda: format_ranking_json(ranking),
            ".html": lambda: render_plan_page(ranking, None, {}),
        },
    )


def _draw_times(axes: Axes, ranking: PlanRanking) -> None:
    """Minutes to finish the field by number of tractors, a colour per strategy, and the best plan ringed."""
    plans = ranking.eligible
    for place, name in enumerate(dict.fromkeys(plan.strategy for plan in plans)):
        points = sorted((plan.tractors, plan.ranked_s / 60.0) for plan in plans if plan.strategy == name)
        counts, minutes = zip(*points, strict=True)
        axes.plot(counts, minutes, marker="o", linestyle="none", color=palette.get_tractor_colour(place), label=name)
    best = ranking.best
    if best is not None:
        axes.plot(
            best.tractors, best.ranked_s / 60.0, marker="o", markersize=13, markerfacecolor="none",
            markeredgecolor="black", linestyle="none", label="best plan",
        )  # fmt: skip
    axes.set_xticks(sorted({plan.tractors for plan in plans}))
    axes.set_ylim(bottom=0.0)
    axes.set(xlabel="tractors", ylabel="time to finish the field, min", title=_shorten_title(ranking.field_name))
    axes.legend(frameon=False, fontsize=8)


@build_view.register
def build_plan_view(plan: PlanResult) -> ResultView:
    """One plan of a ranking: its figures."""

    def render() -> str:
        entry = flatten_entry(build_plan_entry(plan))
        headings, known = ("Figure", "Value"), ((key, str(one)) for key, one in entry.items() if one is not None)
        table = build_plain_table(headings, known)
        return render_fragment(summarise_plan(plan), [plan.remark] if plan.remark else [], [table])

    return ResultView(
        summary=lambda: summarise_plan(plan),
        html=render,
        table=lambda: [flatten_entry(build_plan_entry(plan))],
        not_drawn=f"{NOT_DRAWN}: this is one row of a ranking; draw the answer of plan(), which has the drive.",
    )


@build_view.register
def build_drive_view(drive: PlanDrive) -> ResultView:
    """A drive on its field: the map, and the seconds of each tractor."""

    return ResultView(
        summary=lambda: f"{drive.title}; {format_tractor_count(len(drive.xy))}, {count_tracks(drive)} tracks",
        html=lambda: render_fragment(drive.title, [], [], _encode_map(drive), "Map of the field and the drive"),
        table=lambda: [
            {"tractor": number + 1, "finish_s": finish_s}
            | {f"{state}_s": values[number] for state, values in drive.seconds.items()}
            for number, finish_s in enumerate(drive.finish_s)
        ],
        draw=lambda axes: draw_drive(axes, drive, drive.title),
        figure_inches=(COLUMN_INCHES, COLUMN_INCHES),
    )


def summarise_plan(plan: PlanResult) -> str:
    """One plan in a sentence: who, how long, what it costs, or why it cannot be driven."""
    name = f"{name_plan(plan)}, turns {plan.turn}"
    if not plan.feasible:
        return f"{name}: not feasible, {plan.reason or 'no reason was given'}"
    late_s, cost = plan.stated_late_end_s, plan.stated_cost
    late = "" if late_s is None else f" (95 % in {format_duration(late_s)})"
    parts = [f"{name}: done in {format_duration(plan.stated_end_s)}{late}"]
    parts += [] if cost is None else [f"cost {format_price(cost)}"]
    parts += [] if plan.worked_pct is None else [f"{format_number(plan.worked_pct, 1)} % worked"]
    return ", ".join(parts)


def draw_drive(axes: Axes, drive: PlanDrive, title: str = "") -> None:
    """The map of a drive on given axes, with title and legend."""
    draw_map_layers(axes, drive)
    axes.set_title(_shorten_title(title), loc="left", fontsize=10)
    axes.legend(
        handles=build_legend_entries(drive), loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4, frameon=False,
        fontsize=8,
    )  # fmt: skip


def _shorten_title(title: str) -> str:
    """A title that fits on a drawing: one line, and no formula."""
    return escape_figure_formula(escape_controls(shorten_middle(title, MOST_TITLE_CHARS)))


def _encode_map(drive: PlanDrive) -> str:
    """The map as PNG in base64, its height by the shape of the field; its title is text above it."""
    box = compute_extent(drive)
    height = COLUMN_INCHES * min(box.height / (box.width or 1.0), 1.3) + 1.4
    return encode_picture(lambda axes: draw_drive(axes, drive), (COLUMN_INCHES, max(height, LEAST_MAP_INCHES)))
