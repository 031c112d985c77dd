"""Options that several commands share, and what is checked about them before any work."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Optional

import typer

FieldArgument = Annotated[
    str,
    typer.Argument(
        help="A GeoJSON file (file.geojson#ID picks one of several parcels) or a sample: iwamizawa, denmark, "
        "netherlands, sweden."
    ),
]
Local = Annotated[bool, typer.Option("--local", help="The file holds local metres, not longitude and latitude.")]
Width = Annotated[float, typer.Option("--width", help="Working width of the implement, metres.")]
Headland = Annotated[
    Optional[float],  # noqa: UP045 - typer reads this at run time
    typer.Option("--headland", help="Headland depth, metres. By default sized from the turn that must fit."),
]
Bearing = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option("--bearing", help="Direction of the tracks, degrees clockwise from north. By default the best one."),
]
TractorOption = Annotated[
    str, typer.Option("--tractor", help="A tractor that comes with Headland (eg105, mr1000a) or a TOML file.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of the table.")]


_OPTIONS = {"field": "the field", "counts": "--tractors", "fixes": "--fix"}
_UNITS = ("_mps", "_m", "_s", "_deg", "_per_deg")


def option_of(parameter: str) -> str:
    """What a parameter of a program is called on the command line: width_m is --width, speed_mps is --speed-kmh."""
    if parameter in _OPTIONS:
        return _OPTIONS[parameter]
    stem = parameter.removesuffix("_mps") + "_kmh" if parameter.endswith("_mps") else parameter
    for unit in _UNITS:
        stem = stem.removesuffix(unit)
    return "--" + stem.replace("_", "-")


def check_output(path: Path | None, kind: str = "") -> None:
    """Raise ScenarioError when a result could not be written to `path` later; leaves the file system as it was.

    `kind` is the ending the file must have, as ".png".
    """
    from planner.errors import ScenarioError

    if path is None:
        return
    parent = path.parent
    if path.is_dir():
        raise ScenarioError(f"{path} is a folder; give the name of a file in it.")
    if kind and path.suffix.lower() != kind:
        raise ScenarioError(f"{path} does not end in {kind}; name the file {path.with_suffix(kind).name}.")
    if not parent.is_dir():
        raise ScenarioError(f"{path} cannot be written: the folder {parent} does not exist; make it first.")
    if not os.access(path if path.exists() else parent, os.W_OK):
        raise ScenarioError(f"{path} cannot be written: no permission; choose another place.")
    probe = parent / f".headland-{os.getpid()}"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ScenarioError(f"{path} cannot be written: {error.strerror}; choose another place.") from None


def check_distinct(field: str, *outputs: Path | None) -> None:
    """Raise ScenarioError when two results would go to one file, or a result would replace the field file."""
    check_kept({Path(field.rpartition("#")[0] or field): "the field"}, *outputs)


def check_kept(inputs: Mapping[Path, str], *outputs: Path | None) -> None:
    """Raise ScenarioError when a result would replace an input (path: what it is), or two would go to one file."""
    from planner.errors import ScenarioError

    taken = {path.resolve(): what for path, what in inputs.items()}
    for path in outputs:
        if path is None:
            continue
        if path.resolve() in taken:
            raise ScenarioError(f"{path} would overwrite {taken[path.resolve()]}; choose another file.")
        taken[path.resolve()] = "another result"


def write_text(path: Path, text: str) -> None:
    """Write whole or not at all: an earlier file is replaced only by a complete one."""
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)
