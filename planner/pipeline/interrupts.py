"""Ctrl-C that is not lost: where a library swallows an interrupt, it is raised again until somebody handles it."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

REPEAT_INTERVAL_S = 0.5


@contextmanager
def repeat_interrupts() -> Iterator[None]:
    """Repeat an interrupt of the block every REPEAT_INTERVAL_S until the block ends or `stop_repeating` is called.

    Compiled calls may lose the interrupt that reaches them; that is not reported. Does nothing where the system has no
    timers, outside the main thread, or where somebody else handles Ctrl-C.
    """
    if not _can_listen():
        yield
        return
    report_lost = sys.unraisablehook

    def report_other(lost: UnraisableHookArgs) -> None:
        if not is_interrupt(lost.exc_value):
            report_lost(lost)

    sys.unraisablehook = report_other
    previous_handlers = [signal.signal(number, _raise_interrupt) for number in (signal.SIGINT, signal.SIGALRM)]
    try:
        yield
    finally:
        stop_repeating()
        sys.unraisablehook = report_lost
        for number, handler in zip((signal.SIGINT, signal.SIGALRM), previous_handlers, strict=True):
            signal.signal(number, handler)


def stop_repeating() -> None:
    """Stop repeating: somebody has handled the interrupt."""
    if hasattr(signal, "setitimer") and signal.getsignal(signal.SIGALRM) is _raise_interrupt:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def is_interrupt(error: BaseException | None) -> bool:
    """Whether an error is an interrupt, or was raised by a library because of one."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


def _can_listen() -> bool:
    is_main_thread = threading.current_thread() is threading.main_thread()
    return (
        is_main_thread
        and hasattr(signal, "setitimer")
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )


def _raise_interrupt(_number: int, _frame: FrameType | None) -> None:
    signal.setitimer(signal.ITIMER_REAL, REPEAT_INTERVAL_S)
    raise KeyboardInterrupt
