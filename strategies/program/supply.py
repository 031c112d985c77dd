"""What a tractor carries and uses at work, or collects, and where it is refilled or emptied."""

from __future__ import annotations

from dataclasses import dataclass

PLACE, HEADLAND, SERVICE_VEHICLE = "place", "headland", "tender"
Point = tuple[float, float]


@dataclass(frozen=True)
class Supply:
    """A tank, the same on every tractor: capacity in litres or kilograms, use per square metre worked.

    It starts full and empties at work; a tank that `collects` starts empty and fills. A stop of `stop_s` seconds
    refills (or empties) it: at a `place` (x, y in m) with room for one tractor at a time, at the end of a swath on the
    headland, or there by a service vehicle that serves one tractor at a time.
    """

    capacity: float
    rate_per_m2: float
    stop_s: float
    collects: bool = False
    served_at: str = HEADLAND
    place: Point | None = None

    @property
    def one_at_a_time(self) -> bool:
        """Whether tractors are served one at a time."""
        return self.served_at != HEADLAND

    def compute_need(self, length_m: float, width_m: float) -> float:
        """The part of a load that this work takes."""
        return self.rate_per_m2 * length_m * width_m

    def compute_level(self, used: float) -> float:
        """What is in the tank when this much of a load is used."""
        return used if self.collects else self.capacity - used
