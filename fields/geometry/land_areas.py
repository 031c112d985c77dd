"""Whether a place can be farmland, by the areas for which PROJ's register of coordinate systems (EPSG) has systems.

The register says for about 2,500 parts of countries between which longitudes and latitudes they lie. Boxes are larger
than countries: what lies in one may be sea, but land lies in one. No inhabited place of the tz database lies in none
(`tests/fields/test_whereabouts.py`), except in Antarctica and on atolls.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

FARMED_LATITUDES_DEG = (-56.0, 72.0)
"""No farmland lies south of Tierra del Fuego or north of the North Cape."""
MAX_BOX_DEG2 = 6.0 * 84.0
"""A zone of UTM from the equator to its end; larger boxes are regions with seas between their countries."""
_AREAS = """
    SELECT name, description, west_lon, south_lat, east_lon, north_lat FROM extent
    WHERE auth_name = 'EPSG' AND name NOT LIKE 'World%' AND name NOT LIKE 'Arctic%' AND name NOT LIKE 'Antarctica%'
      AND (east_lon - west_lon + 360 * (east_lon < west_lon)) * (north_lat - south_lat) <= ?
"""
"""Areas of the register, whose names begin with a country or continent and " - "."""


def can_be_farmland(longitude_deg: float, latitude_deg: float) -> bool:
    """Whether a place lies at the latitudes of farmland and in the box of a country or of a part of one."""
    west, south, east, north = _read_land_boxes().T
    crosses_180 = (west > east) & ((longitude_deg >= west) | (longitude_deg <= east))
    in_longitude = (west <= longitude_deg) & (longitude_deg <= east) | crosses_180
    is_farmed = FARMED_LATITUDES_DEG[0] <= latitude_deg <= FARMED_LATITUDES_DEG[1]
    return is_farmed and bool((in_longitude & (south <= latitude_deg) & (latitude_deg <= north)).any())


@lru_cache(maxsize=1)
def _read_land_boxes() -> npt.NDArray[np.float64]:
    """West, south, east and north in degrees of areas on land, and of countries with their sea that have no such area.

    None if the register has another form.
    """
    from pyproj.datadir import get_data_dir

    register = Path(get_data_dir()) / "proj.db"
    try:
        with closing(sqlite3.connect(f"{register.as_uri()}?mode=ro&immutable=1", uri=True)) as connection:
            areas = connection.execute(_AREAS, (MAX_BOX_DEG2,)).fetchall()
    except sqlite3.Error:
        areas = []
    on_land = [(name, *box) for name, description, *box in areas if "offshore" not in description.lower()]
    countries = {name.partition(" - ")[0] for name, *_ in on_land}
    boxes = [box for _, *box in on_land]
    boxes += [
        box
        for name, description, *box in areas
        if "onshore and offshore" in description.lower() and name.partition(" - ")[0] not in countries
    ]
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)
