"""The load of a plan: what draft, soil and engine mean for the wheels of a tractor (vehicle.model.work_load).

Engines give their power at shaft, axle and drawbar in shares (ASABE D497).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from vehicle.energy.draft import DraftRule, find_draft_rule
from vehicle.energy.traction import USUAL_DEFLECTION_RATIO, compute_mobility_number, compute_motion_resistance
from vehicle.model.soil import Soil, Texture
from vehicle.model.tractor import Tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import GRAVITY_MPS2

Drive = Literal["2wd", "mfwd", "4wd"]
Footing = Literal["firm", "tilled", "soft"]
ENGINE_TO_SHAFT = 0.90
"""Of the flywheel's power at the power take-off (a calibration of 2026 on a 105 hp tractor; D497 has the same)."""
ENGINE_TO_AXLE = 0.86
"""Of the flywheel's power at the axle (the spreadsheet that farmdss reproduces; 0.90 times the 0.96 of D497)."""
DRAWBAR_SHARES: Mapping[tuple[Drive, Footing], float] = {
    ("2wd", "firm"): 0.72, ("2wd", "tilled"): 0.67, ("2wd", "soft"): 0.55,
    ("mfwd", "firm"): 0.77, ("mfwd", "tilled"): 0.73, ("mfwd", "soft"): 0.65,
    ("4wd", "firm"): 0.78, ("4wd", "tilled"): 0.75, ("4wd", "soft"): 0.70,
}  # fmt: skip
"""Of the shaft's power at the drawbar, by drive and soil (D497, figure 1, as tcc quotes it)."""
FIRM_KPA, TILLED_KPA = 1050.0, 675.0
"""Least cone index of firm and of tilled soil: halfway between the classes of D497 (1200, 900 and 450 kPa)."""


@dataclass(frozen=True)
class DriveTyre:
    """A tyre of a driven axle: section width and diameter without load (m), and the load it carries (N).

    Without figures it is a 460 mm tyre of 1.6 m under 18 kN: its mobility number, 0.044 per kPa of cone index, is that
    of the classes of soil in D497 (80 on 1800 kPa, 55 on 1200 kPa), which stand for tyres near their rated load.
    """

    width_m: float = 0.46
    diameter_m: float = 1.6
    load_n: float = 18_000.0
    deflection_ratio: float = USUAL_DEFLECTION_RATIO

    def compute_mobility(self, cone_index_kpa: float) -> float:
        """Bn on a soil."""
        return float(
            compute_mobility_number(cone_index_kpa, self.width_m, self.diameter_m, self.load_n, self.deflection_ratio)
        )


def build_work_load(
    tractor: Tractor,
    width_m: float,
    operation: str,
    soil: Soil | None = None,
    *,
    rule: DraftRule | None = None,
    engine_power_kw: float | None = None,
    implement_mass_kg: float = 0.0,
) -> WorkLoad:
    """The load of an operation on a soil. Engine, tyres and height of the centre of mass are those of the tractor.

    Args:
        tractor: the tractor without implement. Without an engine its power is not limited; without tyres, usual ones
            near their rated load and front-wheel assist are taken.
        width_m: working width of the implement.
        operation: "till", "sow", ...; those without a rule of draft pull nothing.
        soil: as found by vehicle.model.soil.find_soil. Without a soil, and on a ground of the thesis, wheels do not
            slip along, and only the ground's resistance to rolling counts.
        rule: draft of the implement, in place of the usual one of the operation.
        engine_power_kw: at the flywheel, in place of the tractor's.
        implement_mass_kg: what the tractor carries, on the rear axle.

    Raises VehicleError for a value that nothing can have.
    """
    rule = rule or find_draft_rule(operation, width_m)
    texture: Texture = "medium" if soil is None else soil.draft
    mobility = compute_mobility(tractor, soil, implement_mass_kg)
    rolling = None if soil is None else soil.rolling_share
    power_kw = engine_power_kw or get_engine_power_kw(tractor)
    return WorkLoad(
        draft_n=(0.0, 0.0, 0.0) if rule is None else rule.compute_draft_terms(width_m, texture),
        implement_mass_kg=implement_mass_kg,
        rolling_share=rolling if mobility is None else float(compute_motion_resistance(0.0, mobility)),
        engine_power_w=math.inf if power_kw is None else 1000.0 * power_kw,
        driveline_efficiency=ENGINE_TO_AXLE if tractor.engine is None else tractor.engine.driveline_efficiency,
        driven_share=compute_driven_share(tractor, implement_mass_kg),
        mobility_number=mobility,
        centre_height_m=None if tractor.stability is None else tractor.stability.centre_height_m,
    )


