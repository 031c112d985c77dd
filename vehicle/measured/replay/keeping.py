"""What was replayed once, kept: the same stretch with the same effects is never driven twice while there is room."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping

from vehicle.effects import REST_KEY, effect
from vehicle.learnt import Settings
from vehicle.measured.logs.record import Array

MOST_BYTES = 200_000_000  # chosen: the states of ninety drives through a quarter of an hour, a tenth of 2 GB
Effects = tuple[tuple[str, tuple[tuple[str, float], ...]], ...]


class Kept:
    """Arrays by what they were made of; those that nobody has asked for longest go first."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        """An empty store for so many bytes."""
        self._most, self._bytes = most_bytes, 0
        self._found: OrderedDict[Hashable, tuple[Array, ...]] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], tuple[Array, ...]]) -> tuple[Array, ...]:
        """The arrays of a key, made where they are not kept. They are shared: nobody may write to them."""
        found = self.find(key)
        return self.keep(key, make()) if found is None else found

    def find(self, key: Hashable) -> tuple[Array, ...] | None:
        """The arrays of a key where they are kept."""
        found = self._found.get(key)
        if found is not None:
            self._found.move_to_end(key)
        return found

    def keep(self, key: Hashable, made: tuple[Array, ...]) -> tuple[Array, ...]:
        """Keep arrays under a key that has none, which from now on nobody may write to."""
        for one in made:
            one.flags.writeable = False
        self._found[key] = made
        self._bytes += sum(one.nbytes for one in made)
        while self._bytes > self._most:
            _, gone = self._found.popitem(last=False)
            self._bytes -= sum(one.nbytes for one in gone)
        return made


def of_blocks(settings: Settings, blocks: frozenset[str]) -> Settings:
    """The effects that sit in some blocks of the chain, and the rest."""
    return {name: values for name, values in settings.items() if name == REST_KEY or effect(name).block in blocks}


def key_of(settings: Mapping[str, Mapping[str, float]]) -> Effects:
    """Settings as a key, in the order of their names."""
    return tuple((name, tuple(sorted(settings[name].items()))) for name in sorted(settings))
