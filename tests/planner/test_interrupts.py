"""An interrupt that is swallowed comes again; one that was turned into another error is known."""

import contextlib
import signal
import sys
from collections.abc import Callable
from typing import Any

import pytest

from planner.pipeline import interrupts
from planner.pipeline.interrupts import is_interrupt, repeat_interrupts, stop_repeating

needs_timers = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs timers")


@pytest.fixture
def swallow(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Interrupts the process and loses that; it comes again after longer than any of these tests takes."""
    monkeypatch.setattr(interrupts, "REPEAT_INTERVAL_S", 60.0)

    def lose() -> None:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)

    return lose


@needs_timers
def test_what_is_swallowed_comes_again(swallow: Callable[[], None]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), repeat_interrupts():
        swallow()
        assert 0.0 < signal.getitimer(signal.ITIMER_REAL)[0] <= 60.0
        signal.raise_signal(signal.SIGALRM)  # the interval is over
    assert signal.getsignal(signal.SIGINT) is before and signal.getitimer(signal.ITIMER_REAL)[0] == 0.0


@needs_timers
def test_what_is_taken_comes_no_more(swallow: Callable[[], None]) -> None:
    with repeat_interrupts():
        swallow()
        stop_repeating()
        assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0


class _FailsInTheEnd:
    """Raises an error where nobody can handle it, as what compiled code calls may."""

    def __init__(self, error: type[BaseException]) -> None:
        self._error = error

    def __del__(self) -> None:
        raise self._error


@needs_timers
def test_what_comes_again_is_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever else is lost is reported to whoever listened before."""
    reported = list[type[BaseException]]()

    def listen(lost: Any) -> None:
        reported.append(lost.exc_type)

    monkeypatch.setattr(sys, "unraisablehook", listen)
    with repeat_interrupts():
        _FailsInTheEnd(KeyboardInterrupt)
        _FailsInTheEnd(ValueError)
    assert reported == [ValueError] and sys.unraisablehook is listen


def test_an_interrupt_in_disguise() -> None:
    try:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise SystemError("returned a result with an exception set") from interrupt
    except SystemError as error:
        assert is_interrupt(error)
    assert not is_interrupt(ValueError("7")) and not is_interrupt(None)
