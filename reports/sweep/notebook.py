"""A sweep in a notebook: in short, as a fragment, as a table and drawn."""

from __future__ import annotations

from reports.common.notebook import NOT_DRAWN, ResultView, build_view, encode_picture, render_fragment
from reports.sweep.page import draw_sweep, render_sweep_page, render_sweep_png
from reports.sweep.results import SweepResult
from reports.sweep.tables import (
    build_front_table,
    format_sweep_csv,
    format_sweep_json,
    list_rows,
    render_sweep_parquet,
)
from reports.sweep.wording import (
    ESTIMATED,
    describe_best,
    describe_influences,
    describe_refused,
    describe_rows,
    describe_title,
)


@build_view.register
def build_sweep_view(result: SweepResult) -> ResultView:
    """A sweep: what to take, cost over time, and all plans as a table."""
    return ResultView(
        summary=lambda: f"{describe_title(result)}. {describe_best(result)}",
        html=lambda: render_sweep_fragment(result),
        table=lambda: list_rows(result),
        draw=None if result.best is None else lambda axes: draw_sweep(axes, result),
        not_drawn=f"{NOT_DRAWN}, as no combination has a plan.",
        files={
            ".csv": lambda: format_sweep_csv(result),
            ".json": lambda: format_sweep_json(result),
            ".html": lambda: render_sweep_page(result),
            ".png": lambda: render_sweep_png(result),
            ".parquet": lambda: render_sweep_parquet(result),
        },
    )


def render_sweep_fragment(result: SweepResult) -> str:
    """What to take and what matters, cost over time, and the table of what no other beats."""
    sentences = [describe_best(result), describe_influences(result), describe_refused(result), ESTIMATED]
    rows = result.rows
    picture = None if result.best is None else encode_picture(lambda axes: draw_sweep(axes, result))
    best = next((place for place, one in enumerate(rows) if one is result.best), None)
    tables = [build_front_table(result).convert_for_notebook(best, describe_rows(result))] if rows else []
    shown = [text for text in sentences if text]
    return render_fragment(describe_title(result), shown, tables, picture, "Cost over time of all combinations")
