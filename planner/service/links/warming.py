"""What is compiled on first use, used once."""

from __future__ import annotations

import numpy as np

from vehicle.approach import approaches, distances
from vehicle.compile import compile_model
from vehicle.speed import follower_speed
from vehicle.tractor import Implement, load_tractor
from vehicle.twin.twin import Fix, Twin

USUAL = "eg105"


def warm() -> None:
    """Load, or the first time compile, the functions of twins and of the guard: a minute then, else a second."""
    tractor, implement = load_tractor(USUAL), Implement()
    for way in ("predict", "thesis"):
        twin = Twin(tractor, implement, Fix(0.0, 0.0, 0.0, 0.0, 1.0, 0.0), way=way)
        twin.command(0.1, 0.1, 1.0)
        for second in (1, 2, 3):
            twin.measured(Fix(second - 0.3, 1.0 * second, 0.0, 0.0, 1.0, float(second)))
            twin.advance(second + 0.1)
        twin.doubt()
    poses = np.zeros((2, 2, 3))
    model = np.array([compile_model(tractor, implement)])
    approaches(poses, np.array([True, True]), model, 0.5, 0.5)
    distances(poses[0], poses[1], model)
    follower_speed(1.0, 1.0, 1.0)
