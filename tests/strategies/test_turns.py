"""Turns between two parallel tracks against their closed forms, and the headland sized for them.

With spacing d and turning radius R: a U is pi R + d - 2R long and R deep; an omega R (pi + 4 acos((d/2 + R) / 2R)) long
and R + sqrt(4R^2 - (R + d/2)^2) deep; three arcs pi R long and R sin(acos(1/2 - d/4R)) deep; arc, straight in reverse,
arc pi R + 2R - d long and R deep.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies.path_planning.turns import (
    compute_headland_m,
    list_allowed_kinds,
    list_turns,
    measure_turn_depth_m,
)

R = 4.0
RADII = st.floats(1.0, 12.0)
SHARES = st.floats(0.01, 1.99)
TOOL_M, MARGIN_M = 2.3, 1.5


@given(RADII, SHARES)
def test_closed_forms_below_two_radii(radius: float, share: float) -> None:
    spacing = share * radius
    omega, three_arcs, fishtail = list_turns(spacing, radius)
    assert [turn.kind for turn in (omega, three_arcs, fishtail)] == ["omega", "switch-back", "switch-back"]
    assert [turn.reversals for turn in (omega, three_arcs, fishtail)] == [0, 2, 2]
    out = math.acos((0.5 * spacing + radius) / (2.0 * radius))
    assert omega.length_m == pytest.approx(radius * (math.pi + 4.0 * out), abs=1e-7)
    assert three_arcs.length_m == pytest.approx(math.pi * radius, abs=1e-7)
    assert fishtail.length_m == pytest.approx(math.pi * radius + 2.0 * radius - spacing, abs=1e-7)
    depths = radius * (1.0 + 2.0 * math.sin(out)), radius * math.sin(math.acos(0.5 - 0.25 * share)), radius
    for turn, depth in zip((omega, three_arcs, fishtail), depths, strict=True):
        assert measure_turn_depth_m(turn) == pytest.approx(depth, abs=2e-3)


@given(RADII, st.floats(2.0, 9.0))
def test_from_two_radii_on_there_is_only_the_u(radius: float, share: float) -> None:
    (turn,) = list_turns(share * radius, radius)
    assert turn.kind == "u" and turn.reversals == 0
    assert turn.length_m == pytest.approx(math.pi * radius + (share - 2.0) * radius, abs=1e-9)
    assert measure_turn_depth_m(turn) == pytest.approx(radius, abs=2e-3)


@given(RADII, st.floats(0.01, 9.0))
def test_every_turn_ends_on_the_next_track_and_stays_in_front(radius: float, share: float) -> None:
    for turn in list_turns(share * radius, radius):
        assert turn.end == pytest.approx((share * radius, 0.0, -0.5 * math.pi), abs=1e-7)
        assert min(float(points[:, 1].min()) for _, points in turn.sample()) >= -1e-7


def test_headland_by_hand() -> None:
    # All but the omega are R = 4.3 m deep: 2.3 + 4.3 + 1.5 = 8.1, so 8.5 m.
    assert [compute_headland_m(turn, 3.0, 4.3, TOOL_M, MARGIN_M) for turn in ("auto", "u", "switch-back")] == [8.5] * 3
    # Omega over 3 m: R + sqrt(4R^2 - (R + 1.5)^2) = 4.3 + 6.35; with 3.8 that is 14.45, so 14.5 m.
    assert compute_headland_m("omega", 3.0, 4.3, TOOL_M, MARGIN_M) == 14.5


@pytest.mark.parametrize("kind", ["omega", "switch-back"])
@pytest.mark.parametrize("width_m", [2.0, 3.0, 5.0, 12.0])
def test_headland_fits_its_turn_and_half_a_metre_less_would_not(kind: str, width_m: float) -> None:
    headland = compute_headland_m(kind, width_m, R, TOOL_M, MARGIN_M)
    needed = max(measure_turn_depth_m(turn) for turn in list_turns(width_m, R) if turn.kind in ("u", kind))
    assert needed <= headland - TOOL_M - MARGIN_M + 1e-9
    assert needed > headland - 0.5 - TOOL_M - MARGIN_M


def test_a_plain_u_is_allowed_beside_what_is_asked_for() -> None:
    assert list_allowed_kinds("auto") == ("u", "omega", "switch-back")
    assert list_allowed_kinds("omega") == ("u", "omega") and list_allowed_kinds("u") == ("u",)
