"""The two methods that correct a twin by fixes of the real tractor.

thesis    section 5.2.3: once a second the twin is moved smoothly to the last received fix, whatever its age
predict   a fix corrects the twin at the time of the fix by their uncertainties; from there the twin is propagated to
          now with the commands known by then, steering dead time included, and the estimated turn and slip
"""

from __future__ import annotations

import math

import numpy as np

from fields.arrays import Floats
from vehicle.records import DT_S
from vehicle.twin.kalman_filter import STATE_SIZE, PoseFilter, update_by_fix
from vehicle.twin.mismatch import RESTART_SIGMA_M, JumpDetector, MismatchTest, is_jump
from vehicle.twin.propagation import CommandBuffer, PropagatedTractor, propagate_with_filters

MAX_LATENESS_STEPS = 240  # 4 s
OUTLIER_SIGMAS = 8.0  # standard deviations beyond which a fix is an outlier
MAX_OUTLIERS = 3  # as many in a row are accepted
CORRECTION_STEPS = round(1.0 / DT_S)  # between two corrections of the thesis
BLEND_STEPS = 12  # over which a correction is spread (assumed: 0.2 s)
NO_ADAPTATION = np.zeros(2)


class StateAtFix:
    """The twin as it was at the last fix, with tracker and monitor; it is never ahead of now."""

    def __init__(
        self, propagated: PropagatedTractor, tracker: PoseFilter, monitor: PoseFilter, test: MismatchTest
    ) -> None:
        self.propagated, self.tracker, self.monitor, self.test = propagated, tracker, monitor, test
        self._carried = np.zeros(2)  # turning rate and uncertainty of the speed from the last piece on
        self._outliers = 0
        self.rejected_count = 0
        self.jump_detector = JumpDetector()
        self.empty_means = np.zeros((4, 0))

    @property
    def adaptation(self) -> Floats:
        """Extra turn (rad per m) and slip (share) over the model's."""
        return self.tracker.estimate[3:5]

    def propagate_to(self, step: int, commands: CommandBuffer) -> None:
        """Drive on to a step."""
        propagated, tracker, monitor = self.propagated, self.tracker, self.monitor
        if step <= propagated.step:
            return
        commands.hold_until(step)
        propagate_with_filters(
            step - propagated.step, propagated.step, DT_S, propagated.state, propagated.body, commands.ring,
            *propagated.compiled_loop_arguments, self._carried, *tracker.arrays, *monitor.arrays,
            self.test.shifts, self.test.sizes,
        )  # fmt: skip
        propagated.step = step
        tracker.estimate[:3] = propagated.body[:3]

    def correct_by_fix(self, fix: Floats, time_s: float, is_conclusive: bool = True) -> Floats:
        """Correct by a fix (4,) of this step; returns measured less predicted (3,): ahead, right (m), turned (rad).

        A fix that is not `is_conclusive`, because too little is known of the commands before it, is no evidence about
        the tractor's file: the monitor restarts at its place.
        """
        propagated, tracker = self.propagated, self.tracker
        pose, turned = propagated.body[:3].copy(), fix[2] - propagated.body[2]
        offset = _compute_offset(propagated, fix, math.atan2(math.sin(turned), math.cos(turned)))
        before = tracker.estimate.copy(), tracker.covariance.copy()
        if not self._update_tracker(fix):
            self._handle_outlier(fix, time_s, offset)
            return offset
        after_outlier, self._outliers = self._outliers > 0, 0
        if is_conclusive and self._add_evidence_of_fix(fix, time_s, offset, after_outlier):
            tracker.estimate[:], tracker.covariance[:] = before
            tracker.add_position_uncertainty(RESTART_SIGMA_M)
            self._update_tracker(fix)
        moved = tracker.estimate[:3] - pose
        propagated.shift(float(moved[0]), float(moved[1]), float(moved[2]))
        if not is_conclusive:
            self.monitor.reset(tracker.estimate[:3])
            self.test.shifts[:] = 0.0
        return offset

    def _update_tracker(self, fix: Floats) -> bool:
        """Correct the tracker; returns False, unchanged, for an outlier."""
        no_shifts = np.zeros((0, STATE_SIZE)), np.zeros(0)
        return update_by_fix(
            *self.tracker.arrays, fix, *self.propagated.instrument_motion, self._carried[1],
            *no_shifts, OUTLIER_SIGMAS, np.zeros(4), self.empty_means,
        )  # fmt: skip

    def _add_evidence_of_fix(self, fix: Floats, time_s: float, offset: Floats, after_outlier: bool) -> bool:
        """Correct the monitor and add its innovation to the evidence; returns whether the fix may have jumped.

        With `after_outlier` it follows outliers, whose jump is recorded already.
        """
        monitor, test = self.monitor, self.test
        before_update = monitor.estimate.copy(), monitor.covariance.copy(), test.shifts.copy()
        self._update_monitor(fix, test.whitened, test.means)
        is_sudden = is_jump(test.whitened)
        if is_sudden:  # accept the place; only its innovation counts as evidence
            monitor.estimate[:], monitor.covariance[:], test.shifts[:] = before_update
            monitor.add_position_uncertainty(RESTART_SIGMA_M)
            self._update_monitor(fix, np.zeros(4), np.zeros_like(test.means))
        was_jump, may_be_jump = self.jump_detector.add_fix(time_s, offset, is_sudden and not after_outlier)
        test.add_fix(time_s, was_jump)
        return may_be_jump or (after_outlier and is_sudden)

    def _update_monitor(self, fix: Floats, whitened: Floats, means: Floats) -> None:
        """Correct the monitor and the shifts by effects; writes `whitened` and `means`."""
        update_by_fix(
            *self.monitor.arrays, fix, *self.propagated.instrument_motion, -1.0,
            self.test.shifts, self.test.sizes, math.inf, whitened, means,
        )  # fmt: skip

    def _handle_outlier(self, fix: Floats, time_s: float, offset: Floats) -> None:
        """Ignore an outlier, unless there are several in a row: then move the twin there."""
        self.rejected_count += 1
        if self._outliers == 0:
            self.jump_detector.add_outlier(time_s, offset)
        self._outliers += 1
        if self._outliers < MAX_OUTLIERS:
            return
        self._outliers = 0
        body = self.propagated.body
        x, y = self.propagated.arrays.locate_antenna(np.array([0.0, 0.0, fix[2]]))
        turned = math.remainder(fix[2] - body[2], 2.0 * math.pi)
        self.propagated.shift(fix[0] - x - body[0], fix[1] - y - body[1], turned)
        for pose_filter in (self.tracker, self.monitor):
            pose_filter.reset(body[:3])
        self.test.shifts[:] = 0.0


