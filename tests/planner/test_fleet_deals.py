"""Which of two sketches is composed: the one that people would rather see, unless it is clearly dearer."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from planner.evaluation.candidates.fleet_deals import TIDY_SHARE, sketch_tidily
from strategies.lines.work_line import WorkLine
from strategies.programmes.programme import Sketch
from strategies.rules.dealing import LineDeal
from vehicle.missions.plan import HEADLAND_PASS, SWATH, LegTask


def make_lines() -> list[WorkLine]:
    """The four sides of a field anticlockwise, and a track in the west and in the east."""
    corners = np.array([(0.0, 0.0), (90.0, 0.0), (90.0, 90.0), (0.0, 90.0), (0.0, 0.0)])
    paths = [corners[[number, number + 1]] for number in range(4)]
    sides = [
        WorkLine(LegTask(HEADLAND_PASS, 1, piece), (HEADLAND_PASS, 1), (path, path[::-1].copy()), 1.0)
        for piece, path in enumerate(paths)
    ]
    tracks = [np.array([(x, 10.0), (x, 80.0)]) for x in (10.0, 80.0)]
    return sides + [
        WorkLine(LegTask(SWATH, number), (SWATH, number), (path, path[::-1].copy()), 1.0)
        for number, path in enumerate(tracks)
    ]


DEAL = LineDeal(np.array([[1, 1, 1, 1, 1, 0], [1, 1, 1, 1, 0, 1]], bool))


@pytest.mark.parametrize("is_first", [True, False])
@pytest.mark.parametrize(("dearer", "is_tidy"), [(0.5, True), (1.5, False)])
def test_a_tidier_sketch_is_taken_unless_it_is_clearly_dearer(is_first: bool, dearer: float, is_tidy: bool) -> None:
    """The tours go anticlockwise on three of four sides; the start of the second tractor is not barred."""
    asked = list[tuple[Any, list[int]]]()

    def sketch(allowed: Any, barred: Any) -> Sketch:
        asked.append((allowed, list(barred)))
        is_other = len(asked) == 2
        return Sketch([[0, 2], [4, 7]], [50.0, 50.0], 100.0 * (1.0 + is_other * dearer * TIDY_SHARE))

    moves: Any = SimpleNamespace(lines=make_lines(), starts=(4,))
    found, allowed, barred = sketch_tidily(sketch, moves, DEAL, is_first=is_first)
    (free, none), (other, ways) = asked
    assert free is DEAL.allowed and none == []
    assert (other[:, :4].sum(axis=0) == 1).all() if is_first else other is DEAL.allowed
    assert ways == ([] if is_first else [1, 3, 7])
    assert (allowed is other and barred == ways) if is_tidy else (allowed is DEAL.allowed and barred == [])
    assert found.cost_s == pytest.approx(100.0 * (1.0 + is_tidy * dearer * TIDY_SHARE))


def test_without_a_tidier_way_lines_are_driven_either_way() -> None:
    moves: Any = SimpleNamespace(lines=make_lines()[4:], starts=())
    plain = Sketch([[0], [2]], [1.0, 1.0], 1.0)
    deal = LineDeal(DEAL.allowed[:, 4:])
    for is_first in (True, False):
        assert sketch_tidily(lambda *_: plain, moves, deal, is_first=is_first) == (plain, deal.allowed, [])
