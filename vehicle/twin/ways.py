"""The two ways in which a twin is corrected by what is measured of the real tractor.

thesis    section 5.2.3: once a second the last fix that came in, old as it is, is where the twin is moved to, smoothly
predict   the fix corrects the twin as it was at the fix's time, as far as each is sure; from there the twin is rolled
          to now along the commands known by now, steering dead time included, turning and slipping as was found out
"""

from __future__ import annotations

import math

import numpy as np

from vehicle.layout import DT_S
from vehicle.twin.belief import SIZE, Belief, measure
from vehicle.twin.doubt import Test
from vehicle.twin.leaps import ANEW_M, Leaps, leapt
from vehicle.twin.motion import Array
from vehicle.twin.rolling import Commands, Rolled, antenna_of, roll_believing

OLDEST = 240  # steps that a fix may be late: 4 s
GATE = 8.0  # standard deviations beyond which a fix is absurd; three in a row are believed all the same
PATIENCE = 3
LOST_M, LOST_RAD = 0.05, 0.02  # how sure the twin is of a place it was moved to
EVERY, BLEND = 60, 12  # steps between two corrections of the thesis, and over which one is spread (assumed: 0.2 s)
STANDING = np.zeros(2)


class Anchor:
    """The twin as it was at the last fix, with what the tracker and the witness believe; it never is ahead of now."""

    def __init__(self, rolled: Rolled, tracker: Belief, witness: Belief, test: Test) -> None:
        self.rolled, self.tracker, self.witness, self.test = rolled, tracker, witness, test
        self._before = np.zeros(2)
        self._absurd = 0
        self.rejected = 0
        self.leaps = Leaps()
        self.taken = 0
        self.clear = np.zeros((4, 0))

    @property
    def learnt(self) -> Array:
        """Turn (rad per m) and slip (share) besides the model's."""
        return self.tracker.estimate[3:5]

    def to(self, step: int, commands: Commands) -> None:
        """Roll on to a step."""
        rolled, one, two = self.rolled, self.tracker, self.witness
        if step <= rolled.step:
            return
        commands.extend(step)
        roll_believing(
            step - rolled.step, rolled.step, DT_S, rolled.state, rolled.body, commands.ring, *rolled.parts,
            self._before, one.estimate, one.cov, one.spec, two.estimate, two.cov, two.spec, self.test.shifts,
            self.test.sizes,
        )  # fmt: skip
        rolled.step = step
        one.estimate[:3] = rolled.body[:3]

    def take(self, fix: Array, time_s: float, telling: bool = True) -> Array:
        """Correct by a fix (4,) of this very step; hands back measured less foretold (3,): ahead, right, turned.

        One that is not `telling`, because too little is known of what was commanded before it, says nothing for or
        against the tractor's file: the witness begins anew at the place.
        """
        rolled, tracker = self.rolled, self.tracker
        off, pose = self._apart(fix), rolled.body[:3].copy()
        kept = tracker.estimate.copy(), tracker.cov.copy()
        if not self._tracked(fix):
            self._lost(fix, time_s, off)
            return off
        again, self._absurd = self._absurd > 0, 0
        self.taken += 1
        if telling and self._told(fix, time_s, off, again):
            tracker.estimate[:], tracker.cov[:] = kept
            tracker.unsure_of_place(ANEW_M)
            self._tracked(fix)
        moved = tracker.estimate[:3] - pose
        rolled.shift(float(moved[0]), float(moved[1]), float(moved[2]))
        if not telling:
            self.witness.start(tracker.estimate[:3], LOST_M, LOST_RAD)
            self.test.shifts[:] = 0.0
        return off

    def _tracked(self, fix: Array) -> bool:
        """Correct the tracker; False, and nothing is changed, by a fix that is absurd."""
        tracker, rolled, machine = self.tracker, self.rolled, self.rolled.machine
        return measure(
            tracker.estimate, tracker.cov, tracker.spec, fix, machine.ahead_m, machine.right_m, rolled.forward_mps,
            float(rolled.body[5]), self._before[1], np.zeros((0, SIZE)), np.zeros(0), GATE, np.zeros(4), self.clear,
        )  # fmt: skip

    def _told(self, fix: Array, time_s: float, off: Array, again: bool) -> bool:
        """Correct the witness, and count its surprise for or against the file: whether the fix may have leapt.

        With `again` it comes after absurd ones, whose leap is told already.
        """
        witness, test = self.witness, self.test
        kept = witness.estimate.copy(), witness.cov.copy(), test.shifts.copy()
        self._witnessed(fix, test.whitened, test.means)
        sudden = leapt(test.whitened)
        if sudden:  # the place is believed, and of what it says no more than its surprise counts
            witness.estimate[:], witness.cov[:], test.shifts[:] = kept
            witness.unsure_of_place(ANEW_M)
            self._witnessed(fix, np.zeros(4), np.zeros_like(test.means))
        before, this = self.leaps.take(time_s, off, sudden and not again)
        test.take(time_s, before)
        return this or (again and sudden)

    def _witnessed(self, fix: Array, whitened: Array, means: Array) -> None:
        """Correct the witness, and what effects would have shifted; surprises and what effects make of them go out."""
        witness, rolled, machine, test = self.witness, self.rolled, self.rolled.machine, self.test
        measure(
            witness.estimate, witness.cov, witness.spec, fix, machine.ahead_m, machine.right_m, rolled.forward_mps,
            float(rolled.body[5]), -1.0, test.shifts, test.sizes, math.inf, whitened, means,
        )  # fmt: skip

    def _apart(self, fix: Array) -> Array:
        """How far a fix lies from what is foretold: ahead, to the right (m), turned (rad)."""
        body = self.rolled.body
        x, y = antenna_of(self.rolled.machine, body[:3])
        east, north, turned = fix[0] - x, fix[1] - y, fix[2] - body[2]
        cosine, sine = math.cos(body[2]), math.sin(body[2])
        return np.array([
            east * cosine + north * sine, east * sine - north * cosine, math.atan2(math.sin(turned), math.cos(turned)),
        ])

    def _lost(self, fix: Array, time_s: float, off: Array) -> None:
        """An absurd fix: left out, unless several in a row are; then the tractor is where they say."""
        self.rejected += 1
        if self._absurd == 0:
            self.leaps.absurd(time_s, off)
        self._absurd += 1
        if self._absurd < PATIENCE:
            return
        self._absurd = 0
        body = self.rolled.body
        x, y = antenna_of(self.rolled.machine, np.array([0.0, 0.0, fix[2]]))
        turned = math.remainder(fix[2] - body[2], 2.0 * math.pi)
        self.rolled.shift(fix[0] - x - body[0], fix[1] - y - body[1], turned)
        for belief in (self.tracker, self.witness):
            belief.start(body[:3], LOST_M, LOST_RAD)
        self.test.shifts[:] = 0.0


