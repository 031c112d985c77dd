"""Draft of implements, and the drawbar power of a tractor (ASAE D497, clauses 3 and 4).

Draft is F (A + B S + C S^2) W T in newtons: soil factor F, speed S in km/h, width W in metres or number of tools, depth
T in cm. Implements driven by the shaft, such as mowers, harvesters and sprayers, have no entry: they need little draft.
The standard gives a range of about 30 % either way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from vehicle.model.tractor import Tractor

N_PER_KN, KMH_PER_MPS = 1000.0, 3.6
DRAWBAR_SHARE = 0.73
"""Of the engine's power, at the drawbar: front-wheel assist on tilled soil (D497, figure 1, with the shaft's power)."""
ENGINE_POWER_KW: Mapping[str, float] = {"Yanmar EG105": 77.0}
"""By name, of tractors that come with Headland: 105 PS by the maker's type."""


@dataclass(frozen=True)
class DraftRule:
    """Coefficients of one kind of implement in medium soil, and how it is usually set.

    Attributes:
        implement: what the implement is called in a sentence.
        soil_factor: F for medium soil.
        terms: A, B and C, newtons per metre or tool and cm of depth.
        depth_cm: usual depth; 1 where the coefficients hold for the whole depth.
        tools_per_m: tools per metre of width; 1 where the coefficients are per metre.
    """

    implement: str
    soil_factor: float
    terms: tuple[float, float, float]
    depth_cm: float = 1.0
    tools_per_m: float = 1.0

    def compute_draft_n(self, width_m: float, speed_mps: float) -> float:
        """Draft at work."""
        speed_kmh = KMH_PER_MPS * speed_mps
        constant, linear, square = self.terms
        per_tool_n = self.soil_factor * (constant + linear * speed_kmh + square * speed_kmh**2) * self.depth_cm
        return per_tool_n * self.tools_per_m * width_m

    def compute_power_kw(self, width_m: float, speed_mps: float) -> float:
        """Power at the drawbar."""
        return self.compute_draft_n(width_m, speed_mps) * speed_mps / N_PER_KN


FIELD_CULTIVATOR = DraftRule("cultivator", 0.85, (46.0, 2.8, 0.0), depth_cm=10.0, tools_per_m=1.0 / 0.15)
"""D497, Table 1: field cultivator, primary tillage; depth and 15 cm between tines are assumed."""
_DRILL_N_PER_M = ((2.4, 400.0), (3.7, 300.0), (float("inf"), 200.0))
"""D497, Table 1: grain drill with press wheels, newtons per metre by the largest width in metres."""


def find_draft_rule(operation: str, width_m: float) -> DraftRule | None:
    """The rule of an operation (till, sow); None for others."""
    if operation == "till":
        return FIELD_CULTIVATOR
    if operation == "sow":
        draft_n = next(value for limit_m, value in _DRILL_N_PER_M if width_m <= limit_m)
        return DraftRule("drill", 1.0, (draft_n, 0.0, 0.0))
    return None


def get_engine_power_kw(tractor: Tractor) -> float | None:
    """Power of the engine; None where it is not known."""
    return ENGINE_POWER_KW.get(tractor.name)
