"""What instruments would have shown: the vehicle of planning driven with effects that vary from step to step.

The formulas are those of vehicle.sim and vehicle.control; here every field of the model may be an array over steps, so
that an effect in one run, at one speed or from one moment on is only another array. Three chains: wheel angle from
commands, speed from commands, path from measured wheel angles and speeds.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vehicle.control.steering import step_steering_simulator
from vehicle.fast_math import compute_cosine_sine
from vehicle.identification.diagnosis.drive_data import PATH_STEP_S, STEP_S, STRIDE, DriveData, Samples
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.rig import ReplayRig, make_settled_state
from vehicle.jit import compile_function
from vehicle.model.effects import CATALOGUE, NEUTRAL_FIELDS, PATH, SPEED, list_neutral_fields
from vehicle.model.instruments import apply_lever_arm, compute_filter_share
from vehicle.records import DT_S, STATE
from vehicle.sim.dynamics import compute_rolling_resistance, step_body, step_speed_control
from vehicle.sim.effect_terms import (
    apply_play,
    compute_affected_tangent,
    compute_draft_crab,
    compute_slope_drift,
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
def simulate_steering(starts, command, first, states, fields, model, dt, out) -> None:  # type: ignore[no-untyped-def]
    """Write the wheel angle before each step to `out` (n,), from commands (n,) and fields (f, n) per step.

    `first` (s,) are the angles at the start of the segments, `states` hold the commands before them.
    """
    for number in range(len(starts) - 1):
        begin, end = starts[number], starts[number + 1]
        state = states[number]
        angle, stage = first[number], 1
        for i in range(begin, end):
            out[i] = angle
            ahead = fields[4, i] / dt
            state.commands[state.clock % len(state.commands)] = _read_at(command, begin, end, i + max(ahead, 0.0))
            late = min(fields[0, i] + max(-ahead, 0.0), float(state.clock))
            delayed = read_delayed(state.commands, state.clock, late)
            angle, stage = step_steering_simulator(
                angle, delayed, stage, dt, max(fields[3, i], 0.0), model.switch, max(fields[2, i], 0.01),
                max(fields[1, i], 0.01), model.gain, model.latch,
            )  # fmt: skip
            state.clock += 1


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
        state.reference_speed, state.integral, state.last_error = forward, 0.0, 0.0
        for i in range(begin, end):
            out[i] = forward
            state.working, state.target_speed = working[i], target[i]
            for row in range(len(terms)):
                values[terms[row]] = fields[row, i]
            model.speed_lag, model.acceleration = max(model.speed_lag, 0.0), acceleration * max(fields[RAMP, i], 0.1)
            drive = step_speed_control(state, model, ground, forward, dt)
            forward += dt * (drive - compute_rolling_resistance(forward, model, ground)) / model.mass
    model.acceleration = acceleration


@compile_function
def simulate_path(  # type: ignore[no-untyped-def]
    starts, wheel, steady, speed, working, east, north, heading, cosine, sine, across, noisy, fields, terms, values,
    model, ground, table, dt, out,
) -> None:  # fmt: skip
    """Write x, y and angle of the centre of mass before each step to `out` (3, m), at measured speeds.

    `fields` (f, m) in the order of PATH_FIELDS; `noisy` (s,) says where wheel angles were measured. `terms` are the
    places of PATH_TERMS in `values`, which is the memory of `model`.
    """
    for number in range(len(starts) - 1):
        begin, end = starts[number], starts[number + 1]
        x, y, angle, right, spin = east[begin], north[begin], heading[begin], 0.0, 0.0
        play, bend = steady[begin], 0.0
        for i in range(begin, end):
            out[0, i], out[1, i], out[2, i] = x, y, angle
            forward = (
                speed[i]
                if fields[SPEED_CLOCK, i] == 0.0
                else _read_at(speed, begin, end, i + fields[SPEED_CLOCK, i] / dt)
            )
            forward /= fields[SPEED_SCALE, i]
            ahead = fields[STEERING_CLOCK, i] / dt
            turned, calm = wheel[i], steady[i]
            if ahead != 0.0:
                turned, calm = _read_at(wheel, begin, end, i + ahead), _read_at(steady, begin, end, i + ahead)
            turned, calm = turned / fields[WHEEL_SCALE, i], calm / fields[WHEEL_SCALE, i]
            for row in range(len(terms)):
                values[terms[row]] = fields[row, i]
            model.half_play, model.slide = max(model.half_play, 0.0), max(model.slide, 0.0)
            play = apply_play(play, calm, model)
            turned = turned + (play - calm) if noisy[number] else play
            tangent = compute_affected_tangent(
                turned, forward, 0.0, 0.0, cosine[i], sine[i], 0.0, working[i], table, model
            )
            if fields[RELAXATION, i] > 1e-3 and i > begin:
                bend += (tangent - bend) * (1.0 - np.exp(-abs(forward) * dt / fields[RELAXATION, i]))
            else:
                bend = tangent
            slide = (
                compute_slope_drift(forward, cosine[i], sine[i], model)
                + abs(forward) * across[i] * fields[PER_SLOPE, i]
            )
            if model.draft != 0.0:
                slide += compute_draft_crab(forward, working[i], model, ground)
            slide += fields[PUSH_EAST, i] * sine[i] - fields[PUSH_NORTH, i] * cosine[i]
            slide -= fields[CRAB, i] * abs(forward) * forward * spin
            along = fields[PUSH_EAST, i] * cosine[i] + fields[PUSH_NORTH, i] * sine[i]
            rolled = compute_rolling_resistance(forward, model, ground)
            _, new_right, new_spin = step_body(forward, right - slide, spin, bend, rolled, dt, model, ground)
            c, s = compute_cosine_sine(angle)
            x += ((forward + along) * c + right * s) * dt
            y += ((forward + along) * s - right * c) * dt
            angle -= spin * dt
            right, spin = new_right + slide, new_spin


@compile_function
def filter_angles(starts, angle, time_constant, stride, out) -> None:  # type: ignore[no-untyped-def]
    """Write the first-order low pass of angles (m,) to `out` (m,), with a time constant (s) per step."""
    for number in range(len(starts) - 1):
        shown = angle[starts[number]]
        for i in range(starts[number], starts[number + 1]):
            for _ in range(stride):
                shown += (angle[i] - shown) * compute_filter_share(max(time_constant[i], 0.0))
            out[i] = shown


@compile_function
def sample_positions(places, segments, starts, path, fields, ahead, aside, dt, out) -> None:  # type: ignore[no-untyped-def]
    """Write antenna positions (2, k) at fractional steps `places` (k,), by the lever arm and what makes them late."""
    for row in range(len(places)):
        begin, end = starts[segments[row]], starts[segments[row] + 1]
        i = min(max(int(places[row]), begin), end - 1)
        late_s = (fields[LATENCY, i] + fields[POSITION_LATE, i]) * DT_S + fields[POSITION_CLOCK, i]
        place = places[row] - late_s / dt
        cosine, sine = compute_cosine_sine(_read_at(path[2], begin, end, place))
        out[0, row], out[1, row] = apply_lever_arm(
            _read_at(path[0], begin, end, place), _read_at(path[1], begin, end, place), cosine, sine,
            ahead + fields[FORWARD, i], aside + fields[RIGHT, i],
        )  # fmt: skip


@compile_function
def sample_headings(places, segments, starts, angle, fields, dt, out) -> None:  # type: ignore[no-untyped-def]
    """Write shown headings (k,) at fractional steps."""
    for row in range(len(places)):
        begin, end = starts[segments[row]], starts[segments[row] + 1]
        i = min(max(int(places[row]), begin), end - 1)
        late_s = (fields[LATENCY, i] + fields[HEADING_LATE, i]) * DT_S + fields[HEADING_CLOCK, i]
        out[row] = _read_at(angle, begin, end, places[row] - late_s / dt) + fields[BIAS, i]


@compile_function
def sample_values(places, segments, starts, values, late_s, step_s, out) -> None:  # type: ignore[no-untyped-def]
    """Write values (k,) at fractional steps, `late_s` (s) old; for what one number per step describes."""
    for row in range(len(places)):
        begin, end = starts[segments[row]], starts[segments[row] + 1]
        i = min(max(int(places[row]), begin), end - 1)
        out[row] = _read_at(values, begin, end, places[row] - late_s[i] / step_s)


Fields = Mapping[str, Array]
Keys = Mapping[str, Hashable]


@dataclass(eq=False)
class Simulator:
    """Simulates what instruments show of the data, chain by chain; chains that no field changed are kept."""

    data: DriveData
    rig: ReplayRig
    base: dict[str, float] = field(init=False)
    cache: dict[tuple[str, Hashable], Array] = field(default_factory=dict)
    simulations: int = 0

    def __post_init__(self) -> None:
        model = self.rig.build_effective_model({})
        self.model, self.ground, self.values = model[0], self.rig.ground[0], model.view(np.float64)
        self.base = dict.fromkeys((*STEERING_FIELDS, *SPEED_FIELDS, *PATH_FIELDS, *INSTRUMENT_FIELDS), 0.0)
        self.base |= dict.fromkeys(FACTORS, 1.0)
        self.base |= {name: float(self.model[name]) for name in ("lag", "rate", "dead_band")}
        self.settled = np.concatenate(
            [
                make_settled_state(self.data.command[begin:], segment.earlier_commands)
                for begin, segment in zip(self.data.step_starts[:-1], self.data.segments, strict=True)
            ]
        )
        self.blank = {
            name: np.array([np.full(size, self.base[field]) for field in names])
            for name, names in CHAINS.items()
            for size in (self.data.step_starts[-1] if name in ("steering", "speed") else self.data.path_starts[-1],)
        }

    def simulate(self, fields: Fields, keys: Keys) -> dict[str, Array]:
        """Predicted columns in the cells of the windows.

        `fields` holds arrays on the axis of the path for fields that differ from the base; `keys` says per chain what
        they are made of, so that a chain is driven again only where that changed.
        """
        wheel = self._get("steering", keys["steering"], lambda: self._simulate_wheel(fields))
        speed = self._get("speed", keys["speed"], lambda: self._simulate_speed(fields))
        steered = () if self.data.has_wheel.all() else keys["steering"]
        path = self._get("path", (keys["path"], steered), lambda: self._simulate_path(fields, wheel))
        return {**self._show_pose(path, fields), **self._show_sensors(wheel, speed, fields)}

    def measure_fastest_turn(self) -> float:
        """The largest yaw rate (rad/s) of the drive without effects; nan where it is none."""
        angle = self._simulate_path({}, self._simulate_wheel({}))[2]
        is_inside = np.ones(len(angle) - 1, dtype=np.bool_)
        is_inside[self.data.path_starts[1:-1] - 1] = False
        return float(np.max(np.abs(np.diff(angle)[is_inside]))) / PATH_STEP_S

    def _get(self, chain: str, key: Hashable, make: Any) -> Array:
        if (chain, key) not in self.cache:
            old = [entry for entry in self.cache if entry[0] == chain]
            if len(old) >= MOST_CACHED:
                del self.cache[old[1]]  # the first is the base
            self.cache[chain, key] = make()
            self.simulations += 1
        return self.cache[chain, key]

    def _fill(self, chain: str, fields: Fields) -> Array:
        """All fields of a chain (f, n)."""
        names = CHAINS[chain]
        if not any(name in fields for name in names):
            return self.blank[chain]
        out = self.blank[chain].copy()
        for place, name in enumerate(names):
            if name in fields:
                values = fields[name]
                out[place] = np.repeat(values, STRIDE) if chain in ("steering", "speed") else values
        return out

    def _find_places(self, terms: Sequence[str]) -> Array:
        """Places (t,) of fields in the memory of the model."""
        return np.array([(self.model.dtype.names or ()).index(name) for name in terms])

    def _simulate_wheel(self, fields: Fields) -> Array:
        data = self.data
        out = np.empty(len(data.command))
        simulate_steering(data.step_starts, data.command, data.first_wheel, self.settled.copy(),
                          self._fill("steering", fields), self.model, STEP_S, out)  # fmt: skip
        return out

    def _simulate_speed(self, fields: Fields) -> Array:
        data, out = self.data, np.empty(len(self.data.target))
        first = data.path["speed"][data.path_starts[:-1]]
        self.model["affected"] = 1.0
        simulate_speeds(
            data.step_starts, data.target, data.working, first, self._fill("speed", fields),
            self._find_places(SPEED_TERMS), self.values, self.model, self.ground, np.zeros(1, dtype=STATE)[0], STEP_S,
            out,
        )  # fmt: skip
        return out

    def _simulate_path(self, fields: Fields, simulated: Array) -> Array:
        data, inputs = self.data, self.data.path
        wheel, steady = inputs["wheel"], inputs["steady"]
        if not data.has_wheel.all():
            is_simulated = ~np.repeat(data.has_wheel, np.diff(data.path_starts))
            wheel = np.where(is_simulated, simulated[::STRIDE], wheel)
            steady = np.where(is_simulated, simulated[::STRIDE], steady)
        out = np.empty((3, len(wheel)))
        simulate_path(
            data.path_starts, wheel, steady, inputs["speed"], inputs["working"], inputs["east"], inputs["north"],
            inputs["heading"], inputs["cosine"], inputs["sine"], inputs["across"], data.has_wheel,
            self._fill("path", fields), self._find_places(PATH_TERMS), self.values, self.model, self.ground,
            self.rig.table, PATH_STEP_S, out,
        )  # fmt: skip
        return out

    def _show_pose(self, path: Array, fields: Fields) -> dict[str, Array]:
        data, filled, tractor = self.data, self._fill("instruments", fields), self.rig.tractor
        places = data.east
        positions = np.empty((2, len(places.places)))
        ahead = tractor.antenna_forward_m - tractor.rear_axle_m
        sample_positions(places.places, places.segments, data.path_starts, path, filled, ahead,
                         tractor.antenna_right_m, PATH_STEP_S, positions)  # fmt: skip
        angle = path[2]
        if filled[HEADING_FILTER].max() > 0.0:
            angle = np.empty(len(path[2]))
            filter_angles(data.path_starts, path[2], filled[HEADING_FILTER], STRIDE, angle)
        headings = np.empty(len(data.heading.places))
        sample_headings(
            data.heading.places, data.heading.segments, data.path_starts, angle, filled, PATH_STEP_S, headings
        )
        return {"east": data.east.average(positions[0]), "north": data.north.average(positions[1]),
                "heading": data.heading.average(headings)}  # fmt: skip

    def _show_sensors(self, wheel: Array, speed: Array, fields: Fields) -> dict[str, Array]:
        return {
            "wheel": self._show(self.data.wheel, wheel, fields, "steering_clock", "wheel_scale"),
            "speed": self._show(self.data.speed, speed, fields, "speed_clock", "speed_scale"),
        }

    def _show(self, samples: Samples, values: Array, fields: Fields, clock: str, scale: str) -> Array:
        """A sensor of one column: what it shows is late by its clock and of its own scale."""
        starts, out = self.data.step_starts, np.empty(len(samples.places))
        late = np.repeat(fields[clock], STRIDE) if clock in fields else np.zeros(len(values))
        shown = values * np.repeat(fields[scale], STRIDE) if scale in fields else values
        sample_values(samples.places, samples.segments, starts, shown, late, STEP_S, out)
        return samples.average(out)
