"""The virtual tractor of a real one: fed with the same commands, corrected by fixes that come late and rarely."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vehicle.errors import VehicleError
from vehicle.ground import ground_index
from vehicle.layout import DT_S
from vehicle.tractor import Implement, Tractor
from vehicle.twin.belief import Belief, tracking, witnessing
from vehicle.twin.doubt import Doubt, Test
from vehicle.twin.leaps import Leap
from vehicle.twin.motion import Array, Noise, make_machine, new_body, new_state
from vehicle.twin.record import Recording
from vehicle.twin.rolling import PIECE, Commands, Rolled, antenna_of
from vehicle.twin.ways import OLDEST, Anchor, Following, Predicting

THESIS, PREDICT = "thesis", "predict"
WAYS = (PREDICT, THESIS)
APART_MPS, APART_S = 0.5 / 3.6, 3.0  # section 5.2.2: driven otherwise than commanded "consistently"; for 3 s here
COLUMNS = ("time_s", "arrived_s", "ahead_m", "right_m", "heading_rad")
UNTOLD_S = 0.4  # commands seen more rarely say too little of how a tractor was steered to doubt its file for that
LONGEST_UNSEEN_S = 2.0  # a link that was silent for longer tells nothing of when a command came into force
KEPT = 36_000  # corrections: an hour at 10 Hz


@dataclass(frozen=True)
class Fix:
    """A measured state of the real tractor and when it came in, all times on one clock (s).

    Metres east and north of the plan's origin of the antenna; the heading mathematical (from east, counter-clockwise);
    the speed negative in reverse.
    """

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    arrived_s: float


@dataclass(frozen=True)
class TwinState:
    """The twin at a time, in the frame of Fix. `sure_m` and `sure_rad` are standard deviations of the last correction;
    without any trust in that the thesis's way has the same."""

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    wheel_angle_rad: float
    sure_m: float
    sure_rad: float


