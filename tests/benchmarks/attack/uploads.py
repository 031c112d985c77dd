"""Item 1: files that make the reader open other files, ask other addresses or create files."""

import json
import secrets
import socket
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import HOST, Service, find_free_port
from tests.benchmarks.attack.web import API, ask, pack_zip, upload

SECRET = "canary-"
DRAWN = "POLYGON((11 48, 11.001 48, 11.001 48.001, 11 48.001, 11 48))"  # a field of 0.8 ha, in degrees
BRIEF = ("evil.gpkg", "shp.zip")
VRT = """<OGRVRTDataSource><OGRVRTLayer name="{layer}">{source}<LayerSRS>EPSG:4326</LayerSRS>
<GeometryField encoding="WKT" field="wkt"/><Field name="name" src="secret"/></OGRVRTLayer></OGRVRTDataSource>"""


@dataclass
class Traps:
    """What an attack may find or leave: files with a secret, a listener, a name at which a file may be created."""

    folder: Path
    secret: str
    port: int
    calls: list[str] = field(default_factory=list)

    @property
    def table(self) -> Path:
        """A table with the secret and an outline."""
        return self.folder / "canary.csv"

    @property
    def created(self) -> Path:
        """What an attack would create."""
        return self.folder / "created.db"


@contextmanager
def set_traps() -> Iterator[Traps]:
    """Traps, with a listener that notes who calls."""
    with TemporaryDirectory(prefix="headland-canary-") as folder, socket.socket() as listening:
        listening.bind((HOST, find_free_port()))
        listening.listen(16)
        traps = Traps(Path(folder), SECRET + secrets.token_hex(8), listening.getsockname()[1])
        traps.table.write_text(f'wkt,secret\n"{DRAWN}",{traps.secret}\n')
        threading.Thread(target=_answer_calls, args=(listening, traps), daemon=True).start()
        yield traps


def _answer_calls(listening: socket.socket, traps: Traps) -> None:
    """Note what is asked for, and answer with the secret."""
    while True:
        try:
            call, _ = listening.accept()
        except OSError:
            return
        with call:
            call.settimeout(2.0)
            try:
                traps.calls.append(call.recv(4096).split(b"\r\n")[0].decode(errors="replace"))
                body = traps.table.read_bytes()
                call.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\nConnection: close\r\n\r\n" % len(body) + body)
            except OSError:
                continue


def write_sources(traps: Traps, database: Path) -> dict[str, str]:
    """Documents of GDAL's virtual format, by what each tries."""
    file = f"<SrcDataSource>CSV:{traps.table}</SrcDataSource><SrcLayer>canary</SrcLayer>"
    bare = f"<SrcDataSource>{traps.table}</SrcDataSource><SrcLayer>canary</SrcLayer>"
    address = f"http://{HOST}:{traps.port}/canary.csv"
    called = f"<SrcDataSource>CSV:/vsicurl/{address}</SrcDataSource><SrcLayer>canary</SrcLayer>"
    plain = f"<SrcDataSource>{address}</SrcDataSource><SrcLayer>canary</SrcLayer>"
    tokens = f"<SrcDataSource>{database}</SrcDataSource><SrcSQL>SELECT sha256 AS secret, '{DRAWN}' AS wkt FROM tokens"
    vacuum = f"<SrcDataSource>{database}</SrcDataSource><SrcSQL>VACUUM INTO '{traps.created}'</SrcSQL>"
    sources = {"file": file, "bare file": bare, "curl": called, "http": plain, "create": vacuum,
               "tokens": f"{tokens}</SrcSQL>"}  # fmt: skip
    return {name: VRT.format(layer="canary", source=source) for name, source in sources.items()}


