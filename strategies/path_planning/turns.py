"""Turns from the end of one swath to the start of a parallel one, in closed form, and the headland they need.

With spacing d and turning radius R, for swath ends that lie side by side ("aligned"):

- u: quarter arc, straight, quarter arc; d >= 2R; length pi R + d - 2R, depth R.
- omega: swings out first; d < 2R; length R (pi + 4 acos((d/2 + R) / 2R)), depth R + sqrt(4R^2 - (R + d/2)^2).
- switch-back: forward, reverse, forward, all on arcs; d <= 2R; length pi R, depth R sin(acos(1/2 - d/4R)).
- fishtail: quarter arc forward, straight reverse, quarter arc forward; d <= 2R; length pi R + 2R - d, depth R.

The omega and the U are the Dubins paths RLR and LSL, the switch-back is the Reeds-Shepp path C|C|C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from strategies.path_planning.paths import DrivePath, PathSegment, Pose, TurnError, merge_segments, require_radius
from strategies.path_planning.turn_kinds import TURN_KINDS

_PARALLEL_RAD = 1e-6
_SAME_M = 1e-9


def build_u_turn(a: Pose, b: Pose, radius_m: float) -> DrivePath | None:
    """Arc, straight, arc from swath end a to swath start b; None if the spacing is below two radii.

    Ends that are not side by side are brought level by driving straight on along the shorter swath. Raises TurnError
    for a radius that is not positive or swaths that are not opposite in heading.
    """
    spacing, hand = _measure_spacing_m(a, b, radius_m)
    if spacing < 2.0 * radius_m - _SAME_M:
        return None
    quarter = PathSegment(0.5 * math.pi * radius_m, hand / radius_m, 1)
    across = PathSegment(max(0.0, spacing - 2.0 * radius_m), 0.0, 1)
    return _level_ends(a, b, (quarter, across, quarter), "u")


def build_omega_turn(a: Pose, b: Pose, radius_m: float) -> DrivePath | None:
    """Bulb-shaped turn that swings out to the far side first; None if the spacing is two radii or more.

    Brings ends level and raises as `build_u_turn`.
    """
    spacing, hand = _measure_spacing_m(a, b, radius_m)
    if spacing >= 2.0 * radius_m:
        return None
    out = math.acos(min(1.0, (0.5 * spacing + radius_m) / (2.0 * radius_m)))
    swing = PathSegment(out * radius_m, -hand / radius_m, 1)
    bulb = PathSegment((math.pi + 2.0 * out) * radius_m, hand / radius_m, 1)
    return _level_ends(a, b, (swing, bulb, swing), "omega")


def build_switch_back(a: Pose, b: Pose, radius_m: float) -> DrivePath | None:
    """Forward arc, reverse arc, forward arc; None if the spacing is above two radii.

    Above two radii the reverse arc would have to turn the heading back. Brings ends level and raises as `build_u_turn`.
    """
    spacing, hand = _measure_spacing_m(a, b, radius_m)
    if spacing > 2.0 * radius_m:
        return None
    first = _compute_switch_back_arc_rad(spacing, radius_m)
    forward = PathSegment(first * radius_m, hand / radius_m, 1)
    reverse = PathSegment((math.pi - 2.0 * first) * radius_m, -hand / radius_m, -1)
    return _level_ends(a, b, (forward, reverse, forward), "switch-back")


def build_fishtail(a: Pose, b: Pose, radius_m: float) -> DrivePath | None:
    """Quarter arc forward, straight reverse, quarter arc forward; None if the spacing is above two radii.

    Brings ends level and raises as `build_u_turn`. The kind is "switch-back": it has the same two direction changes.
    """
    spacing, hand = _measure_spacing_m(a, b, radius_m)
    if spacing > 2.0 * radius_m:
        return None
    quarter = PathSegment(0.5 * math.pi * radius_m, hand / radius_m, 1)
    back = PathSegment(2.0 * radius_m - spacing, 0.0, -1)
    return _level_ends(a, b, (quarter, back, quarter), "switch-back")


def compute_turn_depth_m(kind: str, spacing_m: float, radius_m: float) -> float:
    """How far beyond aligned swath ends the path of the turn reaches (m).

    From two radii of spacing on, every kind is the plain U and reaches one radius. Raises TurnError for an unknown
    kind, a negative spacing, a radius that is not positive, or a U-turn over less than two radii.
    """
    require_radius(radius_m)
    if kind not in TURN_KINDS:
        raise TurnError(f'Turn kind "{kind}" is unknown; use one of {", ".join(TURN_KINDS)}.')
    if not (math.isfinite(spacing_m) and spacing_m >= 0.0):
        raise TurnError(
            f"Track spacing {spacing_m} m must be zero or more and finite; give the distance between the tracks."
        )
    if spacing_m >= 2.0 * radius_m:
        return radius_m
    if kind == "omega":
        return radius_m + math.sqrt(4.0 * radius_m**2 - (radius_m + 0.5 * spacing_m) ** 2)
    if kind == "switch-back":
        return radius_m * math.sin(_compute_switch_back_arc_rad(spacing_m, radius_m))
    raise TurnError(
        f"A U-turn over {spacing_m} m does not exist with a turning radius of {radius_m} m; "
        f"space the tracks {2.0 * radius_m} m or more apart, or use an omega or a switch-back."
    )


def _compute_switch_back_arc_rad(spacing_m: float, radius_m: float) -> float:
    """Angle of the first arc of the switch-back over aligned ends (rad)."""
    return math.acos(0.5 - spacing_m / (4.0 * radius_m))


def _measure_spacing_m(a: Pose, b: Pose, radius_m: float) -> tuple[float, int]:
    """Distance between the swaths and the hand b lies to (1 left, -1 right); raises TurnError as `build_u_turn`."""
    require_radius(radius_m)
    if abs(math.remainder(b[2] - a[2] - math.pi, 2.0 * math.pi)) > _PARALLEL_RAD:
        change = abs(math.degrees(math.remainder(b[2] - a[2], 2.0 * math.pi)))
        raise TurnError(f"Headings {change:.3f} deg apart make no turn between tracks; they must be opposite.")
    left_m = (b[1] - a[1]) * math.cos(a[2]) - (b[0] - a[0]) * math.sin(a[2])
    return abs(left_m), -1 if left_m < 0.0 else 1


def _level_ends(a: Pose, b: Pose, turn: tuple[PathSegment, ...], kind: str) -> DrivePath:
    """The turn after driving straight until the ends are level, or before driving straight to b."""
    ahead_m = (b[0] - a[0]) * math.cos(a[2]) + (b[1] - a[1]) * math.sin(a[2])
    before = PathSegment(max(0.0, ahead_m), 0.0, 1)
    after = PathSegment(max(0.0, -ahead_m), 0.0, 1)
    return merge_segments(a, (before, *turn, after), kind)


HEADLAND_STEP_M = 0.5


@dataclass(frozen=True)
class TurnReach:
    """What a turn needs beyond its own depth (m).

    `tool_m`: how far the implement works behind the guided point, which must drive on to finish the swath. `margin_m`:
    how far the tractor or its implement, whichever is wider, reaches to either side of the guided point.
    """

    tool_m: float
    margin_m: float


def list_allowed_kinds(turn: str) -> tuple[str, ...]:
    """The kinds of turn allowed by an option "auto" or a kind; the plain U is always allowed where it fits."""
    return TURN_KINDS if turn == "auto" else tuple(dict.fromkeys(("u", turn)))


def compute_headland_m(turn: str, width_m: float, radius_m: float, reach: TurnReach) -> float:
    """Depth of headland in which the turn to a neighbouring swath fits (m), rounded up to half a metre.

    "auto" is sized for the switch-back, the shallowest.
    """
    kind = turn if turn in ("omega", "switch-back") else "switch-back"
    depth = max(compute_turn_depth_m(kind, min(width_m, 2.0 * radius_m), radius_m), radius_m)
    return math.ceil((reach.tool_m + depth + reach.margin_m) / HEADLAND_STEP_M) * HEADLAND_STEP_M


def compute_available_turn_depth_m(headland_m: float, reach: TurnReach) -> float:
    """What a headland met squarely leaves for the depth of a turn (m); negative if it is too shallow for any."""
    return headland_m - reach.tool_m - reach.margin_m
