"""`headland drive`: one drive with a fixed steering angle."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from planner.commands.options import AsJson, Html, Png, TractorOption

Value = Optional[float]  # noqa: UP045 - typer reads this at run time


def drive(
    steer: Annotated[float, typer.Option(help="Steering angle, degrees, positive to the right.")],
    ground: Annotated[str, typer.Option(help="asphalt, soil or mud.")] = "asphalt",
    model: Annotated[str, typer.Option(help="Tyre model: kinematic, linear or nonlinear.")] = "nonlinear",
    seconds: Annotated[float, typer.Option(help="Length of the drive, seconds.")] = 60.0,
    speed_kmh: Annotated[float, typer.Option(help="Speed, km/h.")] = 5.0,
    tractor: TractorOption = "eg105",
    steering: Annotated[str, typer.Option(help="Steering simulator: none, proposed, traditional, unlatched.")] = "none",
    curve: Annotated[bool, typer.Option("--curve/--no-curve", help="The engine's friction curve on the tyres.")] = True,
    mass: Annotated[Value, typer.Option(help="Centre of mass, metres behind the front axle.")] = None,
    front_slope: Annotated[Value, typer.Option(help="Side force of the front tyres per load and degree.")] = None,
    front_limit: Annotated[Value, typer.Option(help="Slip up to which it grows, degrees.")] = None,
    rear_slope: Annotated[Value, typer.Option(help="As --front-slope, rear tyres.")] = None,
    rear_limit: Annotated[Value, typer.Option(help="As --front-limit, rear tyres.")] = None,
    html: Html = None,
    png: Png = None,
    json: AsJson = False,
) -> None:
    """Drive with the wheels at a fixed angle on the tyres of chapter 4: radius, stability, side-slip.

    Example: headland drive --steer 25 --ground mud --model nonlinear --png circle.png
    """
    from planner.commands.outputs import check_outputs, inputs, written
    from planner.commands.show import out, warm_up
    from planner.commands.validate import pictures
    from vehicle.trials.sheets.steered import Request, sentence, sheet
    from vehicle.trials.sheets.steered import drive as run

    check_outputs((html, ".html"), (png, ".png"), reads=inputs(tractor=tractor))
    request = Request(
        steer, ground, model, seconds, speed_kmh, tractor, steering, curve, mass, front_slope, front_limit, rear_slope,
        rear_limit,
    )  # fmt: skip
    warm_up()
    driven, track = run(request)
    sheets = (sheet(request, driven, track),) if html or png else ()
    with written(pictures(sheets, html, png)):
        if json:
            from reports.trials import drive_json

            typer.echo(drive_json(driven), nl=False)
        else:
            out(sentence(driven))
