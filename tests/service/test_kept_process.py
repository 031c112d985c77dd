"""Processes that are kept: when one that has ended is started again."""

from types import SimpleNamespace
from typing import Any

import pytest

from planner.service import kept_process
from planner.service.kept_process import KeptProcess


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock."""
    clock = [100.0]
    monkeypatch.setattr(kept_process.time, "monotonic", lambda: clock[0])
    return clock


def wait_after(kept: KeptProcess, now: list[float], lived_s: float, **how: Any) -> float:
    """Let a process live so long; returns the seconds until the next one is due."""
    kept.process, kept._changed_s = SimpleNamespace(exitcode=1), now[0]  # type: ignore[assignment]
    now[0] += lived_s
    assert kept.end_status == 1 and not kept.is_due
    kept.forget(**how)
    ended_s = now[0]
    while not kept.is_due:
        now[0] += 0.25
    return now[0] - ended_s


def test_a_process_that_ends_soon_waits_longer_each_time(now: list[float]) -> None:
    kept = KeptProcess("any", print, 5.0, 30.0)
    assert kept.is_due and kept.end_status is None
    assert [wait_after(kept, now, 1.0) for _ in range(8)] == [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0]
    assert wait_after(kept, now, 6.0) == 0.0, "it lived long enough"
    assert wait_after(kept, now, 1.0) == 0.5
    assert wait_after(kept, now, 1.0, is_fault=False) == 1.0, "that it was meant to end is only logged otherwise"


def test_a_process_that_cannot_be_started_waits_too(now: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**_options: Any) -> Any:
        raise OSError("no more processes")

    monkeypatch.setattr(kept_process.multiprocessing, "get_context", lambda _: SimpleNamespace(Process=refuse))
    kept = KeptProcess("any", print, 5.0, 30.0)
    with pytest.raises(OSError, match="no more processes"):
        kept.start()
    assert not kept.is_due and kept.process is None
    now[0] += kept_process.FIRST_PAUSE_S
    assert kept.is_due
