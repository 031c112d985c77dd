"""Where the CPU seconds of a plan go: functions of the planner are timed while a ledger is open.

Time belongs to the innermost of them that is running, so that the parts add up to the whole.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

PARTS = ("layout", "order", "ways", "right of way", "simulation", "measuring", "rest")
PLACES = {
    "layout": ("planner.site.prepare",),
    "order": (
        "planner.candidates.evaluate._run_job",
        "strategies.orders.table.TurnTable.__init__",
        "strategies.orders.tours.searched",
        "planner.candidates.evaluate.corners_by_promise",
    ),
    "ways": ("strategies.ways.connect.Connector.connect", "strategies.ways.connect.Connector.direct"),
    "right of way": ("planner.candidates.evaluate.giving_way",),
    "simulation": ("vehicle.rehearsal.Rehearsal.simulate", "vehicle.world.World.run"),
    "measuring": (
        *(f"planner.candidates.evaluate.{name}" for name in ("_measured", "_fault", "slips")),
    ),
}  # fmt: skip


class Ledger:
    """CPU seconds per part of PARTS since it was opened."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(PARTS, 0.0)
        self._stack = ["rest"]
        self._since = time.process_time()

    def _book(self) -> None:
        now = time.process_time()
        self.seconds[self._stack[-1]] += now - self._since
        self._since = now

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """What runs inside is booked on a part."""
        self._book()
        self._stack.append(name)
        try:
            yield
        finally:
            self._book()
            self._stack.pop()

    @property
    def total_s(self) -> float:
        """CPU seconds of all parts."""
        self._book()
        return sum(self.seconds.values())


def _timed(ledger: Ledger, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    def around(*given: Any, **options: Any) -> Any:
        with ledger.part(name):
            return function(*given, **options)

    return around


def _owner(place: str) -> tuple[Any, str]:
    """The module or class that holds a function, and the function's name there."""
    path, name = place.rsplit(".", 1)
    try:
        return import_module(path), name
    except ModuleNotFoundError:
        module, cls = path.rsplit(".", 1)
        return getattr(import_module(module), cls), name


@contextmanager
def opened() -> Iterator[Ledger]:
    """A ledger that books the functions of PLACES; they are as before afterwards."""
    ledger = Ledger()
    kept: list[tuple[Any, str, Any]] = []
    try:
        for part, places in PLACES.items():
            for place in places:
                owner, name = _owner(place)
                kept.append((owner, name, getattr(owner, name)))
                setattr(owner, name, _timed(ledger, part, getattr(owner, name)))
        yield ledger
    finally:
        for owner, name, function in reversed(kept):
            setattr(owner, name, function)
