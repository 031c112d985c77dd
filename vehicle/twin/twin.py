"""The twin of a real tractor: it gets the same commands and is corrected by late and sparse fixes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats
from fields.units import KMH_PER_MPS
from vehicle.errors import VehicleError
from vehicle.model.ground import find_ground_index
from vehicle.model.tractor import Implement, Tractor
from vehicle.records import DT_S
from vehicle.sim.effect_terms import compute_ground_speed
from vehicle.twin.correction import MAX_LATENESS_STEPS, PredictionCorrector, StateAtFix, ThesisCorrector
from vehicle.twin.kalman_filter import PoseFilter, build_monitor_parameters, build_tracker_parameters
from vehicle.twin.mismatch import MismatchTest, ModelMismatch, PositionJump
from vehicle.twin.propagation import PIECE_STEPS, CommandBuffer, PropagatedTractor
from vehicle.twin.step_motion import TractorNoise, create_body, create_state, make_tractor_arrays

THESIS, PREDICT = "thesis", "predict"
CORRECTION_METHODS = (PREDICT, THESIS)
# Section 5.2.2: a speed that differs "consistently" from the command; here for 3 s.
SPEED_MISMATCH_MPS = 0.5 / KMH_PER_MPS
SPEED_MISMATCH_S = 3.0
CORRECTION_COLUMNS = ("time_s", "arrived_s", "ahead_m", "right_m", "heading_rad")
MAX_COMMAND_GAP_S = 0.4  # rarer commands say too little about the steering to be evidence against the file
LONGEST_UNSEEN_S = 2.0  # upper bound of the uncertainty of when a command took effect
MAX_CORRECTIONS = 36_000  # an hour at 10 Hz


@dataclass(frozen=True)
class PoseFix:
    """A measured state of the real tractor and its time of arrival, all times on one clock (s).

    `x_m` and `y_m` are of the antenna, from the plan's origin; the heading is mathematical (from east,
    counter-clockwise); the speed is negative in reverse.
    """

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    arrived_s: float


@dataclass(frozen=True)
class TwinState:
    """The twin at a time, in the frame of PoseFix."""

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float


class Twin:
    """One virtual tractor that begins as `start` says and drives as the tractor's file says.

    `method` is how it is corrected (vehicle.twin.correction). Twins draw no random numbers: the same calls give the
    same states bit for bit. Raises VehicleError for an unknown method and for numbers that are not finite.
    """

    def __init__(
        self,
        tractor: Tractor,
        implement: Implement,
        start: PoseFix,
        *,
        method: str = PREDICT,
    ) -> None:
        if method not in CORRECTION_METHODS:
            raise VehicleError(
                f"The correction method {method!r} is unknown; use one of: {', '.join(CORRECTION_METHODS)}."
            )
        _check_fix(start)
        self.tractor = tractor
        self._start_s = start.time_s
        machine = make_tractor_arrays(tractor, implement)
        angle = start.heading_rad - machine.bias_rad
        x, y = machine.locate_antenna(np.array([0.0, 0.0, angle]))
        body = create_body(start.x_m - x, start.y_m - y, angle, start.speed_mps)
        propagated = PropagatedTractor(machine, find_ground_index("soil"), create_state(0.0, start.speed_mps), body, 0)
        self._arrays = machine
        self._commands = CommandBuffer(0.0, start.speed_mps)
        self._test = MismatchTest(tractor, start.time_s)
        tracker, monitor = build_tracker_parameters(TractorNoise()), build_monitor_parameters(TractorNoise())
        self._state_at_fix = StateAtFix(
            propagated, PoseFilter(tracker, body[:3]), PoseFilter(monitor, body[:3]), self._test
        )
        kind = PredictionCorrector if method == PREDICT else ThesisCorrector
        self._corrector: PredictionCorrector | ThesisCorrector = kind(self._state_at_fix, self._commands)
        self._step = 0
        self._pending_fixes: list[PoseFix] = []
        self._seen_s, self._last_command = start.time_s, (0.0, start.speed_mps, 0.0)
        self._unseen_s = 0.0
        self._mismatch_since_s: float | None = None
        self._measured_speed_mps: float | None = None
        self._rows: list[tuple[float, ...]] = []
        self.late_count = 0

    def _compute_step(self, time_s: float) -> int:
        return round((time_s - self._start_s) / DT_S)

    def add_command(
        self, time_s: float, steering_rad: float, speed_mps: float, implement: bool = False, *, is_exact: bool = False
    ) -> None:
        """Add a command of the real tractor at a time, which may be past: steering (positive right), speed (negative
        in reverse), whether the implement works. It holds until the next; a command older than the last is ignored.

        `is_exact` means that the command took effect at this time. Otherwise it was observed then, and may have taken
        effect at any time since the last observation: the middle is used, with its uncertainty. Raises VehicleError
        for numbers that are not finite.
        """
        if not all(map(math.isfinite, (time_s, steering_rad, speed_mps))):
            raise VehicleError(
                f"A command of {steering_rad} rad, {speed_mps} m/s at {time_s} s is not finite; give numbers."
            )
        if time_s < self._seen_s:
            return
        lock = math.radians(self.tractor.max_steering_deg)
        command = (min(max(steering_rad, -lock), lock), speed_mps, float(implement))
        unseen = 0.0 if is_exact else min(time_s - self._seen_s, LONGEST_UNSEEN_S)
        self._seen_s, self._unseen_s = time_s, unseen
        if command == self._last_command:
            return
        self._last_command = command
        self._hold_command(self._compute_step(time_s - 0.5 * unseen), unseen)

    def _hold_command(self, step: int, unseen_s: float) -> None:
        """Hold the last command from a step on, with the measured speed if that differs for long (section 5.2.2)."""
        steering, speed, implement = self._last_command
        speed = speed if self._measured_speed_mps is None else self._measured_speed_mps
        self._commands.set_command(max(step, self._commands.since), np.array([steering, speed, implement, unseen_s]))
        self._corrector.add_command(step, self._commands.held_command)

    def add_fix(self, fix: PoseFix) -> None:
        """Add a fix, which is used when the twin is advanced to its `arrived_s`.

        A fix more than 4 s old, or older than one used before, is counted in `late_count` and ignored. Raises
        VehicleError for numbers that are not finite.
        """
        _check_fix(fix)
        self._pending_fixes.append(fix)
        self._pending_fixes.sort(key=lambda pending: pending.arrived_s)

    def advance(self, time_s: float) -> TwinState:
        """Drive up to a time in steps of 1/60 s, using the fixes that have arrived; a past time does nothing."""
        end = self._compute_step(time_s)
        while self._pending_fixes and self._compute_step(self._pending_fixes[0].arrived_s) <= end:
            fix = self._pending_fixes.pop(0)
            self._advance_to(self._compute_step(fix.arrived_s))
            self._process_arrived_fix(fix)
        self._advance_to(end)
        self._corrector.propagate_to(self._step)
        return self.state

    def _advance_to(self, step: int) -> None:
        if step > self._step:
            self._commands.hold_until(step)
            self._state_at_fix.propagate_to(step - MAX_LATENESS_STEPS, self._commands)
            self._corrector.propagate_to(step)
            self._step = step

    def _process_arrived_fix(self, fix: PoseFix) -> None:
        seen_s = fix.time_s - self._arrays.latency_s
        step = min(math.floor((seen_s - self._start_s) / DT_S + 1e-6), self._step)
        if step < self._state_at_fix.propagated.step:
            self.late_count += 1
            return
        self._state_at_fix.propagate_to(step, self._commands)
        row = self._shift_fix_to_step(fix, seen_s - self._start_s - step * DT_S)
        offset = self._state_at_fix.correct_by_fix(row, fix.time_s, self._unseen_s <= MAX_COMMAND_GAP_S)
        self._update_speed_mismatch(fix)
        self._corrector.note_correction(step, row)
        if isinstance(self._corrector, ThesisCorrector):
            for applied_step, applied in self._corrector.applied:
                self._record_correction(fix.time_s, self._start_s + applied_step * DT_S, applied)
            self._corrector.applied.clear()
        else:
            self._record_correction(fix.time_s, fix.arrived_s, offset)

    def _shift_fix_to_step(self, fix: PoseFix, late_s: float) -> Floats:
        """The fix as it would have been at the step before its time, without the known bias of the heading."""
        angle, body = fix.heading_rad - self._arrays.bias_rad, self._state_at_fix.propagated.body
        angle -= float(body[5]) * late_s
        distance_m = fix.speed_mps * late_s
        return np.array(
            [fix.x_m - distance_m * math.cos(angle), fix.y_m - distance_m * math.sin(angle), angle, fix.speed_mps]
        )

    def _update_speed_mismatch(self, fix: PoseFix) -> None:
        before, (_, commanded_mps, working) = self._measured_speed_mps, self._last_command
        # Speed over ground as a share of the commanded speed, by the slip in the tractor's file.
        direction = math.copysign(1.0, commanded_mps)
        speed_share = direction * compute_ground_speed(direction, working, self._arrays.models[0])
        if abs(fix.speed_mps - commanded_mps * speed_share) <= SPEED_MISMATCH_MPS:
            self._mismatch_since_s, self._measured_speed_mps = None, None
        elif self._mismatch_since_s is None:
            self._mismatch_since_s = fix.time_s
        elif fix.time_s - self._mismatch_since_s >= SPEED_MISMATCH_S:
            self._measured_speed_mps = fix.speed_mps / speed_share
        if self._measured_speed_mps != before:
            self._hold_command(self._compute_step(fix.time_s), 0.0)

    def _record_correction(self, time_s: float, arrived_s: float, offset: Floats) -> None:
        self._rows.append((time_s, arrived_s, *(float(value) for value in offset)))
        del self._rows[:-MAX_CORRECTIONS]

    @property
    def state(self) -> TwinState:
        """The twin now."""
        propagated = self._corrector.propagated
        speed_mps = propagated.forward_mps * (1.0 + float(self._corrector.adaptation[1]))
        time_s, heading_rad = self._start_s + self._step * DT_S, float(propagated.body[2])
        return TwinState(time_s, *propagated.compute_antenna(), heading_rad, speed_mps)

    def predict_path(self, seconds: float) -> Floats:
        """The predicted path (n, 3) under the held command: antenna east and north (m), heading (rad), every 0.1 s
        from now on."""
        pieces = max(0, round(seconds / (PIECE_STEPS * DT_S)))
        poses = self._corrector.propagated.predict_path(pieces, self._commands, self._corrector.adaptation)
        angle, machine = poses[:, 2], self._arrays
        poses[:, 0] += machine.ahead_m * np.cos(angle) + machine.right_m * np.sin(angle)
        poses[:, 1] += machine.ahead_m * np.sin(angle) - machine.right_m * np.cos(angle)
        return poses

    @property
    def corrections(self) -> dict[str, Floats]:
        """The last 36,000 corrections as columns (k,): time of the fix and of its arrival (thesis: of the correction),
        measured less predicted ahead and to the right (m) and in heading (rad).
        """
        table = np.array(self._rows, dtype=np.float64).reshape(-1, len(CORRECTION_COLUMNS))
        return {name: table[:, column].copy() for column, name in enumerate(CORRECTION_COLUMNS)}

    @property
    def last_correction(self) -> tuple[float, float, float] | None:
        """The last correction: ahead and to the right (m) and in heading (rad); None before the first."""
        return None if not self._rows else (self._rows[-1][2], self._rows[-1][3], self._rows[-1][4])

    def find_mismatch(self) -> ModelMismatch | None:
        """Whether, and since when, the corrections exceed what noise explains.

        If commands are observed less often than every 0.4 s there is no evidence, and no mismatch.
        """
        return self._test.find_mismatch()

    @property
    def evidence_s(self) -> float:
        """Noise alone would give as much evidence against the twin once in so many seconds (vehicle.twin.mismatch)."""
        return self._test.evidence_s

    @property
    def jumps(self) -> tuple[PositionJump, ...]:
        """Jumps of the fix, which are no evidence against the tractor's file (vehicle.twin.mismatch)."""
        return tuple(self._state_at_fix.jump_detector.jumps)

    @property
    def rejected_count(self) -> int:
        """Number of outliers: fixes more than 8 standard deviations from the prediction."""
        return self._state_at_fix.rejected_count


def _check_fix(fix: PoseFix) -> None:
    if not all(map(math.isfinite, (fix.time_s, fix.x_m, fix.y_m, fix.heading_rad, fix.speed_mps, fix.arrived_s))):
        raise VehicleError(f"{fix} holds a number that is not finite; give finite numbers.")
    if fix.arrived_s < fix.time_s:
        raise VehicleError(
            f"A fix of {fix.time_s:g} s cannot arrive at {fix.arrived_s:g} s; give both times on one clock."
        )
