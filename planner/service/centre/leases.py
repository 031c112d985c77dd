"""Who drives which tractor by remote control: one operator at a time."""

from __future__ import annotations

from planner.service.centre.errors import LeaseError


class Leases:
    """Holders by tractor; a holder is one link of one operator."""

    def __init__(self) -> None:
        self._holders: dict[int, str] = {}

    def holder(self, tractor: int) -> str | None:
        """Who drives a tractor."""
        return self._holders.get(tractor)

    def held_by(self, who: str) -> list[int]:
        """The tractors that somebody drives."""
        return sorted(tractor for tractor, holder in self._holders.items() if holder == who)

    def take(self, tractor: int, who: str, takeover: bool) -> str | None:
        """Give a tractor to somebody; returns from whom it was taken. Raises LeaseError for one that is driven."""
        before = self._holders.get(tractor)
        if before not in (None, who) and not takeover:
            raise LeaseError(f"Tractor {tractor + 1} is driven by {before}; take it over to drive it yourself.")
        self._holders[tractor] = who
        return before if before != who else None

    def check(self, tractor: int, who: str) -> None:
        """Raise LeaseError unless somebody drives this tractor."""
        holder = self._holders.get(tractor)
        if holder != who:
            told = "nobody drives it" if holder is None else f"{holder} drives it"
            raise LeaseError(f"Tractor {tractor + 1} is not yours to drive, {told}; take the lease first.")

    def leave(self, tractor: int, who: str) -> bool:
        """Give a tractor back; whether it was held."""
        if self._holders.get(tractor) != who:
            return False
        del self._holders[tractor]
        return True
