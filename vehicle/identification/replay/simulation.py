"""What instruments would have shown: the vehicle of planning driven with effects that may vary from step to step.

The formulas are those of vehicle.sim and vehicle.control. No pymunk space is needed for one tractor without contacts:
the position is moved as pymunk moves it, with the velocity before the step. Effects that depend on place or direction
use the measured pose, so one simulation serves every horizon.

Every field of the model may be an array over steps, so that an effect in one run, at one speed or from one moment on is
only another array. Three chains: wheel angle from commands, speed from commands, path from measured wheel angles and
speeds. Speeds, wheel angles and commands are inputs as well as shown: as inputs their clocks and scale are taken out.

A replay of commands drives the path at the wheel angles and speeds that the commands give, with the same effects all
the time.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fields.arrays import Flags, Floats
from vehicle.control.steering import step_steering_simulator
from vehicle.fast_math import compute_cosine_sine
from vehicle.identification.replay.drive_inputs import DriveInputs, Samples, build_inputs
from vehicle.identification.replay.drive_segments import DriveSegment, ReplayRig
from vehicle.jit import compile_function, inline_function
from vehicle.model.effect_kinds import PER_SLOPE as PER_SLOPE_KEY
from vehicle.model.effects import (
    CATALOGUE,
    NEUTRAL_FIELDS,
    PATH,
    SLOPE_DRIFT,
    SPEED,
    compute_effect_fields,
    list_neutral_fields,
)
from vehicle.model.instruments import apply_lever_arm, compute_filter_share
from vehicle.model.tractor import Settings
from vehicle.records import DT_S, HISTORY_STEPS, STATE
from vehicle.sim.dynamics import compute_rolling_resistance, step_body, step_speed_control
from vehicle.sim.effect_terms import (
    apply_play,
    compute_affected_tangent,
    compute_draft_crab,
    compute_ground_drift,
    read_delayed,
)


def _list_term_fields(block: str) -> tuple[str, ...]:
    """Fields of MODEL of the effects of a block of the catalogue; stand-ins are other effects with a basis."""
    effects = [effect for effect in CATALOGUE if effect.block == block and not effect.is_stand_in]
    return tuple(name for effect in effects for name in list_neutral_fields(effect))


STEERING_FIELDS = ("dead_steps", "lag", "rate", "dead_band", "command_clock")
SPEED_TERMS, PATH_TERMS = _list_term_fields(SPEED), _list_term_fields(PATH)
"""Fields that the formulas of vehicle.sim read from the model; each comes first in its chain."""
SPEED_FIELDS = (*SPEED_TERMS, "ramp")
PATH_FIELDS = (*PATH_TERMS, "steering_clock", "speed_clock", "speed_scale", "wheel_scale", "relaxation", "crab",
               "push_east", "push_north", "per_slope")  # fmt: skip
INSTRUMENT_FIELDS = ("shift_forward", "shift_right", "latency", "heading_bias", "position_late", "heading_late",
                     "heading_filter", "position_clock", "heading_clock")  # fmt: skip
SENSOR_FIELDS = {"wheel": ("steering_clock", "wheel_scale"), "speed": ("speed_clock", "speed_scale")}
"""Clock and scale of the sensors whose columns are shown as well as inputs, by channel."""
CHAINS = {"steering": STEERING_FIELDS, "speed": SPEED_FIELDS, "path": PATH_FIELDS, "instruments": INSTRUMENT_FIELDS}
FACTORS = (
    *(name for name in (*SPEED_TERMS, *PATH_TERMS) if NEUTRAL_FIELDS[name] == 1.0), "speed_scale", "wheel_scale", "ramp"
)  # fmt: skip
"""Fields whose neutral value is 1: contributions to them multiply."""
RAMP = len(SPEED_TERMS)
(STEERING_CLOCK, SPEED_CLOCK, SPEED_SCALE, WHEEL_SCALE, RELAXATION, CRAB, PUSH_EAST, PUSH_NORTH,
 PER_SLOPE) = range(len(PATH_TERMS), len(PATH_FIELDS))  # fmt: skip
(FORWARD, RIGHT, LATENCY, BIAS, POSITION_LATE, HEADING_LATE, HEADING_FILTER, POSITION_CLOCK,
 HEADING_CLOCK) = range(9)  # fmt: skip
MOST_CACHED = 6  # chains kept: a fit changes one effect at a time
X_COLUMN, Y_COLUMN, ANGLE_COLUMN, STEERING_COLUMN, FORWARD_COLUMN = range(5)
"""Columns of states: place (m) and angle (rad), wheel angle (rad), speed (m/s)."""


@compile_function
def _read_at(values, low: int, high: int, place: float) -> float:  # type: ignore[no-untyped-def]
    """Value at a fractional place inside [low, high), by linear interpolation; constant outside."""
    if place <= low:
        return values[low]  # type: ignore[no-any-return]
    if place >= high - 1:
        return values[high - 1]  # type: ignore[no-any-return]
    whole = int(place)
    share = place - whole
    return values[whole] * (1.0 - share) + values[whole + 1] * share  # type: ignore[no-any-return]


@compile_function
def _read_path(values, low: int, high: int, place: float) -> float:  # type: ignore[no-untyped-def]
    """Value at a fractional place, by linear interpolation; outside [low, high) it goes on as at that end, as what was
    logged before a segment that begins or ends under way was not at rest."""
    whole = min(max(int(place), low), max(high - 2, low))
    next_one = min(whole + 1, high - 1)
    return values[whole] + (values[next_one] - values[whole]) * (place - whole)  # type: ignore[no-any-return]


@compile_function
def simulate_steering(starts, command, first, states, fields, model, dt, out) -> None:  # type: ignore[no-untyped-def]
    """Write the wheel angles before and after each step to `out` (2, n), from commands (n,) and fields per step.

    `first` (s,) are the angles at the start of the segments, `states` hold the commands before them. Here and below,
    fields are (f, n), or (f, 1) where they stay.
    """
    last = fields.shape[1] - 1
    for number in range(len(starts) - 1):
        begin, end = starts[number], starts[number + 1]
        state = states[number]
        angle, stage = first[number], 1
        for i in range(begin, end):
            out[0, i], now = angle, min(i, last)
            ahead = fields[4, now] / dt
            state.commands[state.clock % len(state.commands)] = _read_at(command, begin, end, i + max(ahead, 0.0))
            late = min(fields[0, now] + max(-ahead, 0.0), float(state.clock))
            delayed = read_delayed(state.commands, state.clock, late)
            angle, stage = step_steering_simulator(
                angle, delayed, stage, dt, max(fields[3, now], 0.0), model.switch, max(fields[2, now], 0.01),
                max(fields[1, now], 0.01), model.gain, model.latch,
            )  # fmt: skip
            out[1, i] = angle
            state.clock += 1


@inline_function
def _step_speed(i, target, working, forward, fields, terms, values, acceleration, model, ground, state, dt) -> float:  # type: ignore[no-untyped-def]
    """Drive force (N) for the commanded speed of a step, with the fields of that step."""
    now = min(i, fields.shape[1] - 1)
    state.working, state.target_speed = working[i], target[i]
    for row in range(len(terms)):
        values[terms[row]] = fields[row, now]
    model.speed_lag, model.acceleration = max(model.speed_lag, 0.0), acceleration * max(fields[RAMP, now], 0.1)
    return step_speed_control(state, model, ground, forward, dt)


@inline_function
def _start_speed(forward, state) -> None:  # type: ignore[no-untyped-def]
    """Start a segment at a speed (m/s), with a speed controller at rest."""
    state.reference_speed, state.integral, state.last_error = forward, 0.0, 0.0


@compile_function
def simulate_speeds(  # type: ignore[no-untyped-def]
    starts, target, working, first, fields, terms, values, model, ground, state, dt, out
) -> None:
    """Write the forward speed before each step to `out` (n,), from commanded speeds (n,), straight ahead.

    `terms` are the places of SPEED_TERMS in `values`, which is the memory of `model`.
    """
    acceleration = model.acceleration
    for number in range(len(starts) - 1):
        begin, end = starts[number], starts[number + 1]
        forward = first[number]
        _start_speed(forward, state)
        for i in range(begin, end):
            out[i] = forward
            drive = _step_speed(
                i, target, working, forward, fields, terms, values, acceleration, model, ground, state, dt
            )
            forward += dt * (drive - compute_rolling_resistance(forward, model, ground)) / model.mass
    model.acceleration = acceleration


@compile_function
def simulate_path(  # type: ignore[no-untyped-def]
    starts, wheel, steady, first, noisy, speed, target, commanded, working, east, north, heading, cosine, sine, across,
    seconds, fields, terms, speed_fields, speed_terms, values, model, ground, state, table, dt, out,
) -> None:  # fmt: skip
    """Write x, y and angle of the centre of mass and its speed before each step to `out` (4, m).

    `fields` are in the order of PATH_FIELDS; `noisy` (s,) says where wheel angles were measured, `commanded` (s,) where
    the speed is that of the speed control instead of the measured one. `first` (s,) are wheel angles before the first
    step. `terms` and `speed_terms` are the places of PATH_TERMS and SPEED_TERMS in `values`, which is the memory of
    `model`. Speeds are over ground: where the ground drift carries the tractor along, it is included.
    """
    acceleration, last = model.acceleration, fields.shape[1] - 1
    for number in range(len(starts) - 1):
        begin, end = starts[number], starts[number + 1]
        x, y, angle, right, spin = east[begin], north[begin], heading[begin], 0.0, 0.0
        play, bend, forward = first[number], 0.0, speed[begin] / fields[SPEED_SCALE, min(begin, last)]
        _start_speed(forward, state)
        for i in range(begin, end):
            now = min(i, last)
            if commanded[number]:
                drive = _step_speed(
                    i, target, working, forward, speed_fields, speed_terms, values, acceleration, model, ground, state,
                    dt,
                )  # fmt: skip
            else:
                forward = (
                    speed[i]
                    if fields[SPEED_CLOCK, now] == 0.0
                    else _read_at(speed, begin, end, i + fields[SPEED_CLOCK, now] / dt)
                )
                forward /= fields[SPEED_SCALE, now]
                drive = compute_rolling_resistance(forward, model, ground)
            out[0, i], out[1, i], out[2, i], out[3, i] = x, y, angle, forward
            ahead = fields[STEERING_CLOCK, now] / dt
            turned, calm = wheel[i], steady[i]
            if ahead != 0.0 and noisy[number]:
                turned, calm = _read_at(wheel, begin, end, i + ahead), _read_at(steady, begin, end, i + ahead)
            turned, calm = turned / fields[WHEEL_SCALE, now], calm / fields[WHEEL_SCALE, now]
            for row in range(len(terms)):
                values[terms[row]] = fields[row, now]
            model.half_play, model.slide = max(model.half_play, 0.0), max(model.slide, 0.0)
            play = apply_play(play, calm, model)
            turned = turned + (play - calm) if noisy[number] else play
            tangent = compute_affected_tangent(
                turned, forward, east[i], north[i], cosine[i], sine[i], seconds[i], working[i], table, model
            )
            if fields[RELAXATION, now] > 1e-3 and i > begin:
                bend += (tangent - bend) * (1.0 - np.exp(-abs(forward) * dt / fields[RELAXATION, now]))
            else:
                bend = tangent
            along, slide = compute_ground_drift(turned, forward, cosine[i], sine[i], model)
            slide += abs(forward) * across[i] * fields[PER_SLOPE, now]
            if model.draft != 0.0:
                slide += compute_draft_crab(forward, working[i], model, ground)
            slide += fields[PUSH_EAST, now] * sine[i] - fields[PUSH_NORTH, now] * cosine[i]
            slide -= fields[CRAB, now] * abs(forward) * forward * spin
            along += fields[PUSH_EAST, now] * cosine[i] + fields[PUSH_NORTH, now] * sine[i]
            new_forward, new_right, new_spin = step_body(forward, right - slide, spin, bend, drive, dt, model, ground)
            c, s = compute_cosine_sine(angle)
            x += ((forward + along) * c + right * s) * dt
            y += ((forward + along) * s - right * c) * dt
            angle -= spin * dt
            forward, right, spin = new_forward, new_right + slide, new_spin
    model.acceleration = acceleration


@compile_function
def filter_angles(starts, angle, time_constant, stride, out) -> None:  # type: ignore[no-untyped-def]
    """Write the first-order low pass of angles (m,) to `out` (m,), with a time constant (s) per step."""
    for number in range(len(starts) - 1):
        shown = angle[starts[number]]
        for i in range(starts[number], starts[number + 1]):
            share = compute_filter_share(max(time_constant[min(i, len(time_constant) - 1)], 0.0))
            for _ in range(stride):
                shown += (angle[i] - shown) * share
            out[i] = shown


@compile_function
def sample_positions(places, segments, starts, path, fields, ahead, aside, dt, out) -> None:  # type: ignore[no-untyped-def]
    """Write antenna positions (2, k) at fractional steps `places` (k,), by the lever arm and what makes them late."""
    for row in range(len(places)):
        begin, end = starts[segments[row]], starts[segments[row] + 1]
        i = min(max(int(places[row]), begin), end - 1, fields.shape[1] - 1)
        late_s = (fields[LATENCY, i] + fields[POSITION_LATE, i]) * DT_S + fields[POSITION_CLOCK, i]
        place = places[row] - late_s / dt
        cosine, sine = compute_cosine_sine(_read_path(path[2], begin, end, place))
        out[0, row], out[1, row] = apply_lever_arm(
            _read_path(path[0], begin, end, place), _read_path(path[1], begin, end, place), cosine, sine,
            ahead + fields[FORWARD, i], aside + fields[RIGHT, i],
        )  # fmt: skip


@compile_function
def sample_headings(places, segments, starts, angle, fields, dt, out) -> None:  # type: ignore[no-untyped-def]
    """Write shown headings (k,) at fractional steps."""
    for row in range(len(places)):
        begin, end = starts[segments[row]], starts[segments[row] + 1]
        i = min(max(int(places[row]), begin), end - 1, fields.shape[1] - 1)
        late_s = (fields[LATENCY, i] + fields[HEADING_LATE, i]) * DT_S + fields[HEADING_CLOCK, i]
        out[row] = _read_path(angle, begin, end, places[row] - late_s / dt) + fields[BIAS, i]


@compile_function
def sample_values(places, segments, starts, values, late_s, step_s, out) -> None:  # type: ignore[no-untyped-def]
    """Write values (k,) at fractional steps, `late_s` (n, or 1) seconds old; for what one number per step describes."""
    for row in range(len(places)):
        begin, end = starts[segments[row]], starts[segments[row] + 1]
        i = min(max(int(places[row]), begin), end - 1, len(late_s) - 1)
        out[row] = _read_at(values, begin, end, places[row] - late_s[i] / step_s)


InstrumentColumns = tuple[Floats, Floats, Floats, Floats]
"""Positions of the antenna (k, 2), headings, wheel angles and speeds (k,) at the rows of a segment."""
Fields = Mapping[str, Floats]
Keys = Mapping[str, Hashable]


@dataclass(eq=False)
class Simulator:
    """Simulates what instruments show of the data, chain by chain; chains that no field changed are kept.

    `settings` are effects that act all the time; fields that vary from step to step come beside them.
    """

    data: DriveInputs
    rig: ReplayRig
    settings: Settings = field(default_factory=dict)
    base: dict[str, float] = field(init=False)
    cache: dict[tuple[str, Hashable], Floats] = field(default_factory=dict)
    simulations: int = 0

    def __post_init__(self) -> None:
        # A slope that was measured takes the place of the plane that a drift is on.
        settings, per_slope = self.settings, self.settings.get(SLOPE_DRIFT, {}).get(PER_SLOPE_KEY)
        if per_slope is not None and all("across" in segment.grids for segment in self.data.segments):
            settings = {name: values for name, values in settings.items() if name != SLOPE_DRIFT}
        else:
            per_slope = 0.0
        model = self.rig.build_effective_model(settings)
        self.model, self.ground, self.values = model[0], self.rig.ground[0], model.view(np.float64)
        known = dict.fromkeys(FACTORS, 1.0) | compute_effect_fields(settings) | {"per_slope": per_slope}
        known |= {name: float(self.model[name]) for name in ("lag", "rate", "dead_band")}
        self.base = {name: known.get(name, 0.0) for names in CHAINS.values() for name in names}
        self.blank = {name: np.array([[self.base[field]] for field in names]) for name, names in CHAINS.items()}
        self.settled = np.concatenate(
            [
                make_settled_state(self.data.command[begin:], segment.earlier_commands)
                for begin, segment in zip(self.data.step_starts[:-1], self.data.segments, strict=True)
            ]
        )

    def simulate(self, fields: Fields, keys: Keys) -> dict[str, Floats]:
        """Predicted columns in the cells of the windows.

        `fields` holds arrays on the axis of the path for fields that differ from the base; `keys` says per chain what
        they are made of, so that a chain is driven again only where that changed.
        """
        wheel = self._get("steering", keys["steering"], lambda: self.simulate_wheel(fields))
        speed = self._get("speed", keys["speed"], lambda: self._simulate_speed(fields))
        steered = () if self.data.has_wheel.all() else keys["steering"]
        path = self._get("path", (keys["path"], steered), lambda: self.simulate_path(fields, wheel))
        return self.show(path, wheel[0], speed, fields)

    def replay(self, fields: Fields, from_sensor: bool = False, from_speed: bool = False) -> tuple[Floats, Floats]:
        """Wheel angles before each step (n,) and the path (4, m), driven as commanded; with `from_sensor` as wheel
        angles, with `from_speed` as speeds were measured, and so wherever there is no command.

        No lag of the steering delays measured wheel angles again.
        """
        wheel, segments = self.simulate_wheel(fields), self.data.segments
        measured = np.array([one.command is None or (from_sensor and one.wheel is not None) for one in segments])
        commanded = np.array([one.target is not None and not from_speed for one in segments])
        path = self.simulate_path(fields, wheel, measured, commanded)
        is_measured = np.repeat(measured, np.diff(self.data.step_starts))
        return np.where(is_measured, np.repeat(self.data.path["wheel"], self.data.stride), wheel[0]), path

    def measure_fastest_turn(self) -> float:
        """The largest yaw rate (rad/s) of the drive without effects; nan where it is none."""
        angle = self.simulate_path({}, self.simulate_wheel({}))[2]
        is_inside = np.ones(len(angle) - 1, dtype=np.bool_)
        is_inside[self.data.path_starts[1:-1] - 1] = False
        return float(np.max(np.abs(np.diff(angle)[is_inside]))) / self.data.path_step_s

    def _get(self, chain: str, key: Hashable, make: Any) -> Floats:
        if (chain, key) not in self.cache:
            old = [entry for entry in self.cache if entry[0] == chain]
            if len(old) >= MOST_CACHED:
                del self.cache[old[1]]  # the first is the base
            self.cache[chain, key] = make()
            self.simulations += 1
        return self.cache[chain, key]

    def _fill(self, chain: str, fields: Fields, repeats: int = 1) -> Floats:
        """All fields of a chain (f, n), each step so many times; (f, 1) where none varies."""
        names = CHAINS[chain]
        if not any(name in fields for name in names):
            return self.blank[chain]
        out = np.repeat(self.blank[chain], repeats * self.data.path_starts[-1], axis=1)
        for place, name in enumerate(names):
            if name in fields:
                out[place] = np.repeat(fields[name], repeats)
        return out

    def _find_places(self, terms: Sequence[str]) -> Floats:
        """Places (t,) of fields in the memory of the model."""
        return np.array([(self.model.dtype.names or ()).index(name) for name in terms])

    def simulate_wheel(self, fields: Fields) -> Floats:
        """Wheel angles that follow their commands, before and after each step (2, n)."""
        data = self.data
        out = np.empty((2, len(data.command)))
        simulate_steering(data.step_starts, data.command, data.first_wheel, self.settled.copy(),
                          self._fill("steering", fields, data.stride), self.model, DT_S, out)  # fmt: skip
        return out

    def _simulate_speed(self, fields: Fields) -> Floats:
        data, out = self.data, np.empty(len(self.data.target))
        first = data.path["speed"][data.path_starts[:-1]]
        simulate_speeds(
            data.step_starts, data.target, data.working, first, self._fill("speed", fields, data.stride),
            self._find_places(SPEED_TERMS), self.values, self.model, self.ground, np.zeros(1, dtype=STATE)[0], DT_S,
            out,
        )  # fmt: skip
        return out

    def simulate_path(
        self, fields: Fields, wheel: Floats, measured: Flags | None = None, commanded: Flags | None = None
    ) -> Floats:
        """The path (4, m) at wheel angles where they were `measured` (s,), by default all that were, else at simulated
        ones (2, n); at commanded speeds where `commanded` (s,), by default nowhere, else at measured ones."""
        data, inputs = self.data, self.data.path
        measured = data.has_wheel if measured is None else measured
        commanded = np.zeros(len(data.segments), dtype=np.bool_) if commanded is None else commanded
        turned, steady, first = inputs["wheel"], inputs["steady"], inputs["steady"][data.path_starts[:-1]]
        if not measured.all():
            is_measured, after = np.repeat(measured, np.diff(data.path_starts)), wheel[1, :: data.stride]
            turned, steady = np.where(is_measured, turned, after), np.where(is_measured, steady, after)
            first = np.where(measured, first, data.first_wheel)
        target = np.ascontiguousarray(data.target[:: data.stride])
        out = np.empty((4, len(turned)))
        simulate_path(
            data.path_starts, turned, steady, first, measured, inputs["speed"], target, commanded, inputs["working"],
            inputs["east"], inputs["north"], inputs["heading"], inputs["cosine"], inputs["sine"], inputs["across"],
            inputs["seconds"], self._fill("path", fields), self._find_places(PATH_TERMS), self._fill("speed", fields),
            self._find_places(SPEED_TERMS), self.values, self.model, self.ground, np.zeros(1, dtype=STATE)[0],
            self.rig.table, data.path_step_s, out,
        )  # fmt: skip
        return out

    def show(self, path: Floats, wheel: Floats, speed: Floats, fields: Fields) -> dict[str, Floats]:
        """What instruments show of a path (3, m), wheel angles (n,) and speeds (n,), column by column."""
        return {
            **self.show_pose(path, fields),
            "wheel": self._show(self.data.wheel, wheel, fields, *SENSOR_FIELDS["wheel"]),
            "speed": self._show(self.data.speed, speed, fields, *SENSOR_FIELDS["speed"]),
        }

    def show_pose(self, path: Floats, fields: Fields) -> dict[str, Floats]:
        """What receiver and compass show of a path."""
        data, filled, tractor = self.data, self._fill("instruments", fields), self.rig.tractor
        places, step_s = data.east, data.path_step_s
        positions = np.empty((2, len(places.places)))
        sample_positions(places.places, places.segments, data.path_starts, path, filled, tractor.guide_m,
                         tractor.antenna_right_m, step_s, positions)  # fmt: skip
        angle = path[2]
        if filled[HEADING_FILTER].max() > 0.0:
            angle = np.empty(len(path[2]))
            filter_angles(data.path_starts, path[2], filled[HEADING_FILTER], data.stride, angle)
        headings = np.empty(len(data.heading.places))
        sample_headings(data.heading.places, data.heading.segments, data.path_starts, angle, filled, step_s, headings)
        return {"east": data.east.average(positions[0]), "north": data.north.average(positions[1]),
                "heading": data.heading.average(headings)}  # fmt: skip

    def _show(self, samples: Samples, values: Floats, fields: Fields, clock: str, scale: str) -> Floats:
        """A sensor of one column: what it shows is late by its clock and of its own scale."""
        late, factor = (np.repeat(fields.get(name, [self.base[name]]), self.data.stride) for name in (clock, scale))
        out = np.empty(len(samples.places))
        shown = values * (factor if scale in fields else self.base[scale])
        sample_values(samples.places, samples.segments, self.data.step_starts, shown, late, DT_S, out)
        return samples.average(out)


def make_settled_state(command: Floats, earlier: Floats) -> Any:
    """Return the state of a tractor that was given `earlier` commands (m,) before the first one of `command` (n,).

    Without any its wheels have settled at the first command. What delays cannot reach back to is left out.
    """
    state = np.zeros(1, dtype=STATE)
    reached = earlier[max(len(earlier) - HISTORY_STEPS + 2, 0) :]
    state["commands"] = command[0]
    state["commands"][0, : len(reached)] = reached
    state["clock"] = len(reached)
    return state


def replay_segment(
    rig: ReplayRig, segment: DriveSegment, settings: Settings, from_sensor: bool, from_speed: bool
) -> Floats:
    """Return states (n, 5) on the grid of a segment; see Simulator.replay."""
    wheel, path = Simulator(build_inputs([segment]), rig, settings).replay({}, from_sensor, from_speed)
    return np.column_stack([*path[:3], wheel, path[3]])


def simulate_logged_values(
    rig: ReplayRig, segment: DriveSegment, states: Floats, settings: Settings
) -> InstrumentColumns:
    """Return what instruments would log of replayed states, per row: antenna (k, 2), heading, wheel angle, speed."""
    path = np.ascontiguousarray(states[:, [X_COLUMN, Y_COLUMN, ANGLE_COLUMN]].T)
    wheel, speed = states[:, STEERING_COLUMN], states[:, FORWARD_COLUMN]
    return _show_columns(Simulator(build_inputs([segment]), rig, settings), path, wheel, speed)


def simulate_instruments(rig: ReplayRig, segment: DriveSegment, settings: Settings) -> InstrumentColumns:
    """Simulate the instruments when the commands of a segment are driven with these effects."""
    simulator = Simulator(build_inputs([segment]), rig, settings)
    wheel, path = simulator.replay({})
    return _show_columns(simulator, path, wheel, path[3])


def _show_columns(simulator: Simulator, path: Floats, wheel: Floats, speed: Floats) -> InstrumentColumns:
    shown = simulator.show(path, wheel, speed, {})
    return np.stack([shown["east"], shown["north"]], axis=1), shown["heading"], shown["wheel"], shown["speed"]
