"""Propagation of a tractor along held commands: a ring buffer of commands per step, and the loop that drives by it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fields.arrays import Floats, Records
from vehicle.jit import compile_function
from vehicle.records import DT_S
from vehicle.sim.effect_terms import compute_draft_crab_share
from vehicle.sim.loop import drive_tractor
from vehicle.twin.kalman_filter import predict_filter
from vehicle.twin.step_motion import TractorArrays, move_body, turn_body

RING_STEPS = 1024  # 17 s of commands, four times as long as any fix may be late
STEERING_COLUMN, SPEED_COLUMN, WORKING_COLUMN, GAP_COLUMN = range(4)
SPEED_SETTLING_S = 1.0  # time constant of a speed error after a changed command
PIECE_STEPS = 6  # between two predictions of the filters: 0.1 s
# Motion of the model over a piece: m ahead, m to the right, rad, m driven; its change of turning rate (rad/s) and of
# speed (m/s), and how long before it was observed its command may have taken effect (s).
AHEAD, RIGHT, TURNED, DISTANCE, SPIN_CHANGE, SPEED_CHANGE, UNSEEN = range(7)
NOMINAL_SIZE = UNSEEN + 1


class CommandBuffer:
    """Commands per step: steering (rad, positive right), speed (m/s, signed), implement (0 or 1), and for how long (s)
    before it was observed the command may have been in effect.

    Holds the last 17 s. `known_steps` is the first step without a command.
    """

    def __init__(self, steering_rad: float, speed_mps: float) -> None:
        self.ring = np.zeros((RING_STEPS, 4))
        self.held_command = np.array([steering_rad, speed_mps, 0.0, 0.0])
        self.since = 0
        self.known_steps = 0

    def hold_until(self, step: int) -> None:
        """Hold the last command up to a step."""
        if step > self.known_steps:
            self._write_held_command(max(self.known_steps, step - RING_STEPS), step)
            self.known_steps = step

    def _write_held_command(self, first: int, end: int) -> None:
        """Write the held command to the steps from `first` to before `end`, at most RING_STEPS of them."""
        if first < end:
            start, stop = first % RING_STEPS, (end - 1) % RING_STEPS + 1
            if start < stop:
                self.ring[start:stop] = self.held_command
            else:
                self.ring[start:] = self.ring[:stop] = self.held_command

    def set_command(self, step: int, command: Floats) -> None:
        """Set a command from a step on, which may be past; a command older than the last is ignored."""
        if step < self.since:
            return
        self.hold_until(step)
        self.held_command = command
        self.since = step
        first = max(step, self.known_steps - RING_STEPS)
        self._write_held_command(first, self.known_steps)


@compile_function
def propagate(  # type: ignore[no-untyped-def]
    steps, first, dt, states, body, adaptation, nominal, ring, models, grounds, ground, tables
) -> None:
    """Drive the tractor of `states` (1,) for `steps` steps from the step `first` by the commands in `ring`.

    `adaptation` (2,) is extra turn (rad per m driven, counter-clockwise) and slip ahead (share of the distance).
    `nominal` (7,) sums the motion without it, seen from the pose at the start; columns as above.
    """
    state, model, table = states[0], models[0], tables[ground]
    force = np.zeros(3)
    size = len(ring)
    for step in range(first, first + steps):
        row = step % size
        state.command, state.target_speed = ring[row, STEERING_COLUMN], ring[row, SPEED_COLUMN]
        state.working = ring[row, WORKING_COLUMN]
        cosine, sine = math.cos(body[2]), math.sin(body[2])
        forward, right = body[3] * cosine + body[4] * sine, body[3] * sine - body[4] * cosine
        along, across = math.cos(nominal[TURNED]), math.sin(nominal[TURNED])
        nominal[AHEAD] += (forward * along + right * across) * dt
        nominal[RIGHT] += (right * along - forward * across) * dt
        nominal[TURNED] += body[5] * dt
        nominal[DISTANCE] += abs(forward) * dt
        drive_tractor(state, model, grounds, ground, table, body, force, dt)
        move_body(body, force, model.mass, model.inertia, dt)
        body[0] += adaptation[1] * forward * cosine * dt
        body[1] += adaptation[1] * forward * sine * dt
        if adaptation[0] != 0.0:
            turn_body(body, adaptation[0] * abs(forward) * dt)


@compile_function
def propagate_with_filters(  # type: ignore[no-untyped-def]
    steps, first, dt, states, body, ring, models, grounds, ground, tables, carried,
    estimate, covariance, parameters, monitor, monitor_covariance, monitor_parameters, shifts, sizes,
) -> None:  # fmt: skip
    """Propagate a tractor and predict two filters piece by piece: the tracker, whose pose is the body, and the monitor.

    `carried` (2,) is the turning rate at the end of the last piece, and the uncertainty of the model's speed (m/s) from
    the unknown time at which a command took effect. `shifts` and `sizes` as in predict_filter.
    """
    state, model = states[0], models[0]
    rear, crab = model.rear, compute_draft_crab_share(model, grounds[ground]) * (model.front + model.rear)
    nominal = np.zeros(NOMINAL_SIZE)
    done = 0
    while done < steps:
        piece_steps = min(PIECE_STEPS, steps - done)
        nominal[:] = 0.0
        nominal[UNSEEN] = ring[(first + done) % len(ring), GAP_COLUMN]
        angle, speed = body[2], state.forward
        propagate(
            piece_steps, first + done, dt, states, body, estimate[3:5], nominal, ring, models, grounds, ground, tables
        )
        nominal[SPIN_CHANGE], nominal[SPEED_CHANGE] = body[5] - carried[0], state.forward - speed
        seconds = piece_steps * dt
        predict_filter(
            estimate, covariance, parameters, angle, nominal, seconds,
            False, state.working, rear, crab, shifts[:0], sizes,
        )  # fmt: skip
        predict_filter(
            monitor, monitor_covariance, monitor_parameters, monitor[2], nominal, seconds,
            True, state.working, rear, crab, shifts, sizes,
        )  # fmt: skip
        carried[0] = body[5]
        uncertainty_mps = 0.5 * nominal[UNSEEN] * abs(nominal[SPEED_CHANGE]) / seconds
        carried[1] = max(carried[1] * math.exp(-piece_steps * dt / SPEED_SETTLING_S), uncertainty_mps)
        done += piece_steps


@compile_function
def propagate_path(  # type: ignore[no-untyped-def]
    first, steps_per_pose, dt, states, body, adaptation, ring, models, grounds, ground, tables, out
) -> None:
    """Write poses `out` (n, 3) of the body, `steps_per_pose` steps apart, beginning with the present one."""
    nominal = np.zeros(NOMINAL_SIZE)
    for row in range(len(out)):
        out[row] = body[:3]
        if row + 1 < len(out):
            start = first + row * steps_per_pose
            propagate(
                steps_per_pose, start, dt, states, body, adaptation, nominal, ring, models, grounds, ground, tables
            )


class PropagatedTractor:
    """A tractor at a step: `state` (1,) and `body` (6,), propagated by commands of a CommandBuffer."""

    def __init__(self, arrays: TractorArrays, ground: int, state: Records, body: Floats, step: int) -> None:
        self.arrays, self.ground, self.state, self.body, self.step = arrays, ground, state, body, step

    def copy(self) -> PropagatedTractor:
        """An independent copy."""
        state = self.state.view(np.uint8).copy().view(self.state.dtype)  # twenty times faster than by field
        return PropagatedTractor(self.arrays, self.ground, state, self.body.copy(), self.step)

    @property
    def compiled_loop_arguments(self) -> tuple[Any, Any, Any, Any]:
        """Models, grounds, ground and tables for the loop."""
        return self.arrays.models, self.arrays.grounds, self.ground, self.arrays.tables

    def propagate_to(self, step: int, commands: CommandBuffer, adaptation: Floats) -> None:
        """Drive up to a step."""
        if step > self.step:
            commands.hold_until(step)
            propagate(
                step - self.step, self.step, DT_S, self.state, self.body, adaptation, np.zeros(NOMINAL_SIZE),
                commands.ring, *self.compiled_loop_arguments,
            )  # fmt: skip
            self.step = step

    def predict_path(self, pieces: int, commands: CommandBuffer, adaptation: Floats) -> Floats:
        """Poses (pieces + 1, 3) of the body from now on, 0.1 s apart, under the held command; does not move it."""
        ring = np.tile(commands.held_command, (RING_STEPS, 1))
        copy, out = self.copy(), np.empty((pieces + 1, 3))
        propagate_path(
            self.step, PIECE_STEPS, DT_S, copy.state, copy.body, adaptation, ring, *self.compiled_loop_arguments, out
        )
        return out

    @property
    def forward_mps(self) -> float:
        """Forward speed."""
        return float(self.body[3] * math.cos(self.body[2]) + self.body[4] * math.sin(self.body[2]))

    @property
    def instrument_motion(self) -> tuple[float, float, float, float]:
        """The lever arm of the antenna ahead and to the right (m), forward speed and spin: what a filter asks of it."""
        return self.arrays.ahead_m, self.arrays.right_m, self.forward_mps, float(self.body[5])

    def compute_antenna(self) -> tuple[float, float]:
        """East and north of the antenna (m)."""
        return self.arrays.locate_antenna(self.body[:3])

    def shift(self, east_m: float, north_m: float, turn_rad: float) -> None:
        """Move it, and turn it about its centre of mass."""
        self.body[0] += east_m
        self.body[1] += north_m
        turn_body(self.body, turn_rad)
