"""One job as the function that does it takes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from planner.service.store.jobs import Made

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Work:
    """One job as its function takes it: the request, processes it may use, whom to tell (done, all, words).

    The function is called in the folder of its input files, and gives the same bytes whenever it is called.
    """

    request: Mapping[str, Any]
    processes: int
    progress: Progress
    cache: str


Kind = Callable[[Work], Sequence[Made]]
"""Does a job: its results, or a HeadlandError with the one sentence."""