def wrap_document(document: bytes) -> dict[str, bytes]:
    """A document under every name that the reader takes."""
    bare = {f"evil.{ending}": document for ending in ("gpkg", "kml", "gpx", "fgb", "xml", "geojson", "json", "zip")}
    packed = {
        "shp.zip": pack_zip({"evil.shp": document, "evil.shx": b"", "evil.dbf": b"", "evil.prj": b""}),
        "gpkg.zip": pack_zip({"evil.gpkg": document}),
        "kml.zip": pack_zip({"doc.kml": document}),
        "doc.kmz": pack_zip({"doc.kml": document}),
        "taskdata.zip": pack_zip({"TASKDATA/TASKDATA.XML": document}),
    }
    return bare | packed


def attack_readers(service: Service, short: bool) -> list[Row]:
    """Upload every document under every name, look at the summaries, and read some by the command."""
    database = service.data / "headland.db"
    with set_traps() as traps:
        documents = write_sources(traps, database)
        found = _upload_all(service, documents, _read_secrets(traps, database), short)
        uploaded = _row("1a", f"{found.tried} uploads of VRT in other forms", found, traps)
        calls, created = len(traps.calls), traps.created.exists()
        traps.created.unlink(missing_ok=True)
        by_command = _read_by_command(service, documents, traps, short)
        command = _row("1b", f"headland field: {by_command.tried} of them", by_command, traps, calls, created)
    return [uploaded, command]


@dataclass
class Found:
    """What answers had in them."""

    tried: int = 0
    accepted: int = 0
    leaks: list[str] = field(default_factory=list)

    def look(self, name: str, text: str, secrets_: list[str]) -> None:
        """Look for secrets."""
        if any(each in text for each in secrets_):
            self.leaks.append(name)


def _read_secrets(traps: Traps, database: Path) -> list[str]:
    """What must not be told: the secret, and digests of tokens as the database has them."""
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as base:
        return [traps.secret, *(row[0] for row in base.execute("SELECT sha256 FROM tokens"))]


def _upload_all(service: Service, documents: dict[str, str], secrets_: list[str], short: bool) -> Found:
    found, token = Found(), service.token("planner")
    for what, document in documents.items():
        for filename, content in wrap_document(document.encode()).items():
            if short and what != "file" and filename not in BRIEF:
                continue
            name = f"{what} {filename}".replace(".", " ")
            answer = upload(service.port, "fields", filename, content, token, name=name)
            found.tried, found.accepted = found.tried + 1, found.accepted + (answer.status == 201)
            found.look(name, answer.body.decode(errors="replace"), secrets_)
            if answer.status == 201:
                path = f"{API}/fields/{name.replace(' ', '%20')}/summary"
                read = ask(service.port, "GET", path, token=service.token("read"))
                found.look(name, read.body.decode(errors="replace"), secrets_)
    return found


def _read_by_command(service: Service, documents: dict[str, str], traps: Traps, short: bool) -> Found:
    found = Found()
    for what in ("file",) if short else ("file", "curl", "create"):
        for filename in ("evil.gpkg",) if short else ("evil.gpkg", "evil.kml", "evil.gpx", "shp.zip"):
            path = traps.folder / f"{what.replace(' ', '-')}-{filename}"
            path.write_bytes(wrap_document(documents[what].encode())[filename])
            done = service.run("field", str(path))
            found.tried, found.accepted = found.tried + 1, found.accepted + (done.returncode == 0)
            found.look(path.name, done.stdout + done.stderr, [traps.secret])
    return found


def _row(item: str, attacked: str, found: Found, traps: Traps, calls: int = 0, created: bool = False) -> Row:
    called = len(traps.calls) - calls
    made = traps.created.exists() and not created
    words = (f"{len(found.leaks)} told a secret, {called} calls of the listener, "
             f"{'a' if made else 'no'} file created, {found.accepted} accepted")  # fmt: skip
    held = not found.leaks and not called and not made and not found.accepted
    values = {"tried": found.tried, "accepted": found.accepted, "leaks": found.leaks, "calls": called, "created": made}
    return Row(item, attacked, words, "no secret, call or file; none accepted", held, json.loads(json.dumps(values)))
