"""`headland compare-bearings`: one field on slopes, planned in several bearings and along its contours."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Optional

import typer

from planner.cli.common.options import (
    NO_PLAN_STATUS,
    AsJson,
    ClusterOption,
    ExecutorChoice,
    FieldArgument,
    GivenOptions,
    ProcessesOption,
    inject_request_options,
    render_refusal,
)
from planner.cli.common.terminal import AnswerForm, create_progress_callback, warm_up
from planner.errors import RequestError, shorten_value
from planner.request.plan_request import FIELD

LEFT_OUT = ("bearing", "cell_bearing", "guidance_line", "swaths", "no_headland", "all")
"""Options of a plan that this command compares, or that exclude what it compares."""
_ONE_TRACTOR: dict[str, dict[str, Any]] = {
    "tractors": {"default": "1", "help": "Tractor counts to try; the best plan of each bearing is compared."},
    "strategies": {
        "default": "split-field",
        "help": "Strategies to try, separated by commas, or all; the best plan of each is compared.",
    },
}


@inject_request_options(without=LEFT_OUT, changes=_ONE_TRACTOR)
def compare_bearings(
    context: typer.Context,
    field: FieldArgument = "iwamizawa",
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
    from planner.pipeline.bearing_comparison import USUAL_BEARINGS_DEG, list_bearing_requests
    from planner.pipeline.bearing_comparison import compare_bearings as compare
    from reports.plan.bearing_report import build_bearing_table, format_bearing_json

    chosen = USUAL_BEARINGS_DEG if bearings is None else _parse_bearings(bearings)
    given = GivenOptions(context, options)
    completed = given.build_inputs(given.build_request(field=field))
    inputs = [replace(completed, request=one) for one in list_bearing_requests(completed.request, chosen)]
    executor_choice = ExecutorChoice(processes, cluster)
    warm_up()
    with (
        executor_choice.open_executor(len(inputs)) as executor,
        create_progress_callback("Comparing bearings") as progress,
    ):
        comparison = compare(inputs, executor, progress, render_refusal)
    AnswerForm(json).print_answer(comparison, json=format_bearing_json, screen=build_bearing_table)
    if all(row.plan is None for row in comparison.rows):
        raise typer.Exit(NO_PLAN_STATUS)


def _parse_bearings(text: str) -> tuple[float, ...]:
    """ "0,45,90" as degrees, each once; raises RequestError."""

    try:
        return tuple(dict.fromkeys(float(part) for part in text.split(",")))
    except ValueError:
        raise RequestError(
            f"--bearings {shorten_value(text)} is not a list of degrees; write for instance 0,45,90,135."
        ) from None
