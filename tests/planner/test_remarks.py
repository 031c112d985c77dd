"""Remarks on plans are good English and say what is so: pieces that are skipped."""

from __future__ import annotations

from typing import cast

import pytest

from planner.evaluation.candidates.variants import ReachableJob
from strategies.program.field_job import FieldJob


@pytest.mark.parametrize(
    ("swaths", "swaths_m", "passes_m", "words"),
    [
        (1, 12.4, 0.0, "1 piece of track (12 m) cannot be reached and is skipped"),
        (2, 30.0, 0.0, "2 pieces of track (30 m) cannot be reached and are skipped"),
        (1, 12.4, 8.0, "1 piece of track (12 m) and 8 m of headland cannot be reached and are skipped"),
        (0, 0.0, 8.0, "8 m of headland cannot be reached and are skipped"),
        (1, 12.4, 0.3, "1 piece of track (12 m) cannot be reached and is skipped"),
    ],
)
def test_what_is_skipped_is_counted_in_good_english(swaths: int, swaths_m: float, passes_m: float, words: str) -> None:
    remark = ReachableJob(cast(FieldJob, None), swaths, swaths_m, passes_m).remark
    assert remark == f"{words}; a wider passage or headland may help"


def test_a_hand_of_headland_is_not_worth_a_word() -> None:
    assert ReachableJob(cast(FieldJob, None), left_out_passes_m=0.4).remark is None