def compute_mobility(tractor: Tractor, soil: Soil | None, implement_mass_kg: float = 0.0) -> float | None:
    """Bn of the driven wheels, the mean of the axles by load; None on a ground without cone index.

    A mean is exact where net traction is linear in Bn; for the tyres of an axle pair it is within 2 %.
    """
    if soil is None or soil.cone_index_kpa is None:
        return None
    tyres = list_drive_tyres(tractor, implement_mass_kg)
    weight = sum(tyre.load_n for tyre in tyres)
    return sum(tyre.compute_mobility(soil.cone_index_kpa) * tyre.load_n for tyre in tyres) / weight


def list_drive_tyres(tractor: Tractor, implement_mass_kg: float = 0.0) -> tuple[DriveTyre, ...]:
    """A tyre of each driven axle, rear first; usual ones where the tractor file names none."""
    tyres = tractor.tyres
    if tyres is None:
        return (DriveTyre(),)
    front_n, rear_n = compute_axle_loads_n(tractor, implement_mass_kg)
    rear = DriveTyre(tyres.rear_width_m, tyres.rear_diameter_m, 0.5 * rear_n, tyres.deflection_ratio)
    front = DriveTyre(tyres.front_width_m, tyres.front_diameter_m, 0.5 * front_n, tyres.deflection_ratio)
    return (rear,) if tyres.driven_wheels == "2wd" or front_n <= 0.0 else (rear, front)


def compute_axle_loads_n(tractor: Tractor, implement_mass_kg: float = 0.0) -> tuple[float, float]:
    """Weight on the front and the rear axle; what the tractor carries is taken to stand on the rear one."""
    front_kg = tractor.mass_kg * tractor.rear_axle_m / tractor.wheelbase_m
    return front_kg * GRAVITY_MPS2, (tractor.mass_kg - front_kg + implement_mass_kg) * GRAVITY_MPS2


def compute_driven_share(tractor: Tractor, implement_mass_kg: float = 0.0) -> float:
    """Share of the whole weight on driven wheels."""
    if tractor.tyres is None or tractor.tyres.driven_wheels != "2wd":
        return 1.0
    front_n, rear_n = compute_axle_loads_n(tractor, implement_mass_kg)
    return rear_n / (front_n + rear_n)


def compute_weight_n(tractor: Tractor, implement_mass_kg: float = 0.0) -> float:
    """Weight of the tractor with what it carries."""
    return (tractor.mass_kg + implement_mass_kg) * GRAVITY_MPS2


def find_drawbar_share(tractor: Tractor, soil: Soil | None = None) -> float:
    """Share of the engine's power that a tractor has at the drawbar on a soil.

    Without tyres in its file front-wheel assist is taken, and tilled soil where none with a cone index is named. The
    shares of the shaft's power are taken for those of the engine, which is some percent too good.
    """
    drive: Drive = "mfwd" if tractor.tyres is None else tractor.tyres.driven_wheels
    cone_index_kpa = None if soil is None else soil.cone_index_kpa
    footing: Footing = "tilled"
    if cone_index_kpa is not None:
        footing = "firm" if cone_index_kpa >= FIRM_KPA else "tilled" if cone_index_kpa >= TILLED_KPA else "soft"
    return DRAWBAR_SHARES[drive, footing]


def get_engine_power_kw(tractor: Tractor) -> float | None:
    """Power of the engine at the flywheel; None where it is not known."""
    return None if tractor.engine is None else tractor.engine.power_kw
