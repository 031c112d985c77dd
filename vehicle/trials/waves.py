"""Zigzag paths: section 3.3 with the corrected base model, section 4.4 with the tyres of chapter 4."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vehicle.circles import CIRCLE_SPEED_MPS
from vehicle.ground import ENGINE_CURVE, FrictionCurve, tyres_on
from vehicle.missions import Mission
from vehicle.tractor import Tractor
from vehicle.trials.deviation import Deviation, deviation, distances
from vehicle.trials.drive import Trace, follow
from vehicle.trials.paths import RUN_OUT_M, wave
from vehicle.trials.setting import CONTROLLED_M, SLIP_LOOKAHEAD_M, WAVE_LOOKAHEAD_M, as_tested

AMPLITUDE_M = 5.0
OMEGAS = (1 / 5, 1 / 4, 1 / 3)
HALF_PERIOD_M = 18.8  # section 4.4
PERIODS = 2.0


@dataclass(frozen=True, eq=False)
class Tracking:
    """Errors along a path: sizes of the lateral error (m) and of the heading error of section 2.2.3 (degrees).

    `track` and `errors` end where the path's run-out begins.
    """

    ground: str
    model: str
    track: Trace
    errors: Deviation
    lateral_max_m: float
    lateral_mean_m: float
    heading_max_deg: float
    heading_mean_deg: float


def tracking(track: Trace, path: Mission, lookahead_m: float, ground: str, model: str) -> Tracking:
    """Measure a track against the first leg of a path, up to its run-out."""
    points = path.legs[0].points
    errors = deviation(track.place(), track.column("angle"), points, lookahead_m)
    end = int(np.argmax(np.append(errors.along, np.inf) >= path.legs[0].length_m - RUN_OUT_M))
    errors = Deviation(errors.along[:end], errors.lateral[:end], errors.heading[:end])
    lateral, heading = np.abs(errors.lateral), np.degrees(np.abs(errors.heading))
    return Tracking(
        ground, model, track.until(end), errors,
        float(lateral.max()), float(lateral.mean()), float(heading.max()), float(heading.mean()),
    )  # fmt: skip


def slip_test(
    tractor: Tractor, ground: str, model: str, *, curve: FrictionCurve | None = ENGINE_CURVE,
    point_m: float = CONTROLLED_M,
) -> Tracking:  # fmt: skip
    """Section 4.4: the wave of 37.6 m and 5 m at 5 km/h with 1.8 m lookahead, angles uncorrected."""
    tested = as_tested(tractor, lookahead_m=SLIP_LOOKAHEAD_M, point_m=point_m)
    path = wave(AMPLITUDE_M, math.pi / HALF_PERIOD_M, PERIODS, CIRCLE_SPEED_MPS, "asphalt")
    track = follow(tested, path, tyres=tyres_on(ground, model, curve=curve), seconds=180.0)
    return tracking(track, path, SLIP_LOOKAHEAD_M, ground, model)


def zigzag(
    tractor: Tractor, omega: float, steering: str = "proposed", ground: str = "soil", *,
    lookahead_m: float = WAVE_LOOKAHEAD_M,
) -> Tracking:  # fmt: skip
    """Section 3.3 at 5 km/h, the path of Eq. 3.1 with the corrected base model."""
    path = wave(AMPLITUDE_M, omega, PERIODS, CIRCLE_SPEED_MPS, ground)
    track = follow(as_tested(tractor, steering, lookahead_m=lookahead_m), path, seconds=240.0)
    return tracking(track, path, lookahead_m, ground, steering)


def apart_m(one: Tracking, other: Tracking) -> tuple[float, float]:
    """Largest and mean distance (m) of one track from another."""
    gap = distances(one.track.place(), other.track.place())
    return float(gap.max()), float(gap.mean())
