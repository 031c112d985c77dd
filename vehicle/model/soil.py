"""Soils: what the ground is made of, how wet and how firm it is.

The table vehicle/data/work/soils.csv has a line per soil and moisture: the three grounds of the thesis, whose tyres
stand in vehicle.model.ground, the classes of ASABE D497, and nine textures. A user's table has the same columns, and
those of MeasuredEffects for what measured logs said, which holds for the tractor of the logs and for others as far as
their tyres and loads are alike. The cone indices of the textures are the middle of three published formulas, with the
lowest and the highest as interval; above 2068 kPa (300 psi) a penetrometer's dial ends. They hold for settled ground:
freshly tilled soil is weaker.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from fields.errors import suggest_name
from vehicle.errors import VehicleError
from vehicle.model.data_table import load_table
from vehicle.model.effects import check_effect, get_effect
from vehicle.model.ground import TYRE_GROUNDS, get_tyres
from vehicle.model.tractor import EffectSetting, Tractor

Texture = Literal["fine", "medium", "coarse"]
USUAL_STATE = "field capacity"
MEASURED_ERROR = 0.3
"""Of a cone index without an interval of its own: as far as published formulas lie apart where they were fitted."""


SOIL_EFFECTS = ("wheel_slip", "implement_slip", "side_slip", "understeer", "steering_gain")
"""Effects of one number that change with the soil: slip, the limit of side forces, and the correction of steering."""
LOW, HIGH = "_low", "_high"


def _define_value(description: str, low: float | None = None, high: float | None = None) -> Any:
    return Field(default=None, ge=low, le=high, allow_inf_nan=False, description=description)


class MeasuredEffects(BaseModel):
    """Values of SOIL_EFFECTS, units as in a tractor file, with their 95 % intervals; None where logs do not say it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    wheel_slip: float | None = _define_value("share of the speed lost")
    wheel_slip_low: float | None = _define_value("lower bound")
    wheel_slip_high: float | None = _define_value("upper bound")
    implement_slip: float | None = _define_value("share of the speed lost at work")
    implement_slip_low: float | None = _define_value("lower bound")
    implement_slip_high: float | None = _define_value("upper bound")
    side_slip: float | None = _define_value("limit, g")
    side_slip_low: float | None = _define_value("lower bound")
    side_slip_high: float | None = _define_value("upper bound")
    understeer: float | None = _define_value("deg per m/s2")
    understeer_low: float | None = _define_value("lower bound")
    understeer_high: float | None = _define_value("upper bound")
    steering_gain: float | None = _define_value("curvature over that of the tractor file")
    steering_gain_low: float | None = _define_value("lower bound")
    steering_gain_high: float | None = _define_value("upper bound")

    @model_validator(mode="after")
    def _check_effects(self) -> MeasuredEffects:
        for name in SOIL_EFFECTS:
            value, low, high = self.get_value(name)
            if value is None:
                if low is not None or high is not None:
                    raise ValueError(f"{name} has an interval and no value")
                continue
            check_effect(name, {get_effect(name).size.name: value})
            if not (value if low is None else low) <= value <= (value if high is None else high):
                raise ValueError(f"{name} {value:g} lies outside of {name}{LOW} to {name}{HIGH}")
        return self

    def get_value(self, name: str) -> tuple[float | None, float | None, float | None]:
        """Value and interval of an effect."""
        return getattr(self, name), getattr(self, name + LOW), getattr(self, name + HIGH)


def replace_soil_effects(tractor: Tractor, effects: Mapping[str, EffectSetting]) -> Tractor:
    """The tractor on a soil: what was measured on it stands in for the same effects of the tractor file."""
    return tractor.model_copy(update={"effects": {**tractor.effects, **effects}}) if effects else tractor


class Soil(MeasuredEffects):
    """A soil at one moisture: a line of a table of soils, or what lies between two of them.

    Attributes:
        name: lines of one name differ in moisture.
        state: how wet in a word; without a moisture the line of USUAL_STATE is taken.
        moisture_pct: water per dry weight.
        clay_pct: clay per dry weight.
        draft: class of texture in the table of drafts.
        cone_index_kpa: resistance to the standard cone; left out where `ground` names a ground of the thesis.
        low_kpa, high_kpa: its interval.
        ground: ground of the thesis whose tyres are taken.
        source: where the line comes from, or which lines it lies between.
    """

    name: str = Field(min_length=1, max_length=80)
    state: str = ""
    moisture_pct: float | None = _define_value("% of dry weight", 0, 100)
    clay_pct: float | None = _define_value("% of dry weight", 0, 100)
    draft: Texture = "medium"
    cone_index_kpa: float | None = _define_value("kPa, usually 200 to 2000", 10, 20_000)
    low_kpa: float | None = _define_value("kPa, usually 200 to 2000", 10, 20_000)
    high_kpa: float | None = _define_value("kPa, usually 200 to 2000", 10, 20_000)
    ground: str | None = None
    source: str = ""

    @model_validator(mode="after")
    def _check_strength(self) -> Soil:
        if (self.cone_index_kpa is None) == (self.ground is None):
            raise ValueError("give either cone_index_kpa or ground")
        if self.ground is not None and self.ground not in TYRE_GROUNDS:
            raise ValueError(f"the ground {self.ground!r} is unknown; use one of: {', '.join(TYRE_GROUNDS)}")
        low, index, high = self.low_kpa, self.cone_index_kpa, self.high_kpa
        if index is not None and not (low or index) <= index <= (high or index):
            raise ValueError(f"cone_index_kpa {index:g} lies outside of low_kpa to high_kpa")
        return self

    @property
    def effects(self) -> dict[str, EffectSetting]:
        """The effects that measured logs said of it, by id."""
        settings = {}
        for name in SOIL_EFFECTS:
            value, low, high = self.get_value(name)
            if value is not None:
                key = get_effect(name).size.name
                interval = {} if low is None or high is None else {key: (low, high)}
                settings[name] = EffectSetting(value={key: value}, interval=interval)
        return settings

    @property
    def rolling_share(self) -> float | None:
        """Resistance to rolling over weight on a ground of the thesis; None where it follows from the cone index."""
        return None if self.ground is None else get_tyres(self.ground, "nonlinear").rolling_resistance


