"""Fixed and changing steering (section 4.3), hypotheses about Table 4.1, and the design studies of section 6.2.

The design studies vary tyres and the position of the centre of mass, at 35 degrees and 5 km/h.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fields.arrays import Flags, Floats
from vehicle.errors import VehicleError
from vehicle.model.ground import ENGINE_CURVE, TYRE_MODELS, FrictionCurve, Tyres, get_tyres
from vehicle.model.tractor import SpeedParameters, Tractor
from vehicle.records import DT_S
from vehicle.trials.drive import (
    Trace,
    compute_settled_radius,
    drive_by_steering_commands,
    is_sideslip_settled,
    replace_steering,
)

ANGLES_DEG = (25.0, 30.0, 35.0)
STRAIGHT_TIME_S, DRIVE_DURATION_S = 1.0, 60.0
MEASURED_AHEAD_M = 0.6  # the point whose circle is measured: it reproduces the kinematic column of Table 4.1
BEST_HYPOTHESIS = "speed sags and friction circle as small as the rear side limit, rolling resistance 0.0204, no curve"
WAVE_PERIOD_S = 20.0  # assumed, as the four periods driven and the steepest angle: Fig. 4.7 is lost
STUDY_LIMITS_DEG = tuple(float(limit) for limit in range(1, 11))
STUDY_SLOPES_PER_DEG = tuple(round(0.001 * step, 3) for step in range(1, 21))
STUDY_STEERING_DEG = ANGLES_DEG[-1]
STUDY_DURATION_S, STUDY_RECORD_EVERY = 40.0, 6
AXLES = ("front", "rear")
MIN_AXLE_DISTANCE_M = 0.7  # the centre of mass stays this far from either axle


@dataclass(frozen=True, eq=False)
class FixedSteeringDrive:
    """A drive with the steering stepped to an angle; the radius is nan if it does not settle."""

    model: str
    steering_deg: float
    radius_m: float
    stable: bool
    trace: Trace


def build_step_commands(angles_deg: Sequence[float], seconds: float = DRIVE_DURATION_S) -> Floats:
    """Straight for a second, then one angle per tractor: (steps, n)."""
    commands = np.tile(np.asarray(angles_deg, dtype=np.float64), (round(seconds / DT_S), 1))
    commands[: round(STRAIGHT_TIME_S / DT_S)] = 0.0
    return commands


def drive_fixed_steering(
    tractor: Tractor,
    tyres: Tyres,
    angles_deg: Sequence[float] = ANGLES_DEG,
    *,
    model: str = "",
    seconds: float = DRIVE_DURATION_S,
    ahead_m: float = MEASURED_AHEAD_M,
) -> tuple[FixedSteeringDrive, ...]:
    """One drive per angle, with the step applied to the wheels at once as in Fig. 4.4."""
    commands, count = build_step_commands(angles_deg, seconds), len(angles_deg)
    direct = [replace_steering(tractor, "none")] * count
    traces = drive_by_steering_commands(direct, [tyres] * count, commands)
    return tuple(
        FixedSteeringDrive(model, angle, compute_settled_radius(trace, ahead_m), is_sideslip_settled(trace), trace)
        for angle, trace in zip(angles_deg, traces, strict=True)
    )


def drive_table_4_1(tractor: Tractor, curve: FrictionCurve | None = ENGINE_CURVE) -> tuple[FixedSteeringDrive, ...]:
    """The nine drives of Table 4.1 on the tyres of section 4.3."""
    return _drive_table({model: (tractor, get_tyres("soil", model, curve=curve)) for model in TYRE_MODELS})


def _drive_table(settings: Mapping[str, tuple[Tractor, Tyres]]) -> tuple[FixedSteeringDrive, ...]:
    """The drives of Table 4.1 by tyre model, each with a tractor and tyres of its own."""
    return tuple(drive for model, setting in settings.items() for drive in drive_fixed_steering(*setting, model=model))


def drive_changing_steering(tractor: Tractor) -> dict[str, Trace]:
    """Section 4.3.2: one drive per model, with a sine of the steering applied to the wheels at once."""
    time = DT_S * np.arange(round(4.0 * WAVE_PERIOD_S / DT_S))
    commands = np.tile(ANGLES_DEG[-1] * np.sin(2.0 * math.pi * time / WAVE_PERIOD_S)[:, None], (1, len(TYRE_MODELS)))
    direct = [replace_steering(tractor, "none")] * len(TYRE_MODELS)
    traces = drive_by_steering_commands(direct, [get_tyres("soil", model) for model in TYRE_MODELS], commands)
    return dict(zip(TYRE_MODELS, traces, strict=True))


def build_best_hypothesis(tractor: Tractor, model: str = "nonlinear") -> tuple[Tractor, Tyres]:
    """BEST_HYPOTHESIS: a tractor whose speed sags in turns, and tyres without the engine's curve, whose side force and
    drive force at the rear share the limit of the side force.

    Two numbers are fitted (950 N s/m, 0.0204) to the three of the non-linear column; the other models have no limit.
    """
    weak = SpeedParameters(proportional_n_s_per_m=950.0, integral_n_per_m=0.0, derivative_n_s2_per_m=0.0)
    tyres = get_tyres("soil", model, curve=None).model_copy(update={"rolling_resistance": 0.0204, "grip": None})
    limited = add_friction_circle(tyres) if model == "nonlinear" else tyres
    return tractor.model_copy(update={"speed": weak}), limited


def add_friction_circle(tyres: Tyres) -> Tyres:
    """The tyres with a friction circle as small as the side limit of the rear ones."""
    return tyres.model_copy(update={"grip": tyres.rear_slope_per_deg * tyres.rear_limit_deg})


def drive_best_hypothesis_table(tractor: Tractor) -> tuple[FixedSteeringDrive, ...]:
    """The nine drives of Table 4.1 under BEST_HYPOTHESIS."""
    return _drive_table({model: build_best_hypothesis(tractor, model) for model in TYRE_MODELS})


def try_hypotheses(tractor: Tractor) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """All hypotheses about the non-linear column of Table 4.1, one change at a time: words, and the radii (m) that each
    gives at ANGLES_DEG (nan: oversteer)."""
    soil = get_tyres("soil", "nonlinear")
    bare = soil.model_copy(update={"grip": None})
    plain = bare.model_copy(update={"curve": None, "grip": 100.0})
    limit = soil.rear_slope_per_deg * soil.rear_limit_deg
    sagging, closest = build_best_hypothesis(tractor)
    nose_heavy = tractor.model_copy(update={"front_axle_m": 1.1, "rear_axle_m": 1.3})
    exchanged = {
        "front_slope_per_deg": soil.rear_slope_per_deg,
        "front_limit_deg": soil.rear_limit_deg,
        "rear_slope_per_deg": soil.front_slope_per_deg,
        "rear_limit_deg": soil.front_limit_deg,
    }

    def change_tyres(tyres: Tyres, **changes: Any) -> Tyres:
        return tyres.model_copy(update=changes)

    trials = [
        ("Eq. 4.3 and 4.4 alone: force = k min(slip, limit) x load", tractor, plain),
        ("times the engine's curve, slip in radians", tractor, bare),
        ("as above and a friction circle with the drive force (the setting used)", tractor, soil),
        ("curve read at slips in degrees, so beyond its end everywhere", tractor,
         change_tyres(bare, curve=FrictionCurve(peak_slip_rad=0.2 / 57.3, slide_slip_rad=0.5 / 57.3))),
        ("curve without the fall beyond its peak", tractor, change_tyres(bare, curve=FrictionCurve(slide=1.0))),
        ("curve read at slips eased by 1 m/s, as in the engine's own tyre model", tractor,
         change_tyres(bare, curve=FrictionCurve(ease_mps=1.0))),
        ("centre of mass closer to the front axle (1.1 m and 1.3 m), with curve", nose_heavy, bare),
        ("front and rear tyres exchanged, no curve", tractor, change_tyres(plain, **exchanged)),
        ("front and rear tyres exchanged, with curve", tractor, change_tyres(bare, **exchanged)),
        ("speed sags in the turn (proportional control, 950 N s/m), with curve", sagging, bare),
        ("speed sags, no curve", sagging, plain),
        ("friction circle as small as the rear side limit, rolling resistance 0.019, no curve", tractor,
         change_tyres(plain, grip=limit, rolling_resistance=0.019)),
        (BEST_HYPOTHESIS, sagging, closest),
        ("the same with the curve", sagging, change_tyres(closest, curve=ENGINE_CURVE)),
    ]  # fmt: skip
    return tuple(
        (words, tuple(drive.radius_m for drive in drive_fixed_steering(variant, tyres)))
        for words, variant, tyres in trials
    )


@dataclass(frozen=True, eq=False)
class RadiusMap:
    """Radius (m) of the centre of mass per row and column of a design study; nan is oversteer.

    `rows` and `columns` are slopes per degree and limits (degrees) of the tyres of one axle, or steering angles
    (degrees) and distances (m) of the centre of mass behind the front axle. `traces` are the drives in the order of the
    cells.
    """

    rows: tuple[float, ...]
    columns: tuple[float, ...]
    radius_m: Floats
    traces: tuple[Trace, ...]

    @property
    def stable(self) -> Flags:
        """Whether the tractor settles, per cell."""
        return np.isfinite(self.radius_m)


def compute_tyre_maps(
    tractor: Tractor, *, tyres: Tyres | None = None, shared_limit: bool = False
) -> tuple[RadiusMap, RadiusMap]:
    """Vary the front tyres with the rear tyres of section 4.3, and vice versa: 400 drives in one call.

    `tyres` are the tyres to vary; with `shared_limit` drive and side force of the rear tyres share the side limit.
    """
    base = tyres or get_tyres("soil", "nonlinear")
    grid = [(slope, limit) for slope in STUDY_SLOPES_PER_DEG for limit in STUDY_LIMITS_DEG]
    cells = [
        base.model_copy(update={f"{axle}_slope_per_deg": slope, f"{axle}_limit_deg": limit})
        for axle in AXLES
        for slope, limit in grid
    ]
    if shared_limit:
        cells = [add_friction_circle(cell) for cell in cells]
    angles = [STUDY_STEERING_DEG] * len(cells)
    front, rear = _drive_maps(STUDY_SLOPES_PER_DEG, STUDY_LIMITS_DEG, [tractor] * len(cells), cells, angles)
    return front, rear


def sweep_centre_of_mass(tractor: Tractor, *, tyres: Tyres | None = None) -> RadiusMap:
    """Move the centre of mass from near the front axle to near the rear axle."""
    base = tractor.wheelbase_m
    places = tuple(float(place) for place in np.linspace(MIN_AXLE_DISTANCE_M, base - MIN_AXLE_DISTANCE_M, 11))
    variants = [move_centre_of_mass(tractor, place) for place in places]
    tractors = variants * len(ANGLES_DEG)
    angles = [angle for angle in ANGLES_DEG for _ in places]
    chosen = [tyres or get_tyres("soil", "nonlinear")] * len(tractors)
    return _drive_maps(ANGLES_DEG, places, tractors, chosen, angles)[0]


def move_centre_of_mass(tractor: Tractor, front_axle_m: float) -> Tractor:
    """The tractor with its centre of mass `front_axle_m` behind the front axle; VehicleError outside the wheelbase."""
    base = tractor.wheelbase_m
    if not 1e-6 < front_axle_m < base - 1e-6:
        raise VehicleError(
            f"A centre of mass {front_axle_m:g} m behind the front axle is outside the wheelbase of {base:g} m; "
            f"use a value between 0 and {base:g}."
        )
    changes = {"front_axle_m": front_axle_m, "rear_axle_m": base - front_axle_m}
    return tractor.model_copy(update=changes)


def _drive_maps(
    rows: tuple[float, ...],
    columns: tuple[float, ...],
    tractors: Sequence[Tractor],
    tyres: Sequence[Tyres],
    angles_deg: Sequence[float],
) -> list[RadiusMap]:
    """Maps of drives of the design studies, each with the wheels stepped to one angle, cell by cell."""
    direct = {id(tractor): replace_steering(tractor, "none") for tractor in tractors}
    commands = build_step_commands(angles_deg, STUDY_DURATION_S)
    traces = drive_by_steering_commands(
        [direct[id(tractor)] for tractor in tractors], tyres, commands, record_every=STUDY_RECORD_EVERY
    )
    radii_m = np.array([compute_settled_radius(track, 0.0) for track in traces])
    size = len(rows) * len(columns)
    return [
        RadiusMap(rows, columns, cells.reshape(len(rows), len(columns)), tuple(traces[k * size : (k + 1) * size]))
        for k, cells in enumerate(radii_m.reshape(-1, size))
    ]
