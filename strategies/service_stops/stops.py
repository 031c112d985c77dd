"""Stops at which tanks are refilled or emptied in the legs of a tractor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vehicle.missions.plan import Leg

SERVICE_CLEAR_M = 20.0  # a place is free when the tractor before has driven this far from it
WAIT_POINT_STEP_M = SERVICE_CLEAR_M  # between places to wait on the path to a place and back, with several tractors


@dataclass(frozen=True)
class ServiceStop:
    """Before leg `leg` the tank is refilled or emptied by `amount` (l or kg; kWh of a battery).

    The tractor may wait for its turn before leg `hold_leg`.
    """

    leg: int
    hold_leg: int
    amount: float


@dataclass(frozen=True)
class MissionWithStops:
    """The legs of a mission with its stops."""

    legs: tuple[Leg, ...]
    stops: tuple[ServiceStop, ...]


def find_waiting_leg(legs: Sequence[Leg], least: int) -> int:
    """The last leg before a stop, from `least` on, before which a tractor may wait; else the path to the stop."""
    work_legs = (number for number in range(len(legs) - 1, least - 1, -1) if legs[number].may_wait)
    return next(work_legs, len(legs))
