"""The service that is attacked: a process of its own with a folder of its own, and what can be seen of it outside."""

import contextlib
import http.client
import json
import os
import re
import resource
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

HOST = "127.0.0.1"
START_S, END_S, COMMAND_S = 240.0, 15.0, 120.0
ADDRESS = re.compile(r"http://([^\s/]+):(\d+)")


@dataclass
class Service:
    """A running service. `command` starts one of it: words that end in "serve"."""

    command: tuple[str, ...]
    data: Path
    log: Path
    files: int | None = None  # descriptors that it may have, None for as many as this process
    port: int = 0
    process: subprocess.Popen[bytes] | None = None
    admin: str = ""
    _tokens: dict[str, str] = field(default_factory=dict)

    def start(self) -> None:
        """Start it, on the port it had before if it had one; raises RuntimeError where it does not start."""
        self.port = self.port or find_free_port()
        words = [*self.command, "--data", str(self.data), "--port", str(self.port)]
        seen = self.log_bytes()
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True, preexec_fn=self._limit
            )
        until = time.monotonic() + START_S
        while not ADDRESS.search(self.log.read_bytes()[seen:].decode(errors="replace")):
            if self.process.poll() is not None or time.monotonic() > until:
                raise RuntimeError(f"The service does not start: {self.log.read_text(errors='replace')[-500:]}")
            time.sleep(0.05)
        wait_until_open(self.port, until)

    def _limit(self) -> None:
        if self.files is not None:
            resource.setrlimit(resource.RLIMIT_NOFILE, (self.files, self.files))

    def end(self) -> None:
        """End it with all that it has started."""
        if self.process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            self.process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(END_S)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(END_S)

    def run(self, *words: str, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
        """Another command of the same Headland."""
        return subprocess.run([*self.command[:-1], *words], capture_output=True, text=True, timeout=COMMAND_S,
                              env=env, stdin=subprocess.DEVNULL, check=False)  # fmt: skip

    def token(self, *roles: str) -> str:
        """A token with these roles, made once."""
        key = " ".join(roles)
        if key not in self._tokens:
            name = f"{'-'.join(roles)}-{time.monotonic_ns() % 10**9}"
            status, answer = self._post_token({"name": name, "scopes": list(roles)})
            if status != 201:
                raise RuntimeError(f"No token: {status} {answer[:300]!r}")
            self._tokens[key] = str(read_json(answer)["token"])
        return self._tokens[key]

    def _post_token(self, body: dict[str, object]) -> tuple[int, bytes]:
        link = http.client.HTTPConnection(HOST, self.port, timeout=COMMAND_S)
        headers = {"Authorization": f"Bearer {self.admin}", "Content-Type": "application/json"}
        link.request("POST", "/api/v1/tokens", json.dumps(body), headers)
        answer = link.getresponse()
        try:
            return answer.status, answer.read()
        finally:
            link.close()

    def make_admin(self) -> None:
        """Make the first token by the command, as an administrator does."""
        words = ["token", "new", "--scope", "admin", "--name", "attack", "--data", str(self.data)]
        answer = self.run(*words)
        if answer.returncode != 0:
            raise RuntimeError(f"No token: {answer.stderr[-300:]}")
        self.admin = self._tokens["admin"] = answer.stdout.split()[0]

    def processes(self) -> list[int]:
        """Its processes: the one that was started and all that are in its session."""
        assert self.process is not None
        return [pid for pid in _all_processes() if _session_of(pid) == self.process.pid]

    def descriptors(self) -> int:
        """The most descriptors that one of its processes has open."""
        return max((_count_descriptors(pid) for pid in self.processes()), default=0)

    def log_bytes(self) -> int:
        """Bytes that it has written to its log."""
        return self.log.stat().st_size if self.log.exists() else 0


@contextlib.contextmanager
def run_service(command: Sequence[str], *, files: int | None = None) -> Iterator[Service]:
    """A service in a folder that is gone afterwards; ended with all its processes."""
    with tempfile.TemporaryDirectory(prefix="headland-attack-") as folder:
        service = Service(tuple(command), Path(folder) / "data", Path(folder) / "log", files)
        try:
            service.make_admin()
            service.start()
            service.token("operator", "planner")
            yield service
        finally:
            service.end()


def find_free_port() -> int:
    """A port of this machine that nobody has."""
    with socket.create_server((HOST, 0)) as found:
        return int(found.getsockname()[1])


def wait_until_open(port: int, until_s: float) -> None:
    """Wait until somebody listens; raises RuntimeError at `until_s` of the monotonic clock."""
    while time.monotonic() < until_s:
        with contextlib.suppress(OSError), socket.create_connection((HOST, port), 5.0):
            return
        time.sleep(0.1)
    raise RuntimeError(f"Nothing listens on port {port}.")


def read_json(text: bytes) -> dict[str, object]:
    """An object of JSON, empty for what is none."""
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _all_processes() -> list[int]:
    return [int(name) for name in os.listdir("/proc") if name.isdigit()]


def _session_of(pid: int) -> int:
    try:
        return os.getsid(pid)
    except OSError:
        return -1


def _count_descriptors(pid: int) -> int:
    try:
        return len(os.listdir(f"/proc/{pid}/fd"))
    except OSError:
        return 0
