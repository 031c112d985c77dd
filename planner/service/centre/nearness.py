"""Two tractors that are too near: for how long they stand, so that nobody goes on and is stopped again and again.

What stops them and what lets them go on is apart by a distance (guard.release) and a time (`release_s`): the alarm of a
pair is over when the two have been farther apart than that for so long, and who stands goes on when its way has been
clear for so long, one after the other. Two that stand nearer than what would stop them may part: while they do, and
come no nearer than they were, they are not stopped for it again.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from planner.service.centre.guard import CONTACT_M, Danger

SLACK_M = 0.05  # noise of places, by which two that part may seem to come nearer
STUCK_S = 10.0  # after which an operator is told that nobody of those that stand can go on

Pair = tuple[int, int]


class Nearness:
    """Since when pairs are clear, ways are free, and which pairs part; times in seconds of the centre's clock."""

    def __init__(self, release_s: float, stuck_s: float) -> None:
        self.release_s, self.stuck_s = release_s, stuck_s
        self._clear_since: dict[Pair, float] = {}
        self._free_since: dict[int, float] = {}
        self._stands_since: dict[int, float] = {}
        self._parting: dict[Pair, float] = {}

    @property
    def watched(self) -> bool:
        """Whether any two were let part that are not apart yet, as far as was looked."""
        return bool(self._parting)

    def parts(self, danger: Danger) -> bool:
        """Whether two that are too near were let part, and come no nearer than they were then."""
        if danger.second is None:
            return False
        apart_m = self._parting.get((danger.first, danger.second))
        return apart_m is not None and danger.least_m >= max(apart_m - SLACK_M, CONTACT_M)

    def endangered(self, first: int, second: int) -> None:
        """Two have to stand, or will have to."""
        self._clear_since.pop((first, second), None)
        self._parting.pop((first, second), None)

    def over(
        self, pairs: Collection[Pair], close: Mapping[Pair, float], standing: Collection[int], now: float
    ) -> list[Pair]:
        """Which of these pairs have been apart for long enough; `close` are those that are not, and who of them is
        `standing` for it still would come near if it went on."""
        for pair in list(self._parting):
            if pair not in close:
                del self._parting[pair]
        clear = [pair for pair in pairs if pair not in close and not any(number in standing for number in pair)]
        self._clear_since = {pair: self._clear_since.get(pair, now) for pair in clear}
        return [pair for pair, since in self._clear_since.items() if now - since >= self.release_s]

    def free(self, ways: Mapping[int, bool], now: float) -> list[int]:
        """Whose way has been free for long enough, of those that stand: `ways` by tractor whether it is free now."""
        self._free_since = {number: self._free_since.get(number, now) for number, is_free in ways.items() if is_free}
        self._stands_since = {number: self._stands_since.get(number, now) for number in ways}
        return [number for number, since in self._free_since.items() if now - since >= self.release_s]

    def stuck(self, number: int, now: float) -> bool:
        """Whether one stands for so long, and cannot go on, that somebody has to help."""
        since = self._stands_since.get(number)
        return since is not None and number not in self._free_since and now - since >= self.stuck_s

    def goes(self, number: int, close: Mapping[Pair, float]) -> None:
        """One goes on; all others wait until it is seen how."""
        self._parting |= {pair: metres for pair, metres in close.items() if number in pair}
        self._free_since.clear()
        self._stands_since.clear()
