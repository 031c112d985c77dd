"""The service's side of confined readings; their answers are only ever parsed as JSON.

The fork server of multiprocessing would do but for the confinement: it has the environment of the service, hands the
arguments and the key of the service to each process (the password of a database can stand in both), knows no peak of
memory, and is one for a whole process.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

from fields.errors import HeadlandError
from planner.service.errors import ServiceError
from planner.service.sandbox.confined_reading import MOST_FAULT_CHARS

BOOTSTRAP_CODE = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from planner.service.sandbox import confined_reading; "
)
FORK_SERVER_CODE = f"{BOOTSTRAP_CODE}confined_reading.serve(int(sys.argv[2]))"
READ_ONCE_CODE = f"{BOOTSTRAP_CODE}confined_reading.read_once()"
INHERITED_VARIABLES = (
    "LANG", "LC_ALL", "LC_CTYPE", "TZ", "PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT", "WINDIR", "TEMP",
    "TMP", "NUMBA_CACHE_DIR", "PROJ_DATA", "PROJ_LIB", "GDAL_DATA",
)  # fmt: skip
"""Environment variables that a reading gets; others may hold secrets."""
SINGLE_THREAD_VARIABLES = {
    f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL", "NUMEXPR", "GDAL", "OGR_GPKG")
}
"""A process with threads cannot be forked safely, and a confined one cannot start any."""
MOST_ANSWER_BYTES = 64 * 2**20
LONGEST_SENTENCE_CHARS, LONGEST_PARAMETER_CHARS = 2000, 60
READ_FAULT = (
    "This file cannot be read: it triggers a fault of Headland, described in the log of the service; save the "
    "file in another way, and please report it."
)
START_TIMEOUT_S, READ_GRACE_S = 120.0, 5.0
MOST_TRIES = 2
_LOGGED_MISSING: set[str] = set()


@dataclass(frozen=True)
class ReadOrder:
    """An order to read: the name of a reading (readings.READINGS), its folder and its limits."""

    read: str
    folder: str
    arguments: list[Any]
    options: dict[str, Any]
    seconds: float
    memory: int


@dataclass(frozen=True)
class ReadOutcome:
    """How a reading ended: its answer, exit code (None if unknown), peak memory, and whether it was too late."""

    answer: bytes
    exit_code: int | None = None
    peak_kb: int = 0
    is_late: bool = False


@dataclass
class _ForkServer:
    """A running fork server, and whether it is ready."""

    process: subprocess.Popen[bytes]
    control: socket.socket
    lock: threading.Lock = field(default_factory=threading.Lock)
    is_ready: bool = False

    def wait_until_ready(self) -> None:
        """Wait until it takes orders, and log once which protections are missing."""
        if self.is_ready:
            return
        self.control.settimeout(START_TIMEOUT_S)
        message = self.control.recv(65_536)
        if not message:
            raise ConnectionResetError
        _log_missing_protections(json.loads(message)["missing"])
        self.is_ready = True

    def end(self) -> None:
        """End the server, which ends its readings."""
        self.control.close()
        try:
            self.process.wait(READ_GRACE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class ForkingReader:
    """Reads each file in a process forked by a server (Linux)."""

    def __init__(self) -> None:
        self._server: _ForkServer | None = None
        self._lock = threading.Lock()
        self._closed = False

    def start_process(self) -> None:
        """Start the server without waiting for it."""
        self._get_server()

    def close(self) -> None:
        """End the server and its readings, for good."""
        with self._lock:
            self._closed, server, self._server = True, self._server, None
        if server is not None:
            server.end()

    def read_order(self, order: ReadOrder) -> ReadOutcome:
        """Run a reading; raises ServiceError where no server starts."""
        for _ in range(MOST_TRIES):
            server = self._get_server()
            try:
                return self._send_order(server, order)
            except (OSError, ValueError):  # it is gone, or no longer itself
                with self._lock:
                    if self._server is server:
                        self._server = None
                server.process.kill()
                server.end()
        raise ServiceError(
            "Files cannot be read now, as the process for it does not start; see the log of the service."
        )

    def _get_server(self) -> _ForkServer:
        with self._lock:
            if self._closed:
                raise ServiceError("The file was not read, as the service is stopping; try again after its restart.")
            if self._server is None:
                self._server = _ForkServer(*start_linked_python(FORK_SERVER_CODE, kind=socket.SOCK_SEQPACKET))
            return self._server

    def _send_order(self, server: _ForkServer, order: ReadOrder) -> ReadOutcome:
        local_socket, remote_socket = socket.socketpair()
        report, report_sender = socket.socketpair()
        with local_socket, report:
            with remote_socket, report_sender, server.lock:
                server.wait_until_ready()
                limits = json.dumps({"seconds": order.seconds}).encode()
                socket.send_fds(server.control, [limits], [remote_socket.fileno(), report_sender.fileno()])
            deadline_s = time.monotonic() + order.seconds + READ_GRACE_S
            local_socket.settimeout(READ_GRACE_S)
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                local_socket.sendall(json.dumps(asdict(order)).encode())
                local_socket.shutdown(socket.SHUT_WR)
            answer = _receive_all(local_socket, deadline_s)
            content = _receive_all(report, deadline_s + READ_GRACE_S)
        if not content and not answer:
            raise ConnectionResetError
        end: dict[str, Any] = json.loads(content) if content else {"code": None, "peak_kb": 0, "late": False}
        return ReadOutcome(answer, end["code"], end["peak_kb"], end["late"])


class SpawningReader:
    """Reads each file in a new process, one of which waits ready (systems without fork or Landlock)."""

    def __init__(self) -> None:
        self._spare: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()

    def start_process(self) -> None:
        """Start the spare process."""
        with self._lock:
            self._spare = self._spare or _start_spare_process()

    def close(self) -> None:
        """End the spare process."""
        with self._lock:
            spare, self._spare = self._spare, None
        if spare is not None:
            spare.kill()
            spare.communicate()

    def read_order(self, order: ReadOrder) -> ReadOutcome:
        """Run a reading."""
        with self._lock:
            process, self._spare = self._spare or _start_spare_process(), _start_spare_process()
        is_late = False
        try:
            output, _ = process.communicate(json.dumps(asdict(order)).encode(), order.seconds + READ_GRACE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            output, is_late = process.communicate()[0], True
        first, _, answer = output.partition(b"\n")
        with contextlib.suppress(ValueError):
            _log_missing_protections(json.loads(first)["missing"])
        return ReadOutcome(answer[:MOST_ANSWER_BYTES], process.returncode, 0, is_late)


def choose_reader() -> ForkingReader | SpawningReader:
    """The reader for this system."""
    return ForkingReader() if sys.platform.startswith("linux") else SpawningReader()


def extract_reading_value(outcome: ReadOutcome, limit_s: float, memory_bytes: int) -> Any:
    """The value of a reading; raises HeadlandError for a refusal, ServiceError for another end."""
    report = parse_answer(outcome.answer)
    if "value" in report or "refused" in report:
        return extract_value(report)
    if "fault" in report:
        logging.getLogger(__name__).error(
            "A reading ended in a fault: %s", ascii(str(report["fault"])[-MOST_FAULT_CHARS:])
        )
        raise ServiceError(READ_FAULT)
    signal_name = _name_signal(outcome.exit_code)
    if outcome.is_late or signal_name == "SIGXCPU":
        raise ServiceError(f"Reading this file took longer than {limit_s:.0f} s; split it.")
    has_crashed = signal_name in ("SIGABRT", "SIGSEGV", "SIGBUS")
    is_large = outcome.peak_kb * 1024 > memory_bytes // 2
    if "memory" in report or signal_name == "SIGKILL" or (has_crashed and is_large):
        raise ServiceError("Reading this file needed too much memory; split it.")
    if len(outcome.answer) >= MOST_ANSWER_BYTES:
        raise ServiceError("The content of this file is too large to be shown; split it.")
    raise ServiceError("Reading this file was interrupted; it may be damaged, so save it again.")


def extract_value(report: Mapping[str, Any]) -> Any:
    """The value of an answer that has one or refuses; raises HeadlandError for a refusal."""
    if "value" in report:
        return report["value"]
    name = report.get("parameter")
    parameter = name[:LONGEST_PARAMETER_CHARS] if isinstance(name, str) else None
    # In one short line; private characters mark its parameters.
    sentence = "".join(
        one if one.isprintable() or "\ue000" <= one <= "\uf8ff" else " "
        for one in report["refused"][:LONGEST_SENTENCE_CHARS]
    )
    raise HeadlandError(sentence, parameter=parameter)


def _name_signal(exit_code: int | None) -> str:
    """The signal that ended a process; "" for another end."""
    try:
        return signal.Signals(-(exit_code or 0)).name
    except ValueError:
        return ""


def parse_answer(answer: bytes) -> dict[str, Any]:
    """A parsed answer; empty where it cannot be parsed."""
    try:
        report = json.loads(answer) if len(answer) < MOST_ANSWER_BYTES else None
    except (ValueError, RecursionError):
        return {}
    if not isinstance(report, dict) or ("refused" in report and not isinstance(report["refused"], str)):
        return {}
    return report


def _start_spare_process() -> subprocess.Popen[bytes]:
    return start_python(READ_ONCE_CODE, stdout=subprocess.PIPE, stdin=subprocess.PIPE)


def start_linked_python(
    code: str, *arguments: str, kind: socket.SocketKind = socket.SOCK_STREAM
) -> tuple[subprocess.Popen[bytes], socket.socket]:
    """A Python as of `start_python`, and a socket to it, whose other end is the first argument of the code."""
    local_socket, remote_socket = socket.socketpair(type=kind)
    with remote_socket:
        descriptor = remote_socket.fileno()
        process = start_python(code, str(descriptor), *arguments, pass_fds=(descriptor,), stdout=subprocess.DEVNULL)
    return process, local_socket


def start_python(code: str, *arguments: str, **popen_options: Any) -> subprocess.Popen[bytes]:
    """A Python with the same packages and a minimal environment."""
    search_path = [os.path.abspath(one) for one in sys.path]
    inherited = {name: os.environ[name] for name in INHERITED_VARIABLES if name in os.environ}
    command = [sys.executable, "-I", "-c", code, json.dumps(search_path), *arguments]
    popen_options = {"stdin": subprocess.DEVNULL} | popen_options
    return cast(
        "subprocess.Popen[bytes]",
        subprocess.Popen(command, env=inherited | SINGLE_THREAD_VARIABLES, cwd=Path(sys.prefix), **popen_options),
    )


def _log_missing_protections(missing: list[str]) -> None:
    for protection in missing:
        if protection not in _LOGGED_MISSING:
            _LOGGED_MISSING.add(protection)
            logging.getLogger(__name__).warning("Files are read without %s, as this system lacks it.", protection)


def _receive_all(channel: socket.socket, deadline_s: float) -> bytes:
    """All bytes from a socket, up to its end, the deadline or the size limit."""
    parts, size = [], 0
    with contextlib.suppress(TimeoutError, ConnectionResetError):
        while size < MOST_ANSWER_BYTES and (remaining_s := deadline_s - time.monotonic()) > 0:
            channel.settimeout(remaining_s)
            part = channel.recv(1 << 20)
            if not part:
                break
            parts.append(part)
            size += len(part)
    return b"".join(parts)[:MOST_ANSWER_BYTES]
