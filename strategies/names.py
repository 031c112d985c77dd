"""Names and descriptions of the strategies in the order in which they are offered, for help texts and forms.

Every module beside this one that has a STRATEGY is a strategy of Headland. They are read and not imported, as importing
one loads the simulator. Other packages offer strategies as entry points in the group ENTRY_POINT_GROUP.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ENTRY_POINT_GROUP = "headland.strategies"
FIRST_OFFERED = ("row-by-row", "row-by-row-optimised", "col-by-col", "split-field")
"""All others follow by the alphabet. The first of a request stands for all of them with one tractor alone."""


def read_descriptions(folder: Path) -> dict[str, str]:
    """The description of every strategy that has a module in a folder, by name."""
    sources = {file.stem.replace("_", "-"): file.read_text(encoding="utf-8") for file in folder.glob("*.py")}
    found = {name: text for name, source in sources.items() if (text := _find_description(source)) is not None}
    return dict(sorted(found.items(), key=lambda entry: (_get_place(entry[0]), entry[0])))


def _find_description(source: str) -> str | None:
    """The second argument of the record STRATEGY of a module; None without such a record."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "STRATEGY":
            return str(ast.literal_eval(node.value.args[1])) if isinstance(node.value, ast.Call) else ""
    return None


def _get_place(name: str) -> int:
    return FIRST_OFFERED.index(name) if name in FIRST_OFFERED else len(FIRST_OFFERED)


STRATEGY_DESCRIPTIONS = read_descriptions(Path(__file__).parent)
STRATEGY_NAMES = tuple(STRATEGY_DESCRIPTIONS)


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
