"""XML of strangers: no document types, no entities, nothing fetched, whatever stands before them."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from fields.documents.reader import read_field
from fields.errors import FieldError, HeadlandError
from fields.formats.markup import MAX_XML_DEPTH, check_xml_root, parse_root
from planner.task_logs.formats import isoxml_logs
from tests.fields.strangers import SECRET, listening

RING = "10,50 10.004,50 10.004,50.002 10,50.002 10,50"
KML = (
    '<kml xmlns="http://www.opengis.net/kml/2.2"{attributes}><Document>{more}<Placemark><name>{name}</name><Polygon>'
    f"<outerBoundaryIs><LinearRing><coordinates>{RING}</coordinates></LinearRing></outerBoundaryIs></Polygon>"
    "</Placemark></Document></kml>"
)
POINTS = "".join(f'<trkpt lat="{place.split(",")[1]}" lon="{place.split(",")[0]}"/>' for place in RING.split())
GPX = f'<gpx version="1.1" creator="t"><trk><name>{{name}}</name><trkseg>{POINTS}</trkseg></trk></gpx>'
CORNERS = "".join(f'<PNT A="2" C="{place.split(",")[1]}" D="{place.split(",")[0]}"/>' for place in RING.split())
TASKS = (
    '<ISO11783_TaskData VersionMajor="4"><PFD A="PFD1" C="{name}" D="1"><PLN A="1"><LSG A="1">'
    f"{CORNERS}</LSG></PLN></PFD></ISO11783_TaskData>"
)
BEFORE: dict[str, str] = {
    "alone": "",
    "after a comment": "<!-- <a -->",
    "after a comment with a root": "<!-- <kml></kml> -->",
    "after an instruction": "<?xsl <a?>",
    "after spaces": "\n\n  ",
}
DECLARED: dict[str, str] = {
    "an inner entity": '<!DOCTYPE a [<!ENTITY e "{value}">]>',
    "a file": '<!DOCTYPE a [<!ENTITY e SYSTEM "file://{file}">]>',
    "an address": '<!DOCTYPE a [<!ENTITY e SYSTEM "http://127.0.0.1:{port}/e">]>',
    "a document type elsewhere": '<!DOCTYPE a SYSTEM "http://127.0.0.1:{port}/a.dtd">',
    "a parameter": '<!DOCTYPE a [<!ENTITY % e SYSTEM "http://127.0.0.1:{port}/e"> %e;]>',
    "a document type of nothing": "<!DOCTYPE a>",
}
FORMS = {".kml": KML, ".gpx": GPX, ".xml": TASKS}


@pytest.fixture
def canary(tmp_path: Path) -> Path:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "secret").write_text(SECRET)
    return tmp_path / "elsewhere" / "secret"


def refused(read: Callable[[], object]) -> str:
    with pytest.raises(HeadlandError) as refusal:
        read()
    assert SECRET not in str(refusal.value) and "\n" not in str(refusal.value)
    return str(refusal.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("before", BEFORE.values(), ids=BEFORE)
@pytest.mark.parametrize("declared", DECLARED.values(), ids=DECLARED)
@pytest.mark.parametrize("ending", FORMS)
def test_declarations(ending: str, declared: str, before: str, encoding: str, tmp_path: Path, canary: Path) -> None:
    with listening() as (port, calls):
        head = before + declared.format(value=SECRET, file=canary, port=port)
        name = "" if "nothing" in declared or "a.dtd" in declared else "&e;"
        text = head + FORMS[ending].format(name=name, more="", attributes="")
        content = text.encode(encoding)
        place = tmp_path / f"x{ending}"
        place.write_bytes(content)
        assert "document type or entities" in refused(lambda: read_field(place))
        packed = tmp_path / ("x.kmz" if ending == ".kml" else "x.zip")
        inner = {".kml": "doc.kml", ".gpx": "x.gpx", ".xml": "TASKDATA.XML"}[ending]
        with zipfile.ZipFile(packed, "w") as archive:
            archive.writestr(inner, content)
        assert "document type or entities" in refused(lambda: read_field(packed))
        if ending == ".xml":
            refused(lambda: isoxml_logs.LOG_FORMAT.read(str(packed), "'x'"))
        assert calls == []


@pytest.mark.parametrize("ending", FORMS)
def test_the_same_without_declarations_is_read(ending: str, tmp_path: Path) -> None:
    for before in BEFORE.values():
        place = tmp_path / f"x{ending}"
        place.write_text(before + FORMS[ending].format(name="A & B".replace("&", "&amp;"), more="", attributes=""))
        assert read_field(place).name in ("A & B", "x")


def test_links_of_a_kml_are_not_followed(tmp_path: Path, canary: Path) -> None:
    with listening() as (port, calls):
        links = "".join(
            f"<NetworkLink><Link><href>{href}</href></Link></NetworkLink>"
            for href in (f"http://127.0.0.1:{port}/a.kml", f"file://{canary}", str(canary))
        )
        more = (
            f'{links}<Style id="s"><IconStyle><Icon><href>http://127.0.0.1:{port}/i.png</href></Icon></IconStyle>'
            f"</Style><GroundOverlay><Icon><href>http://127.0.0.1:{port}/o.png</href></Icon></GroundOverlay>"
            f'<Placemark><styleUrl>http://127.0.0.1:{port}/s.kml#a</styleUrl><description>&lt;a href="{canary}"&gt;'
            "</description><Point><coordinates>10.001,50.001</coordinates></Point></Placemark>"
        )
        schema = (
            ' xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
            f'xsi:schemaLocation="http://www.opengis.net/kml/2.2 http://127.0.0.1:{port}/a.xsd"'
        )
        (tmp_path / "x.kml").write_text(KML.format(name="A", more=more, attributes=schema))
        with zipfile.ZipFile(tmp_path / "x.kmz", "w") as archive:
            archive.write(tmp_path / "x.kml", "doc.kml")
        for name in ("x.kml", "x.kmz"):
            found = read_field(tmp_path / name)
            assert found.name == "A" and SECRET not in repr(found)
        assert calls == []


@pytest.mark.parametrize("ending", [".kml", ".gpx"])
@pytest.mark.parametrize("depth", [MAX_XML_DEPTH + 1, 200_000])
def test_elements_in_elements(ending: str, depth: int, tmp_path: Path) -> None:
    root = ending[1:]
    place = tmp_path / f"x{ending}"
    place.write_text(f"<{root}>" + "<Folder>" * depth + "</Folder>" * depth + f"</{root}>")
    assert "nested too deeply" in refused(lambda: read_field(place))


@pytest.mark.parametrize("ending, form", [(".kml", "KML"), (".gpx", "GPX")])
def test_xml_of_another_root(ending: str, form: str, tmp_path: Path) -> None:
    place = tmp_path / f"x{ending}"
    place.write_text('<OGRVRTDataSource xmlns="http://www.opengis.net/kml/2.2"/>')
    assert f"is XML but not {form} (its root is 'OGRVRTDataSource')" in refused(lambda: read_field(place))


@pytest.mark.parametrize("content", [b"", b"\0", b"<", b"\xff\xfe<", b"<a>&e;</a>", b"plain", b"<a></b>"])
def test_what_is_no_xml(content: bytes) -> None:
    for read in (lambda: parse_root(content, "'x'"), lambda: check_xml_root(content, "'x'", "KML", ("kml",))):
        with pytest.raises(FieldError, match=r"^'x' "):
            read()
