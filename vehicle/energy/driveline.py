"""Engines and drivelines: power of the engine, and the share of it at shaft, axle and drawbar (ASABE D497)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from vehicle.model.tractor import Tractor

Drive = Literal["2wd", "mfwd", "4wd"]
ENGINE_TO_SHAFT = 0.90
"""Of the flywheel's power at the power take-off (a calibration of 2026 on a 105 hp tractor; D497 has the same)."""
ENGINE_TO_AXLE = 0.86
"""Of the flywheel's power at the axle (the spreadsheet that farmdss reproduces; 0.90 times the 0.96 of D497)."""
DRAWBAR_SHARES: Mapping[tuple[Drive, str], float] = {
    ("2wd", "firm"): 0.72, ("2wd", "tilled"): 0.67, ("2wd", "soft"): 0.55,
    ("mfwd", "firm"): 0.77, ("mfwd", "tilled"): 0.73, ("mfwd", "soft"): 0.65,
    ("4wd", "firm"): 0.78, ("4wd", "tilled"): 0.75, ("4wd", "soft"): 0.70,
}  # fmt: skip
"""Of the shaft's power at the drawbar, by drive and soil (D497, figure 1, as tcc quotes it)."""
DRAWBAR_SHARE = DRAWBAR_SHARES["mfwd", "tilled"]


def get_engine_power_kw(tractor: Tractor) -> float | None:
    """Power of the engine at the flywheel; None where it is not known."""
    return None if tractor.engine is None else tractor.engine.power_kw
