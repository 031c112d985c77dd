"""Traction of a driven wheel on soil by its mobility number (Brixius 1987, as in ASABE D497).

    Bn   = CI b d / W  (1 + 5 delta/h) / (1 + 3 b/d)            mobility number
    GT/W = 0.88 (1 - exp(-0.1 Bn)) (1 - exp(-7.5 s)) + 0.04     gross traction: torque over rolling radius
    MR/W = 1/Bn + 0.04 + 0.5 s / sqrt(Bn)                       motion resistance
    NT/W = GT/W - MR/W                                          net traction: what the wheel pushes the tractor with

CI is the cone index (kPa), b and d the tyre's section width and diameter (m), delta/h its deflection over its section
height, W its load (kN) and s the slip, 1 - speed over ground / speed of the wheel. The equations were fitted to
bias-ply tyres; a wheel that brakes is taken to slip as one that drives, which the standard does not say. The simulation
and the reckoning of energy call the same functions.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vehicle.jit import compile_function

USUAL_DEFLECTION_RATIO = 0.2  # of the section height: the middle of the range that the equations were fitted to
PEAK_SHARE, PEAK_RATE = 0.88, 0.1
SLIP_RATE = 7.5
HARD_RESISTANCE, SLIP_RESISTANCE = 0.04, 0.5
MAX_NEWTON_STEPS, NEWTON_TOLERANCE = 12, 1e-9


@compile_function
def compute_mobility_number(
    cone_index_kpa: float, width_m: float, diameter_m: float, load_n: float, deflection_ratio: float
) -> float:
    """Bn of one tyre; `deflection_ratio` is delta/h, usually USUAL_DEFLECTION_RATIO."""
    shape = (1.0 + 5.0 * deflection_ratio) / (1.0 + 3.0 * width_m / diameter_m)
    return cone_index_kpa * width_m * diameter_m * 1000.0 / load_n * shape


@compile_function
def compute_traction_envelope(mobility: float) -> float:
    """The gross traction per load that slip could reach, without the 0.04 of hard ground."""
    return PEAK_SHARE * (1.0 - math.exp(-PEAK_RATE * mobility))


@compile_function
def compute_gross_traction(slip: float, mobility: float) -> float:
    """Gross traction per load of a driven wheel that slips by `slip` (0 to 1)."""
    return compute_traction_envelope(mobility) * (1.0 - math.exp(-SLIP_RATE * slip)) + HARD_RESISTANCE


@compile_function
def compute_motion_resistance(slip: float, mobility: float) -> float:
    """Motion resistance per load; that of a wheel that is not driven has a slip of 0."""
    return 1.0 / mobility + HARD_RESISTANCE + SLIP_RESISTANCE * slip / math.sqrt(mobility)


@compile_function
def compute_net_traction(slip: float, mobility: float) -> float:
    """Net traction per load; negative where the wheel must be pushed."""
    return compute_gross_traction(slip, mobility) - compute_motion_resistance(slip, mobility)


@compile_function
def compute_tractive_efficiency(slip: float, mobility: float) -> float:
    """Share of the power at the axle that pushes the tractor: (1 - s) NT / GT."""
    return (1.0 - slip) * compute_net_traction(slip, mobility) / compute_gross_traction(slip, mobility)


@compile_function
def compute_friction_circle_share(drive: float, grip: float) -> float:
    """Share of the side force of a driven wheel: the friction circle, with `grip` the largest drive force.

    At the limit of the grip a twentieth remains, so that a spinning wheel still resists a little.
    """
    used = min(abs(drive) / grip, 1.0)
    return max(math.sqrt(1.0 - used * used), 0.05)


@compile_function
def compute_best_pull_slip(mobility: float, max_slip: float) -> float:
    """The slip up to `max_slip` at which net traction is greatest: beyond it wheels only dig."""
    steepest = SLIP_RATE * compute_traction_envelope(mobility) * math.sqrt(mobility) / SLIP_RESISTANCE
    return min(max(math.log(steepest) / SLIP_RATE, 0.0), max_slip)


@compile_function
def solve_slip(net_share: float, mobility: float, max_slip: float) -> float:
    """The slip at which net traction per load is `net_share`, from -max_slip (braking) to that of the best pull.

    The best pull's slip where the ground gives no such traction: compare with compute_net_traction there. Newton's
    method from below, which cannot overshoot as net traction is concave in slip.
    """
    envelope = compute_traction_envelope(mobility)
    per_slip = SLIP_RESISTANCE / math.sqrt(mobility)
    gain = net_share + 1.0 / mobility  # over a wheel without slip
    sign = 1.0
    limit = max_slip
    if gain < 0.0:
        sign = -1.0
        gain, per_slip = -gain, -per_slip  # resistance helps a brake
    else:
        limit = compute_best_pull_slip(mobility, max_slip)
    if envelope * (1.0 - math.exp(-SLIP_RATE * limit)) - per_slip * limit <= gain:
        return sign * limit
    slip = 0.0
    if sign > 0.0:
        slip = -math.log(1.0 - gain / envelope) / SLIP_RATE  # the slip if resistance did not grow with it
    for _ in range(MAX_NEWTON_STEPS):
        rest = envelope * math.exp(-SLIP_RATE * slip)
        step = (gain - (envelope - rest - per_slip * slip)) / (SLIP_RATE * rest - per_slip)
        slip += step
        if abs(step) < NEWTON_TOLERANCE:
            break
    return sign * min(max(slip, 0.0), limit)


@compile_function
def solve_slips(net_shares: Any, mobility: float, max_slip: float) -> Any:
    """As solve_slip, for an array of net traction per load."""
    slips = np.empty(len(net_shares))
    for n in range(len(net_shares)):
        slips[n] = solve_slip(net_shares[n], mobility, max_slip)
    return slips
