"""Replay of logged commands through the functions that planning drives with.

No pymunk space is needed for one tractor that touches nothing: steering, drive line, effects and chassis are the
functions of the planning loop, and the position is moved as pymunk moves it, with the velocity before the step.
Effects that belong to a place or a direction look at the measured pose, so one simulation serves every horizon.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from vehicle.calibration import steering_tables
from vehicle.chassis import body_step
from vehicle.compile import compile_grounds, compile_model
from vehicle.driveline import propel, turn_wheels
from vehicle.effects import PATH, SLOPE_DRIFT, SPEED, STEP_HZ, effect_fields
from vehicle.effects import STEERING as STEERS
from vehicle.ground import ground_index
from vehicle.instruments import SHOWN_EAST, SHOWN_HEADING, SHOWN_NORTH, shown_rows
from vehicle.jit import compiled
from vehicle.kinds import PER_SLOPE
from vehicle.layout import DT_S, STATE
from vehicle.learnt import Learnt, Settings, learnt, without_logs
from vehicle.measured.logs.record import Array
from vehicle.measured.replay.abreast import ABREAST, move_on, turn_abreast
from vehicle.measured.replay.course import Stretch
from vehicle.measured.replay.foretelling import foretell
from vehicle.measured.replay.keeping import Effects, Kept, key_of, of_blocks
from vehicle.measured.replay.states import ANGLE, FORWARD, STEERING, X, Y
from vehicle.series import cosine_sine
from vehicle.terms import affected_tangent, ground_drift, played
from vehicle.tractor import Implement, Tractor

LAID_STEPS = 100_000  # chosen, of stretches laid side by side once all lanes are taken: they stay near the processor
MOST_MODELS = 16  # chosen: the stretches of a course ask for one after another
Pair = tuple[Stretch, Settings]


@compiled
def replay_steps(  # type: ignore[no-untyped-def]
    turned, speed, target, working, east, north, heading, cosines, sines, downhill, start_s, dt, state, model, ground,
    table, out,
) -> None:  # fmt: skip
    """Drive at the speed commanded through inputs of one value per step; `out` (n, 5) gets x, y, angle and speed before
    each.

    `turned` is the wheel angle behind the play, `cosines` and `sines` are those of `heading`; `downhill` is the drift
    to the right (m/m) on a slope that was measured, beside that of the model. Speeds are those on the ground: where
    that is itself carried along, the tractor drives on top of it.
    """
    x, y, angle, forward = east[0], north[0], heading[0], speed[0]
    state.reference_speed = forward
    right = spin = 0.0
    for i in range(len(turned)):
        state.working, state.target_speed = working[i], target[i]
        out[i, X], out[i, Y], out[i, ANGLE], out[i, FORWARD] = x, y, angle, forward
        drive = propel(state, model, ground, forward, dt)
        there, across = cosines[i], sines[i]
        tangent = affected_tangent(
            turned[i], forward, east[i], north[i], there, across, start_s + i * dt, working[i], table, model
        )
        along, slide = ground_drift(turned[i], forward, there, across, model)
        slide += abs(forward) * downhill[i]
        new_forward, new_right, new_spin = body_step(forward, right - slide, spin, tangent, drive, dt, model, ground)
        cosine, sine = cosine_sine(angle)
        x += ((forward + along) * cosine + right * sine) * dt
        y += ((forward + along) * sine - right * cosine) * dt
        angle -= spin * dt
        forward, right, spin = new_forward, new_right + slide, new_spin


@compiled
def steer_steps(command, first, dt, state, model, out) -> None:  # type: ignore[no-untyped-def]
    """Steer through one command per step from a `first` wheel angle; `out` (n + 1,) gets the wheel angle before each
    and after the last."""
    state.steering = state.play = state.commands[-1] = first
    for i in range(len(command)):
        state.command = command[i]
        out[i] = state.steering
        turn_wheels(state, model, dt)
        state.clock += 1
    out[len(command)] = state.steering


@compiled
def play_steps(wheel, steady, first, noisy, model, out) -> None:  # type: ignore[no-untyped-def]
    """Wheel angles behind the play, `out` (n,), of those before it, (n,), and without noise, `steady` (n,).

    The play begins at a `first` angle and follows those without noise: the extremes of noise would take up some of it.
    Angles that are not `noisy` are their own `steady` ones.
    """
    play = first
    for i in range(len(wheel)):
        play = played(play, steady[i], model)
        out[i] = wheel[i] + (play - steady[i]) if noisy else play


@dataclass(frozen=True, eq=False)
class Rig:
    """A tractor ready for replay: its compiled model without effects, the ground, and the steering table.

    `ranges` are the fields that keep a rest to where it was seen; a rest that is still sought has none. `kept` is what
    was replayed already, `models` what it was replayed with.
    """

    tractor: Tractor
    model: Any
    ground: Any
    table: Array
    origin: tuple[float, float] = (0.0, 0.0)
    ranges: Mapping[str, float] = field(default_factory=dict)
    kept: Kept = field(default_factory=Kept)
    models: dict[Hashable, Any] = field(default_factory=dict)

    def effective(self, settings: Settings) -> Any:
        """The record of with_effects, made once for the stretches of a course."""
        key = self.origin, tuple(self.ranges.items()), key_of(settings)
        if key not in self.models:
            if len(self.models) >= MOST_MODELS:
                self.models.clear()
            self.models[key] = self.with_effects(settings)[0]
        return self.models[key]

    def with_effects(self, settings: Settings) -> Any:
        """The model record with effects; places in the field are moved to the origin of the course."""
        model = self.model.copy()
        fields = Learnt(settings, self.ranges).fields
        fields["affected"] = 1.0
        fields["patch_east"] -= self.origin[0]
        fields["patch_north"] -= self.origin[1]
        for name, value in fields.items():
            model[0][name] = value
        return model


def make_rig(tractor: Tractor, ground: str, origin: tuple[float, float]) -> Rig:
    """The tractor as its file describes it, without what logs taught. Raises VehicleError for an unknown ground."""
    bare = without_logs(tractor)
    index = ground_index(ground)
    model = np.zeros(1, dtype=compile_model(bare, Implement()).dtype)
    model[0] = compile_model(bare, Implement())
    return Rig(bare, model, compile_grounds()[index : index + 1], steering_tables(bare)[index], origin)


def own_rig(tractor: Tractor, ground: str, origin: tuple[float, float]) -> tuple[Rig, Settings]:
    """The tractor of make_rig, and what its file has from logs: effects, and the rest where it was seen."""
    own = learnt(tractor)
    return replace(make_rig(tractor, ground, origin), ranges=own.ranges), own.settings


def replay(rig: Rig, stretch: Stretch, settings: Settings, from_sensor: bool, from_speed: bool) -> Array:
    """States (n, 5) on the grid of a stretch, not to be written to.

    What the log lacks is replaced: a sensor by the command and back.
    """
    return replays(rig, [(stretch, settings)], from_sensor, from_speed)[0]


def replays(rig: Rig, pairs: Sequence[Pair], from_sensor: bool, from_speed: bool) -> list[Array]:
    """The states of replay for many stretches, each with its settings."""
    asked = _asked(rig, pairs, from_sensor, from_speed)
    found = [rig.kept.find(one.key) for one in asked]
    missing = {one.key: one for one, states in zip(asked, found, strict=True) if states is None}
    made: dict[Hashable, Array] = {}
    for group in _groups(list(missing.values())):
        made |= _led(rig, group) if group[0].timed else {group[0].key: _commanded(rig, group[0])}
    for key in missing:
        rig.kept.keep(key, (made[key],))
    return [made[one.key] if states is None else states[0] for one, states in zip(asked, found, strict=True)]


@dataclass(frozen=True, eq=False)
class _Acting:
    """Settings that act in a replay, with what many stretches ask of them."""

    rig: Rig
    settings: Settings

    @cached_property
    def key(self) -> Effects:
        """The settings as a key."""
        return key_of(self.settings)

    @cached_property
    def model(self) -> Any:
        """The tractor with them."""
        return self.rig.effective(self.settings)

    @cached_property
    def steering(self) -> Settings:
        """Those of the steering alone."""
        return of_blocks(self.settings, frozenset({STEERS}))

    @cached_property
    def steering_key(self) -> Effects:
        """Those of the steering as a key."""
        return key_of(self.steering)


@dataclass(frozen=True, eq=False)
class _Asked:
    """A stretch to be replayed with the settings that act: `sensed` from its wheel angle, `timed` at its speed."""

    stretch: Stretch
    acting: _Acting
    sensed: bool
    timed: bool
    key: Hashable


def _asked(rig: Rig, pairs: Sequence[Pair], from_sensor: bool, from_speed: bool) -> list[_Asked]:
    """What is asked for, with its key; settings that many stretches share are looked at once."""
    ranges, known = tuple(rig.ranges.items()), dict[tuple[int, bool, bool], _Acting]()
    asked = []
    for stretch, settings in pairs:
        sensed, timed = from_sensor and stretch.wheel is not None, from_speed or stretch.target is None
        place = (id(settings), sensed, timed)
        if place not in known:
            # A sensor cuts the chain: what lies before it moves nothing; antenna and clocks move no tractor at all.
            blocks = {PATH, *(() if sensed else (STEERS,)), *(() if timed else (SPEED,))}
            known[place] = _Acting(rig, of_blocks(settings, frozenset(blocks)))
        acting = known[place]
        asked.append(_Asked(stretch, acting, sensed, timed, (stretch, sensed, timed, ranges, acting.key)))
    return asked


def _groups(asked: list[_Asked]) -> list[list[_Asked]]:
    """What is driven side by side, the longest first; what drives at commanded speeds is driven alone."""
    timed = sorted((one for one in asked if one.timed), key=lambda one: -len(one.stretch.grids["speed"]))
    groups, steps = list[list[_Asked]](), 0
    for one in timed:
        if not groups or (steps >= LAID_STEPS and len(groups[-1]) >= ABREAST):
            groups.append([])
            steps = 0
        groups[-1].append(one)
        steps += len(one.stretch.grids["speed"])
    return groups + [[one] for one in asked if not one.timed]


def _led(rig: Rig, group: list[_Asked]) -> dict[Hashable, Array]:
    """States of stretches driven side by side at their measured speed."""
    ends = np.cumsum([len(one.stretch.grids["speed"]) for one in group])
    begins = np.concatenate([[0], ends[:-1]])
    speed, bend, ahead, slide, right, spin = np.empty((6, ends[-1]))
    parts = [slice(int(begin), int(end)) for begin, end in zip(begins, ends, strict=True)]
    made = []
    for one, mine in zip(group, parts, strict=True):
        speed[mine] = one.stretch.grids["speed"]
        made.append(_foretold(rig, one, bend[mine], ahead[mine], slide[mine]))
    turn_abreast(begins, ends, speed, bend, slide, DT_S, rig.model[0], rig.ground[0], right, spin)
    for one, mine, states in zip(group, parts, made, strict=True):
        x, y, angle = (one.stretch.grids[name][0] for name in ("east", "north", "heading"))
        move_on(speed[mine], ahead[mine], right[mine], spin[mine], x, y, angle, DT_S, states.T)
    return {one.key: states for one, states in zip(group, made, strict=True)}


def _foretold(rig: Rig, asked: _Asked, bend: Array, ahead: Array, slide: Array) -> Array:
    """States (n, 5) of a stretch, column by column, with the wheel angle and the speed alone; the rest as foretell."""
    stretch, grids = asked.stretch, asked.stretch.grids
    model, slope = _on_slope(rig, asked)
    states = np.empty((len(bend), 5), order="F")
    slide[:] = 0.0 if slope is None else slope
    states[:, FORWARD] = grids["speed"]
    states[:, STEERING], turned = _wheels(rig, asked, model)
    foretell(
        grids["speed"], grids["working"], grids["east"], grids["north"], *stretch.direction, turned,
        stretch.start_s, DT_S, rig.table, model, bend, ahead, slide,
    )  # fmt: skip
    return states


def _wheels(rig: Rig, asked: _Asked, model: Any) -> tuple[Array, Array]:
    """Wheel angles (n,) on the grid: before each step, and behind the play in it."""
    stretch = asked.stretch
    if asked.sensed:
        wheel, steady = stretch.grids["wheel"], stretch.steady_wheel
        before, first = np.concatenate([wheel[:1], wheel[:-1]]), steady[0]
    else:
        steered = _steered(rig, stretch, asked.acting)
        before, wheel, steady, first = steered[:-1], steered[1:], steered[1:], steered[0]
    if model["half_play"] == 0.0:
        return before, wheel.copy()  # what nobody may write to would be another type, and all be compiled for it too
    turned = np.empty(len(wheel))
    play_steps(wheel, steady, first, asked.sensed, model, turned)
    return before, turned


def _commanded(rig: Rig, asked: _Asked) -> Array:
    """States of a stretch driven at the speeds commanded."""
    stretch, grids = asked.stretch, asked.stretch.grids
    (model, slope), count = _on_slope(rig, asked), len(grids["speed"])
    out = np.empty((count, 5), order="F")
    out[:, STEERING], turned = _wheels(rig, asked, model)
    replay_steps(
        turned, grids["speed"], grids["target"], grids["working"], grids["east"], grids["north"], grids["heading"],
        *stretch.direction, np.zeros(count) if slope is None else slope, stretch.start_s, DT_S,
        np.zeros(1, dtype=STATE)[0], model, rig.ground[0], rig.table, out,
    )  # fmt: skip
    return out


def _on_slope(rig: Rig, asked: _Asked) -> tuple[Any, Array | None]:
    """The tractor without the drift on a plane, and the drift (m/m, n) on the slope measured; as it is without one."""
    settings, across = asked.acting.settings, asked.stretch.grids.get("across")
    share = settings.get(SLOPE_DRIFT, {}).get(PER_SLOPE)
    if share is None or across is None:
        return asked.acting.model, None
    return rig.effective({name: values for name, values in settings.items() if name != SLOPE_DRIFT}), share * across


def wheel_angles(rig: Rig, stretch: Stretch, settings: Settings) -> Array:
    """Wheel angle (n,) on the grid of a stretch that its commands come to: that of replay, without the drive."""
    return _steered(rig, stretch, _Acting(rig, settings))[:-1]


def _steered(rig: Rig, stretch: Stretch, acting: _Acting) -> Array:
    """Wheel angle (n + 1,) that the commands of a stretch come to before each step and after the last."""

    def steered() -> tuple[Array]:
        command, wheel = _steering(stretch)
        out = np.empty(len(command) + 1)
        steer_steps(command, wheel[0], DT_S, _fresh(command)[0], rig.effective(acting.steering), out)
        return (out,)

    return rig.kept.get((stretch, "wheel", acting.steering_key), steered)[0]


def _steering(stretch: Stretch) -> tuple[Array, Array]:
    """Commands and wheel angles on the grid, one standing in for the other."""
    command = stretch.grids.get("command", stretch.grids.get("wheel"))
    wheel = stretch.grids.get("wheel", command)
    assert command is not None and wheel is not None
    return command, wheel


def _fresh(command: Array) -> Any:
    """The state of a tractor whose wheels have long been where the first command wants them."""
    state = np.zeros(1, dtype=STATE)
    state["commands"] = command[0]
    return state


def antenna_lever(rig: Rig, fields: Mapping[str, float]) -> tuple[float, float]:
    """Antenna ahead of and to the right of the centre of mass, effects included (m)."""
    tractor = rig.tractor
    ahead = tractor.antenna_forward_m - tractor.rear_axle_m + fields["shift_forward"]
    return ahead, tractor.antenna_right_m + fields["shift_right"]


def seen(rig: Rig, stretch: Stretch, states: Array, settings: Settings) -> tuple[Array, Array, Array, Array]:
    """What instruments would have logged of replayed states, per row: antenna (k, 2), heading, wheel angle, speed."""
    grid = np.arange(len(states), dtype=np.float64) * DT_S
    wheel, speed = (np.interp(stretch.time, grid, states[:, column]) for column in (STEERING, FORWARD))
    return *antenna_seen(rig, stretch, states, settings), wheel, speed


def antenna_seen(rig: Rig, stretch: Stretch, states: Array, settings: Settings) -> tuple[Array, Array]:
    """Antenna (k, 2) and heading (k,) of `seen` alone."""
    fields, out = effect_fields(settings), np.empty((6, stretch.rows))
    shown_rows(
        stretch.time, stretch.steps_s, states[:, X], states[:, Y], states[:, ANGLE], fields["latency"] / STEP_HZ,
        *antenna_lever(rig, fields), fields["heading_bias"], out,
    )  # fmt: skip
    return out[SHOWN_EAST : SHOWN_NORTH + 1].T, out[SHOWN_HEADING]
