"""Forms of field files: one record each, chosen by the ending; a new one is used wherever a field is named."""

from pathlib import Path

import pytest

from fields import list_fields, read_field
from fields.documents import sources
from fields.documents.sources import FIELD_FORMATS, find_field_format
from fields.formats import geojson, gpx, isoxml, shapefile
from fields.formats.format_records import list_records
from fields.formats.guidance import GuidanceFormat
from fields.raw_document import FieldDocument, FieldFormat, RawShape


def squares(path: str, label: str) -> FieldDocument:
    """A toy form: a side in metres a line, a square each."""
    sides = [float(line) for line in Path(path).read_text().split()]
    rings = [[[[0, 0], [side, 0], [side, side], [0, side], [0, 0]]] for side in sides]
    polygons = tuple(RawShape("Polygon", ring, (f"square-{number}",), {}) for number, ring in enumerate(rings))
    return FieldDocument(polygons, (), (), None, "local_metres", {}, "drawn")


def test_endings_are_told_apart() -> None:
    endings = [ending for form in FIELD_FORMATS for ending in form.extensions]
    assert len(set(endings)) == len(endings)
    assert all(ending.startswith(".") and ending == ending.lower() for ending in endings)
    assert (
        find_field_format("a/b.GeoJSON") is geojson.FIELD_FORMAT and find_field_format("plain") is geojson.FIELD_FORMAT
    )
    assert find_field_format("parcels.SHP") is shapefile.FIELD_FORMAT and find_field_format("parcels.DXF") is None


def test_a_new_form_is_a_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    toy = FieldFormat("squares", (".sq",), squares)
    monkeypatch.setattr(sources, "FIELD_FORMATS", (*FIELD_FORMATS, toy))
    place = tmp_path / "two.sq"
    place.write_text("30\n50\n")
    assert [one.area_ha for one in list_fields(place)] == [0.09, 0.25]
    field = read_field(f"{place}#square-1")
    assert field.area_m2 == pytest.approx(2500.0) and field.crs is None and field.source == "drawn"


def test_records_are_found_in_the_modules_of_formats() -> None:
    forms = list_records(FieldFormat, first=("gpx",))
    modules = [form.read.__module__ for form in forms]
    assert forms[0] is gpx.FIELD_FORMAT and modules[1:] == sorted(modules[1:])
    assert set(forms) == set(FIELD_FORMATS) and len(forms) == len(FIELD_FORMATS)
    older = [form.name for form in list_records(GuidanceFormat, first=("isoxml",))][:2]
    assert older == [isoxml.GUIDANCE_FORMAT_4.name, isoxml.GUIDANCE_FORMAT_4.older]
