"""Hysteresis for tractors that are too near, so that nobody is stopped and resumed again and again.

Stopping and resuming differ by a distance (`SafetyGuard.release_clearances_m`) and a time (`release_s`): the alarm of a
pair ends when the two have been farther apart than that for so long, and a standing tractor resumes when its path has
been clear for so long, one after the other. Two that stand nearer than the stopping distance may move apart: as long as
they come no nearer than they were, they are not stopped again.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from planner.fleet.safety.motion_prediction import TractorKey

CONTACT_M = 0.05  # a distance that counts as contact
PARTING_SLACK_M = 0.05  # noise of positions of two that move apart
STUCK_AFTER_S = 10.0  # after which operators are warned that no standing tractor can resume

NearPair = tuple[int, int | TractorKey]
"""A tractor, and another one of its fleet or of a neighbouring fleet."""


@dataclass(frozen=True)
class SafetyDanger:
    """Two tractors will be too near, or one will leave the fence (`second` is None), in `in_s` seconds.

    `is_urgent` if only the time to stop remains. `distance_m` is the first distance that is too small, and
    `least_distance_m` the smallest predicted. `second` may be a tractor of another fleet.
    """

    first: int
    second: int | TractorKey | None
    in_s: float
    distance_m: float
    is_urgent: bool
    least_distance_m: float = 0.0


def sort_pair(first: int, second: int | TractorKey) -> NearPair:
    """A pair of one fleet has its lower number first."""
    return (min(first, second), max(first, second)) if isinstance(second, int) else (first, second)


class SeparationMonitor:
    """Since when pairs and paths are clear, and which pairs move apart; seconds of the fleet manager's clock."""

    def __init__(self, release_s: float, stuck_s: float) -> None:
        self.release_s, self.stuck_s = release_s, stuck_s
        self._clear_since: dict[NearPair, float] = {}
        self._free_since: dict[int, float] = {}
        self._stands_since: dict[int, float] = {}
        self._parting: dict[NearPair, float] = {}

    @property
    def has_parting_pairs(self) -> bool:
        """Whether any pair is still moving apart."""
        return bool(self._parting)

    def is_parting(self, danger: SafetyDanger) -> bool:
        """Whether a pair in danger is moving apart and comes no nearer than it was."""
        if danger.second is None:
            return False
        distance_m = self._parting.get((danger.first, danger.second))
        return distance_m is not None and danger.least_distance_m >= max(distance_m - PARTING_SLACK_M, CONTACT_M)

    def mark_endangered(self, first: int, second: int | TractorKey) -> None:
        """A pair has to stop, now or soon: it is neither clear nor moving apart."""
        self._clear_since.pop((first, second), None)
        self._parting.pop((first, second), None)

    def find_cleared_pairs(
        self,
        pairs: Collection[NearPair],
        close_pairs: Mapping[NearPair, float],
        standing: Collection[int | TractorKey],
        now: float,
    ) -> list[NearPair]:
        """Which of these pairs have been apart for `release_s`. `close_pairs` are not apart; pairs with a `standing`
        tractor do not count as apart, as it would come near if it resumed."""
        for pair in list(self._parting):
            if pair not in close_pairs:
                del self._parting[pair]
        clear = [pair for pair in pairs if pair not in close_pairs and not any(number in standing for number in pair)]
        self._clear_since = {pair: self._clear_since.get(pair, now) for pair in clear}
        return [pair for pair, since in self._clear_since.items() if now - since >= self.release_s]

    def find_tractors_free_to_resume(self, is_path_clear: Mapping[int, bool], now: float) -> list[int]:
        """Standing tractors whose path has been clear for `release_s`; `is_path_clear` by tractor for now."""
        self._free_since = {
            number: self._free_since.get(number, now) for number, is_free in is_path_clear.items() if is_free
        }
        self._stands_since = {number: self._stands_since.get(number, now) for number in is_path_clear}
        return [number for number, since in self._free_since.items() if now - since >= self.release_s]

    def is_stuck(self, number: int, now: float) -> bool:
        """Whether a tractor has stood for `stuck_s` without a clear path, so that an operator must help."""
        since = self._stands_since.get(number)
        return since is not None and number not in self._free_since and now - since >= self.stuck_s

    def start_parting(self, number: int, close_pairs: Mapping[NearPair, float]) -> None:
        """A tractor resumes; all other standing ones start their waiting time again."""
        self._parting |= {pair: distance_m for pair, distance_m in close_pairs.items() if number in pair}
        self.restart_waiting_times()

    def is_free(self, number: int) -> bool:
        """Whether the path of a standing tractor was clear at the last check."""
        return number in self._free_since

    def restart_waiting_times(self) -> None:
        """A tractor resumes: all standing ones start their waiting time again."""
        self._free_since.clear()
        self._stands_since.clear()
