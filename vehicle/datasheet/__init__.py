"""A whole tractor from what a maker's datasheet says.

    sheet    Datasheet: the values, what is usual, and what cannot be
    rules    everything else by rules, each with its words under [source]
    whole    tractor_from: the tractor as the simulator needs it; remarks on what looks odd
"""

from vehicle.datasheet.sheet import NEEDED, QUANTITIES, Datasheet, lacking, sheet_from
from vehicle.datasheet.whole import remarks, tractor_from

__all__ = ["NEEDED", "QUANTITIES", "Datasheet", "lacking", "remarks", "sheet_from", "tractor_from"]
