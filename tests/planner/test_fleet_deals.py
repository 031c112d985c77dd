"""Which of two deals of lines is sketched further: the tidier one, unless it is clearly dearer."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from planner.evaluation.candidates.fleet_deals import sketch_tidily
from reports.common.plan_results import MODEL_ERROR_SHARE
from strategies.lines.work_line import WorkLine
from strategies.programmes.programme import Sketch
from vehicle.missions.plan import HEADLAND_PASS, LegTask

ALL, OWN = np.ones((2, 4), bool), np.array([[1, 1, 0, 0], [0, 0, 1, 1]], bool)


def make_ring() -> list[WorkLine]:
    corners = np.array([(0.0, 0.0), (90.0, 0.0), (90.0, 90.0), (0.0, 90.0), (0.0, 0.0)])
    sides = [corners[[number, number + 1]] for number in range(4)]
    return [
        WorkLine(LegTask(HEADLAND_PASS, 1, piece), (HEADLAND_PASS, 1), (path, path[::-1].copy()), 1.0)
        for piece, path in enumerate(sides)
    ]


@pytest.mark.parametrize(("dearer", "is_tidy"), [(0.5, True), (1.5, False)])
def test_a_tidier_deal_is_taken_unless_it_is_clearly_dearer(dearer: float, is_tidy: bool) -> None:
    """The tours without it go one way on three of four sides; the start of the second tractor is not barred."""
    asked = []

    def sketch(allowed: Any, barred: Any) -> Sketch:
        asked.append((allowed, list(barred)))
        cost_s = 100.0 * (1.0 + dearer * MODEL_ERROR_SHARE) if len(barred) else 100.0
        return Sketch([[0, 2], [4, 7]], [50.0, 50.0], cost_s)

    moves: Any = SimpleNamespace(lines=make_ring(), starts=(4,))
    found, allowed, barred = sketch_tidily(sketch, moves, ALL, OWN)
    assert asked == [(ALL, []), (OWN, [1, 3, 7])]
    assert (allowed is OWN) is is_tidy and barred == ([1, 3, 7] if is_tidy else [])
    assert found.cost_s == pytest.approx(100.0 * (1.0 + dearer * MODEL_ERROR_SHARE * is_tidy))


def test_without_a_tidier_deal_lines_are_driven_either_way() -> None:
    moves: Any = SimpleNamespace(lines=make_ring(), starts=())
    plain = Sketch([[0], [2]], [1.0, 1.0], 1.0)
    assert sketch_tidily(lambda *_: plain, moves, ALL, None) == (plain, ALL, [])
