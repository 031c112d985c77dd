"""The service's side of confined readings; their answers are only ever parsed as JSON."""

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

LOGGER = logging.getLogger(__name__)
BOOTSTRAP_CODE = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from planner.service.sandbox.fork_server import "
)
FORK_SERVER_CODE, READ_ONCE_CODE = (
    f"{BOOTSTRAP_CODE}serve; serve(int(sys.argv[2]))",
    f"{BOOTSTRAP_CODE}read_once; read_once()",
)
INHERITED_VARIABLES = (
    "LANG",
    "LC_ALL",
    "LC_CTYPE",
    "TZ",
    "PATH",
    "LD_LIBRARY_PATH",
    "DYLD_LIBRARY_PATH",
    "SYSTEMROOT",
    "WINDIR",
    "TEMP",
    "TMP",
    "NUMBA_CACHE_DIR",
    "PROJ_DATA",
    "PROJ_LIB",
    "GDAL_DATA",
)
"""Environment variables that a reading gets; others may hold secrets."""
SINGLE_THREAD_VARIABLES = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMEXPR_NUM_THREADS": "1",
    "GDAL_NUM_THREADS": "1",
    "OGR_GPKG_NUM_THREADS": "1",
}
"""A process with threads cannot be forked safely, and a confined one cannot start any."""
MOST_ANSWER_BYTES = 64 * 2**20
LONGEST_SENTENCE_CHARS, LONGEST_PARAMETER_CHARS, LONGEST_FAULT_CHARS = 2000, 60, 4000
READ_FAULT = (
    "This file cannot be read: it triggers a fault of Headland, described in the log of the service; save the "
    "file in another way, and please report it."
)
START_TIMEOUT_S, READ_GRACE_S = 120.0, 5.0
MOST_TRIES = 2
_LOGGED_MISSING: set[str] = set()


@dataclass(frozen=True)
class ReadOrder:
    """An order to read: the name of a reading (confined_reading.list_readings), its folder and its limits."""

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


class ForkServerGoneError(Exception):
    """The fork server is gone."""


