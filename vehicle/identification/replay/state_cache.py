"""Cache of replayed states: the same segment with the same effects is not driven twice while there is room."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping

from vehicle.identification.logs.schema import Array
from vehicle.model.effects import DISCREPANCY_KEY, get_effect
from vehicle.model.tractor import Settings

MOST_CACHE_BYTES = 200_000_000  # chosen: the states of ninety replays of a quarter of an hour, a tenth of 2 GB
EffectsKey = tuple[tuple[str, tuple[tuple[str, float], ...]], ...]


class ReplayCache:
    """Arrays by key; the least recently used are dropped first."""

    def __init__(self, most_bytes: int = MOST_CACHE_BYTES) -> None:
        """Create an empty cache of so many bytes."""
        self._most_bytes, self._bytes = most_bytes, 0
        self._arrays: OrderedDict[Hashable, tuple[Array, ...]] = OrderedDict()

    def get_or_make_arrays(self, key: Hashable, make: Callable[[], tuple[Array, ...]]) -> tuple[Array, ...]:
        """Return the arrays of a key, made if missing. They are shared and read-only."""
        arrays = self.find_cached_arrays(key)
        return self.store(key, make()) if arrays is None else arrays

    def find_cached_arrays(self, key: Hashable) -> tuple[Array, ...] | None:
        """Return the arrays of a key, if cached."""
        arrays = self._arrays.get(key)
        if arrays is not None:
            self._arrays.move_to_end(key)
        return arrays

    def store(self, key: Hashable, arrays: tuple[Array, ...]) -> tuple[Array, ...]:
        """Cache arrays under a new key; they become read-only."""
        for array in arrays:
            array.flags.writeable = False
        self._arrays[key] = arrays
        self._bytes += sum(array.nbytes for array in arrays)
        while self._bytes > self._most_bytes:
            _, dropped = self._arrays.popitem(last=False)
            self._bytes -= sum(array.nbytes for array in dropped)
        return arrays


def split_settings_by_block(settings: Settings, blocks: frozenset[str]) -> Settings:
    """Split the effects into those of some blocks of the chain and the others."""
    return {
        name: values for name, values in settings.items() if name == DISCREPANCY_KEY or get_effect(name).block in blocks
    }


def make_settings_key(settings: Mapping[str, Mapping[str, float]]) -> EffectsKey:
    """Return settings as a cache key, in the order of their names."""
    return tuple((name, tuple(sorted(settings[name].items()))) for name in sorted(settings))


X_COLUMN, Y_COLUMN, ANGLE_COLUMN, STEERING_COLUMN, FORWARD_COLUMN = range(
    5
)  # columns: place (m) and angle (rad), wheel angle (rad), speed (m/s)
