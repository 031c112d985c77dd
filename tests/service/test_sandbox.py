"""Readings are closed in: what a taken-over reader would try next does not work, and what reading needs does."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fields.errors import HeadlandError
from planner.service.errors import ServiceError
from planner.service.sandbox import reader_processes
from planner.service.sandbox.confinement import can_use_seccomp, get_landlock_version, list_library_folders
from planner.service.sandbox.reader_processes import (
    ForkingReader,
    ReadOrder,
    ReadOutcome,
    SpawningReader,
    choose_reader,
    extract_reading_value,
)
from tests.fields.strangers import SECRET, listening
from tests.service.conftest import SMALL

Attempt = Callable[..., dict[str, Any]]
MEGABYTE = 2**20
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="forks readings, as Linux alone does")
FILES = pytest.mark.skipif(get_landlock_version() == 0, reason="this system has no Landlock")
CALLS = pytest.mark.skipif(not can_use_seccomp(), reason="this system has no seccomp, or a processor that is not known")
POSIX = pytest.mark.skipif(os.name != "posix", reason="this system has no limits of processes")
CLOSED_IN = """
import ctypes, json, os, signal, socket, subprocess, sys, time
from pathlib import Path
from planner.service.sandbox.confinement import confine_process, list_library_folders
libraries, libc = list_library_folders(), ctypes.CDLL(None, use_errno=True)
for line in sys.stdin:
    told, (answers, channel) = json.loads(line), os.pipe()
    pid = os.fork()
    if pid == 0:
        parent = os.getppid()
        while time.process_time() < told["before"]:
            pass
        confine_process(Path(told["folder"]), libraries, told["memory"], told["seconds"], channel)
        try:
            said = {"value": str(eval(told["code"]))}
        except BaseException as error:
            said = {"error": type(error).__name__}
        os.write(channel, json.dumps(said).encode())
        os._exit(0)
    os.close(channel)
    with os.fdopen(answers) as file:
        said = file.read()
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    print(said or json.dumps({"code": code}), flush=True)
"""
"""Forks a process for each attempt, as the fork server does for each reading."""
LONGEST_S = 120.0
READ = "__import__('fields.documents.reader').documents.reader.read_field('own.geojson', local=True).area_ha"
WEB = "'EPSG:4326', 'EPSG:3857'"
PROJECT = f"__import__('fields.geometry.geodesy').geometry.geodesy.project(__import__('numpy').ones((1, 2)), {WEB})"
OTHER_FILES = (
    "open({canary!r}).read()", "os.listdir('/')", "os.listdir('..')", "open('../headland.db').read()",
    "open('/etc/passwd').read()", "open('/proc/self/environ').read()", "open(f'/proc/{{parent}}/environ').read()",
    "open(f'/proc/{{parent}}/mem', 'r+b')", "open('/proc/self/root/etc/passwd').read()", "os.listdir('/dev')",
)  # fmt: skip
WRITES = (
    "open('new', 'w').write('a')", "open('own.geojson', 'a')", "os.unlink('own.geojson')", "os.mkdir('new')",
    "os.rename('own.geojson', 'b')", "os.symlink('/etc/passwd', 'b')", "os.link('own.geojson', 'b')",
    "os.chmod('own.geojson', 0o777)", "os.truncate('own.geojson', 0)", "open('../headland-was-here', 'w')",
    "os.utime('own.geojson')", "os.memfd_create('a')",
)  # fmt: skip
PROCESSES = (
    "os.fork()", "subprocess.run(['/bin/sh', '-c', 'id'])", "os.execv('/bin/sh', ['sh'])", "os.system('id') == 0",
    "os.posix_spawn('/bin/sh', ['sh'], {{}})", "os.kill(parent, signal.SIGTERM)", "os.kill(parent, 0)",
    "os.pidfd_open(parent)", "os.setpriority(os.PRIO_PROCESS, parent, 19)", "os.setuid(1)", "os.chroot('.')",
    "__import__('resource').setrlimit(__import__('resource').RLIMIT_CPU, (1, 1))",
    "__import__('fcntl').fcntl(0, __import__('fcntl').F_SETOWN, parent)",
)  # fmt: skip
CONNECTIONS = (
    "socket.create_connection(('127.0.0.1', {port}), 2)", "socket.socket()", "socket.socketpair()",
    "socket.socket(socket.AF_UNIX)", "socket.socket(socket.AF_INET6, socket.SOCK_DGRAM)",
    "__import__('urllib.request').request.urlopen('http://127.0.0.1:{port}/')",
)  # fmt: skip


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """The folder of a reading."""
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / "own.geojson").write_bytes(SMALL)
    return folder


@pytest.fixture
def canary(tmp_path: Path) -> Path:
    """A file of the service beside that folder."""
    (tmp_path / "headland.db").write_text(SECRET)
    return tmp_path / "headland.db"


@pytest.fixture(scope="module")
def attempts() -> Iterator[subprocess.Popen[str]]:
    """The process that starts those that are closed in."""
    environment = dict(os.environ) | reader_processes.SINGLE_THREAD_VARIABLES
    command = [sys.executable, "-c", CLOSED_IN]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1, env=environment
    ) as process:
        yield process


@pytest.fixture
def attempt(attempts: subprocess.Popen[str], here: Path) -> Attempt:
    """Tells what becomes of an expression in a process that is closed in, after so many seconds of computing."""

    def start(code: str, memory: int = 256 * MEGABYTE, seconds: float = 60.0, before: float = 0.0) -> dict[str, Any]:
        told = {"folder": str(here), "code": code, "memory": memory, "seconds": seconds, "before": before}
        assert attempts.stdin is not None and attempts.stdout is not None
        late = threading.Timer(LONGEST_S, attempts.kill)
        late.start()
        print(json.dumps(told), file=attempts.stdin, flush=True)
        said = attempts.stdout.readline()
        late.cancel()
        assert said, "it has ended, or took too long"
        answer: dict[str, Any] = json.loads(said)
        return answer

    return start


@pytest.mark.parametrize(
    ("code", "errors"),
    [
        *(pytest.param(code, ("PermissionError",), marks=FILES) for code in OTHER_FILES),
        *(pytest.param(code, ("PermissionError", "OSError"), marks=CALLS) for code in WRITES),
        *(pytest.param(code, ("PermissionError", "OSError", "ValueError"), marks=CALLS) for code in PROCESSES),
        *(pytest.param(code, ("PermissionError", "URLError"), marks=CALLS) for code in CONNECTIONS),
    ],
)
def test_other_files_writing_processes_signals_and_connections_are_closed(
    code: str, errors: tuple[str, ...], attempt: Attempt, canary: Path, here: Path
) -> None:
    with listening() as (port, calls):
        said = attempt(code.format(canary=str(canary), port=port))
        assert said.get("error") in errors or (said.get("value"), code) == ("False", "os.system('id') == 0"), said
        assert calls == []
    assert [one.name for one in here.iterdir()] == ["own.geojson"] and (here / "own.geojson").read_bytes() == SMALL


@CALLS
@pytest.mark.parametrize(
    "call",
    [101, 310, 311, 425, 434, 438, 439 + 2, 157, 165, 272, 298, 321, 323, 0x40000000 + 41],
    ids=lambda number: f"call {number}",
)
@pytest.mark.skipif("x86_64" not in os.uname().machine if hasattr(os, "uname") else True, reason="numbers of x86_64")
def test_calls_that_no_reader_needs(call: int, attempt: Attempt) -> None:
    """ptrace, process_vm_*, io_uring, pidfd_*, prctl, mount, unshare, perf, bpf, userfaultfd, and sockets of x32."""
    assert attempt(f"(libc.syscall({call}, 0, 0, 0, 0, 0, 0), ctypes.get_errno())") == {"value": "(-1, 13)"}


@POSIX
def test_memory_has_an_end(attempt: Attempt) -> None:
    assert attempt("len(bytearray(1 << 30))") == {"error": "MemoryError"}
    assert attempt("len(bytearray(1 << 26))") == {"value": str(1 << 26)}


@pytest.mark.slow
@POSIX
def test_computing_has_an_end_and_counts_from_the_moment_of_being_closed_in(attempt: Attempt) -> None:
    assert attempt("sum(iter(int, 1))", seconds=0.5) in ({"code": -signal.SIGXCPU}, {"code": -signal.SIGKILL})
    assert attempt("sum(range(10**7))", seconds=0.5, before=1.2) == {"value": "49999995000000"}


@POSIX
def test_what_reading_takes_is_open(attempt: Attempt) -> None:
    assert attempt("open('own.geojson').read()") == {"value": SMALL.decode()}
    assert attempt(READ, 2**30) == {"value": "0.36"}
    assert "111319" in attempt(PROJECT, 2**30)["value"]


def test_only_folders_of_packages_and_libraries_are_open(here: Path) -> None:
    root = Path(reader_processes.__file__).parents[3]
    open_ = [one.resolve() for one in list_library_folders()]
    assert not any(one in (root, Path("/"), Path.home(), Path(sys.prefix), Path("/usr")) for one in open_)
    assert (root / "planner") in open_ or any(one.name in ("site-packages", "dist-packages") for one in open_)


@pytest.fixture(scope="module", params=[pytest.param(ForkingReader, marks=LINUX), SpawningReader])
def reader(request: pytest.FixtureRequest) -> Iterator[ForkingReader | SpawningReader]:
    """Each kind of reader in turn, with a secret in the environment."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HEADLAND_DATABASE", SECRET)
        made = request.param()
        made.start_process()
        yield made
        made.close()


