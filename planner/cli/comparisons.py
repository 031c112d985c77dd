"""`headland compare-headlands` and `compare-bearings`: fields planned in several ways, side by side."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from planner.cli.common.options import (
    DEFAULT_FIELD,
    NO_RESULT_STATUS,
    AsJson,
    ClusterOption,
    CsvOption,
    ExecutorChoice,
    FieldArgument,
    FieldsArgument,
    ForceOutputOption,
    HeadlandOrderOption,
    JsonOption,
    ProcessesOption,
    build_requests,
    in_output,
    in_work,
    inject_request_options,
    read_given_options,
    render_refusal,
)
from planner.cli.common.outputs import check_output_paths, list_input_files, write_before_printing
from planner.cli.common.terminal import AnswerForm, create_progress_callback, print_remarks, warm_up
from planner.errors import RequestError, shorten_value, suggest_name
from planner.request.parameter_names import WISHES
from planner.request.plan_request import COSTS, FIELD, MAX_HEADLAND_PASSES
from reports.common.language import mark_text
from strategies.path_planning.turn_kinds import CORNERS, HEADLAND_ORDERS

if TYPE_CHECKING:
    from planner.evaluation.work_order import WorkOrder
    from reports.plan.comparison import Comparison

MAX_OPERATIONS_PER_YEAR = 366  # one a day
COMPARED_OPTIONS = (
    "corners", "headland", "headland_passes", "headland_first", "headland_last", "no_headland", *WISHES
)  # fmt: skip
"""Options of a plan that this command takes as lists, or not at all."""
_SPLIT_FIELD = {
    "default": "split-field",
    "help": "Strategies to try, separated by commas, or all; the best plan of each is compared.",
}
_CHANGED_OPTIONS: dict[str, dict[str, Any]] = {
    "width": {
        "type": str,
        "default": "3",
        "help": "Working widths of the implement, metres: 3 or 3,6; with several each is compared.",
    },
    "tractors": {"default": "2", "help": "Tractor counts to try: 2, 1-3 or 1,2; the best plan of each is compared."},
    "strategies": _SPLIT_FIELD,
}
LEFT_OUT = ("bearing", "cell_bearing", "guidance_line", "swaths", "no_headland", "all", *WISHES)
"""Options of a plan that this command compares, or that exclude what it compares."""
_ONE_TRACTOR = {
    "tractors": {"default": "1", "help": "Tractor counts to try; the best plan of each bearing is compared."},
    "strategies": _SPLIT_FIELD,
}


@inject_request_options(without=COMPARED_OPTIONS, changes=_CHANGED_OPTIONS)
def compare_headlands(
    context: typer.Context,
    fields: FieldsArgument = None,
    corners: Annotated[str, in_work(help="Kinds of corners: square, round, auto.")] = ",".join(CORNERS),
    headland_order: HeadlandOrderOption = None,
    headland_passes: Annotated[
        Optional[str],
        in_work(help="Numbers of headland passes: 1,2,3. By default as many as turns need."),
    ] = None,
    operations_per_year: Annotated[
        int,
        typer.Option(help="How often a field is worked in a year, for hours, fuel and cost.", rich_help_panel=COSTS),
    ] = 1,
    html: Annotated[Optional[Path], in_output(help="Write one page with a map of every plan.")] = None,
    force: ForceOutputOption = False,
    json: JsonOption = False,
    csv: CsvOption = False,
    processes: ProcessesOption = None,
    cluster: ClusterOption = None,
    **options: Any,
) -> None:
    """Compare ways to work the headland: corners, order, number of passes and working width, on one field or several.

    Example: headland compare-headlands farm.geojson#* --corners square,round --headland-passes 2,3 --html page.html
    """
    from planner.pipeline.many_fields import compare_ways, list_headland_requests, share_obstacles
    from reports.plan.headland_report import (
        build_headland_table,
        format_headland_csv,
        format_headland_json,
        render_headland_page,
    )

    form = AnswerForm(json, csv)
    if not 1 <= operations_per_year <= MAX_OPERATIONS_PER_YEAR:
        raise RequestError(f"--operations-per-year is {operations_per_year}; use 1 to {MAX_OPERATIONS_PER_YEAR}.")
    choices = (
        _parse_choices(corners, "--corners", CORNERS),
        () if headland_order is None else _parse_choices(headland_order, "--headland-order", HEADLAND_ORDERS),
        () if headland_passes is None else _parse_pass_counts(headland_passes),
    )
    executor_choice = ExecutorChoice(processes, cluster)
    given = read_given_options(context, options)
    requests = build_requests(given, fields)
    orders = [
        replace(order, request=request)
        for order in map(given.build_order, share_obstacles(requests))
        for request in list_headland_requests(order.request, *choices)
    ]
    input_files: dict[str | Path, str] = {}
    for name in dict.fromkeys(request.field for request in requests):
        input_files |= list_input_files({"field": name, "farm": given.values["farm"]})
    check_output_paths((html, ".html"), input_files=input_files, force=force)
    compare = partial(compare_ways, with_maps=html is not None)
    comparison = replace(
        _compare(compare, orders, executor_choice, mark_text("Comparing headlands")),
        operations_per_year=operations_per_year,
    )
    _check_any_way(comparison)
    rankings = [row.ranking for row in comparison.rows if row.ranking is not None]
    print_remarks(dict.fromkeys(remark for one in rankings for remark in one.field_remarks))
    with write_before_printing((html, lambda: render_headland_page(comparison))):
        form.print_answer(comparison, json=format_headland_json, csv=format_headland_csv, screen=build_headland_table)
    best = comparison.best
    if best is None or not best.is_complete or not all(each.meets_request for each in best.rows):
        raise typer.Exit(NO_RESULT_STATUS)


def _compare(
    compare: Callable[..., Comparison], orders: Sequence[WorkOrder], executor_choice: ExecutorChoice, title: str
) -> Comparison:
    """What is compared of some work orders, while a bar with a title says how many are answered."""
    warm_up()
    with executor_choice.open_executor(len(orders)) as executor, create_progress_callback(title) as progress:
        return compare(orders, executor, progress, render_refusal)


def _check_any_way(comparison: Comparison) -> None:
    """Raise RequestError if the only field is refused for one reason, whatever the way."""
    reasons = {row.refusal for row in comparison.rows}
    if len(comparison.fields) == 1 and len(reasons) == 1 and None not in reasons:
        raise RequestError(str(reasons.pop()))


def _parse_choices(text: str, option: str, allowed: Sequence[str]) -> tuple[str, ...]:
    """The words of a list with commas, each once; raises RequestError."""

    words = tuple(dict.fromkeys(word.strip() for word in text.split(",")))
    for word in words:
        if word not in allowed:
            raise RequestError(
                f"{option} {shorten_value(word)} is unknown{suggest_name(word, allowed)}; use one or more of "
                f"{', '.join(allowed)}, separated by commas."
            )
    return words


def _parse_pass_counts(text: str) -> tuple[int, ...]:
    """ "2", "1-3" or "1,2,4" as numbers of headland passes, each once; raises RequestError."""

    counts: dict[int, None] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,3})\s*(?:-\s*(\d{1,3})\s*)?", part)
        numbers = range(int(match[1]), int(match[2] or match[1]) + 1) if match else range(0)
        if not numbers or numbers[0] < 1 or numbers[-1] > MAX_HEADLAND_PASSES:
            raise RequestError(
                f"--headland-passes {shorten_value(text)} is not a list of numbers from 1 to {MAX_HEADLAND_PASSES}; "
                "write for instance 2, 1-3 or 1,2,4."
            )
        counts |= dict.fromkeys(numbers)
    return tuple(counts)


@inject_request_options(without=LEFT_OUT, changes=_ONE_TRACTOR)
def compare_bearings(
    context: typer.Context,
    field: FieldArgument = DEFAULT_FIELD,
    bearings: Annotated[
        Optional[str],
        typer.Option(help="Bearings to try, degrees clockwise from north: 0,45,90,135.", rich_help_panel=FIELD),
    ] = None,
    json: AsJson = False,
    processes: ProcessesOption = None,
    cluster: ClusterOption = None,
    **options: Any,
) -> None:
    """Compare bearings of the tracks on slopes: time, fuel, largest cross slope, margin to rolling over and erosion.

    The bearing that a plan chooses by itself and tracks along contours are compared as well.

    Example: headland compare-bearings hill.geojson --elevation hill.tif --bearings 0,45,90,135
    """
    from planner.pipeline.many_fields import USUAL_BEARINGS_DEG, list_bearing_requests
    from planner.pipeline.many_fields import compare_bearings as compare
    from reports.plan.bearing_report import build_bearing_table, format_bearing_json

    chosen: tuple[float, ...] = USUAL_BEARINGS_DEG
    if bearings is not None:
        try:
            chosen = tuple(dict.fromkeys(map(float, bearings.split(","))))
        except ValueError:
            raise RequestError(
                f"--bearings {shorten_value(bearings)} is not a list of degrees; write for instance 0,45,90,135."
            ) from None
    given = read_given_options(context, options)
    completed = given.build_order(given.build_request(field=field))
    orders = [replace(completed, request=one) for one in list_bearing_requests(completed.request, chosen)]
    comparison = _compare(compare, orders, ExecutorChoice(processes, cluster), mark_text("Comparing bearings"))
    AnswerForm(json).print_answer(comparison, json=format_bearing_json, screen=build_bearing_table)
    if all(row.best is None for row in comparison.rows):
        raise typer.Exit(NO_RESULT_STATUS)
