"""Windows of a drive: the parts of one run that take turns in telling a model and in being simulated with it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vehicle.measured.logs.record import Array

WINDOW_S = 20.0  # the longest horizon, so that no piece of an error lies in two windows
Numbers = npt.NDArray[np.int64]


def window_of(seconds: Array) -> Numbers:
    """Window, counted from 0, that times since the start of a stretch belong to."""
    return (seconds / WINDOW_S).astype(np.int64)


def half_of(seconds: Array) -> Numbers:
    """Half (0 or 1) that times since the start of a stretch belong to: its windows in turn."""
    return window_of(seconds) % 2
