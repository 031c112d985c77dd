"""A run in figures."""

from __future__ import annotations

import numpy as np

from planner.works.metres import STANDING_MPS
from planner.works.phases import GAP_S, Phases, phases
from planner.works.record import ACTIVE_M, AREA_M2, FUEL_L, INACTIVE_M, Array, Driven
from reports.work_results import KINDS, Figures

MOVING_MPS = 0.2  # slower rows say nothing of the speed somebody works at
APART = 0.03
"""Counters and positions that differ by more than this are worth a remark."""


def summary(run: Driven, done: Phases | None = None) -> Figures:
    """The figures of a run; `done` where its phases are known already."""
    done = done or phases(run)
    lasts, steps = np.diff(run.time_s), np.hypot(*np.diff(run.xy, axis=0).T)
    by_kind = {kind: float(lasts[done.kinds == place].sum()) for place, kind in enumerate(KINDS)}
    known, counted = run.works_known, run.counters
    works = run.works[:-1]
    moves = (run.speed_mps[:-1] >= STANDING_MPS) | (lasts > GAP_S)  # positions wander while a machine stands
    active, inactive = (float(steps[rows & moves].sum()) if known else None for rows in (works, ~works))
    total = counted[ACTIVE_M] + counted[INACTIVE_M] if {ACTIVE_M, INACTIVE_M} <= counted.keys() else None
    plain = [turn for turn in done.turns if not turn.standing_s]
    us = [turn.seconds for turn in done.turns if turn.is_u]
    area = counted.get(AREA_M2)
    if area is None and run.width_m and active is not None:
        area = active * run.width_m
    return Figures(
        seconds=float(run.time_s[-1]),
        by_kind_s=by_kind,
        active_m=counted.get(ACTIVE_M, active),
        inactive_m=counted.get(INACTIVE_M, inactive),
        counted_m=total,
        placed_m=float(steps[moves].sum()),
        area_m2=area,
        area_counted=AREA_M2 in counted,
        lifts=done.lifts if known else None,
        turns=len(done.turns) if known else None,
        u_turns=len(us) if known else None,
        u_turn_s=float(np.median(us)) if us else None,
        stops=len(done.stops_s),
        stops_s=float(done.stops_s.sum()),
        working_mps=_median(run.speed_mps[run.works & (run.speed_mps > MOVING_MPS)]),
        turning_mps=sum(one.length_m for one in plain) / sum(one.seconds for one in plain) if plain else None,
        fuel_l=counted.get(FUEL_L),
        width_m=run.width_m,
        rows=len(run.time_s),
    )


def remarks(run: Driven, told: Figures) -> list[str]:
    """What does not go together in a run, one part of a sentence each."""
    found = list(run.notes)
    if told.counted_m and abs(told.placed_m / told.counted_m - 1.0) > APART:
        found.append(
            f"positions make {told.placed_m / 1e3:.2f} km and the machine counted {told.counted_m / 1e3:.2f} km; the "
            "counted length is used"
        )
    if run.outline is not None and run.outline_m2 and abs(run.outline.area / run.outline_m2 - 1.0) > APART:
        found.append(
            f"the outline of the field measures {run.outline.area / 1e4:.2f} ha and its file says "
            f"{run.outline_m2 / 1e4:.2f} ha"
        )
    return found


def _median(values: Array) -> float | None:
    return float(np.median(values)) if len(values) else None
