from __future__ import annotations

from dataclasses import dataclass

from planner.service.centre.centre import Centre
from planner.service.centre.fleet_plan import FleetPlan


@dataclass(frozen=True)
class Rest:
    without: tuple[int, ...]


@dataclass(frozen=True)
class Proposal:
    plan: FleetPlan
    kept: tuple[int, ...]
    eta_s: float
    moved_m: float
    left_m: float
    sentence: str | None = None


def rest_of(centre: Centre, without: list[int]) -> Rest:
    return Rest(tuple(without))


def replanned(rest: Rest) -> Proposal:
    raise NotImplementedError
