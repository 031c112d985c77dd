"""What a soil gives to the tyres of a tractor, and from which moisture it is too wet to work, to pull or to drive on.

    Worked without harm   up to 7.5 + 1.91 organic matter + 0.34 clay, in % (Terzaghi, Hoogmoed and Miedema 1988); two
                          fields measured in Berlin differ from that by 3 % of moisture
    Pulled on             while the net traction of the driven wheels at their best slip is above the draft;
                          beyond 20 % of slip more power goes into the ground than into the pull
    Driven on             while the cone index is above the vehicle cone index of fifty passes, of the US army
                          (Priddy and Willoughby 2006), which holds for vehicles with all axles driven

The first is about compaction: wetter soil smears and is compacted by usual tyres. Cone indices have intervals, and so
have the last two.

A wheel pushes the soil with at most 0.88 (1 - exp(-0.1 Bn)) of its load, the gross traction that slip could reach
(Brixius 1987, as in ASABE D497), and is taken to do so in any direction; of a driven wheel the friction circle leaves
sqrt(1 - u^2) of it across, u the share that its thrust takes. The simulation does the same (vehicle.sim.dynamics).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vehicle.energy.load import compute_axle_loads_n, compute_driven_share, compute_mobility, compute_weight_n
from vehicle.energy.traction import (
    compute_best_pull_slip,
    compute_friction_circle_share,
    compute_motion_resistance,
    compute_net_traction,
    compute_traction_envelope,
    compute_tractive_efficiency,
    solve_slip,
)
from vehicle.model.soil import Soil, get_soil_rows, interpolate_soil
from vehicle.model.tractor import Tractor
from vehicle.model.work_load import WorkLoad

USUAL_ORGANIC_PCT = 2.0
MUCH_SLIP = 0.2
TILLAGE_LIMIT_ERROR_PCT = 3.0
USUAL_CLEARANCE_M = 0.45  # below a tractor; ten centimetres more or less change the vehicle cone index by 1 %
LBF_PER_N, INCHES_PER_M, KPA_PER_PSI = 0.224809, 39.3701, 6.894757
MOISTURE_STEPS = 40  # halvings, of the range of a soil's lines
WEIGHT_FACTORS = (
    (2_000.0, 0.553, 0.0),
    (13_500.0, 0.033, 1.05),
    (20_000.0, 0.142, -0.42),
    (float("inf"), 0.278, -3.115),
)
"""Below an axle's weight (lbf): slope per 1000 lbf and constant of the weight factor."""
OTHER_LIMIT = 0.8
"""Of the load, on any soil: radial tyres of MAVS, the simulator of Mississippi State University (its Brixius class)."""


@dataclass(frozen=True)
class MoistureLimit:
    """The moisture (% of dry weight) from which something does not go, and from when to when it may be.

    None: it goes at every moisture that is known of the soil; `low_pct` and `high_pct` the same for the firmest and the
    softest soil of the interval.
    """

    from_pct: float | None
    low_pct: float | None
    high_pct: float | None


@dataclass(frozen=True)
class Trafficability:
    """Limits of a soil for a tractor and its load.

    Attributes:
        work: from when working the soil compacts it; None where its clay is not known.
        slip: from when the wheels slip by more than MUCH_SLIP under the load.
        pull: from when they cannot pull it.
        sink: from when the tractor sinks in; None where not all axles are driven, or tyres are not known.
    """

    work: MoistureLimit | None
    slip: MoistureLimit
    pull: MoistureLimit
    sink: MoistureLimit | None


def compute_trafficability(
    tractor: Tractor,
    load: WorkLoad,
    soil_name: str,
    *,
    speed_mps: float,
    path: str | Path | None = None,
) -> Trafficability | None:
    """The limits of moisture of a soil by name; None for one that is the same at any moisture.

    The implement works at `speed_mps`, on level ground. Raises VehicleError for a soil that is not known.
    """
    rows = get_soil_rows(soil_name, path)
    if len(rows) < 2:
        return None
    needed_n = load.compute_draft_n(speed_mps)

    def find_pull_limit(max_slip: float | None) -> MoistureLimit:
        return _find_limit(rows, lambda soil: bool(compute_pull_n(tractor, load, soil, max_slip) >= needed_n))

    work = sink = None
    if rows[0].clay_pct is not None:
        work_pct, error_pct = compute_tillage_limit_pct(rows[0].clay_pct), TILLAGE_LIMIT_ERROR_PCT
        work = MoistureLimit(work_pct, work_pct - error_pct, work_pct + error_pct)
    index_kpa = compute_vehicle_cone_index(tractor, load.implement_mass_kg)
    if index_kpa is not None:
        sink = _find_limit(rows, lambda soil: (soil.cone_index_kpa or 0.0) >= index_kpa)
    return Trafficability(work, find_pull_limit(MUCH_SLIP), find_pull_limit(None), sink)


def compute_tillage_limit_pct(clay_pct: float) -> float:
    """The most moisture (% of dry weight) at which soil is worked without harm."""
    return 7.5 + 1.91 * USUAL_ORGANIC_PCT + 0.34 * clay_pct


def compute_pull_n(tractor: Tractor, load: WorkLoad, soil: Soil, max_slip: float | None = None) -> float:
    """What the tractor can pull with besides moving itself on level ground, at the slip that pulls most.

    Slip is at most `max_slip`, by default that of the load.
    """
    mobility = compute_mobility(tractor, soil, load.implement_mass_kg)
    if mobility is None:
        return float("inf")
    share = compute_driven_share(tractor, load.implement_mass_kg)
    slip = compute_best_pull_slip(mobility, load.max_slip if max_slip is None else max_slip)
    net = compute_net_traction(slip, mobility)
    towed = compute_motion_resistance(0.0, mobility)
    return (share * net - (1.0 - share) * towed) * compute_weight_n(tractor, load.implement_mass_kg)


