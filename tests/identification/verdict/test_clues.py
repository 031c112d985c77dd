"""A hint on where errors are larger is told only where they are much larger there, and says where."""

from __future__ import annotations

import numpy as np
import pytest

from vehicle.identification.laws.bases import RunClock
from vehicle.identification.logs.schema import Array
from vehicle.identification.verdict.hints import (
    _WHERE_WORDS,
    _choose_clue,
    _compare_thirds,
    _describe_clue,
    list_quantities,
)

RNG = np.random.default_rng(5)
BLOCKS = 60
QUANTITIES = {"speed": RNG.uniform(0.5, 3.0, BLOCKS), "the implement": (np.arange(BLOCKS) % 2).astype(np.float64),
              "the size of the wheel angle": RNG.uniform(0.0, 30.0, BLOCKS)}  # fmt: skip


def make_energy(name: str, times: float) -> Array:
    """Squared errors of blocks that grow with a quantity so many times from its smallest to its largest value."""
    values = QUANTITIES[name]
    share = (values - values.min()) / np.ptp(values)
    return RNG.uniform(0.9, 1.1, BLOCKS) * (1.0 + (times - 1.0) * share) ** 2


@pytest.mark.parametrize(
    ("name", "times", "said"),
    [
        ("the implement", 4.0, "times as large with the implement working as with the implement lifted"),
        ("the implement", 0.25, "times as large with the implement lifted as with the implement working"),
        ("the size of the wheel angle", 8.0, "times as large in tight bends as near straight ahead"),
    ],
)
def test_a_clue_says_where_errors_are_larger(name: str, times: float, said: str) -> None:
    clue = _choose_clue("heading", make_energy(name, times), QUANTITIES)
    assert clue is not None and clue.depends_on == name
    words = _describe_clue(clue).words
    assert words.startswith("Errors of the headings are ") and said in words and "go together" not in words


def test_small_differences_and_the_share_of_a_speed_sensor_are_no_clue() -> None:
    assert _choose_clue("heading", make_energy("the implement", 1.6), QUANTITIES) is None
    assert _choose_clue("speed", make_energy("speed", 6.0), QUANTITIES) is None
    assert _choose_clue("position", make_energy("speed", 6.0), QUANTITIES) is not None
    assert _choose_clue("heading", np.ones(BLOCKS), QUANTITIES) is None


def test_every_quantity_has_words_for_where_it_is_large_and_small() -> None:
    assert set(list_quantities(RunClock(np.zeros(1), 0.0, True))) <= set(_WHERE_WORDS)


def test_values_that_most_blocks_share_are_compared_as_two_groups() -> None:
    """Eight blocks of sixty in reverse with three times the error, wherever they are in the log."""
    reverse = np.zeros(60)
    reverse[20:28] = 1.0
    assert _compare_thirds(reverse, np.where(reverse > 0.0, 9.0, 1.0)) == pytest.approx(3.0)
    assert _compare_thirds(np.zeros(60), np.ones(60)) == 1.0
