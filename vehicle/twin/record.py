"""A run as a log in the project's columns: what was commanded and what was measured, one row per fix."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vehicle.measured.logs.record import Log

COLUMNS = (
    "time_s", "easting_m", "northing_m", "heading_deg", "speed_mps", "speed_command_mps", "steering_command_deg",
    "shuttle", "implement",
)  # fmt: skip
STANDING_MPS = 0.03


class Recording:
    """What a link carried. Rows of fixes are kept in the order of their times, with the command that held then."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._commands: list[tuple[float, float, float]] = []
        self._fixes: dict[float, tuple[float, float, float, float]] = {}

    def commanded(self, time_s: float, steering_rad: float, speed_mps: float, implement: float) -> None:
        """A command from a time on; one that repeats the last is not kept again."""
        place = bisect_right(self._times, time_s)
        command = (steering_rad, speed_mps, implement)
        if place and self._commands[place - 1] == command:
            return
        self._times.insert(place, time_s)
        self._commands.insert(place, command)

    def measured(self, time_s: float, x_m: float, y_m: float, heading_rad: float, speed_mps: float) -> None:
        """A fix, in the frame of vehicle.twin.twin.Fix."""
        self._fixes[time_s] = (x_m, y_m, heading_rad, speed_mps)

    def __len__(self) -> int:
        return len(self._fixes)

    def rows(self, origin_m: tuple[float, float] = (0.0, 0.0)) -> list[tuple[float, ...]]:
        """One row per fix in COLUMNS, positions with the plan's origin added; speeds are 0 or more."""
        out: list[tuple[float, ...]] = []
        for time_s, (x, y, heading, speed) in sorted(self._fixes.items()):
            place = bisect_right(self._times, time_s)
            steering, target, implement = self._commands[place - 1] if place else (0.0, 0.0, 0.0)
            moving = target if abs(target) > STANDING_MPS else speed if abs(speed) > STANDING_MPS else 1.0
            out.append((
                round(time_s, 4), round(origin_m[0] + x, 4), round(origin_m[1] + y, 4),
                round((90.0 - math.degrees(heading)) % 360.0, 3), round(abs(speed), 4), round(abs(target), 4),
                round(math.degrees(steering), 4), math.copysign(1.0, moving), implement,
            ))  # fmt: skip
        return out

    def csv(self, origin_m: tuple[float, float] = (0.0, 0.0)) -> str:
        """The log as text that `headland diagnose` reads."""
        lines = [",".join(COLUMNS)]
        for row in self.rows(origin_m):
            lines.append(",".join(f"{value:.10g}" for value in row))
        return "\n".join(lines) + "\n"

    def log(self, name: str) -> Log:
        """The log as an object. Raises LogError where it is too short, or the tractor never moved."""
        import pandas as pd

        from vehicle.measured.logs.reading import log_from_frame

        return log_from_frame(pd.DataFrame(self.rows(), columns=list(COLUMNS)), name)
