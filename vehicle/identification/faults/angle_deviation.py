"""How far a wheel angle is from the one that its command makes, wherever that angle is held.

A sensor on one knuckle of a steered axle reads more than the angle of the axle in bends to its own side and less in
bends to the other one; a crooked linkage bends the scale of a sensor as well. Such a deviation is a fixed function of
the angle, there in every run. That of a steering that breaks is there from a moment on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vehicle.identification.faults.steering_evidence import STEP_S, SteeringEvidence
from vehicle.identification.faults.thresholds import FAULT_JOIN_S, FAULT_TOLERANCE_DEG
from vehicle.identification.logs.schema import Array

_BIN_DEG = 3.0  # chosen: within it an Ackermann angle of 30 degrees deviates by a degree more
_LEAST_ELSEWHERE_S = 3.0  # chosen: the shortest time elsewhere at an angle that shows what is usual there
_ALIKE_SHARE = 0.8  # chosen: of the rows elsewhere; the others are wheels on their way to an angle


class AngleDeviations:
    """Wheel angle minus that of a usual steering (deg), by the latter, in all runs of a set."""

    def __init__(self, segments: Sequence[SteeringEvidence]) -> None:
        self._starts: dict[int, int] = {}
        usual, deviation, count = [np.zeros(0)], [np.zeros(0)], 0
        for segment in segments:
            if segment.wheel is not None and segment.command is not None:
                self._starts[id(segment)] = count
                usual.append(segment.usual)
                deviation.append(segment.wheel - segment.usual)
                count += len(segment.usual)
        self._bins = np.round(np.concatenate(usual) / _BIN_DEG)
        self._deviation = np.concatenate(deviation)

    def compute_elsewhere(self, segment: SteeringEvidence, first: int, last: int) -> Array:
        """Return the deviation (k, deg) that rows `first` to `last` of a segment have where their angle is held
        elsewhere; 0 where it is not, or not always with the same one."""
        start = self._starts[id(segment)]
        reach = round(FAULT_JOIN_S / STEP_S)
        others = np.ones(len(self._bins), dtype=np.bool_)
        # The rows about a span may be of its fault still.
        others[start + max(first - reach, 0) : start + min(last + reach + 1, len(segment.usual))] = False
        bins = self._bins[start + first : start + last + 1]
        usual = np.zeros(len(bins))
        for one in np.unique(bins):
            elsewhere = self._deviation[others & (self._bins == one)]
            if len(elsewhere) * STEP_S < _LEAST_ELSEWHERE_S:
                continue
            middle = float(np.median(elsewhere))
            if float(np.mean(np.abs(elsewhere - middle) < FAULT_TOLERANCE_DEG)) >= _ALIKE_SHARE:
                usual[bins == one] = middle
        return usual
