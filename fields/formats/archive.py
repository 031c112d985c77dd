"""Folders and ZIP archives of field files: what is in them, read without trusting their names or sizes."""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

from fields.errors import FieldError
from fields.reading import MOST_BYTES, reason, shown

MOST_FILES = 20_000
DEEPEST = 4
"""Folders below the one that was named are looked through so far down."""


def is_archive(path: str | Path) -> bool:
    """Whether a file begins as a ZIP archive does; a pipe is never looked into, as it can be read only once."""
    try:
        if not os.path.isfile(path):
            return False
        with open(path, "rb") as stream:
            return stream.read(4) in (b"PK\x03\x04", b"PK\x05\x06")
    except (OSError, ValueError):
        return False


class Members(Mapping[str, bytes]):
    """The files of a folder or ZIP archive by their path in it, with forward slashes, in the order of the names.

    Folders in a folder are looked through `deepest` down. Nothing is read before it is asked for, and nothing is ever
    written. Raises FieldError for an archive that cannot be opened, that holds names leading out of it, or more than
    256 MB when unpacked.
    """

    def __init__(self, path: str | Path, deepest: int = DEEPEST) -> None:
        self.path = Path(path)
        self._archive = None if self.path.is_dir() else _opened(self.path)
        self._unpacked = 0
        self._names = _in_folder(self.path, deepest) if self._archive is None else _in_archive(self._archive, self.path)

    def __getitem__(self, name: str) -> bytes:
        if name not in self._names:
            raise KeyError(name)
        try:
            if self._archive is None:
                return _bytes(self.path / name)
            with self._archive.open(self._names[name]) as stream:
                content = stream.read(min(MOST_BYTES - self._unpacked, MOST_BYTES) + 1)
        except (OSError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error, EOFError) as error:
            raise FieldError(
                f"{name} in {shown(self.path)} cannot be read ({reason(error)}); make the folder or archive again."
            ) from None
        self._unpacked += len(content)
        if self._unpacked > MOST_BYTES:
            raise FieldError(_too_much(self.path))
        return content

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def named(self, name: str) -> list[str]:
        """The paths of all files of this name, whatever their case and folder, in order."""
        wanted = name.lower()
        return [one for one in self if PurePosixPath(one).name.lower() == wanted]

    def beside(self, path: str, name: str) -> bytes | None:
        """A file of the same folder as another, whatever its case; None without one."""
        folder, wanted = PurePosixPath(path).parent, name.lower()
        for one in self:
            place = PurePosixPath(one)
            if place.parent == folder and place.name.lower() == wanted:
                return self[one]
        return None


def members_around(path: str | Path) -> Members:
    """What is in a folder or ZIP archive; for any other file, what stands in the same folder."""
    if os.path.isdir(path) or is_archive(path):
        return Members(path)
    return Members(Path(path).parent, 0)


def file_beside(path: Path, name: str) -> bytes | None:
    """A file of the same folder as another, whatever its case; None without one."""
    try:
        near = next((one for one in sorted(path.parent.iterdir()) if one.name.lower() == name.lower()), None)
        return None if near is None or not near.is_file() else _bytes(near)
    except OSError as error:
        raise FieldError(f"{shown(path.parent)} cannot be looked through ({reason(error)}); copy the folder.") from None


def names_in(path: str | Path) -> frozenset[str]:
    """Names of the files in a folder or archive, lower case, without folders; none for any other file."""
    if not (os.path.isdir(path) or is_archive(path)):
        return frozenset()
    return frozenset(PurePosixPath(name).name.lower() for name in Members(path))


def _opened(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise FieldError(f"{shown(path)} is no archive that can be opened ({reason(error)}); pack it again.") from None


def _in_archive(archive: zipfile.ZipFile, path: Path) -> dict[str, str]:
    """Members by clean name; refuses what would unpack to too much and names that lead out."""
    files = [one for one in archive.infolist() if not one.is_dir()]
    if len(files) > MOST_FILES:
        raise FieldError(f"{shown(path)} holds {len(files)} files; a farm's archive has {MOST_FILES} at most.")
    if sum(one.file_size for one in files) > MOST_BYTES:
        raise FieldError(_too_much(path))
    clean = {}
    for one in files:
        parts = PurePosixPath(one.filename.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in one.filename:
            raise FieldError(
                f"{shown(path)} holds the name {shown(one.filename)}, which leads out of it; pack it again "
                "with names only."
            )
        if not _hidden(parts):
            clean[str(parts)] = one.filename
    return dict(sorted(clean.items()))


def _too_much(path: Path) -> str:
    return f"{shown(path)} unpacks to more than {MOST_BYTES >> 20} MB; give an archive with less in it."


def _in_folder(folder: Path, deepest: int) -> dict[str, str]:
    """Regular files of a folder and its folders; hidden ones and links to folders are left out."""
    found: dict[str, str] = {}
    for base, folders, files in os.walk(folder):
        below = PurePosixPath(Path(base).relative_to(folder).as_posix())
        folders[:] = [] if len(below.parts) >= deepest else sorted(folders)
        for name in sorted(files):
            if not _hidden(below / name) and os.path.isfile(os.path.join(base, name)):
                found[str(below / name)] = name
        if len(found) > MOST_FILES:
            raise FieldError(
                f"{shown(folder)} holds more than {MOST_FILES} files; name the folder of the field itself."
            )
    return dict(sorted(found.items()))


def _hidden(path: PurePosixPath) -> bool:
    """Files that systems leave behind: ._names and __MACOSX."""
    return path.name.startswith(".") or "__MACOSX" in path.parts


def _bytes(path: Path) -> bytes:
    with open(path, "rb") as stream:
        content = stream.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise OSError(f"it is larger than {MOST_BYTES >> 20} MB")
    return content
