"""Labels of options and strategies in forms, options with their units (the key is the name, the text English).

Also which parameters name single tracks, and which number none anew.
"""

from __future__ import annotations

from planner.errors import strip_unit
from strategies.names import STRATEGY_DESCRIPTIONS

LABELS = {
    "field": "Field", "local": "The file is in local metres", "swap_axes": "Latitude or northing comes first",
    "crs": "Coordinate system", "part": "Part of a divided field", "margin": "Distance to obstacles and fences, m",
    "overhang": "Reach over open edges, m", "open_edges": "Edges are open",
    "obstacle": "More obstacles", "ignore": "Obstacles to leave out",
    "entrance": "Entrance", "guidance_line": "Lay the tracks", "bearing": "Direction of tracks, degrees",
    "cell_bearing": "Direction in one cell, degrees", "swaths": "Tracks",
    "tractor": "Tractor", "tractors": "Number of tractors", "farm": "Farm", "implement": "Implement of the farm",
    "width": "Working width, m", "speed_kmh": "Working speed, km/h", "turn_speed_kmh": "Turn speed, km/h",
    "min_speed_kmh": "Least working speed, km/h", "max_speed_kmh": "Greatest working speed, km/h",
    "radius": "Turning radius, m", "clearance": "Least distance between machines, m",
    "transport_width": "Width of the implement when folded, m", "sections": "Sections of the implement",
    "refill": "Refill at",
    "draft": "Implement of the table of drafts", "depth_cm": "Working depth, cm",
    "operation": "Work", "strategies": "Strategies", "turn": "Turns", "corners": "Corners of the headland",
    "headland": "Headland depth, m", "headland_passes": "Passes on the headland",
    "headland_order": "Work the headland", "headland_first": "Headland before the tracks",
    "headland_last": "Headland after the tracks", "no_headland": "Headland left unworked",
    "leave_out": "Tracks to leave out", "work_first": "Tracks to work first", "give": "Tracks of one tractor",
    "elevation": "Heights of the field", "elevation_crs": "Coordinate system of the heights", "soil": "Soil",
    "moisture": "Moisture of the soil, percent", "rain_mm": "Rain of the last days, mm",
    "et0_mm": "Evapotranspiration of those days, mm a day",
    "start": "Start", "deadline": "Done by", "rain": "Rain", "objective": "The best plan is the", "budget": "Budget",
    "price_per_hour": "Price per tractor and hour", "price_per_tractor": "Price per tractor brought",
    "samples": "Samples of what varies", "seed": "Seed", "all": "Simulate every plan, however slow",
    "gnss": "Simulate GNSS errors", "gnss_table": "GNSS errors by a table",
}  # fmt: skip
STRATEGY_LABELS = {name: f"{name}: {description}" for name, description in STRATEGY_DESCRIPTIONS.items()}
WISHES = ("leave_out", "work_first", "give")
"""Parameters that name single tracks and headland passes."""
APPRAISED = ("price_per_hour", "price_per_tractor", "start_s", "deadline_s", "samples", "budget", "rain", "objective")
"""Parameters that change no drive, only what it is worth; an objective also says which drives are tried."""
UNLAID = frozenset(("tractors", "strategies", "seed", *WISHES, *APPRAISED)) - {"rain", "objective"}
"""Parameters that the choice of a layout does not ask for: with any values of them tracks have the same numbers."""


def quote_label(parameter: str) -> str:
    """The label of the option of a parameter in quotes, for sentences; its name where it has no label."""
    name = strip_unit(parameter)
    return f"\u201c{LABELS[name]}\u201d" if name in LABELS else name
