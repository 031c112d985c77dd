"""Whether a remote command is of now: one that was held up on its way must not set a tractor in motion."""

from __future__ import annotations

from planner.service.centre.errors import CentreError
from planner.service.links.frames import Acknowledge, Begin, Drive, GoOn

AHEAD_S = 0.5  # of the service's clock that a client's may be
ORDER_S = 2.0  # age up to which an order to go on is carried out


class Freshness:
    """The last sequence of the commands to each tractor since its lease was taken."""

    def __init__(self, latest_s: float) -> None:
        self.latest_s = latest_s  # age up to which a command is carried out
        self._last: dict[int, int] = {}

    def leased(self, tractor: int) -> None:
        """Somebody takes a tractor: sequences begin anew."""
        self._last.pop(tractor, None)

    def check(self, frame: Drive, moves: bool, clock_s: float) -> None:
        """Raise CentreError for a command that is too old, or older than one before; `clock_s` is since 1970.

        One to stand (not `moves`) is never too old.
        """
        age_s = clock_s - frame.time.timestamp()
        last = self._last.get(frame.tractor, -1)
        if not moves:
            self._last[frame.tractor] = max(frame.sequence, last)
            return
        if frame.sequence <= last:
            raise CentreError(f"Command {frame.sequence} comes after command {last} and is not carried out; give each "
                              "a higher sequence.", parameter="sequence")  # fmt: skip
        if not -AHEAD_S <= age_s <= self.latest_s:
            raise CentreError(f"The command is {age_s:.2f} s old and is not carried out; it must be at most "
                              f"{self.latest_s:g} s old by the clock of the service.", parameter="time")  # fmt: skip
        self._last[frame.tractor] = frame.sequence


def check_order(frame: Begin | GoOn | Acknowledge, clock_s: float) -> None:
    """Raise CentreError for an order to go on that was held up; `clock_s` is since 1970. One without time passes."""
    age_s = 0.0 if frame.time is None else clock_s - frame.time.timestamp()
    if age_s > ORDER_S:
        raise CentreError(f"The order to go on is {age_s:.1f} s old and is not carried out; look at the tractors and "
                          "give it again.", parameter="time")  # fmt: skip
