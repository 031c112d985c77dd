"""`headland tractor`: a tractor file from a datasheet, and whether a file holds together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.commands.options import AsJson, FarmOption, Html, Png

if TYPE_CHECKING:
    from vehicle.datasheet import Datasheet
    from vehicle.tractor import Tractor
    from vehicle.trials.sheets.sheet import Sheet

tractor = typer.Typer(
    help="Own tractors: make a file from a datasheet, check a file.\n\nExample: headland tractor check my.toml",
    no_args_is_help=True,
)
Metres = Optional[float]  # noqa: UP045 - typer reads this at run time
Force = Annotated[bool, typer.Option("--force", help="Write over a file that is there.")]
BANNER = "# Made by `headland tractor new`: [source] says what was given and what was assumed, by which rule.\n"


@tractor.callback()
def about() -> None:
    """Own tractors: make a file from a datasheet, check a file."""


@tractor.command()
def new(
    file: Annotated[Path, typer.Argument(help="The file to write, such as my.toml.")],
    name: Annotated[Optional[str], typer.Option(help="What the tractor is called.")] = None,  # noqa: UP045
    wheelbase: Annotated[Metres, typer.Option(help="Between the axles, metres.")] = None,
    width: Annotated[Metres, typer.Option(help="Over all, metres.")] = None,
    turning_radius: Annotated[Metres, typer.Option(help="At full lock on asphalt, metres; half the circle.")] = None,
    radius_of: Annotated[
        str, typer.Option(help="What the turning radius is of: centre, or outer-wheel as in ISO 789-3.")
    ] = "centre",
    mass: Annotated[Metres, typer.Option("--mass", help="Ready to work, kg.")] = None,
    power_kw: Annotated[Metres, typer.Option(help="Power, kW; gives the mass where that is not known.")] = None,
    length: Annotated[Metres, typer.Option(help="Over all, metres.")] = None,
    track: Annotated[Metres, typer.Option(help="Between the wheels of an axle, metres.")] = None,
    rear_overhang: Annotated[Metres, typer.Option(help="Behind the rear axle, metres.")] = None,
    max_steering: Annotated[Metres, typer.Option(help="Wheel angle at full lock, degrees.")] = None,
    steering_rate: Annotated[Metres, typer.Option(help="How fast the wheels turn over, degrees per s.")] = None,
    front_share: Annotated[Metres, typer.Option(help="Share of the weight on the front axle, 0 to 1.")] = None,
    antenna_forward: Annotated[Metres, typer.Option(help="Antenna ahead of the rear axle, metres.")] = None,
    force: Force = False,
) -> None:
    """Write a tractor file from what a datasheet says; what is missing is asked for, the rest follows from rules.

    Example: headland tractor new my.toml --name "Fendt 724" --wheelbase 2.78 --width 2.55 --turning-radius 5.5
    """
    from planner.commands.outputs import check_outputs, spare, written
    from planner.commands.show import out, remark
    from reports.trials import trials_table
    from vehicle.datasheet import remarks, tractor_from
    from vehicle.measured.answer.save import tractor_toml

    check_outputs((file, ".toml"))
    spare(file, force)
    given: dict[str, float | str | None] = {
        "wheelbase_m": wheelbase, "width_m": width, "turning_radius_m": turning_radius, "mass_kg": mass,
        "power_kw": power_kw, "length_m": length, "track_m": track, "rear_overhang_m": rear_overhang,
        "max_steering_deg": max_steering, "steering_rate_deg_per_s": steering_rate, "front_share": front_share,
        "antenna_forward_m": antenna_forward, "radius_of": radius_of,
    }  # fmt: skip
    called, sheet = _asked(name, given)
    remark(remarks(sheet))
    made = tractor_from(called, sheet)
    with written([(file, BANNER + tractor_toml(made))]):
        out(trials_table((_overview(made, file),)))


@tractor.command()
def check(
    file: Annotated[str, typer.Argument(help="A tractor file, one that comes with Headland, or with --farm its name.")],
    farm: FarmOption = None,
    html: Html = None,
    png: Png = None,
    json: AsJson = False,
) -> None:
    """Drive circles, a straight track, a change of lane and a turn, and show them beside what the file asks for.

    Example: headland tractor check my.toml --html my.html
    """
    from planner.commands.outputs import check_outputs, inputs, written
    from planner.commands.show import out, progress_bar, warm_up
    from planner.commands.validate import pictures
    from planner.farm import load_farm
    from vehicle.tractor import load_tractor
    from vehicle.trials.sheets.proved import proved

    check_outputs((html, ".html"), (png, ".png"), reads=inputs(tractor=file, farm=farm))
    machine = load_tractor(file) if farm is None else load_farm(farm).tractor(file).machine()
    warm_up()
    with progress_bar("Driving the tractor"):
        verdict, sheet = proved(machine)
    with written(pictures((sheet,), html, png)):
        if json:
            from reports.trials import proved_json

            typer.echo(proved_json(verdict), nl=False)
        else:
            from reports.trials import trials_table

            out(trials_table((sheet,)))


def _asked(name: str | None, given: dict[str, float | str | None]) -> tuple[str, Datasheet]:
    """Name and datasheet; on a terminal what is missing is asked for. Raises VehicleError."""
    from planner.commands.asking import ask_missing, may_ask
    from planner.errors import ScenarioError, named
    from vehicle.datasheet import lacking, sheet_from

    missing = lacking(given)
    if (missing or name is None) and may_ask():
        name, missing = ask_missing(name, given), []
    if name is None:
        missing.insert(0, f"{named('name')} (in quotes, for instance \"Fendt 724\")")
        raise ScenarioError(f"A tractor cannot be made without {' and '.join(missing)}; see its datasheet.")
    if not name.strip():
        raise ScenarioError(f"{named('name')} is empty; call the tractor something, for instance \"Fendt 724\".")
    return name.strip(), sheet_from(given)


def _overview(made: Tractor, file: Path) -> Sheet:
    """What was written: how tightly it turns, and every value of its own that was assumed."""
    from vehicle.trials.sheets.sheet import Sheet, TextTable

    own = made.model_dump()
    rows = []
    for key, source in made.source.items():
        value = own.get(key)
        if isinstance(value, float):
            rows.append((f"{key}: {source}", f"{value:g}"))
    asphalt, soil = (made.smallest_radius_m(ground) for ground in ("asphalt", "soil"))
    words = (
        f"Turns on {asphalt:.2f} m on asphalt and {soil:.2f} m on soil, wheels at {made.max_steering_deg:g} degrees.",
        f"headland tractor check {file} drives it; headland plan --tractor {file} plans with it.",
    )
    table = TextTable("Its body; steering, guidance and speed are in the file", ("Value and source", ""), tuple(rows))
    return Sheet("tractor", f"{made.name}: written to {file}", words, (), (), (table,))
