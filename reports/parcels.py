"""The fields of a file, one to a line."""

from __future__ import annotations

import json
from collections.abc import Sequence

from rich.console import RenderableType

from fields.read import Listed
from reports.fitting import Column, FittedTable
from reports.wording import NOTHING, number


def parcels_table(parcels: Sequence[Listed]) -> RenderableType:
    """Position, key, area in hectares and number of holes of every field, or why it cannot be used."""
    columns = [Column("#"), Column("ID", words=True), Column("Area (ha)"), Column("Holes")]
    if any(parcel.fault for parcel in parcels):
        columns.append(Column("Not usable", words=True))
    rows = tuple(
        (
            str(parcel.position),
            parcel.key,
            number(parcel.area_ha, 2),
            NOTHING if parcel.holes is None else str(parcel.holes),
            parcel.fault,
        )[: len(columns)]
        for parcel in parcels
    )
    return FittedTable(tuple(columns), rows)


def parcels_json(parcels: Sequence[Listed]) -> str:
    """A list of objects: position, id, area_ha and holes (null where it cannot be used), fault (null or why)."""
    rows = [
        {
            "position": parcel.position,
            "id": parcel.key,
            "area_ha": None if parcel.area_ha is None else round(parcel.area_ha, 4),
            "holes": parcel.holes,
            "fault": parcel.fault or None,
        }
        for parcel in parcels
    ]
    return json.dumps(rows, indent=2, allow_nan=False) + "\n"
