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


@pytest.mark.parametrize(("dearer", "is_tidy"), [(0.5, True), (1.5, False)])
def test_a_tidier_sketch_is_taken_unless_it_is_clearly_dearer(dearer: float, is_tidy: bool) -> None:
    asked = list[Any]()

    def sketch(allowed: Any) -> Sketch:
        asked.append(allowed)
        return Sketch([[0, 2], [4, 7]], [50.0, 50.0], 100.0 * (1.0 + (len(asked) == 2) * dearer * TIDY_SHARE))

    moves: Any = SimpleNamespace(lines=make_lines(), starts=(4,))
    found, allowed = sketch_tidily(sketch, moves, DEAL)
    free, other = asked
    assert free is DEAL.allowed and (other[:, :4].sum(axis=0) == 1).all()
    assert allowed is (other if is_tidy else DEAL.allowed)
    assert found.cost_s == pytest.approx(100.0 * (1.0 + is_tidy * dearer * TIDY_SHARE))


def test_without_a_tidier_deal_lines_are_dealt_as_they_are() -> None:
    moves: Any = SimpleNamespace(lines=make_lines()[4:], starts=())
    plain = Sketch([[0], [2]], [1.0, 1.0], 1.0)
    deal = LineDeal(DEAL.allowed[:, 4:])
    assert sketch_tidily(lambda _: plain, moves, deal) == (plain, deal.allowed)
