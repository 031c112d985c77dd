"""Replay of logged commands, one per step of the grid, with the functions that planning simulates with.

No pymunk space is needed for one tractor without contacts: steering, drive line, effects and chassis are the functions
of the planning loop, and the position is moved as pymunk moves it, with the velocity before the step. Effects that
depend on place or direction use the measured pose, so one simulation serves every horizon.

Lateness of positions and headings is added to what a replay shows. Speeds, wheel angles and commands are inputs of a
replay as well: there their clocks and scale are taken out first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from vehicle.fast_math import compute_cosine_sine
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.jit import compile_function
from vehicle.model.effect_kinds import PER_SLOPE
from vehicle.model.effects import DISCREPANCY_KEY, PATH, SLOPE_DRIFT, SPEED, STEP_HZ, compute_effect_fields, get_effect
from vehicle.model.effects import STEERING as STEERS
from vehicle.model.ground import find_ground_index
from vehicle.model.instruments import (
    SHOWN_EAST,
    SHOWN_HEADING,
    SHOWN_NORTH,
    compute_filter_share,
    write_instrument_poses,
)
from vehicle.model.tractor import (
    Implement,
    LogCorrections,
    Settings,
    Tractor,
    get_log_corrections,
    remove_log_corrections,
)
from vehicle.records import DT_S, HISTORY_STEPS, STATE
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.compile import build_ground_records, build_model_record
from vehicle.sim.dynamics import compute_rolling_resistance, step_body, step_speed_control, step_steering_system
from vehicle.sim.effect_terms import apply_play, compute_affected_tangent, compute_draft_crab, compute_ground_drift

X_COLUMN, Y_COLUMN, ANGLE_COLUMN, STEERING_COLUMN, FORWARD_COLUMN = range(5)
"""Columns of states: place (m) and angle (rad), wheel angle (rad), speed (m/s)."""


def split_settings_by_block(settings: Settings, blocks: frozenset[str]) -> Settings:
    """Split the effects into those of some blocks of the chain and the others."""
    return {
        name: values for name, values in settings.items() if name == DISCREPANCY_KEY or get_effect(name).block in blocks
    }


@compile_function
def drive_segment(  # type: ignore[no-untyped-def]
    wheel_angle, speed, is_speed_known, target, working, east, north, heading, cosines, sines, downhill, start_s, dt,
    state, model, ground, table, out,
) -> None:  # fmt: skip
    """Drive at the measured or the commanded speed, one input value per step; `out` (n, 5) gets x, y, angle and speed
    before each step.

    `wheel_angle` is behind the play, `cosines` and `sines` are of `heading`; `downhill` is the drift to the right (m/m)
    on a measured slope, in addition to the model's. Speeds are over ground: where the ground drift carries the tractor
    along, it is included.
    """
    x, y, angle, forward = east[0], north[0], heading[0], speed[0]
    state.reference_speed = forward
    right = spin = 0.0
    for i in range(len(wheel_angle)):
        if is_speed_known:
            forward = speed[i]
            drive = compute_rolling_resistance(forward, model, ground)
        else:
            state.working, state.target_speed = working[i], target[i]
            drive = step_speed_control(state, model, ground, forward, dt)
        out[i, X_COLUMN], out[i, Y_COLUMN], out[i, ANGLE_COLUMN], out[i, FORWARD_COLUMN] = x, y, angle, forward
        heading_cosine, heading_sine = cosines[i], sines[i]
        tangent = compute_affected_tangent(
            wheel_angle[i], forward, east[i], north[i], heading_cosine, heading_sine, start_s + i * dt, working[i],
            table, model,
        )  # fmt: skip
        along, slide = compute_ground_drift(wheel_angle[i], forward, heading_cosine, heading_sine, model)
        slide += abs(forward) * downhill[i]
        if model.draft != 0.0:
            slide += compute_draft_crab(forward, working[i], model, ground)
        new_forward, new_right, new_spin = step_body(forward, right - slide, spin, tangent, drive, dt, model, ground)
        cosine, sine = compute_cosine_sine(angle)
        x += ((forward + along) * cosine + right * sine) * dt
        y += ((forward + along) * sine - right * cosine) * dt
        angle -= spin * dt
        forward, right, spin = new_forward, new_right + slide, new_spin


@dataclass(frozen=True, eq=False)
class ReplayRig:
    """A tractor ready for replay: its compiled model without effects, the ground, and the steering table.

    `ranges` limit a discrepancy model to where it was observed; one that is still being fitted has none.
    """

    tractor: Tractor
    model: Any
    ground: Any
    table: Array
    origin: tuple[float, float] = (0.0, 0.0)
    ranges: Mapping[str, float] = field(default_factory=dict)

    def build_effective_model(self, settings: Settings) -> Any:
        """Build the model record with effects; places in the field are moved to the origin of the dataset."""
        model = self.model.copy()
        fields = LogCorrections(settings, self.ranges).fields
        fields["affected"] = 1.0
        fields["patch_east"] -= self.origin[0]
        fields["patch_north"] -= self.origin[1]
        for name, value in fields.items():
            model[0][name] = value
        return model


def build_rig(tractor: Tractor, ground: str, origin: tuple[float, float]) -> ReplayRig:
    """Build the rig of a tractor without the effects learnt from logs.

    Raises VehicleError for an unknown ground.
    """
    bare = remove_log_corrections(tractor)
    index = find_ground_index(ground)
    model = np.zeros(1, dtype=build_model_record(bare, Implement()).dtype)
    model[0] = build_model_record(bare, Implement())
    return ReplayRig(bare, model, build_ground_records()[index : index + 1], build_steering_tables(bare)[index], origin)


def build_rig_and_corrections(tractor: Tractor, ground: str, origin: tuple[float, float]) -> tuple[ReplayRig, Settings]:
    """Build the rig of a tractor, and return what its file has from logs: effects, and the discrepancy model with its
    ranges."""
    learnt_effects = get_log_corrections(tractor)
    return replace(build_rig(tractor, ground, origin), ranges=learnt_effects.ranges), learnt_effects.settings


def replay_segment(
    rig: ReplayRig, segment: DriveSegment, settings: Settings, from_sensor: bool, from_speed: bool
) -> Array:
    """Return states (n, 5) on the grid of a segment.

    Missing columns are replaced: a sensor by its command, and a command by the angle that was measured, which no lag of
    the steering delays again.
    """
    from_sensor = segment.wheel is not None and (from_sensor or segment.command is None)
    at_measured_speed = from_speed or segment.target is None
    # A sensor cuts the chain: effects before it have no influence. Antenna and clocks never move the tractor.
    blocks = {PATH, *(() if from_sensor else (STEERS,)), *(() if at_measured_speed else (SPEED,))}
    acting = split_settings_by_block(settings, frozenset(blocks))
    segment = restore_true_inputs(segment, compute_timing(compute_effect_fields(settings)))
    grids, (model, slope) = segment.grids, _extract_measured_slope_drift(rig, segment, acting)
    out = np.empty((len(grids["speed"]), 5), order="F")
    out[:, STEERING_COLUMN], played_angle = _compute_wheel_angles(rig, segment, acting, from_sensor, model)
    drive_segment(
        played_angle, grids["speed"], at_measured_speed, grids.get("target", grids["speed"]), grids["working"],
        grids["east"], grids["north"], grids["heading"], *segment.heading_cosine_sine,
        np.zeros(len(out)) if slope is None else slope, segment.start_s, DT_S, np.zeros(1, dtype=STATE)[0], model,
        rig.ground[0], rig.table, out,
    )  # fmt: skip
    return out


def _compute_wheel_angles(
    rig: ReplayRig, segment: DriveSegment, settings: Settings, from_sensor: bool, model: Any
) -> tuple[Array, Array]:
    """Return wheel angles (n,) on the grid: before each step, and behind the play in it."""
    if from_sensor:
        wheel = segment.grids["wheel"]
        before = np.concatenate([wheel[:1], wheel[:-1]])
    else:
        steered = _simulate_steering(rig, segment, settings)
        before, wheel = steered[:-1], steered[1:]
    if model["half_play"] == 0.0:
        return before, wheel
    steady = segment.denoised_wheel_angle if from_sensor else wheel
    first = steady[0] if from_sensor else before[0]
    played_angle = np.empty(len(wheel))
    apply_play_steps(wheel, steady, first, from_sensor, model, played_angle)
    return before, played_angle


def _extract_measured_slope_drift(
    rig: ReplayRig, segment: DriveSegment, settings: Settings
) -> tuple[Any, Array | None]:
    """Return the tractor without the drift on a plane, and the drift (m/m, n) on the measured slope; with the plane and
    None without one."""
    across, share = segment.grids.get("across"), settings.get(SLOPE_DRIFT, {}).get(PER_SLOPE)
    if share is None or across is None:
        return rig.build_effective_model(settings)[0], None
    others = {name: values for name, values in settings.items() if name != SLOPE_DRIFT}
    return rig.build_effective_model(others)[0], share * across


def _simulate_steering(rig: ReplayRig, segment: DriveSegment, settings: Settings) -> Array:
    """Return the wheel angle (n + 1,) that the commands of a segment produce before each step and after the last."""
    model = rig.build_effective_model(split_settings_by_block(settings, frozenset({STEERS})))[0]
    # One column replaces the other where it is missing.
    command = segment.grids["command" if "command" in segment.grids else "wheel"]
    wheel = segment.grids.get("wheel", command)
    out = np.empty(len(command) + 1)
    state = make_settled_state(command, segment.earlier_commands)[0]
    simulate_steering_steps(command, wheel[0], DT_S, state, model, out)
    return out


@dataclass(frozen=True)
class InstrumentTiming:
    """How old the columns of a log are (s), the time constant of the heading (s), and the scale of the speed."""

    position_s: float = 0.0
    heading_s: float = 0.0
    heading_filter_s: float = 0.0
    speed_s: float = 0.0
    speed_scale: float = 1.0
    steering_s: float = 0.0
    command_s: float = 0.0

    @property
    def is_heading_as_old(self) -> bool:
        """Whether headings are as old as positions, and not smoothed."""
        return self.heading_s == self.position_s and self.heading_filter_s == 0.0

    @property
    def has_neutral_inputs(self) -> bool:
        """Whether speed, wheel angle and command are as they were when they were logged."""
        return self.speed_s == self.steering_s == self.command_s == 0.0 and self.speed_scale == 1.0


def compute_timing(fields: Mapping[str, float]) -> InstrumentTiming:
    """Return the timing of the instruments from the fields of MODEL."""
    return InstrumentTiming(
        (fields["latency"] + fields["position_late"]) / STEP_HZ + fields["position_clock"],
        (fields["latency"] + fields["heading_late"]) / STEP_HZ + fields["heading_clock"],
        fields["heading_filter"],
        fields["speed_clock"],
        fields["speed_scale"],
        fields["steering_clock"],
        fields["command_clock"],
    )


def restore_true_inputs(segment: DriveSegment, timing: InstrumentTiming) -> DriveSegment:
    """Return a segment whose speed, wheel angle and command on the grid are as they were at its times.

    A replay at commanded speeds begins with the first speed that was logged, whatever its clock.
    """
    if timing.has_neutral_inputs:
        return segment
    grids, steps_s, earlier = dict(segment.grids), segment.steps_s, segment.earlier_commands
    if timing.command_s != 0.0 and "command" in grids:
        earlier = _shift_earlier_commands(segment, timing.command_s)
    for name, late_s in (("speed", timing.speed_s), ("wheel", timing.steering_s), ("command", timing.command_s)):
        if name in grids and late_s != 0.0:
            first = grids[name][0]
            grids[name] = np.interp(steps_s + late_s, steps_s, grids[name])
            grids[name][0] = first if name == "speed" else grids[name][0]
    if timing.speed_scale != 1.0:
        grids["speed"] = grids["speed"] / timing.speed_scale
    logged_wheel = segment.logged_wheel
    if timing.steering_s != 0.0 and segment.wheel is not None:
        time, wheel = logged_wheel or (segment.time, segment.wheel)
        logged_wheel = (time - timing.steering_s, wheel)
    return replace(segment, grids=grids, logged_wheel=logged_wheel, earlier_commands=earlier)


def _shift_earlier_commands(segment: DriveSegment, late_s: float) -> Array:
    """Return the commands (m,) before the first row as they were at their times, where their clock is late."""
    known = np.concatenate([segment.earlier_commands, segment.grids["command"]])
    steps_s = DT_S * (np.arange(len(known)) - len(segment.earlier_commands))
    shifted: Array = np.interp(steps_s + late_s, steps_s, known)
    return shifted[: len(segment.earlier_commands)]


def compute_shown_headings(segment: DriveSegment, angles: Array, timing: InstrumentTiming) -> Array:
    """Return what a compass without bias shows (rad) in the rows of a segment, from true angles (n,) on its grid."""
    if timing.heading_filter_s > 0.0:
        share = compute_filter_share(timing.heading_filter_s)
        angles = lfilter([share], [1.0, share - 1.0], angles, zi=[(1.0 - share) * angles[0]])[0]
    shown: Array = np.interp(segment.time - timing.heading_s, segment.steps_s, angles)
    return shown


def compute_antenna_lever(rig: ReplayRig, fields: Mapping[str, float]) -> tuple[float, float]:
    """Return the antenna's position ahead of and to the right of the centre of mass, effects included (m)."""
    tractor = rig.tractor
    ahead = tractor.antenna_forward_m - tractor.rear_axle_m + fields["shift_forward"]
    return ahead, tractor.antenna_right_m + fields["shift_right"]


