"""A tractor rolled along held commands: a ring of what was commanded at each step, and the loop that drives by it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vehicle.jit import compiled
from vehicle.layout import DT_S
from vehicle.loop import drive_tractor
from vehicle.twin.belief import spread
from vehicle.twin.motion import Array, Machine, Records, move, turn_body

RING = 1024  # steps that commands are kept for: 17 s, four times as long as any fix may be late
STEER, SPEED, WORKING, GAP = range(4)
SETTLED_S = 1.0  # in which an error of the speed after a change of its command is forgotten
PIECE = 6  # steps between two looks at how sure a pose is: 0.1 s
# Motion over a piece as the model has it: m ahead, m to the right, rad, m along; change of the turning rate (rad/s) and
# of speed (m/s) in it, and how long before its command was seen it may have come into force (s).
WAY, ASIDE, TURNED, PATH, SPIN_CHANGE, SPEED_CHANGE, UNSEEN_S = range(7)
NOMINAL = 7


class Commands:
    """What was commanded per step: steering (rad, positive right), speed (m/s, signed), implement (0 or 1), and for how
    long before it was seen it may have been in force (s).

    Those of the last 17 s are kept. `head` is the first step that nothing is known of yet.
    """

    def __init__(self, steering_rad: float, speed_mps: float) -> None:
        self.ring = np.zeros((RING, 4))
        self.held = np.array([steering_rad, speed_mps, 0.0, 0.0])
        self.since = 0
        self.head = 0

    def extend(self, step: int) -> None:
        """Hold the last command up to a step."""
        if step > self.head:
            self._fill(max(self.head, step - RING), step)
            self.head = step

    def _fill(self, first: int, end: int) -> None:
        """Write the held command to the steps from `first` to before `end`, a ring's length of them at most."""
        if first < end:
            one, two = first % RING, (end - 1) % RING + 1
            if one < two:
                self.ring[one:two] = self.held
            else:
                self.ring[one:] = self.ring[:two] = self.held

    def set(self, step: int, command: Array) -> None:
        """A command from a step on, which may be gone by; one older than the last is not taken."""
        if step < self.since:
            return
        self.extend(step)
        self.held = command
        self.since = step
        first = max(step, self.head - RING)
        self._fill(first, self.head)


@compiled
def roll(  # type: ignore[no-untyped-def]
    steps, first, dt, states, body, learnt, nominal, ring, models, grounds, ground, tables
) -> None:  # fmt: skip
    """Drive the one of `states` (1,) so many steps from the step `first` on by the commands in the ring.

    `learnt` (2,) turns the tractor besides (rad per m driven, counter-clockwise) and lets it slip ahead (share of the
    way). `nominal` (7,) gathers the motion without it, seen from the pose at the start, columns as above.
    """
    state, model, table = states[0], models[0], tables[ground]
    force = np.zeros(3)
    size = len(ring)
    for step in range(first, first + steps):
        row = step % size
        state.command, state.target_speed, state.working = ring[row, STEER], ring[row, SPEED], ring[row, WORKING]
        cosine, sine = math.cos(body[2]), math.sin(body[2])
        forward, right = body[3] * cosine + body[4] * sine, body[3] * sine - body[4] * cosine
        there, across = math.cos(nominal[TURNED]), math.sin(nominal[TURNED])
        nominal[WAY] += (forward * there + right * across) * dt
        nominal[ASIDE] += (right * there - forward * across) * dt
        nominal[TURNED] += body[5] * dt
        nominal[PATH] += abs(forward) * dt
        drive_tractor(state, model, grounds, ground, table, body, force, dt)
        move(body, force, model.mass, model.inertia, dt)
        body[0] += learnt[1] * forward * cosine * dt
        body[1] += learnt[1] * forward * sine * dt
        if learnt[0] != 0.0:
            turn_body(body, learnt[0] * abs(forward) * dt)


