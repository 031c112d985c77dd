"""The fork server, a process without secrets, and the confined readings that it starts.

It has loaded the libraries and forks one process per reading, so that no reading waits for Python to start and none
sees the data of another. It has one thread, no secrets and no file of the service open. Where processes cannot be
forked, `read_once` runs a single reading in this one.

The answer of a reading is JSON: {value}, {refused, parameter}, {memory} or {fault}.
"""

from __future__ import annotations

import gc
import json
import os
import select
import signal
import socket
import sys
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planner.service.sandbox.confinement import (
    confine_process,
    list_library_folders,
    list_missing_protections,
    lower_priority,
)

MOST_FAULT_CHARS = 4000
MOST_ORDER_BYTES = 16 * 1024  # bytes of an order without what is to be read
KILL_GRACE_S = 0.5


def _load_libraries() -> None:
    """Load the libraries for reading, by summarising a sample field, and let what follows leave them alone."""
    import pandas  # noqa: F401
    import pyogrio.raw  # noqa: F401
    import scipy.interpolate  # noqa: F401
    import tomlkit  # noqa: F401

    with suppress(ImportError):  # an extra, for GeoTIFFs
        import rasterio.windows  # noqa: F401
    from planner.evaluation import context  # noqa: F401
    from planner.service.sandbox.readings import summarize_field, summarize_tractor
    from vehicle.identification.diagnosis import demo_logs  # noqa: F401
    from vehicle.identification.logs import reader  # noqa: F401
    from vehicle.model import gnss  # noqa: F401

    summarize_field("netherlands")
    summarize_tractor("eg105")
    gc.collect()
    gc.freeze()  # so that garbage collection in a reading does not copy shared memory
    lower_priority()


def _read_confined(channel: int, request: dict[str, Any], libraries: list[Path], *, is_forked: bool = True) -> None:
    """Confine this process, read and write the answer; never returns."""

    def read() -> Any:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        open_descriptor = channel if is_forked else None
        confine_process(Path(request["folder"]), libraries, request["memory"], request["seconds"], open_descriptor)
        from planner.service.sandbox.readings import READINGS

        return READINGS[request["read"]](*request["arguments"], **request["options"])

    try:
        write_all(channel, encode_answer(read))
    finally:
        os._exit(0)


def encode_answer(compute: Callable[[], Any], more: Callable[[], Mapping[str, Any]] = dict) -> bytes:
    """What a function computes, refuses or fails with as an answer in JSON; with `more` keys, found when it is over."""
    from fields.errors import HeadlandError

    try:
        return json.dumps({"value": compute(), **more()}).encode()
    except HeadlandError as refusal:
        answer: dict[str, Any] = {"refused": str(refusal.args[0]), "parameter": refusal.parameter}
    except MemoryError:
        answer = {"memory": True}
    except BaseException as error:
        answer = {"fault": "".join(traceback.format_exception(error))[-MOST_FAULT_CHARS:]}
    return json.dumps({**answer, **more()}).encode()


def write_all(channel: int, content: bytes) -> None:
    """Write all of it to a descriptor."""
    remaining = memoryview(content)
    while remaining:
        remaining = remaining[os.write(channel, remaining) :]


@dataclass
class _RunningReader:
    """A reading process: the socket for its end, and its deadline."""

    report_socket: socket.socket
    deadline_s: float
    is_late: bool = False


def serve(descriptor: int) -> None:
    """Take orders until the service is gone."""
    control = socket.socket(fileno=descriptor)
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(wake)
    _load_libraries()
    libraries, readings = list_library_folders(), dict[int, _RunningReader]()
    watched: list[Any] = [control, woken]
    try:
        control.sendall(json.dumps({"missing": list_missing_protections()}).encode() + b"\n")
    except ConnectionError:  # the service was ended while this began
        return
    while True:
        first_deadline_s = min((each.deadline_s for each in readings.values()), default=None)
        wait_s = None if first_deadline_s is None else max(0.0, first_deadline_s - time.monotonic())
        ready, _, _ = select.select(watched, [], [], wait_s)
        if woken in ready:
            os.read(woken, 4096)
        if control in ready and not _start_reading(control, readings, libraries):
            break
        _report_or_kill_readings(readings)
    for pid in readings:
        os.kill(pid, signal.SIGKILL)


def read_once() -> None:
    """Run the one reading ordered on standard input in this process; the answer goes to standard output."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _load_libraries()
    libraries, channel = list_library_folders(), os.dup(1)
    print(json.dumps({"missing": list_missing_protections()}), flush=True)
    order = sys.stdin.buffer.read()
    if order:
        _read_confined(channel, json.loads(order), libraries, is_forked=False)


def _start_reading(control: socket.socket, readings: dict[int, _RunningReader], libraries: list[Path]) -> bool:
    """Take one order and fork a process for it; False once the service is gone."""
    try:
        message, descriptors, _, _ = socket.recv_fds(control, MOST_ORDER_BYTES, 2)
    except ConnectionError:  # the service was ended with something unread
        return False
    if not message or len(descriptors) != 2:
        return False
    order: dict[str, Any] = json.loads(message)
    channel, report_descriptor = descriptors
    pid = os.fork()
    if pid == 0:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        with open(channel, "rb", closefd=False) as stream:
            order |= json.load(stream)
        _read_confined(channel, order, libraries)
    os.close(channel)
    readings[pid] = _RunningReader(socket.socket(fileno=report_descriptor), time.monotonic() + order["seconds"])
    return True


def _report_or_kill_readings(readings: dict[int, _RunningReader]) -> None:
    """Report readings that have ended, and kill late ones."""
    for pid, reading in list(readings.items()):
        ended, status, usage = os.wait4(pid, os.WNOHANG)
        if ended:
            del readings[pid]
            report = {"code": os.waitstatus_to_exitcode(status), "late": reading.is_late, "peak_kb": usage.ru_maxrss}
            with reading.report_socket, suppress(OSError):  # the service may no longer wait for it
                reading.report_socket.sendall(json.dumps(report).encode())
        elif time.monotonic() >= reading.deadline_s:
            reading.is_late, reading.deadline_s = True, time.monotonic() + KILL_GRACE_S
            os.kill(pid, signal.SIGKILL)
