"""Gates by which a fleet keeps to the order of headland and tracks, where one tractor drives over another's ground.

Where finished ground must not be driven over, nobody works a piece of what comes last before all others have passed
it for what comes first. Where a crop stands, nobody drives over a piece of what comes first, for what comes last,
before it is worked. Tractors on ground of their own wait for nobody.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Flags, Integers
from fields.geometry.overlays import intersect
from strategies.lines.work_line import build_tool_strip
from strategies.site.site import Site
from vehicle.missions.plan import LegGate, LegTask, Mission, Plan

Shapes = npt.NDArray[np.object_]

_NOTHING = np.array(None, object)


def add_order_gates(plan: Plan, site: Site, first: Collection[LegTask], body_width_m: float, *, is_kept: bool) -> Plan:
    """The plan with the gates that the `first` tasks before all others ask for.

    `is_kept` is whether finished ground must not be driven over, else a crop stands that must not. A body is
    `body_width_m` wide. No gate comes before another that opens it, so they never bar each other. Who rests has none.
    """
    orders = [_MissionOrder.trace(mission, site, first, body_width_m) for mission in plan.missions]
    works = [number for number, mission in enumerate(plan.missions) if mission.works]
    for waiting, awaited in permutations(works, 2):
        gates = dict(sorted(_iter_waits(orders[waiting], orders[awaited], is_kept=is_kept)))
        reached = -1
        for hold, leg in gates.items():
            if leg > reached:
                gate = LegGate.place(awaited, leg, plan.missions[awaited].legs[leg].length_m)
                plan, reached = plan.copy_with_gate(waiting, hold, gate), leg
    return plan


@dataclass(frozen=True, eq=False)
class _MissionOrder:
    """What a mission drives over and works, and where it may wait between what comes first and the rest.

    Attributes:
        driven: (legs,) the ground that its body drives over.
        worked: (legs,) the ground that it works, None for a leg without work.
        stages: (legs,) 0 up to the last of what comes first, 1 from there on.
        is_first: (legs,) whether a leg works what comes first.
        holds: (legs,) where it waits for others before a leg of the second stage: as late as it may, but no sooner than
            before the last part of its first stage, where it may stand in any case.
        end: the last leg that others wait for, -1 for none: what it drives before it may wait itself.
    """

    driven: Shapes
    worked: Shapes
    stages: Integers
    is_first: Flags
    holds: Integers
    end: int

    @classmethod
    def trace(cls, mission: Mission, site: Site, first: Collection[LegTask], body_width_m: float) -> _MissionOrder:
        """The order of a mission on a site."""
        legs = mission.legs
        is_first = np.array([leg.implement and leg.task in first for leg in legs])
        last = int(np.flatnonzero(is_first)[-1]) if is_first.any() else -1
        may_wait = [number for number, leg in enumerate(legs) if leg.may_wait]
        border = max((number for number in may_wait if number <= last), default=0)
        holds = np.full(len(legs), border)
        for number in (number for number in may_wait if number > border):
            holds[number:] = number
        owner = np.repeat(np.arange(len(legs)), [len(leg.points) for leg in legs])
        paths = shapely.linestrings(np.concatenate([leg.points for leg in legs]), indices=owner)
        driven = shapely.buffer(paths, 0.5 * body_width_m, cap_style="flat")
        strips = [
            build_tool_strip(leg.points, site.rules.tool_m, site.width_m) if leg.implement else None for leg in legs
        ]
        stages = (np.arange(len(legs)) > last).astype(np.int64)
        return cls(driven, np.array(strips, object), stages, is_first, holds, border - 1 if last >= 0 else -1)


def _iter_waits(waiting: _MissionOrder, awaited: _MissionOrder, *, is_kept: bool) -> Iterator[tuple[int, int]]:
    """Where one mission waits and the leg of another that it waits for, wherever the ground asks for it."""
    if awaited.end < 0:
        return
    own, others = (waiting.worked, awaited.driven) if is_kept else (waiting.driven, awaited.worked)
    comes_first = awaited.stages == 0 if is_kept else awaited.is_first
    own, others = np.where(waiting.stages == 1, own, _NOTHING), np.where(comes_first, others, _NOTHING)
    pairs = shapely.STRtree(others).query(own, predicate="intersects")
    is_over = shapely.area(intersect(own[pairs[0]], others[pairs[1]])) > 0.0
    for leg, other in pairs[:, is_over].T.tolist():
        yield int(waiting.holds[leg]), min(other, awaited.end)
