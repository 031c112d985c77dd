"""What engines and electric drives take for the power they give.

Diesel: ASABE D497.7 (2011), clause 3.3.3, after Grisso, Kocher and Vaughan 2004:

    Q = (0.22 X + 0.096) P     litres per hour

P is the rated power (kW) at the shaft, X the share of it in use (whatever turns the wheels counts as if taken from the
shaft), at full throttle. The edition of 2003 and those before it gave up to a third more. It says too much at light
loads: a New Holland T7 logged 0.97 of it at work, half of it while driving and turning. Points of a test, such as those
of OECD Code 2, give the two numbers for an engine. Two things the standard leaves out are said here: an engine that the
wheels turn, downhill, needs less along the same line until it needs nothing, and one that idles needs IDLE_SHARE.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fields.arrays import Floats
from fields.units import HOUR_S, J_PER_KWH, KILO
from vehicle.energy.load import ENGINE_TO_SHAFT
from vehicle.errors import check_range
from vehicle.model.tractor import BatteryParameters, Tractor

USE_L_PER_KWH, NO_LOAD_L_PER_KWH = 0.22, 0.096
IDLE_SHARE = 0.07
"""Of the fuel at full load: 1.9 of 28 l/h of a New Holland T7.165 S at 750 rpm (lindiap/tractor-field-operations)."""
CO2_KG_PER_L = 2.65
"""Of burnt diesel: IPCC 2006, 74.1 kg per GJ, 43.0 MJ/kg, 0.832 kg/l; without that of making the fuel."""
LITRES, KWH = "l", "kWh"


@dataclass(frozen=True)
class DieselEngine:
    """A diesel engine.

    Attributes:
        power_w: rated, at the flywheel.
        use_l_per_kwh, no_load_l_per_kwh: the two numbers of the equation.

    Raises VehicleError for a value that no engine has.
    """

    unit: ClassVar[str] = LITRES
    """What `compute_rate` counts per second."""
    power_w: float
    use_l_per_kwh: float = USE_L_PER_KWH
    no_load_l_per_kwh: float = NO_LOAD_L_PER_KWH

    def __post_init__(self) -> None:
        check_range("The power of the engine", self.power_w / KILO, 0.1, 2000.0, "kW")
        check_range("The fuel per work", self.use_l_per_kwh, 0.05, 1.0, "l/kWh")
        check_range("The fuel without load", self.no_load_l_per_kwh, 0.0, 0.5, "l/h per kW")

    @property
    def idle_rate(self) -> float:
        """Litres per second while the tractor stands."""
        return float(IDLE_SHARE * self._compute_lph(1.0)) / HOUR_S

    def compute_rate(self, power_w: Floats) -> Floats:
        """Litres per second at powers of the flywheel; negative where the wheels turn the engine."""
        return np.asarray(self._compute_lph(power_w / self.power_w) / HOUR_S)

    def _compute_lph(self, share: Any) -> Any:
        rated_kw = self.power_w * ENGINE_TO_SHAFT / KILO
        return compute_diesel_lph(share, rated_kw, self.use_l_per_kwh, self.no_load_l_per_kwh)


@dataclass(frozen=True)
class ElectricDrive:
    """A battery and motors. The efficiencies and the reserve are assumed; give those of the maker where known.

    The battery is charged for as long as the charger takes, and the time to connect it; with `change_s` it is changed
    for a full one instead.
    """

    unit: ClassVar[str] = KWH
    """What `compute_rate` counts per second."""
    battery: BatteryParameters

    @property
    def usable_kwh(self) -> float:
        """What a full battery gives before it must be charged or changed."""
        return self.battery.capacity_kwh * (1.0 - self.battery.reserve)

    @property
    def idle_rate(self) -> float:
        """Kilowatt-hours per second while the tractor stands."""
        return self.battery.standby_w / J_PER_KWH

    def compute_rate(self, power_w: Floats) -> Floats:
        """Kilowatt-hours per second at powers of the motor; negative where braking charges the battery."""
        drawn = np.where(
            power_w > 0.0, power_w / self.battery.efficiency, power_w * self.battery.recovery * self.battery.efficiency
        )
        return np.asarray((drawn + self.battery.standby_w) / J_PER_KWH)

    @property
    def stop_s(self) -> float:
        """What every stop takes besides the time of the charger."""
        return self.battery.connect_s if self.battery.change_s is None else self.battery.change_s

    @property
    def charge_s_per_kwh(self) -> float:
        """How long the charger takes for a kilowatt-hour; nothing where the battery is changed."""
        return HOUR_S / self.battery.charger_kw if self.battery.change_s is None else 0.0

    def compute_charge_s(self, energy_kwh: float) -> float:
        """How long a stop takes that puts an amount of energy into the battery."""
        return self.stop_s + energy_kwh * self.charge_s_per_kwh


PowerSource = DieselEngine | ElectricDrive


def compute_diesel_lph(
    share: Any,
    rated_shaft_kw: float,
    use_l_per_kwh: float = USE_L_PER_KWH,
    no_load_l_per_kwh: float = NO_LOAD_L_PER_KWH,
) -> Any:
    """Litres per hour of a diesel engine at a share X of its rated power at the shaft (D497.7, 3.3.3); never below 0.

    `share` may be an array.
    """
    return np.maximum(use_l_per_kwh * share + no_load_l_per_kwh, 0.0) * rated_shaft_kw


def build_power_source(tractor: Tractor, power_w: float) -> PowerSource:
    """What drives a tractor: its battery, or its diesel engine with this power.

    Raises VehicleError where the power of the engine is not known, or the fuel points are those of no engine.
    """
    if tractor.battery is None:
        return build_diesel_engine(tractor, power_w)
    return ElectricDrive(tractor.battery)


def build_diesel_engine(tractor: Tractor, power_w: float) -> DieselEngine:
    """The engine of a tractor with this power, by the fuel points of its file or by the equation of the standard.

    Raises VehicleError where the power is not known, or the points are those of no engine.
    """
    points = () if tractor.engine is None else tractor.engine.fuel_points
    if not points:
        return DieselEngine(power_w)
    shaft_kw, litres_per_h = np.array(points).T
    away_kw = shaft_kw - shaft_kw.mean()
    use = float((away_kw * litres_per_h).sum() / (away_kw**2).sum())
    no_load_lph = float(litres_per_h.mean() - use * shaft_kw.mean())
    rated_kw = power_w * ENGINE_TO_SHAFT / KILO
    return DieselEngine(power_w, use_l_per_kwh=use, no_load_l_per_kwh=no_load_lph / rated_kw)
