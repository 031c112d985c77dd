"""What stands in the way: obstacles that tractors report and operators draw, and those that nobody can read.

A tractor that tells of an obstacle which cannot be read (no polygon, too many corners, a frame that is cut off) faces
something, and nobody knows where. Driving on would be to bet that it is small and aside; to stop everybody would let
one faulty sensor stop a fleet. So that tractor alone is held, however it is driven: where the obstacle lies is unknown,
but it is in reach of the one that sees it. Its stream goes on, as states that can be read are still the best that is
known of it. It is held until

- an operator has looked and acknowledges the alarm, which has the sentence why the frame was refused. That counts for
  the place: the tractor may pass what was looked at, and report it again and again, within LOOKED_M; farther on what
  cannot be read holds it anew, as that may be something else;
- or it reports an obstacle that can be read, and none that cannot for SETTLED_S: that is then what it sees, with a
  place, and blocks what it touches. A state is no such word: it says where the tractor is, not what stands before it.

Frames that do not even name themselves obstacles hold nobody. Who sends nothing else is silent, and stands for that.
"""

from __future__ import annotations

import math

from planner.service.centre.alarms import CRITICAL, WARNING
from planner.service.centre.core import Core
from planner.service.centre.errors import CentreError
from planner.service.centre.obstacles import Block, Ring
from planner.service.centre.tractors import UNREAD

LOOK_S = 1.0  # after it was told of, in which nobody can have looked
LOOKED_M = 15.0  # from where it stood, in which a tractor passes what an operator has looked at
SETTLED_S = 2.0  # without an unreadable frame, after which a readable one stands for what is seen
UNREAD_CODE = "unread obstacle"


class Seeing(Core):
    """A fleet that is told of obstacles; `seen_by` is the tractor that tells, None for an operator."""

    def obstacle(self, who: str, ring: Ring, name: str, now: float, seen_by: int | None = None) -> Block:
        """Something stands there: legs that it touches are released no more, who is driving at it stands.

        What the same one has told of already is no new one. Raises CentreError for what cannot be kept; the tractor
        that sees it is then held as for one that cannot be read.
        """
        block = self.obstacles.known(ring, who)
        if block is None:
            try:
                block = self.obstacles.add(ring, name, who)
            except CentreError as refusal:
                if seen_by is not None:
                    self.unreadable(seen_by, str(refusal), now)
                raise
            self._reblock()
            touched = sum(len(blocked) for blocked in self.blocked)
            self._alarm(f"obstacle {block.id}", None, WARNING, f"Obstacle {name!r} blocks {touched} legs.", now)
            self.note(who, "obstacle", obstacle=block.id, name=name, legs=touched)
        if seen_by is not None:
            self.states[seen_by].read_s = now
            self.read_again(now)
        return block

    def unreadable(self, number: int, sentence: str, now: float) -> None:
        """A tractor tells of an obstacle that cannot be read; `sentence` says why. It stands, see above."""
        state = self.states[number]
        state.unread_s = now
        if UNREAD in state.holds or self._looked(number):
            return
        state.holds.add(UNREAD)
        state.faces_s = now
        self.note(f"tractor {number + 1}", UNREAD_CODE, tractor=number + 1, sentence=sentence)
        told = (f"Tractor {number + 1} sees an obstacle that could not be taken, and stands. {sentence} Look what is "
                "there before you let it go on.")  # fmt: skip
        self._alarm(UNREAD_CODE, number, CRITICAL, told, now)
        self._stand(number, UNREAD)

    def _looked(self, number: int) -> bool:
        """Whether a tractor is still where an operator has looked for what it sees."""
        state = self.states[number]
        if state.looked_at is None or state.report is None:
            return False
        if math.dist(state.looked_at, (state.report.x_m, state.report.y_m)) > LOOKED_M:
            state.looked_at = None
        return state.looked_at is not None

    def read_again(self, now: float) -> None:
        """Who has told of an obstacle that can be read, and of none that cannot for a while, is held no more."""
        for number, state in enumerate(self.states):
            if UNREAD in state.holds and state.read_s > state.unread_s and now - state.unread_s >= SETTLED_S:
                self._let_go(number)

    def looked(self, who: str, number: int, now: float) -> None:
        """An operator has looked what a tractor sees that cannot be read: for that it stands no more.

        Raises CentreError as check_looked.
        """
        state = self.states[number]
        if UNREAD not in state.holds:
            return
        self.check_looked(number, now)
        state.looked_at = None if state.report is None else (state.report.x_m, state.report.y_m)
        self.note(who, "looked", tractor=number + 1)
        self._let_go(number)

    def check_looked(self, number: int, now: float) -> None:
        """Raise CentreError where a tractor has told just now of what cannot be read: what was looked at is another."""
        state = self.states[number]
        if UNREAD in state.holds and now - state.faces_s < LOOK_S:
            raise CentreError(f"Tractor {number + 1} has told just now of an obstacle that cannot be read; look what "
                              "is there, and let it go on then.", parameter="tractor")  # fmt: skip

    def faced_by(self, alarm: int) -> int | None:
        """The tractor that goes on once this alarm is acknowledged; None for all other alarms."""
        found = (each.tractor for each in self.alarms.items() if each.id == alarm and each.code == UNREAD_CODE)
        number = next(found, None)
        return number if number is not None and UNREAD in self.states[number].holds else None

    def _let_go(self, number: int) -> None:
        self.states[number].holds.discard(UNREAD)
        self.alarms.ended(UNREAD_CODE, number)
        self._settle()

    def clear(self, who: str, number: int, now: float) -> None:
        """An obstacle is gone."""
        self.obstacles.clear(number)
        self.alarms.ended(f"obstacle {number}", None)
        self.note(who, "cleared", obstacle=number)
        self._reblock()

    def acknowledge(self, who: str, alarm: int, now: float) -> None:
        """Somebody has seen an alarm; that of an obstacle that cannot be read lets its tractor go on.

        Raises CentreError as check_looked, or where there is no such alarm.
        """
        number = self.faced_by(alarm)
        if number is not None:
            self.looked(who, number, now)
        self.alarms.acknowledge(alarm, who)
        self.note(who, "acknowledge", alarm=alarm)
