"""Replay of logged commands with the functions that planning simulates with.

No pymunk space is needed for one tractor without contacts: steering, drive line, effects and chassis are the functions
of the planning loop, and the position is moved as pymunk moves it, with the velocity before the step. Effects that
depend on place or direction use the measured pose, so one simulation serves every horizon.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from vehicle.fast_math import compute_cosine_sine
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.instrument_timing import (
    TrueSegmentCache,
    compute_shown_headings,
    compute_timing,
    extract_timing,
    simulate_logged_speeds,
    simulate_logged_wheel_angles,
)
from vehicle.identification.replay.state_cache import (
    ANGLE_COLUMN,
    FORWARD_COLUMN,
    STEERING_COLUMN,
    X_COLUMN,
    Y_COLUMN,
    EffectsKey,
    ReplayCache,
    make_settings_key,
    split_settings_by_block,
)
from vehicle.identification.replay.steering_steps import apply_play_steps, make_settled_state, simulate_steering_steps
from vehicle.identification.replay.vectorised import (
    LANES,
    add_draft_crab,
    compute_tangents_and_drift,
    integrate_poses,
    simulate_turning_lanes,
)
from vehicle.jit import compile_function
from vehicle.model.effect_kinds import PER_SLOPE
from vehicle.model.effects import PATH, SLOPE_DRIFT, SPEED, compute_effect_fields
from vehicle.model.effects import STEERING as STEERS
from vehicle.model.ground import find_ground_index
from vehicle.model.instruments import SHOWN_EAST, SHOWN_HEADING, SHOWN_NORTH, write_instrument_poses
from vehicle.model.tractor import (
    Implement,
    LogCorrections,
    Settings,
    Tractor,
    get_log_corrections,
    remove_log_corrections,
)
from vehicle.records import DT_S, STATE
from vehicle.sim.calibration import build_steering_tables
from vehicle.sim.compile import build_ground_records, build_model_record
from vehicle.sim.dynamics import step_body, step_speed_control
from vehicle.sim.effect_terms import compute_affected_tangent, compute_draft_crab, compute_ground_drift

VECTORISED_STEPS = 100_000  # chosen, per batch of segments driven side by side: they fit in the processor's cache
MOST_CACHED_MODELS = 16  # chosen: the segments of a dataset use the same model in turn
SegmentSettings = tuple[DriveSegment, Settings]


@compile_function
def drive_at_commanded_speed(  # type: ignore[no-untyped-def]
    wheel_angle, speed, target, working, east, north, heading, cosines, sines, downhill, start_s, dt, state, model,
    ground, table, out,
) -> None:  # fmt: skip
    """Drive at the commanded speed, one input value per step; `out` (n, 5) gets x, y, angle and speeds before each
    step.

    `turned` is the wheel angle behind the play, `cosines` and `sines` are of `heading`; `downhill` is the drift to the
    right (m/m) on a measured slope, in addition to the model's. Speeds are over ground: where the ground drift carries
    the tractor along, it is included.
    """
    x, y, angle, forward = east[0], north[0], heading[0], speed[0]
    state.reference_speed = forward
    right = spin = 0.0
    for i in range(len(wheel_angle)):
        state.working, state.target_speed = working[i], target[i]
        out[i, X_COLUMN], out[i, Y_COLUMN], out[i, ANGLE_COLUMN], out[i, FORWARD_COLUMN] = x, y, angle, forward
        drive = step_speed_control(state, model, ground, forward, dt)
        heading_cosine, heading_sine = cosines[i], sines[i]
        tangent = compute_affected_tangent(
            wheel_angle[i],
            forward,
            east[i],
            north[i],
            heading_cosine,
            heading_sine,
            start_s + i * dt,
            working[i],
            table,
            model,
        )
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

    `ranges` limit a discrepancy model to where it was observed; one that is still being fitted has none. `cache` holds
    replayed states, `models` the model records used, `segments` those with true inputs.
    """

    tractor: Tractor
    model: Any
    ground: Any
    table: Array
    origin: tuple[float, float] = (0.0, 0.0)
    ranges: Mapping[str, float] = field(default_factory=dict)
    cache: ReplayCache = field(default_factory=ReplayCache)
    models: dict[Hashable, Any] = field(default_factory=dict)
    segments: TrueSegmentCache = field(default_factory=TrueSegmentCache)

    def get_effective_model(self, settings: Settings) -> Any:
        """Return the record of build_effective_model, cached for the segments of a dataset."""
        key = self.origin, tuple(self.ranges.items()), make_settings_key(settings)
        if key not in self.models:
            if len(self.models) >= MOST_CACHED_MODELS:
                self.models.clear()
            self.models[key] = self.build_effective_model(settings)[0]
        return self.models[key]

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
    """Return states (n, 5) on the grid of a segment; read-only.

    Missing columns are replaced: a sensor by its command, and a command by the angle that was measured, which no lag of
    the steering delays again.
    """
    return replay_segments(rig, [(segment, settings)], from_sensor, from_speed)[0]


