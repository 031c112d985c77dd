"""Names with a star as the fields they stand for."""

from __future__ import annotations

import glob
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import partial

from fields.read import Listed, list_fields
from fields.source import source_of
from planner.errors import ScenarioError, named

EVERY = "*"
MOST_FIELDS = 100_000


def fields_of(
    names: Iterable[str], *, local: bool = False, crs: str | None = None, swap: bool = False
) -> tuple[str, ...]:
    """The fields that names stand for, each once, in the order given.

    ``file.geojson#*`` stands for every field of a file, ``*.geojson`` for every such file (sorted by name) where the
    shell has not put them in its place already. Raises FieldError for a file that cannot be read, ScenarioError for a
    pattern that no file answers to.
    """
    ask = partial(list_fields, local=local, crs=crs, swap=swap)
    found = dict.fromkeys(field for name in names for file in _files(name) for field in _inside(file, ask))
    if len(found) > MOST_FIELDS:
        raise ScenarioError(f"{named('field')} stands for {len(found)} fields; plan at most {MOST_FIELDS} at once.")
    return tuple(found)


def _files(name: str) -> Iterator[str]:
    place, mark, key = name.partition("#")
    if os.path.exists(name) or not glob.has_magic(place):
        yield name
        return
    files = sorted(glob.glob(place))
    if not files:
        raise ScenarioError(f"No file answers to {place!r}; check the folder and the ending.", parameter="field")
    for file in files:
        yield file + mark + key


def _inside(name: str, ask: Callable[[str], tuple[Listed, ...]]) -> Iterator[str]:
    source = source_of(name)
    if source.key != EVERY:
        yield name
        return
    listed = ask(source.place)
    keys = Counter(one.key for one in listed)
    for one in listed:
        yield f"{source.place}#{one.key if keys[one.key] == 1 else one.position}"
