"""The fields of a file, one to a line."""

from __future__ import annotations

import json
from collections.abc import Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from fields.read import Listed
from reports.wording import NOTHING


def parcels_table(parcels: Sequence[Listed]) -> RenderableType:
    """Position, key, area in hectares and number of holes of every field, or why it cannot be used."""
    table = Table(box=None, header_style="bold", padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("#", justify="right", no_wrap=True)
    table.add_column("ID", overflow="fold")
    table.add_column("Area (ha)", justify="right", no_wrap=True)
    table.add_column("Holes", justify="right", no_wrap=True)
    if any(parcel.fault for parcel in parcels):
        table.add_column("Not usable", overflow="fold", ratio=1)
    for parcel in parcels:
        area = NOTHING if parcel.area_ha is None else f"{parcel.area_ha:.2f}"
        holes = NOTHING if parcel.holes is None else str(parcel.holes)
        table.add_row(str(parcel.position), *(Text(text) for text in (parcel.key, area, holes, parcel.fault) if text))
    return table


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