class Twin:
    """One virtual tractor, standing or driving where `start` says, and as the tractor's file says.

    `way` is how it is corrected, see vehicle.twin.ways; `noise` what is believed of instruments and soil. Twins draw no
    random numbers: the same calls give the same states bit for bit. Raises VehicleError for an unknown way or ground
    and for numbers that are none.
    """

    def __init__(
        self, tractor: Tractor, implement: Implement, start: Fix, *, way: str = PREDICT, ground: str = "soil",
        noise: Noise | None = None,
    ) -> None:  # fmt: skip
        if way not in WAYS:
            raise VehicleError(f"The way of correction {way!r} is unknown; use one of: {', '.join(WAYS)}.")
        _check(start)
        self.tractor, self.implement, self.way, self.ground = tractor, implement, way, ground
        self._start_s = start.time_s
        noise = noise or Noise()
        machine = make_machine(tractor, implement)
        angle = start.heading_rad - machine.bias_rad
        x, y = antenna_of(machine, np.array([0.0, 0.0, angle]))
        body = new_body(start.x_m - x, start.y_m - y, angle, start.speed_mps)
        rolled = Rolled(machine, ground_index(ground), new_state(0.0, start.speed_mps), body, 0)
        self._machine = machine
        self._commands = Commands(0.0, start.speed_mps)
        self._test = Test(tractor, start.time_s)
        self._anchor = Anchor(
            rolled, Belief(tracking(noise), body[:3]), Belief(witnessing(noise), body[:3]), self._test
        )  # fmt: skip
        kind = Predicting if way == PREDICT else Following
        self._way: Predicting | Following = kind(self._anchor, self._commands)
        self._step = 0
        self._waiting: list[Fix] = []
        self._seen_s, self._told = start.time_s, (0.0, start.speed_mps, 0.0)
        self._unseen_s = 0.0
        self._apart_since: float | None = None
        self._instead: float | None = None
        self._rows: list[tuple[float, ...]] = []
        self.late = 0
        self.recording = Recording()

    def _at(self, time_s: float) -> int:
        return round((time_s - self._start_s) / DT_S)

    def command(
        self, time_s: float, steering_rad: float, speed_mps: float, implement: bool = False, *, exact: bool = False
    ) -> None:
        """What the real tractor was told at a time, which may be gone by: steering (positive right), speed (negative in
        reverse), whether the implement works. It holds until the next one; one older than the last is not taken.

        `exact` is a command from just that time on; without it, it was seen then, and may have come into force since
        the last one was seen: halfway is taken, and by how much that may be wrong is heeded. Raises VehicleError for
        numbers that are none.
        """
        if not all(map(math.isfinite, (time_s, steering_rad, speed_mps))):
            raise VehicleError(f"A command of {steering_rad} rad, {speed_mps} m/s at {time_s} s is none; give numbers.")
        if time_s < self._seen_s:
            return
        lock = math.radians(self.tractor.max_steering_deg)
        told = (min(max(steering_rad, -lock), lock), speed_mps, float(implement))
        unseen = 0.0 if exact else min(time_s - self._seen_s, LONGEST_UNSEEN_S)
        self._seen_s, self._unseen_s = time_s, unseen
        if told == self._told:
            return
        self._told = told
        self.recording.commanded(time_s, *told)
        self._hold(self._at(time_s - 0.5 * unseen), unseen)

    def _hold(self, step: int, unseen_s: float) -> None:
        """Hold what was told from a step on, or the measured speed where that has long been another (section 5.2.2)."""
        steering, speed, implement = self._told
        speed = speed if self._instead is None else self._instead
        self._commands.set(max(step, self._commands.since), np.array([steering, speed, implement, unseen_s]))
        self._way.commanded(step, self._commands.held)

    def measured(self, fix: Fix) -> None:
        """A fix that comes in at its `arrived_s`: taken then, when the twin is advanced to that time.

        One more than 4 s old, or older than one taken before, is counted in `late` and left out. Raises VehicleError
        for numbers that are none.
        """
        _check(fix)
        self._waiting.append(fix)
        self._waiting.sort(key=lambda one: one.arrived_s)

    def advance(self, time_s: float) -> TwinState:
        """Drive up to a time in steps of 1/60 s and take the fixes that have come in by then.

        A time gone by does nothing.
        """
        end = self._at(time_s)
        while self._waiting and self._at(self._waiting[0].arrived_s) <= end:
            fix = self._waiting.pop(0)
            self._to(self._at(fix.arrived_s))
            self._take(fix)
        self._to(end)
        self._way.to(self._step)
        return self.state

    def _to(self, step: int) -> None:
        if step > self._step:
            self._commands.extend(step)
            self._anchor.to(step - OLDEST, self._commands)
            self._way.to(step)
            self._step = step

    def _take(self, fix: Fix) -> None:
        seen_s = fix.time_s - self._machine.late_s
        step = min(math.floor((seen_s - self._start_s) / DT_S + 1e-6), self._step)
        if step < self._anchor.rolled.step:
            self.late += 1
            return
        self._anchor.to(step, self._commands)
        row = self._shifted_back(fix, seen_s - self._start_s - step * DT_S)
        off = self._anchor.take(row, fix.time_s, self._unseen_s <= UNTOLD_S)
        self._heed_speed(fix)
        self.recording.measured(fix.time_s, fix.x_m, fix.y_m, fix.heading_rad, fix.speed_mps)
        self._way.corrected(step, row)
        if self.way == PREDICT:
            self._note(fix.time_s, fix.arrived_s, off)
        else:
            self._note_applied(fix)

    def _shifted_back(self, fix: Fix, late_s: float) -> Array:
        """The fix as it would have been at the step before its time, and without the compass's known bias."""
        angle, body = fix.heading_rad - self._machine.bias_rad, self._anchor.rolled.body
        angle -= float(body[5]) * late_s
        way = fix.speed_mps * late_s
        return np.array([fix.x_m - way * math.cos(angle), fix.y_m - way * math.sin(angle), angle, fix.speed_mps])

    def _heed_speed(self, fix: Fix) -> None:
        before = self._instead
        kept = self._kept_share()
        if abs(fix.speed_mps - self._told[1] * kept) <= APART_MPS:
            self._apart_since, self._instead = None, None
        elif self._apart_since is None:
            self._apart_since = fix.time_s
        elif fix.time_s - self._apart_since >= APART_S:
            self._instead = fix.speed_mps / kept
        if self._instead != before:
            self._hold(self._at(fix.time_s), 0.0)

    def _kept_share(self) -> float:
        """The share of a commanded speed that the slip of the tractor's file leaves over ground."""
        model = self._machine.models[0]
        return float((1.0 - model["slip"]) * (1.0 - model["tool_slip"] * self._told[2]))

    def _note(self, time_s: float, arrived_s: float, off: Array) -> None:
        self._rows.append((time_s, arrived_s, *(float(value) for value in off)))
        del self._rows[:-KEPT]

    def _note_applied(self, fix: Fix) -> None:
        assert isinstance(self._way, Following)
        for step, off in self._way.applied:
            self._note(fix.time_s, self._start_s + step * DT_S, off)
        self._way.applied.clear()

    @property
    def state(self) -> TwinState:
        """Where the twin is now."""
        rolled = self._way.rolled
        x, y = rolled.antenna()
        cov = self._anchor.tracker.cov
        return TwinState(
            self._start_s + self._step * DT_S, x, y, float(rolled.body[2]), self._speed(rolled),
            float(rolled.state["steering"][0]), math.sqrt(0.5 * (cov[0, 0] + cov[1, 1])), math.sqrt(cov[2, 2]),
        )  # fmt: skip

    def _speed(self, rolled: Rolled) -> float:
        return rolled.forward_mps * (1.0 + float(self._way.learnt[1]))

    def ahead(self, seconds: float) -> Array:
        """The path (n, 3) foretold under the held command: antenna east and north (m), heading (rad), every 0.1 s from
        now on."""
        pieces = max(0, round(seconds / (PIECE * DT_S)))
        poses = self._way.rolled.path(pieces, self._commands, self._way.learnt)
        angle, machine = poses[:, 2], self._machine
        poses[:, 0] += machine.ahead_m * np.cos(angle) + machine.right_m * np.sin(angle)
        poses[:, 1] += machine.ahead_m * np.sin(angle) - machine.right_m * np.cos(angle)
        return poses

    @property
    def corrections(self) -> dict[str, Array]:
        """The last 36,000 corrections as columns (k,): time of the fix and of its arrival (thesis: of the correction),
        measured less foretold ahead and to the right (m) and in heading (rad).
        """
        table = np.array(self._rows, dtype=np.float64).reshape(-1, len(COLUMNS))
        return {name: table[:, column].copy() for column, name in enumerate(COLUMNS)}

    @property
    def last_correction(self) -> tuple[float, float, float] | None:
        """The last of the corrections: ahead and to the right (m) and in heading (rad); None before the first."""
        return None if not self._rows else (self._rows[-1][2], self._rows[-1][3], self._rows[-1][4])

    def doubt(self) -> Doubt | None:
        """Whether, and since when, the corrections exceed what noise explains.

        Where commands are seen less often than every 0.4 s it cannot be told, and nothing is doubted.
        """
        return self._test.doubt()

    @property
    def evidence_s(self) -> float:
        """Noise alone would say as much against the twin once in so many seconds (vehicle.twin.doubt)."""
        return self._test.seconds

    @property
    def leaps(self) -> tuple[Leap, ...]:
        """Where fixes were suddenly elsewhere: no evidence against the tractor's file (vehicle.twin.leaps)."""
        return tuple(self._anchor.leaps.told)

    @property
    def rejected(self) -> int:
        """Fixes left out as absurd: more than 8 standard deviations from what was foretold."""
        return self._anchor.rejected


def _check(fix: Fix) -> None:
    if not all(map(math.isfinite, (fix.time_s, fix.x_m, fix.y_m, fix.heading_rad, fix.speed_mps, fix.arrived_s))):
        raise VehicleError(f"{fix} holds what is no finite number; give numbers.")
    if fix.arrived_s < fix.time_s:
        raise VehicleError(
            f"A fix of {fix.time_s:g} s cannot have come in at {fix.arrived_s:g} s; give both on one clock."
        )
