"""A tractor as a pymunk body: mass, inertia, place, and the boxes that may touch others."""

from __future__ import annotations

import pymunk

from vehicle.compile import outline
from vehicle.tractor import Implement, Tractor

FRICTION = 0.5  # any value will do: plans in which tractors touch are reported as collisions


def make_body(
    space: pymunk.Space, tractor: Tractor, implement: Implement, pose: tuple[float, float, float]
) -> pymunk.Body:
    """A tractor body at its centre of mass, with contact boxes for tractor and implement."""
    body = pymunk.Body(tractor.mass_kg, tractor.inertia_kg_m2)
    body.position, body.angle = pose[:2], pose[2]
    boxes = outline(tractor, implement)
    shapes = [
        _box(body, boxes["tail"], boxes["nose"], boxes["half_width"]),
        _box(body, boxes["tool_tail"], boxes["tool_front"], boxes["tool_half_width"]),
    ]
    space.add(body, *shapes)
    return body


def _box(body: pymunk.Body, rear: float, front: float, half: float) -> pymunk.Poly:
    shape = pymunk.Poly(body, [(rear, -half), (front, -half), (front, half), (rear, half)])
    shape.friction = FRICTION
    return shape
