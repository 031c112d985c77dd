"""Errors in bins: nothing is lost, edges are round, and squares of a map hold what was driven in them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.pipeline.replays import MOST_VALUE_BINS, bin_errors, build_evidence, choose_edges
from vehicle.identification.logs.reader import read_log
from vehicle.model.tractor import load_tractor

VALUES = st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=200).map(np.array)


@given(VALUES)
def test_edges_hold_all_values_in_a_few_bins_of_equal_width(values: np.ndarray) -> None:
    edges = choose_edges(values)
    assert edges[0] <= values.min() + 1e-6 and edges[-1] >= values.max() - 1e-6
    assert 1 <= len(edges) - 1 <= MOST_VALUE_BINS + 1
    assert np.diff(edges) == pytest.approx(edges[1] - edges[0])


@given(VALUES, st.integers(0, 9))
def test_bins_keep_the_sum_of_squares(values: np.ndarray, seed: int) -> None:
    squares = np.random.default_rng(seed).uniform(0.0, 5.0, (len(values), 4))
    bins = bin_errors(values, squares, choose_edges(values), fewest_rows=1)
    assert bins.rows.sum() == len(values)
    for number, name in enumerate(("cross_before_cm", "cross_after_cm", "along_before_cm", "along_after_cm")):
        assert (bins.rows * getattr(bins, name) ** 2).sum() == pytest.approx(squares[:, number].sum())


def test_bins_of_few_rows_are_left_out() -> None:
    values = np.concatenate([np.full(20, 0.5), np.full(3, 1.5)])
    bins = bin_errors(values, np.ones((23, 4)), np.array([0.0, 1.0, 2.0]))
    assert bins.lows.tolist() == [0.0] and bins.highs.tolist() == [1.0] and bins.rows.tolist() == [20.0]


def test_one_tractor_twice_gives_the_same_before_and_after() -> None:
    tractor = load_tractor("eg105")
    found = build_evidence([read_log("sample")], tractor, tractor, "soil")
    np.testing.assert_array_equal(found.by_speed.cross_before_cm, found.by_speed.cross_after_cm)
    (path,) = found.paths
    np.testing.assert_array_equal(path.before_m, path.after_m)
    # The first seconds of the simulation lie on the measurement; later it drifts away.
    gaps = np.linalg.norm(path.before_m - path.measured_m, axis=1)
    assert gaps[path.time_s - path.time_s[0] <= 5.0].max() < 0.1 < 5.0 < gaps[-1]
    places = found.by_place
    east, north = path.measured_m.T
    assert places.west_m.min() <= east.min() + 1e-9 and (places.west_m + places.side_m).max() >= east.max() - 12.0
    assert places.south_m.min() <= north.min() + 12.0 and len(
        np.unique(np.stack([places.west_m, places.south_m]), axis=1).T
    ) == len(places.west_m)


def test_squares_know_the_slope_of_the_ground() -> None:
    """Ground that steepens to the east as 0.01 + 0.001 x: each square has the slope of its rows."""
    tractor, log = load_tractor("eg105"), read_log("sample")
    west = float(log.easting_m[log.used].min())
    fall = np.column_stack([-0.01 - 0.001 * (log.easting_m - west), 0.0 * log.easting_m])
    found = build_evidence([replace(log, ground_fall=fall)], tractor, tractor, "soil").by_place
    assert len(found.slopes) == len(found.west_m)
    low = 0.01 + 0.001 * (found.west_m - found.west_m.min())
    assert (found.slopes >= low - 0.002).all() and (found.slopes <= low + 0.001 * found.side_m + 0.002).all()