only_forking = pytest.mark.parametrize(
    "reader",
    [pytest.param(ForkingReader, marks=LINUX), pytest.param(SpawningReader, marks=pytest.mark.matrix)],
    indirect=True,
)
"""The other reader, which starts a process for each reading, in the matrix alone."""


def read(reader: ForkingReader | SpawningReader, folder: Path, name: str = "own.geojson", **more: Any) -> Any:
    how = {"read": "summary field", "options": {"local": True}, "seconds": 240.0, "memory": 512 * MEGABYTE} | more
    order = ReadOrder(folder=str(folder), arguments=[name], **how)
    return extract_reading_value(reader.read_order(order), order.seconds, order.memory)


@pytest.mark.slow
def test_a_field_is_read_and_a_refusal_keeps_its_sentence_and_parameter(
    reader: ForkingReader | SpawningReader, here: Path
) -> None:
    assert read(reader, here)["field"]["area_ha"] == 0.36
    with pytest.raises(HeadlandError) as refusal:
        read(reader, here, options={"crs": " "})
    sentence = refusal.value.render_sentence(lambda name: f"<{name}>")
    assert refusal.value.parameter == "crs" and sentence.startswith("<crs> is")


@pytest.mark.slow
@only_forking
def test_another_file_is_not_read(reader: ForkingReader | SpawningReader, here: Path, canary: Path) -> None:
    canary.with_suffix(".geojson").write_bytes(SMALL)
    with pytest.raises(HeadlandError) as refusal:
        read(reader, here, str(canary.with_suffix(".geojson")))
    if get_landlock_version():
        assert "no permission" in str(refusal.value)


