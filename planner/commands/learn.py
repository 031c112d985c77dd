"""`headland learn`: what a farm's own logs teach goes into its farm file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from planner.commands.options import AsJson


def learn(
    runs: Annotated[list[Path], typer.Argument(help="The folder of headland logs import, or log files in it.")],
    farm: Annotated[Path, typer.Option(help="The farm file to learn into (headland farm new writes one).")],
    out: Annotated[
        Optional[Path],  # noqa: UP045 - typer reads this at run time
        typer.Option("--out", "-o", help="Write to this file instead, and leave the farm file as it is."),
    ] = None,
    implement: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(help="The implement that the logs are of; by default the one of their width."),
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Replace values that the file gives already.")] = False,
    json: AsJson = False,
) -> None:
    """Take speeds, turn times, stops and the order of the headland from imported runs into the farm file.

    Values that the file gives stay, unless --replace is given or they were learnt before; every other byte stays as it
    is. Each value comes with its 95 % interval and the runs it is from, and plans with --farm use and cite it.

    Example: headland learn runs --farm farm.toml
    """
    from planner.commands.outputs import check_outputs, spare, written
    from planner.commands.show import progress_bar, warm_up
    from planner.farm.file import farm_from
    from planner.works.files import run_files
    from planner.works.learning import learn as learnt
    from reports.work_taught import taught_json, taught_table

    reads: dict[str | Path, str] = {path: f"the log {path}" for path in run_files(runs)}
    if out is not None:
        check_outputs((out, ".toml"), reads=reads | {farm: "the farm file"})
        spare(out, False)
    warm_up()
    with progress_bar("Learning"):
        lesson = learnt(runs, farm, implement, replace)
    place = farm if out is None else out
    if out is not None:
        farm_from(lesson.text, str(out), out.parent)  # files of tractors are looked for beside it
    check_outputs((place, ".toml"), reads=reads)
    with written([(place, lesson.text)]):
        if json:
            typer.echo(taught_json(lesson.taught, lesson.notes), nl=False)
            return
        from planner.commands.show import out as show
        from reports.fitting import sentence

        show(taught_table(lesson.taught, lesson.notes))
        kept = sum(one.done.startswith("kept") for one in lesson.taught)
        more = f"; {kept} kept as they were (--replace takes the learnt ones)" if kept else ""
        show(sentence(f"Written to {place}: {len(lesson.taught) - kept} values{more}."))
