"""What a scan of candidates told that the next one need not ask again.

A log is cut at its sensors into channels, and an effect of one is not seen in another. A candidate whose channel is
left by the fit as it was left before would be found at the same place again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from vehicle.effects import PATH, POSITION, SPEED, STEERING, effect
from vehicle.measured.causes.dependence import Score
from vehicle.measured.causes.foreseen import Seen
from vehicle.measured.causes.trial import Projector, Tried
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.products import squared
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.thresholds import UNCHANGED


@dataclass(frozen=True, eq=False)
class Known:
    """A scan: its fit, what no column of that explains (n,), the candidates, and the scores of the unnamed terms.

    `project` takes out the columns of the fit; `seen` are the motions of trials, for the next scan.
    """

    fit: Fit
    project: Projector
    left: Array
    candidates: Sequence[Tried]
    scores: Sequence[Score]
    seen: Seen = field(default_factory=dict)

    def still(self, bench: Bench, fit: Fit, left: Array) -> frozenset[str]:
        """Blocks whose channels another fit on the same course leaves as this one did."""
        same: list[str] = []
        for blocks, rows in channels(bench):
            before, now = (_parts_in(one, blocks) for one in (self.fit, fit))
            if before == now and squared(left[rows] - self.left[rows]) < UNCHANGED:
                same += blocks
        return frozenset(same)

    def same_path(self, bench: Bench, fit: Fit) -> bool:
        """Whether another fit leaves the path as this one did, linear terms included: the scores are then the same."""
        _, path = channels(bench)[0]
        same_terms = self.fit.extra is not None and fit.extra is not None and (
            self.fit.extra.columns.shape == fit.extra.columns.shape
        )  # fmt: skip
        return same_terms and squared(fit.surprise[path] - self.fit.surprise[path]) < UNCHANGED

    def found(self, blocks: frozenset[str]) -> dict[str, Tried]:
        """Candidates of some blocks that were tried to their end, by name."""
        return {one.knobs.id: one for one in self.candidates if one.ended and effect(one.knobs.id).block in blocks}


def channels(bench: Bench) -> list[tuple[tuple[str, ...], slice]]:
    """Blocks that show in the path, in the wheel angle and in the speed, with their entries of the surprises."""
    rows = bench.course.rows
    wheel, others = ((STEERING,), ()) if bench.has_wheel else ((), (STEERING,))
    return [
        ((PATH, POSITION, *others), slice(0, 3 * rows)),
        (wheel, slice(3 * rows, 4 * rows)),
        ((SPEED,), slice(4 * rows, 5 * rows)),
    ]


def _parts_in(fit: Fit, blocks: tuple[str, ...]) -> list[tuple[str, tuple[float, ...]]]:
    """Parts of a fit in some blocks, with what was searched for of them."""
    return sorted((knobs.id, knobs.fixed) for knobs, _ in fit.parts if effect(knobs.id).block in blocks)
