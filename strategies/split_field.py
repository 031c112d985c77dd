"""Split field: a block of neighbouring tracks for each tractor."""

from __future__ import annotations

from itertools import pairwise

from fields.layout import Track
from strategies.job import Job
from strategies.legs import mission_of
from strategies.orders.sequence import Searched, patterned, searched
from strategies.orders.shares import balanced, cut
from strategies.orders.table import TurnTable
from strategies.record import Strategy
from strategies.refilling.tracks import searched_in_loads
from strategies.separate import lines_of, mission_in, plan_of
from vehicle.missions import Plan

NAME = "split-field"


def split_field(job: Job) -> Plan:
    """One block of neighbouring lines per tractor, each in its quickest order; all start at once.

    Blocks are balanced by these orders. With `job.jump` every block takes that pattern (1: one after another), and
    blocks are of equal working time.
    """
    lines = lines_of(job)
    borders = cut([_weight(job, line) for line in lines], job.tractors)
    if job.jump is not None:
        orders = patterned([_tracks(lines, *ends) for ends in pairwise(borders)], job, job.jump)
        return plan_of(job, NAME, (mission_of(job, order) for order in orders))
    shares = _quickest(job, lines, borders)
    missions = (mission_in(job, number, share.order) for number, share in enumerate(shares))
    if job.turned:  # the other way round an order takes a little more or less, and how good it is is not known
        return plan_of(job, NAME, missions)
    gap = max(share.gap_pct for share in shares)
    return plan_of(job, NAME, missions, order_gap_pct=round(gap, 3))


def _quickest(job: Job, lines: list[list[Track]], borders: list[int]) -> list[Searched]:
    """The blocks of all tractors in their quickest orders, balanced by these; worked out once for a site."""
    key = job.tractors, tuple(job.layout.tracks)
    if key not in job.blocks:
        job.blocks[key] = _balanced_blocks(job, lines, borders)
    return job.blocks[key]  # type: ignore[no-any-return]


def _balanced_blocks(job: Job, lines: list[list[Track]], borders: list[int]) -> list[Searched]:
    table = TurnTable(job, list(job.layout.tracks))
    known: dict[tuple[int, int], Searched] = {}

    def block(first: int, last: int) -> Searched:
        if (first, last) not in known:
            best = searched(_tracks(lines, first, last), job, table)
            known[first, last] = best if job.supply is None else searched_in_loads(best, job, table, job.supply)
        return known[first, last]

    borders = balanced(borders, lambda first, last: block(first, last).seconds)
    return [block(first, last) for first, last in pairwise(borders)]


def _weight(job: Job, line: list[Track]) -> float:
    """Length of a line with a turn for every piece (m)."""
    return sum(track.length + job.manner.turn_s[1] * job.manner.work_speed_mps for track in line)


def _tracks(lines: list[list[Track]], first: int, last: int) -> list[Track]:
    return [track for line in lines[first:last] for track in line]


STRATEGY = Strategy(NAME, "one block of neighbouring tracks per tractor", split_field, takes_jump=True)