@compiled
def roll_believing(  # type: ignore[no-untyped-def]
    steps, first, dt, states, body, ring, models, grounds, ground, tables, before,
    estimate, spreading, spec, other, other_spreading, other_spec, shifts, sizes,
) -> None:  # fmt: skip
    """Roll, and let two beliefs follow piece by piece: the first one's pose is the body, the other's is its own.

    `before` (2,) is carried on: the turning rate at the end of the last piece, and how wrong the model's speed may be
    (m/s) because a command came into force sooner or later than is known. `shifts` and `sizes` as in belief.
    """
    state, rear = states[0], models[0].rear
    nominal = np.zeros(NOMINAL)
    done = 0
    while done < steps:
        now = min(PIECE, steps - done)
        nominal[:] = 0.0
        nominal[UNSEEN_S] = ring[(first + done) % len(ring), GAP]
        angle, speed = body[2], state.forward
        roll(now, first + done, dt, states, body, estimate[3:5], nominal, ring, models, grounds, ground, tables)
        nominal[SPIN_CHANGE], nominal[SPEED_CHANGE] = body[5] - before[0], state.forward - speed
        spread(estimate, spreading, spec, angle, nominal, now * dt, False, state.working, rear, shifts[:0], sizes)
        spread(
            other, other_spreading, other_spec, other[2], nominal, now * dt, True, state.working, rear, shifts, sizes
        )  # fmt: skip
        before[0] = body[5]
        unsure = 0.5 * nominal[UNSEEN_S] * abs(nominal[SPEED_CHANGE]) / (now * dt)
        before[1] = max(before[1] * math.exp(-now * dt / SETTLED_S), unsure)
        done += now


@compiled
def roll_path(  # type: ignore[no-untyped-def]
    first, every, dt, states, body, learnt, ring, models, grounds, ground, tables, out
) -> None:  # fmt: skip
    """Poses `out` (n, 3) of the body, `every` steps apart, the first one as it stands."""
    nominal = np.zeros(NOMINAL)
    for row in range(len(out)):
        out[row] = body[:3]
        if row + 1 < len(out):
            roll(every, first + row * every, dt, states, body, learnt, nominal, ring, models, grounds, ground, tables)


class Rolled:
    """A tractor at a step: `state` (1,), `body` (6,), rolled by commands of a ring."""

    def __init__(self, machine: Machine, ground: int, state: Records, body: Array, step: int) -> None:
        self.machine, self.ground, self.state, self.body, self.step = machine, ground, state, body, step

    def copy(self) -> Rolled:
        """One of its own."""
        state = self.state.view(np.uint8).copy().view(self.state.dtype)  # twenty times as fast as field by field
        return Rolled(self.machine, self.ground, state, self.body.copy(), self.step)

    @property
    def parts(self) -> tuple[Any, Any, Any, Any]:
        """Models, grounds, ground and tables for the loop."""
        return self.machine.models, self.machine.grounds, self.ground, self.machine.tables

    def to(self, step: int, commands: Commands, learnt: Array) -> None:
        """Drive up to a step."""
        if step > self.step:
            commands.extend(step)
            roll(
                step - self.step, self.step, DT_S, self.state, self.body, learnt, np.zeros(NOMINAL), commands.ring,
                *self.parts,
            )  # fmt: skip
            self.step = step

    def path(self, pieces: int, commands: Commands, learnt: Array) -> Array:
        """Poses (pieces + 1, 3) of the body from now on, 0.1 s apart, under the held command; it stays where it is."""
        ring = np.tile(commands.held, (RING, 1))
        copy, out = self.copy(), np.empty((pieces + 1, 3))
        roll_path(self.step, PIECE, DT_S, copy.state, copy.body, learnt, ring, *self.parts, out)
        return out

    @property
    def forward_mps(self) -> float:
        """Speed ahead."""
        return float(self.body[3] * math.cos(self.body[2]) + self.body[4] * math.sin(self.body[2]))

    def antenna(self) -> tuple[float, float]:
        """Where the antenna is (m)."""
        return antenna_of(self.machine, self.body[:3])

    def shift(self, east_m: float, north_m: float, turn_rad: float) -> None:
        """Move and turn it about its centre of mass."""
        self.body[0] += east_m
        self.body[1] += north_m
        turn_body(self.body, turn_rad)


def antenna_of(machine: Machine, pose: Array) -> tuple[float, float]:
    """East and north (m) of the antenna of a body at a pose (x, y, angle)."""
    x, y, angle = (float(value) for value in pose)
    ahead, right = machine.ahead_m, machine.right_m
    return (
        x + ahead * math.cos(angle) + right * math.sin(angle),
        y + ahead * math.sin(angle) - right * math.cos(angle),
    )
