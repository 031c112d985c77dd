"""`headland export`: the lines of a saved plan for terminals and maps."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.options import AsJson

if TYPE_CHECKING:
    from reports.guidance.forms import Written

ZIP, TASKDATA = ".zip", "TASKDATA"
TO = "isoxml4, isoxml3, agopengps, kml, shapefile, geojson or gpx."
OUT = "File or folder to write (that of a stick, too), or a .zip; by default named after the plan."
CURVES = (
    "Write curves, or straight lines alone, as some terminals refuse curves: those of few straight stretches are cut "
    "into these, others left out. By default ISOXML has straight lines alone, and all else curves."
)


def export(
    plan: Annotated[Path, typer.Argument(help="A plan written by headland plan --save.")],
    to: Annotated[str, typer.Option("--to", help=TO)],
    output: Annotated[Optional[Path], typer.Option("--out", "-o", help=OUT)] = None,  # noqa: UP045
    tractor: Annotated[Optional[int], typer.Option(help="Write this tractor alone, counted from 1.")] = None,  # noqa: UP045
    curves: Annotated[Optional[bool], typer.Option("--curves/--straight", help=CURVES)] = None,  # noqa: UP045
    force: Annotated[bool, typer.Option("--force", help="Write over files that are there.")] = False,
    json: AsJson = False,
) -> None:
    """Write boundary, headland and lines of a saved plan, by tractor in driving order, for terminals and maps.

    Example: headland export plan.json --to isoxml4 --out TASKDATA.zip

    For a stick: headland export plan.json --to isoxml4 --out /media/stick, which makes TASKDATA/TASKDATA.XML on it.
    """
    from fields.reading import read_text
    from planner.commands.outputs import check_outputs, spare, written
    from planner.commands.show import out, remark
    from planner.guidance import form_for, guidance_of
    from reports.guidance.forms import written as write_guidance
    from reports.guidance.told import export_json, export_table, remarks
    from vehicle.errors import MissionError
    from vehicle.plan_file import saved_from_json

    form = form_for(to)
    guidance = guidance_of(saved_from_json(read_text(plan, "a plan of headland plan --save", MissionError)), tractor)
    made = write_guidance(guidance, form, curves)
    target, results = _placed(made, output, plan)
    paths = [path for path, _ in results]
    for path in paths:
        spare(path, force)
    remark(remarks(guidance, made))
    with _folders(target, paths):
        check_outputs(*((path, "") for path in paths), reads={plan: "the plan"})
        with written(results):
            names = [str(path) for path in paths]
            if json:
                typer.echo(export_json(guidance, made, names), nl=False)
            else:
                out(export_table(guidance, made, names))


def _placed(made: Written, output: Path | None, plan: Path) -> tuple[Path, list[tuple[Path, bytes]]]:
    """The file or folder that is written, and the files with their places."""
    from planner.errors import ScenarioError
    from reports.guidance.packing import zipped

    ending = made.form.ending
    if output is not None and output.suffix.lower() == ZIP and not output.is_dir():
        return output, [(output, zipped(made.files))]
    target = output or Path(f"{plan.stem}{ending}" if made.single else f"{plan.stem}-{made.form.name}")
    if made.single:
        place = target / f"{plan.stem}{ending}" if target.is_dir() else target
        if place.suffix.lower() != ending:
            raise ScenarioError(f"{place} does not end in {ending}; name the file {place.with_suffix(ending)}.")
        return place, [(place, content) for content in made.files.values()]
    if target.exists() and not target.is_dir():
        raise ScenarioError(f"{target} is a file, and {made.form.words} is a folder here; name another one.")
    if ending and target.suffix.lower() == ending:
        raise ScenarioError(
            f"{target} is one file, and {made.form.words} has one for each of the tractors; name a folder, or add "
            "--tractor N."
        )
    if target.name.upper() == TASKDATA and all(path.startswith(f"{TASKDATA}/") for path in made.files):
        target = target.parent  # what was named is the folder that is made
    return target, [(target.joinpath(*path.split("/")), content) for path, content in made.files.items()]


@contextmanager
def _folders(target: Path, paths: Sequence[Path]) -> Iterator[None]:
    """Make the folders of files in a folder that is written, and that one, but none above it.

    Whatever goes wrong after that, those that are left empty are taken away again.
    """
    from planner.commands.outputs import WriteError
    from planner.errors import ScenarioError

    if not target.parent.is_dir():
        raise ScenarioError(f"{target} cannot be written: the folder {target.parent} does not exist; make it first.")
    inside = {parent for path in paths for parent in path.parents if parent == target or target in parent.parents}
    made: list[Path] = []
    try:
        for folder in sorted(inside, key=lambda one: len(one.parts)):
            if not os.path.lexists(folder):
                folder.mkdir()
                made.append(folder)
        yield
    except BaseException as error:
        for folder in reversed(made):
            with suppress(OSError):
                folder.rmdir()
        if isinstance(error, OSError):
            raise WriteError(
                f"The folder {folder} could not be made: {error.strerror}; choose another place."
            ) from None
        raise
