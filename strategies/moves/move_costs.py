"""What the quickest moves between many poses cost, in closed form with the body, compiled as one."""

from __future__ import annotations

import math

import numpy as np

from strategies.moves.closed_forms import ROWS, list_closed_forms, pick_with_room, weigh_forms
from vehicle.jit import compile_function

MOST_FORMS = 12  # closed forms tried for a pair


@compile_function
def _find_cost(a, forms, speeds, settling, body, kept):  # type: ignore[no-untyped-def]
    """Seconds with and without charges of the first of the forms (n, m, 3) from pose a on which the body has room."""
    guide, points, reach, grid, frame, margin = body
    numbers = pick_with_room(a, forms, 1, guide, points, reach, grid, frame, margin)
    if len(numbers) == 0:
        return np.inf, np.inf
    kept_grid, kept_frame, wheels_s_per_m = kept
    weights = weigh_forms(a, forms, numbers, speeds, settling, kept_grid, kept_frame, wheels_s_per_m)
    return weights.sum(), weights[0, 0]


@compile_function
def compute_move_costs(a_poses, places, alike, dear_s, most_cuts, cuts, cut_s_per_m, driving, body, kept):  # type: ignore[no-untyped-def]
    """Seconds with and without charges (k, 2) of the quickest closed form with room from poses to places (k, 3).

    Infinite where nothing has room. A place is as seen from its pose; equal ones have the same number in `alike` (k,)
    and follow one another. Where a move takes more than `dear_s` (k,), it is also sought with the ends of lines cut
    back by pairs of `cuts` (m, 2) below `most_cuts` (k, 2), the first of which is none; each metre cut costs and saves
    `cut_s_per_m` (2,). `driving` are radii, leads out and in, speeds, settling, allowed kinds and the limit of
    reversing as list_closed_forms takes them, `body` is what pick_with_room takes, `kept` the ground of swaths (grid,
    frame) and what wheels there are charged (s/m).
    """
    radii, outs, ins, speeds, settling, kinds, max_reverse = driving
    costs, pose, goal = np.full((len(a_poses), 2), np.inf), np.empty(3), np.empty(3)
    forms, are_known = [np.empty((0, ROWS, 3)) for _ in range(len(cuts))], np.zeros(len(cuts), np.bool_)
    for k in range(len(a_poses)):
        if k == 0 or alike[k] != alike[k - 1]:
            are_known[:] = False
        for number in range(len(cuts)):
            leave, join = cuts[number, 0], cuts[number, 1]
            charge = (cut_s_per_m[0] - cut_s_per_m[1]) * (leave + join)
            if number > 0 and (costs[k, 0] < max(charge, dear_s[k]) or leave >= most_cuts[k, 0]):
                continue
            if number > 0 and join >= most_cuts[k, 1]:
                continue
            if not are_known[number]:
                goal[0] = places[k, 0] + leave + join * math.cos(places[k, 2])
                goal[1], goal[2] = places[k, 1] + join * math.sin(places[k, 2]), places[k, 2]
                forms[number], _, _ = list_closed_forms(
                    goal, radii, speeds, settling, outs, ins, kinds, 0.0, max_reverse, MOST_FORMS
                )
                are_known[number] = True
            pose[0] = a_poses[k, 0] - leave * math.cos(a_poses[k, 2])
            pose[1], pose[2] = a_poses[k, 1] - leave * math.sin(a_poses[k, 2]), a_poses[k, 2]
            cost, driven_s = _find_cost(pose, forms[number], speeds, settling, body, kept)
            if charge + cost < costs[k, 0]:
                costs[k, 0], costs[k, 1] = charge + cost, driven_s - cut_s_per_m[1] * (leave + join)
    return costs
