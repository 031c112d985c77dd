"""A tractor as a pymunk body: mass, inertia and place, and the boxes that may touch others.

Boxes cost time in every step, so they are in the space only where tractors are near each other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pymunk

from vehicle.compile import outline
from vehicle.tractor import Implement, Tractor

FEWEST_ITERATIONS = 1  # of the solver of contacts: each costs time in every step, also where there are none
FRICTION = 0.5  # any value will do: plans in which tractors touch are reported as collisions


def new_space() -> pymunk.Space:
    """A space without boxes, in which nothing can touch and nothing has to be solved."""
    space = pymunk.Space()
    space.iterations = FEWEST_ITERATIONS
    return space


def make_body(space: pymunk.Space, tractor: Tractor, pose: tuple[float, float, float]) -> pymunk.Body:
    """A tractor body at its centre of mass, without contact boxes."""
    body = pymunk.Body(tractor.mass_kg, tractor.inertia_kg_m2)
    body.position, body.angle = pose[:2], pose[2]
    space.add(body)
    return body


class ContactBoxes:
    """The boxes of tractor and implement of every body: which are in the space, and which ought to be.

    `near` (n,) tells whose boxes are in the space, `wanted` (n,) whose should be; the compiled loop writes `wanted`
    and `bring` makes it so.
    """

    def __init__(
        self, space: pymunk.Space, bodies: list[pymunk.Body], tractor: Tractor, implement: Implement
    ) -> None:
        boxes = outline(tractor, implement)
        tractor_box = _corners(boxes["tail"], boxes["nose"], boxes["half_width"])
        tool_box = _corners(boxes["tool_tail"], boxes["tool_front"], boxes["tool_half_width"])
        self._space = space
        self._iterations = pymunk.Space().iterations
        self._shapes = [(_shape(body, tractor_box), _shape(body, tool_box)) for body in bodies]
        self.near: npt.NDArray[np.bool_] = np.zeros(len(bodies), dtype=np.bool_)
        self.wanted: npt.NDArray[np.bool_] = np.zeros(len(bodies), dtype=np.bool_)

    def bring(self) -> None:
        """Put the boxes that are wanted into the space and take the others out."""
        for index in np.flatnonzero(self.near != self.wanted):
            change = self._space.add if self.wanted[index] else self._space.remove
            change(*self._shapes[index])
        self.near[:] = self.wanted
        self._space.iterations = self._iterations if self.near.any() else FEWEST_ITERATIONS

    def bring_all(self) -> None:
        """Put the boxes of every tractor into the space."""
        self.wanted[:] = True
        self.bring()


def _corners(rear: float, front: float, half: float) -> list[tuple[float, float]]:
    return [(rear, -half), (front, -half), (front, half), (rear, half)]


def _shape(body: pymunk.Body, corners: list[tuple[float, float]]) -> pymunk.Poly:
    shape = pymunk.Poly(body, corners)
    shape.friction = FRICTION
    return shape