def _compute_offset(propagated: PropagatedTractor, fix: Floats, turned_rad: float) -> Floats:
    """How far a fix is ahead and to the right of the antenna (m), and the turn (rad) that is given."""
    x, y = propagated.compute_antenna()
    east, north, angle = fix[0] - x, fix[1] - y, propagated.body[2]
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([east * cosine + north * sine, east * sine - north * cosine, turned_rad])


class PredictionCorrector:
    """Prediction over the age of a fix: the present is propagated from the state at the last fix."""

    def __init__(self, state_at_fix: StateAtFix, commands: CommandBuffer) -> None:
        self.state_at_fix, self.commands = state_at_fix, commands
        self.propagated = state_at_fix.propagated.copy()
        self._stale = False

    def add_command(self, step: int, command: Floats) -> None:
        """Add a command from a step on; later steps are driven again."""
        self._stale = self._stale or step < self.propagated.step

    def note_correction(self, step: int, fix: Floats) -> None:
        """Note that the state at the last fix has changed."""
        self._stale = True

    def propagate_to(self, step: int) -> None:
        """Drive on to a step."""
        if self._stale:
            self.propagated, self._stale = self.state_at_fix.propagated.copy(), False
        self.propagated.propagate_to(step, self.commands, self.state_at_fix.adaptation)

    @property
    def adaptation(self) -> Floats:
        """Extra turn (rad per m) and slip (share) over the model's."""
        return self.state_at_fix.adaptation


class ThesisCorrector:
    """The thesis's method: commands apply when they arrive, and once a second the twin moves to the last fix."""

    def __init__(self, state_at_fix: StateAtFix, commands: CommandBuffer) -> None:
        self.propagated = state_at_fix.propagated.copy()
        self.adaptation = NO_ADAPTATION
        self.commands = CommandBuffer(float(commands.held_command[0]), float(commands.held_command[1]))
        self.applied: list[tuple[int, Floats]] = []
        self._fix: Floats | None = None
        self._remaining_steps, self._shift = 0, np.zeros(3)

    def add_command(self, step: int, command: Floats) -> None:
        """Add a command that has arrived now."""
        self.commands.set_command(self.propagated.step, command)

    def note_correction(self, step: int, fix: Floats) -> None:
        """Note a fix that has arrived."""
        self._fix = fix

    def propagate_to(self, step: int) -> None:
        """Drive on to a step, with the corrections that are due before it."""
        while self.propagated.step < step:
            now = self.propagated.step
            if now % CORRECTION_STEPS == 0 and now > 0 and self._fix is not None:
                self._start_correction()
            until = min(step, now + 1 if self._remaining_steps else (now // CORRECTION_STEPS + 1) * CORRECTION_STEPS)
            self.propagated.propagate_to(until, self.commands, NO_ADAPTATION)
            if self._remaining_steps:
                self._remaining_steps -= 1
                self.propagated.shift(*(float(value) for value in self._shift))

    def _start_correction(self) -> None:
        """Begin to move the twin to the last fix."""
        fix, body = self._fix, self.propagated.body
        assert fix is not None
        turned = math.remainder(float(fix[2]) - float(body[2]), 2.0 * math.pi)
        x, y = self.propagated.arrays.locate_antenna(np.array([body[0], body[1], body[2] + turned]))
        self._shift = np.array([fix[0] - x, fix[1] - y, turned]) / BLEND_STEPS
        self._remaining_steps = BLEND_STEPS
        self.applied.append((self.propagated.step, _compute_offset(self.propagated, fix, turned)))
        self._fix = None
