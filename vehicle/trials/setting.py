"""The tractor as the experiments of chapters 3 and 4 drive it: the plain Eq. 2.5 and the controlled point.

One setting for all of them. The controlled point is not printed; 0.6 m behind the centre of mass is what brings
Tables 3.3 and 4.3 nearest. Plans limit the lateral error of Eq. 2.5; the experiments do not, as the thesis did not.
"""

from __future__ import annotations

from vehicle.tractor import Tractor
from vehicle.trials.drive import with_steering

CONTROLLED_M = -0.6
UNLIMITED_M = 1000.0
STEP_LOOKAHEAD_M, WAVE_LOOKAHEAD_M, SLIP_LOOKAHEAD_M = 5.0, 5.0, 1.8


def as_tested(
    tractor: Tractor, steering: str = "proposed", *, lookahead_m: float = STEP_LOOKAHEAD_M,
    limit_m: float = UNLIMITED_M, point_m: float = CONTROLLED_M,
) -> Tractor:  # fmt: skip
    """The tractor with a steering simulator, a lookahead, a limit of the lateral error and a controlled point."""
    guidance = tractor.guidance.model_copy(update={"lookahead_m": lookahead_m, "lateral_limit_m": limit_m})
    changes = {"guidance": guidance, "antenna_forward_m": tractor.rear_axle_m + point_m}
    return with_steering(tractor.model_copy(update=changes), steering)
