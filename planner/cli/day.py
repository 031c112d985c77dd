"""`headland day`: several fields and fleets on one day."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer
from typer.core import TyperGroup

from planner.cli.common.options import (
    NO_RESULT_STATUS,
    AsJson,
    ExecutorChoice,
    ForceOption,
    add_example_commands,
    create_group,
    inject_request_options,
)
from planner.cli.common.outputs import (
    Result,
    check_cache_folder,
    check_output_paths,
    list_input_files,
    write_before_printing,
)
from planner.cli.common.terminal import AnswerForm, print_remarks, print_sentence, warm_up
from planner.errors import RequestError
from planner.request.job_options import DAY_HELP
from reports.common.language import mark_text

if TYPE_CHECKING:
    from planner.day.input_file import DayFile
    from reports.day.results import DayResult


PLAN = "plan"
DAY_OPTIONS: dict[str, dict[str, Any]] = {
    "farm": {"help": DAY_HELP["farm"]},
    "rain": {"help": DAY_HELP["rain"]},
    "samples": {"default": 10_000, "help": DAY_HELP["samples"]},
    "seed": {},
}
"""Options of a plan that a day takes, and what differs."""


class FileFirstGroup(TyperGroup):
    """A group whose first word may be a file instead of a command."""

    def parse_args(self, context: Any, args: list[str]) -> list[str]:
        """Insert `plan` before a first argument that is no command."""
        own_commands = {*self.commands, *self.get_help_option_names(context)}
        return super().parse_args(context, args if not args or args[0] in own_commands else [PLAN, *args])


day = create_group(
    """Several fields and fleets on one day: which fleet works which field, when, and how certain that is.

    Fields, windows, values, fleets, roads, light and rain are in one file; headland day new day.toml writes an example.

    Example: headland day day.toml --html day.html
    """,
    cls=FileFirstGroup,
)


@day.command(PLAN)
@inject_request_options(only=DAY_OPTIONS, panels=False, changes=DAY_OPTIONS)
def plan_day_file(
    file: Annotated[str, typer.Argument(help="A day file (headland day new).")],
    certainty: Annotated[Optional[float], typer.Option(help=DAY_HELP["certainty"])] = None,
    html: Annotated[Optional[Path], typer.Option(help="Write one page with pictures and tables.")] = None,
    png: Annotated[Optional[Path], typer.Option(help="Write the chart of machines and fields over time.")] = None,
    map_png: Annotated[Optional[Path], typer.Option("--map", help="Write the map of fields and roads, PNG.")] = None,
    force: ForceOption = False,
    explain: Annotated[
        bool, typer.Option("--explain", help="Print roads, fields, costs, and how each figure is made up as well.")
    ] = False,
    json: AsJson = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV, a row per field, instead of the tables.")] = False,
    cache: Annotated[
        Optional[Path], typer.Option("--cache", help="Folder for simulated field times; it may be deleted at any time.")
    ] = None,
    processes: Annotated[Optional[int], typer.Option(help="Processes to use; by default one per core.")] = None,
    field_minutes: Annotated[
        float,
        typer.Option(
            help="Most computing for one fleet on one field, minutes; then the best plan found so far is taken, and it "
            "says so."
        ),
    ] = 10.0,
    **options: Any,
) -> None:
    """Simulate every fleet on every field that it fits, and assign the fields to the fleets in the best order.

    Example: headland day plan day.toml --html day.html. The word plan may be left out.
    """
    from planner.cli.common.progress import open_stage_bar
    from planner.day.input_file import load_day
    from planner.day.planning import plan_day, prepare_day
    from planner.pipeline.result_cache import ResultCache, find_cache_folder
    from planner.request.option_checks import check_day_options
    from reports.day.tables import build_day_screen, build_day_table, format_day_csv, format_day_json

    form, executor_choice = AnswerForm(json, csv, explain), ExecutorChoice(processes)
    samples, seed = options["samples"], options["seed"]
    check_day_options(samples, certainty)
    check_cache_folder(cache)
    if not field_minutes > 0.0:
        raise RequestError(f"--field-minutes is {field_minutes:g}; use more than 0.")
    day_file, farm_file = load_day(file, farm=options["farm"], rain=options["rain"], certainty_pct=certainty)
    check_output_paths(
        (html, ".html"), (png, ".png"), (map_png, ".png"), input_files=_list_day_files(file, day_file), force=force
    )
    prepared = prepare_day(day_file, farm_file)
    print_remarks(f"{one.name}: {text}" for one in prepared.fields for text in one.remarks)
    store = ResultCache(find_cache_folder() / "field-times" if cache is None else cache)
    unknown_count = prepared.count_uncached_field_times(store)
    if unknown_count:
        warm_up()
    with executor_choice.open_executor(max(unknown_count, 1)) as executor, open_stage_bar("Simulating fields") as bar:
        result = plan_day(
            prepared, cache=store, executor=executor, progress=bar.count, report_work=bar.show_work, samples=samples,
            seed=seed, field_minutes=field_minutes,
        )  # fmt: skip
    with write_before_printing(*_list_day_results(result, html, png, map_png)):
        form.print_answer(
            result, json=format_day_json, csv=format_day_csv, screen=build_day_screen, table=build_day_table
        )
    if not result.jobs:
        print_sentence(f"No field can be done; the closest is {result.closest_field}.", err=True)
    if not result.jobs or result.shortfalls:
        raise typer.Exit(NO_RESULT_STATUS)


def _list_day_results(result: DayResult, html: Path | None, png: Path | None, map_png: Path | None) -> list[Result]:
    """The page and the pictures; says so if there is no map."""
    from reports.day.page import draw_gantt, draw_road_map, render_day_page
    from reports.plan.map_figure import render_png

    results: list[Result] = [(html, lambda: render_day_page(result)), (png, lambda: render_png(draw_gantt(result)))]
    road_map = draw_road_map(result) if map_png else None
    if road_map is not None:
        results.append((map_png, render_png(road_map)))
    elif map_png:
        typer.echo("There is no map, as fewer than two places are known; give lon and lat.", err=True)
    return results


add_example_commands(
    day,
    "day",
    lambda file: mark_text(f"This is an example: adapt it, then plan the day with headland day {file}."),
)


def _list_day_files(file: str, day_file: DayFile) -> dict[str | Path, str]:
    """The files that a day reads, and what they are."""
    from fields.documents.sources import list_field_files
    from planner.day.input_file import EXAMPLE

    files: dict[str | Path, str] = {file: "the day file"}
    for entry in day_file.fields:
        files |= dict.fromkeys(list_field_files(entry.file), "a field of the day")
        files |= {} if entry.elevation is None else {entry.elevation: "the heights of a field of the day"}
    farm = None if day_file.farm == EXAMPLE else day_file.farm
    return files | list_input_files({"farm": farm, "rain": day_file.rain})
