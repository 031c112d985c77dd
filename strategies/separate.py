"""Strategies without formation: every tractor has its own tracks."""

from __future__ import annotations

from dataclasses import replace

from fields.layout import Track
from strategies.errors import StrategyError
from strategies.job import Job
from strategies.legs import mission_of
from strategies.sequence import best_orders
from vehicle.missions import Gate, Mission, Plan


def split_field(job: Job, jump: int | None = None) -> Plan:
    """One block of neighbouring lines per tractor, blocks of equal working time; all start at once.

    Within a block the order that is quickest by simulated turns is taken, or the pattern of `jump` (1: one after
    another).
    """
    return _plan(job, "split-field", [mission_of(job, order) for order in best_orders(blocks(job), job, jump)])


def blocks(job: Job) -> list[list[Track]]:
    """Contiguous lines shared out so that the longest block is as short as possible with one cut per tractor."""
    lines = _lines(job)
    weight = [sum(t.length + job.manner.turn_s[1] * job.manner.work_speed_mps for t in line) for line in lines]
    low, high = max(weight), sum(weight)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if len(_cut(weight, middle)) <= job.tractors else (middle, high)
    cuts = _spread(_cut(weight, high), job.tractors)
    shares: list[list[Track]] = []
    first = 0
    for size in cuts:
        shares.append([track for line in lines[first : first + size] for track in line])
        first += size
    return shares


def _lines(job: Job) -> list[list[Track]]:
    by_line: dict[int, list[Track]] = {}
    for track in job.layout.tracks:
        by_line.setdefault(track.line, []).append(track)
    lines = [by_line[line] for line in sorted(by_line)]
    if len(lines) < job.tractors:
        raise StrategyError(
            f"{job.tractors} tractors are more than the {len(lines)} tracks of the field; use {len(lines)} or fewer."
        )
    return lines


def _cut(weight: list[float], most: float) -> list[int]:
    """Sizes of the fewest runs of lines none of which weighs more than `most`."""
    sizes, total = [0], 0.0
    for each in weight:
        if sizes[-1] and total + each > most * (1 + 1e-12):
            sizes.append(0)
            total = 0.0
        sizes[-1] += 1
        total += each
    return sizes


def _spread(sizes: list[int], count: int) -> list[int]:
    """Split the largest runs until there is one for every tractor."""
    sizes = list(sizes)
    while len(sizes) < count:
        largest = max(range(len(sizes)), key=lambda i: sizes[i])
        half = sizes[largest] // 2
        sizes[largest : largest + 1] = [sizes[largest] - half, half]
    return sizes


def interleaved(job: Job) -> Plan:
    """Tractors take every n-th line; each starts when the one before it is well under way."""
    lines = _lines(job)
    shares = [[track for line in lines[i :: job.tractors] for track in line] for i in range(job.tractors)]
    missions = [mission_of(job, order) for order in best_orders(shares, job, only_jump=1)]
    return _plan(job, "interleaved", _staggered(missions, job.manner.stagger_m))


def _staggered(missions: list[Mission], distance_m: float) -> list[Mission]:
    """Hold each tractor until the one before it has driven `distance_m` of its first working leg."""
    held = missions[:1]
    for number, mission in enumerate(missions[1:], start=1):
        before = missions[number - 1].legs[1]
        gate = Gate(number - 1, 1, min(distance_m, before.length_m))
        held.append(replace(mission, legs=(mission.legs[0].with_gates([gate]), *mission.legs[1:])))
    return held


def _plan(job: Job, name: str, missions: list[Mission]) -> Plan:
    return Plan(tuple(missions), {"strategy": name, "tractors": job.tractors})
