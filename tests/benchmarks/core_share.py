"""Processes held to a share of one core, so that several of them can be compared on a machine of few cores."""

from __future__ import annotations

import os
import secrets
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

PERIOD_US, PATIENCE_S = 100_000, 5.0
GROUPS = ("/sys/fs/cgroup", "/sys/fs/cgroup/cpu")  # of version 2 and 1


@contextmanager
def hold_to_share(share: float) -> Iterator[Sequence[str]]:
    """The words before a command whose process, and all that it starts, get a share of a core by a control group.

    No words where no group can be made: `take_turns` holds what was started.
    """
    group = _make_group(share)
    if group is None:
        yield ()
        return
    try:
        yield "sh", "-c", 'echo $$ > "$0" && exec "$@"', str(group / "cgroup.procs")
    finally:
        until = time.monotonic() + PATIENCE_S
        while group.exists() and time.monotonic() < until:  # the last process may still be leaving it
            with suppress(OSError):
                group.rmdir()
            time.sleep(0.05)


def _make_group(share: float) -> Path | None:
    """A new control group with a share of a core; None where there can be none."""
    quota_us = round(share * PERIOD_US)
    for folder in map(Path, GROUPS):
        group = folder / f"headland-{secrets.token_hex(4)}"
        with suppress(OSError):
            group.mkdir()
            for name, text in (("cpu.max", f"{quota_us} {PERIOD_US}"), ("cpu.cfs_quota_us", str(quota_us))):
                if (group / name).exists():
                    (group / name).write_text(text)
                    return group
            group.rmdir()
    return None


@contextmanager
def take_turns(processes: Sequence[subprocess.Popen[bytes]], share: float) -> Iterator[None]:
    """Stop and continue processes that lead groups of their own, each for its share of the time."""
    is_over = threading.Event()

    def signal_all(number: int) -> None:
        for process in processes:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, number)

    def turn() -> None:
        while not is_over.is_set():
            signal_all(signal.SIGCONT)
            time.sleep(share * PERIOD_US / 1e6)
            signal_all(signal.SIGSTOP)
            time.sleep((1.0 - share) * PERIOD_US / 1e6)
        signal_all(signal.SIGCONT)

    thread = threading.Thread(target=turn, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
