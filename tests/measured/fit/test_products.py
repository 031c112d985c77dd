"""Products of tall columns against those of numpy, whatever the layout."""

import numpy as np
import pytest

from vehicle.measured.fit.products import crossed, squared, squares, without


def test_products_are_those_of_the_columns() -> None:
    rng = np.random.default_rng(2)
    one, two, left = rng.normal(size=(500, 3)), rng.normal(size=(4, 500)).T, rng.normal(size=500)
    assert crossed(one, two) == pytest.approx(one.T @ two)
    assert crossed(two, left) == pytest.approx(two.T @ left) and crossed(two, left).shape == (4,)
    assert crossed(one[:, :1], two[:, :1]) == pytest.approx(one[:, :1].T @ two[:, :1])
    assert crossed(one, two[:, :2]) == pytest.approx(one.T @ two[:, :2]), "fewer columns than the first has"
    assert squares(two) == pytest.approx(np.diag(two.T @ two))
    assert squared(left) == pytest.approx(float(left @ left))
    assert without(left, one[:, ::2], np.array([2.0, -1.0])) == pytest.approx(left - 2.0 * one[:, 0] + one[:, 2])


def test_no_columns_take_nothing_away() -> None:
    left = np.arange(4.0)
    none = np.zeros((4, 0))
    assert crossed(none, left).shape == (0,) and crossed(none, none).shape == (0, 0)
    assert np.array_equal(without(left, none, np.zeros(0)), left)
