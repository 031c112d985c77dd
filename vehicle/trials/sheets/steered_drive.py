"""One drive with a fixed steering angle on a ground: radius, stability, slips and path."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fields.errors import mark_parameter
from fields.units import KMH_PER_MPS
from vehicle.errors import VehicleError
from vehicle.model.ground import get_tyres
from vehicle.model.tractor import load_tractor
from vehicle.trials.drive import (
    Trace,
    compute_settled_radius,
    drive_by_steering_commands,
    is_sideslip_settled,
    replace_steering,
)
from vehicle.trials.fixed_steering import STUDY_RECORD_EVERY, build_step_commands, move_centre_of_mass
from vehicle.trials.sheets.fixed_steering import build_slip_panel, build_trajectory_panel
from vehicle.trials.sheets.sheet import ExperimentSheet, PlotLine, SteeredDrive, build_time_panel

MIN_DRIVE_S, MAX_DRIVE_S, MAX_SPEED_KMH = 20.0, 3600.0, 30.0
SHOWN_RADII, WIDEST_SHOWN_M = 3.0, 100.0
MAX_CIRCLE_RADIUS_M = 1e6  # a radius beyond this is no circle


@dataclass(frozen=True)
class SteeredDriveRequest:
    """The request for a steered drive. Steering in degrees, positive to the right; `mass_m` is the distance of the
    centre of mass behind the front axle.
    """

    steer_deg: float
    ground: str = "asphalt"
    model: str = "nonlinear"
    seconds: float = 60.0
    speed_kmh: float = 5.0
    tractor: str = "eg105"
    steering: str = "none"
    mass_m: float | None = None


def run_steered_drive(request: SteeredDriveRequest) -> tuple[SteeredDrive, Trace]:
    """The result of the drive, and the whole trace for plots.

    Raises VehicleError for a request that cannot be driven.
    """
    _check_request(request)
    tractor = load_tractor(request.tractor)
    if request.mass_m is not None:
        tractor = move_centre_of_mass(tractor, request.mass_m)
    tractors, tyres = [replace_steering(tractor, request.steering)], [get_tyres(request.ground, request.model)]
    commands, speed_mps = build_step_commands([request.steer_deg], request.seconds), request.speed_kmh / KMH_PER_MPS
    (trace,) = drive_by_steering_commands(
        tractors, tyres, commands, speed_mps=speed_mps, record_every=STUDY_RECORD_EVERY
    )
    radius = compute_settled_radius(trace, trace.point_m)
    front, rear = (float(np.degrees(slip[-1])) for slip in trace.compute_slips())
    circle = math.isfinite(radius) and radius < MAX_CIRCLE_RADIUS_M
    heading, wheels = (90.0 - np.degrees(trace.get_column("angle"))) % 360.0, np.degrees(trace.get_column("steering"))
    rows = np.column_stack([trace.time_s, trace.compute_path(), heading, wheels])
    return SteeredDrive(radius if circle else None, is_sideslip_settled(trace), front, rear, rows), trace


def _check_request(request: SteeredDriveRequest) -> None:
    values = {"steer_deg": request.steer_deg, "seconds": request.seconds, "speed_kmh": request.speed_kmh}
    for name, value in values.items():
        if not math.isfinite(value):
            raise VehicleError(f"{mark_parameter(name)} is {value}; give a number.")
    if not MIN_DRIVE_S <= request.seconds <= MAX_DRIVE_S:
        raise VehicleError(
            f"{mark_parameter('seconds')} is {request.seconds:g}; use {MIN_DRIVE_S:g} to {MAX_DRIVE_S:g}."
        )
    if not 0 < request.speed_kmh <= MAX_SPEED_KMH:
        raise VehicleError(
            f"{mark_parameter('speed_kmh')} is {request.speed_kmh:g}; use a speed above 0 and up to {MAX_SPEED_KMH:g}."
        )


def build_drive_sheet(request: SteeredDriveRequest, driven: SteeredDrive, trace: Trace) -> ExperimentSheet:
    """The drive in words and plots."""
    seconds = float(trace.time_s[-1])
    radius = trace.compute_radius()
    # Up to so many metres that the circle fills the plot.
    limit_m = SHOWN_RADII * driven.radius_m if driven.stable and driven.radius_m else WIDEST_SHOWN_M
    shown = np.where(radius < limit_m, radius, np.nan)
    wheels = np.degrees(trace.get_column("steering"))
    panels = (
        build_trajectory_panel("Path of the centre of mass", {f"{request.steer_deg:g} degrees": trace}, seconds),
        build_slip_panel("Slip angles", trace, seconds),
        build_time_panel("Wheel angle", "Angle (degrees)", (PlotLine("wheel angle", trace.time_s, wheels, 0),)),
        build_time_panel("Momentary turning radius", "Radius (m)", (PlotLine("radius", trace.time_s, shown, 0),)),
    )
    title = f"{request.steer_deg:g} degrees on {request.ground}, {request.model} tyres, {request.speed_kmh:g} km/h"
    words = describe_drive(driven), "The wheels are stepped after one second at speed."
    return ExperimentSheet("drive", title, words, (), panels)


def describe_drive(driven: SteeredDrive) -> str:
    """The result in one sentence."""
    slips = f"slip {driven.slip_front_deg:.2f} degrees at the front axle and {driven.slip_rear_deg:.2f} at the rear"
    if not driven.stable:
        return f"Oversteer: the side-slip does not settle; at the end {slips}."
    if driven.radius_m is None:
        return f"Straight on; {slips}."
    return f"A steady circle of {driven.radius_m:.2f} m radius (antenna); {slips}."
