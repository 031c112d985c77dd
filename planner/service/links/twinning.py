"""One twin per tractor, fed with what it was told, corrected by what it reports, advanced with the fleet."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from planner.service.centre.alarms import WARNING
from planner.service.centre.centre import Centre
from planner.service.centre.fleet_plan import FleetPlan
from planner.service.links.converting import heading_deg
from planner.service.links.frames import State
from vehicle.tractor import Tractor
from vehicle.twin.twin import Fix, Twin

CORRECT_S = 1.0  # between two fixes that a twin is given, as in section 5.2.2, by its own clock
PERIOD_S = 0.1  # between two states
AHEAD_S = 0.1  # between two poses of a foretold path
OLDEST_S = 4.0  # on the wall, of a state that a twin can still use
SET_S = 0.5  # by which a clock differs from one that only goes on where somebody has set it
DOUBT_S = 1.0  # between two looks at whether a twin is wrong
LEAP_S, LEAP_ON_S = 5.0, 60.0  # after which a leap of the fix is told, and for how long

Array = npt.NDArray[np.float64]


class Twins:
    """The twins of a fleet. Their clock is the simulated one, `times` as fast as that on the wall, from `begin_s` on
    (seconds since 1970, by which tractors date their states)."""

    def __init__(self, plan: FleetPlan, way: str, times: float, begin_s: float) -> None:
        self.plan, self.way, self.times, self.begin_s = plan, way, times, begin_s
        self.tractors: list[Tractor] = [plan.tractor] * plan.tractors
        self.items: list[Twin | None] = [None] * plan.tractors
        self._fixed_s = [-math.inf] * plan.tractors
        self._doubt_s = self._advanced_s = -math.inf
        self._apart_s = 0.0

    def time_s(self, clock_s: float) -> float:
        """The time of the twins at a time of the clock (seconds since 1970)."""
        return (clock_s - self.begin_s) * self.times

    def reported(self, number: int, state: State, clock_s: float) -> None:
        """A tractor has reported: what it was told is held, and once a second where it is corrects its twin.

        A state that is sent again long after it was made tells nothing of where the tractor is now.
        """
        arrived = self.time_s(clock_s)
        time_s = min(self.time_s(state.time.timestamp()), arrived)
        if time_s < arrived - OLDEST_S * self.times:
            return
        east, north = self.plan.saved.origin_m
        sign = -1.0 if state.shuttle < 0 else 1.0
        fix = Fix(time_s, state.easting_m - east, state.northing_m - north, math.radians(90.0 - state.heading_deg),
                  sign * state.speed_mps, arrived)  # fmt: skip
        twin = self.items[number]
        if twin is None:
            self.items[number] = Twin(self.tractors[number], self.plan.implement, fix, way=self.way)
            return
        speed = sign * abs(state.speed_command_mps)
        twin.command(time_s, math.radians(state.steering_command_deg), speed, bool(state.implement))
        if time_s - self._fixed_s[number] >= CORRECT_S - 0.5 * PERIOD_S:
            self._fixed_s[number] = time_s
            twin.measured(fix)

    def commanded(self, number: int, steering_rad: float, speed_mps: float, clock_s: float) -> None:
        """A tractor is told by remote control how to drive, and its twin at the same time."""
        twin = self.items[number]
        if twin is not None:
            twin.command(self.time_s(clock_s), steering_rad, speed_mps, exact=True)

    def advance(self, now: float, clock_s: float, centre: Centre) -> None:
        """Drive all twins up to now; who is in doubt raises an alarm of the centre."""
        self._check_clock(now, clock_s)
        time_s = self.time_s(clock_s)
        for twin in self.items:
            if twin is not None:
                twin.advance(time_s)
        if now - self._doubt_s >= DOUBT_S:
            self._doubt_s = now
            for number in range(len(self.items)):
                self._look(number, time_s, centre, now)

    def _look(self, number: int, time_s: float, centre: Centre, now: float) -> None:
        """Tell of a twin that is wrong, or of a fix that leapt; for seconds one may look like the other."""
        twin = self.items[number]
        doubt = None if twin is None else twin.doubt()
        if doubt is None:
            centre.alarms.ended("doubt", number)
        else:
            told = f"The twin of tractor {number + 1} is wrong: {doubt.words}"
            centre.alarms.raised("doubt", number, WARNING, told, now)
        leaps = () if twin is None or doubt is not None else twin.leaps[-2:]
        fresh = [leap for leap in leaps if LEAP_S <= time_s - leap.time_s <= LEAP_S + LEAP_ON_S]
        if not fresh:
            centre.alarms.ended("leap", number)
            return
        told = (f"The position of tractor {number + 1} leapt by {fresh[-1].metres:.2f} m; its twin follows and is not "
                "doubted for it. Look at its receiver, its corrections and what shades the sky.")  # fmt: skip
        centre.alarms.raised("leap", number, WARNING, told, now)

    def _check_clock(self, now: float, clock_s: float) -> None:
        """Begin all twins anew where the clock was set, or nobody looked for long: they would stand still, or drive all
        that time at once and everybody wait for them. `now` is of a clock that only goes on."""
        apart_s, gap_s = clock_s - now, now - self._advanced_s
        known = math.isfinite(gap_s)
        if known and (gap_s > OLDEST_S or abs(apart_s - self._apart_s) > SET_S):
            self.items = [None] * len(self.items)
            self._fixed_s = [-math.inf] * len(self.items)
        self._advanced_s, self._apart_s = now, apart_s

    def told(self, number: int, known: bool = True) -> dict[str, Any]:
        """The entries of a twin in a tick; none for a tractor that was never heard of.

        Without `known` it is left out where the twin is: nobody has told it for a while how its tractor is driven.
        """
        twin = self.items[number]
        if twin is None:
            return {}
        state = twin.state
        east, north = self.plan.saved.origin_m
        metres, degrees = self.error(number)
        place = {
            "twin": {
                "easting_m": round(state.x_m + east, 3), "northing_m": round(state.y_m + north, 3),
                "heading_deg": round(heading_deg(state.heading_rad), 2), "speed_mps": round(state.speed_mps, 3),
            }
        }  # fmt: skip
        return (place if known else {}) | {"error_m": metres, "error_deg": degrees}

    def error(self, number: int) -> tuple[float | None, float | None]:
        """How far off the last correction found a twin: metres and degrees."""
        twin = self.items[number]
        last = None if twin is None else twin.last_correction
        if last is None:
            return None, None
        ahead, right, heading = last
        return round(math.hypot(ahead, right), 4), round(math.degrees(heading), 3)

    def place(self, number: int) -> tuple[float, float] | None:
        """Where a tractor's guided point is by its twin (m of the plan); None without a twin that is trusted."""
        twin = self.items[number]
        if twin is None or twin.doubt() is not None:
            return None
        state = twin.state
        x, y = self._guided(np.array([[state.x_m, state.y_m, state.heading_rad]]))[0, :2]
        return float(x), float(y)

    def path(self, number: int, times_s: Array) -> Array | None:
        """Poses (steps, 3) of it that its twin foretells at times from now on; None without a twin that is trusted."""
        twin = self.items[number]
        if twin is None or twin.doubt() is not None:
            return None
        ahead = self._guided(twin.ahead(float(times_s[-1])))
        picked: Array = ahead[np.minimum(np.round(times_s / AHEAD_S).astype(int), len(ahead) - 1)]
        return picked

    def _guided(self, poses: Array) -> Array:
        """Poses of the guided point, abreast of the antenna, from those of the antenna."""
        aside, moved = self.plan.tractor.antenna_right_m, poses.copy()
        moved[:, 0] -= aside * np.sin(poses[:, 2])
        moved[:, 1] += aside * np.cos(poses[:, 2])
        return moved

    def changed(self, plan: FleetPlan) -> None:
        """The fleet goes on by another plan of the same tractors."""
        self.plan = plan

    def mended(self, number: int, tractor: Tractor) -> None:
        """From its next report on a twin is that of this tractor file."""
        self.tractors[number] = tractor
        self.items[number] = None
