"""Work lines dealt to a fleet, the stages of its work, and where its tractors stand in each other's way."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fields.arrays import Flags
from strategies.interleaved import deal_in_turn
from strategies.lines.deal_apart import deal_runs, deal_tours, list_deals_apart
from strategies.lines.lay_lines import LEFTOVER
from strategies.lines.work_line import HOLE_PASS, WorkLine
from strategies.path_planning.errors import StrategyError
from strategies.programmes.stages import charge_furrows, charge_rounds, find_first_tasks, list_stages, stagger_starts
from strategies.programmes.waiting_places import find_clashes, list_parts_m
from strategies.registry import STRATEGIES
from strategies.rules.dealing import cut_balanced_blocks
from strategies.rules.driving_rules import DrivingRules
from strategies.site.site import ORDER_S
from strategies.split_field import deal_blocks
from strategies.strategy_record import Strategy
from vehicle.missions.plan import HEADLAND_PASS, SWATH, TURN, Leg, LegGate, LegTask, Mission, Plan
from vehicle.sim.path_conflicts import PosePath

RULES = DrivingRules(2.0, 2.0, 1.0, 5.0, 1.0, turn_s=(0.0, 20.0))


def draw_line(kind: str, number: int, begin: tuple[float, float], end: tuple[float, float]) -> WorkLine:
    path = np.array([begin, end])
    return WorkLine(LegTask(kind, number), (kind, number), (path, path[::-1].copy()), 1.0)


def draw_lines(swaths: int, pieces: int = 1) -> list[WorkLine]:
    """One headland side, then parallel swaths 3 m apart in pieces of 100 m."""
    side = draw_line(HEADLAND_PASS, 0, (0.0, -5.0), (3.0 * swaths, -5.0))
    return [side] + [
        draw_line(SWATH, number, (3.0 * number, 110.0 * piece), (3.0 * number, 110.0 * piece + 100.0))
        for number in range(swaths)
        for piece in range(pieces)
    ]


@pytest.mark.parametrize("pieces", [1, 2])
def test_blocks_are_equal_and_share_a_quarter_over_their_borders(pieces: int) -> None:
    lines = draw_lines(24, pieces)
    allowed = deal_blocks(lines, RULES, 3).allowed
    swaths = [
        sorted({line.task.number for line, may in zip(lines, row, strict=True) if may and line.task.kind == SWATH})
        for row in allowed
    ]
    assert swaths == [list(range(10)), list(range(6, 18)), list(range(14, 24))]  # blocks of 8, 2 more at a border
    assert allowed[:, 0].all(), "the headland is for all"
    assert allowed.any(axis=0).all(), "every line is for somebody"


def test_every_nth_swath_in_turn() -> None:
    deal = deal_in_turn(draw_lines(7, 2), RULES, 3)
    owners = deal.allowed[:, 1:].argmax(axis=0)[::2]
    assert owners.tolist() == [0, 1, 2, 0, 1, 2, 0]
    assert (deal.allowed[:, 1:].sum(axis=0) == 1).all()
    assert deal.stagger_m == RULES.stagger_m


@pytest.mark.parametrize("strategy", STRATEGIES.values(), ids=STRATEGIES)
def test_one_tractor_alone_does_the_same_by_all_that_do_not_say_otherwise(strategy: Strategy) -> None:
    """A plan of one of them stands for all, so another order or lines left out would never be tried."""
    deal = strategy.deal and strategy.deal(draw_lines(7, 2), RULES, 1)
    assert strategy.differs_alone or deal is None or (deal.allowed.all() and deal.places is None)


def draw_ring(number: int, low: float, high: float, first: int) -> list[WorkLine]:
    """The sides of a square, from the south anticlockwise, as headland pass `number`."""
    corners = [(low, low), (high, low), (high, high), (low, high), (low, low)]
    return [
        WorkLine(LegTask(HEADLAND_PASS, number), (HEADLAND_PASS, first), (path, path[::-1].copy()), 1.0)
        for path in (np.array(ends) for ends in pairwise(corners))
    ]


def test_sides_beside_each_other_are_dealt_to_the_tractor_whose_swaths_are_near() -> None:
    """West and east block of a square of 120 m, three rings along its edge and one round a pond in the east."""
    rings = [
        draw_ring(pass_number, 3.0 * pass_number, 120.0 - 3.0 * pass_number, pass_number) for pass_number in (1, 2, 3)
    ]
    swaths = [draw_line(SWATH, k, (12.0 + 3.0 * k, 12.0), (12.0 + 3.0 * k, 108.0)) for k in range(32)]
    lines = [*(side for ring in rings for side in ring), *draw_ring(1, 85.0, 95.0, 4), *swaths]
    allowed = np.ones((2, len(lines)), bool)
    allowed[0, 16:] = np.arange(32) < 16
    allowed[1, 16:] = ~allowed[0, 16:]

    def share_swaths(sides: Flags) -> list[list[int]]:
        """Tours by which the last tractor has the first swaths, and each of the others as many of those that follow."""
        shares = np.array_split(np.arange(16, len(lines)), len(sides))
        return [(2 * share).tolist() for share in reversed(shares)]

    (dealt,) = list_deals_apart(lines, allowed, share_swaths)
    assert (dealt[:, 16:] == allowed[:, 16:]).all()
    assert (dealt[:, :16].sum(axis=0) == 1).all(), "a side is one tractor's"
    assert (dealt[:, :4] == dealt[:, 4:8]).all() and (dealt[:, :4] == dealt[:, 8:12]).all(), "in all passes"
    assert dealt[0, 3] and dealt[1, 1], "the west side is the western tractor's, the east side the eastern's"
    assert (dealt[:, :4].sum(axis=1) == 2).all(), "as long for both"
    assert dealt[1, 12:16].all(), "the ring round the pond is whole"
    places = np.array([[110.0, 60.0], [10.0, 60.0]])
    (left,) = list_deals_apart(lines[:16], np.ones((2, 16), bool), share_swaths, places)
    assert (left.sum(axis=0) == 1).all() and left[0, 1] and left[1, 3] and left[0, 12:].all(), "by where they stand"
    *_, parted = list_deals_apart(lines, np.ones((2, len(lines)), bool), share_swaths, places)
    assert parted[:, 16:].argmax(axis=0).tolist() == [1] * 16 + [0] * 16, "swaths too: nobody crosses the other's"
    (many,) = list_deals_apart(lines, np.ones((5, len(lines)), bool), share_swaths)
    assert many[:, :16].all(), "four sides are no stretches for five"
    assert (many[:, 16:].sum(axis=0) == 1).all() and (np.diff(many[:, 16:].argmax(axis=0)) <= 0).all(), "runs of swaths"
    nothing = list_deals_apart(lines[:16], np.ones((2, 16), bool), share_swaths)
    assert nothing == [], "nobody has swaths that a side could be near"


@pytest.mark.parametrize("deal", [deal_blocks, deal_in_turn])
def test_tractors_without_swaths_have_the_headland(deal: Any) -> None:
    lines = [*draw_lines(3), *draw_ring(1, -20.0, 120.0, 1)]
    allowed = deal(lines, RULES, 4).allowed
    headland = [line.task.kind != SWATH for line in lines]
    assert allowed[:, headland].all() and allowed.any(axis=0).all() and allowed[3].tolist() == headland


@pytest.mark.parametrize("deal", [deal_blocks, deal_in_turn])
def test_more_tractors_than_lines_are_refused(deal: Any) -> None:
    with pytest.raises(StrategyError, match="9 tractors are more than the 8 tracks and sides"):
        deal([*draw_lines(3), *draw_ring(1, -20.0, 120.0, 1)], RULES, 9)


@pytest.mark.parametrize(("order", "stages"), [("first", [0, 1, 1]), ("last", [1, 0, 0]), ("", [0, 0, 0])])
def test_stages_of_lines(order: str, stages: Sequence[int]) -> None:
    assert list_stages(make_site(), draw_lines(2), order) == stages


def test_a_machine_works_its_way_into_a_crop_that_stands() -> None:
    """Two passes round a field with a hole in the middle, a track past it, and one in two pieces up to its passes."""

    def draw_pass(kind: str, number: int, low: float, high: float) -> list[WorkLine]:
        pieces = enumerate(draw_ring(number, low, high, 0), start=4 * (kind == HOLE_PASS))
        return [replace(line, group=(kind, 0), task=replace(line.task, piece=piece)) for piece, line in pieces]

    outer, inner = draw_pass(HEADLAND_PASS, 1, 1.5, 98.5), draw_pass(HEADLAND_PASS, 2, 4.5, 95.5)
    near, away = draw_pass(HOLE_PASS, 1, 43.5, 56.5), draw_pass(HOLE_PASS, 2, 40.5, 59.5)
    past = draw_line(SWATH, 0, (6.0, 20.0), (94.0, 20.0))
    up_to, on = draw_line(SWATH, 1, (6.0, 50.0), (39.0, 50.0)), draw_line(SWATH, 1, (61.0, 50.0), (94.0, 50.0))
    lines = [*near, on, *inner, past, *away, up_to, *outer]
    stages = list_stages(make_site(crop_stands=True), lines, "first")
    assert stages == [4] * 4 + [5] + [1] * 4 + [2] + [3] * 4 + [5] + [0] * 4
    first = find_first_tasks(make_site(crop_stands=True), lines, "first")
    assert first == {line.task for line in (*outer, *inner)}
    assert list_stages(make_site(), lines, "first") == [int(line.task.kind == SWATH) for line in lines]
    asked = make_site(crop_stands=True)
    assert list_stages(asked, lines, "last") == [int(line.task.kind != SWATH) for line in lines]
    assert find_first_tasks(asked, lines, "last") == {line.task for line in (past, up_to, on)}


def make_site(crop_stands: bool = False, in_furrows: bool = False) -> Any:
    return SimpleNamespace(crop_stands=crop_stands, furrow_s=120.0 * in_furrows, width_m=3.0)


def make_plan(*kinds: str) -> Plan:
    """Tractors beside each other that work legs of 30 m: T and H in two parts of a line, to wait before the second."""

    def make_mission(row: int, letters: str) -> Mission:
        legs = []
        for letter in letters:
            x = 30.0 * len(legs)
            kind = {"t": SWATH, "T": SWATH, "h": HEADLAND_PASS, "H": HEADLAND_PASS, "-": TURN}[letter]
            points = np.array([[x, 50.0 * row], [x + 30.0, 50.0 * row]])
            legs.append(Leg(points, 2.0, 1, kind != TURN, task=LegTask(kind, 0), may_wait=letter in "TH"))
        return Mission(tuple(legs))

    return Plan(tuple(make_mission(row, letters) for row, letters in enumerate(kinds)))


def list_gates(plan: Plan) -> dict[tuple[int, int], list[LegGate]]:
    return {(t, n): list(leg.gates) for t, m in enumerate(plan.missions) for n, leg in enumerate(m.legs) if leg.gates}


def test_the_tracks_of_each_become_neighbours() -> None:
    """Of eight tracks the first works 0, 1, 3 and 6: nearest to that are 0 to 3."""
    lines = draw_lines(8)
    tracks = [number for number, line in enumerate(lines) if line.task.kind == SWATH]
    tours = [[2 * tracks[n] for n in (3, 0, 1, 6)], [2 * tracks[n] + 1 for n in (2, 4, 5, 7)]]
    shared = np.ones((2, len(lines)), bool)
    dealt = deal_runs(lines, shared, tours)
    assert [int(dealt[:, number].argmax()) for number in tracks] == [0, 0, 0, 0, 1, 1, 1, 1]
    assert (dealt[:, tracks].sum(axis=0) == 1).all()
    others = np.setdiff1d(range(len(lines)), tracks)
    assert dealt[:, others].all(), "the headland stays as it was"
    swapped = deal_runs(lines, shared, tours[::-1])
    assert (swapped == dealt[::-1]).all()
    taken = shared.copy()
    taken[1, tracks[0]], taken[0, tracks[-1]] = False, False
    taken[0, tracks[1]], taken[1, tracks[2]] = False, False
    assert deal_runs(lines, taken, tours) is taken, "0 may have 0 and 2, 1 what is between: that is no run"


def test_runs_of_tracks_are_as_long_as_those_of_tours() -> None:
    """The middle one of three works what is left between tracks of both others."""
    lines = draw_lines(12)
    tracks = [number for number, line in enumerate(lines) if line.task.kind == SWATH]
    tours = [[2 * tracks[n] for n in own] for own in ((0, 1, 4, 5), (3, 2, 9, 8), (6, 7, 10, 11))]
    dealt = deal_runs(lines, np.ones((3, len(lines)), bool), tours)
    assert [int(dealt[:, number].argmax()) for number in tracks] == [0] * 4 + [1] * 4 + [2] * 4


def test_moves_that_leave_the_order_of_passes_are_charged() -> None:
    """Three rings round a field, two round a hole, a track; a side of each."""
    rings = [draw_ring(number, 3.0 * number, 120.0 - 3.0 * number, number) for number in (1, 2, 3)]
    around = [draw_ring(number, 50.0 - 3.0 * number, 60.0 + 3.0 * number, 9) for number in (1, 2)]
    lines = [*(side for ring in rings for side in ring)]
    lines += [replace(side, group=(HOLE_PASS, 9)) for ring in around for side in ring]
    lines.append(draw_line(SWATH, 0, (12.0, 12.0), (12.0, 100.0)))
    shared, alone = np.ones((2, 21), bool), np.ones((1, 21), bool)
    one, two, three, near, away, swath, gate = (*(2 * number for number in (0, 4, 8, 12, 16, 20)), -1)
    charged_s = charge_rounds(make_site(), lines, "first", shared)
    assert charged_s.shape == (43, 43) and set(charged_s.ravel()) == {0.0, ORDER_S}
    free = [(one, two), (one, three), (one, one + 2), (near, away), (away, one), (swath, two), (swath, away)]
    assert not any(charged_s[pair] for pair in free), "from the outside in, and from another nest to the first"
    charged = [(two, one), (three, two + 1), (three, one), (away, near), (one, away), (near, two)]
    assert all(charged_s[pair] for pair in charged)
    assert not charged_s[:, [swath, gate]].any() and not charged_s[[swath, gate]].any()
    alone_s = charge_rounds(make_site(), lines, "first", alone)
    assert all(alone_s[pair] for pair in [(swath, two), (swath, away)]) and not alone_s[swath, one]
    assert (alone_s >= charged_s).all() and not charged_s[two, near] and not alone_s[three, near]
    assert alone_s[one, near] and alone_s[two, near], "it leaves a ring when that is done"
    own = shared.copy()
    own[1, [0, 4, 8]] = False
    own_s = charge_rounds(make_site(), lines, "first", own)
    assert own_s[swath, two] and own_s[two, near] and not any(own_s[pair] for pair in [(one, two), (two, three)])
    assert not own_s[swath, two + 2] and not own_s[two + 2, near], "these the other may work as well"
    assert not charge_rounds(make_site(crop_stands=True), lines, "first", alone).any(), "stages see to that"
    leftover = replace(rings[2][0], task=LegTask(HEADLAND_PASS, 4), group=(LEFTOVER, 0))
    with_it_s, left = charge_rounds(make_site(), [*lines, leftover], "last", np.ones((1, 22), bool)), -3
    assert not any(with_it_s[pair] for pair in [(swath, three), (three, left), (left, two), (left, one)])
    assert all(with_it_s[pair] for pair in [(swath, left), (left, three), (one, left)]), "it lies between three and two"
    inside_out_s = charge_rounds(make_site(), lines, "last", shared)
    assert not any(inside_out_s[pair] for pair in [(three, two), (two, one), (away, near), (one, away), (near, three)])
    assert all(inside_out_s[pair] for pair in [(two, three), (one, three), (one, near), (near, away), (near, two)])


def test_a_plough_follows_the_furrow() -> None:
    lines, site = draw_lines(4, pieces=2), make_site(in_furrows=True)
    charged_s = charge_furrows(site, lines, np.ones((1, 9), bool))
    side, first, its_second, second, third, gate = 0, 2, 4, 6, 10, -1
    free = [(first, second), (second, first + 1), (first, its_second), (its_second, second), (second, third)]
    assert not any(charged_s[pair] for pair in free)
    assert all(charged_s[pair] for pair in [(first, third), (third, first), (side, first), (third, side)])
    assert not charged_s[gate].any() and not charged_s[:, gate].any()
    in_turn = np.array(
        [[True, True, True, False, False, True, True, False, False], [True] + 2 * [False, False, True, True]]
    )
    assert not charge_furrows(site, lines, in_turn)[first, third], "the next of its own"
    assert not charge_furrows(make_site(), lines, in_turn).any()
    left = replace(lines[0], group=(LEFTOVER, 0))
    assert charge_furrows(site, [left, *lines], np.ones((1, 10), bool))[0, 2:-1].all(), "no furrow leads there"


def test_lines_of_tours_are_their_tractors() -> None:
    dealt = deal_tours(np.ones((2, 4), bool), [[0, 5], [2]])
    assert dealt.tolist() == [[True, False, True, True], [False, True, False, True]]


def test_starts_are_staggered_on_the_first_working_leg() -> None:
    gates = list_gates(stagger_starts(make_plan("-tT", "tT", "tT"), 12.0))
    assert gates == {(1, 0): [LegGate(0, 1, 12.0)], (2, 0): [LegGate(1, 0, 12.0)]}
    waits = make_plan("hH", "tT").copy_with_gate(0, 0, LegGate(1, 0, 29.8))
    assert list_gates(stagger_starts(waits, 12.0)) == list_gates(waits), "no circle of two that wait"


def make_moves(lines: Sequence[WorkLine]) -> Any:
    body = SimpleNamespace(guide_m=0.0, reach_m=2.0)
    site = SimpleNamespace(body=body, back_m=0.0, rules=RULES, lane=None)
    return SimpleNamespace(lines=lines, site=site, gate=2 * len(lines), starts=(), clashes={})


def test_places_to_wait() -> None:
    moves = make_moves(draw_lines(30))
    assert list_parts_m(moves, 0, 90.0) == [0.0, 41.0, 82.0, 90.0], "about every 40 m along a headland side"
    assert list_parts_m(moves, 2, 100.0) == [0.0, 52.0, 92.0, 100.0], "and on a track before its end is in the way"
    assert list_parts_m(moves, 2, 80.0) == [0.0, 72.0, 80.0]
    assert list_parts_m(moves, 2, 10.0) == [0.0, 5.0, 10.0]


def test_two_never_end_at_one_corner_nor_begin_there() -> None:
    """Two lines meet in a corner, a third is far off."""
    lines = [
        draw_line(HEADLAND_PASS, 0, (100.0, 0.0), (0.0, 0.0)),
        draw_line(HEADLAND_PASS, 1, (0.0, 100.0), (0.0, 0.0)),
        draw_line(SWATH, 2, (50.0, 50.0), (50.0, 90.0)),
    ]

    class WithinTwoMetres:
        def find_blocked_parts(self, standing: PosePath, driving: PosePath) -> np.ndarray:
            (x, y), (u, v) = ((path.poses["x"], path.poses["y"]) for path in (standing, driving))
            return np.argwhere(np.hypot(x[:, None] - u, y[:, None] - v) < 2.0)

    clashes = find_clashes(make_moves(lines), WithinTwoMetres())  # type: ignore[arg-type]
    assert np.argwhere(clashes[1]).tolist() == [[0, 0], [0, 2], [1, 1], [2, 0], [2, 2], [3, 3], [4, 4], [5, 5]]
    assert np.argwhere(clashes[0]).tolist() == [[0, 0], [1, 1], [1, 3], [2, 2], [3, 1], [3, 3], [4, 4], [5, 5]]


@given(st.lists(st.integers(10, 400), min_size=1, max_size=9), st.data())
def test_contiguous_complete_and_as_even_as_can_be(weights: list[int], data: st.DataObject) -> None:
    count = data.draw(st.integers(1, len(weights)))
    borders = cut_balanced_blocks(weights, count)
    assert borders[0] == 0 and borders[-1] == len(weights) and len(borders) == count + 1
    assert all(a < b for a, b in pairwise(borders))
    cuts = combinations(range(1, len(weights)), count - 1)
    best = min(max(sum(weights[a:b]) for a, b in pairwise((0, *inner, len(weights)))) for inner in cuts)
    assert max(sum(weights[a:b]) for a, b in pairwise(borders)) == pytest.approx(best, rel=1e-9)
