"""The result of a simulation: outcome, 10 Hz record and times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vehicle.arrays import Floats, Integers, Records
from vehicle.missions.plan import LEAVE, Plan
from vehicle.records import REC_LEG, REC_POSE, REC_SPEED, REC_STATUS, REVERSING, STANDING, TURNING, WAITING, WORKING

DONE, CONFLICT, STALL, TIMEOUT = "done", "conflict", "stall", "timeout"


@dataclass(frozen=True)
class Conflict:
    """Two tractors that came too close: when, which, and for each the leg and the metres driven on it."""

    time_s: float
    first: int
    second: int
    first_leg: int
    second_leg: int
    first_m: float = 0.0
    second_m: float = 0.0


@dataclass(frozen=True)
class Stall:
    """A tractor that got stuck or ran away, where, and what it lacked: "drive force", "grip", "power" or "brakes".

    `leg` counts from the first of its mission, `grade` is the rise per metre in its direction of travel. `needed_n` is
    the thrust that would have kept it going there (for brakes: the force that would have held it), `available_n` what
    there was.
    """

    time_s: float
    tractor: int
    leg: int
    x_m: float
    y_m: float
    grade: float
    lacking: str
    needed_n: float
    available_n: float


@dataclass(frozen=True)
class RollOverMargin:
    """How far a tractor stayed from rolling over sideways (rad; negative: it would have), and where it came closest.

    `leg` counts from the first of its mission.
    """

    margin_rad: float
    x_m: float
    y_m: float
    leg: int


@dataclass(frozen=True, eq=False)
class SimulationRun:
    """A simulated plan.

    `time_s` (t,), `record` (t, tractors, 7) at 10 Hz with the columns vehicle.records.RECORD_COLUMNS, `finish_s`
    (tractors,; nan if not finished), `contacts` (time, first, second) at first touch, `min_clearance_m` between any
    two outlines (inf for one tractor). `stall` names the tractor of a run that ended because it could not go on;
    `roll_over` has a margin per tractor, and none where the height of the centre of mass is not known.
    """

    plan: Plan
    outcome: str
    time_s: Floats
    record: Floats
    finish_s: Floats
    contacts: tuple[tuple[float, int, int], ...]
    min_clearance_m: float
    conflict: Conflict | None = None
    stall: Stall | None = None
    roll_over: tuple[RollOverMargin, ...] = ()

    @property
    def duration_s(self) -> float:
        """When the last tractor was done."""
        return float(np.max(self.finish_s))

    @property
    def work_finish_s(self) -> float:
        """When the last tractor finished its work: done, or on its way out of the field."""
        if not any(mission.leaves for mission in self.plan.missions):
            return self.duration_s
        ends = []
        for tractor, mission in enumerate(self.plan.missions):
            end_s = self.finish_s[tractor]
            leave_leg = next((n for n, leg in enumerate(mission.legs) if leg.task.kind == LEAVE), None)
            if leave_leg is not None:
                leave_row = int(np.searchsorted(self.get_leg_numbers(tractor), leave_leg))
                end_s = self.time_s[min(leave_row, len(self.time_s) - 1)]
            ends.append(float(end_s))
        return max(ends)

    @property
    def step_s(self) -> float:
        """Seconds between two rows of the record; 0 where there is only one."""
        return float(self.time_s[1] - self.time_s[0]) if len(self.time_s) > 1 else 0.0

    def get_poses(self, tractor: int) -> Floats:
        """x, y (m) and angle (rad) of the centre of mass of a tractor, shape (t, 3)."""
        return self.record[:, tractor, REC_POSE]

    def get_leg_numbers(self, tractor: int) -> Integers:
        """Number of the leg a tractor is on, shape (t,)."""
        return self.record[:, tractor, REC_LEG].astype(np.int64)

    def get_statuses(self, tractor: int) -> Integers:
        """Status of a tractor, as the constants of vehicle.records, shape (t,)."""
        return self.record[:, tractor, REC_STATUS].astype(np.int64)

    def sum_seconds(self, status: int) -> Floats:
        """Time per tractor in a status of vehicle.records (tractors,)."""
        return np.asarray((self.record[:, :, REC_STATUS] == status).sum(axis=0) * self.step_s)

    def sum_slow_work_m(self, speed_mps: float) -> float:
        """Metres of all tractors worked more slowly than at a speed."""
        speeds = np.abs(self.record[:, :, REC_SPEED])
        is_slow = (self.record[:, :, REC_STATUS] == WORKING) & (speeds < speed_mps)
        return float(speeds[is_slow].sum() * self.step_s)

    @property
    def standing_s(self) -> Floats:
        """Seconds per tractor of standing to refill or unload."""
        return self.sum_seconds(STANDING)

    def compute_time_shares(self) -> dict[str, Records]:
        """Seconds per tractor of working, turning, waiting and reversing."""
        statuses = {"working": WORKING, "turning": TURNING, "waiting": WAITING, "reversing": REVERSING}
        return {name: self.sum_seconds(status) for name, status in statuses.items()}
