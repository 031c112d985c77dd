"""Split field: a block of neighbouring tracks for each tractor."""

from __future__ import annotations

from fields.layout import Track
from strategies.job import Job
from strategies.legs import mission_of
from strategies.record import Strategy
from strategies.separate import lines_of, plan_of
from strategies.sequence import best_orders
from vehicle.missions import Plan

NAME = "split-field"


def split_field(job: Job) -> Plan:
    """One block of neighbouring lines per tractor, blocks of equal working time; all start at once.

    Within a block the order that is quickest by simulated turns is taken, or the pattern of `job.jump` (1: one after
    another).
    """
    return plan_of(job, NAME, (mission_of(job, order) for order in best_orders(blocks(job), job, job.jump)))


def blocks(job: Job) -> list[list[Track]]:
    """Contiguous lines shared out so that the longest block is as short as possible with one cut per tractor."""
    lines = lines_of(job)
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


STRATEGY = Strategy(NAME, "one block of neighbouring tracks per tractor", split_field, takes_jump=True)
