"""`headland tractor check`: what a tractor file asks for beside what the simulator drives with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from vehicle.calibration import drive_circle
from vehicle.errors import VehicleError
from vehicle.tractor import Tractor
from vehicle.trials.proving import (
    BEFORE_M,
    GROUND,
    LANE_AT_M,
    LANE_M,
    Half,
    Lane,
    Round,
    ackermann_m,
    circles,
    half_circle,
    lanes,
)
from vehicle.trials.sheets.sheet import Line, Panel, Proof, Proved, Sheet, TextTable

CIRCLE_SHARE, ACKERMANN_SHARE = 0.01, 0.35
WEAVING_CM, SETTLED_M, BEYOND_CM, OFF_M = 5.0, 30.0, 50.0, 1.0
RADII = "look at [radius]"
ASKED_COLOUR = 4
GUIDING = "look at [guidance] and at steering.rate_deg_per_s"


def proved(tractor: Tractor) -> tuple[Proved, Sheet]:
    """The verdict on a tractor file, and what there is to see of it.

    Raises VehicleError for a tractor that cannot be driven at all.
    """
    if GROUND not in tractor.radius:
        raise VehicleError(
            f"{tractor.name} has no turning radii on {GROUND}, which fields are; add [radius.{GROUND}] with right and "
            "left, usually as tight as on asphalt or up to a tenth wider."
        )
    rounds, lane, half = circles(tractor), lanes(tractor), half_circle(tractor)
    proofs = (*_circle_proofs(tractor, rounds), *_lane_proofs(lane), _half_proof(half))
    verdict = Proved(tractor.name, all(proof.good for proof in proofs), _words(tractor, proofs), proofs)
    table = TextTable(
        "Driven beside asked",
        ("Drive", "Ground", "Asked", "Driven", "Difference", "Good"),
        tuple(map(_row, proofs)),
    )
    panels = (*_circle_panels(rounds), _lane_panel(lane), _half_panel(half))
    return verdict, Sheet("proved", f"{tractor.name}, driven", verdict.words, (), panels, (table,))


def _circle_proofs(tractor: Tractor, rounds: Sequence[Round]) -> Iterator[Proof]:
    for each in rounds:
        lock = "full lock" if abs(each.steering_deg) == tractor.max_steering_deg else "half lock"
        side = "right" if each.steering_deg > 0 else "left"
        yield Proof(
            f"circle {side}, {lock}, {abs(each.steering_deg):.1f} degrees", each.ground, "m", each.asked_m,
            each.circle.radius_m, CIRCLE_SHARE * each.asked_m, RADII,
        )  # fmt: skip
    asked, ground = ackermann_m(tractor), "asphalt" if "asphalt" in tractor.radius else GROUND
    yield Proof(
        "radius at full lock, by wheelbase and wheel angle and in the file", ground, "m", asked,
        tractor.smallest_radius_m(ground), ACKERMANN_SHARE * asked,
        "look at [radius], max_steering_deg, front_axle_m and rear_axle_m: one of them does not go with the others",
    )  # fmt: skip


def _lane_proofs(lane: Lane) -> Iterator[Proof]:
    weaving, settled, beyond = 100.0 * lane.weaving_m, lane.settled_m, 100.0 * lane.beyond_m
    yield Proof("straight track, RTK: largest error", GROUND, "cm", 0.0, weaving, WEAVING_CM, GUIDING)
    yield Proof(
        f"lane {LANE_M:g} m to the right: way until it is kept to 5 cm", GROUND, "m", 0.0, settled, SETTLED_M, GUIDING
    )  # fmt: skip
    yield Proof("the same: how far beyond the lane", GROUND, "cm", 0.0, beyond, BEYOND_CM, GUIDING)


def _half_proof(half: Half) -> Proof:
    return Proof(
        f"half circle of {half.radius_m:.2f} m between tracks: how far off it", GROUND, "m", 0.0, half.off_m, OFF_M,
        "look at steering.rate_deg_per_s and guidance.turn_lookahead_m, or drive turns slower",
    )  # fmt: skip


def _row(proof: Proof) -> tuple[str, ...]:
    apart = proof.difference
    if proof.asked == 0.0:
        asked, told = f"{proof.tolerance:g} {proof.unit} or less", ""
    else:
        asked = f"{proof.asked:.2f} {proof.unit}"
        told = "" if apart is None else f"{round(100.0 * apart / proof.asked, 1) + 0.0:+.1f} %"
    driven = "not to its end" if proof.driven is None else f"{proof.driven:.2f} {proof.unit}"
    return proof.drive, proof.ground, asked, driven, told, "yes" if proof.good else "no"


def _words(tractor: Tractor, proofs: Sequence[Proof]) -> tuple[str, ...]:
    """The verdict, what to do about each drive that is not good, and what the file itself assumes."""
    wrong = [proof for proof in proofs if not proof.good]
    assumed = sorted(key for key, words in tractor.source.items() if "assumed" in words)
    first = (
        f"The file holds together: {tractor.name} drives what it asks for, at 5 km/h."
        if not wrong
        else f"The file does not hold together: {len(wrong)} of {len(proofs)} drives are not as it asks."
    )
    told = tuple(
        f"{proof.drive[0].upper()}{proof.drive[1:]} on {proof.ground}: {_row(proof)[3]} instead of {_row(proof)[2]}; "
        f"{proof.advice}."
        for proof in wrong
    )
    learnt = _learnt(tractor)
    guessed = f"Values assumed, not measured: {len(assumed)} of {len(tractor.source)}." if assumed else ""
    return (first, *told, *(text for text in (learnt, guessed) if text))


def _learnt(tractor: Tractor) -> str:
    """What effects found in logs make of the circle at full lock."""
    if not tractor.effects:
        return ""
    radius = drive_circle(tractor, tractor.max_steering_deg, GROUND).radius_m
    return (
        f"Logs taught the file: {', '.join(tractor.effects)}; with that full lock to the right drives {radius:.2f} m "
        f"on {GROUND}. Circles here are without, the other drives with it."
    )


def _circle_panels(rounds: Sequence[Round]) -> Iterator[Panel]:
    for ground in dict.fromkeys(each.ground for each in rounds):
        lines = []
        for number, each in enumerate(one for one in rounds if one.ground == ground):
            side = "right" if each.steering_deg > 0 else "left"
            label = f"{abs(each.steering_deg):.1f} degrees {side}, {each.asked_m:.2f} m asked"
            track = each.circle.track
            lines.append(Line(label, track[:, 0] - track[0, 0], track[:, 1] - track[0, 1], number))
            lines.append(_asked(each))
        yield Panel(f"Circles on {ground}; dashed: as asked", "East (m)", "North (m)", tuple(lines), equal=True)


def _asked(each: Round) -> Line:
    """The circle of the asked radius about the middle of the one that was driven in the end."""
    track = each.circle.track
    ahead = track[-1] - track[-2]
    aside = np.array([ahead[1], -ahead[0]]) / max(float(np.hypot(*ahead)), 1e-9)
    middle = track[-1] - track[0] + np.copysign(each.circle.radius_m, each.steering_deg) * aside
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    x, y = middle[0] + each.asked_m * np.cos(turn), middle[1] + each.asked_m * np.sin(turn)
    return Line("_asked", x, y, ASKED_COLOUR, dashed=True)  # in the legend the line that was driven names it


def _lane_panel(lane: Lane) -> Panel:
    far = LANE_AT_M + 2.0 * SETTLED_M
    part = lane.track[(lane.track[:, 1] > 0.0) & (lane.track[:, 1] < far)]
    path = np.array([[0.0, 0.0], [LANE_AT_M, 0.0], [LANE_AT_M, LANE_M], [far, LANE_M]])
    lines = (
        Line("driven", part[:, 1], part[:, 0], 0),
        Line("asked", path[:, 0], path[:, 1], ASKED_COLOUR, dashed=True),
    )
    return Panel(f"A lane {LANE_M:g} m to the right, on {GROUND}", "Along (m)", "To the right (m)", lines)


def _half_panel(half: Half) -> Panel:
    lines = (
        Line("driven", half.track[:, 0], half.track[:, 1], 0),
        Line("asked", half.path[:, 0], half.path[:, 1], ASKED_COLOUR, dashed=True),
    )
    title = f"A half circle of {half.radius_m:.2f} m between tracks, {BEFORE_M:g} m before it, on {GROUND}"
    return Panel(title, "East (m)", "North (m)", lines, equal=True)
