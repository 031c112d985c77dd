"""`headland day`: several fields and fleets on one day."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer
from typer.core import TyperGroup

from planner.commands.options import AsJson

if TYPE_CHECKING:
    from planner.commands.outputs import Content
    from planner.day import DayFile, Ready
    from planner.farm import FarmFile
    from reports.day_results import DayResult

NOTHING_DONE_STATUS = 3
PLAN = "plan"


class FileFirst(TyperGroup):
    """A group whose first word may be a file instead of a command."""

    def parse_args(self, context: Any, args: list[str]) -> list[str]:
        """What is no command of the group is what `plan` takes."""
        own = {*self.commands, *self.get_help_option_names(context)}
        return super().parse_args(context, args if not args or args[0] in own else [PLAN, *args])


day = typer.Typer(cls=FileFirst, no_args_is_help=True)


@day.callback()
def about() -> None:
    """Several fields and fleets on one day: who works which, in what order, and how sure that is.

    Fields, windows, values, fleets, roads, light and rain are in one file: headland day new day.toml writes an example.

    Example: headland day day.toml --html day.html
    """


@day.command(PLAN)
def plan(
    file: Annotated[str, typer.Argument(help="A day file (headland day new).")],
    farm: Annotated[
        Optional[str],  # noqa: UP045 - typer reads this at run time
        typer.Option("--farm", help="A farm file instead of the one that the day file names."),
    ] = None,
    rain: Annotated[Optional[str], typer.Option(help="When it begins to rain, instead of the file's.")] = None,  # noqa: UP045
    certainty: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(help="Plan by times that so many percent of the draws keep (50 to 99), not by means."),
    ] = None,
    html: Annotated[Optional[Path], typer.Option(help="Write one page with pictures and tables.")] = None,  # noqa: UP045
    png: Annotated[Optional[Path], typer.Option(help="Write the work of machines and fields over time.")] = None,  # noqa: UP045
    map: Annotated[Optional[Path], typer.Option("--map", help="Write the map of fields and roads, PNG.")] = None,  # noqa: UP045
    json: AsJson = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV, a row per field, instead of the tables.")] = False,
    draws: Annotated[int, typer.Option(help="Draws of what varies.")] = 10_000,
    seed: Annotated[int, typer.Option(help="Seed; the same seed gives the same bytes.")] = 1,
    cache: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--cache", help="Folder for simulated field times; it may be deleted at any time."),
    ] = None,
    processes: Annotated[Optional[int], typer.Option(help="Processes to use; by default one per core.")] = None,  # noqa: UP045
) -> None:
    """Simulate every fleet on every field it fits, and give the fields to the fleets in the best order.

    Example: headland day plan day.toml --html day.html. The word plan may be left out.
    """
    from planner.commands.outputs import check_outputs, written
    from planner.commands.show import remark
    from planner.day import prepare_day
    from planner.errors import ScenarioError
    from planner.scenario import MOST_DRAWS

    if json and csv:
        raise ScenarioError("--json and --csv both print to standard output; choose one.")
    if processes is not None and processes < 1:
        raise ScenarioError(f"--processes is {processes}; use 1 or more.")
    if not 1 <= draws <= MOST_DRAWS:
        raise ScenarioError(f"--draws is {draws}; use 1 to {MOST_DRAWS}.")
    if cache is not None and cache.exists() and not cache.is_dir():
        raise ScenarioError(f"--cache {cache} is a file; give the name of a folder.")
    if certainty is not None and not 50.0 <= certainty <= 99.0:
        raise ScenarioError(f"--certainty is {certainty:g}; use 50 to 99 percent.")
    asked, own = _asked(file, farm, rain, certainty)
    check_outputs((html, ".html"), (png, ".png"), (map, ".png"), reads=_reads(file, asked, own))
    ready = prepare_day(asked, own)
    remark(f"{one.name}: {text}" for one in ready.fields for text in one.remarks)
    result = _planned(ready, cache, draws, seed, processes)
    with written(_results(result, html, png, map)):
        _print(result, json, csv)
    if not result.jobs:
        typer.echo(f"No field can be done; the closest is {result.closest}.", err=True)
        raise typer.Exit(NOTHING_DONE_STATUS)


@day.command()
def new(
    file: Annotated[Path, typer.Argument(help="The file to write, such as day.toml.")],
    force: Annotated[bool, typer.Option("--force", help="Write over a file that is there.")] = False,
) -> None:
    """Write an example of a day file, to be changed to what there is to do.

    Example: headland day new day.toml
    """
    from planner.commands.outputs import check_outputs, spare, written
    from planner.day.file import example_text

    check_outputs((file, ".toml"))
    spare(file, force)
    with written([(file, example_text())]):
        typer.echo(f"An example was written to {file}. Change it; headland day {file} plans the day.")


@day.command()
def example() -> None:
    """Print the example of a day file.

    Example: headland day example > day.toml
    """
    from planner.day.file import example_text

    typer.echo(example_text(), nl=False)


def _asked(
    file: str, farm: str | None, rain: str | None, certainty: float | None
) -> tuple[DayFile, FarmFile]:
    """The day and its farm, with what was given on the command line."""
    from planner.day import load_day

    return load_day(file, farm=farm, rain=rain, certainty_pct=certainty)


def _reads(file: str, asked: DayFile, own: FarmFile) -> dict[str | Path, str]:
    """The files that a day reads, by what they are."""
    from fields.source import field_files
    from planner.day.file import EXAMPLE

    files: dict[str | Path, str] = {file: "the day file"}
    for each in asked.fields:
        files |= dict.fromkeys(field_files(each.file), "a field of the day")
    files |= {each.file: "a tractor file of the farm" for each in own.tractors if each.file is not None}
    if asked.farm not in (None, EXAMPLE):
        files[str(asked.farm)] = "the farm file"
    if asked.rain is not None and asked.rain.lower().endswith(".csv"):
        files[asked.rain] = "the file of rain"
    return files


def _planned(ready: Ready, cache: Path | None, draws: int, seed: int, processes: int | None) -> DayResult:
    from planner.commands.show import progress_bar, warm_up
    from planner.day import plan_day
    from planner.day.cache import Cache, user_folder
    from planner.pool import local_pool

    store = Cache(user_folder() / "field-times" if cache is None else cache)
    todo = ready.unknown(store)
    if todo:
        warm_up()
    with local_pool(max(todo, 1), processes) as executor, progress_bar("Simulating fields") as progress:
        return plan_day(ready, cache=store, executor=executor, progress=progress, draws=draws, seed=seed)


def _print(result: DayResult, json: bool, csv: bool) -> None:
    if json or csv:
        from reports.day_export import day_csv, day_json

        typer.echo(day_json(result) if json else day_csv(result), nl=False)
        return
    from planner.commands.show import out
    from reports.day_table import day_table

    out(day_table(result))


def _results(
    result: DayResult, html: Path | None, png: Path | None, drawn: Path | None
) -> list[tuple[Path, Content]]:
    """Pages and pictures that were asked for."""
    from reports.figures import png_bytes

    results: list[tuple[Path, Content]] = []
    if html:
        from reports.day_page import day_page

        results.append((html, day_page(result)))
    if png:
        from reports.day_figures import gantt_figure

        results.append((png, png_bytes(gantt_figure(result))))
    if drawn:
        from reports.day_figures import map_figure

        figure = map_figure(result)
        if figure is None:
            typer.echo("Fewer than two places are known, so there is no map; give lon and lat.", err=True)
        else:
            results.append((drawn, png_bytes(figure)))
    return results
