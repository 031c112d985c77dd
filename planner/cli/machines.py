"""`headland tractor`, `headland farm` (make and check their files) and `headland gnss` (the table of GNSS errors)."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner.cli.common.options import AsJson, FarmOption, ForceOption, Html, Png, add_example_commands, create_group
from planner.cli.common.outputs import check_output_paths, list_input_files, write_before_printing
from planner.cli.common.terminal import (
    AnswerForm,
    create_progress_callback,
    print_remarks,
    print_renderable,
    print_sentence,
    warm_up,
)
from planner.errors import RequestError, mark_parameter
from reports.common.language import mark_text

if TYPE_CHECKING:
    from vehicle.datasheet.sheet import DatasheetQuantity
    from vehicle.model.tractor import Tractor
    from vehicle.trials.sheets.sheet import ExperimentSheet


OptionalNumber = Optional[float]


def can_prompt() -> bool:
    """Whether somebody can answer questions on a terminal."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr is not None and sys.stderr.isatty()


def _prompt_number(quantity: DatasheetQuantity) -> float:
    """Ask until the answer is a possible number."""
    question = f"{quantity.label[0].upper()}{quantity.label[1:]}, {quantity.unit}"
    hint = f"usually {quantity.usual_low:g} to {quantity.usual_high:g}, such as {quantity.usual:g}"
    while True:
        answer = str(typer.prompt(f"{question} ({hint})", err=True))
        try:
            value = float(answer.strip().removesuffix(quantity.unit).strip().replace(",", "."))
        except ValueError:
            print_sentence(f"{answer.strip()!r} is not a number; write for instance {quantity.usual:g}.", err=True)
            continue
        if quantity.low <= value <= quantity.high:
            return value
        typer.echo(f"{value:g} is not possible; use {quantity.low:g} to {quantity.high:g}.", err=True)


gnss = create_group("GNSS errors: make a table from static fixes.\n\nExample: headland gnss fit fixes.csv")


