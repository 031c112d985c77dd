"""Requests over plain sockets: nothing between the attack and the service but http.client."""

import contextlib
import http.client
import io
import json
import secrets
import time
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tests.benchmarks.attack.service import HOST, read_json

API = "/api/v1"
NOBODY = 0
"""The status where there was no answer."""


@dataclass(frozen=True)
class Answer:
    """Status (NOBODY without an answer), body and seconds until it was there; `why` is what came instead of it."""

    status: int
    body: bytes
    seconds: float
    why: str = ""

    @property
    def json(self) -> dict[str, Any]:
        """The body as an object, empty for what is none."""
        return dict(read_json(self.body))


def ask(
    port: int, method: str, path: str, *, token: str | None = None, json_body: Any = None,
    body: bytes | None = None, headers: Mapping[str, str] | None = None, source: str = HOST, timeout_s: float = 60.0,
) -> Answer:  # fmt: skip
    """One request over a connection of its own; an answer that does not come has the status NOBODY."""
    sent = {} if token is None else {"Authorization": f"Bearer {token}"}
    if json_body is not None:
        body, sent["Content-Type"] = json.dumps(json_body).encode(), "application/json"
    begin = time.monotonic()
    link = http.client.HTTPConnection(HOST, port, timeout=timeout_s, source_address=(source, 0))
    try:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the answer may be there already
            link.request(method, path, body, {**sent, **(headers or {})})
        answer = link.getresponse()
        content = answer.read()
        return Answer(answer.status, content, time.monotonic() - begin)
    except (OSError, http.client.HTTPException) as error:
        return Answer(NOBODY, b"", time.monotonic() - begin, f"{type(error).__name__}: {error}"[:80])
    finally:
        link.close()


def upload(
    port: int, kind: str, filename: str, content: bytes, token: str | None, *, name: str | None = None,
    source: str = HOST, timeout_s: float = 120.0, **said: str,
) -> Answer:  # fmt: skip
    """Upload a file as a form does."""
    mark = f"----attack{secrets.token_hex(8)}"
    fields = said | ({} if name is None else {"name": name})
    parts = [f'--{mark}\r\nContent-Disposition: form-data; name="{key}"\r\n\r\n{value}\r\n'.encode()
             for key, value in fields.items()]  # fmt: skip
    head = f'--{mark}\r\nContent-Disposition: form-data; name="file"; filename="{filename}"\r\n'
    parts.append(head.encode() + b"Content-Type: application/octet-stream\r\n\r\n" + content + b"\r\n")
    body = b"".join([*parts, f"--{mark}--\r\n".encode()])
    return ask(port, "POST", f"{API}/{kind}", token=token, body=body, source=source, timeout_s=timeout_s,
               headers={"Content-Type": f"multipart/form-data; boundary={mark}"})  # fmt: skip


def pack_zip(members: Mapping[str, bytes]) -> bytes:
    """An archive of some files."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return packed.getvalue()


def star_field(points: int) -> bytes:
    """A field with a very long outline as GeoJSON: a small file that takes long to read."""
    import math

    ring = []
    for number in range(points):
        far, angle = 300.0 * (1.0 + 0.2 * (number % 2)), 2.0 * math.pi * number / points
        ring.append([round(far * math.cos(angle), 4), round(far * math.sin(angle), 4)])
    return json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}).encode()
