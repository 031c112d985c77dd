"""Split field: one block of neighbouring tracks per tractor, cut so that the last tractor finishes soonest.

Blocks are cut by the work on their lines and then balanced by the best orders found inside them: a line at a border
changes sides if that makes the slower of the two blocks quicker.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from fields.layout.swaths import Swath
from strategies.lines.work_line import WorkLine
from strategies.program.field_job import DrivingRules, FieldJob
from strategies.program.legs import build_mission, build_own_mission, group_by_line, make_strategy_plan
from strategies.program.strategy_record import Strategy
from strategies.programmes.dealing import LineDeal, free_other_lines, group_swath_lines
from strategies.sequencing.order_proof import PROOF_EFFORT
from strategies.sequencing.swath_order import SearchedOrder, order_shares_in_pattern, prove_order, search_order
from strategies.sequencing.turn_table import TurnTable
from strategies.service_stops.loaded_order import search_in_loads
from vehicle.missions.plan import Plan

BlockCost = Callable[[int, int], float]
"""Seconds of the block of lines first..last - 1."""

WEIGHT_RESOLUTION = 1e-6  # of the heaviest line
MIN_GAIN_S = 0.01
MAX_BALANCE_ROUNDS = 50


def cut_balanced_blocks(weights: Sequence[float], count: int) -> list[int]:
    """Borders 0 = b0 < b1 < ... = n of `count` runs, the heaviest as light as possible; n must be at least `count`.

    Weights count to a millionth of the heaviest, so that rounding errors decide nothing where two cuts are as good.
    """
    heaviest = max(weights)
    shares = [round(weight / heaviest / WEIGHT_RESOLUTION) for weight in weights]
    low, high = max(shares), sum(shares)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if len(_pack_runs(shares, middle)) <= count else (middle + 1, high)
    sizes = _split_largest_runs(_pack_runs(shares, high), count)
    borders = [0]
    for size in sizes:
        borders.append(borders[-1] + size)
    return borders


def _pack_runs(weights: Sequence[int], max_weight: int) -> list[int]:
    """Sizes of the fewest runs none of which weighs more than `max_weight`."""
    sizes, total = [0], 0
    for weight in weights:
        if sizes[-1] and total + weight > max_weight:
            sizes.append(0)
            total = 0
        sizes[-1] += 1
        total += weight
    return sizes


def _split_largest_runs(sizes: list[int], count: int) -> list[int]:
    """Split the largest runs until there are `count` of them."""
    sizes = list(sizes)
    while len(sizes) < count:
        largest = max(range(len(sizes)), key=lambda i: sizes[i])
        half = sizes[largest] // 2
        sizes[largest : largest + 1] = [sizes[largest] - half, half]
    return sizes


def balance_borders(borders: list[int], block_cost: BlockCost) -> list[int]:
    """Move borders line by line while that makes the slower of two neighbouring blocks quicker."""
    borders = list(borders)
    for _ in range(MAX_BALANCE_ROUNDS):
        has_moved = [_move_border(borders, number, block_cost) for number in range(1, len(borders) - 1)]
        if not any(has_moved):
            break
    return borders


def _move_border(borders: list[int], number: int, block_cost: BlockCost) -> bool:
    """Move one border by a line if that helps; return whether it did."""
    first, border, last = borders[number - 1 : number + 2]
    before_s, after_s = block_cost(first, border), block_cost(border, last)
    new_border = border - 1 if before_s > after_s else border + 1
    if not first < new_border < last:
        return False
    if max(block_cost(first, new_border), block_cost(new_border, last)) >= max(before_s, after_s) - MIN_GAIN_S:
        return False
    borders[number] = new_border
    return True


NAME = "split-field"
BORDER_SHARE = 0.25  # of a block on either side of its border: swaths that either of the two tractors may work


def deal_blocks(lines: Sequence[WorkLine], rules: DrivingRules, tractors: int) -> LineDeal:
    """A block of neighbouring swaths each, equal by work; the search for orders balances them over their borders."""
    swaths = group_swath_lines(lines, tractors)
    borders = cut_balanced_blocks([_weigh_swath_s(lines, numbers, rules) for numbers in swaths], tractors)
    allowed = free_other_lines(lines, tractors)
    for tractor, (first, last) in enumerate(pairwise(borders)):
        low = first - math.ceil(BORDER_SHARE * (first - borders[tractor - 1])) if tractor else 0
        high = last + (math.ceil(BORDER_SHARE * (borders[tractor + 2] - last)) if tractor < tractors - 1 else 0)
        for numbers in swaths[low:high]:
            allowed[tractor, numbers] = True
    return LineDeal(allowed)


def _weigh_swath_s(lines: Sequence[WorkLine], numbers: Sequence[int], rules: DrivingRules) -> float:
    """Seconds of the pieces of a swath, with a turn for each."""
    return sum(lines[number].length_m / rules.work_speed_mps + rules.turn_s[1] for number in numbers)


def plan_split_field(job: FieldJob) -> Plan:
    """One block of neighbouring lines per tractor, each in its quickest order; all start at once.

    Blocks are balanced by these orders. With `job.jump` every block takes that pattern (1: one line after another) and
    blocks have equal working times.
    """
    lines = group_by_line(job)
    borders = cut_balanced_blocks([_weigh_line(job, line) for line in lines], job.tractors)
    if job.jump is not None:
        orders = order_shares_in_pattern([_list_swaths(lines, *ends) for ends in pairwise(borders)], job, job.jump)
        return make_strategy_plan(job, NAME, (build_mission(job, order) for order in orders))
    shares = _get_quickest_blocks(job, lines, borders)
    missions = (build_own_mission(job, number, share.order) for number, share in enumerate(shares))
    if job.reversed_tractors:  # driven backwards, an order takes a little more or less: no gap is known
        return make_strategy_plan(job, NAME, missions)
    gap_pct = max(share.gap_pct for share in shares)
    return make_strategy_plan(job, NAME, missions, order_gap_pct=round(gap_pct, 3))


def _get_quickest_blocks(job: FieldJob, lines: list[list[Swath]], borders: list[int]) -> list[SearchedOrder]:
    """The blocks of all tractors in their quickest orders, balanced by these; cached for all jobs of a field."""
    key = job.tractors, job.entrance_ends, tuple(job.layout.swaths)
    if key not in job.block_cache:
        job.block_cache[key] = _balance_blocks(job, lines, borders)
    return job.block_cache[key]  # type: ignore[no-any-return]


def _balance_blocks(job: FieldJob, lines: list[list[Swath]], borders: list[int]) -> list[SearchedOrder]:
    table = TurnTable(job, list(job.layout.swaths))
    searched_blocks: dict[tuple[int, int], SearchedOrder] = {}

    def search_block(first: int, last: int) -> SearchedOrder:
        if (first, last) not in searched_blocks:
            searched = search_order(_list_swaths(lines, first, last), job, table)
            searched_blocks[first, last] = (
                searched if job.supply is None else search_in_loads(searched, job, table, job.supply)
            )
        return searched_blocks[first, last]

    borders = balance_borders(borders, lambda first, last: search_block(first, last).seconds)
    blocks = [search_block(first, last) for first, last in pairwise(borders)]
    return (
        blocks
        if job.supply is not None
        else [prove_order(block, table, PROOF_EFFORT / len(blocks)) for block in blocks]
    )


def _weigh_line(job: FieldJob, line: list[Swath]) -> float:
    """Length of a line, plus one turn for every piece of it (m)."""
    return sum(swath.length_m + job.driving_rules.turn_s[1] * job.driving_rules.work_speed_mps for swath in line)


def _list_swaths(lines: list[list[Swath]], first: int, last: int) -> list[Swath]:
    return [swath for line in lines[first:last] for swath in line]


STRATEGY = Strategy(
    NAME, "work one block of neighbouring swaths each", plan_split_field, takes_jump=True, deal=deal_blocks
)
