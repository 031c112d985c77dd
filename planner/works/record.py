"""What is known of one run of work: as a file has it, and in metres."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

ACTIVE_M, INACTIVE_M, ACTIVE_S, INACTIVE_S, AREA_M2, FUEL_L = (
    "active_m", "inactive_m", "active_s", "inactive_s", "area_m2", "fuel_l"
)  # fmt: skip
COUNTERS = (ACTIVE_M, INACTIVE_M, ACTIVE_S, INACTIVE_S, AREA_M2, FUEL_L)
"""What machines count themselves, by the names that files of runs have."""


@dataclass(frozen=True, eq=False)
class Logged:
    """One run as its file has it, in longitude and latitude.

    Attributes:
        name: of the log in its file, such as TLG00001.
        form: of the file, in words.
        lonlat: (n, 2) degrees; rows without a position are left out already.
        time_s: (n,) from the first row, rising.
        speed_mps: (n,), None where the file has none.
        works: (n,) whether the implement worked, None where the file does not say.
        width_m: working width, None where the file does not say.
        start: of the first row, "2020-01-02T17:30:20" as the file has it, "" where it has none.
        field: name of the field, "" where the file has none.
        counters: what the machine counted over the run, by names of COUNTERS.
        outline: rings of the field in degrees, the outer one first; nothing where the file has none.
        outline_m2: area of the field as the file says it.
        notes: sentences on what was left out or taken for something.
    """

    name: str
    form: str
    lonlat: Array
    time_s: Array
    speed_mps: Array | None = None
    works: Mask | None = None
    width_m: float | None = None
    start: str = ""
    field: str = ""
    counters: dict[str, float] = dataclasses.field(default_factory=dict)
    outline: tuple[Array, ...] = ()
    outline_m2: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Driven:
    """One run in metres of `crs`: what all that follows works with.

    Attributes:
        heading_deg: (n,) course over ground, clockwise from north.
        works_known: False where nobody said when the implement worked; `works` is then False throughout.
        speed_logged: whether the speed was logged; else it is from the positions.
        outline: the field where it is known.
        outline_m2: its area as the file of the run says it.
    """

    name: str
    form: str
    crs: str
    time_s: Array
    xy: Array
    heading_deg: Array
    speed_mps: Array
    works: Mask
    works_known: bool = True
    speed_logged: bool = True
    width_m: float | None = None
    start: str = ""
    field: str = ""
    counters: dict[str, float] = dataclasses.field(default_factory=dict)
    outline: shapely.Polygon | None = None
    outline_m2: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Found:
    """Runs of a file, and sentences on what of it could not be read."""

    runs: tuple[Logged, ...]
    notes: tuple[str, ...] = ()
