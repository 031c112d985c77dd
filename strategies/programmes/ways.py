"""Ways between any two poses of a site, for plans that change while they are driven."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np
import numpy.typing as npt

from strategies.moves.move import Move
from strategies.moves.move_finder import MoveFinder
from strategies.path_planning.paths import Pose
from strategies.site.site import Site

Floats = npt.NDArray[np.float64]


@dataclass(eq=False)
class Ways:
    """Finds ways on a site; each is looked for once. `settling` is as of MoveFinder.

    A machine that stands nearer to an edge than plans go is led on over what it may touch in a drive.
    """

    site: Site
    settling: Floats
    _finders: tuple[MoveFinder, ...] = field(init=False)
    _found: dict[tuple[Pose, Pose], Move | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        standing = replace(self.site, ground=self.site.proof_ground)
        self._finders = MoveFinder(self.site, self.settling), MoveFinder(standing, self.settling)

    def find(self, a: Pose, b: Pose) -> Move | None:
        """The cheapest way from a to b: in closed form, or by a search where none has room; None if none is found."""
        if (a, b) not in self._found:
            self._found[a, b] = next((way for finder in self._finders if (way := _find_way(finder, a, b))), None)
        return self._found[a, b]

    def leads_on(self, pose: Pose) -> bool:
        """Whether more than a pocket of ground is reached from a pose."""
        return any(finder.has_way_on(pose, backwards=False) for finder in self._finders)


def _find_way(finder: MoveFinder, a: Pose, b: Pose) -> Move | None:
    return min(finder.list_moves(a, b), key=attrgetter("cost_s"), default=None) or finder.search(a, b)
