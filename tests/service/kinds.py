"""Kinds of jobs for tests: functions that workers import by name."""

import hashlib
import os
import signal
import time
from pathlib import Path

from planner.errors import RequestError, mark_parameter
from planner.service.jobs.input_files import JobContext, ResultContents

STEPS = 4


def tiny(work: JobContext) -> ResultContents:
    """Some steps of so many seconds each; the result depends on the request and its file alone."""
    for step in range(STEPS):
        work.report_progress(step, STEPS, "At work")
        time.sleep(work.request.get("step_s", 0.0))
    return made(work.request["number"], b"".join(Path(name).read_bytes() for name in work.request.get("files", ())))


def made(number: int, content: bytes = b"") -> dict[str, bytes]:
    """What a tiny job of a number makes."""
    lines = [hashlib.sha256(f"{number} {line}".encode()).hexdigest() for line in range(50)]
    return {"result.json": ("\n".join(lines)).encode() + content}


def refused(_work: JobContext) -> ResultContents:
    """A job that cannot be done."""
    raise RequestError(f"{mark_parameter('width_m')} is 7; use another.")


def broken(_work: JobContext) -> ResultContents:
    """A job that meets a fault."""
    raise RuntimeError("something\nelse")


def deadly(_work: JobContext) -> ResultContents:
    """A job that takes its process with it."""
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


KINDS = {"tiny": tiny, "refused": refused, "broken": broken, "deadly": deadly}
