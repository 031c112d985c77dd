"""A tile server, MBTiles files and GeoTIFFs for tests: pictures whose colours tell which tile they are."""

import contextlib
import io
import sqlite3
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
from PIL import Image

Answer = tuple[int, dict[str, str], bytes]


def paint_tile(column: int, row: int, side_px: int = 256) -> bytes:
    """PNG of one colour, by column and row, with a darker rim."""
    pixels = np.empty((side_px, side_px, 3), dtype=np.uint8)
    pixels[:] = (60 + 40 * (column % 4), 90 + 30 * (row % 4), 40)
    pixels[:2] = pixels[:, :2] = 20
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG")
    return stream.getvalue()


def answer_png(path: str) -> Answer:
    """The tile of an address that ends in zoom/column/row.png."""
    _, column, row = path.split("?")[0].removesuffix(".png").rsplit("/", 3)[1:]
    return 200, {"content-type": "image/png"}, paint_tile(int(column), int(row))


class TileHost:
    """A server that counts what it is asked; `answer` makes the answers."""

    def __init__(self, port: int) -> None:
        self.address = f"http://127.0.0.1:{port}/{{z}}/{{x}}/{{y}}.png"
        self.paths: list[str] = []
        self.headers: list[dict[str, str]] = []
        self.answer: Callable[[str], Answer] = answer_png


@contextlib.contextmanager
def serve_tiles() -> Iterator[TileHost]:
    """A tile server on this machine for as long as the body takes."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            host.paths.append(self.path)
            host.headers.append({name.lower(): value for name, value in self.headers.items()})
            status, headers, content = host.answer(self.path)
            self.send_response(status)
            for name, value in {"content-length": str(len(content)), **headers}.items():
                self.send_header(name, value)
            self.end_headers()
            with contextlib.suppress(OSError):
                self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    host = TileHost(server.server_address[1])
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield host
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def write_mbtiles(path: Path, tiles: dict[tuple[int, int, int], bytes], **metadata: str) -> Path:
    """An MBTiles file of tiles by zoom, column and row from the north."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        database.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
        rows = [(zoom, column, 2**zoom - 1 - row, content) for (zoom, column, row), content in tiles.items()]
        database.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
    return path
