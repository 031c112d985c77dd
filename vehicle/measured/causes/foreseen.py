"""What earlier trials of a cause tell of it beside another fit, without another simulation.

What an effect adds to the simulated motion hardly depends on what else acts. From one scan to the next it is the fit
and the weights that change. So the motions of a trial, weighed anew, foresee what a trial would begin with now, and a
cause that falls far short of what is asked is not tried again in this scan. That is no verdict on it: before anything
rests on it, it is tried.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.effects import PATH, POSITION, STEERING, effect
from vehicle.measured.causes.trial import Projector, Tried, needed, promised, sides_of
from vehicle.measured.fit.fitting import Fit
from vehicle.measured.fit.knobs import Knobs, block_of, settings_of
from vehicle.measured.fit.products import crossed, side_by_side, without
from vehicle.measured.logs.record import Array
from vehicle.measured.surprise.bench import Bench
from vehicle.measured.surprise.whitening import Increments
from vehicle.measured.thresholds import FORESEEN, OLDEST

Motion = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Motions:
    """What an effect added to the motion of a fit at the p places of a trial: its starts, then a side per axis.

    `added` are (3, r) each: ahead, aside and turned between rows, of all stretches one after another. The sides lie
    beside the place `begun`, None for neutral; `scans` is how many scans ago they were simulated.
    """

    knobs: Knobs
    places: tuple[Array, ...]
    added: tuple[Motion, ...]
    begun: int | None
    scans: int = 0

    @property
    def at(self) -> Array:
        """Where the trial began (m,)."""
        return np.array(self.knobs.neutral) if self.begun is None else self.places[self.begun]

    @cached_property
    def slope_of(self) -> Array:
        """Amounts (p, m) of what the places add, of which the slope where the trial began is made."""
        count = self.knobs.count
        first = len(self.places) - count
        out = np.zeros((len(self.places), count))
        for axis in range(count):
            step = self.places[first + axis][axis] - self.at[axis]
            out[first + axis, axis] = 1.0 / step
            if self.begun is not None:
                out[self.begun, axis] = -1.0 / step
        return out


Seen = Mapping[str, Motions]


@dataclass(frozen=True, eq=False)
class Promise:
    """What a trial would begin with at coordinates `at`: its slope (n, m), the gain there, and with a straight line.

    `whole` is the most of what straight lines promise from there and from other starts.
    """

    knobs: Knobs
    at: Array
    slope: Array
    gain: float
    whole: float


def older(seen: Seen) -> dict[str, Motions]:
    """Motions for the next scan, without those that are too old by then."""
    return {name: replace(one, scans=one.scans + 1) for name, one in seen.items() if one.scans + 1 < OLDEST}


@dataclass(frozen=True, eq=False)
class Foresight:
    """What is foreseen beside a fit; `project` takes out its columns, and `left` (n,) is what that leaves."""

    bench: Bench
    fit: Fit
    project: Projector
    left: Array

    def promises(self, seen: Seen, names: Collection[str]) -> dict[str, Promise]:
        """What earlier trials promise of some causes, by name."""
        return {name: self._promise(one) for name, one in seen.items() if name in names}

    def hopeless(self, promise: Promise, worth: float) -> Tried | None:
        """The cause as a trial would leave it that began with far less than is asked; None where it may begin so."""
        if promise.whole >= FORESEEN * needed(worth):
            return None
        slope = side_by_side([self.project(one) for one in promise.slope.T], len(self.left))
        return Tried(promise.knobs, promise.at, promise.gain, slope, False, promise.at, foreseen=promise.whole)

    def motions(self, one: Tried) -> dict[str, Motions]:
        """The motions of a trial by its name, to be asked for right after it; none where it shows beside the path."""
        return {one.knobs.id: self._motions(one)} if self._moves_path(one.knobs) else {}

    def _moves_path(self, knobs: Knobs) -> bool:
        """Whether an effect that was not searched for shows in the path alone."""
        blocks = {PATH, POSITION}
        if all(stretch.wheel is None for stretch in self.bench.course.stretches):
            blocks |= {STEERING}
        return block_of(knobs.id) in blocks and not effect(knobs.id).kind.searched

    @cached_property
    def _moves(self) -> list[Increments]:
        return self.bench.path(self.fit.settings)

    @cached_property
    def _now(self) -> Array:
        return self.bench.path_surprise(self._moves, self.fit.settings)

    def _motions(self, one: Tried) -> Motions:
        """The motions of a trial on this fit, which are kept of it: see replay.keeping."""
        assert one.begun is not None
        knobs = one.knobs
        starts = [np.array(at) for at in knobs.starts if at != knobs.neutral]
        begun = next((k for k, at in enumerate(starts) if np.array_equal(at, one.begun)), None)
        places = (*starts, *sides_of(knobs, one.begun))
        return Motions(knobs, places, tuple(self._added(knobs, at) for at in places), begun)

    def _added(self, knobs: Knobs, at: Array) -> Motion:
        moves = self.bench.path(settings_of([*self.fit.parts, (knobs, at)]))
        parts = [
            np.stack([one.ahead - now.ahead, one.aside - now.aside, one.turned - now.turned])
            for one, now in zip(moves, self._moves, strict=True)
        ]
        return np.concatenate(parts, axis=1).astype(np.float32)

    def _promise(self, motions: Motions) -> Promise:
        columns = side_by_side(
            [self._column(motions.knobs, *one) for one in zip(motions.places, motions.added, strict=True)],
            len(self.left),
        )
        square, side = self.project.products(columns), crossed(columns, self.left)
        amounts, gain, there = motions.slope_of, 0.0, side
        if motions.begun is not None:
            there = side + square[motions.begun]
            gain = -float(2.0 * side[motions.begun] + square[motions.begun, motions.begun])
        whole = gain + promised(amounts.T @ square @ amounts, amounts.T @ there)
        starts = range(len(motions.places) - motions.knobs.count)
        each = [promised(square[k : k + 1, k : k + 1], side[k : k + 1]) for k in starts]
        slope = side_by_side([without(np.zeros(len(self.left)), columns, -one) for one in amounts.T], len(self.left))
        return Promise(motions.knobs, motions.at, slope, max(gain, 0.0), max([whole, *each]))

    def _column(self, knobs: Knobs, at: Array, added: Motion) -> Array:
        """What motions that are added to those of the fit change of the surprises (n,)."""
        moves, first = [], 0
        for now in self._moves:
            ahead, aside, turned = added[:, first : first + len(now.ahead)]
            moves.append(Increments(now.ahead + ahead, now.aside + aside, now.turned + turned))
            first += len(now.ahead)
        out = np.zeros(len(self.left))
        path = self.bench.path_surprise(moves, settings_of([*self.fit.parts, (knobs, at)])) - self._now
        out[: len(path)] = path
        return out
