"""Draft of implements (ASABE D497, clause 4 and Table 1).

Draft is F (A + B S + C S^2) W T in newtons: texture factor F, speed S in km/h, width W in metres, tools or rows, depth
T in cm (1 where the coefficients hold for the whole depth). The table is vehicle/data/work/implements.csv; its sources
quote the standard, and a row that no source quotes is left out. Depths, their ranges and distances between tools and
rows are usual ones, not the standard's. Implements driven by the shaft, such as mowers, harvesters and sprayers, have
no row: they need little draft.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from fields.errors import shorten_value, suggest_name
from fields.units import KILO, KMH_PER_MPS
from vehicle.errors import VehicleError
from vehicle.model.data_table import load_table
from vehicle.model.soil import Texture

WHOLE_DEPTH_CM = 1.0
"""The depth of a row whose coefficients hold for the whole depth: T of the standard's equation."""
TILL, SOW = "till", "sow"
SPELLINGS = {"plow": "plough", "disc": "disk"}
NARROW_DRILL_M, WIDE_DRILL_M = 2.4, 3.7
"""Widths at which the rows of grain drills change (D497, Table 1)."""

Coefficient = Annotated[float, Field(ge=0, le=1e5, allow_inf_nan=False, description="newtons per unit and cm")]
Factor = Annotated[float, Field(gt=0, le=5, allow_inf_nan=False, description="factor of the texture, usually up to 1")]
Length = Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]


class DraftRule(BaseModel):
    """Coefficients of one kind of implement, and how it is usually set.

    Attributes:
        name: what a farm or an option calls it.
        implement: what it is called in a sentence.
        unit: what A, B and C count: metres of width, tools or rows.
        a, b, c: newtons per unit and cm of depth, per km/h and per (km/h)^2.
        fine, medium, coarse: F by texture of the soil.
        depth_cm: usual depth; WHOLE_DEPTH_CM where the coefficients hold for the whole depth.
        min_depth_cm, max_depth_cm: the depths that it can be set to.
        spacing_m: width of a unit, 1 for metres.
        range_pct: how far drafts lie from the mean, either way.
        in_furrows: whether it works one track after its neighbour, as each needs the furrow of the one before.
        source: where the coefficients come from.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(min_length=1)
    implement: str = Field(min_length=1)
    unit: Literal["m", "tools", "rows"]
    a: Coefficient
    b: Coefficient
    c: Coefficient
    fine: Factor
    medium: Factor
    coarse: Factor
    depth_cm: Length = WHOLE_DEPTH_CM
    min_depth_cm: Length = 0.1
    max_depth_cm: Length = 100.0
    spacing_m: Length = 1.0
    range_pct: float = Field(ge=0, le=100)
    in_furrows: bool = False
    source: str = ""

    @model_validator(mode="after")
    def _check_depths(self) -> DraftRule:
        low, high = self.min_depth_cm, self.max_depth_cm
        if self.follows_depth and not low <= self.depth_cm <= high:
            raise ValueError(f"depth_cm {self.depth_cm:g} lies outside of min_depth_cm to max_depth_cm")
        return self

    @property
    def follows_depth(self) -> bool:
        """Whether the draft grows with the working depth."""
        return self.depth_cm != WHOLE_DEPTH_CM

    def compute_draft_terms(self, width_m: float, texture: Texture = "medium") -> tuple[float, float, float]:
        """Draft at work as d0 + d1 v + d2 v^2 in newtons, v in m/s."""
        factor: float = getattr(self, texture)
        scale = factor * self.depth_cm * width_m / self.spacing_m
        return scale * self.a, scale * self.b * KMH_PER_MPS, scale * self.c * KMH_PER_MPS**2

    def compute_draft_n(self, width_m: float, speed_mps: float, texture: Texture = "medium") -> float:
        """Draft at work."""
        constant, linear, square = self.compute_draft_terms(width_m, texture)
        return constant + linear * speed_mps + square * speed_mps**2

    def compute_power_kw(self, width_m: float, speed_mps: float, texture: Texture = "medium") -> float:
        """Power at the drawbar."""
        return self.compute_draft_n(width_m, speed_mps, texture) * speed_mps / KILO

    def set_depth(self, depth_cm: float) -> DraftRule:
        """The implement set to another depth.

        Raises VehicleError where its draft does not follow depth, or it cannot be set to this one.
        """
        if not self.follows_depth:
            raise VehicleError(f"The draft of the {self.implement} holds for its whole depth; leave out the depth.")
        if not self.min_depth_cm <= depth_cm <= self.max_depth_cm:
            raise VehicleError(
                f"The working depth is {depth_cm:g} cm, and {self.name!r} works {self.min_depth_cm:g} to "
                f"{self.max_depth_cm:g} cm deep; give a depth in between, or another implement."
            )
        return self.model_copy(update={"depth_cm": depth_cm})


def find_draft_rule(operation: str, width_m: float) -> DraftRule | None:
    """The usual rule of an operation (till, sow); None for others."""
    rules = load_draft_rules()
    if operation == TILL:
        return rules["cultivator"]
    if operation == SOW:
        name = "narrow-drill" if width_m < NARROW_DRILL_M else "drill" if width_m <= WIDE_DRILL_M else "wide-drill"
        return rules[name]
    return None


def get_draft_rule(name: str) -> DraftRule:
    """The rule of an implement by name; "Disk harrow" will do.

    Raises VehicleError where the table has no such implement.
    """
    rules = load_draft_rules()
    plain_name = "-".join(name.lower().replace("_", " ").split())
    for spelling, own_spelling in SPELLINGS.items():
        plain_name = plain_name.replace(spelling, own_spelling)
    found = rules.get(name) or rules.get(plain_name)
    if found is None:
        close = suggest_name(plain_name, rules)
        raise VehicleError(
            f"The implement {shorten_value(name)} is not in the table of drafts{close}; use one of: {', '.join(rules)}."
        )
    return found


def load_draft_rules() -> dict[str, DraftRule]:
    """All rules of the table by name."""
    return {rule.name: rule for rule in load_table(None, "implements.csv", DraftRule, "an implement")}
