"""Files of strangers: what each driver of GDAL would take for its own, holding or naming a secret."""

import json
import socket
import sqlite3
import tempfile
import threading
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pyogrio
import shapely

SECRET = "xyzzy-of-the-farm-4711"
BOX = shapely.box(10.0, 50.0, 10.004, 50.002)
HEAD = b"\x00" * 512


@contextmanager
def listening() -> Iterator[tuple[int, list[object]]]:
    """A port of this machine, and who called there."""
    calls: list[object] = []
    server = socket.create_server(("127.0.0.1", 0))

    def answer() -> None:
        while True:
            try:
                peer, address = server.accept()
            except OSError:
                return
            calls.append(address)
            peer.close()

    threading.Thread(target=answer, daemon=True).start()
    try:
        yield server.getsockname()[1], calls
    finally:
        server.shutdown(socket.SHUT_RDWR)
        server.close()


def written(driver: str) -> bytes | None:
    """A field as a driver of GDAL writes it, the secret its name; None for one that cannot write."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        place = Path(folder) / "made.shp" if driver == "ESRI Shapefile" else Path(folder) / "made.bin"
        try:
            pyogrio.raw.write(
                place, np.array([shapely.to_wkb(BOX)], dtype=object), [np.array([SECRET], dtype=object)],
                np.array(["name"]), geometry_type="Polygon", crs="EPSG:4326", driver=driver,
            )  # fmt: skip
        except Exception:
            return None
        made = [one for one in sorted(Path(folder).rglob("*")) if one.is_file()]
        own = place if place.is_file() else made[0] if made else None
        return None if own is None else own.read_bytes()


def vrt(source: str, more: str = "") -> bytes:
    """A virtual layer of GDAL's, of another source; it has the name of the secret's file, as GDAL wants it."""
    return (
        f'<OGRVRTDataSource><OGRVRTLayer name="secret"><SrcDataSource relativeToVRT="0">{source}</SrcDataSource>{more}'
        "</OGRVRTLayer></OGRVRTDataSource>"
    ).encode()


def vacuum(database: Path, target: Path) -> bytes:
    """A virtual layer whose SQL writes a file."""
    return vrt(str(database), f"<SrcSQL dialect='SQLITE'>VACUUM INTO '{target}'</SrcSQL>")


def database(path: Path, *statements: str) -> bytes:
    """An SQLite database made by statements."""
    with closing(sqlite3.connect(path)) as made:
        for one in statements:
            made.execute(one)
        made.commit()
    return path.read_bytes()


def made_by_hand(canary: Path, port: int) -> dict[str, bytes]:
    """What drivers that cannot write, or that name other sources, would take for their own, by driver."""
    url = f"http://127.0.0.1:{port}"
    pipeline = f"gdal vector pipeline ! read {canary} ! write --of stream streamed_dataset"
    esri = {"geometryType": "esriGeometryPolygon", "fields": [], "features": [], "displayFieldName": SECRET}
    rings = [[[10.0, 50.0], [10.004, 50.0], [10.004, 50.002], [10.0, 50.0]]]
    topology = {"type": "Topology", "arcs": rings, "objects": {"a": {"type": "Polygon", "arcs": [[0]], "id": SECRET}}}
    texts: dict[str, str] = {
        "OGR_VRT": vrt(f"CSV:{canary}").decode(),
        "CSV": f"CSV:{canary}",
        "GDALG": json.dumps({"type": "gdal_streamed_alg", "command_line": pipeline}),
        "WFS": f"<OGRWFSDataSource><URL>{url}/wfs</URL></OGRWFSDataSource>",
        "OAPIF": f"<OGRWFS3DataSource><URL>{url}/</URL></OGRWFS3DataSource>",
        "OGCAPI": f"OGCAPI:{url}/",
        "CSW": f"CSW:{url}/",
        "HTTP": f"{url}/a.geojson",
        "Elasticsearch": f"ES:{url}",
        "NGW": f"NGW:{url}/resource/1",
        "Carto": f"CARTO:{url}",
        "AmigoCloud": f"AMIGOCLOUD:1 datasets={url}",
        "PLSCENES": f"PLScenes:version=data_v1,api_key={url}",
        "EEDA": f"EEDA:{url}",
        "ADBC": f"ADBC:{canary}",
        "GPSBabel": f"GPSBabel:nmea:{canary}",
        "MVT": f"MVT:{url}/0/0/0.pbf",
        "PMTiles": "PMTiles\x03" + "\0" * 120,
        "ESRIJSON": json.dumps(esri),
        "TopoJSON": json.dumps(topology),
        "GTFS": f"GTFS:{canary}",
        "OSM": f'<osm version="0.6"><node id="1" lat="50" lon="10"><tag k="name" v="{SECRET}"/></node></osm>',
        "LVBAG": f'<sl-bag-extract:bagStand xmlns:sl-bag-extract="http://x" href="{canary}"/>',
        "GML": f'<FeatureCollection xmlns="http://www.opengis.net/wfs" schemaLocation="x {url}/a.xsd"/>',
        "VFK": f"&HVERZE;{SECRET}\r\n",
        "SXF": "SXF\0" + "\0" * 400,
        "S57": "001923LE1 0900061",
        "EDIGEO": f"BOMT 12:{SECRET}.THF",
        "AVCE00": f"EXP  0 {canary}\r\n",
        "AIVector": f"<AIVector>{canary}</AIVector>",
        "SQLite": f"<SQLite>{canary}</SQLite>",
        "Idrisi": f"file format : IDRISI Vector {canary}",
        "OGR_PDS": f"PDS_VERSION_ID = PDS3\r\n^TABLE = {canary}\r\nEND\r\n",
        "XLSX": f"XLSX:{canary}",
        "ODS": f"ODS:{canary}",
    }
    return {name: text.encode("latin-1") for name, text in texts.items()}


def offered(driver: str, canary: Path, port: int) -> list[bytes]:
    """Everything that is offered for a driver: written by it, made by hand, and its name before the secret's file."""
    hand = made_by_hand(canary, port).get(driver)
    prefix = f"{driver}:{canary}".encode()
    return [one for one in (written(driver), hand, prefix, prefix + HEAD) if one is not None]