def replay_segments(
    rig: ReplayRig, pairs: Sequence[SegmentSettings], from_sensor: bool, from_speed: bool
) -> list[Array]:
    """Return the states of replay_segment for many segments, each with its settings."""
    requests = _build_requests(rig, pairs, from_sensor, from_speed)
    cached = [rig.cache.find_cached_arrays(request.key) for request in requests]
    missing = {request.key: request for request, states in zip(requests, cached, strict=True) if states is None}
    states_by_key: dict[Hashable, Array] = {}
    for group in _group_requests(list(missing.values())):
        states_by_key |= (
            _replay_at_measured_speed(rig, group)
            if group[0].at_measured_speed
            else {group[0].key: _replay_at_commanded_speed(rig, group[0])}
        )
    for key in missing:
        rig.cache.store(key, (states_by_key[key],))
    return [
        states_by_key[request.key] if states is None else states[0]
        for request, states in zip(requests, cached, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class _ActingSettings:
    """Settings that act in a replay, with derived values that many segments share."""

    rig: ReplayRig
    settings: Settings

    @cached_property
    def key(self) -> EffectsKey:
        """The settings as a cache key."""
        return make_settings_key(self.settings)

    @cached_property
    def model(self) -> Any:
        """The tractor with the settings."""
        return self.rig.get_effective_model(self.settings)

    @cached_property
    def steering(self) -> Settings:
        """The settings of the steering alone."""
        return split_settings_by_block(self.settings, frozenset({STEERS}))

    @cached_property
    def steering_key(self) -> EffectsKey:
        """The settings of the steering as a cache key."""
        return make_settings_key(self.steering)


@dataclass(frozen=True, eq=False)
class _ReplayRequest:
    """A segment to replay with the acting settings: `sensed` uses its wheel angle, `timed` its measured speed."""

    segment: DriveSegment
    acting_settings: _ActingSettings
    from_sensor: bool
    at_measured_speed: bool
    key: Hashable


def _build_requests(
    rig: ReplayRig, pairs: Sequence[SegmentSettings], from_sensor: bool, from_speed: bool
) -> list[_ReplayRequest]:
    """Build the replay requests with their keys; settings that many segments share are processed once."""
    ranges, acting_by_place = tuple(rig.ranges.items()), dict[tuple[int, bool, bool], _ActingSettings]()
    unique_settings = {id(settings): settings for _, settings in pairs}
    timing_by_settings = {place: compute_timing(settings) for place, settings in unique_settings.items()}
    requests = []
    for segment, settings in pairs:
        from_sensor_angle, at_measured_speed = (
            segment.wheel is not None and (from_sensor or segment.command is None),
            from_speed or segment.target is None,
        )
        place = (id(settings), from_sensor_angle, at_measured_speed)
        if place not in acting_by_place:
            # A sensor cuts the chain: effects before it have no influence. Antenna and clocks never move the tractor.
            blocks = {PATH, *(() if from_sensor_angle else (STEERS,)), *(() if at_measured_speed else (SPEED,))}
            acting_by_place[place] = _ActingSettings(rig, split_settings_by_block(settings, frozenset(blocks)))
        acting_settings = acting_by_place[place]
        segment = rig.segments.get_true_segment(segment, timing_by_settings[id(settings)])
        requests.append(
            _ReplayRequest(
                segment,
                acting_settings,
                from_sensor_angle,
                at_measured_speed,
                (segment, from_sensor_angle, at_measured_speed, ranges, acting_settings.key),
            )
        )
    return requests


def _group_requests(requests: list[_ReplayRequest]) -> list[list[_ReplayRequest]]:
    """Group segments that are driven side by side, the longest first; those at commanded speeds are driven alone."""
    timed_requests = sorted(
        (request for request in requests if request.at_measured_speed),
        key=lambda request: -len(request.segment.grids["speed"]),
    )
    groups, steps = list[list[_ReplayRequest]](), 0
    for request in timed_requests:
        if not groups or (steps >= VECTORISED_STEPS and len(groups[-1]) >= LANES):
            groups.append([])
            steps = 0
        groups[-1].append(request)
        steps += len(request.segment.grids["speed"])
    return groups + [[request] for request in requests if not request.at_measured_speed]


def _replay_at_measured_speed(rig: ReplayRig, group: list[_ReplayRequest]) -> dict[Hashable, Array]:
    """Return the states of segments driven side by side at their measured speed."""
    ends = np.cumsum([len(request.segment.grids["speed"]) for request in group])
    begins = np.concatenate([[0], ends[:-1]])
    speed, bend, ahead, slide, right, spin = np.empty((6, ends[-1]))
    parts = [slice(int(begin), int(end)) for begin, end in zip(begins, ends, strict=True)]
    segment_states = []
    for request, step_slice in zip(group, parts, strict=True):
        speed[step_slice] = request.segment.grids["speed"]
        segment_states.append(
            _start_replay_states(rig, request, bend[step_slice], ahead[step_slice], slide[step_slice])
        )
    simulate_turning_lanes(begins, ends, speed, bend, slide, DT_S, rig.model[0], rig.ground[0], right, spin)
    for request, step_slice, states in zip(group, parts, segment_states, strict=True):
        x, y, angle = (request.segment.grids[name][0] for name in ("east", "north", "heading"))
        integrate_poses(
            speed[step_slice], ahead[step_slice], right[step_slice], spin[step_slice], x, y, angle, DT_S, states.T
        )
    return {request.key: states for request, states in zip(group, segment_states, strict=True)}


def _start_replay_states(rig: ReplayRig, request: _ReplayRequest, bend: Array, ahead: Array, slide: Array) -> Array:
    """Return states (n, 5) of a segment, by columns, with wheel angle and speed filled in, and the steps of
    compute_tangents_and_drift."""
    segment, grids = request.segment, request.segment.grids
    model, slope = _extract_measured_slope_drift(rig, request)
    states = np.empty((len(bend), 5), order="F")
    slide[:] = 0.0 if slope is None else slope
    states[:, FORWARD_COLUMN] = grids["speed"]
    states[:, STEERING_COLUMN], played_angle = _compute_wheel_angles(rig, request, model)
    compute_tangents_and_drift(
        grids["speed"],
        grids["working"],
        grids["east"],
        grids["north"],
        *segment.heading_cosine_sine,
        played_angle,
        segment.start_s,
        DT_S,
        rig.table,
        model,
        bend,
        ahead,
        slide,
    )
    if model["draft"] != 0.0:
        add_draft_crab(grids["speed"], grids["working"], model, rig.ground[0], slide)
    return states


def _compute_wheel_angles(rig: ReplayRig, request: _ReplayRequest, model: Any) -> tuple[Array, Array]:
    """Return wheel angles (n,) on the grid: before each step, and behind the play in it."""
    segment = request.segment
    if request.from_sensor:
        wheel = segment.grids["wheel"]
        before = np.concatenate([wheel[:1], wheel[:-1]])
    else:
        steered = _simulate_steering(rig, segment, request.acting_settings)
        before, wheel = steered[:-1], steered[1:]
    if model["half_play"] == 0.0:
        return before, wheel.copy()  # a read-only array is another type for numba and would be compiled for again
    steady = segment.denoised_wheel_angle if request.from_sensor else wheel
    first = steady[0] if request.from_sensor else before[0]
    played_angle = np.empty(len(wheel))
    apply_play_steps(wheel, steady, first, request.from_sensor, model, played_angle)
    return before, played_angle


def _replay_at_commanded_speed(rig: ReplayRig, request: _ReplayRequest) -> Array:
    """Return the states of a segment driven at the commanded speeds."""
    segment, grids = request.segment, request.segment.grids
    (model, slope), count = _extract_measured_slope_drift(rig, request), len(grids["speed"])
    out = np.empty((count, 5), order="F")
    out[:, STEERING_COLUMN], played_angle = _compute_wheel_angles(rig, request, model)
    drive_at_commanded_speed(
        played_angle,
        grids["speed"],
        grids["target"],
        grids["working"],
        grids["east"],
        grids["north"],
        grids["heading"],
        *segment.heading_cosine_sine,
        np.zeros(count) if slope is None else slope,
        segment.start_s,
        DT_S,
        np.zeros(1, dtype=STATE)[0],
        model,
        rig.ground[0],
        rig.table,
        out,
    )
    return out


def _extract_measured_slope_drift(rig: ReplayRig, request: _ReplayRequest) -> tuple[Any, Array | None]:
    """Return the tractor without the drift on a plane, and the drift (m/m, n) on the measured slope; unchanged without
    one."""
    settings, across = request.acting_settings.settings, request.segment.grids.get("across")
    share = settings.get(SLOPE_DRIFT, {}).get(PER_SLOPE)
    if share is None or across is None:
        return request.acting_settings.model, None
    return rig.get_effective_model(
        {name: values for name, values in settings.items() if name != SLOPE_DRIFT}
    ), share * across


def simulate_wheel_angles(rig: ReplayRig, segments: Sequence[DriveSegment], settings: Settings) -> list[Array]:
    """Return the wheel angles (n,) that the commands of each segment produce on the grid, as in a replay but without
    driving."""
    timing, acting_settings = compute_timing(settings), _ActingSettings(rig, settings)
    return [
        _simulate_steering(rig, rig.segments.get_true_segment(segment, timing), acting_settings)[:-1]
        for segment in segments
    ]


def _simulate_steering(rig: ReplayRig, segment: DriveSegment, acting_settings: _ActingSettings) -> Array:
    """Return the wheel angle (n + 1,) that the commands of a segment produce before each step and after the last."""

    def simulate() -> tuple[Array]:
        command, wheel = _select_steering_inputs(segment)
        out = np.empty(len(command) + 1)
        simulate_steering_steps(
            command,
            wheel[0],
            DT_S,
            make_settled_state(command, segment.earlier_commands)[0],
            rig.get_effective_model(acting_settings.steering),
            out,
        )
        return (out,)

    return rig.cache.get_or_make_arrays((segment, "wheel", acting_settings.steering_key), simulate)[0]


def _select_steering_inputs(segment: DriveSegment) -> tuple[Array, Array]:
    """Return commands and wheel angles on the grid; one replaces the other where it is missing."""
    command = segment.grids.get("command", segment.grids.get("wheel"))
    wheel = segment.grids.get("wheel", command)
    assert command is not None and wheel is not None
    return command, wheel


def compute_antenna_lever(rig: ReplayRig, fields: Mapping[str, float]) -> tuple[float, float]:
    """Return the antenna's position ahead of and to the right of the centre of mass, effects included (m)."""
    tractor = rig.tractor
    ahead = tractor.antenna_forward_m - tractor.rear_axle_m + fields["shift_forward"]
    return ahead, tractor.antenna_right_m + fields["shift_right"]


def simulate_logged_values(
    rig: ReplayRig, segment: DriveSegment, states: Array, settings: Settings
) -> tuple[Array, Array, Array, Array]:
    """Return what instruments would log of replayed states, per row: antenna (k, 2), heading, wheel angle, speed."""
    timing = compute_timing(settings)
    wheel = simulate_logged_wheel_angles(segment, states[:, STEERING_COLUMN], timing)
    speed = simulate_logged_speeds(segment, states[:, FORWARD_COLUMN], timing)
    return *simulate_logged_antenna(rig, segment, states, settings), wheel, speed


def simulate_logged_antenna(
    rig: ReplayRig, segment: DriveSegment, states: Array, settings: Settings
) -> tuple[Array, Array]:
    """Return antenna (k, 2) and heading (k,) of simulate_logged_values."""
    fields, out = compute_effect_fields(settings), np.empty((6, segment.rows))
    timing = extract_timing(fields)
    write_instrument_poses(
        segment.time,
        segment.steps_s,
        states[:, X_COLUMN],
        states[:, Y_COLUMN],
        states[:, ANGLE_COLUMN],
        timing.position_s,
        *compute_antenna_lever(rig, fields),
        fields["heading_bias"],
        out,
    )
    if not timing.is_heading_as_old:
        out[SHOWN_HEADING] = compute_shown_headings(segment, states[:, ANGLE_COLUMN], timing) + fields["heading_bias"]
    return out[SHOWN_EAST : SHOWN_NORTH + 1].T, out[SHOWN_HEADING]
