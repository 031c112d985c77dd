"""What a farm's own logs taught: beside a value its interval and the runs it is from, so that it can be cited."""

from __future__ import annotations

from pydantic import Field

from planner.farm.values import Section, other


class LearnedValue(Section):
    """One value that `headland learn` put into the farm file; it is cited for as long as the value stands there.

    `key` names the value as sources do, such as "chances.turn_cv" or "implements.drill.speed_kmh".
    """

    key: str = Field(strict=True, min_length=1, description="in quotes")
    value: float | str = Field(description="as it stands in the file")
    low: float | None = other(None, "where the 95 % interval begins")
    high: float | None = other(None, "where it ends")
    told: str = other("", "in quotes")
    runs: tuple[str, ...] = other((), "names in quotes")

    def words(self) -> str:
        """Value, interval and origin: "7.2 (95 %: 6.9 to 7.6), median of 17 runs"."""
        interval = "" if self.low is None or self.high is None else f" (95 %: {self.low:g} to {self.high:g})"
        value = self.value if isinstance(self.value, str) else f"{self.value:g}"
        return f"{value}{interval}, {self.told}" if self.told else f"{value}{interval}"
