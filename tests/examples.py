"""What tests draw: the same examples and seeds in every run on every machine, or fresh ones and more of them.

`HEADLAND_TEST_SEED=random` draws fresh ones, `HEADLAND_TEST_SEED=n` repeats the seed n that a test printed.
"""

import os
import secrets
from typing import Any

import pytest

USUAL_SEED = 20261
DRAWS_FRESH = os.environ.get("HEADLAND_TEST_SEED") == "random"
SHARE = 5
"""Of the examples that are worth drawing afresh, every fifth is tried where the same ones are drawn each time."""


def draw_seed() -> int:
    """The seed of a test, printed so that it can be repeated."""
    given = os.environ.get("HEADLAND_TEST_SEED") or str(USUAL_SEED)
    seed = secrets.randbits(32) if DRAWS_FRESH else int(given)
    print(f"HEADLAND_TEST_SEED={seed}")
    return seed


def count_examples(fresh: int) -> int:
    """How many of so many fresh examples are tried: a fifth where the same ones are drawn in every run."""
    return fresh if DRAWS_FRESH else max(fresh // SHARE, min(fresh, 5))


def seldom(*values: Any) -> list[Any]:
    """Values of a parameter of a test that are tried in the matrix alone."""
    return [pytest.param(value, marks=pytest.mark.matrix) for value in values]