@gnss.command()
def fit(
    fixes: Annotated[Path, typer.Argument(help="CSV of static fixes: x_m, y_m or longitude, latitude.")],
    output: Annotated[
        Optional[Path], typer.Option("--output", "-o", help="Write the table to this file instead of the screen.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Make the table of errors from static fixes of a receiver (section 2.3.1 of the thesis).

    Example: headland gnss fit fixes.csv -o table.csv
    """
    from vehicle.model.gnss import build_error_table, format_error_table, load_static_fixes

    check_output_paths((output, ""), input_files={fixes: "the fixes"}, force=force)
    table = build_error_table(*load_static_fixes(fixes))
    if output is None:
        typer.echo(format_error_table(table), nl=False)
        return
    with write_before_printing((output, format_error_table(table))):
        print_sentence(f"{int(table[-1, 3])} fixes in {len(table)} cells of a millimetre.")


@gnss.command()
def default() -> None:
    """Print the table that comes with Headland: 8000 fixes made for an RTK receiver.

    Example: headland gnss default > table.csv
    """
    from vehicle.model.gnss import format_error_table, load_default_error_table

    typer.echo(format_error_table(load_default_error_table()), nl=False)


tractor = create_group(
    "Tractor files: make one from a datasheet, check one.\n\nExample: headland tractor check my.toml"
)


@tractor.command()
def new(
    file: Annotated[Path, typer.Argument(help="The file to write, such as my.toml.")],
    name: Annotated[Optional[str], typer.Option(help="Name of the tractor.")] = None,
    wheelbase: Annotated[OptionalNumber, typer.Option(help="Distance between the axles, metres.")] = None,
    width: Annotated[OptionalNumber, typer.Option(help="Overall width, metres.")] = None,
    turning_radius: Annotated[
        OptionalNumber, typer.Option(help="Turning radius at full lock on asphalt, metres (half the turning circle).")
    ] = None,
    radius_of: Annotated[
        str,
        typer.Option(
            help="Reference of the turning radius: centre (the antenna; square root of rear axle radius^2 + "
            "antenna-forward^2), or outer-wheel (the outer front wheel) as in ISO 789-3."
        ),
    ] = "centre",
    mass: Annotated[OptionalNumber, typer.Option("--mass", help="Mass ready to work, kg.")] = None,
    power_kw: Annotated[
        OptionalNumber,
        typer.Option(help="Power, kW; plans check pulls by it, and it gives the mass if that is unknown."),
    ] = None,
    length: Annotated[OptionalNumber, typer.Option(help="Overall length, metres.")] = None,
    track: Annotated[OptionalNumber, typer.Option(help="Distance between the wheels of an axle, metres.")] = None,
    rear_overhang: Annotated[OptionalNumber, typer.Option(help="Length behind the rear axle, metres.")] = None,
    max_steering: Annotated[OptionalNumber, typer.Option(help="Wheel angle at full lock, degrees.")] = None,
    steering_rate: Annotated[
        OptionalNumber, typer.Option(help="Steering rate of the wheels, degrees per second.")
    ] = None,
    front_share: Annotated[OptionalNumber, typer.Option(help="Share of the weight on the front axle, 0 to 1.")] = None,
    antenna_forward: Annotated[OptionalNumber, typer.Option(help="Antenna ahead of the rear axle, metres.")] = None,
    force: ForceOption = False,
) -> None:
    """Write a tractor file from a datasheet; asks for missing values, the rest follows from rules.

    Example: headland tractor new my.toml --name "Fendt 724" --wheelbase 2.78 --width 2.55 --turning-radius 5.5
    """
    from reports.trials.report import build_trials_table
    from vehicle.datasheet.build import build_tractor, describe_unusual_values
    from vehicle.datasheet.sheet import build_datasheet
    from vehicle.model.tractor_writer import format_tractor_toml

    check_output_paths((file, ".toml"), force=force)
    values: dict[str, float | str | None] = {
        "wheelbase_m": wheelbase, "width_m": width, "turning_radius_m": turning_radius, "mass_kg": mass,
        "power_kw": power_kw, "length_m": length, "track_m": track, "rear_overhang_m": rear_overhang,
        "max_steering_deg": max_steering, "steering_rate_deg_per_s": steering_rate, "front_share": front_share,
        "antenna_forward_m": antenna_forward, "radius_of": radius_of,
    }  # fmt: skip
    name = _complete_datasheet(name, values)
    sheet = build_datasheet(values)
    print_remarks(describe_unusual_values(sheet))
    machine = build_tractor(name, sheet)
    banner = (
        "# Made by `headland tractor new`: [source] says which values were given, and by which rule others were "
        "assumed.\n"
    )
    with write_before_printing((file, banner + format_tractor_toml(machine))):
        print_renderable(build_trials_table, (_build_overview(machine, file),))
    if sheet.power_kw is None:
        print_remarks([mark_text("Without --power-kw plans cannot check whether this tractor can pull its implement.")])


def _complete_datasheet(name: str | None, values: dict[str, float | str | None]) -> str:
    """The name of a tractor; a person is asked for it and for what `values` lack. Raises RequestError for none."""
    from vehicle.datasheet.sheet import QUANTITIES, REQUIRED_KEYS, list_missing

    missing = list_missing(values)
    if (missing or name is None) and can_prompt():
        missing = []
        try:
            name = str(typer.prompt("Name of the tractor", err=True)) if name is None else name
            for key in REQUIRED_KEYS:
                values[key] = _prompt_number(QUANTITIES[key]) if values[key] is None else values[key]
        except typer.Abort:
            typer.echo(err=True)  # ends the line of the question
            raise KeyboardInterrupt from None
    if name is None:
        missing.insert(0, f'{mark_parameter("name")} (in quotes, for instance "Fendt 724")')
        raise RequestError(f"A tractor cannot be made without {' and '.join(missing)}; see its datasheet.")
    if not name.strip():
        raise RequestError(f'{mark_parameter("name")} is empty; give the tractor a name, for instance "Fendt 724".')
    return name.strip()


@tractor.command()
def check(
    file: Annotated[
        str, typer.Argument(help="A tractor file, a built-in tractor, or with --farm its name in the farm file.")
    ],
    farm: FarmOption = None,
    html: Html = None,
    png: Png = None,
    force: ForceOption = False,
    json: AsJson = False,
) -> None:
    """Drive circles, a straight track, a lane change and a turn, and compare them with the values of the file.

    Example: headland tractor check my.toml --html my.html
    """
    from planner.cli.experiments import print_experiments
    from planner.farm.inventory import load_farm
    from reports.trials.report import format_tractor_check_json
    from vehicle.model.tractor import load_tractor
    from vehicle.trials.sheets.tractor_check import check_tractor

    input_files = list_input_files({"tractor": file, "farm": farm})
    check_output_paths((html, ".html"), (png, ".png"), input_files=input_files, force=force)
    machine = load_tractor(file) if farm is None else load_farm(farm).get_tractor(file).build_tractor()
    warm_up()
    with create_progress_callback("Driving the tractor"):
        verdict, sheet = check_tractor(machine)
    print_experiments((sheet,), html, png, AnswerForm(json), verdict, json=format_tractor_check_json)


def _build_overview(machine: Tractor, file: Path) -> ExperimentSheet:
    """A summary of the file: its turning radius, and every value with its source."""
    from vehicle.trials.sheets.sheet import ExperimentSheet, TextTable
    from vehicle.trials.sheets.tractor_check import describe_radius_reference

    own = machine.model_dump()
    rows = tuple(
        (f"{key}: {source}", f"{own[key]:g}")
        for key, source in machine.source.items()
        if isinstance(own.get(key), float)
    )
    asphalt, soil = (machine.compute_smallest_radius_m(ground) for ground in ("asphalt", "soil"))
    sentences = (
        f"Turning radius {asphalt:.2f} m on asphalt and {soil:.2f} m on soil, at {machine.max_steering_deg:g} degrees.",
        describe_radius_reference(machine),
        f"Test it with headland tractor check {file}; plan with headland plan --tractor {file}.",
    )
    table = TextTable("Dimensions; steering, guidance and speed are in the file", ("Value and source", ""), rows)
    return ExperimentSheet("tractor", machine.name, sentences, (), (), (table,))


farm = create_group("The farm file: tractors, implements, prices, times.\n\nExample: headland farm check farm.toml")


add_example_commands(
    farm,
    "farm",
    lambda file: mark_text(f"This is an example: adapt it, then check it with headland farm check {file}."),
)


@farm.command("check")
def check_farm(
    file: Annotated[str, typer.Argument(help="A farm file.")],
    explain: Annotated[bool, typer.Option("--explain", help="Print every value with its source.")] = False,
    json: AsJson = False,
) -> None:
    """Check a farm file, and show its machines and how much of it is given; the rest are defaults with sources.

    Example: headland farm check farm.toml
    """
    from planner.farm.inventory import load_farm
    from planner.farm.value_sources import build_farm_sheet, format_farm_json
    from reports.trials.report import build_trials_table

    AnswerForm(json).print_answer(
        load_farm(file),
        json=format_farm_json,
        screen=lambda shown: build_trials_table((build_farm_sheet(shown, file, with_values=explain),)),
    )
