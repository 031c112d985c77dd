"""A folder or archive with one field file in it, and with several."""

import zipfile
from pathlib import Path

import pytest

from fields.documents.reader import list_fields, read_field
from fields.errors import FieldError
from fields.sample_fields import list_sample_names, read_sample_text

KML = (
    '<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>{name}</name><Polygon><outerBoundaryIs>'
    "<LinearRing><coordinates>{x},48 {x}.002,48 {x}.002,48.002 {x},48.002 {x},48</coordinates></LinearRing>"
    "</outerBoundaryIs></Polygon></Placemark></Document></kml>"
)


def archive(place: Path, **files: str) -> Path:
    with zipfile.ZipFile(place, "w") as packed:
        for name, text in files.items():
            packed.writestr(name.replace("__", "/").replace("_", "."), text)
    return place


def test_a_zipped_geojson_is_the_same_field(tmp_path: Path) -> None:
    text = read_sample_text(list_sample_names()[0])
    (tmp_path / "field.geojson").write_text(text)
    alone = read_field(tmp_path / "field.geojson")
    packed = read_field(archive(tmp_path / "field.zip", farm__field_geojson=text, readme_txt="hello"))
    assert packed.boundary.equals(alone.boundary)
    assert read_field(tmp_path.parent / tmp_path.name, name=alone.name).boundary.equals(alone.boundary)


def test_a_folder_of_an_archive_may_have_a_colon_in_its_name(tmp_path: Path) -> None:
    place = tmp_path / "farm.zip"
    with zipfile.ZipFile(place, "w") as packed:
        packed.writestr("North: 3:4/field.kml", KML.format(name="North", x=15))
    assert read_field(place).name == "North"


def test_of_several_none_is_guessed(tmp_path: Path) -> None:
    place = archive(tmp_path / "two.zip", a_kml=KML.format(name="A", x=15), b_geojson="{}")
    with pytest.raises(FieldError, match=r"holds 2 field files \(a\.kml, b\.geojson\); unpack it and name one of them"):
        read_field(place)


def test_every_document_of_a_kmz_is_read(tmp_path: Path) -> None:
    place = archive(
        tmp_path / "farm.kmz", files__a_kml=KML.format(name="East", x=16), doc_kml=KML.format(name="West", x=15)
    )
    assert [one.key for one in list_fields(place)] == ["West", "East"]


def test_hidden_folders_are_not_searched(tmp_path: Path) -> None:
    (tmp_path / ".stversions").mkdir()
    (tmp_path / ".stversions" / "old.kml").write_text(KML.format(name="Old", x=15))
    (tmp_path / "new.kml").write_text(KML.format(name="New", x=16))
    assert read_field(tmp_path).name == "New"
