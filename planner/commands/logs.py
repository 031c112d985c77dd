"""`headland logs`: work that was driven, from the files of terminals to log files and figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.options import AsJson

if TYPE_CHECKING:
    from planner.works.importing import Imported

logs = typer.Typer(
    help="Work that was driven: ISOXML time logs (TASKDATA), point Shapefiles, AgOpenGPS paths and CSV files become "
    "log files and figures.\n\nExample: headland logs import TASKDATA -o runs",
    no_args_is_help=True,
)


@logs.callback()
def about() -> None:
    """Work that was driven."""


@logs.command("import")
def import_(
    files: Annotated[list[str], typer.Argument(help="Folders, zips or files with logs, as they come on the stick.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder for the runs; made where there is none.")],
    mapping: Annotated[
        Optional[str],  # noqa: UP045 - typer reads this at run time
        typer.Option(help="A TOML file that says which columns of a CSV file hold what ([columns] time = ...)."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over runs of the same name.")] = False,
    json: AsJson = False,
) -> None:
    """Turn logs of terminals into log files (CSV) with position, course, speed and work state, and a table of runs.

    The form is recognised: ISOXML time logs in a TASKDATA folder or zip, Shapefiles of points (John Deere export),
    AgOpenGPS folders with recorded paths, CSV files. A log that is cut off is read as far as it is whole. Beside every
    log stands a JSON file with its field, width, counters and figures. `headland compare` and `headland learn` take
    the folder.

    A mapping for CSV files is a TOML file: under [columns] time, longitude, latitude, and where there are any speed_kmh
    or speed_mps and works, each with the name of a column in quotes; under [values] width_m and field.

    Example: headland logs import TASKDATA -o runs
    """
    from planner.commands.show import progress_bar, remark
    from planner.works.importing import imported

    with progress_bar("Reading logs") as progress:
        found = imported(files, mapping, progress)
    remark(found.notes)
    _write(found, out, force)
    if json:
        from reports.work_table import runs_json

        typer.echo(runs_json(found.runs, found.notes), nl=False)
        return
    from planner.commands.show import out as show
    from reports.fitting import sentence
    from reports.work_table import runs_table

    show(runs_table(found.runs))
    show(sentence(f"Written to {out}: {len(found.runs)} x log (CSV) and what is known of it (JSON)."))


def _write(found: Imported, out: Path, force: bool) -> None:
    from planner.commands.outputs import check_outputs, folder_for, spare, write_results

    places = {out / name: text for name, text in found.files.items()}
    for place in places:
        spare(place, force)
    with folder_for(out):
        check_outputs(*((place, "") for place in places))
        write_results(list(places.items()))


@logs.command()
def example(
    plan: Annotated[Path, typer.Argument(help="A plan written by headland plan --save.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to make, such as TASKDATA.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the stops.")] = 1,
) -> None:
    """Write ISOXML time logs as a terminal would have logged them of a saved plan, to try imports without a machine.

    The tractors drive 10 % slower than planned and stop now and then; what was put in is printed.

    Example: headland logs example plan.json -o TASKDATA
    """
    from planner.commands.outputs import check_outputs, folder_for, spare, write_results
    from planner.commands.show import out as show
    from planner.commands.show import progress_bar, warm_up
    from planner.works.example import PACE
    from planner.works.example import example as made
    from reports.fitting import sentence

    for name in ("TASKDATA.XML", "TLG00001.xml", "TLG00001.bin"):
        spare(out / name, False)
    warm_up()
    with progress_bar("Driving the plan again"):
        found = made(plan, seed)
    with folder_for(out):
        check_outputs(*((out / name, "") for name in found.files), reads={plan: "the plan"})
        write_results([(out / name, content) for name, content in found.files.items()])
    pace = f"driven at {100 * PACE:.0f} % of the plan's speed"
    show(sentence(f"Written to {out}: {len(found.truths)} x time log, {pace}."))
    for number, truth in enumerate(found.truths, start=1):
        stops = ", ".join(f"{seconds:.0f} s" for seconds in truth.stops_s)
        show(sentence(f"Tractor {number}: {truth.time_s[-1] / 60.0:.1f} min; stops put in: {stops or 'none'}."))
