"""What a soil gives to the tyres of a tractor at work: slip, the share of the axles' power that pulls, and side force.

A wheel pushes the soil with at most 0.88 (1 - exp(-0.1 Bn)) of its load, the gross traction that slip could reach
(Brixius 1987, as in ASABE D497), and is taken to do so in any direction; of a driven wheel the friction circle leaves
sqrt(1 - u^2) of it across, u the share that its thrust takes. The simulation does the same (vehicle.sim.dynamics).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from vehicle.energy.load import compute_mobility, compute_weight_n
from vehicle.energy.traction import (
    compute_friction_circle_share,
    compute_traction_envelope,
    compute_tractive_efficiency,
    solve_slip,
)
from vehicle.model.soil import Soil
from vehicle.model.tractor import Tractor
from vehicle.model.work_load import WorkLoad

OTHER_LIMIT = 0.8
"""Of the load, on any soil: radial tyres of MAVS, the simulator of Mississippi State University (its Brixius class)."""


@dataclass(frozen=True)
class GripAtWork:
    """What the driven wheels have on level ground at working speed.

    Attributes:
        slip: of the wheels; that of the best pull where the soil does not give what work needs.
        pulling_share: of the power at the axles that pushes the tractor: (1 - s) NT / GT.
        side_limit: largest side force over load, of a wheel that rolls freely.
        side_low, side_high: its interval, with the bounds at both ends of the cone index and OTHER_LIMIT.
        side_at_work: what work leaves of it.
    """

    slip: float
    pulling_share: float
    side_limit: float
    side_low: float
    side_high: float
    side_at_work: float


def compute_grip_at_work(tractor: Tractor, load: WorkLoad, soil: Soil, speed_mps: float) -> GripAtWork | None:
    """What a soil gives on level ground; None on a ground without a cone index."""
    mobility, rolling = load.mobility_number, load.rolling_share
    if mobility is None or rolling is None:
        return None
    weight_n = compute_weight_n(tractor, load.implement_mass_kg)
    driven_n = load.driven_share * weight_n
    draft_n = load.compute_draft_n(speed_mps)
    slip = solve_slip((draft_n + rolling * (weight_n - driven_n)) / driven_n, mobility, load.max_slip)
    limit = compute_traction_envelope(mobility)
    share = compute_friction_circle_share(draft_n + rolling * weight_n, driven_n * limit)
    limits = [_compute_limit(tractor, soil, index, load) for index in (soil.low_kpa, soil.high_kpa)]
    return GripAtWork(
        slip,
        compute_tractive_efficiency(slip, mobility),
        limit,
        min(*limits, OTHER_LIMIT),
        max(*limits, OTHER_LIMIT),
        limit * share,
    )


def _compute_limit(tractor: Tractor, soil: Soil, cone_index_kpa: float | None, load: WorkLoad) -> float:
    index_kpa = soil.cone_index_kpa if cone_index_kpa is None else cone_index_kpa
    mobility = compute_mobility(tractor, replace(soil, cone_index_kpa=index_kpa), load.implement_mass_kg)
    assert mobility is not None  # the soil has a cone index
    return float(compute_traction_envelope(mobility))
