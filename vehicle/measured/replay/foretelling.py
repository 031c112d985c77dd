"""What a log at a measured speed tells of the steps to come: how far wheels bend the way, how the ground drifts.

The formulas are those of vehicle.terms, which plans are driven with, asked of many steps at a time: each loop does one
thing to all of them, without a branch, so that it is made of vectors. The answers are the same to the last bit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vehicle.jit import compiled, inlined
from vehicle.series import NEAR, near_tangent, tangent
from vehicle.steering import corrected_angle
from vehicle.terms import (
    SECANTS,
    STRAIGHT_RAD,
    down_slope,
    grip,
    lost_share,
    pushed_along,
    rest_angle,
    rest_grip,
    rest_trust,
    secant_step,
    unstrained_angle,
    within_slide,
    worked,
)


class _Numbers(NamedTuple):
    """What formulas ask of a model, as numbers: vectors are made of nothing else."""

    front: Any
    rear: Any
    lock: Any
    bend: Any
    bend_left: Any
    drift: Any
    patch: Any
    patch_east: Any
    patch_north: Any
    patch_radius: Any
    understeer: Any
    draft: Any
    slope_east: Any
    slope_north: Any
    offset: Any
    slide: Any


@inlined
def _numbers(model) -> Any:  # type: ignore[no-untyped-def]
    return _Numbers(
        model.front, model.rear, model.lock, model.bend, model.bend_left, model.drift, model.patch, model.patch_east,
        model.patch_north, model.patch_radius, model.understeer, model.draft, model.slope_east, model.slope_north,
        model.offset, model.slide,
    )  # fmt: skip


@compiled
def foretell(  # type: ignore[no-untyped-def]
    speed, working, east, north, cosines, sines, turned, start_s, dt, table, model, bend, ahead, slide
) -> None:
    """Of steps (n,) the tangent of affected_tangent, `bend`, and ground_drift, `ahead` and to `slide`.

    The columns are those of a stretch, `turned` its wheel angle behind the play. In `slide` stands the drift to the
    right (m/m) on a slope that was measured, to which that of the model is added.
    """
    rows, some = len(speed), _numbers(model)
    angle, extra = np.empty(rows), np.zeros(rows)
    for k in range(rows):
        angle[k] = turned[k] + some.offset
    for k in range(rows):
        ahead[k] = 0.0
    for k in range(rows):
        slide[k] = down_slope(speed[k], cosines[k], sines[k], some) + abs(speed[k]) * slide[k]
    if model.rest != 0.0:
        _rest(speed, working, cosines, sines, turned, model, angle, extra, ahead, slide)
    if np.abs(table).max() > NEAR:
        _bends_far(angle, bend, speed, table, model)
    else:
        _bends(angle, bend, speed, table, some)
    for k in range(rows):
        factor = grip(angle[k], east[k], north[k], start_s + k * dt, some)
        bend[k] = worked(bend[k] * factor, extra[k], working[k], some)
    if some.slide > 0.0:
        for k in range(rows):
            bend[k] = within_slide(bend[k], speed[k], some)


@compiled
def _rest(speed, working, cosines, sines, turned, model, angle, extra, ahead, slide) -> None:  # type: ignore[no-untyped-def]
    """What the rest adds to wheel angles, to the curvature and to the drift of the ground."""
    for k in range(len(speed)):
        trust = rest_trust(turned[k], speed[k], model)
        angle[k] += trust * rest_angle(speed[k], cosines[k], sines[k], model)
        extra[k] = trust * rest_grip(turned[k], speed[k], cosines[k], sines[k], working[k], model)
    if model.rest_push_to_east == 0.0 and model.rest_push_to_north == 0.0:
        return
    for k in range(len(speed)):
        ahead[k], right = pushed_along(turned[k], speed[k], cosines[k], sines[k], model)
        slide[k] += right


@inlined
def _bends(angle, bend, speed, table, some) -> None:  # type: ignore[no-untyped-def]
    """Tangents that wheel angles (n,) stand for, which get less by what is lost of them (unstrained_angle)."""
    rows = len(angle)
    if some.understeer != 0.0:
        left, lost = np.empty(rows), np.empty(rows)
        for k in range(rows):
            lost[k] = lost_share(speed[k], some)
        for k in range(rows):
            left[k] = _bent(angle[k])
        for _ in range(SECANTS):
            _tangents(left, bend, table, some.lock)
            for k in range(rows):
                left[k] = secant_step(_bent(angle[k]), left[k], bend[k], lost[k])
        for k in range(rows):
            angle[k] = angle[k] if abs(angle[k]) < STRAIGHT_RAD else left[k]
    _tangents(angle, bend, table, some.lock)


@inlined
def _tangents(angle, bend, table, lock) -> None:  # type: ignore[no-untyped-def]
    """Tangents of angles (n,) behind the table: what is looked up is no vector, so it has a loop of its own."""
    for k in range(len(angle)):
        bend[k] = corrected_angle(angle[k], table, lock)
    for k in range(len(angle)):
        bend[k] = near_tangent(bend[k])


@inlined
def _bent(angle: float) -> float:
    """The angle, or one that stands in for those that are as good as straight: nothing is divided by 0."""
    return angle if abs(angle) >= STRAIGHT_RAD else STRAIGHT_RAD


@compiled
def _bends_far(angle, bend, speed, table, model) -> None:  # type: ignore[no-untyped-def]
    """_bends with a table of which some angles are not near, one by one."""
    for k in range(len(angle)):
        if model.understeer != 0.0:
            angle[k] = unstrained_angle(angle[k], speed[k], table, model)
        bend[k] = tangent(corrected_angle(angle[k], table, model.lock))