def find_soil(name: str, moisture_pct: float | None = None, path: str | Path | None = None) -> Soil:
    """The soil of a name at a moisture, from Headland's table or a user's (`path`).

    Between two lines the logarithms of the cone index and of its interval are interpolated by moisture, and what logs
    said as it is; without a moisture, the line at field capacity counts, or the only one. Beyond the driest and wettest
    line nothing is said.

    Raises VehicleError for an unknown name, a moisture that is missing or outside of the lines, or a table with a
    fault.
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


def interpolate_soil(rows: tuple[Soil, ...], moisture_pct: float) -> Soil:
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


def get_soil_rows(name: str, path: str | Path | None = None) -> tuple[Soil, ...]:
    """The lines of a soil, driest first. Raises VehicleError."""
    soils = load_soils(path)
    if name not in soils:
        close = suggest_name(name, soils)
        raise VehicleError(f"The soil {name!r} is unknown{close}; use one of: {', '.join(soils)}.")
    return soils[name]


def load_soils(path: str | Path | None = None) -> dict[str, tuple[Soil, ...]]:
    """All soils by name, of Headland's table or a user's, lines from dry to wet.

    Raises VehicleError, naming the line and the fault, or the soil whose lines contradict each other.
    """
    soils: dict[str, list[Soil]] = {}
    for row in load_table(path, "soils.csv", Soil, "a soil"):
        soils.setdefault(row.name, []).append(row)
    return {name: _sort_rows(name, rows) for name, rows in soils.items()}


def _sort_rows(name: str, rows: list[Soil]) -> tuple[Soil, ...]:
    moistures = [row.moisture_pct for row in rows if row.moisture_pct is not None]
    if len(rows) > 1 and (len(set(moistures)) < len(rows) or len({row.ground for row in rows}) > 1):
        raise VehicleError(
            f"The soil {name!r} has {len(rows)} lines; give each another moisture_pct, and all a cone_index_kpa or the "
            "same ground."
        )
    return tuple(sorted(rows, key=lambda row: row.moisture_pct or 0.0))


def _build_soil(drier: Soil, wetter: Soil, share: float, moisture_pct: float | None) -> Soil:
    lines = (drier,) if share == 0.0 else (wetter,) if share == 1.0 else (drier, wetter)
    source = lines[0].source
    if len(lines) > 1:
        between = f"between {drier.moisture_pct:g} and {wetter.moisture_pct:g} % moisture"
        source = f"{source}; {between}" if source else between
    index, low, high = (
        None if first is None or second is None else first * math.exp(share * math.log(second / first))
        for first, second in zip(_list_strengths(drier), _list_strengths(wetter), strict=True)
    )
    cone = {"cone_index_kpa": index, "low_kpa": low, "high_kpa": high}
    effects = _interpolate_effects(lines[0], lines[-1], share)
    return drier.model_copy(update={"moisture_pct": moisture_pct, "source": source, "state": "", **cone, **effects})


def _interpolate_effects(drier: Soil, wetter: Soil, share: float) -> dict[str, float | None]:
    """Values and intervals of effects that both lines know, `share` (0 to 1) of the way between them."""
    return {
        key: None if one is None or other is None else one + share * (other - one)
        for key in MeasuredEffects.model_fields
        for one, other in [(getattr(drier, key), getattr(wetter, key))]
    }


def _list_strengths(row: Soil) -> tuple[float | None, float | None, float | None]:
    """Cone index and its interval, which is MEASURED_ERROR either way where the line has none."""
    index = row.cone_index_kpa
    if index is None:
        return None, None, None
    return index, row.low_kpa or index * (1.0 - MEASURED_ERROR), row.high_kpa or index * (1.0 + MEASURED_ERROR)


def _join_range(rows: tuple[Soil, ...]) -> str:
    return f"from {rows[0].moisture_pct:g} to {rows[-1].moisture_pct:g} %"
