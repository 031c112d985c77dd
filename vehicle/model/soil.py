"""Soils: what the ground is made of, how wet and how firm it is.

The table vehicle/data/work/soils.csv has a line per soil and moisture: the three grounds of the thesis, whose tyres
stand in vehicle.model.ground, the classes of ASABE D497, and nine textures. A user's table has the same columns, and
those of vehicle.model.soil_effects for what measured logs said. The
cone indices of the textures are the middle of three published formulas, with the lowest and the highest as interval;
above 2068 kPa (300 psi) a penetrometer's dial ends. They hold for settled ground: freshly tilled soil is weaker.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from fields.errors import suggest_name
from vehicle.errors import VehicleError
from vehicle.model.data_table import load_table
from vehicle.model.ground import TYRE_GROUNDS, get_tyres
from vehicle.model.soil_effects import MeasuredEffects, interpolate_effects
from vehicle.model.tractor import EffectSetting

Texture = Literal["fine", "medium", "coarse"]
USUAL_STATE = "field capacity"
MEASURED_ERROR = 0.3
"""Of a cone index without an interval of its own: as far as published formulas lie apart where they were fitted."""


def _define_share(description: str) -> Any:
    return Field(default=None, ge=0, le=100, allow_inf_nan=False, description=description)


def _define_strength() -> Any:
    return Field(default=None, ge=10, le=20_000, allow_inf_nan=False, description="kPa, usually 200 to 2000")


class SoilRow(MeasuredEffects):
    """A line of a table of soils.

    Attributes:
        name: lines of one name differ in moisture.
        state: how wet in a word; without a moisture the line of USUAL_STATE is taken.
        moisture_pct: water per dry weight.
        clay_pct: clay per dry weight.
        draft: class of texture in the table of drafts.
        cone_index_kpa: resistance to the standard cone; left out where `ground` names a ground of the thesis.
        low_kpa, high_kpa: its interval.
        ground: ground of the thesis whose tyres are taken.
        source: where the line comes from.
    """

    name: str = Field(min_length=1, max_length=80)
    state: str = ""
    moisture_pct: float | None = _define_share("% of dry weight")
    clay_pct: float | None = _define_share("% of dry weight")
    draft: Texture = "medium"
    cone_index_kpa: float | None = _define_strength()
    low_kpa: float | None = _define_strength()
    high_kpa: float | None = _define_strength()
    ground: str | None = None
    source: str = ""

    @model_validator(mode="after")
    def _check_strength(self) -> SoilRow:
        if (self.cone_index_kpa is None) == (self.ground is None):
            raise ValueError("give either cone_index_kpa or ground")
        if self.ground is not None and self.ground not in TYRE_GROUNDS:
            raise ValueError(f"the ground {self.ground!r} is unknown; use one of: {', '.join(TYRE_GROUNDS)}")
        low, index, high = self.low_kpa, self.cone_index_kpa, self.high_kpa
        if index is not None and not (low or index) <= index <= (high or index):
            raise ValueError(f"cone_index_kpa {index:g} lies outside of low_kpa to high_kpa")
        return self


@dataclass(frozen=True)
class Soil:
    """A soil at one moisture, as a plan uses it; attributes as those of SoilRow.

    `low_kpa` to `high_kpa` is the interval of the cone index. `source` says from which lines it was interpolated.
    `effects` are those that measured logs said of it, by id.
    """

    name: str
    moisture_pct: float | None
    clay_pct: float | None
    draft: Texture
    cone_index_kpa: float | None
    low_kpa: float | None
    high_kpa: float | None
    ground: str | None
    source: str
    effects: Mapping[str, EffectSetting] = field(default_factory=dict, hash=False)

    @property
    def rolling_share(self) -> float | None:
        """Resistance to rolling over weight on a ground of the thesis; None where it follows from the cone index."""
        return None if self.ground is None else get_tyres(self.ground, "nonlinear").rolling_resistance


def find_soil(name: str, moisture_pct: float | None = None, path: str | Path | None = None) -> Soil:
    """The soil of a name at a moisture, from Headland's table or a user's (`path`).

    Between two lines the logarithms of the cone index and of its interval are interpolated by moisture, and what logs
    said as it is; without a moisture, the line at field capacity counts, or the only one. Beyond the driest and wettest
    line nothing is said.

    Raises:
        VehicleError: an unknown name, a moisture that is missing or outside of the lines, or a table with a fault.
    """
    rows = get_soil_rows(name, path)
    if moisture_pct is None:
        usual = [row for row in rows if row.state == USUAL_STATE] or list(rows)
        if len(usual) > 1:
            raise VehicleError(
                f"The soil {name!r} has {len(rows)} lines by moisture; say how wet it is, {_join_range(rows)}."
            )
        return _build_soil(usual[0], usual[0], 0.0, usual[0].moisture_pct)
    return interpolate_soil(rows, moisture_pct)


def interpolate_soil(rows: tuple[SoilRow, ...], moisture_pct: float) -> Soil:
    """The soil of these lines (driest first) at a moisture. Raises VehicleError as find_soil."""
    name = rows[0].name
    if rows[0].moisture_pct is None:
        raise VehicleError(f"The soil {name!r} is the same at any moisture; leave out the moisture or name a texture.")
    for drier, wetter in zip(rows, [*rows[1:], rows[-1]], strict=True):
        low, high = drier.moisture_pct or 0.0, wetter.moisture_pct or 0.0
        if low <= moisture_pct <= high:
            share = (moisture_pct - low) / (high - low) if high > low else 0.0
            return _build_soil(drier, wetter, share, moisture_pct)
    raise VehicleError(
        f"The moisture {moisture_pct:g} % is outside of what is known of the soil {name!r}; "
        f"give one {_join_range(rows)}."
    )


def get_soil_rows(name: str, path: str | Path | None = None) -> tuple[SoilRow, ...]:
    """The lines of a soil, driest first. Raises VehicleError."""
    soils = load_soils(path)
    if name not in soils:
        close = suggest_name(name, soils)
        raise VehicleError(f"The soil {name!r} is unknown{close}; use one of: {', '.join(soils)}.")
    return soils[name]


def load_soils(path: str | Path | None = None) -> dict[str, tuple[SoilRow, ...]]:
    """All soils by name, of Headland's table or a user's, lines from dry to wet.

    Raises:
        VehicleError: naming the line and the fault, or the soil whose lines contradict each other.
    """
    soils: dict[str, list[SoilRow]] = {}
    for row in load_table(path, "soils.csv", SoilRow, "a soil"):
        soils.setdefault(row.name, []).append(row)
    return {name: _sort_rows(name, rows) for name, rows in soils.items()}


def _sort_rows(name: str, rows: list[SoilRow]) -> tuple[SoilRow, ...]:
    moistures = [row.moisture_pct for row in rows if row.moisture_pct is not None]
    if len(rows) > 1 and (len(set(moistures)) < len(rows) or len({row.ground for row in rows}) > 1):
        raise VehicleError(
            f"The soil {name!r} has {len(rows)} lines; give each another moisture_pct, and all a cone_index_kpa or the "
            "same ground."
        )
    return tuple(sorted(rows, key=lambda row: row.moisture_pct or 0.0))


def _build_soil(drier: SoilRow, wetter: SoilRow, share: float, moisture_pct: float | None) -> Soil:
    lines = (drier,) if share == 0.0 else (wetter,) if share == 1.0 else (drier, wetter)
    source = lines[0].source
    if len(lines) > 1:
        between = f"between {drier.moisture_pct:g} and {wetter.moisture_pct:g} % moisture"
        source = f"{source}; {between}" if source else between
    index, low, high = (
        None if first is None or second is None else first * math.exp(share * math.log(second / first))
        for first, second in zip(_list_strengths(drier), _list_strengths(wetter), strict=True)
    )
    return Soil(
        name=drier.name,
        moisture_pct=moisture_pct,
        clay_pct=drier.clay_pct,
        draft=drier.draft,
        cone_index_kpa=index,
        low_kpa=low,
        high_kpa=high,
        ground=drier.ground,
        source=source,
        effects=interpolate_effects(drier, wetter, share),
    )


def _list_strengths(row: SoilRow) -> tuple[float | None, float | None, float | None]:
    """Cone index and its interval, which is MEASURED_ERROR either way where the line has none."""
    index = row.cone_index_kpa
    if index is None:
        return None, None, None
    return index, row.low_kpa or index * (1.0 - MEASURED_ERROR), row.high_kpa or index * (1.0 + MEASURED_ERROR)


def _join_range(rows: tuple[SoilRow, ...]) -> str:
    return f"from {rows[0].moisture_pct:g} to {rows[-1].moisture_pct:g} %"
