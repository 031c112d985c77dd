"""The fork server: a process without secrets that starts all readings.

It has loaded the libraries and forks one process per reading, so that no reading waits for Python to start and none
sees the data of another. It has one thread, no secrets and no file of the service open. Where processes cannot
be forked, `read_once` runs a single reading in this one.
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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planner.service.sandbox.confined_reading import load_libraries, read_confined
from planner.service.sandbox.confinement import list_library_folders, list_missing_protections

MOST_ORDER_BYTES = 16 * 1024  # bytes of an order without what is to be read
READER_NICENESS = 5  # links and stops come before readings
KILL_GRACE_S = 0.5


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
    _preload_server()
    libraries, readings = list_library_folders(), dict[int, _RunningReader]()
    watched: list[Any] = [control, woken]
    try:
        control.sendall(json.dumps({"missing": list_missing_protections()}).encode() + b"\n")
    except ConnectionError:  # the service was ended while this began
        return
    while True:
        ready, _, _ = select.select(watched, [], [], _compute_wait_s(readings))
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
    _preload_server()
    libraries, channel = list_library_folders(), os.dup(1)
    print(json.dumps({"missing": list_missing_protections()}), flush=True)
    order = sys.stdin.buffer.read()
    if order:
        read_confined(channel, json.loads(order), libraries, is_forked=False)


def _preload_server() -> None:
    load_libraries()
    gc.collect()
    gc.freeze()  # so that garbage collection in a reading does not copy shared memory
    if hasattr(os, "nice"):
        os.nice(READER_NICENESS)


def _compute_wait_s(readings: dict[int, _RunningReader]) -> float | None:
    """Seconds until the first deadline; None without readings."""
    if not readings:
        return None
    return max(0.0, min(each.deadline_s for each in readings.values()) - time.monotonic())


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
        read_confined(channel, order | json.loads(_receive_all(channel)), libraries)
    os.close(channel)
    readings[pid] = _RunningReader(socket.socket(fileno=report_descriptor), time.monotonic() + order["seconds"])
    return True


def _receive_all(channel: int) -> bytes:
    """All bytes that the service has sent to a reading."""
    parts = []
    while part := os.read(channel, 65_536):
        parts.append(part)
    return b"".join(parts)


def _report_or_kill_readings(readings: dict[int, _RunningReader]) -> None:
    """Report readings that have ended, and kill late ones."""
    for pid, reading in list(readings.items()):
        ended, status, usage = os.wait4(pid, os.WNOHANG)
        if ended:
            _report_end(readings.pop(pid), os.waitstatus_to_exitcode(status), usage.ru_maxrss)
        elif time.monotonic() >= reading.deadline_s:
            reading.is_late, reading.deadline_s = True, time.monotonic() + KILL_GRACE_S
            os.kill(pid, signal.SIGKILL)


def _report_end(reading: _RunningReader, code: int, peak_kb: int) -> None:
    with reading.report_socket as report_socket:
        try:
            report_socket.sendall(json.dumps({"code": code, "late": reading.is_late, "peak_kb": peak_kb}).encode())
        except OSError:
            return  # the service no longer waits for it
