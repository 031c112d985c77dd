"""Ctrl-C that is heard: where a library swallows an interrupt, it comes again until somebody takes it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

AGAIN_S = 0.5


@contextmanager
def heard() -> Iterator[None]:
    """Interrupts of what is done meanwhile come again every AGAIN_S until it ends or `quiet` is called.

    Compiled calls may lose the one that reaches them. Does nothing where a system has no timers, beside the main
    thread, or where somebody else listens to Ctrl-C.
    """
    if not _may_listen():
        yield
        return
    before = [signal.signal(number, _interrupt) for number in (signal.SIGINT, signal.SIGALRM)]
    try:
        yield
    finally:
        quiet()
        for number, handler in zip((signal.SIGINT, signal.SIGALRM), before, strict=True):
            signal.signal(number, handler)


def quiet() -> None:
    """Somebody has taken the interrupt: it comes no more."""
    if hasattr(signal, "setitimer") and signal.getsignal(signal.SIGALRM) is _interrupt:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def was_interrupt(error: BaseException | None) -> bool:
    """Whether an error is an interrupt or was made of one by a library that it came to."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


def _may_listen() -> bool:
    own = threading.current_thread() is threading.main_thread()
    return own and hasattr(signal, "setitimer") and signal.getsignal(signal.SIGINT) is signal.default_int_handler


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
    raise KeyboardInterrupt
