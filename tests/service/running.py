"""A real service as a process of its own, asked over HTTP by a plain client."""

import http.client
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from planner.service.settings import ServiceSettings
from planner.service.store.service_store import open_store

COMMAND = (sys.executable, "-c", "from planner.cli.main import main\nif __name__ == '__main__':\n    main()")
LONGEST_START_S = 240.0


@dataclass
class Running:
    """A service that listens; `login` is its login address, `lines` what it has printed."""

    process: subprocess.Popen[str]
    data: Path
    port: int
    login: str
    lines: list[str] = field(default_factory=list)

    def ask(
        self, method: str, path: str, body: bytes | None = None, headers: Mapping[str, str] | None = None
    ) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and body of one request on a connection of its own."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, dict(headers or {}))
            answer = connection.getresponse()
            return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
        finally:
            connection.close()

    def ask_json(self, method: str, path: str, value: Any = None, headers: Mapping[str, str] | None = None) -> Any:
        """Status and JSON of one request below /api/v1."""
        body = None if value is None else json.dumps(value).encode()
        more = {"content-type": "application/json"} if body is not None else {}
        status, _, text = self.ask(method, f"/api/v1{path}", body, {**more, **(headers or {})})
        return status, json.loads(text) if text else None

    def make_token(self, *scopes: str, name: str = "", **more: str) -> dict[str, str]:
        """The header of a new token, made beside the service as the command line makes them."""
        with open_store(ServiceSettings(data=self.data)) as store:
            text = store.create_token_text(name or f"a {' '.join(scopes)}", scopes, **more)
        return {"authorization": f"Bearer {text}"}


@contextmanager
def run_service(data: Path, *options: str, environment: Mapping[str, str] | None = None) -> Iterator[Running]:
    """A service on a free port with a folder, for as long as the body takes."""
    command = [*COMMAND, "serve", "--port", "0", "--data", str(data), *options]
    with (data.parent / f"{data.name}.err").open("a") as errors:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=errors, text=True, env=os.environ | (environment or {})
        )
        try:
            yield _await_start(process, data)
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout is not None:
                process.stdout.close()


def _await_start(process: subprocess.Popen[str], data: Path) -> Running:
    assert process.stdout is not None
    stream, lines = process.stdout, []
    until = time.monotonic() + LONGEST_START_S
    while len(lines) < 2 and time.monotonic() < until:
        line = stream.readline()
        assert line, (data.parent / f"{data.name}.err").read_text()
        lines.append(line.strip())
    port = int(lines[0].split("http://127.0.0.1:")[1].split("/")[0])
    made = Running(process, data, port, lines[1].split(": ", 1)[1], lines)
    threading.Thread(target=lambda: lines.extend(line.strip() for line in stream), daemon=True).start()
    return made
