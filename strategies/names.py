"""Names of the strategies in the order in which they are offered; imports nothing, so that help texts stay quick.

Other packages offer strategies as entry points in the group ENTRY_POINT_GROUP.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

STRATEGY_NAMES = (
    "row-by-row",
    "row-by-row-optimised",
    "col-by-col",
    "split-field",
    "interleaved",
)
ENTRY_POINT_GROUP = "headland.strategies"


def list_strategy_names() -> tuple[str, ...]:
    """Headland's names in their order, then those of other packages by the alphabet."""
    return tuple(dict.fromkeys((*STRATEGY_NAMES, *(one.name for one in list_entry_points()))))


@cache
def list_entry_points() -> tuple[EntryPoint, ...]:
    """The strategies of other packages by name and package, not loaded."""
    from importlib.metadata import entry_points

    return tuple(sorted(entry_points(group=ENTRY_POINT_GROUP), key=lambda one: (one.name, get_package_name(one))))


def get_package_name(entry: EntryPoint) -> str:
    """The name of the package that has an entry point."""
    return entry.value if entry.dist is None else entry.dist.name
