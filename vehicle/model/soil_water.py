"""Moisture of the topsoil after the rain of the last days: the balance of the evaporating layer of FAO-56.

Allen and others 1998, FAO Irrigation and Drainage Paper 56, chapter 7, for bare soil, day by day:

    De  = De - P + E, from 0 (field capacity) to TEW         depletion of the layer, mm (Eq. 77 to 79)
    TEW = 1000 (FC - 0.5 WP) Ze                              (Eq. 73), FC and WP as volumes of water per volume of soil
    REW = 1000 (FC - 0.5 WP) 0.04                            as AquaCrop has it, a skin of 4 cm
    E   = Kr Kc ET0, Kr = 1 up to REW, then falling to 0     (Eq. 71 and 74), Kc = 1.2 of bare wet soil

Rain falls early on its day, and water beyond field capacity has drained by the evening. Nothing runs off, no crop
draws water, and none rises from below. The table of soils has FC as its line at field capacity, WP as its dry line and
the density in its saturated one, as Saxton and Rawls 2006 have it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from fields.units import KILO, PCT
from vehicle.errors import VehicleError
from vehicle.model.soil import USUAL_STATE, Soil, interpolate_soil

LAYER_DEPTHS_M = (0.10, 0.15)
"""Ze of FAO-56, from and to. Cone indices are those of the upper 15 cm, so the deeper one counts."""
SKIN_DEPTH_M = 0.04
BARE_SOIL_COEFFICIENT = 1.2
PARTICLE_DENSITY = 2.65  # of mineral soil, over that of water
DRY_STATE, SATURATED_STATE = "dry", "saturated"


@dataclass(frozen=True)
class SoilWater:
    """Water of a soil: field capacity, wilting point and saturation (volume of water per volume), and dry density."""

    field_capacity: float
    wilting_point: float
    saturation: float
    density: float

    @property
    def evaporable_share(self) -> float:
        """Water that evaporation can take from the soil at field capacity, per volume."""
        return self.field_capacity - 0.5 * self.wilting_point

    def convert_to_moisture_pct(self, depletion_mm: float, depth_m: float) -> float:
        """Moisture of a layer, % of dry weight, that lacks so much water to field capacity; negative for a surplus."""
        share = min(self.field_capacity - depletion_mm / (KILO * depth_m), self.saturation)
        return PCT * share / self.density


@dataclass(frozen=True)
class MoistureEstimate:
    """Moisture (% of dry weight) with its interval, and the days, rain and evaporation it is estimated from."""

    moisture_pct: float
    low_pct: float
    high_pct: float
    days: int
    rain_mm: float
    et0_mm: float


def find_soil_water(rows: Sequence[Soil]) -> SoilWater:
    """The water of a soil by its lines. Raises VehicleError for a soil without the lines that say it."""
    by_state = {row.state: row.moisture_pct for row in rows}
    dry, usual, wet = (by_state.get(state) for state in (DRY_STATE, USUAL_STATE, SATURATED_STATE))
    if dry is None or usual is None or wet is None or not dry < usual < wet:
        raise VehicleError(
            f"The soil {rows[0].name!r} does not say how much water it holds, so rain does not tell its moisture; give "
            f"the moisture itself, or lines with the states {DRY_STATE}, {USUAL_STATE} and {SATURATED_STATE}."
        )
    density = PARTICLE_DENSITY / (1.0 + PARTICLE_DENSITY * wet / PCT)  # all pores are full
    field_capacity, wilting_point, saturation = (density * pct / PCT for pct in (usual, dry, wet))
    return SoilWater(field_capacity, wilting_point, saturation, density)


def compute_depletions(
    rains_mm: Sequence[float], et0s_mm: Sequence[float], water: SoilWater, depth_m: float, start_share: float
) -> tuple[float, float]:
    """Depletion (mm) of a layer after the last day, and what drained from it on that day.

    Args:
        rains_mm, et0s_mm: rain and reference evapotranspiration by day, the oldest first.
        water: of the soil.
        depth_m: of the layer.
        start_share: of what can evaporate, that had done so before the first day: 0 to 1.
    """
    most_mm = KILO * water.evaporable_share * depth_m
    readily_mm = KILO * water.evaporable_share * SKIN_DEPTH_M
    depletion_mm, drained_mm = start_share * most_mm, 0.0
    for rain_mm, et0_mm in zip(rains_mm, et0s_mm, strict=True):
        drained_mm = max(rain_mm - depletion_mm, 0.0)
        depletion_mm = max(depletion_mm - rain_mm, 0.0)
        reduction = min((most_mm - depletion_mm) / (most_mm - readily_mm), 1.0)
        depletion_mm = min(depletion_mm + reduction * BARE_SOIL_COEFFICIENT * et0_mm, most_mm)
    return depletion_mm, drained_mm


def estimate_moisture(
    rows: Sequence[Soil], rains_mm: Sequence[float], et0s_mm: Sequence[tuple[float, float, float]]
) -> MoistureEstimate:
    """Moisture of a soil after some days, from the day before the first to the evening of the last.

    The estimate begins halfway between field capacity and dry. The interval has all beginnings, both depths of the
    layer and the range of the evaporation, and on its wet side what fell on the last day and may not have drained.
    Drier than the driest line of the soil counts as that line.

    Args:
        rows: lines of the soil, driest first.
        rains_mm: by day, the oldest first, one or more.
        et0s_mm: reference evapotranspiration by day: likely, least and greatest.

    Raises VehicleError where the lines do not say how much water the soil holds.
    """
    water = find_soil_water(rows)
    driest_pct = rows[0].moisture_pct or 0.0
    likely, least, greatest = (list(column) for column in zip(*et0s_mm, strict=True))
    depth_m = LAYER_DEPTHS_M[-1]
    depletion_mm, _ = compute_depletions(rains_mm, likely, water, depth_m, 0.5)
    moistures = [water.convert_to_moisture_pct(depletion_mm, depth_m)]
    for et0s, layer_m, share in itertools.product((least, greatest), LAYER_DEPTHS_M, (0.0, 1.0)):
        depletion_mm, drained_mm = compute_depletions(rains_mm, et0s, water, layer_m, share)
        moistures += [
            water.convert_to_moisture_pct(each, layer_m) for each in (depletion_mm, depletion_mm - drained_mm)
        ]
    moistures = [max(moisture, driest_pct) for moisture in moistures]
    mean_et0_mm = sum(likely) / len(likely)
    return MoistureEstimate(
        moistures[0], min(moistures), max(moistures), len(rains_mm), float(sum(rains_mm)), mean_et0_mm
    )


def build_estimated_soil(rows: tuple[Soil, ...], estimate: MoistureEstimate) -> Soil:
    """The soil at the estimated moisture, whose cone index has the interval of the moisture in its own."""
    soil = interpolate_soil(rows, estimate.moisture_pct)
    driest, wettest = (interpolate_soil(rows, pct) for pct in (estimate.low_pct, estimate.high_pct))
    return soil.model_copy(update={"low_kpa": wettest.low_kpa, "high_kpa": driest.high_kpa})
