"""CPU seconds per part of planning: functions of the planner are timed while a ledger is open.

Time is booked on the innermost of them that is running, so that the parts add up to the whole.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

PARTS = ("layout", "order", "paths", "traffic", "simulation", "measuring", "other")
_EVALUATE = "planner.evaluation.candidates.evaluate"
PLACES = {
    "layout": ("planner.evaluation.preparation.prepare_context",),
    "order": (f"{_EVALUATE}.sketch_plans", "strategies.programmes.programme.make_programme"),
    "paths": ("strategies.moves.move_finder.MoveFinder.search", "strategies.moves.move_finder.MoveFinder.list_moves"),
    "traffic": ("planner.evaluation.candidates.fleet_drive.schedule_plan",),
    "simulation": ("vehicle.sim.incremental.IncrementalSimulator.simulate", "vehicle.sim.world.World.run"),
    "measuring": (f"{_EVALUATE}.measure_candidate", f"{_EVALUATE}._find_fault", f"{_EVALUATE}.find_contact_places"),
}


class Ledger:
    """CPU seconds per part of PARTS since the ledger was opened."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(PARTS, 0.0)
        self._stack = ["other"]
        self._since = time.process_time()

    def _book(self) -> None:
        now = time.process_time()
        self.seconds[self._stack[-1]] += now - self._since
        self._since = now

    @contextmanager
    def book_part(self, name: str) -> Iterator[None]:
        """Book the time inside on a part."""
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


def _wrap_timed(ledger: Ledger, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    def call(*given: Any, **options: Any) -> Any:
        with ledger.book_part(name):
            return function(*given, **options)

    return call


def _find_owner(place: str) -> tuple[Any, str]:
    """The module or class that holds a function, and the function's name there."""
    path, name = place.rsplit(".", 1)
    try:
        return import_module(path), name
    except ModuleNotFoundError:
        module, cls = path.rsplit(".", 1)
        return getattr(import_module(module), cls), name


@contextmanager
def open_ledger() -> Iterator[Ledger]:
    """A ledger that books the functions of PLACES, which are restored afterwards."""
    ledger = Ledger()
    originals: list[tuple[Any, str, Any]] = []
    try:
        for part, places in PLACES.items():
            for place in places:
                owner, name = _find_owner(place)
                originals.append((owner, name, getattr(owner, name)))
                setattr(owner, name, _wrap_timed(ledger, part, getattr(owner, name)))
        yield ledger
    finally:
        for owner, name, function in reversed(originals):
            setattr(owner, name, function)
