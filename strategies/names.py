"""Names and descriptions of the strategies in the order in which they are offered, for help texts and forms.

Every module beside this one that has a STRATEGY is a strategy of Headland, named like its file. They are read and not
imported, as importing one loads the simulator: name and description are plain strings there. Other packages offer
strategies as entry points in the group ENTRY_POINT_GROUP.
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
"""All others follow by the alphabet. The first of a request is tried with one tractor alone (differs_alone)."""


def read_descriptions(folder: Path) -> dict[str, str]:
    """The description of every strategy that has a module in a folder, by name."""
    found = dict(entry for file in folder.glob("*.py") if (entry := _read_entry(file)) is not None)
    return dict(sorted(found.items(), key=lambda entry: (_get_place(entry[0]), entry[0])))


def _read_entry(file: Path) -> tuple[str, str] | None:
    """Name and description in the record STRATEGY of a module; None without such a record. Raises ValueError."""
    values: dict[str, ast.expr] = {}
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
            values[getattr(target, "id", "")] = node.value
    record, expected = values.get("STRATEGY"), file.stem.replace("_", "-")
    if record is None:
        return None
    given = dict(zip(("name", "description"), record.args, strict=False)) if isinstance(record, ast.Call) else {}
    given |= {word.arg or "": word.value for word in record.keywords} if isinstance(record, ast.Call) else {}
    texts = [values.get(getattr(each, "id", ""), each) for each in map(given.get, ("name", "description"))]
    name, description = (each.value if isinstance(each, ast.Constant) else None for each in texts)
    if name != expected or not isinstance(description, str):
        raise ValueError(
            f"{file.name} must set STRATEGY = Strategy({expected!r}, 'what the tractors do', ...) with plain strings."
        )
    return expected, description


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