@dataclass
class _ForkServer:
    """A running fork server, and whether it is ready."""

    process: subprocess.Popen[bytes]
    control: socket.socket
    lock: threading.Lock = field(default_factory=threading.Lock)
    is_ready: bool = False


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
            server.control.close()
            _wait_for_exit(server.process)

    def read_order(self, order: ReadOrder) -> ReadOutcome:
        """Run a reading; raises ServiceError where no server starts."""
        for _ in range(MOST_TRIES):
            server = self._get_server()
            try:
                return self._send_order(server, order)
            except (ForkServerGoneError, OSError, ValueError):
                self._discard_server(server)
        raise ServiceError(
            "Files cannot be read now, as the process for it does not start; see the log of the service."
        )

    def _get_server(self) -> _ForkServer:
        with self._lock:
            if self._closed:
                raise ServiceError("The file was not read, as the service is stopping; try again after its restart.")
            if self._server is None:
                self._server = _start_server()
            return self._server

    def _discard_server(self, server: _ForkServer) -> None:
        with self._lock:
            if self._server is server:
                self._server = None
        server.control.close()
        server.process.kill()
        _wait_for_exit(server.process)

    def _send_order(self, server: _ForkServer, order: ReadOrder) -> ReadOutcome:
        local_socket, remote_socket = socket.socketpair()
        report, report_sender = socket.socketpair()
        with local_socket, report:
            with remote_socket, report_sender, server.lock:
                _wait_until_ready(server)
                limits = {"seconds": order.seconds}
                descriptors = [remote_socket.fileno(), report_sender.fileno()]
                socket.send_fds(server.control, [json.dumps(limits).encode()], descriptors)
            deadline_s = time.monotonic() + order.seconds + READ_GRACE_S
            local_socket.settimeout(READ_GRACE_S)
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                local_socket.sendall(json.dumps(asdict(order)).encode())
                local_socket.shutdown(socket.SHUT_WR)
            answer = _receive_all(local_socket, deadline_s)
            return _build_outcome(answer, _receive_all(report, deadline_s + READ_GRACE_S))


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
    report = _parse_answer(outcome.answer)
    if "value" in report:
        return report["value"]
    if "refused" in report:
        name = report.get("parameter")
        raise HeadlandError(
            _shorten_refusal_sentence(report["refused"]),
            parameter=name[:LONGEST_PARAMETER_CHARS] if isinstance(name, str) else None,
        )
    if "fault" in report:
        raise build_refusal(str(report["fault"]))
    if outcome.is_late or outcome.exit_code == -getattr(signal, "SIGXCPU", 0):
        raise ServiceError(f"Reading this file took longer than {limit_s:.0f} s; split it.")
    has_crashed = outcome.exit_code in [-getattr(signal, one, 0) for one in ("SIGABRT", "SIGSEGV", "SIGBUS", "SIGKILL")]
    if (
        "memory" in report
        or outcome.exit_code == -getattr(signal, "SIGKILL", 0)
        or (has_crashed and outcome.peak_kb * 1024 > memory_bytes // 2)
    ):
        raise ServiceError("Reading this file needed too much memory; split it.")
    if len(outcome.answer) >= MOST_ANSWER_BYTES:
        raise ServiceError("The content of this file is too large to be shown; split it.")
    raise ServiceError("Reading this file was interrupted; it may be damaged, so save it again.")


def build_refusal(fault: str) -> ServiceError:
    """The refusal for a reading that ended in a fault; its traceback is logged in one line."""
    LOGGER.error("A reading ended in a fault: %s", ascii(fault[-LONGEST_FAULT_CHARS:]))
    return ServiceError(READ_FAULT)


def _shorten_refusal_sentence(sentence: str) -> str:
    """A sentence in one short line; private characters mark its parameters."""
    printable = (
        one if one.isprintable() or "\ue000" <= one <= "\uf8ff" else " " for one in sentence[:LONGEST_SENTENCE_CHARS]
    )
    return "".join(printable)


def _parse_answer(answer: bytes) -> dict[str, Any]:
    """A parsed answer; empty where it cannot be parsed."""
    try:
        report = json.loads(answer) if len(answer) < MOST_ANSWER_BYTES else None
    except (ValueError, RecursionError):
        return {}
    if not isinstance(report, dict) or ("refused" in report and not isinstance(report["refused"], str)):
        return {}
    return report


def _start_server() -> _ForkServer:
    local_socket, remote_socket = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with remote_socket:
        process = _start_python(
            FORK_SERVER_CODE, str(remote_socket.fileno()), pass_fds=(remote_socket.fileno(),), stdout=subprocess.DEVNULL
        )
    return _ForkServer(process, local_socket)


def _start_spare_process() -> subprocess.Popen[bytes]:
    return _start_python(READ_ONCE_CODE, stdout=subprocess.PIPE, stdin=subprocess.PIPE)


def _start_python(code: str, *arguments: str, **popen_options: Any) -> subprocess.Popen[bytes]:
    """A Python with the same packages and a minimal environment."""
    search_path = [os.path.abspath(one) for one in sys.path]
    inherited = {name: os.environ[name] for name in INHERITED_VARIABLES if name in os.environ}
    command = [sys.executable, "-I", "-c", code, json.dumps(search_path), *arguments]
    popen_options = {"stdin": subprocess.DEVNULL} | popen_options
    return cast(
        "subprocess.Popen[bytes]",
        subprocess.Popen(command, env=inherited | SINGLE_THREAD_VARIABLES, cwd=Path(sys.prefix), **popen_options),
    )


def _wait_until_ready(server: _ForkServer) -> None:
    """Wait until a server is ready, and log once which protections are missing."""
    if server.is_ready:
        return
    server.control.settimeout(START_TIMEOUT_S)
    message = server.control.recv(65_536)
    if not message:
        raise ForkServerGoneError
    _log_missing_protections(json.loads(message)["missing"])
    server.is_ready = True


def _log_missing_protections(missing: list[str]) -> None:
    for protection in missing:
        if protection not in _LOGGED_MISSING:
            _LOGGED_MISSING.add(protection)
            LOGGER.warning("Files are read without %s, as this system lacks it.", protection)


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


def _build_outcome(answer: bytes, report: bytes) -> ReadOutcome:
    """The outcome of a reading; raises ForkServerGoneError where the server ended first."""
    if not report and not answer:
        raise ForkServerGoneError
    values: Mapping[str, Any] = json.loads(report) if report else {"code": None, "peak_kb": 0, "late": False}
    return ReadOutcome(answer, values["code"], values["peak_kb"], values["late"])


def _wait_for_exit(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(READ_GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
