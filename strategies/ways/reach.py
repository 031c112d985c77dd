"""Whether rings lead from one end of a route to the other, compiled: asked before the quickest way is looked for.

Most searches along rings fail, in narrow places nearly all, and a search for the quickest way has to try every pose
before it knows. That some way exists at all is found without regard to time, link by link as far as none is known, and
which ring poses are joined to an end serves every route from or to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from strategies.ways.chains import UNKNOWN, Floats, in_reach, link_s
from strategies.ways.paths import Path, Pose
from strategies.ways.words import MOST_PIECES
from vehicle.jit import compiled

UNASKED, APART, JOINED = -1, 0, 1


@dataclass(eq=False)
class Spots:
    """Poses (n, 3) that routes lead through, and what is known of the room they have, (n, 4) as of chains.link_s."""

    poses: Floats
    rooms: Floats

    @classmethod
    def at(cls, poses: Sequence[Pose]) -> Spots:
        """Poses of whose room nothing is known yet."""
        return cls(np.array(poses, dtype=np.float64).reshape(-1, 3), np.full((len(poses), 4), UNKNOWN))

    @classmethod
    def of(cls, parts: Sequence[Spots]) -> Spots:
        """Those of some parts, one after another."""
        return cls(np.concatenate([part.poses for part in parts]), np.concatenate([part.rooms for part in parts]))

    def learn(self, parts: Sequence[Spots]) -> None:
        """Tell the parts that these were made of what is known now."""
        first = 0
        for part in parts:
            part.rooms[:] = self.rooms[first : first + len(part.rooms)]
            first += len(part.rooms)


@dataclass(eq=False)
class Layers:
    """Poses of which a route takes one of each layer: how many are in each, and all of them one after another."""

    sizes: list[int]
    spots: Spots

    @classmethod
    def of(cls, layers: Sequence[Sequence[Pose]]) -> Layers:
        """From the poses of each layer."""
        return cls([len(layer) for layer in layers], Spots.at([pose for layer in layers for pose in layer]))


@dataclass(eq=False)
class Moves:
    """What may be driven at one end of a route, and whether each pose of the rings is joined to any of it.

    `spots` is where the rest of the route joins each of the ways, `seconds` (n,) how long they take. `joined` (poses,)
    is empty until rings are asked for, and UNASKED where that was not needed yet.
    """

    ways: list[Path]
    spots: Spots
    seconds: Floats
    joined: npt.NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))

    def asked(self, poses: int) -> npt.NDArray[np.int8]:
        """`joined`, for so many poses of rings."""
        if len(self.joined) != poses:
            self.joined = np.full(poses, UNASKED, np.int8)
        return self.joined


@compiled
def rings_lead(  # type: ignore[no-untyped-def]
    poses, rooms, starts, first_goal, kept, from_start, to_goal, near, behind, radius, speeds, edges
):  # fmt: skip
    """Whether ring poses lead from a start to a goal; what is found out is put into `kept` and both kinds of `joined`.

    `poses` (n, 3) are so many `starts`, the ring poses, and goals from `first_goal` on; `rooms` and `kept` are as of
    chains.quickest_chain, whose links are the same: from starts to ring poses within `near` metres that are not
    farther back than `behind`, from every ring pose to every goal.
    """
    rings, row, barriers = first_goal - starts, np.zeros((MOST_PIECES, 3)), np.full((3, 1, 4), np.inf)
    seen, stack, high = np.zeros(rings, np.bool_), np.empty(rings, np.int64), 0
    for first in range(rings):
        if from_start[first] == UNASKED and not seen[first]:
            from_start[first] = APART
            for start in range(starts):
                if from_start[first] == APART and _leads(poses[start], poses[starts + first], near, behind):
                    link = link_s(poses, start, starts + first, rooms, barriers[0], radius, speeds, edges, row)
                    from_start[first] = JOINED if link < np.inf else APART
        if from_start[first] == JOINED and not seen[first]:
            seen[first], stack[0], high = True, first, 1
        while high > 0:
            high -= 1
            node = stack[high]
            if to_goal[node] == UNASKED:
                to_goal[node] = APART
                for goal in range(first_goal, len(poses)):
                    if to_goal[node] == APART:
                        link = link_s(poses, starts + node, goal, rooms, barriers[1], radius, speeds, edges, row)
                        to_goal[node] = JOINED if link < np.inf else APART
            if to_goal[node] == JOINED:
                return True
            for k in range(kept[0][node], kept[0][node + 1]):
                one, to = starts + node, starts + kept[1][k]
                if not seen[kept[1][k]]:
                    if kept[2][k] == UNKNOWN:
                        kept[2][k] = link_s(poses, one, to, rooms, barriers[2], radius, speeds, edges, row)
                    if kept[2][k] < np.inf:
                        seen[kept[1][k]], stack[high] = True, kept[1][k]
                        high += 1
    return False


@compiled
def _leads(pose, spot, near, behind) -> bool:  # type: ignore[no-untyped-def]
    """Whether a spot is close by a pose, as chains.close_by has it."""
    x, y = spot[0] - pose[0], spot[1] - pose[1]
    return in_reach(x, y, near) and x * math.cos(pose[2]) + y * math.sin(pose[2]) > -behind
