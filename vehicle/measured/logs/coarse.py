"""Columns in steps too coarse to tell anything from: whole kilometres per hour, compass points, degrees of 5 digits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vehicle.measured.errors import LogError
from vehicle.measured.logs.held import DIGITS
from vehicle.measured.logs.record import Array, Log

POSITION_M = 0.25  # chosen: beyond it no bend within 5 s is seen, the piece that errors are compared over
HEADING_DEG = (1.5, 45.0)  # chosen: good positions tell the course over 5 s to less; beyond are directions of a field
SPEED_SHARE = 0.1  # chosen, of the median speed: the positions tell the speed over some seconds to less
_UNEVEN = 20  # chosen, times that a column goes on by other steps than before: a tractor starts and stops less often
_OFF = 0.02  # of a step, that values may lie beside it
_UNITS = {"heading_deg": "degrees", "speed_mps": "m/s"}


def without_coarse(log: Log) -> Log:
    """The log without a heading or a speed in coarse steps; `doubts` and `coarse` say which.

    Raises LogError for coarse positions.
    """
    for name in ("easting_m", "northing_m"):
        step = step_of(_values(log, name))
        if step > POSITION_M:
            raise LogError(
                f"{log.name}: {name} comes in steps of {step:.2g} m, too coarse to tell how a tractor steers; log "
                "positions with more digits, to 0.01 m or better."
            )
    if log.heading_deg is not None:
        step = step_of(_values(log, "heading_deg"))
        if HEADING_DEG[0] < step <= HEADING_DEG[1]:
            log = _without(log, "heading_deg", step)
    if log.speed_mps is not None:
        moving = log.speed_mps[log.used & (log.speed_mps > 0.0)]
        # Of those alone: a tractor that starts and stops at once has steps of its speed.
        step = step_of(moving)
        if len(moving) and step > SPEED_SHARE * float(np.median(moving)):
            log = _without(log, "speed_mps", step)
    return log


def without_coarse_together(logs: Sequence[Log]) -> list[Log]:
    """Logs of a set, without columns of the same instrument that came in coarse steps in another log."""
    coarse = {name: (step, log.name) for log in logs for name, step in log.coarse.items()}
    out = list(logs)
    for name, (step, other) in coarse.items():
        for place, log in enumerate(out):
            if getattr(log, name) is not None and _in_steps(_values(log, name), step):
                out[place] = _without(log, name, step, f", as in {other}")
    return out


def _values(log: Log, name: str) -> Array:
    """The values measured of a column."""
    rows = log.used if log.fresh is None or name == "speed_mps" else log.used & log.fresh
    values: Array = getattr(log, name)[rows]
    return values


def _without(log: Log, name: str, step: float, where: str = "") -> Log:
    said = f"{name} comes in steps of {step:.2g} {_UNITS[name]}{where}, too coarse to tell anything"
    changed: dict[str, Any] = {name: None}
    doubts = (*log.doubts, f"{said}; it counts as not logged")
    return replace(log, doubts=doubts, coarse={**log.coarse, name: step}, **changed)


def step_of(values: Array) -> float:
    """The step that values (k,), row by row, are rounded to; 0 where there is none.

    All are multiples of it but for one shift, and they go on by different numbers of steps: those that always go on by
    one are of an even motion, whose step is no instrument's.
    """
    apart = np.diff(np.unique(np.round(values, DIGITS)))
    if not len(apart):
        return 0.0
    step = float(apart.min())
    if not _in_steps(values, step):
        return 0.0
    uneven = np.count_nonzero(np.diff(np.round(np.diff(values) / step)))
    return step if uneven >= _UNEVEN else 0.0


def _in_steps(values: Array, step: float) -> bool:
    """Whether values (k,) lie a whole number of steps apart; one value alone does."""
    steps = np.diff(np.unique(np.round(values, DIGITS))) / step
    return bool((np.abs(steps - np.round(steps)) < _OFF).all())
