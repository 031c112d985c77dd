"""The other end of planner.pool: a process that takes pickled calls from its input and answers on its output."""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import signal
import sys
import threading
import traceback
from typing import Any, BinaryIO


def main() -> None:
    """Answer calls until the input is closed, which it is as soon as the process that started this one is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever is printed on the way must not get among the answers
    calls: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, calls), daemon=True).start()
    with contextlib.suppress(Exception):  # what cannot be loaded is told by the first call that needs it
        import planner.evaluate  # noqa: F401 - while nobody waits for it yet
    while True:
        output.write(_answer(calls.get()))
        output.flush()


def _listen(source: BinaryIO, calls: queue.SimpleQueue[Any]) -> None:
    """Pass calls on; end the process, whatever it is doing, when there can be no more."""
    try:
        while call := _read(source):
            calls.put(call)
    finally:
        os._exit(0)


def _read(source: BinaryIO) -> bytes:
    """One call as it was pickled, nothing at the end."""
    return source.read(int.from_bytes(source.read(8), "big"))


def _answer(call: bytes) -> bytes:
    """(True, result) or (False, error) of a pickled call, pickled; an error carries where it arose as a note."""
    try:
        fn, args, kwargs = pickle.loads(call)
        return pickle.dumps((True, fn(*args, **kwargs)))
    except Exception as error:
        error.add_note(traceback.format_exc())
        return pickle.dumps((False, error))
