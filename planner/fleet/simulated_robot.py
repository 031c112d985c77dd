"""A simulated robot tractor: how it obeys frames, and what it does in silence."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from typing import Any

from planner.fleet.model.rules import FleetRules
from planner.fleet.session.frame_timing import CLOCK_JUMP_S, format_utc
from vehicle.missions.plan import Mission
from vehicle.missions.plan_file import parse_plan
from vehicle.model.tractor import Implement, Tractor
from vehicle.twin.robot_tractor import REMOTE, RobotTractor

SILENCE_S, HORIZON_S = FleetRules.silence_s, FleetRules.horizon_s  # the latter until a release gives another value
CLOCK_DRIFT = 1e-3
STANDING_MPS = 0.02
WARM_UP_S = 0.1


class RobotDriver:
    """One tractor. Times are of a monotonic clock; the tractor runs `times` as fast.

    After a second of silence it stops at once if it is driven by remote control or follows another tractor. Else it
    drives its base legs, but stops after `horizon_s` of silence, by the clock of `now` whatever `times` is. Unless it
    was driven by remote control, the next frame of the same link lets it resume; over a new link it waits for orders.

    A heartbeat a second later than the fastest of its link was delayed, as is all that follows: that counts as silence
    too, and no delayed frame sets the tractor in motion.
    """

    def __init__(
        self,
        mission: Mission,
        tractor: Tractor,
        implement: Implement,
        origin_m: tuple[float, float],
        *,
        name: str,
        hidden: Mapping[str, float] | None = None,
        noise_m: float = 0.0,
        seed: int = 0,
        times: float = 1.0,
    ) -> None:
        self.stepper = RobotTractor(mission, tractor, implement, hidden_effects=hidden, noise_m=noise_m, seed=seed)
        self.stepper.halt()
        self.implement = implement
        self.origin_m, self.name, self.times = origin_m, name, times
        self.update = 0
        self.sequence = -1
        self.is_welcomed = False
        self.reason = "it has no order to drive"
        self._begun_s: float | None = None
        self._clock_s = 0.0  # of the wall clock when `now` was 0
        self._last_contact_s = -math.inf
        self._late_s = 0.0  # delay of the frames that arrive
        self._heartbeat_s: float | None = None  # clock of the last heartbeat, as the fleet manager sent it
        self._quickest_s, self._quickest_at_s = math.inf, 0.0
        self._horizon_s = HORIZON_S
        self._silent = False
        self._ordered_to_drive = self._stopped_by_silence = False

    def warm_up(self) -> None:
        """Load, or the first time compile, the simulation; no frames are handled meanwhile."""
        stepper = self.stepper
        RobotTractor(stepper.mission, stepper.tractor, self.implement).advance(WARM_UP_S)

    def handle_frame(self, frame: dict[str, Any], now: float) -> None:
        """Handle a frame of the service; kinds that are not for tractors change nothing."""
        self._measure_delay(frame, now)
        self._last_contact_s = max(self._last_contact_s, now - self._late_s)
        if self._late_s <= SILENCE_S:
            self._silent = False
            if self._stopped_by_silence:
                self._stopped_by_silence = False
                if frame.get("kind") != "welcome":
                    self.stepper.drive_automatically()
        kind = frame.get("kind")
        if kind == "welcome":
            self.times = float(frame["settings"]["times"])
            self.sequence = max(self.sequence, int(frame["last_sequence"]))
            self._replace_mission_legs(frame["plan"])
            leg, leg_m = int(frame.get("leg") or 0), float(frame.get("leg_m") or 0.0)
            if not self.is_welcomed and (leg, leg_m) > (0, 0.0):
                # progress from before this process started
                self.stepper.place_on_leg(leg, leg_m, self._read_place(frame))
            self.is_welcomed = True
        elif kind == "release":
            self.update, self.stepper.base_legs = int(frame["update"]), int(frame["base_end"])
            self._horizon_s = float(frame.get("horizon_s", HORIZON_S))
            limit = frame["limit_mps"]
            self.stepper.speed_limit_mps = math.inf if limit is None else float(limit)
        elif kind == "stop":
            self.reason = str(frame["reason"])
            self._ordered_to_drive = self._stopped_by_silence = False
            self.stepper.halt()
        elif kind == "resume":
            self._ordered_to_drive = True
            if self._late_s > SILENCE_S:
                self._stopped_by_silence = True  # it resumes when frames arrive in time again
            else:
                self.stepper.drive_automatically()
        elif kind == "command":
            self._ordered_to_drive = self._stopped_by_silence = False
            if self._late_s > SILENCE_S:
                self.stepper.halt()
            else:
                steering_rad = math.radians(frame["steering_command_deg"])
                self.stepper.drive_remotely(steering_rad, float(frame["speed_command_mps"]))
        elif kind == "plan":
            self._replace_mission_legs(frame["plan"])
            self.stepper.base_legs = int(frame["base_end"])

    def _measure_delay(self, frame: dict[str, Any], now: float) -> None:
        """Measure the delay of heartbeats against the fastest; a drift of the clocks of 1 ms/s is allowed for."""
        kind, clock_s = frame.get("kind"), frame.get("clock_s")
        if kind in ("welcome", "heartbeat"):
            self._heartbeat_s = clock_s
        if kind == "welcome":
            self._quickest_s, self._late_s = math.inf, 0.0
        elif kind == "heartbeat" and clock_s is not None:
            offset_s = now - float(clock_s)
            forgiven_s = CLOCK_DRIFT * (now - self._quickest_at_s)
            self._quickest_s, self._quickest_at_s = min(offset_s, self._quickest_s + forgiven_s), now
            self._late_s = offset_s - self._quickest_s

    def _read_place(self, frame: dict[str, Any]) -> tuple[float, float, float] | None:
        """The last place of its antenna in a welcome: east and north of the plan's origin (m), heading (rad)."""
        if frame.get("easting_m") is None:
            return None
        east, north = self.origin_m
        heading = math.radians(90.0 - float(frame["heading_deg"]))
        return float(frame["easting_m"]) - east, float(frame["northing_m"]) - north, heading

    def _replace_mission_legs(self, plan: dict[str, Any]) -> None:
        """Replace its legs; those driven so far are unchanged."""
        self.stepper.replace_mission(parse_plan(json.dumps(plan)).missions[0])

    def set_clock(self, clock_s: float, now: float) -> None:
        """The wall clock shows `clock_s` (since 1970); if somebody has set it, states are dated by the new time."""
        if self._begun_s is not None and abs(clock_s - now - self._clock_s) > CLOCK_JUMP_S:
            self._clock_s = clock_s - now

    def step(self, now: float) -> dict[str, Any]:
        """Drive up to now; returns the state to send."""
        if self._begun_s is None:
            self._begun_s, self._clock_s = now, time.time() - now
        if now - self._last_contact_s > SILENCE_S and not self._silent:
            self._silent = True
            is_following = self._ordered_to_drive and math.isfinite(self.stepper.speed_limit_mps)
            if is_following or self.stepper.state.mode == REMOTE:
                self._stand_for_silence()
        if now - self._last_contact_s > self._horizon_s and self._ordered_to_drive and not self._stopped_by_silence:
            self._stand_for_silence()
        self.stepper.advance((now - self._begun_s) * self.times)
        self.sequence += 1
        return self._build_state(now)

    def _stand_for_silence(self) -> None:
        """Stop until frames arrive again; under remote control until a new order."""
        self._stopped_by_silence = self._ordered_to_drive
        self.reason = "no contact with the control centre"
        self.stepper.halt()

    def _build_state(self, now: float) -> dict[str, Any]:
        state = self.stepper.state
        east, north = self.origin_m
        velocity_mps = state.speed_mps if abs(state.speed_mps) > STANDING_MPS else state.speed_command_mps
        is_backwards = velocity_mps < 0.0 if velocity_mps else state.gear < 0
        return {
            "kind": "state",
            "id": self.name,
            "sequence": self.sequence,
            "time": format_utc(self._clock_s + now),
            "easting_m": round(state.x_m + east, 4),
            "northing_m": round(state.y_m + north, 4),
            "heading_deg": round((90.0 - math.degrees(state.heading_rad)) % 360.0, 4),
            "speed_mps": round(abs(state.speed_mps), 4),
            "speed_command_mps": round(abs(state.speed_command_mps), 4),
            "steering_command_deg": round(math.degrees(state.steering_command_rad), 4),
            "steering_deg": round(math.degrees(state.wheel_angle_rad), 4),
            "shuttle": -1 if is_backwards else 1,
            "start": int(state.speed_command_mps != 0.0),
            "mode": state.mode,
            "leg": state.leg,
            "leg_m": round(max(state.leg_m, 0.0), 4),
            "implement": int(state.implement),
            "update": self.update,
            "done": state.done,
            "errors": [],
        } | ({} if self._heartbeat_s is None else {"heartbeat_s": self._heartbeat_s})
