"""Products of tall columns against those of numpy, whatever the layout."""

import numpy as np
import pytest

from vehicle.measured.fit.products import crossed, squared, without


def test_products_are_those_of_the_columns() -> None:
    rng = np.random.default_rng(2)
    one, two, left = rng.normal(size=(500, 3)), rng.normal(size=(4, 500)).T, rng.normal(size=500)
    assert crossed(one, two) == pytest.approx(one.T @ two)
    assert crossed(two, left) == pytest.approx(two.T @ left) and crossed(two, left).shape == (4,)
    assert squared(left) == pytest.approx(float(left @ left))
    assert without(left, one[:, ::2], np.array([2.0, -1.0])) == pytest.approx(left - 2.0 * one[:, 0] + one[:, 2])


def test_no_columns_take_nothing_away() -> None:
    left = np.arange(4.0)
    none = np.zeros((4, 0))
    assert crossed(none, left).shape == (0,) and crossed(none, none).shape == (0, 0)
    assert np.array_equal(without(left, none, np.zeros(0)), left)
