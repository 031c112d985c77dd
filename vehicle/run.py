"""What came out of a simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.layout import REC_LEG, REC_POSE, REC_STATUS, REVERSING, STANDING, TURNING, WAITING, WORKING
from vehicle.missions import LEAVE, Plan

DONE, CONFLICT, STALL, TIMEOUT = "done", "conflict", "stall", "timeout"


@dataclass(frozen=True)
class Conflict:
    """Two tractors that came too close: when, who, on which of their legs and how many metres into it."""

    time_s: float
    first: int
    second: int
    first_leg: int
    second_leg: int
    first_m: float = 0.0
    second_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Run:
    """A simulated plan.

    `time_s` (t,), `record` (t, tractors, 7) with the columns of vehicle.layout.RECORD at 10 Hz, `finish_s`
    (tractors,; nan when not finished), `contacts` (time, first, second) at first touch, `min_clearance_m` between
    any two outlines (inf for one tractor).
    """

    plan: Plan
    outcome: str
    time_s: npt.NDArray[np.float64]
    record: npt.NDArray[np.float64]
    finish_s: npt.NDArray[np.float64]
    contacts: tuple[tuple[float, int, int], ...]
    min_clearance_m: float
    conflict: Conflict | None = None

    @property
    def duration_s(self) -> float:
        """When the last tractor was done."""
        return float(np.max(self.finish_s))

    @property
    def worked_s(self) -> float:
        """When the last tractor was through with its work: done, or on its way out of the field."""
        if not any(mission.leaves for mission in self.plan.missions):
            return self.duration_s
        ends = []
        for tractor, mission in enumerate(self.plan.missions):
            out = next((n for n, leg in enumerate(mission.legs) if leg.task.kind == LEAVE), None)
            gone = None if out is None else int(np.searchsorted(self.leg(tractor), out))
            ends.append(float(self.finish_s[tractor] if gone is None else self.time_s[min(gone, len(self.time_s) - 1)]))
        return max(ends)

    def poses(self, tractor: int) -> npt.NDArray[np.float64]:
        """x, y (m) and angle (rad) of the centre of mass of a tractor, shape (t, 3)."""
        return self.record[:, tractor, REC_POSE]

    def leg(self, tractor: int) -> npt.NDArray[np.int64]:
        """Number of the leg a tractor is on, shape (t,)."""
        return self.record[:, tractor, REC_LEG].astype(np.int64)

    def status(self, tractor: int) -> npt.NDArray[np.int64]:
        """Status of a tractor as in vehicle.layout, shape (t,)."""
        return self.record[:, tractor, REC_STATUS].astype(np.int64)

    def seconds(self, status: int) -> npt.NDArray[np.float64]:
        """Time per tractor in a status of vehicle.layout (tractors,)."""
        step = float(self.time_s[1] - self.time_s[0]) if len(self.time_s) > 1 else 0.0
        return np.asarray((self.record[:, :, REC_STATUS] == status).sum(axis=0) * step)

    @property
    def standing_s(self) -> npt.NDArray[np.float64]:
        """Seconds per tractor of standing before legs that ask for it: what is refilled or unloaded."""
        return self.seconds(STANDING)

    def time_shares(self) -> dict[str, npt.NDArray[Any]]:
        """Seconds per tractor of working, turning, waiting and reversing."""
        return {
            "working": self.seconds(WORKING),
            "turning": self.seconds(TURNING),
            "waiting": self.seconds(WAITING),
            "reversing": self.seconds(REVERSING),
        }
