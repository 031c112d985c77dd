"""The twins of a fleet: fed with each tractor's commands, corrected by its reports, advanced with the fleet."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fields.arrays import Floats
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.model.alarms import WARNING
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import REFRESH_PERIOD_S, STATE_PERIOD_S
from planner.fleet.model.timed_mission import sample_segments
from planner.fleet.model.tractor_state import TractorReport
from planner.fleet.safety.credible_motion import CredibleMotion
from planner.fleet.safety.motion_prediction import TwinPredictions
from planner.fleet.session.frame_content import compute_heading_deg
from planner.fleet.session.frame_timing import CLOCK_JUMP_S
from planner.fleet.session.inbound_frames import StateFrame
from vehicle.control.speed import compute_follower_speed
from vehicle.model.tractor import Implement, Tractor, load_tractor
from vehicle.records import DT_S
from vehicle.sim.compile import build_model_record
from vehicle.sim.path_conflicts import compute_outline_distances, find_close_approaches, find_close_approaches_between
from vehicle.twin.correction import MAX_LATENESS_STEPS
from vehicle.twin.propagation import PIECE_STEPS
from vehicle.twin.twin import PoseFix, Twin

CORRECTION_PERIOD_S = 1.0  # between two fixes of a twin, as in section 5.2.2, by its clock
PATH_STEP_S = PIECE_STEPS * DT_S  # between two poses of a predicted path
OLDEST_STATE_S = MAX_LATENESS_STEPS * DT_S  # in real time, of a state that a twin can still use
LEAP_DELAY_S, LEAP_SHOWN_S = 5.0, 60.0  # after which a jump of the fix is shown, and for how long


class FleetTwins(TwinPredictions):
    """The twins of a fleet. Their clock is the simulated one, `times` as fast as real time, from `begin_s` on (seconds
    since 1970, the clock of states)."""

    def __init__(self, plan: FleetPlan, method: str, times: float, begin_s: float) -> None:
        self.plan, self.method, self.times, self.begin_s = plan, method, times, begin_s
        self.tractors: list[Tractor] = [plan.tractor] * plan.tractor_count
        self.items: list[Twin | None] = [None] * plan.tractor_count
        self._corrected_s = [-math.inf] * plan.tractor_count
        self._doubt_at_s = self._advanced_at_s = -math.inf
        self._clock_offset_s = 0.0

    def compute_time_s(self, clock_s: float) -> float:
        """The time of the twins at a time of the clock (seconds since 1970)."""
        return (clock_s - self.begin_s) * self.times

    def take_state(self, number: int, state: StateFrame, state_s: float, clock_s: float) -> None:
        """Pass a tractor's commands to its twin, and once a second its place as a correction; times are since 1970.

        An old state that is sent again is ignored: it does not show where the tractor is now.
        """
        arrived_s = self.compute_time_s(clock_s)
        time_s = min(self.compute_time_s(state_s), arrived_s)
        if time_s < arrived_s - OLDEST_STATE_S * self.times:
            return
        east, north = self.plan.saved.origin_m
        sign = -1.0 if state.shuttle < 0 else 1.0
        fix = PoseFix(
            time_s,
            state.easting_m - east,
            state.northing_m - north,
            math.radians(90.0 - state.heading_deg),
            sign * state.speed_mps,
            arrived_s,
        )
        twin = self.items[number]
        if twin is None:
            self.items[number] = Twin(self.tractors[number], self.plan.implement, fix, method=self.method)
            return
        speed_mps = sign * abs(state.speed_command_mps)
        twin.add_command(time_s, math.radians(state.steering_command_deg), speed_mps, bool(state.implement))
        if time_s - self._corrected_s[number] >= CORRECTION_PERIOD_S - 0.5 * STATE_PERIOD_S:
            self._corrected_s[number] = time_s
            twin.add_fix(fix)

    def take_command(self, number: int, steering_rad: float, speed_mps: float, clock_s: float) -> None:
        """Pass a remote command to the twin of a tractor."""
        twin = self.items[number]
        if twin is not None:
            twin.add_command(self.compute_time_s(clock_s), steering_rad, speed_mps, is_exact=True)

    def advance(self, now: float, clock_s: float, manager: FleetManager) -> None:
        """Advance all twins to now; a twin in doubt raises an alarm."""
        self._check_clock(now, clock_s)
        time_s = self.compute_time_s(clock_s)
        for twin in self.items:
            if twin is not None:
                twin.advance(time_s)
        if now - self._doubt_at_s >= REFRESH_PERIOD_S:
            self._doubt_at_s = now
            for number in range(len(self.items)):
                self._check_twin_doubt(number, time_s, manager, now)

    def _check_twin_doubt(self, number: int, time_s: float, manager: FleetManager, now: float) -> None:
        """Raise an alarm for a wrong twin, or for a jump of the fix; for seconds one may look like the other."""
        twin = self.items[number]
        doubt = None if twin is None else twin.find_mismatch()
        if doubt is None:
            manager.alarms.end_alarm("doubt", number)
        else:
            sentence = f"The twin of tractor {number + 1} is wrong: {doubt.words}"
            manager.alarms.raise_alarm("doubt", number, WARNING, sentence, now)
        leaps = () if twin is None or doubt is not None else twin.jumps[-2:]
        fresh = [leap for leap in leaps if LEAP_DELAY_S <= time_s - leap.time_s <= LEAP_DELAY_S + LEAP_SHOWN_S]
        if not fresh:
            manager.alarms.end_alarm("leap", number)
            return
        sentence = (
            f"The position of tractor {number + 1} jumped by {fresh[-1].distance_m:.2f} m; its twin follows. "
            "Check its receiver, its corrections, and what blocks the sky."
        )
        manager.alarms.raise_alarm("leap", number, WARNING, sentence, now)

    def _check_clock(self, now: float, clock_s: float) -> None:
        """Restart all twins if the clock was set, or after a long pause: they would stand still, or simulate all that
        time at once. `now` is of a monotonic clock."""
        clock_offset_s, gap_s = clock_s - now, now - self._advanced_at_s
        is_known = math.isfinite(gap_s)
        if is_known and (gap_s > OLDEST_STATE_S or abs(clock_offset_s - self._clock_offset_s) > CLOCK_JUMP_S):
            self.items = [None] * len(self.items)
            self._corrected_s = [-math.inf] * len(self.items)
        self._advanced_at_s, self._clock_offset_s = now, clock_offset_s

    def build_tick_entries(self, number: int, shows_place: bool = True) -> dict[str, Any]:
        """The entries of a twin in a tick; empty for a tractor that has never reported.

        Without `shows_place` its place is left out, as it has received no commands for a while.
        """
        twin = self.items[number]
        if twin is None:
            return {}
        state = twin.state
        east, north = self.plan.saved.origin_m
        errors: dict[str, float | None] = {"error_m": None, "error_deg": None}
        if twin.last_correction is not None:
            ahead_m, right_m, heading_rad = twin.last_correction
            errors["error_m"] = round(math.hypot(ahead_m, right_m), 4)
            errors["error_deg"] = round(math.degrees(heading_rad), 3)
        place = {
            "twin": {
                "easting_m": round(state.x_m + east, 3),
                "northing_m": round(state.y_m + north, 3),
                "heading_deg": round(compute_heading_deg(state.heading_rad), 2),
                "speed_mps": round(state.speed_mps, 3),
            }
        }
        return {**(place if shows_place else {}), **errors}

    def find_place(self, number: int) -> tuple[float, float] | None:
        """The guided point of a tractor by its twin (m of the plan); None without a trusted twin."""
        twin = self.items[number]
        if twin is None or twin.find_mismatch() is not None:
            return None
        state = twin.state
        x, y = self._shift_to_guided_point(np.array([[state.x_m, state.y_m, state.heading_rad]]))[0, :2]
        return float(x), float(y)

    def predict_path(self, number: int, times_s: Floats) -> Floats | None:
        """Poses (steps, 3) of the guided point that a twin predicts; None without a trusted twin."""
        twin = self.items[number]
        if twin is None or twin.find_mismatch() is not None:
            return None
        ahead = self._shift_to_guided_point(twin.predict_path(float(times_s[-1])))
        picked: Floats = ahead[np.minimum(np.round(times_s / PATH_STEP_S).astype(int), len(ahead) - 1)]
        return picked

    def _shift_to_guided_point(self, poses: Floats) -> Floats:
        """Poses of the guided point, beside the antenna, from those of the antenna."""
        aside_m, moved = self.plan.tractor.antenna_right_m, poses.copy()
        moved[:, 0] -= aside_m * np.sin(poses[:, 2])
        moved[:, 1] += aside_m * np.cos(poses[:, 2])
        return moved

    def change_tractor(self, number: int, tractor: Tractor) -> None:
        """Restart a twin with this tractor file at its next report."""
        self.tractors[number] = tractor
        self.items[number] = None


def warm_up() -> None:
    """Load, or the first time compile, the functions of twins and of what watches tractors: a minute then, else a
    second."""
    tractor, implement = load_tractor("eg105"), Implement()
    for method in ("predict", "thesis"):
        twin = Twin(tractor, implement, PoseFix(0.0, 0.0, 0.0, 0.0, 1.0, 0.0), method=method)
        twin.add_command(0.1, 0.1, 1.0)
        for second in (1, 2, 3):
            twin.add_fix(PoseFix(second - 0.3, 1.0 * second, 0.0, 0.0, 1.0, float(second)))
            twin.advance(second + 0.1)
        twin.find_mismatch()
    motion = CredibleMotion(tractor.antenna_forward_m, 1.0)
    for time_s in (0.0, 0.1):
        motion.add_report(TractorReport(0.0, 0.0, 0.0, 0.0), np.zeros(3), time_s, time_s)
    sample_segments(np.zeros(1), np.zeros((1, 6)), 0.0, np.zeros(1), 0.0)
    poses = np.zeros((2, 2, 3))
    model = np.array([build_model_record(tractor, implement)])
    find_close_approaches(poses, np.array([True, True]), model, 0.5, 0.5)
    compute_outline_distances(poses[0], poses[1], model)
    find_close_approaches_between(poses[:1], model, poses[1:], model, 0.5, 0.5)
    compute_follower_speed(1.0, 1.0, 1.0)