class Predicting:
    """Prediction over a fix's age: now is the anchor rolled on."""

    def __init__(self, anchor: Anchor, commands: Commands) -> None:
        self.anchor, self.commands = anchor, commands
        self.rolled = anchor.rolled.copy()

        self._stale = False

    def commanded(self, step: int, command: Array) -> None:
        """A command from a step on; what was driven since is driven again."""
        self._stale = self._stale or step < self.rolled.step

    def corrected(self, step: int, fix: Array) -> None:
        """The anchor has taken a fix."""
        self._stale = True

    def to(self, step: int) -> None:
        """Roll on to a step."""
        if self._stale:
            self.rolled, self._stale = self.anchor.rolled.copy(), False
        self.rolled.to(step, self.commands, self.anchor.learnt)

    @property
    def learnt(self) -> Array:
        """Turn and slip besides the model's."""
        return self.anchor.learnt


class Following:
    """The thesis's way: commands count when they come in, and once a second the last fix is where the twin goes."""

    def __init__(self, anchor: Anchor, commands: Commands) -> None:
        self.rolled = anchor.rolled.copy()
        self.learnt = STANDING
        self.commands = Commands(float(commands.held[0]), float(commands.held[1]))
        self.applied: list[tuple[int, Array]] = []
        self._fix: Array | None = None
        self._left, self._shift = 0, np.zeros(3)

    def commanded(self, step: int, command: Array) -> None:
        """A command that has come in now."""
        self.commands.set(self.rolled.step, command)

    def corrected(self, step: int, fix: Array) -> None:
        """A fix has come in."""
        self._fix = fix

    def to(self, step: int) -> None:
        """Roll on to a step, with the corrections that fall due on the way."""
        while self.rolled.step < step:
            now = self.rolled.step
            if now % EVERY == 0 and now > 0 and self._fix is not None:
                self._due()
            until = min(step, now + 1 if self._left else (now // EVERY + 1) * EVERY)
            self.rolled.to(until, self.commands, STANDING)
            if self._left:
                self._left -= 1
                self.rolled.shift(*(float(value) for value in self._shift))

    def _due(self) -> None:
        """Begin to move the twin to the last fix."""
        fix, body = self._fix, self.rolled.body
        assert fix is not None
        turned = math.remainder(float(fix[2]) - float(body[2]), 2.0 * math.pi)
        x, y = antenna_of(self.rolled.machine, body[:3])
        there = antenna_of(self.rolled.machine, np.array([body[0], body[1], body[2] + turned]))
        east, north = fix[0] - there[0], fix[1] - there[1]
        self._shift = np.array([east, north, turned]) / BLEND
        self._left = BLEND
        cosine, sine = math.cos(body[2]), math.sin(body[2])
        dx, dy = fix[0] - x, fix[1] - y
        self.applied.append((self.rolled.step, np.array([dx * cosine + dy * sine, dx * sine - dy * cosine, turned])))
        self._fix = None
