"""Engines and drivelines: power of the engine, and the share of it at shaft, axle and drawbar (ASABE D497)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from vehicle.model.soil import Soil
from vehicle.model.tractor import Tractor

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
