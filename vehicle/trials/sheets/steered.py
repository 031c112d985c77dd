"""One drive with a fixed steering angle on a ground: radius, stability, slips and track."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fields.errors import named
from vehicle.errors import VehicleError
from vehicle.ground import Tyres, tyres_on
from vehicle.tractor import Tractor, load_tractor
from vehicle.trials.design import moved_mass
from vehicle.trials.drive import Trace, drive_steered, with_steering
from vehicle.trials.fixed import step_commands
from vehicle.trials.oversteer import settled_radius, settles
from vehicle.trials.sheets.circles import slip_panel, trajectory_panel
from vehicle.trials.sheets.sheet import Driven, Line, Panel, Sheet

SHORTEST_S, LONGEST_S, FASTEST_KMH = 20.0, 3600.0, 30.0
KEEP = 6
SHOWN_RADII, WIDEST_SHOWN_M = 3.0, 100.0
STRAIGHT_M = 1e6  # a radius beyond this is no circle


@dataclass(frozen=True)
class Request:
    """What to drive. Steering in degrees, positive to the right; `mass_m` moves the centre of mass behind the front
    axle; the tyre values, where given, replace those of the ground.
    """

    steer_deg: float
    ground: str = "asphalt"
    model: str = "nonlinear"
    seconds: float = 60.0
    speed_kmh: float = 5.0
    tractor: str = "eg105"
    steering: str = "none"
    curve: bool = True
    mass_m: float | None = None
    front_slope: float | None = None
    front_limit_deg: float | None = None
    rear_slope: float | None = None
    rear_limit_deg: float | None = None


def drive(request: Request) -> tuple[Driven, Trace]:
    """Drive it: the outcome, and the whole track for pictures.

    Raises VehicleError for what cannot be driven.
    """
    _check(request)
    tractor = _tractor(request)
    commands = step_commands([request.steer_deg], request.seconds)
    track = drive_steered(
        [with_steering(tractor, request.steering)], [_tyres(request)], commands,
        speed_mps=request.speed_kmh / 3.6, keep=KEEP,
    )[0]  # fmt: skip
    radius = settled_radius(track, track.point_m)
    front, rear = (float(np.degrees(slip[-1])) for slip in track.slips())
    circle = math.isfinite(radius) and radius < STRAIGHT_M
    driven = Driven(radius if circle else None, settles(track), front, rear, _rows(track))
    return driven, track


def _check(request: Request) -> None:
    values = {"steer_deg": request.steer_deg, "seconds": request.seconds, "speed_kmh": request.speed_kmh}
    for name, value in values.items():
        if not math.isfinite(value):
            raise VehicleError(f"{named(name)} is {value}; give a number.")
    if not SHORTEST_S <= request.seconds <= LONGEST_S:
        raise VehicleError(f"{named('seconds')} is {request.seconds:g}; use {SHORTEST_S:g} to {LONGEST_S:g}.")
    if not 0 < request.speed_kmh <= FASTEST_KMH:
        raise VehicleError(
            f"{named('speed_kmh')} is {request.speed_kmh:g}; use a speed above 0 and up to {FASTEST_KMH:g}."
        )


def _tractor(request: Request) -> Tractor:
    tractor = load_tractor(request.tractor)
    return tractor if request.mass_m is None else moved_mass(tractor, request.mass_m)


def _tyres(request: Request) -> Tyres:
    """The ground's tyres with the values asked for; the values are checked again."""
    tyres = tyres_on(request.ground, request.model)
    changes = {
        "front_slope_per_deg": request.front_slope,
        "front_limit_deg": request.front_limit_deg,
        "rear_slope_per_deg": request.rear_slope,
        "rear_limit_deg": request.rear_limit_deg,
    }
    given = {name: value for name, value in changes.items() if value is not None}
    for name, value in given.items():
        most = 90.0 if name.endswith("limit_deg") else 10.0
        if not (math.isfinite(value) and 0 < value <= most):
            raise VehicleError(f"{named(name)} is {value:g}; use a value above 0 and up to {most:g}.")
    if not request.curve:
        given["curve"] = None  # type: ignore[assignment]
    return tyres.model_copy(update=given)


def _rows(track: Trace) -> npt.NDArray[np.float64]:
    place = track.place()
    heading = (90.0 - np.degrees(track.column("angle"))) % 360.0
    return np.column_stack([track.time_s, place, heading, np.degrees(track.column("steering"))])


def sheet(request: Request, driven: Driven, track: Trace) -> Sheet:
    """The drive in words and pictures."""
    seconds = float(track.time_s[-1])
    radius = track.radius()
    shown = np.where(radius < _highest_shown(driven), radius, np.nan)
    panels = (
        trajectory_panel("Track of the centre of mass", {f"{request.steer_deg:g} degrees": track}, seconds),
        slip_panel("Slip angles", track, seconds),
        Panel("Wheel angle", "Time (s)", "Angle (degrees)",
              (Line("wheel angle", track.time_s, np.degrees(track.column("steering")), 0),)),
        Panel("Momentary turning radius", "Time (s)", "Radius (m)", (Line("radius", track.time_s, shown, 0),)),
    )  # fmt: skip
    title = f"{request.steer_deg:g} degrees on {request.ground}, {request.model} tyres, {request.speed_kmh:g} km/h"
    return Sheet("drive", title, (sentence(driven), "Step of the wheels after one second at speed."), (), panels)


def _highest_shown(driven: Driven) -> float:
    """Metres up to which the momentary radius is drawn: a circle fills the picture, not the run before it."""
    return SHOWN_RADII * driven.radius_m if driven.stable and driven.radius_m else WIDEST_SHOWN_M


def sentence(driven: Driven) -> str:
    """The outcome in one sentence."""
    slips = f"slip {driven.slip_front_deg:.2f} degrees at the front axle and {driven.slip_rear_deg:.2f} at the rear"
    if not driven.stable:
        return f"Oversteer: the side-slip does not settle; at the end {slips}."
    if driven.radius_m is None:
        return f"Straight on; {slips}."
    return f"A steady circle of {driven.radius_m:.2f} m radius (antenna); {slips}."
