"""The ways of a move that the ground leaves."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fields.arrays import Floats, Integers
from strategies.moves.closed_forms import (
    CURVED_REVERSE_S,
    LEADS_IN_M,
    LEADS_OUT_M,
    list_closed_forms,
    measure_backing_up,
    pick_with_room,
    weigh_forms,
)
from strategies.moves.move import Move
from strategies.moves.search import has_way_on, measure_remaining_m, search_move, shorten_rows
from strategies.path_planning.paths import PATH_KINDS, Pose, place_in_frame, shift_pose_ahead
from strategies.site.site import Site

MOVE_MARGIN_M = 0.10  # room kept on planned moves; a drive errs by about as much
WIDER_RADIUS = 1.25  # of the planned one: some arcs at the smallest radius are not followed well enough
MOST_FORMS, MOST_OPTIONS = 60, 6  # closed forms tried for a pair, and those with room that are kept
MOST_POSES = 1500  # expanded by a search
POCKET_POSES = 400  # a place from which fewer are reached is a pocket that nothing leads out of
PLAIN_LEADS = 3  # of the leads are tried first, and the others where none of these has room


@dataclass(eq=False)
class MoveFinder:
    """Finds moves between poses on a site; closed forms are kept by relative pose, as most of a field's are alike.

    `settling` (2, k) are metres driven straight after an arc, and the charge for beginning a line then.
    """

    site: Site
    settling: Floats
    radii: Floats = field(init=False)
    _forms: dict[tuple[float, float, float, int], tuple[Floats, Integers]] = field(default_factory=dict)
    _ways: dict[tuple[Pose, bool], bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        radius = self.site.rules.radius_m
        self.radii = np.array([radius, WIDER_RADIUS * radius])

    @property
    def costs(self) -> tuple[Floats, Floats]:
        """What driving costs, and beginning a line, as compiled functions take it."""
        return self.site.rules.turn_costs, self.settling

    def _get_body(self, is_folded: bool = False) -> Any:
        body, ground = self.site.get_body(is_folded), self.site.ground
        return body.guide_m, body.points, body.reach_m, ground.grid, ground.frame, MOVE_MARGIN_M

    def list_moves(
        self,
        a: Pose,
        b: Pose,
        *,
        leads: bool = True,
        most: int = MOST_OPTIONS,
        is_folded: bool = False,
        passes: int | None = None,
    ) -> list[Move]:
        """The quickest closed forms from a to b on which the body has room; without `leads` arcs may begin at once.

        `passes` of the headland are worked then, all by default: what stands is charged (Site.get_kept).
        """
        place, start, kept = place_in_frame(a, b), np.array(a), self.site.get_kept(passes)
        body = self._get_body(is_folded)
        forms, kinds = self._get_forms(place, PLAIN_LEADS if leads else 1)
        numbers = pick_with_room(start, forms, most, *body)
        if leads and not len(numbers):
            forms, kinds = self._get_forms(place, len(LEADS_OUT_M))
            numbers = pick_with_room(start, forms, most, *body)
        weights = weigh_forms(start, forms, numbers, *self.costs, kept)
        return [
            Move(a, forms[k], PATH_KINDS[kinds[k]], *seconds)
            for k, seconds in zip(numbers.tolist(), weights.tolist(), strict=True)
        ]

    def list_folded_moves(self, a: Pose, b: Pose, passes: int | None = None) -> list[Move]:
        """Moves with the implement folded, in closed form, else by search; none where it does not fold.

        To unfold beside an edge a machine has to stand straight: some drive on along the line of b and back up to it.
        """
        site = self.site
        if site.folded is None:
            return []
        found = self._find_folded(a, b, passes)
        if site.allowed_kinds[3]:
            on_m = site.rules.radius_m  # as far again the tractor needs to come into line with its implement
            straighten = np.array([[on_m, 0.0, 1.0], [2.0 * on_m, 0.0, -1.0]])
            beyond = self._find_folded(a, shift_pose_ahead(b, on_m), passes)
            found += [self._build_move(a, np.concatenate((one.rows, straighten)), one.kind, passes) for one in beyond]
        return [replace(move, drive_s=move.drive_s + 2.0 * site.get_fold_s(True), is_folded=True) for move in found]

    def _find_folded(self, a: Pose, b: Pose, passes: int | None) -> list[Move]:
        found = self.list_moves(a, b, is_folded=True, passes=passes)
        searched = None if found else self.search(a, b, passes, is_folded=True)
        return found if searched is None else [searched]

    def _build_move(self, a: Pose, rows: Floats, kind: str, passes: int | None = None) -> Move:
        """The move of rows (k, 3) from a, with its seconds and charges."""
        only, kept = np.zeros(1, np.int64), self.site.get_kept(passes)
        drive_s, charge_s, settling_s = weigh_forms(np.array(a), rows[None], only, *self.costs, kept)[0].tolist()
        max_reverse_m = self.site.rules.max_reverse_m
        charge_s += CURVED_REVERSE_S * max(0.0, measure_backing_up(rows, 0.0) / max_reverse_m - 1.0)
        return Move(a, rows, kind, drive_s, charge_s, settling_s)

    def search(self, a: Pose, b: Pose, passes: int | None = None, *, is_folded: bool = False) -> Move | None:
        """The move that a search finds; far reversing and wheels on kept ground are charged. `passes` as in
        `list_moves`."""
        start, goal, max_reverse_m = np.array(a), np.array(b), self.site.rules.max_reverse_m
        how = self.radii[:1], *self.costs, self.site.allowed_kinds, max_reverse_m
        body, kept = self._get_body(is_folded), self.site.get_kept(passes)
        least_m = min(half for _, _, half in self.site.rules.boxes)  # no machine gets through less
        ground, radius_m, speed_mps = self.site.ground, float(self.radii[0]), self.site.rules.turn_speed_mps
        remaining = measure_remaining_m(start, goal, least_m, radius_m, speed_mps, kept, ground.grid, ground.frame)
        far_s_per_m = CURVED_REVERSE_S / max_reverse_m
        rows = search_move(start, goal, remaining, *how, far_s_per_m, kept, MOST_POSES, body)
        if not len(rows):
            return None
        return self._build_move(a, shorten_rows(start, rows, *how, kept, body), "route", passes)

    def has_way_on(self, pose: Pose, *, backwards: bool) -> bool:
        """Whether more than a pocket of ground is reached from a pose, or `backwards` reaches it; kept."""
        both = bool(self.site.allowed_kinds[3])
        key = pose, backwards and not both
        if key not in self._ways:
            gears = np.array([1.0, -1.0]) if both else np.array([-1.0 if backwards else 1.0])
            radius_m = float(self.radii[0])
            self._ways[key] = bool(has_way_on(np.array(pose), gears, radius_m, POCKET_POSES, *self._get_body()))
        return self._ways[key]

    def _get_forms(self, place: tuple[float, float, float], leads: int) -> tuple[Floats, Integers]:
        """The closed forms to a place with the first so many leads, none but zero for one."""
        key = (*place, leads)
        if key not in self._forms:
            none, site = np.zeros(1), self.site
            outs, ins = (LEADS_OUT_M[:leads], LEADS_IN_M[:leads]) if leads > 1 else (none, none)
            goal, kinds = np.array(place), site.allowed_kinds
            forms, _, form_kinds = list_closed_forms(
                goal, self.radii, *self.costs, outs, ins, kinds, 0.0, site.rules.max_reverse_m, np.inf, MOST_FORMS
            )
            self._forms[key] = forms, form_kinds
        return self._forms[key]
