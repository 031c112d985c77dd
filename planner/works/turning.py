"""The speed in turns at which the simulated turn takes as long as turns were measured to take."""

from __future__ import annotations

from planner.site import RADIUS_MARGIN, SHUNTING_MPS
from strategies.job import Manner
from strategies.timing import TurnClock
from strategies.ways.sizing import allowed_kinds
from vehicle.tractor import Implement, Tractor

SLOWEST_MPS, FASTEST_MPS = 0.3, 5.5
STEPS = 8  # halvings: to a fiftieth of a m/s
ROOM_M = 1e3
SOIL = "soil"


class TurnSpeed:
    """Turns of one tractor with one implement over so many tracks, worked at a speed."""

    def __init__(self, tractor: Tractor, implement: Implement, work_mps: float, over: int) -> None:
        """Take the machines; nothing is simulated yet."""
        self.tractor, self.implement, self.work_mps, self.over = tractor, implement, work_mps, over

    def seconds(self, turn_mps: float) -> float | None:
        """Simulated seconds of the quickest turn that fits a headland deep enough for all; None where none is."""
        manner = Manner(
            work_speed_mps=self.work_mps,
            turn_speed_mps=turn_mps,
            reverse_speed_mps=min(turn_mps, SHUNTING_MPS),
            radius_m=RADIUS_MARGIN * self.tractor.smallest_radius_m(SOIL),
            tool_m=self.implement.hitch_m,
        )
        clock = TurnClock(self.tractor, self.implement, manner, SOIL)
        times = clock.best_times(self.implement.width_m, ROOM_M, allowed_kinds("auto"))
        last = min(self.over, len(times) - 1)
        timed = times[last]
        across_m = (self.over - last) * self.implement.width_m  # over more tracks than that it drives straight across
        return None if timed is None else timed + across_m / turn_mps

    def for_seconds(self, seconds: float) -> float | None:
        """The speed (m/s) whose turn takes so long, by halving; None where none from 0.3 to 5.5 m/s does."""
        low, high = SLOWEST_MPS, FASTEST_MPS
        slowest, quickest = self.seconds(low), self.seconds(high)
        if slowest is None or quickest is None or not quickest <= seconds <= slowest:
            return None
        for _ in range(STEPS):
            middle = 0.5 * (low + high)
            took = self.seconds(middle)
            if took is None:
                return None
            low, high = (low, middle) if took < seconds else (middle, high)
        return 0.5 * (low + high)
