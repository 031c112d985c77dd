"""Options that several commands share, and what the parameters of the library are called among them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.parameters import OF_REQUEST, word_of

if TYPE_CHECKING:
    from planner.asked import Asked
    from planner.scenario import Scenario

FieldArgument = Annotated[
    str,
    typer.Argument(
        help="A field file (GeoJSON, Shapefile, KML, GeoPackage, GPX, ISOXML, AgOpenGPS; file#ID picks one of several "
        "parcels) or a sample: iwamizawa, denmark, netherlands, sweden."
    ),
]
FieldsArgument = Annotated[
    Optional[list[str]],  # noqa: UP045 - typer reads this at run time
    typer.Argument(
        help="Field files (GeoJSON, Shapefile, KML, GeoPackage, GPX, ISOXML, AgOpenGPS; file#ID picks one of several "
        "parcels, #* all of them) or samples: iwamizawa, denmark, netherlands, sweden.",
        show_default="iwamizawa",
    ),
]
Local = Annotated[bool, typer.Option("--local", help="The file holds local metres, not longitude and latitude.")]
Crs = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option("--crs", help="Coordinate system of a file that names none, such as EPSG:25832."),
]
Swap = Annotated[bool, typer.Option("--swap", help="The file has latitude or northing first: exchange the two.")]
Along = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option("--along", help="Lay the tracks along this guidance line of the file, by its name."),
]
Width = Annotated[float, typer.Option("--width", help="Working width of the implement, metres.")]
Widths = Annotated[
    str, typer.Option("--width", help="Working width of the implement, metres; 3,6 plans with both in one table.")
]
Headland = Annotated[
    Optional[float],  # noqa: UP045 - typer reads this at run time
    typer.Option("--headland", help="Headland depth, metres. By default sized from the turn that must fit."),
]
Bearing = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option("--bearing", help="Direction of the tracks, degrees clockwise from north. By default the best one."),
]
CellBearing = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option("--cell-bearing", help="Direction of the tracks in one cell: 2=45; for every such cell."),
]
Margin = Annotated[float, typer.Option("--margin", help="Distance kept to obstacles, holes and fences, metres.")]
Entrance = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option(
        "--entrance", help="Where the tractors come in: LON,LAT, or x,y with --local. By default that of the file."
    ),
]
TractorOption = Annotated[
    str, typer.Option("--tractor", help="A tractor that comes with Headland (eg105, mr1000a) or a TOML file.")
]
FarmOption = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option("--farm", help="A farm file (headland farm new): tractors, implements, prices. Options win over it."),
]
ImplementOption = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option("--implement", help="The implement of the farm file, by name; by default the first that fits."),
]
Html = Annotated[Optional[Path], typer.Option(help="Write a page with pictures.")]  # noqa: UP045
Png = Annotated[Optional[Path], typer.Option(help="Write the pictures.")]  # noqa: UP045
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of the table.")]


Operation = Annotated[
    str, typer.Option(help="till, sow, spray, harvest or mow: says whether the headland comes first or last.")
]
HeadlandFirst = Annotated[bool, typer.Option("--headland-first", help="Work the headland before the tracks.")]
HeadlandLast = Annotated[bool, typer.Option("--headland-last", help="Work the headland after the tracks.")]
Corners = Annotated[str, typer.Option(help="Corners of the headland: square (worked whole, backing up) or round.")]
TracksOnly = Annotated[
    bool,
    typer.Option("--tracks-only/--rounds", help="Leave the headland as room for turning, or work it in rounds too."),
]


_OPTIONS = {
    "field": "the field", "headland_order": "--headland-first or --headland-last",
    "list_fields": word_of("list_fields"),
}  # fmt: skip


def with_farm(scenario: Scenario, farm: str | None, implement: str | None, context: typer.Context) -> Asked:
    """The scenario with what a farm file has for it; options that were given win."""
    from planner.asked import as_it_is, asked
    from planner.errors import ScenarioError
    from planner.farm import load_farm

    if farm is not None:
        return asked(scenario, load_farm(farm), _given(context), implement=implement)
    if implement is not None:
        raise ScenarioError(f"--implement {implement!r} is one of a farm file; add --farm FILE or leave it out.")
    return as_it_is(scenario)


def shift_start(farm: str | None) -> int | None:
    """When the shift of a farm file begins, in seconds of the day; a deadline counts from it. None without one."""
    if farm is None:
        return None
    from planner.farm import load_farm

    return load_farm(farm).times.shift_s[0]


def _given(context: typer.Context) -> frozenset[str]:
    """Parameters of a scenario, of those a farm file may set, whose options were given."""
    sources = {option: context.get_parameter_source(option) for option in OF_REQUEST}
    return frozenset(OF_REQUEST[option] for option, source in sources.items() if source and source.name != "DEFAULT")


def option_of(parameter: str) -> str:
    """What a parameter of a program is called on the command line: width_m is --width, speed_mps is --speed-kmh."""
    return _OPTIONS.get(parameter) or "--" + word_of(parameter).replace("_", "-")
