"""What measured logs say of a soil: effects that follow from the ground, in a line of a table of soils.

They hold for the tractor of the logs and for others as far as their tyres and loads are alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from vehicle.model.effects import check_effect, get_effect
from vehicle.model.tractor import EffectSetting, Tractor

SOIL_EFFECTS = ("wheel_slip", "implement_slip", "side_slip", "understeer", "steering_gain")
"""Effects of one number that change with the soil: slip, the limit of side forces, and the correction of steering."""
LOW, HIGH = "_low", "_high"


def _define_value(description: str) -> Any:
    return Field(default=None, allow_inf_nan=False, description=description)


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


def interpolate_effects(first: MeasuredEffects, second: MeasuredEffects, share: float) -> dict[str, EffectSetting]:
    """Effects `share` (0 to 1) of the way between two lines, values and intervals; those that both lines know.

    At 0 and at 1 the line alone counts.
    """
    lines = (first, first) if share == 0.0 else (second, second) if share == 1.0 else (first, second)
    settings = {}
    for name in SOIL_EFFECTS:
        ends = [line.get_value(name) for line in lines]
        value, low, high = (_mix(one, other, share) for one, other in zip(*ends, strict=True))
        if value is not None:
            key = get_effect(name).size.name
            interval = {} if low is None or high is None else {key: (low, high)}
            settings[name] = EffectSetting(value={key: value}, interval=interval)
    return settings


def _mix(one: float | None, other: float | None, share: float) -> float | None:
    return None if one is None or other is None else one + share * (other - one)


def replace_soil_effects(tractor: Tractor, effects: Mapping[str, EffectSetting]) -> Tractor:
    """The tractor on a soil: what was measured on it stands in for the same effects of the tractor file."""
    return tractor.model_copy(update={"effects": {**tractor.effects, **effects}}) if effects else tractor
