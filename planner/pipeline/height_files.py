"""Hashes of the files that heights are read from, by which a cached result notices other heights of the same name."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from fields.errors import FieldError
from fields.formats.archive import ArchiveMembers
from fields.terrain.point_files import AGOPENGPS_FILE
from planner.pipeline.fingerprint import hash_file


def hash_height_files(name: str | None) -> list[tuple[str, str | None]] | None:
    """What heights of this name hold: hashes by the ends of the files' names; None without heights.

    The files are those of the same stem, as one beside the heights may say their coordinate system, or those that are
    read in a folder.
    """
    if name is None:
        return None
    place = Path(name)
    folder, stem = (place, "") if place.is_dir() else (place.parent, place.stem.lower())
    return [(str(path.relative_to(folder)).lower()[len(stem) :], hash_file(path)) for path in _list_files(place)]


def _list_files(place: Path) -> Iterable[Path]:
    """The files of heights; none where they cannot be listed, which is refused when they are read."""
    with suppress(OSError, ValueError, FieldError):
        if not place.is_dir():
            start = f"{place.stem}.".lower()
            return sorted(path for path in place.parent.iterdir() if f"{path.name}.".lower().startswith(start))
        own = sorted(path for path in place.iterdir() if path.name.lower() == AGOPENGPS_FILE)
        return own or [place / member for member in ArchiveMembers(place)]
    return []
