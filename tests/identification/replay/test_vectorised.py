"""Segments driven side by side against each of them alone, and what is told beforehand against one step after another.

Equal to the last bit: a segment must not notice what drives beside it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.identification.analytic_drives import rig
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_programmes import DRIVE_PROGRAMMES, simulate_programme
from vehicle.identification.replay.drive_segments import DriveSegment
from vehicle.identification.replay.rig import (
    ReplayRig,
    _build_requests,
    _compute_wheel_angles,
    replay_segment,
    replay_segments,
    simulate_wheel_angles,
)
from vehicle.identification.replay.state_cache import (
    ANGLE_COLUMN,
    FORWARD_COLUMN,
    MOST_CACHE_BYTES,
    X_COLUMN,
    Y_COLUMN,
    ReplayCache,
)
from vehicle.identification.replay.vectorised import LANES, compute_tangents_and_drift
from vehicle.model.tractor import Settings
from vehicle.records import DT_S, GRAVITY_MPS2
from vehicle.sim.dynamics import step_body
from vehicle.sim.effect_terms import compute_affected_tangent, compute_ground_drift

BENT: Settings = {
    "steering_offset": {"angle_deg": 1.2},
    "understeer": {"deg_per_mps2": 0.7},
    "grip_drift": {"per_minute": 0.04},
    "steering_asymmetry": {"ratio": 1.1},
    "steering_backlash": {"angle_deg": 1.0},
    "side_slip": {"limit_g": 0.25},
    "implement_side_draft": {"curvature_per_m": 0.003},
}
REST: Settings = {"discrepancy_model": {"grip_by_angle": 0.3, "push_to_east": 0.05, "angle_by_speed": 0.01}}
PATCH: Settings = {"grip_patch": {"ratio": 0.7, "east_m": 3.0, "north_m": 2.0, "radius_m": 9.0}}
ALL = (BENT, REST, {"understeer": {"deg_per_mps2": 0.7}}, {**BENT, **REST}, {}, PATCH)


@lru_cache(maxsize=1)
def segments() -> tuple[DriveSegment, ...]:
    """Drives of many lengths, more than are driven at once."""
    drives = [one for drill in DRIVE_PROGRAMMES for one in simulate_programme(rig(), drill, 0.3, 1.4, {}).segments]
    whole = [replace(one, run=number) for number, one in enumerate(3 * drives)]
    assert len(whole) > LANES
    return tuple(whole)


def fresh(most_bytes: int = MOST_CACHE_BYTES) -> ReplayRig:
    """The tractor of the tests, which has replayed nothing yet."""
    return replace(rig(), cache=ReplayCache(most_bytes))


@pytest.mark.parametrize("settings", ALL)
@pytest.mark.parametrize("from_sensor", [False, True])
def test_a_segment_does_not_notice_what_drives_beside_it(settings: Settings, from_sensor: bool) -> None:
    together = replay_segments(fresh(), [(one, settings) for one in segments()], from_sensor, True)
    for one, states in zip(segments(), together, strict=True):
        assert np.array_equal(states, replay_segment(fresh(), one, settings, from_sensor, True))


def test_each_segment_is_driven_with_its_own_settings() -> None:
    pairs = [(one, ALL[number % len(ALL)]) for number, one in enumerate(segments())]
    for (one, settings), states in zip(pairs, replay_segments(fresh(), pairs, False, True), strict=True):
        assert np.array_equal(states, replay_segment(fresh(), one, settings, False, True))


def test_what_slides_far_is_driven_alike() -> None:
    """Wheels beyond the small angles of the series and beyond the limit of their side force."""
    thrown = [wild(one) for one in segments()[:12]]
    together = replay_segments(fresh(), [(one, {}) for one in thrown], False, True)
    spins = np.concatenate([np.diff(states[:, ANGLE_COLUMN]) * 60.0 for states in together])
    assert np.abs(spins).max() > 1.0
    for one, states in zip(thrown, together, strict=True):
        assert np.array_equal(states, replay_segment(fresh(), one, {}, False, True))


def wild(segment: DriveSegment) -> DriveSegment:
    """The drive with wheels thrown from side to side, at six times the speed."""
    wheel = np.sign(np.sin(np.arange(len(segment.grids["wheel"])) / 40.0)) * 0.6
    speed = 6.0 * segment.grids["speed"]
    return replace(segment, grids=segment.grids | {"wheel": wheel, "command": wheel, "speed": speed})


def by_steps_of_planning(tractor: ReplayRig, segment: DriveSegment) -> Array:
    """Places and angles (n, 3) of a replay from the wheel angle, the body stepped as plans step it."""
    grids, model, ground = segment.grids, tractor.model[0], tractor.ground[0]
    speed, wheel = grids["speed"], grids["wheel"]
    zero = np.zeros(len(speed))
    bend, ahead, slide = np.empty(len(speed)), np.empty(len(speed)), zero.copy()
    compute_tangents_and_drift(
        speed, zero, zero, zero, zero, zero, wheel, 0.0, DT_S, tractor.table, model, bend, ahead, slide
    )
    x, y, angle, right, spin, out = *(float(grids[name][0]) for name in ("east", "north", "heading")), 0.0, 0.0, []
    for forward, tangent in zip(speed.tolist(), bend.tolist(), strict=True):
        out.append((x, y, angle))
        rolled = ground["rolling"] * model["mass"] * GRAVITY_MPS2 * forward / (abs(forward) + 0.05)
        x += (forward * math.cos(angle) + right * math.sin(angle)) * DT_S
        y += (forward * math.sin(angle) - right * math.cos(angle)) * DT_S
        angle -= spin * DT_S
        _, right, spin = step_body(forward, right, spin, tangent, rolled, DT_S, model, ground)
    return np.array(out)


@pytest.mark.parametrize("limit", [None, 0.3, math.pi])
@pytest.mark.parametrize("count", [1, 5])
def test_bodies_step_as_in_plans(limit: float | None, count: int) -> None:
    """Where wheels slip beyond the small angles of the series and no limit holds them, too; it differs by axle."""
    tractor = replace(fresh(), ground=rig().ground.copy())
    if limit is not None:
        tractor.ground["front_limit"], tractor.ground["rear_limit"] = limit, 0.6 * limit
    some = [wild(one) for one in segments()[:count]]
    for one, states in zip(some, replay_segments(tractor, [(one, {}) for one in some], True, True), strict=True):
        assert states[:, [X_COLUMN, Y_COLUMN, ANGLE_COLUMN]] == pytest.approx(
            by_steps_of_planning(tractor, one), abs=1e-7
        )
        assert np.array_equal(states, replay_segment(replace(tractor, cache=ReplayCache()), one, {}, True, True))


@pytest.mark.parametrize("shaped", [False, True])
def test_other_grounds_are_driven_alike(shaped: bool) -> None:
    """A friction curve is asked of one segment after another."""
    tractor = replace(fresh(), ground=rig().ground.copy())
    tractor.ground["front_slope"] *= 0.4
    tractor.ground["shaped"], tractor.ground["grip"] = float(shaped), 0.6
    together = replay_segments(tractor, [(one, BENT) for one in segments()], False, True)
    assert not np.array_equal(together[0], replay_segment(fresh(), segments()[0], BENT, False, True))
    for one, states in zip(segments(), together, strict=True):
        assert np.array_equal(states, replay_segment(replace(tractor, cache=ReplayCache()), one, BENT, False, True))


def test_reverse_a_measured_slope_and_a_single_step_are_driven_alike_and_what_is_no_number_stays_where_it_is() -> None:
    back, sloped, short, broken = (replace(one, run=90 + number) for number, one in enumerate(segments()[:4]))
    rows = {name: values[:1] for name, values in short.grids.items()}
    lost = broken.grids["speed"].copy()
    lost[40:] = np.nan
    some = [
        replace(back, gear=-1.0, grids=back.grids | {"speed": -back.grids["speed"]}),
        replace(sloped, grids=sloped.grids | {"across": np.sin(np.arange(len(sloped.grids["speed"])) / 30.0)}),
        replace(short, grids=rows), replace(broken, grids=broken.grids | {"speed": lost}), *segments()[4:7],
    ]  # fmt: skip
    drift: Settings = {"cross_slope_drift": {"ratio": 0.1, "bearing_deg": 40.0, "per_slope": 0.5}}
    together = replay_segments(fresh(), [(one, drift) for one in some], False, True)
    for one, states in zip(some, together, strict=True):
        assert np.array_equal(states, replay_segment(fresh(), one, drift, False, True), equal_nan=True)
    assert len(together[2]) == 1 and np.isfinite(together[-1]).all() and np.isnan(together[3][-1]).any()


@pytest.mark.parametrize("sensed", [False, True])
def test_wheel_angles_that_are_kept_are_of_the_type_of_measured_ones(sensed: bool) -> None:
    """Arrays that nobody may write to are another type, for which all that drives would be compiled once more."""
    tractor, (one,) = fresh(), segments()[:1]
    for asked in _build_requests(tractor, [(one, {}), (one, BENT)], sensed, True):
        _, turned = _compute_wheel_angles(tractor, asked, asked.acting_settings.model)
        assert turned.flags.writeable and turned.flags.c_contiguous
    assert not simulate_wheel_angles(tractor, [one], {})[0].flags.writeable


def test_what_is_asked_for_twice_at_once_takes_room_once() -> None:
    """Else room that nothing takes adds up, until nothing is kept any more."""
    one, other = segments()[:2]
    size = sum(states.nbytes for states in replay_segments(fresh(), [(one, {}), (other, {})], True, True))
    tractor = fresh(most_bytes=size)
    first, second, *_ = replay_segments(tractor, [(one, {}), (other, {}), (one, {}), (other, {})], True, True)
    assert (
        replay_segment(tractor, one, {}, True, True) is first
        and replay_segment(tractor, other, {}, True, True) is second
    )


def test_what_is_kept_of_one_segment_keeps_nothing_of_those_beside_it() -> None:
    tractor = fresh(most_bytes=3 * max(one.grids["speed"].nbytes for one in segments()) * 5)
    for number in range(4):
        offset = {"steering_offset": {"angle_deg": 0.1 * number}}
        states = replay_segments(tractor, [(one, offset) for one in segments()], False, True)
        assert all(one.base is None for one in states)


def test_what_was_kept_is_neither_driven_nor_changed() -> None:
    tractor, pairs = fresh(), [(one, BENT) for one in segments()]
    first = replay_segments(tractor, pairs[:5], False, True)
    again = replay_segments(tractor, pairs[3:9], False, True)
    assert again[0] is first[3] and again[1] is first[4]
    assert all(not one.flags.writeable for one in again)
    twice = replay_segments(fresh(), [pairs[0], pairs[0]], False, True)
    assert twice[0] is twice[1]


def test_speeds_are_the_measured_ones() -> None:
    for one, states in zip(
        segments(), replay_segments(fresh(), [(one, {}) for one in segments()], True, True), strict=True
    ):
        assert np.array_equal(states[:, FORWARD_COLUMN], one.grids["speed"])
        assert states[0, X_COLUMN] == one.grids["east"][0]


@pytest.mark.parametrize("settings", ALL)
@pytest.mark.parametrize(("most", "wider"), [(0.0, 1.0), (0.05, 1.0), (0.7, 1.0), (1.4, 1.0), (0.9, 1.6)])
def test_what_is_told_beforehand_is_what_steps_are_told(settings: Settings, most: float, wider: float) -> None:
    """The formulas of planning, step by step: straight wheels too, beyond full lock, and wheels that turn very far."""
    rng, steps, tractor = np.random.default_rng(8), 333, rig()
    turned, speed = most * rng.uniform(-1.0, 1.0, steps), rng.uniform(-1.0, 4.0, steps)
    turned[:5] = 0.0
    east, north, heading = rng.uniform(-20.0, 20.0, (3, steps))
    cosines, sines, working = np.cos(heading), np.sin(heading), np.round(rng.uniform(size=steps))
    downhill = rng.normal(0.0, 0.02, steps)
    model, table = tractor.get_effective_model(settings), wider * tractor.table
    bend, ahead, slide = np.empty(steps), np.empty(steps), downhill.copy()
    compute_tangents_and_drift(
        speed, working, east, north, cosines, sines, turned, 30.0, 0.1, table, model, bend, ahead, slide
    )
    for k in range(steps):
        here = (cosines[k], sines[k])
        asked = compute_affected_tangent(
            turned[k], speed[k], east[k], north[k], *here, 30.0 + k * 0.1, working[k], table, model
        )
        along, across = compute_ground_drift(turned[k], speed[k], *here, model)
        assert (bend[k], ahead[k]) == (asked, along)
        assert slide[k] == pytest.approx(across + abs(speed[k]) * downhill[k], abs=1e-15)
