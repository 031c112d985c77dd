"""An interrupt that is swallowed comes again; one that was turned into another error is known."""

import contextlib
import os
import signal
import time

import pytest

from planner.pipeline.interrupts import REPEAT_INTERVAL_S, is_interrupt, repeat_interrupts, stop_repeating

needs_timers = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs timers")


@needs_timers
def test_what_is_swallowed_comes_again() -> None:
    before = signal.getsignal(signal.SIGINT)
    swallowed = 0
    with pytest.raises(KeyboardInterrupt), repeat_interrupts():
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1.0)
        swallowed += 1
        time.sleep(4.0 * REPEAT_INTERVAL_S)
    assert swallowed == 1 and signal.getsignal(signal.SIGINT) is before


@needs_timers
def test_what_is_taken_comes_no_more() -> None:
    with repeat_interrupts():
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(1.0)
        stop_repeating()
        time.sleep(2.0 * REPEAT_INTERVAL_S)


def test_an_interrupt_in_disguise() -> None:
    try:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise SystemError("returned a result with an exception set") from interrupt
    except SystemError as error:
        assert is_interrupt(error)
    assert not is_interrupt(ValueError("7")) and not is_interrupt(None)
