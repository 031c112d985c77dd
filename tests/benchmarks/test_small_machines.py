"""A mower on a small field: its order is proven to a percent, and far quicker than one swath after another."""

import pytest

from tests.benchmarks.small_machines import plan, prepare


@pytest.mark.slow
def test_a_mower_skips_swaths_and_comes_back() -> None:
    # Round corners, as backing into the corners of the headland says nothing about the order of swaths.
    planned = plan(prepare("trapezium", corners="round"))
    by_omega = plan(prepare("trapezium", turn="omega", corners="round"))
    assert planned.feasible and planned.finished_s is not None
    assert not by_omega.feasible or (by_omega.finished_s is not None and planned.finished_s <= by_omega.finished_s)


def test_tractors_of_a_short_machine_keep_shorter_distances() -> None:
    rules = prepare("rectangle", turn="u").driving_rules
    assert 3.0 < rules.length_m < 3.6
    assert rules.gap_m == 2.0 * rules.length_m and rules.hold_back_m == 1.6 * rules.length_m
