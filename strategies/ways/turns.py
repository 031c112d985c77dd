"""Turns from the end of one track to the start of a parallel one, in closed form.

With spacing d and turning radius R, for track ends that lie side by side ("aligned"):

- u: quarter arc, straight, quarter arc; d >= 2R; length pi R + d - 2R, depth R.
- omega: swings out first; d < 2R; length R (pi + 4 acos((d/2 + R) / 2R)), depth R + sqrt(4R^2 - (R + d/2)^2).
- switch-back: forward, reverse, forward, all on arcs; d <= 2R; length pi R, depth R sin(acos(1/2 - d/4R)).
- fishtail: quarter arc forward, straight reverse, quarter arc forward; d <= 2R; length pi R + 2R - d, depth R.

The omega and the U are the Dubins words RLR and LSL, the switch-back is the Reeds-Shepp word C|C|C.
"""

import math

from strategies.ways.paths import Path, Pose, Segment, TurnError, make_path, require_radius

TURN_KINDS = ("u", "omega", "switch-back")

_PARALLEL_RAD = 1e-6
_SAME_M = 1e-9


def u_turn(a: Pose, b: Pose, radius_m: float) -> Path | None:
    """Arc, straight, arc from track end a to track start b; None when the spacing is below two radii.

    Ends that are not side by side are brought level by driving straight on along the shorter track. Raises
    TurnError for a radius that is not positive or tracks that are not opposite in heading.
    """
    spacing, hand = _spacing(a, b, radius_m)
    if spacing < 2.0 * radius_m - _SAME_M:
        return None
    quarter = Segment(0.5 * math.pi * radius_m, hand / radius_m, 1)
    across = Segment(max(0.0, spacing - 2.0 * radius_m), 0.0, 1)
    return _level(a, b, (quarter, across, quarter), "u")


def omega_turn(a: Pose, b: Pose, radius_m: float) -> Path | None:
    """Bulb-shaped turn that swings out to the far side first; None when the spacing is two radii or more.

    Straightens skewed ends and raises as `u_turn`.
    """
    spacing, hand = _spacing(a, b, radius_m)
    if spacing >= 2.0 * radius_m:
        return None
    out = math.acos(min(1.0, (0.5 * spacing + radius_m) / (2.0 * radius_m)))
    swing = Segment(out * radius_m, -hand / radius_m, 1)
    bulb = Segment((math.pi + 2.0 * out) * radius_m, hand / radius_m, 1)
    return _level(a, b, (swing, bulb, swing), "omega")


def switch_back(a: Pose, b: Pose, radius_m: float) -> Path | None:
    """Forward arc, reverse arc, forward arc; None when the spacing is above two radii.

    Above two radii the reverse arc would have to turn the heading back, so the turn is no longer one.
    Straightens skewed ends and raises as `u_turn`.
    """
    spacing, hand = _spacing(a, b, radius_m)
    if spacing > 2.0 * radius_m:
        return None
    first = _switch_back_arc(spacing, radius_m)
    forward = Segment(first * radius_m, hand / radius_m, 1)
    reverse = Segment((math.pi - 2.0 * first) * radius_m, -hand / radius_m, -1)
    return _level(a, b, (forward, reverse, forward), "switch-back")


def fishtail(a: Pose, b: Pose, radius_m: float) -> Path | None:
    """Quarter arc forward, straight reverse, quarter arc forward; None when the spacing is above two radii.

    Straightens skewed ends and raises as `u_turn`. The kind is "switch-back", as it has the same two cusps.
    """
    spacing, hand = _spacing(a, b, radius_m)
    if spacing > 2.0 * radius_m:
        return None
    quarter = Segment(0.5 * math.pi * radius_m, hand / radius_m, 1)
    back = Segment(2.0 * radius_m - spacing, 0.0, -1)
    return _level(a, b, (quarter, back, quarter), "switch-back")


def turn_depth(kind: str, spacing_m: float, radius_m: float) -> float:
    """How far beyond aligned track ends the path of the turn reaches (m).

    From two radii of spacing on, every kind is the plain U and reaches one radius. Raises TurnError for an
    unknown kind, a negative spacing, a radius that is not positive, or a U asked for below two radii.
    """
    require_radius(radius_m)
    if kind not in TURN_KINDS:
        raise TurnError(f'Turn kind "{kind}" is not known; use one of {", ".join(TURN_KINDS)}.')
    if not (math.isfinite(spacing_m) and spacing_m >= 0.0):
        raise TurnError(f"Track spacing {spacing_m} m must be zero or more and finite; give the distance between.")
    if spacing_m >= 2.0 * radius_m:
        return radius_m
    if kind == "omega":
        return radius_m + math.sqrt(4.0 * radius_m**2 - (radius_m + 0.5 * spacing_m) ** 2)
    if kind == "switch-back":
        return radius_m * math.sin(_switch_back_arc(spacing_m, radius_m))
    raise TurnError(
        f"A U-turn over {spacing_m} m does not exist with a turning radius of {radius_m} m; "
        f"space the tracks {2.0 * radius_m} m or more apart, or use an omega or a switch-back."
    )


def _switch_back_arc(spacing_m: float, radius_m: float) -> float:
    """Angle of the first arc of the switch-back over aligned ends (rad)."""
    return math.acos(0.5 - spacing_m / (4.0 * radius_m))


def _spacing(a: Pose, b: Pose, radius_m: float) -> tuple[float, int]:
    """Distance between the tracks and the hand b lies to (1 left, -1 right), after checking both."""
    require_radius(radius_m)
    if abs(math.remainder(b[2] - a[2] - math.pi, 2.0 * math.pi)) > _PARALLEL_RAD:
        change = abs(math.degrees(math.remainder(b[2] - a[2], 2.0 * math.pi)))
        raise TurnError(f"Headings {change:.3f} deg apart do not make a turn between tracks; they must be opposite.")
    left = (b[1] - a[1]) * math.cos(a[2]) - (b[0] - a[0]) * math.sin(a[2])
    return abs(left), -1 if left < 0.0 else 1


def _level(a: Pose, b: Pose, turn: tuple[Segment, ...], kind: str) -> Path:
    """The turn after driving straight until the ends are level, or before driving straight to b."""
    on = (b[0] - a[0]) * math.cos(a[2]) + (b[1] - a[1]) * math.sin(a[2])
    before = Segment(max(0.0, on), 0.0, 1)
    after = Segment(max(0.0, -on), 0.0, 1)
    return make_path(a, (before, *turn, after), kind)
