"""What each tractor of a plan does when nobody is in its way: where its outline is, when, and where it may stand."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.layout import REC_ANGLE, REC_PLACE
from vehicle.meetings import Trail, poses_of
from vehicle.missions import THROUGH_M, Gate, Mission, Plan
from vehicle.run import DONE, Run

STEP_M = 0.8  # between poses of a course
MOST_POSES = 1_000_000  # of courses that are kept
TURNED_M = 3.0  # of driving count as much as a radian of turning
Floats = npt.NDArray[np.float64]
Alone = Callable[[Mission], Run]
"""Drives one mission with nobody else on the field."""


@dataclass(frozen=True, eq=False)
class Course:
    """One tractor's way, driven alone without a stop: `poses` (k,) as vehicle.meetings has them, `time_s` (k,).

    `holds` are places in these at which it may stand, the start first and the end of all last, each before leg
    `hold_legs[number]`; between two of them lies a stretch. Of every pose `leg` and `metres` (k,) tell how far it is.
    One that `enters` the field is not on it at its start, one that `leaves` it not at its end.
    """

    poses: npt.NDArray[np.void]
    time_s: Floats
    leg: npt.NDArray[np.int64]
    metres: Floats
    holds: tuple[int, ...]
    hold_legs: tuple[int, ...]
    enters: bool = False
    leaves: bool = False

    def stands_at(self, hold: int) -> bool:
        """Whether a tractor at a hold point is on the field, by its number."""
        return not ((hold == 0 and self.enters) or (hold == self.stretches and self.leaves))

    @cached_property
    def trail(self) -> Trail:
        """Its poses, ready to be held against those of others."""
        return Trail(self.poses)

    @property
    def stretches(self) -> int:
        """Number of ways from one hold point to the next."""
        return len(self.holds) - 1

    def begins_s(self, stretch: int) -> float:
        """When a stretch begins; for the number of stretches when the last one ends."""
        return float(self.time_s[self.holds[stretch]])

    def lasts_s(self, stretch: int) -> float:
        """How long a stretch takes."""
        return self.begins_s(stretch + 1) - self.begins_s(stretch)

    def without(self, holds: set[int]) -> Course:
        """The same course with these hold points, by number, not used."""
        kept = [number for number in range(len(self.holds)) if number not in holds]
        return replace(self, holds=tuple(self.holds[n] for n in kept), hold_legs=tuple(self.hold_legs[n] for n in kept))

    def passes(self, leg: int, metres: float) -> tuple[int, float]:
        """The stretch in which a place on a leg is passed, and when, from the beginning of that stretch (s)."""
        first = int(np.searchsorted(self.leg, leg))
        last = int(np.searchsorted(self.leg, leg, "right"))
        place = min(first + int(np.searchsorted(self.metres[first:last], metres)), len(self.leg) - 1)
        stretch = min(max(int(np.searchsorted(self.holds, place, "left")) - 1, 0), self.stretches - 1)
        return stretch, float(self.time_s[place]) - self.begins_s(stretch)

    def gate(self, tractor: int, stretch: int, after_s: float, legs: Mission) -> Gate:
        """Gate that opens when the tractor, whose course this is, has been on a stretch for so long."""
        at = self.begins_s(stretch) + min(max(after_s, 0.0), self.lasts_s(stretch))
        place = min(int(np.searchsorted(self.time_s, at)), self.holds[stretch + 1])
        place = max(place, min(self.holds[stretch] + 1, self.holds[stretch + 1]))
        leg, metres = int(self.leg[place]), float(self.metres[place])
        if place == self.holds[stretch + 1] and leg == self.hold_legs[stretch + 1] and leg > 0 and metres < STEP_M:
            leg, metres = leg - 1, legs.legs[leg - 1].length_m
        return Gate(tractor, leg, max(0.0, min(metres, legs.legs[leg].length_m - THROUGH_M)))


@dataclass
class Known:
    """What plans of one site share: `courses` by what was driven, `met` as of vehicle.meetings by the two that meet.

    All is forgotten when it is of more than MOST_POSES poses: large fields have few plans.
    """

    courses: dict[bytes, Course | None] = field(default_factory=dict)
    met: dict[tuple[Course, Course], npt.NDArray[np.int64]] = field(default_factory=dict)
    poses: int = 0

    def course(self, mission: Mission, alone: Alone) -> Course | None:
        """The course of a mission, driven where that has not been done yet; None where it does not get home."""
        key = mission_key(mission)
        if key not in self.courses:
            run = alone(_unbound(mission))
            course = _course(mission, run) if run.outcome == DONE else None
            self.poses += len(course.poses) if course else 0
            self.courses[key] = course
        return self.courses[key]

    def trimmed(self) -> None:
        """Forget all that is known where it has become too much."""
        if self.poses > MOST_POSES:
            self.courses.clear()
            self.met.clear()
            self.poses = 0


def courses_of(plan: Plan, alone: Alone, known: Known | None = None) -> list[Course] | None:
    """The course of every tractor of a plan; None where one does not get home even alone."""
    known = known or Known()
    known.trimmed()
    courses = [known.course(mission, alone) for mission in plan.missions]
    found = [course for course in courses if course is not None]
    return found if len(found) == len(courses) else None


def mission_key(mission: Mission) -> bytes:
    """A digest of all that a course depends on."""
    digest = hashlib.sha256()
    for leg in mission.legs:
        what = leg.gear, leg.implement, leg.task.works, bool(leg.may_wait or leg.gates), len(leg.points)
        digest.update(struct.pack("<2d5i", leg.speed_mps, leg.stand_s, *what))
        digest.update(f"{leg.ground} {leg.task.kind}".encode())
        digest.update(np.ascontiguousarray(leg.points, dtype=np.float64).tobytes())
    return digest.digest()


def _unbound(mission: Mission) -> Mission:
    """The mission for a tractor that waits for nobody."""
    return Mission(tuple(leg.linked(gates=(), follow=None) for leg in mission.legs))


def _course(mission: Mission, run: Run) -> Course:
    legs = run.leg(0)
    holds = [n for n, leg in enumerate(mission.legs) if n == 0 or leg.may_wait or leg.gates]
    rows = np.searchsorted(legs, holds)
    rows[0] = 0
    poses = run.poses(0)
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, REC_PLACE], axis=0).T))))
    turned = np.abs((np.diff(poses[:, REC_ANGLE]) + np.pi) % (2.0 * np.pi) - np.pi)
    travel = driven + TURNED_M * np.concatenate(([0.0], np.cumsum(turned)))
    kept = np.searchsorted(travel, np.arange(0.0, travel[-1], STEP_M))
    kept = np.unique(np.concatenate([kept, rows, [len(legs) - 1]]))
    began = driven[np.searchsorted(legs, legs[kept])]
    return Course(
        poses_of(poses[kept]),
        run.time_s[kept],
        legs[kept],
        driven[kept] - began,
        (*np.searchsorted(kept, rows).tolist(), len(kept) - 1),
        (*holds, len(mission.legs)),
        mission.enters,
        mission.leaves,
    )
