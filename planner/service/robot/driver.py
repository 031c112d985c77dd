"""What a simulated robot tractor does with what it is told, and when it hears nothing any more."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from vehicle.missions import Mission
from vehicle.plan_file import plan_from_json
from vehicle.tractor import Implement, Tractor
from vehicle.twin.stepper import REMOTE, Stepper

SILENCE_S = 1.0
UNLIKE = 1e-3
SET_S = 0.5  # by which a clock differs from one that only goes on where somebody has set it
STANDING_MPS = 0.02
WARM_S = 0.1


class Driver:
    """One tractor. Times are of a clock that only goes on; `times` is how much faster than it the tractor lives.

    Silence of the centre for a second stops it at once when it is driven by remote control or follows another tractor,
    of which nobody tells it now; else it ends its released legs and stands. One that only followed goes on with the
    next word of the same link; over a new one it is told anew.

    A beat that comes a second later than the quickest of its link was held up on its way, and with it all that comes
    after: that is silence too, and nothing that comes so late sets the tractor in motion.
    """

    def __init__(
        self, mission: Mission, tractor: Tractor, implement: Implement, origin_m: tuple[float, float], *,
        name: str, hidden: Mapping[str, float] | None = None, noise_m: float = 0.0, seed: int = 0, times: float = 1.0,
    ) -> None:  # fmt: skip
        self.stepper = Stepper(mission, tractor, implement, hidden=hidden, noise_m=noise_m, seed=seed)
        self.stepper.halt()
        self.implement = implement
        self.origin_m, self.name, self.times = origin_m, name, times
        self.update = 0
        self.sequence = -1
        self.welcomed = False
        self.reason = "nobody has told it to drive"
        self._begun_s: float | None = None
        self._clock_s = 0.0  # of the clock on the wall when that of `now` was 0
        self._heard_s = -math.inf
        self._late_s = 0.0  # by which what is heard was held up
        self._quickest_s, self._quickest_at_s = math.inf, 0.0
        self._silent = False
        self._told_to_go = self._stopped_by_silence = False

    def warm(self) -> None:
        """Load, or the first time compile, what drives: while that lasts nobody is heard and nothing is reported."""
        stepper = self.stepper
        Stepper(stepper.mission, stepper.tractor, self.implement).advance(WARM_S)

    def heard(self, frame: dict[str, Any], now: float) -> None:
        """The centre says something; a frame of a kind that is not for tractors changes nothing."""
        self._look_how_late(frame, now)
        self._heard_s = max(self._heard_s, now - self._late_s)
        if self._late_s <= SILENCE_S:
            self._silent = False
            if self._stopped_by_silence:
                self._stopped_by_silence = False
                if frame.get("kind") != "welcome":
                    self.stepper.automatic()
        take = getattr(self, f"_take_{frame.get('kind')}", None)
        if take is not None:
            take(frame)

    def _look_how_late(self, frame: dict[str, Any], now: float) -> None:
        """By how much beats take longer than the quickest did; clocks that run unlike are forgiven 1 ms a second."""
        kind, clock_s = frame.get("kind"), frame.get("clock_s")
        if kind == "welcome":
            self._quickest_s, self._late_s = math.inf, 0.0
        elif kind == "beat" and clock_s is not None:
            away_s = now - float(clock_s)
            forgiven_s = UNLIKE * (now - self._quickest_at_s)
            self._quickest_s, self._quickest_at_s = min(away_s, self._quickest_s + forgiven_s), now
            self._late_s = away_s - self._quickest_s

    def _take_welcome(self, frame: dict[str, Any]) -> None:
        self.times = float(frame["settings"]["times"])
        self.sequence = max(self.sequence, int(frame["last_sequence"]))
        self._follow(frame["plan"])
        leg, leg_m = int(frame.get("leg") or 0), float(frame.get("leg_m") or 0.0)
        if not self.welcomed and (leg, leg_m) > (0, 0.0):
            self.stepper.begin_at(leg, leg_m, self._place(frame))  # it was driven that far before this process began
        self.welcomed = True

    def _place(self, frame: dict[str, Any]) -> tuple[float, float, float] | None:
        """Where its antenna was by what the centre knows: east and north of the plan's origin (m), heading (rad)."""
        if frame.get("easting_m") is None:
            return None
        east, north = self.origin_m
        heading = math.radians(90.0 - float(frame["heading_deg"]))
        return float(frame["easting_m"]) - east, float(frame["northing_m"]) - north, heading

    def _take_release(self, frame: dict[str, Any]) -> None:
        self.update, self.stepper.released = int(frame["update"]), int(frame["released"])
        limit = frame["limit_mps"]
        self.stepper.limit_mps = math.inf if limit is None else float(limit)

    def _take_stop(self, frame: dict[str, Any]) -> None:
        self.reason = str(frame["reason"])
        self._told_to_go = self._stopped_by_silence = False
        self.stepper.halt()

    def _take_resume(self, _frame: dict[str, Any]) -> None:
        self._told_to_go = True
        if self._late_s > SILENCE_S:
            self._stopped_by_silence = True  # it goes on when it hears in time again
        else:
            self.stepper.automatic()

    def _take_command(self, frame: dict[str, Any]) -> None:
        self._told_to_go = self._stopped_by_silence = False
        if self._late_s > SILENCE_S:
            self.stepper.halt()
            return
        self.stepper.remote(math.radians(frame["steering_command_deg"]), float(frame["speed_command_mps"]))

    def _take_plan(self, frame: dict[str, Any]) -> None:
        self._follow(frame["plan"])
        self.stepper.released = int(frame["released"])

    def _follow(self, plan: dict[str, Any]) -> None:
        """Take the centre's legs, which are those driven so far and new ones."""
        self.stepper.follow(plan_from_json(json.dumps(plan)).missions[0])

    def dated(self, clock_s: float, now: float) -> None:
        """The clock on the wall shows `clock_s` (since 1970): states are dated by it anew where somebody has set it."""
        if self._begun_s is not None and abs(clock_s - now - self._clock_s) > SET_S:
            self._clock_s = clock_s - now

    def step(self, now: float) -> dict[str, Any]:
        """Drive up to now; the state to be sent."""
        if self._begun_s is None:
            self._begun_s, self._clock_s = now, time.time() - now
        if now - self._heard_s > SILENCE_S and not self._silent:
            self._silent = True
            self._lost()
        self.stepper.advance((now - self._begun_s) * self.times)
        self.sequence += 1
        return self._state(now)

    def _lost(self) -> None:
        """Nothing was heard of the centre for a second."""
        follows = self._told_to_go and math.isfinite(self.stepper.limit_mps)
        if follows or self.stepper.state.mode == REMOTE:
            self._stopped_by_silence = follows
            self.reason = "the centre is silent"
            self.stepper.halt()

    def _state(self, now: float) -> dict[str, Any]:
        state = self.stepper.state
        east, north = self.origin_m
        velocity = state.speed_mps if abs(state.speed_mps) > STANDING_MPS else state.speed_command_mps
        backwards = velocity < 0.0 if velocity else state.gear < 0
        return {
            "kind": "state", "id": self.name, "sequence": self.sequence, "time": utc(self._clock_s + now),
            "easting_m": round(state.x_m + east, 4), "northing_m": round(state.y_m + north, 4),
            "heading_deg": round((90.0 - math.degrees(state.heading_rad)) % 360.0, 4),
            "speed_mps": round(abs(state.speed_mps), 4), "speed_command_mps": round(abs(state.speed_command_mps), 4),
            "steering_command_deg": round(math.degrees(state.steering_command_rad), 4),
            "steering_deg": round(math.degrees(state.wheel_angle_rad), 4), "shuttle": -1 if backwards else 1,
            "start": int(state.speed_command_mps != 0.0), "mode": state.mode, "leg": state.leg,
            "leg_m": round(max(state.leg_m, 0.0), 4), "implement": int(state.implement), "update": self.update,
            "done": state.done, "errors": [],
        }  # fmt: skip


def utc(clock_s: float) -> str:
    """Seconds since 1970 as frames have them."""
    return datetime.fromtimestamp(clock_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
