"""Fixed and continuously changing steering (section 4.3), and what was tried for Table 4.1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.circles import CIRCLE_SPEED_MPS
from vehicle.ground import ENGINE_CURVE, MODELS, FrictionCurve, Tyres, tyres_on
from vehicle.layout import DT_S
from vehicle.tractor import SpeedControl, Tractor
from vehicle.trials.drive import Trace, drive_steered, with_steering
from vehicle.trials.oversteer import settled_radius, settles

Array = npt.NDArray[np.float64]
ANGLES_DEG = (25.0, 30.0, 35.0)
STRAIGHT_S, SECONDS = 1.0, 60.0
MEASURED_AHEAD_M = 0.6  # the point whose circle is measured: with it the kinematic column of Table 4.1 comes out
BEST_GUESS = "speed sags and friction circle as small as the rear side limit, rolling resistance 0.0204, no curve"
WAVE_DEG, WAVE_PERIOD_S, WAVE_SECONDS = 35.0, 20.0, 80.0  # assumed: Fig. 4.7 is lost


@dataclass(frozen=True, eq=False)
class Fixed:
    """A drive with the steering stepped to an angle; the radius is nan when it does not settle."""

    model: str
    steering_deg: float
    radius_m: float
    stable: bool
    track: Trace


@dataclass(frozen=True)
class Guess:
    """A hypothesis about Table 4.1 and the radii it gives at ANGLES_DEG for the non-linear model (nan: oversteer)."""

    words: str
    radii_m: tuple[float, ...]


def step_commands(angles_deg: Sequence[float], seconds: float = SECONDS, dt: float = DT_S) -> Array:
    """Straight for a second, then one angle per tractor: (steps, n)."""
    commands = np.tile(np.asarray(angles_deg, dtype=np.float64), (round(seconds / dt), 1))
    commands[: round(STRAIGHT_S / dt)] = 0.0
    return commands


def fixed_steering(
    tractor: Tractor, tyres: Tyres, angles_deg: Sequence[float] = ANGLES_DEG, *, model: str = "",
    speed_mps: float = CIRCLE_SPEED_MPS, seconds: float = SECONDS, ahead_m: float = MEASURED_AHEAD_M,
) -> tuple[Fixed, ...]:  # fmt: skip
    """One drive per angle, the step put on the wheels at once as in Fig. 4.4."""
    direct = with_steering(tractor, "none")
    commands = step_commands(angles_deg, seconds)
    count = len(angles_deg)
    tracks = drive_steered([direct] * count, [tyres] * count, commands, speed_mps=speed_mps)
    return tuple(
        Fixed(model, angle, settled_radius(track, ahead_m), settles(track), track)
        for angle, track in zip(angles_deg, tracks, strict=True)
    )


def table_4_1(tractor: Tractor, curve: FrictionCurve | None = ENGINE_CURVE) -> tuple[Fixed, ...]:
    """The nine drives of Table 4.1 on the tyres of section 4.3."""
    return tuple(
        drive
        for model in MODELS
        for drive in fixed_steering(tractor, tyres_on("soil", model, curve=curve), model=model)
    )


def changing_steering(tractor: Tractor) -> dict[str, Trace]:
    """Section 4.3.2: one drive per model, the steering a sine that is put on the wheels at once."""
    time = DT_S * np.arange(round(WAVE_SECONDS / DT_S))
    commands = np.tile(WAVE_DEG * np.sin(2.0 * math.pi * time / WAVE_PERIOD_S)[:, None], (1, len(MODELS)))
    direct = with_steering(tractor, "none")
    tracks = drive_steered([direct] * len(MODELS), [tyres_on("soil", model) for model in MODELS], commands)
    return dict(zip(MODELS, tracks, strict=True))


def best_guess(tractor: Tractor, model: str = "nonlinear") -> tuple[Tractor, Tyres]:
    """BEST_GUESS: a tractor whose speed sags in turns, and tyres without the engine's curve whose rear ones share
    one limit, that of their side force, between side force and drive.

    Two fitted numbers (950 N s/m, 0.0204) for the three of the non-linear column; the other models have no limit.
    """
    weak = SpeedControl(proportional_n_s_per_m=950.0, integral_n_per_m=0.0, derivative_n_s2_per_m=0.0)
    tyres = tyres_on("soil", model, curve=None).model_copy(update={"rolling_resistance": 0.0204, "grip": None})
    limited = own_limit(tyres) if model == "nonlinear" else tyres
    return tractor.model_copy(update={"speed": weak}), limited


def own_limit(tyres: Tyres) -> Tyres:
    """The tyres with a friction circle as small as the side limit of the rear ones."""
    return tyres.model_copy(update={"grip": tyres.rear_slope_per_deg * tyres.rear_limit_deg})


def closest_table(tractor: Tractor) -> tuple[Fixed, ...]:
    """The nine drives of Table 4.1 under BEST_GUESS."""
    return tuple(drive for model in MODELS for drive in fixed_steering(*best_guess(tractor, model), model=model))


def guesses(tractor: Tractor) -> tuple[Guess, ...]:
    """Everything tried for the non-linear column of Table 4.1, one change at a time."""
    soil = tyres_on("soil", "nonlinear")
    bare = soil.model_copy(update={"grip": None})
    plain = bare.model_copy(update={"curve": None, "grip": 100.0})
    limit = soil.rear_slope_per_deg * soil.rear_limit_deg
    sagging, closest = best_guess(tractor)
    nose = tractor.model_copy(update={"front_axle_m": 1.1, "rear_axle_m": 1.3})
    exchanged = {
        "front_slope_per_deg": soil.rear_slope_per_deg, "front_limit_deg": soil.rear_limit_deg,
        "rear_slope_per_deg": soil.front_slope_per_deg, "rear_limit_deg": soil.front_limit_deg,
    }  # fmt: skip

    def other(tyres: Tyres, **changes: Any) -> Tyres:
        return tyres.model_copy(update=changes)

    tried = [
        ("Eq. 4.3 and 4.4 alone: force = k min(slip, limit) x load", tractor, plain),
        ("times the engine's curve, slip in radians", tractor, bare),
        ("as above and a friction circle with the drive force (the setting used)", tractor, soil),
        ("curve read at slips in degrees, so past its end everywhere", tractor,
         other(bare, curve=FrictionCurve(peak_slip_rad=0.2 / 57.3, slide_slip_rad=0.5 / 57.3))),
        ("curve without the fall behind its peak", tractor, other(bare, curve=FrictionCurve(slide=1.0))),
        ("curve read at slips eased by 1 m/s, as the engine's own tyre model does", tractor,
         other(bare, curve=FrictionCurve(ease_mps=1.0))),
        ("centre of mass nearer the front axle (1.1 m and 1.3 m), curve on", nose, bare),
        ("front and rear tyres exchanged, no curve", tractor, other(plain, **exchanged)),
        ("front and rear tyres exchanged, curve on", tractor, other(bare, **exchanged)),
        ("speed sags in the turn (proportional control, 950 N s/m), curve on", sagging, bare),
        ("speed sags, no curve", sagging, plain),
        ("friction circle as small as the rear side limit, rolling resistance 0.019, no curve", tractor,
         other(plain, grip=limit, rolling_resistance=0.019)),
        (BEST_GUESS, sagging, closest),
        ("the same with the curve on", sagging, other(closest, curve=ENGINE_CURVE)),
    ]  # fmt: skip
    return tuple(
        Guess(words, tuple(drive.radius_m for drive in fixed_steering(who, tyres))) for words, who, tyres in tried
    )
