"""Which rows of a log can be used: one rule after another, each with its count and first line."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
import numpy.typing as npt

from vehicle.measured.logs.record import Array, Gated, Mask

FASTEST_MPS = 20.0  # 72 km/h: no tractor drives faster
JUMP_SLACK_M = 0.5  # noise of two positions, on top of what was driven
STANDSTILL_MPS = 0.1  # a speed sensor's noise about zero; larger negative speeds are a direction
LOCK_DEG = 90.0  # no wheel turns further: what does is no angle
MOST_HEADING_DEG = 720.0  # two turns, as of a counter that goes on
SPIKE_DEG = 60.0  # no tractor yaws so far and back between two rows
GAP_SAMPLES = 5.0  # half a second of the usual 10 Hz, in which a straight line stands in for the path
FIRST_ROW_LINE = 2  # after the header
_OPEN_CHAINS = 8  # places a receiver may jump between before the shortest chain is given up


class RowRules:
    """Rows still in use, and the rules that took the others out."""

    def __init__(self, rows: int) -> None:
        """Start with every row in use."""
        self.used: Mask = np.ones(rows, dtype=np.bool_)
        self.gated: list[Gated] = []

    def take_out(self, rule: str, bad: Mask) -> None:
        """Take the `bad` rows out, counting only those that were still in use."""
        rows = np.flatnonzero(bad & self.used)
        if len(rows):
            self.gated.append(Gated(rule, len(rows), int(rows[0]) + FIRST_ROW_LINE))
            self.used[rows] = False


def gate_rows(columns: dict[str, Array]) -> RowRules:
    """Apply every rule to the columns (units of the contract); roll and pitch take no row out: others stand in."""
    rules = RowRules(len(columns["time_s"]))
    rules.take_out("time missing or not a number", ~np.isfinite(columns["time_s"]))
    east, north = columns["easting_m"], columns["northing_m"]
    rules.take_out("position missing or not a number", ~(np.isfinite(east) & np.isfinite(north)))
    _apply(rules, "time not increasing", outside_longest_increase(columns["time_s"][rules.used]))
    rows = rules.used
    jumping = jumps(columns["time_s"][rows], east[rows], north[rows])
    _apply(rules, f"position jumps faster than {FASTEST_MPS:g} m/s", jumping)
    for name in ("heading_deg", "steering_command_deg", "steering_deg"):
        if name in columns:
            rules.take_out(f"{name} missing or not a number", ~np.isfinite(columns[name]))
    _gate_headings(rules, columns)
    for name in ("speed_mps", "speed_command_mps"):
        if name in columns:
            rules.take_out(f"{name} missing or not a number", ~np.isfinite(columns[name]))
            rules.take_out(f"{name} below 0 (the direction belongs in shuttle)", columns[name] < -STANDSTILL_MPS)
            rules.take_out(f"{name} above {FASTEST_MPS:g} m/s", columns[name] > FASTEST_MPS)
    _gate_ranges(rules, columns)
    return rules


def _gate_headings(rules: RowRules, columns: dict[str, Array]) -> None:
    """Headings that are no angle, and single ones that stand far out of their neighbours."""
    if "heading_deg" not in columns:
        return
    heading = columns["heading_deg"]
    rules.take_out(f"heading_deg beyond {MOST_HEADING_DEG:g} deg", np.abs(heading) > MOST_HEADING_DEG)
    rows = np.flatnonzero(rules.used)
    if len(rows) >= 3:
        step = (np.diff(heading[rows]) + 180.0) % 360.0 - 180.0
        alone = (np.abs(step[:-1]) > SPIKE_DEG) & (np.abs(step[1:]) > SPIKE_DEG) & (step[:-1] * step[1:] < 0.0)
        _apply(rules, f"heading_deg more than {SPIKE_DEG:g} deg off the rows about it", np.pad(alone, 1))


def _gate_ranges(rules: RowRules, columns: dict[str, Array]) -> None:
    for name in ("steering_command_deg", "steering_deg"):
        if name in columns:
            rules.take_out(f"{name} beyond {LOCK_DEG:g} deg", np.abs(columns[name]) > LOCK_DEG)
    if "implement" in columns:
        rules.take_out("implement neither 0 nor 1", ~np.isin(columns["implement"], (0.0, 1.0)))
    if "shuttle" in columns:
        rules.take_out("shuttle not -1, 0 or 1", ~np.isin(columns["shuttle"], (-1.0, 0.0, 1.0)))
        rules.take_out("shuttle in neutral", columns["shuttle"] == 0.0)


def _apply(rules: RowRules, rule: str, bad_of_used: Mask) -> None:
    """Take rows out by a mask over the rows in use."""
    bad = np.zeros(len(rules.used), dtype=np.bool_)
    bad[np.flatnonzero(rules.used)[bad_of_used]] = True
    rules.take_out(rule, bad)


def outside_longest_increase(values: Array) -> Mask:
    """Entries that are not in one longest strictly increasing subsequence (patience sorting)."""
    bad = np.ones(len(values), dtype=np.bool_)
    if len(values) == 0 or bool((np.diff(values) > 0.0).all()):
        return ~bad
    tails: list[float] = []
    at: list[int] = []
    before = np.full(len(values), -1)
    for row, value in enumerate(values.tolist()):
        place = bisect_left(tails, value)
        before[row] = at[place - 1] if place else -1
        if place == len(tails):
            tails.append(value)
            at.append(row)
        else:
            tails[place], at[place] = value, row
    row = at[-1]
    while row >= 0:
        bad[row] = False
        row = int(before[row])
    return bad


def jumps(time: Array, east: Array, north: Array) -> Mask:
    """Positions that cannot be reached from the bulk of the others.

    Rows are strung into chains of reachable positions; the longest chain is kept.
    """
    if len(time) < 2 or bool(_reachable(np.diff(time), np.diff(east), np.diff(north)).all()):
        return np.zeros(len(time), dtype=np.bool_)
    chains: list[list[int]] = []
    for row in range(len(time)):
        for chain in chains:
            last = chain[-1]
            if _reachable(time[row] - time[last], east[row] - east[last], north[row] - north[last]):
                chain.append(row)
                break
        else:
            chains.append([row])
            if len(chains) > _OPEN_CHAINS:
                chains.remove(min(chains[:-1], key=len))
        chains.sort(key=len, reverse=True)
    bad = np.ones(len(time), dtype=np.bool_)
    bad[chains[0]] = False
    return bad


def _reachable(seconds: Array, east: Array, north: Array) -> Mask:
    reach: Mask = np.hypot(east, north) <= FASTEST_MPS * seconds + JUMP_SLACK_M
    return reach


def segments(time: Array, used: Mask) -> npt.NDArray[np.int64]:
    """Number of the stretch each used row is in, a new one after a gap of more than GAP_SAMPLES steps; else -1."""
    out = np.full(len(time), -1, dtype=np.int64)
    steps = np.diff(time[used])
    if len(steps):
        out[used] = np.concatenate([[0], np.cumsum(steps > (GAP_SAMPLES + 0.5) * np.median(steps))])
    elif used.any():
        out[used] = 0
    return out
