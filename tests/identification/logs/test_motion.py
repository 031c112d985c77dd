"""What positions alone say, against the circle they lie on."""

import math

import numpy as np
import pytest

from tests.identification.analytic_drives import SPEED_MPS, circle, log
from vehicle.identification.logs.motion import compute_path_chords


@pytest.mark.parametrize("curvature", [0.1, -0.05, 0.0])
def test_speed_and_curvature_of_a_circle(curvature: float) -> None:
    chords = compute_path_chords(log(circle(curvature)))
    assert chords is not None
    assert chords.speed == pytest.approx(np.full(len(chords.row), SPEED_MPS), rel=0.01)
    assert chords.curvature == pytest.approx(np.full(len(chords.row), curvature), rel=0.01, abs=1e-9)


def test_the_course_is_clockwise_from_north() -> None:
    chords = compute_path_chords(log(circle(0.0, bearing_deg=120.0)))
    assert chords is not None and chords.course == pytest.approx(np.full(len(chords.row), math.radians(120.0)))


def test_tighter_bends_get_shorter_chords() -> None:
    wide, tight = compute_path_chords(log(circle(0.05))), compute_path_chords(log(circle(0.8)))
    assert wide is not None and tight is not None and wide.span_s == 2.0 > tight.span_s


def test_a_log_of_a_moment_has_no_chords() -> None:
    assert compute_path_chords(log(circle(0.0, seconds=0.3))) is None