def compute_vehicle_cone_index(tractor: Tractor, implement_mass_kg: float = 0.0) -> float | None:
    """The cone index (kPa) that the softer of the axles needs for fifty passes; None unless all axles are driven."""
    tyres = tractor.tyres
    if tyres is None or tyres.driven_wheels == "2wd":
        return None
    front_n, rear_n = compute_axle_loads_n(tractor, implement_mass_kg)
    return max(
        compute_cone_index_of_passes(front_n, tyres.front_width_m, tyres.front_diameter_m),
        compute_cone_index_of_passes(rear_n, tyres.rear_width_m, tyres.rear_diameter_m),
    )


def compute_cone_index_of_passes(
    axle_n: float, width_m: float, diameter_m: float, clearance_m: float = USUAL_CLEARANCE_M, *, has_gears: bool = True
) -> float:
    """Vehicle cone index (kPa) of fifty passes of axles with two tyres each, all driven."""
    index = compute_mobility_index(axle_n, width_m, diameter_m, clearance_m, has_gears=has_gears)
    return KPA_PER_PSI * (28.23 + 0.43 * index - 92.67 / (index + 3.67))


def compute_mobility_index(
    axle_n: float, width_m: float, diameter_m: float, clearance_m: float, *, has_gears: bool = True
) -> float:
    """The army's index of an axle with two tyres; strong engines, no chains, `has_gears` shifted by hand."""
    weight_lbf, width_in = axle_n * LBF_PER_N, width_m * INCHES_PER_M
    contact_pressure = weight_lbf / (width_in * diameter_m * INCHES_PER_M)  # two tyres: n / 2 is 1
    slope, constant = next((slope, constant) for below, slope, constant in WEIGHT_FACTORS if weight_lbf < below)
    weight_factor = slope * weight_lbf / 1000.0 + constant
    tyre_factor = (10.0 + width_in) / 100.0
    wheel_load, clearance = weight_lbf / 2000.0, clearance_m * INCHES_PER_M / 10.0
    return (contact_pressure * weight_factor / tyre_factor + wheel_load - clearance) * (1.05 if has_gears else 1.0)


def describe_trafficability(limits: Trafficability, soil_name: str, moisture_pct: float | None) -> tuple[str, ...]:
    """A sentence per limit that is known: from which moisture it holds, and whether it holds now."""
    soil = soil_name.capitalize()
    rules = (
        (limits.work, f"{soil} is compacted when it is worked"),
        (limits.slip, f"{soil} lets the wheels slip by more than {100.0 * MUCH_SLIP:.0f} % at work"),
        (limits.pull, f"{soil} does not give the pull for this work"),
        (limits.sink, f"{soil} does not carry the tractor"),
    )
    return tuple(
        _describe_limit(limit, what, moisture_pct)
        for limit, what in rules
        if limit is not None and (limit.from_pct is not None or limit.low_pct is not None)
    )


def _describe_limit(limit: MoistureLimit, what: str, moisture_pct: float | None) -> str:
    start, low, high = limit.from_pct, limit.low_pct, limit.high_pct
    if start is None:
        return f"{what} from {low:.0f} % of moisture at the earliest."
    sentence = (
        f"{what} from about {start:.0f} % of moisture ({low:.0f} % at the earliest, or not at all)."
        if high is None
        else f"{what} from about {start:.0f} % of moisture ({low:.0f} % at the earliest, {high:.0f} % at the latest)."
    )
    if moisture_pct is None or moisture_pct < start:
        return sentence
    return f"{sentence} At present it has {moisture_pct:.0f} %."


def _find_limit(rows: tuple[Soil, ...], is_possible: Callable[[Soil], bool]) -> MoistureLimit:
    """The limit at the cone index and at both ends of its interval; softer soil must never be better."""
    return MoistureLimit(
        _find_end(rows, is_possible),
        _find_end(rows, lambda soil: is_possible(soil.model_copy(update={"cone_index_kpa": soil.low_kpa}))),
        _find_end(rows, lambda soil: is_possible(soil.model_copy(update={"cone_index_kpa": soil.high_kpa}))),
    )


def _find_end(rows: tuple[Soil, ...], is_possible: Callable[[Soil], bool]) -> float | None:
    """The moisture (%) at which something ends to be possible; None if it does not."""
    low, high = rows[0].moisture_pct or 0.0, rows[-1].moisture_pct or 0.0
    if is_possible(interpolate_soil(rows, high)):
        return None
    if not is_possible(interpolate_soil(rows, low)):
        return low
    for _ in range(MOISTURE_STEPS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_possible(interpolate_soil(rows, middle)) else (low, middle)
    return high


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
    limits = [OTHER_LIMIT]
    for index_kpa in (soil.low_kpa, soil.high_kpa):
        end = soil if index_kpa is None else soil.model_copy(update={"cone_index_kpa": index_kpa})
        end_mobility = compute_mobility(tractor, end, load.implement_mass_kg)
        assert end_mobility is not None  # the soil has a cone index
        limits.append(float(compute_traction_envelope(end_mobility)))
    efficiency = compute_tractive_efficiency(slip, mobility)
    return GripAtWork(slip, efficiency, limit, min(limits), max(limits), limit * share)
