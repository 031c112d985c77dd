"""What moves between lines cost as far as closed forms tell: near lines at once, others when they are asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fields.arrays import Flags, Floats, Integers, build_directions
from strategies.lines.work_line import WorkLine
from strategies.moves.closed_forms import (
    FEW_FORMS,
    LEADS_IN_M,
    LEADS_OUT_M,
    list_closed_forms,
    pick_with_room,
    weigh_forms,
)
from strategies.moves.move_finder import MOVE_MARGIN_M, MoveFinder
from strategies.path_planning.paths import Pose, shift_pose_ahead
from strategies.programmes.order_tours import DETOUR_S, NO_MOVE_S
from strategies.programmes.work_moves import list_work_moves
from strategies.site.site import MISSED_FACTOR, Site
from vehicle.jit import compile_function
from vehicle.missions.plan import HEADLAND_PASS

Pair = tuple[int, int]

NEAR_NODES = 16  # nodes whose moves from a node are asked for at once
OUTS, INS = 1, 3  # how many leads out and leads in are tried
CUTS_M = ((4.0, 0.0), (0.0, 4.0), (4.0, 4.0), (8.0, 8.0))  # from the line left and that begun, for want of room
MOST_CUT_SHARE = 0.4
DETOUR_FACTOR = 2.0  # guess of a move that only a search may find, of the way at turning speed
SEARCHED_S = 40.0  # and about this much beside it: medians of what searches found on four fields were 34 to 51


@dataclass(eq=False)
class MoveEstimates:
    """Estimates between nodes, the last of which is the entrance.

    Attributes:
        ends, begins: poses of the guided point where nodes end and begin.
        starts: nodes that no move leads to, as tractors begin with them.
        known: by pairs of nodes the seconds with charges and as driven.
    """

    site: Site
    lines: Sequence[WorkLine]
    finder: MoveFinder
    ends: Sequence[Pose]
    begins: Sequence[Pose]
    starts: Sequence[int] = ()
    known: dict[Pair, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def plain_s(self) -> Floats:
        """Seconds (n, n) of the straight ways at turning speed, with changes of heading on an arc; NO_MOVE_S where a
        node leads to its own line, a line is driven the way that it may not be, or no passage is wide enough."""
        ends, begins, rules = np.array(self.ends), np.array(self.begins), self.site.rules
        gaps_m = np.hypot(*(ends[:, None, :2] - begins[None, :, :2]).transpose(2, 0, 1))
        turns = np.abs((begins[None, :, 2] - ends[:, None, 2] + np.pi) % (2.0 * np.pi) - np.pi)
        costs: Floats = (gaps_m + turns * rules.radius_m) / rules.turn_speed_mps
        numbers = np.append(np.repeat(np.arange(len(self.lines)), 2), -1)
        costs[numbers[:, None] == numbers[None, :]] = NO_MOVE_S
        one_way = [2 * number + 1 for number, line in enumerate(self.lines) if not line.both_ways]
        costs[one_way], costs[:, one_way] = NO_MOVE_S, NO_MOVE_S
        costs[:, list(self.starts)] = NO_MOVE_S
        costs[self.is_apart.all(axis=0)] = NO_MOVE_S
        return costs

    @cached_property
    def is_apart(self) -> Flags:
        """Whether nodes (2, n, n) lie in parts of the ground between which no passage is as wide as the machine, with
        the implement up (0) and folded (1): all, where it does not fold."""
        middles = [line.get_pose(0, 0.5 * line.measure_path_m(0)) for line in self.lines]
        bars = np.array([shift_pose_ahead(pose, -self.site.rules.tool_m)[:2] for pose in middles]).reshape(-1, 2)
        is_apart = np.ones((2, len(self.ends), len(self.ends)), bool)
        for is_folded in (False, True) if self.site.folded else (False,):
            half_m = max(half for _, _, half in self.site.get_body(is_folded).boxes)
            parts = np.append(np.repeat(self.site.ground.number_parts(half_m, bars), 2), 0)
            is_known = parts > 0
            is_apart[int(is_folded)] = np.not_equal.outer(parts, parts) & np.logical_and.outer(is_known, is_known)
        return is_apart

    @cached_property
    def near(self) -> tuple[Floats, Flags]:
        """Costs (n, n) estimated between near nodes and guessed between others, and which are estimated."""
        nearest = np.argsort(self.plain_s[:-1, :-1], axis=1, kind="stable")[:, :NEAR_NODES]
        pairs = [(u, v) for u, row in enumerate(nearest.tolist()) for v in row if self.plain_s[u, v] < NO_MOVE_S]
        costs, is_estimated = self.plain_s.copy(), np.zeros(self.plain_s.shape, bool)
        if pairs:
            places = tuple(np.array(pairs, np.int64).T)
            costs[places], is_estimated[places] = self.estimate_s(pairs), True
            usual_s = max(0.0, float(np.median((costs - self.plain_s)[places])))
            costs[~is_estimated & (costs < NO_MOVE_S)] += usual_s
        return costs, is_estimated

    def estimate_s(self, pairs: Sequence[Pair], is_charged: bool = True) -> Floats:
        """Seconds (k,) of the best closed forms between pairs of nodes, with charges or as driven; else a guess."""
        new = [pair for pair in dict.fromkeys(pairs) if pair not in self.known]
        if new:
            for pair, raised in zip(new, self._estimate_raised_s(np.array(new, np.int64)).tolist(), strict=True):
                cost_s, drive_s = min([tuple(raised), *self._list_work_s(*pair)])
                found = (
                    (max(cost_s, 0.0), drive_s)
                    if np.isfinite(cost_s)
                    else (self.guess_detour_s(*pair), float(self.plain_s[pair]))
                )
                self.known[pair] = found
        return np.array([self.known[pair][0 if is_charged else 1] for pair in pairs])

    def guess_searched_s(self, u: int, v: int) -> float:
        """Seconds of a move that a search finds, if it finds one."""
        return DETOUR_FACTOR * float(self.plain_s[u, v]) + SEARCHED_S

    def guess_folded_s(self, u: int, v: int) -> float:
        """Seconds that a move with the implement folded usually takes."""
        return DETOUR_FACTOR * float(self.plain_s[u, v]) + 2.0 * self.site.get_fold_s(True)

    def guess_detour_s(self, u: int, v: int) -> float:
        """Seconds of a move that only a search may find, and may not."""
        return DETOUR_FACTOR * float(self.plain_s[u, v]) + DETOUR_S

    def count_passes(self, u: int, v: int) -> int | None:
        """How many passes of the headland are worked, from the edge on, when a move is made; None for all.

        Into a crop that stands the way in leads to the first of them, and from each on to the next.
        """
        gate = len(self.ends) - 1
        if self.site.standing is None or v == gate:
            return None
        line = self.lines[(v if u == gate else u) // 2]
        if line.group[0] != HEADLAND_PASS:
            return None
        return 0 if u == gate else line.task.number

    def _estimate_raised_s(self, pairs: Integers) -> Floats:
        """Seconds (k, 2), charged and as driven, of moves with the implement up; infinite where only a search may find
        one."""
        finder, site = self.finder, self.site
        limits = site.allowed_kinds, site.rules.max_reverse_m
        lengths_m = [line.measure_path_m(way) for line in self.lines for way in (0, 1)]
        most_cuts_m = np.append(MOST_CUT_SHARE * np.array(lengths_m) - 1.0, 0.0)
        found_s = np.empty((len(pairs), 2))
        passes = np.array([self.count_passes(u, v) for u, v in pairs.tolist()], object)
        a_poses, b_poses = np.array(self.ends)[pairs[:, 0]], np.array(self.begins)[pairs[:, 1]]
        at_gate = (pairs == len(self.ends) - 1).any(axis=1)
        for is_at_gate, worked in dict.fromkeys(zip(at_gate.tolist(), passes, strict=True)):
            here = (at_gate == is_at_gate) & (passes == worked)
            ground = site.at_gate.ground if is_at_gate else site.ground
            folds = is_at_gate and site.folds_at_gate
            body = site.get_body(folds)
            found_s[here] = site.get_fold_s(folds) + compute_move_costs(
                a_poses[here],
                _see_from(a_poses[here], b_poses[here]),
                most_cuts_m[pairs[here]],
                np.array([(0.0, 0.0), *CUTS_M]),
                np.array([MISSED_FACTOR, 1.0]) / site.rules.work_speed_mps,
                (finder.radii, LEADS_OUT_M[:OUTS], LEADS_IN_M[:INS], *finder.costs, *limits),
                (body.guide_m, body.points, body.reach_m, ground.grid, ground.frame, MOVE_MARGIN_M),
                site.get_kept(worked),
            )
        return found_s

    def _list_work_s(self, u: int, v: int) -> list[tuple[float, float]]:
        """Seconds of moves with the implement down, charged and as driven."""
        if len(self.ends) - 1 in (u, v):
            return []
        found = list_work_moves(self.site, self.finder, self.lines[u // 2], u % 2, self.lines[v // 2], v % 2)
        return [(one.cost_s, one.drive_s) for one in found]


def _see_from(a_poses: Floats, b_poses: Floats) -> Floats:
    """Poses b as seen from poses a, both (k, 3)."""
    cosine, sine = build_directions(a_poses[:, 2]).T
    east, north, turn = (b_poses - a_poses).T
    return np.column_stack([east * cosine + north * sine, north * cosine - east * sine, turn])


@compile_function
def _find_cost(a, forms, speeds, settling, body, kept):  # type: ignore[no-untyped-def]
    """Seconds with and without charges of the first of the forms (n, m, 3) from pose a on which the body has room."""
    guide, points, reach, grid, frame, margin = body
    numbers = pick_with_room(a, forms, 1, guide, points, reach, grid, frame, margin)
    if len(numbers) == 0:
        return np.inf, np.inf
    weights = weigh_forms(a, forms, numbers, speeds, settling, kept)
    return weights.sum(), weights[0, 0]


@compile_function
def compute_move_costs(a_poses, places, most_cuts, cuts, cut_s_per_m, driving, body, kept):  # type: ignore[no-untyped-def]
    """Seconds with and without charges (k, 2) of the quickest closed form with room from poses to places (k, 3).

    Infinite where nothing has room. A place is as seen from its pose. Where nothing has room, moves are sought with the
    ends of lines cut back by pairs of `cuts` (m, 2) below `most_cuts` (k, 2), which begin with none, no farther than
    needed; each metre cut costs and saves `cut_s_per_m` (2,). `driving` are radii, leads out and in, speeds, settling,
    allowed kinds and the limit of reversing as list_closed_forms takes them, `body` is what pick_with_room takes,
    `kept` what Site.get_kept gives.
    """
    radii, outs, ins, speeds, settling, kinds, max_reverse = driving
    costs, pose, goal = np.full((len(a_poses), 2), np.inf), np.empty(3), np.empty(3)
    for k in range(len(a_poses)):
        cut = 0.0
        for leave, join in cuts:
            if leave + join > cut and costs[k, 0] < np.inf:
                break
            cut = leave + join
            if cut > 0.0 and (leave >= most_cuts[k, 0] or join >= most_cuts[k, 1]):
                continue
            goal[0] = places[k, 0] + leave + join * math.cos(places[k, 2])
            goal[1], goal[2] = places[k, 1] + join * math.sin(places[k, 2]), places[k, 2]
            pose[0] = a_poses[k, 0] - leave * math.cos(a_poses[k, 2])
            pose[1], pose[2] = a_poses[k, 1] - leave * math.sin(a_poses[k, 2]), a_poses[k, 2]
            forms, _, _ = list_closed_forms(
                goal, radii, speeds, settling, outs, ins, kinds, 0.0, max_reverse, np.inf, FEW_FORMS
            )
            cost, driven_s = _find_cost(pose, forms, speeds, settling, body, kept)
            charged_s = cost + (cut_s_per_m[0] - cut_s_per_m[1]) * cut
            if charged_s < costs[k, 0]:
                costs[k, 0], costs[k, 1] = charged_s, driven_s - cut_s_per_m[1] * cut
    return costs
