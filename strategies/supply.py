"""What a tractor carries and uses at work, or collects, and where that is made good."""

from __future__ import annotations

from dataclasses import dataclass

PLACE, HEADLAND, TENDER = "place", "headland", "tender"
Point = tuple[float, float]


@dataclass(frozen=True)
class Supply:
    """A tank, the same on every tractor: litres or kilograms, and per square metre worked.

    It is full at the start and empties at work; one that `collects` is empty and fills. A stop of `refill_s` seconds
    makes it full, or empty, again: at a `place` (metres) that one tractor has at a time, at the end of a track on the
    headland ("headland"), or there by a tender that serves one at a time.
    """

    capacity: float
    rate_per_m2: float
    refill_s: float
    collects: bool = False
    where: str = HEADLAND
    place: Point | None = None

    @property
    def alone(self) -> bool:
        """Whether tractors are served one at a time."""
        return self.where != HEADLAND

    def need(self, length_m: float, width_m: float) -> float:
        """What working so far takes of a load."""
        return self.rate_per_m2 * length_m * width_m

    def level(self, used: float) -> float:
        """What the tank holds when so much of a load is used."""
        return used if self.collects else self.capacity - used
