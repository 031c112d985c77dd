"""Outlines of machines on the field, and whether a path leads away from one."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely
import shapely.affinity

from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.compile import list_contact_boxes

Array = npt.NDArray[np.float64]
ROUNDING_M = 0.01  # rounding, of distances that must not become smaller
PREDICTION_ERROR_M = 0.15  # of poses predicted along legs


def build_footprint(tractor: Tractor, implement: Implement) -> shapely.MultiPolygon:
    """Outlines of tractor and implement, the centre of mass at the origin, forward along x."""
    boxes = list_contact_boxes(tractor, implement)
    return shapely.MultiPolygon([shapely.box(rear, -half, front, half) for rear, front, half in boxes])


def is_leading_away(path: Array, place: Array, distances_m: Array, least_m: float) -> bool:
    """Whether a path (steps, 3) leads away to `least_m` from a machine at `place`, and not back; judged by the
    distances (steps,) of the outlines, and by the distance of the centres until then."""
    far_steps = np.flatnonzero(distances_m >= least_m)
    far_step = int(far_steps[0]) + 1 if len(far_steps) else len(distances_m)
    centre_distances_m = np.hypot(*(path[:far_step, :2] - place[:2]).T)
    if (np.maximum.accumulate(centre_distances_m) - centre_distances_m).max() > PREDICTION_ERROR_M:
        return False
    return bool(
        (distances_m >= min(distances_m[0] - ROUNDING_M, least_m)).all() and (distances_m[far_step:] >= least_m).all()
    )


def place_outline(boxes: shapely.MultiPolygon, pose: Array) -> shapely.Geometry:
    """The outline of a machine, `boxes` as of `build_footprint`, at x, y (m) and heading (mathematical, rad)."""
    x, y, heading = pose.tolist()
    cos, sin = math.cos(heading), math.sin(heading)
    return shapely.unary_union(shapely.affinity.affine_transform(boxes, [cos, -sin, sin, cos, x, y]))
