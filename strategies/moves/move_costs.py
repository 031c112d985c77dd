"""What the quickest moves between many poses cost, in closed form with the body, compiled as one."""

from __future__ import annotations

import math

import numpy as np

from strategies.moves.closed_forms import list_closed_forms, pick_with_room, weigh_forms
from vehicle.jit import compile_function

MOST_FORMS = 12  # closed forms tried for a pair


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
                goal, radii, speeds, settling, outs, ins, kinds, 0.0, max_reverse, MOST_FORMS
            )
            cost, driven_s = _find_cost(pose, forms, speeds, settling, body, kept)
            charged_s = cost + (cut_s_per_m[0] - cut_s_per_m[1]) * cut
            if charged_s < costs[k, 0]:
                costs[k, 0], costs[k, 1] = charged_s, driven_s - cut_s_per_m[1] * cut
    return costs
