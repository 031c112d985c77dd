"""What a strategy is given: the tracks, how the tractors drive, and a finder of ways between tracks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from fields.layout import Layout, Track
from fields.rounds import Round
from strategies.supply import Supply
from strategies.ways.around import Around
from strategies.ways.connect import Connector
from strategies.ways.fence import Fence, inside
from strategies.ways.gateway import Gateway
from strategies.ways.paths import Path, Pose
from strategies.ways.search import shortest_m

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

PLAIN_TURN_S = 40.0  # a turn in the headland that is quicker than this is not compared with one across tracks
DETOUR, DETOUR_S = 1.25, 5.0  # how much longer than one across tracks a way round them may take, factor and seconds


@dataclass(frozen=True)
class Manner:
    """How every tractor of the fleet drives.

    `tool_m` is how far the implement works behind the guided point; `turn_s[k]` the simulated seconds of the best
    turn over k lines (index 0 unused), beyond its end the last entry grows by driving straight across. A tractor
    that must give way waits `hold_back_m` before the end of its track, clear of the headland. Two that would turn side
    by side go `ahead_m` one after the other. `boxes` are the outline of tractor and implement: from and to so far ahead
    of the guided point, and half the width (m).
    """

    work_speed_mps: float
    turn_speed_mps: float
    reverse_speed_mps: float
    radius_m: float
    tool_m: float
    gap_m: float = 10.0
    stagger_m: float = 12.0
    hold_back_m: float = 8.0
    ahead_m: float = 0.0
    turn_s: tuple[float, ...] = (0.0, 20.0)
    boxes: tuple[tuple[float, float, float], ...] = ((-1.8, 2.4, 1.0), (-2.7, -1.9, 1.4))


@dataclass(frozen=True)
class Pass:
    """One track driven in one direction (+1 along the bearing of its cell, -1 against it)."""

    track: Track
    direction: int


@dataclass
class Job:
    """A field to be worked by `tractors` tractors.

    `connector` finds ways anywhere in the field, `headland` only beside the tracks. `corner` is where to begin
    (from the last line?, first direction), None where any will do, as it does where the ways from a gate count; `jump`
    fixes the pattern of tracks, None leaves it to the strategy; `turned` tractors drive their orders from the end to
    the beginning, where each has tracks of its own. `rounds` are those of the headland, `rim` finds ways in
    their corners, where the guided point may be anywhere on the field, and `square` tells whether corners are worked
    whole. With `spare_tracks` no way crosses tracks that can keep to the headland, however longer it is. With
    `standing` what is not worked yet is not driven through on the way in, where the headland leads round it. `around`
    has the passes that are bent round small obstacles. No way leads over a fence or an obstacle (`fence`) as long as
    one of the `careful` finders knows another. Tractors come in and go out by the `gate`; without one they stand where
    work begins, and stay where it ends. Ways once worked out are kept in `ways`, as strategies ask for the same ones,
    `tables` of turns (orders.table) by their tracks, `sharings` of the rounds (headland.rounds) by how they are shared
    out, `shifts` the legs of such shares, `formations` the groups of tracks worked abreast, `blocks` of neighbouring
    tracks in their quickest orders by how many tractors share them out, `legs` of tracks and ways (strategies.legs);
    jobs of one site have these in common. `supply` is what every tractor carries, None for nothing. `used` counts turns
    driven by kind.
    """

    layout: Layout
    manner: Manner
    connector: Connector
    tractors: int
    headland: Connector | None = None
    corner: tuple[bool, int] | None = None
    jump: int | None = None
    turned: tuple[int, ...] = ()
    rounds: tuple[Round, ...] = ()
    rim: Connector | None = None
    square: bool = True
    spare_tracks: bool = False
    standing: bool = False
    around: Around = field(default_factory=Around)
    fence: Fence | None = None
    careful: tuple[Connector, ...] = ()
    gate: Gateway | None = None
    ways: dict[tuple[Pose, Pose], Path | None] = field(default_factory=dict)
    tables: dict[tuple[int, tuple[Track, ...]], Any] = field(default_factory=dict)
    sharings: dict[tuple[Any, ...], Any] = field(default_factory=dict)
    supply: Supply | None = None
    shifts: dict[tuple[Any, ...], Any] = field(default_factory=dict)
    formations: dict[tuple[Any, ...], Any] = field(default_factory=dict)
    blocks: dict[tuple[int, tuple[Track, ...]], Any] = field(default_factory=dict)
    legs: dict[tuple[Any, ...], Any] = field(default_factory=dict)
    used: dict[str, int] = field(default_factory=dict)

    def way(self, a: Pose, b: Pose) -> Path | None:
        """The quickest drivable way from a to b, or None.

        It keeps to the headland, where it tramples nothing, unless a way across tracks is much quicker and tracks need
        not be spared.
        """
        if (a, b) not in self.ways:
            found = self.turn(a, b) or self._route(a, b)
            if self.crosses(found):
                found = inside(self.fence, [each.connect(a, b) for each in self.careful], self.connector.cost) or found
            self.ways[a, b] = found or (self._turn(a, b) if self.fence else None)
        return self.ways[a, b]

    def crosses(self, way: Path | None, *, fences_only: bool = False) -> bool:
        """Whether some part of the machine comes to a fence, or an obstacle as well, on a way."""
        return way is not None and self.fence is not None and self.fence.crosses(way, fences_only=fences_only)

    def turn(self, a: Pose, b: Pose) -> Path | None:
        """A turn beside the tracks, or one across them that is much quicker; none that leads over the fence."""
        best = self._turn(a, b)
        if not self.crosses(best):
            return best
        return inside(self.fence, [each.direct(a, b) for each in self.careful], self.connector.cost)

    def turn_costs(self, starts: Floats, ends: Floats, pairs: Ints) -> Floats:
        """The connector's cost (k,) of what `turn` finds for many pairs; infinite where it finds nothing.

        `pairs` (k, 2) are numbers of `starts` (n, 3) and `ends` (m, 3); those with one start follow one another.
        """
        beside = np.full((len(pairs), 2), np.inf)
        if self.headland:
            beside = self.headland.direct_costs(starts, ends, pairs)
        best, dear = beside.copy(), np.flatnonzero(beside[:, 0] > PLAIN_TURN_S)
        if len(dear) and not self.spare_tracks:
            across = self.connector.direct_costs(starts, ends, pairs[dear])
            better = np.isfinite(across[:, 0]) & (beside[dear, 0] > DETOUR * across[:, 0] + DETOUR_S)
            best[dear[better]] = across[better]
        found = np.flatnonzero(np.isfinite(best[:, 0]))
        if self.fence is not None and len(found):
            near = self.fence.may_cross(starts[pairs[found, 0]], ends[pairs[found, 1]], best[found, 1])
            for k in found[near].tolist():
                p, q = pairs[k]
                path = self.turn(_pose(starts[p]), _pose(ends[q]))
                best[k, 0] = math.inf if path is None else self.connector.cost(path)
        seconds: Floats = best[:, 0]
        return seconds

    def _turn(self, a: Pose, b: Pose) -> Path | None:
        cost = self.connector.cost
        beside = self.headland.direct(a, b) if self.headland else None
        if self.spare_tracks or (beside and cost(beside) <= PLAIN_TURN_S):
            return beside
        across = self.connector.direct(a, b)
        if across and (beside is None or cost(beside) > DETOUR * cost(across) + DETOUR_S):
            return across
        return beside

    def _route(self, a: Pose, b: Pose) -> Path | None:
        """A route along the headland if it is hardly longer than the crow flies, else the quickest one."""
        beside = self.headland.connect(a, b) if self.headland else None
        flight_s = math.dist(a[:2], b[:2]) / self.manner.turn_speed_mps
        cost = self.connector.cost
        if beside and (self.spare_tracks or cost(beside) <= DETOUR * flight_s + PLAIN_TURN_S):
            return beside
        across = self.connector.connect(a, b)
        if across and (beside is None or cost(beside) > DETOUR * cost(across) + DETOUR_S):
            return across
        return beside

    def entry(self, this: Pass) -> Pose:
        """Pose of the guided point where a pass begins: on the headland line, facing along the track."""
        x, y = this.track.start if this.direction > 0 else this.track.end
        return x, y, self.heading(this)

    def exit(self, this: Pass) -> Pose:
        """Pose of the guided point where the implement has reached the end of the track."""
        x, y = this.track.end if this.direction > 0 else this.track.start
        heading = self.heading(this)
        tool = self.manner.tool_m
        return x + tool * math.cos(heading), y + tool * math.sin(heading), heading

    def heading(self, this: Pass) -> float:
        """Mathematical angle of travel."""
        bearing = self.layout.bearing_of(this.track)
        return math.remainder(bearing if this.direction > 0 else bearing + math.pi, 2.0 * math.pi)

    def gate_time(self, first: Pass, last: Pass) -> float:
        """Estimated seconds of the ways in to a pass and out from another, by the gate; 0 without one."""
        if self.gate is None:
            return 0.0
        ends = (self.gate.inside, self.entry(first)), (self.exit(last), self.gate.out().start)
        metres = sum(shortest_m(np.array(a), np.array(b), self.manner.radius_m) for a, b in ends)
        return metres / self.manner.turn_speed_mps

    def turn_time(self, a: Pass, b: Pass) -> float:
        """Estimated seconds between two passes, from simulated turns: cheap, for comparing orders only."""
        return self.turns_from(a)(b)

    def turns_from(self, a: Pass) -> Callable[[Pass], float]:
        """`turn_time` from one pass to others."""
        cell, heading, manner, width_m = a.track.cell, self.heading(a), self.manner, self.layout.width_m
        cosine, sine, speed = math.cos(heading), math.sin(heading), manner.turn_speed_mps
        x, y = a.track.end if a.direction > 0 else a.track.start
        x, y = x + manner.tool_m * cosine, y + manner.tool_m * sine
        table, round_m = manner.turn_s, 2.0 * math.pi * manner.radius_m

        def seconds(b: Pass) -> float:
            if cell != b.track.cell:
                return shortest_m(np.array((x, y, heading)), np.array(self.entry(b)), manner.radius_m) / speed
            to_x, to_y = b.track.start if b.direction > 0 else b.track.end
            off_x, off_y = to_x - x, to_y - y
            along, across = off_x * cosine + off_y * sine, abs(off_y * cosine - off_x * sine)
            if a.direction == b.direction:
                return (abs(along) + across + round_m) / speed
            lines = max(1, round(across / width_m))
            extra = max(0, lines - len(table) + 1) * width_m
            return table[min(lines, len(table) - 1)] + (extra + abs(along)) / speed

        return seconds


def _pose(row: Floats) -> Pose:
    x, y, heading = row.tolist()
    return x, y, heading


def starting_corner(layout: Layout) -> tuple[bool, int] | None:
    """Which side and direction to begin with when the field has an entrance: (from the last line, direction).

    The side is one of the cell that is nearest to the entrance.
    """
    entrance = layout.field.entrance
    if entrance is None:
        return None
    _, line, direction, cell = min(
        ((math.dist(entrance, end), track.line, direction, track.cell) for track in layout.tracks
         for end, direction in ((track.start, 1), (track.end, -1))),
    )  # fmt: skip
    lines = [track.line for track in layout.tracks if track.cell == cell]
    return line > (lines[0] + lines[-1]) / 2, direction
