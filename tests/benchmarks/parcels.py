"""The parcels of a folder of field files, as benchmarks plan them."""

from collections.abc import Iterator
from pathlib import Path

from fields.documents.reader import list_fields, read_field
from fields.errors import FieldError
from fields.geometry.field import Field

ENDINGS = (".geojson", ".json")


def iter_parcels(folder: Path) -> Iterator[Field]:
    """Every parcel of the GeoJSON files in and below a folder, by names of files; what cannot be read is printed."""
    for path in sorted(one for one in folder.rglob("*") if one.suffix in ENDINGS):
        try:
            places = [f"{path}#{one.position}" for one in list_fields(path)]
        except FieldError as refusal:
            print(f"{path.name}: not read, {refusal}")
            continue
        for place in places:
            try:
                yield read_field(place)
            except FieldError as refusal:
                print(f"{Path(place).name}: not read, {refusal}")
