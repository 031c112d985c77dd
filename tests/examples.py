"""How much is tried: fewer examples of a property where they are the same every time, as in CI, and fewer values."""

import os
from typing import Any

import pytest

SAME = "HEADLAND_TEST_SEED" in os.environ
"""Whether every run draws the same examples."""
SHARE = 5


def count_examples(fresh: int) -> int:
    """A fifth of the number where the same ones are drawn every time, as what is drawn again finds nothing new."""
    return max(fresh // SHARE, min(fresh, 5)) if SAME else fresh


def seldom(*values: Any) -> list[Any]:
    """Values of a parameter of a test that are tried in the matrix alone."""
    return [pytest.param(value, marks=pytest.mark.matrix) for value in values]
