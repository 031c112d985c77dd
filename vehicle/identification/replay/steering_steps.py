"""Steering through logged commands, one per step of the grid, with the steering simulator of planning."""

from __future__ import annotations

from typing import Any

import numpy as np

from vehicle.identification.logs.schema import Array
from vehicle.jit import compile_function
from vehicle.records import HISTORY_STEPS, STATE
from vehicle.sim.dynamics import step_steering_system
from vehicle.sim.effect_terms import apply_play


def make_settled_state(command: Array, earlier: Array) -> Any:
    """Return the state of a tractor that was given `earlier` commands (m,) before the first one of `command` (n,).

    Without any its wheels have settled at the first command. What delays cannot reach back to is left out.
    """
    state = np.zeros(1, dtype=STATE)
    reached = earlier[max(len(earlier) - HISTORY_STEPS + 2, 0) :]
    state["commands"] = command[0]
    state["commands"][0, : len(reached)] = reached
    state["clock"] = len(reached)
    return state


@compile_function
def simulate_steering_steps(command, first, dt, state, model, out) -> None:  # type: ignore[no-untyped-def]
    """Steer through one command per step from wheel angle `first`; `out` (n + 1,) gets the wheel angle before each step
    and after the last."""
    state.steering = state.play = state.commands[-1] = first
    for i in range(len(command)):
        state.command = command[i]
        out[i] = state.steering
        step_steering_system(state, model, dt)
        state.clock += 1
    out[len(command)] = state.steering


@compile_function
def apply_play_steps(wheel, steady, first, noisy, model, out) -> None:  # type: ignore[no-untyped-def]
    """Write wheel angles behind the play to `out` (n,), from those before it (n,) and without noise, `steady` (n,).

    The play begins at `first` and follows the denoised angles: extremes of noise would take up part of it. Angles that
    are not `noisy` are their own `steady` ones.
    """
    play = first
    for i in range(len(wheel)):
        play = apply_play(play, steady[i], model)
        out[i] = wheel[i] + (play - steady[i]) if noisy else play
