"""Which rows of a log can be used: rules applied in turn, each with its row count and first line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.logs.schema import STEERING_COLUMNS, GatedRows, find_file_line
from vehicle.identification.logs.series import find_decreasing_entries, wrap_degrees
from vehicle.identification.logs.thresholds import JUMP_M, STANDSTILL_MPS, TURNED_DEG

FASTEST_MPS = 20.0  # 72 km/h: no tractor drives faster
MOST_STEERING_DEG = 90.0  # no wheel turns further
MOST_HEADING_DEG = 720.0  # two turns, for sensors that count on beyond 360
SPIKE_DEG = 2.0 * TURNED_DEG  # no tractor yaws this far and back between two rows
_MOST_OPEN_CHAINS = 8  # positions a receiver may jump between before the shortest chain is dropped


def gate_rows(
    columns: dict[str, Floats], faults: Mapping[str, Integers] | None = None
) -> tuple[Flags, list[GatedRows]]:
    """Apply every rule to columns (units of the contract), `faults` (rules with rows) first; none of roll and pitch.

    Returns the rows still in use, and the rules that excluded the others.
    """
    used, gated = np.ones(len(columns["time_s"]), dtype=np.bool_), list[GatedRows]()

    def exclude_used_rows(rule: str, bad_of_used: Flags) -> None:
        """Exclude rows by a mask over the rows in use."""
        rows = np.flatnonzero(used)[bad_of_used]
        if len(rows):
            gated.append(GatedRows(rule, len(rows), find_file_line(rows)))
            used[rows] = False

    def exclude_rows(rule: str, bad: Flags) -> None:
        """Exclude the `bad` rows and count those that were still in use."""
        exclude_used_rows(rule, bad[used])

    for rule, fault_rows in (faults or {}).items():
        exclude_rows(rule, np.isin(np.arange(len(used)), fault_rows))
    exclude_rows("time missing or not a number", ~np.isfinite(columns["time_s"]))
    east, north = columns["easting_m"], columns["northing_m"]
    exclude_rows("position missing or not a number", ~(np.isfinite(east) & np.isfinite(north)))
    # The fewest rows without which time increases; where those are many before a jump back, its line is told.
    timed = np.flatnonzero(used)
    bad = find_decreasing_entries(columns["time_s"][timed])
    exclude_used_rows("time not increasing", bad)
    if bad.any():
        back = int(np.flatnonzero(np.diff(columns["time_s"][timed]) <= 0.0)[0]) + 1
        if back > int(np.argmax(bad)) + 1:
            gated[-1] = replace(gated[-1], first_line=find_file_line(timed[back:]))
    jumping = find_jumps(columns["time_s"][used], east[used], north[used])
    exclude_used_rows(f"position jumps faster than {FASTEST_MPS:g} m/s", jumping)
    for name in ("heading_deg", *STEERING_COLUMNS):
        if name in columns:
            exclude_rows(f"{name} missing or not a number", ~np.isfinite(columns[name]))
    if "heading_deg" in columns:
        heading = columns["heading_deg"]
        exclude_rows(f"heading_deg beyond {MOST_HEADING_DEG:g} deg", np.abs(heading) > MOST_HEADING_DEG)
        step = wrap_degrees(np.diff(heading[used]))
        if len(step) >= 2:
            alone = (np.abs(step[:-1]) > SPIKE_DEG) & (np.abs(step[1:]) > SPIKE_DEG) & (step[:-1] * step[1:] < 0.0)
            rule = f"heading_deg differs by more than {SPIKE_DEG:g} deg from the rows before and after"
            exclude_used_rows(rule, np.pad(alone, 1))
    for name in ("speed_mps", "speed_command_mps"):
        if name in columns:
            exclude_rows(f"{name} missing or not a number", ~np.isfinite(columns[name]))
            exclude_rows(f"{name} below 0 (the direction belongs in shuttle)", columns[name] < -STANDSTILL_MPS)
            exclude_rows(f"{name} above {FASTEST_MPS:g} m/s", columns[name] > FASTEST_MPS)
    for name in STEERING_COLUMNS:
        if name in columns:
            exclude_rows(f"{name} beyond {MOST_STEERING_DEG:g} deg", np.abs(columns[name]) > MOST_STEERING_DEG)
    if "implement" in columns:
        exclude_rows("implement neither 0 nor 1", ~np.isin(columns["implement"], (0.0, 1.0)))
    if "shuttle" in columns:
        exclude_rows("shuttle not -1, 0 or 1", ~np.isin(columns["shuttle"], (-1.0, 0.0, 1.0)))
        exclude_rows("shuttle in neutral", columns["shuttle"] == 0.0)
    return used, gated


def find_jumps(time: Floats, east: Floats, north: Floats) -> Flags:
    """Mark the positions that cannot be reached from most others: those outside the longest chain of reachable ones."""
    if len(time) < 2 or bool(_is_reachable(np.diff(time), np.diff(east), np.diff(north)).all()):
        return np.zeros(len(time), dtype=np.bool_)
    chains: list[list[int]] = []
    for row in range(len(time)):
        for chain in chains:
            last = chain[-1]
            if _is_reachable(time[row] - time[last], east[row] - east[last], north[row] - north[last]):
                chain.append(row)
                break
        else:
            chains.append([row])
            if len(chains) > _MOST_OPEN_CHAINS:
                chains.remove(min(chains[:-1], key=len))
        chains.sort(key=len, reverse=True)
    bad = np.ones(len(time), dtype=np.bool_)
    bad[chains[0]] = False
    return bad


def _is_reachable(seconds: Floats, east: Floats, north: Floats) -> Flags:
    return np.asarray(np.hypot(east, north) <= FASTEST_MPS * seconds + JUMP_M)
