"""What the quickest moves between many poses cost, in closed form with the body, compiled as one."""

from __future__ import annotations

import math

import numpy as np

from strategies.moves.closed_forms import list_closed_forms, pick_with_room, weigh_forms
from vehicle.jit import compile_function

FEW_FORMS, MORE_FORMS = 24, 60  # closed forms tried for a pair, without leads and with them


@compile_function
def _find_cost(a, b, forms, body, site, kept) -> float:  # type: ignore[no-untyped-def]
    """Seconds and charges of the first of the forms (n, m, 3) from pose a on which the body has room."""
    guide, points, reach, grid, frame, margin = body
    numbers = pick_with_room(a, forms, 1, guide, points, reach, grid, frame, margin)
    if len(numbers) == 0:
        return np.inf
    kept_grid, kept_frame, wheels_s_per_m = kept
    seconds, charges = weigh_forms(a, forms, numbers, site, kept_grid, kept_frame, wheels_s_per_m)
    return seconds[0] + charges[0]  # type: ignore[no-any-return]


@compile_function
def compute_move_costs(ends, begins, pairs, radii, leads_out, leads_in, speeds, allowed_kinds, body, kept):  # type: ignore[no-untyped-def]
    """Seconds with charges (k,) of the quickest closed form with room for pairs (k, 2) of ends and begins (n, 3).

    The first of the leads is tried alone, and all of them where it has no room; infinite where nothing has. `body` is
    what pick_with_room takes, `kept` the ground of swaths (grid, frame) and what wheels there are charged (s/m).
    """
    costs, b = np.empty(len(pairs)), np.empty(3)
    for k in range(len(pairs)):
        a, goal = ends[pairs[k, 0]], begins[pairs[k, 1]]
        dx, dy, cosine, sine = goal[0] - a[0], goal[1] - a[1], math.cos(a[2]), math.sin(a[2])
        b[0], b[1] = dx * cosine + dy * sine, dy * cosine - dx * sine
        b[2] = (goal[2] - a[2] + math.pi) % (2.0 * math.pi) - math.pi
        costs[k] = np.inf
        for count, most in ((1, FEW_FORMS), (len(leads_out), MORE_FORMS)):
            outs, ins = leads_out[:count], leads_in[:count]
            forms, _, _ = list_closed_forms(b, radii, speeds, outs, ins, allowed_kinds, most)
            costs[k] = _find_cost(a, b, forms, body, speeds, kept)
            if costs[k] < np.inf:
                break
    return costs
