"""What effects beside a fit do to its surprises, to see what they promise where one of its parts is missing.

The trace of an effect hardly depends on what else acts. So rivals that promise far less than a part is worth are told
without a simulation for every part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vehicle.measured.causes.trial import Changes, Projector, needed, promised
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import Knobs, block_of, settings_of
from vehicle.measured.fit.products import crossed, side_by_side
from vehicle.measured.fit.solver import FIRST_STEP
from vehicle.measured.logs.record import Array


@dataclass(frozen=True, eq=False)
class Traces:
    """Traces of effects beside a fit; `changes_of` is Bench.changes, `bare` (n,) the surprises without linear terms."""

    changes_of: Changes
    fit: Fit
    bare: Array
    _known: dict[str, Array] = field(init=False, default_factory=dict)

    def hopeless(self, left: Array, project: Projector, knobs: Knobs, worth: float) -> bool:
        """Whether an effect promises far less than a gain that is `worth` something, in the place of a part.

        `left` (n,) is what the fit without the part leaves, its columns, which `project` takes out, free.
        """
        return self.promise(left, project, knobs) < needed(worth)

    def promise(self, left: Array, project: Projector, knobs: Knobs) -> float:
        """Loss that an effect takes away of what is left, by a straight line."""
        if knobs.id not in self._known:
            self._known[knobs.id] = self._trace(knobs)
        trace = self._known[knobs.id]
        square, side = project.products(trace), crossed(trace, left)
        each = [slice(0, knobs.count), *[slice(k, k + 1) for k in range(knobs.count, len(side))]]
        return max(promised(square[one, one], side[one]) for one in each)

    def _trace(self, knobs: Knobs) -> Array:
        """Changes of the surprises (n, m + s) by an effect: per coordinate from neutral, and at its other starts."""
        neutral = np.array(knobs.neutral)
        places = []
        for step in FIRST_STEP * np.diag(knobs.typical):
            ahead = knobs.inside(neutral + step)
            places.append(ahead if np.any(ahead != neutral) else knobs.inside(neutral - step))
        return self._columns(knobs, [*places, *[np.array(one) for one in knobs.starts if one != knobs.neutral]])

    def _columns(self, knobs: Knobs, places: Sequence[Array]) -> Array:
        block = frozenset({block_of(knobs.id)})
        asked = [(settings_of([*self.fit.parts, (knobs, at)]), block) for at in places]
        return side_by_side([one - self.bare for one in self.changes_of(asked, self.bare)], len(self.bare))