def simulate_logged_values(
    rig: ReplayRig, segment: DriveSegment, states: Array, settings: Settings
) -> tuple[Array, Array, Array, Array]:
    """Return what instruments would log of replayed states, per row: antenna (k, 2), heading, wheel angle, speed."""
    fields, out = compute_effect_fields(settings), np.empty((6, segment.rows))
    timing, steps_s = compute_timing(fields), np.arange(len(states), dtype=np.float64) * DT_S
    wheel = np.interp(segment.time - timing.steering_s, steps_s, states[:, STEERING_COLUMN])
    speed = timing.speed_scale * np.interp(segment.time - timing.speed_s, steps_s, states[:, FORWARD_COLUMN])
    write_instrument_poses(
        segment.time, segment.steps_s, states[:, X_COLUMN], states[:, Y_COLUMN], states[:, ANGLE_COLUMN],
        timing.position_s, *compute_antenna_lever(rig, fields), fields["heading_bias"], out,
    )  # fmt: skip
    if not timing.is_heading_as_old:
        out[SHOWN_HEADING] = compute_shown_headings(segment, states[:, ANGLE_COLUMN], timing) + fields["heading_bias"]
    return out[SHOWN_EAST : SHOWN_NORTH + 1].T, out[SHOWN_HEADING], wheel, speed


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