def large(folder: Path) -> None:
    ring = [[float(place % 50), float(place)] for place in range(400_000)]
    text = json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]})
    (folder / "large.geojson").write_text(text)


@pytest.mark.slow
@only_forking
@POSIX
def test_too_much_memory_is_one_sentence(reader: ForkingReader | SpawningReader, here: Path) -> None:
    large(here)
    with pytest.raises(ServiceError, match=r"^Reading this file needed too much memory; split it\.$"):
        read(reader, here, "large.geojson", memory=8 * MEGABYTE)


@pytest.mark.slow
@only_forking
def test_too_long_is_one_sentence(reader: ForkingReader | SpawningReader, here: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(reader_processes, "READ_GRACE_S", 0.5)
    large(here)
    with pytest.raises(ServiceError, match=r"^Reading this file took longer than 1 s; split it\.$"):
        for _ in range(20):  # until the machine is slow enough, which 20 MB of places make every one
            read(reader, here, "large.geojson", seconds=0.6)
    assert read(reader, here)["field"]["area_ha"] == 0.36


@only_forking
@pytest.mark.slow
def test_a_large_log_is_read_where_no_thread_may_be_started(reader: ForkingReader | SpawningReader, here: Path) -> None:
    """A file of more than 5 MB pandas would read with several; a long note makes it one with few rows."""
    rows = "".join(f"{row}.1,{row}.123,0,0,{'x' * 130}\n" for row in range(40_000))
    (here / "large.csv").write_text(f"time_s,easting_m,northing_m,steering_deg,note\n{rows}")
    assert (here / "large.csv").stat().st_size > 5 * MEGABYTE
    assert read(reader, here, "large.csv", read="summary log", options={})["rows"] == 40_000


@pytest.mark.slow
def test_a_fault_is_one_sentence_and_logged_once(
    reader: ForkingReader | SpawningReader, here: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(ServiceError, match=r"^This file cannot be read: [^\n]*\.$") as refusal:
        read(reader, here, options={"nothing": "of this name"})
    assert refusal.value.http_status == 422
    (record,) = [one for one in caplog.records if one.name == reader_processes.__name__ and one.levelname == "ERROR"]
    assert "Traceback" in record.getMessage() and "TypeError" in record.getMessage()


@pytest.mark.slow
@LINUX
@pytest.mark.parametrize("reader", [ForkingReader], indirect=True)
def test_the_one_who_starts_readings_knows_no_secrets(reader: ForkingReader, here: Path) -> None:
    read(reader, here)
    server = reader._server
    assert server is not None and os.environ["HEADLAND_DATABASE"] == SECRET
    pid = server.process.pid
    assert SECRET not in Path(f"/proc/{pid}/environ").read_text()
    opened = [os.readlink(one) for one in Path(f"/proc/{pid}/fd").iterdir()]
    assert not any("headland.db" in one or str(here) in one for one in opened)


@pytest.mark.slow
@LINUX
def test_a_new_one_is_started_where_the_one_that_starts_readings_is_gone_and_ends_with_the_service(here: Path) -> None:
    reader = ForkingReader()
    read(reader, here)
    server = reader._server
    assert server is not None
    server.process.kill()
    server.process.wait()
    assert read(reader, here)["field"]["area_ha"] == 0.36
    second = reader._server
    assert second is not None and second is not server
    reader.close()
    assert second.process.returncode == 0
    with pytest.raises(ServiceError, match="the service is stopping"):
        read(reader, here)


@pytest.mark.parametrize(
    ("ending", "words"),
    [
        (ReadOutcome(b""), "was interrupted"), (ReadOutcome(b"", 1), "was interrupted"),
        (ReadOutcome(b"[]", 0), "was interrupted"),
        (ReadOutcome(b"{" * 100_000, 0), "was interrupted"), (ReadOutcome(b"\xff", 0), "was interrupted"),
        (ReadOutcome(b'{"refused": 1}', 0), "was interrupted"), (ReadOutcome(b"", -9), "too much memory"),
        (ReadOutcome(b"", -6, 600_000), "too much memory"), (ReadOutcome(b"", -11, 1000), "was interrupted"),
        (ReadOutcome(b'{"memory": true}', 1), "too much memory"), (ReadOutcome(b"", -9, 0, True), "longer than 60 s"),
        (ReadOutcome(b"a" * reader_processes.MOST_ANSWER_BYTES, 0), "too large to be shown"),
    ],
)  # fmt: skip
@POSIX
def test_what_ended_is_told_honestly(ending: ReadOutcome, words: str) -> None:
    with pytest.raises(ServiceError, match=words) as refusal:
        extract_reading_value(ending, 60.0, 512 * MEGABYTE)
    assert str(refusal.value).endswith(".") and "\n" not in str(refusal.value)


def test_a_sentence_of_a_taken_over_reader_stays_one_line() -> None:
    told = {"refused": "a\n\x1b[31mb" + "c" * 10_000, "parameter": "p" * 1000}
    with pytest.raises(HeadlandError) as refusal:
        extract_reading_value(ReadOutcome(json.dumps(told).encode(), 0), 60.0, MEGABYTE)
    sentence, parameter = str(refusal.value), str(refusal.value.parameter)
    assert len(sentence) <= reader_processes.LONGEST_SENTENCE_CHARS and not {"\n", "\x1b"} & set(sentence)
    assert len(parameter) == reader_processes.LONGEST_PARAMETER_CHARS


def test_what_a_system_lacks_is_told_once(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(choose_reader(), ForkingReader if sys.platform.startswith("linux") else SpawningReader)
    monkeypatch.setattr(reader_processes, "_LOGGED_MISSING", set())
    for _ in range(3):
        reader_processes._log_missing_protections(["Landlock (a reader could open other files of this user)"])
    (told,) = [one.getMessage() for one in caplog.records if "Landlock" in one.getMessage()]
    assert told.startswith("Files are read without Landlock (a reader could open other files of this user), as this ")
