"""Where tractors of a fleet stand: places to wait on a line, and those where they begin and end without an entrance.

Before it begins and when it is done, a tractor stands in the way of others. Two that each stand where the other must
pass on its first or last part never get on, so one of them is barred from such a place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
import numpy.typing as npt

from strategies.lines.work_line import cut_line, locate_at
from strategies.programmes.move_estimates import NO_MOVE_S
from strategies.programmes.move_table import MoveTable
from vehicle.arrays import measure_along
from vehicle.missions.plan import HEADLAND_PASS
from vehicle.sim.path_conflicts import PosePath, build_poses, find_conflicting_poses

Floats = npt.NDArray[np.float64]
StandsInWay = Callable[[Floats, Floats], bool]
"""Whether a tractor that stands with its centre of mass at a pose (3,) is in the way of one at poses (n, 3)."""

Clash = tuple[int, int, int]
"""Where tractors begin (0) or end (1), and the two that are in each other's way there."""

HEADLAND_WAIT_M = 40.0  # between places to wait along a headland side
POSE_STEP_M = 0.8  # between the poses of a path that are compared with one standing


@dataclass(frozen=True)
class StandingCheck:
    """Whether tractors stand in the way of others, as the scheduler sees it; all of one site have the same machine.

    Attributes:
        models: (1,) their MODEL record.
        clearance_m, beside_clearance_m: how near they may come, and how near beside each other.
    """

    models: npt.NDArray[np.void] = field(compare=False)
    clearance_m: float
    beside_clearance_m: float

    def __call__(self, standing: Floats, driving: Floats) -> bool:
        """Whether one that stands at a pose (3,) is in the way of one at poses (n, 3)."""
        return bool(self.find_blocked(standing[None], [PosePath(build_poses(driving))])[0])

    @property
    def reach_m(self) -> float:
        """How far apart two are never in each other's way (m)."""
        return float(2.0 * self.models["reach"][0] + max(self.clearance_m, self.beside_clearance_m))

    def find_blocked(self, places: Floats, driving: Iterable[PosePath]) -> npt.NDArray[np.bool_]:
        """At which of the poses (n, 3) one would stand in the way of any of others on their paths."""
        standing, blocked = PosePath(build_poses(places)), np.zeros(len(places), bool)
        for other in driving:
            blocked[self.find_blocked_parts(standing, other)[:, 0]] = True
        return blocked

    def find_blocked_parts(self, standing: PosePath, driving: PosePath) -> npt.NDArray[np.int64]:
        """Rows (k, 3): one of the poses to stand at, and the first and last pose of a path that one there bars."""
        return find_conflicting_poses(standing, driving, self.models, self.clearance_m, self.beside_clearance_m)


def sample_poses(points: Floats, back_m: float, gear: int = 1) -> Floats:
    """Poses (n, 3) of a centre of mass `back_m` behind the guided point on a path (k, 2) that is driven in a gear."""
    along = measure_along(points)
    places = locate_at(points, along, np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / POSE_STEP_M))))
    headings = np.arctan2(*(gear * np.diff(places, axis=0)).T[::-1])
    headings = np.append(headings, headings[-1])
    return np.column_stack([places - back_m * np.column_stack([np.cos(headings), np.sin(headings)]), headings])


def list_parts_m(table: MoveTable, node: int, length_m: float) -> list[float]:
    """Where the parts of a worked line begin, and its end: a tractor may wait before each but the first.

    There are places to wait along a headland side, and before the last part of any line.
    """
    hold_m = max(length_m - table.site.rules.hold_back_m, 0.5 * length_m)
    is_headland = table.lines[node // 2].task.kind == HEADLAND_PASS
    parts = max(1, round(hold_m / HEADLAND_WAIT_M)) if is_headland else 1
    return [0.0, *(hold_m * part / parts for part in range(1, parts + 1)), length_m]


@dataclass(eq=False)
class BarredPlaces:
    """Places where a tractor may not begin (0) or end (1): masks (2, tractors, nodes), found from tours that clash."""

    table: MoveTable
    stands_in_way: StandsInWay
    tractors: int
    masks: npt.NDArray[np.bool_] = field(init=False)
    _parts: dict[tuple[int, int], Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.masks = np.zeros((2, self.tractors, self.table.gate), bool)

    def charge(self, side: int, ends_s: Floats) -> Floats:
        """Seconds (tractors, nodes) of ways in (0) or home (1), NO_MOVE_S where a tractor is barred."""
        return np.where(self.masks[side], NO_MOVE_S, ends_s)

    def extend(self, tours: Sequence[Sequence[int]], seconds: Sequence[float]) -> bool:
        """Bar places of tours that clash, of the tractor that is done sooner; whether there were any."""
        return self.bar(list(self._iter_clashes(tours)), tours, seconds)

    def bar(self, clashes: Sequence[Clash], tours: Sequence[Sequence[int]], seconds: Sequence[float]) -> bool:
        """Bar the tractor that is done sooner from its place and all that clash with the other's; whether any was."""
        for side, a, b in clashes:
            yields, keeps = (a, b) if seconds[a] < seconds[b] else (b, a)
            taken = tours[keeps][-side]
            self.masks[side, yields, tours[yields][-side]] = True
            for node in range(self.table.gate):
                if self._do_clash(side, taken, node):
                    self.masks[side, yields, node] = True
        return bool(clashes)

    def _iter_clashes(self, tours: Sequence[Sequence[int]]) -> Iterator[Clash]:
        working = [number for number, tour in enumerate(tours) if tour]
        for side in (0, 1):
            for a, b in combinations(working, 2):
                if side == 0 and self.table.starts:
                    continue  # they stand where they stand
                if self._do_clash(side, tours[a][-side], tours[b][-side]):
                    yield side, a, b

    def _do_clash(self, side: int, a: int, b: int) -> bool:
        """Whether two that begin (or end) with these nodes each stand where the other has to pass."""
        known, key = self.table.moves.clashes, (self.stands_in_way, side, min(a, b), max(a, b))
        if key not in known:
            known[key] = self._find_clash(side, a, b)
        return known[key]

    def _find_clash(self, side: int, a: int, b: int) -> bool:
        p, q = self._get_part(side, a), self._get_part(side, b)
        reach_m = 2.0 * self.table.site.body.reach_m
        lengths_m = sum(math.dist(part[0, :2], part[-1, :2]) for part in (p, q))
        if math.dist(p[-side, :2], q[-side, :2]) > reach_m + lengths_m:
            return False
        return self.stands_in_way(p[-side], q) and self.stands_in_way(q[-side], p)

    def _get_part(self, side: int, node: int) -> Floats:
        """Poses (n, 3) of the centre of mass on the first (or last) part of a line."""
        if (side, node) not in self._parts:
            table, site = self.table, self.table.site
            path = table.lines[node // 2].paths[node % 2]
            along = measure_along(path)
            parts_m = list_parts_m(table, node, float(along[-1]))
            points = cut_line(path, *(parts_m[-2:] if side else parts_m[:2]))
            self._parts[side, node] = sample_poses(points, site.body.guide_m - site.axle_m)
        return self._parts[side, node]
