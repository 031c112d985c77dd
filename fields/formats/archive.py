"""Files in folders and ZIP archives, read without trusting their names or sizes."""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath

from fields.errors import FieldError
from fields.text_files import MAX_BYTES, explain_error, quote_path

MAX_FILES = 20_000


def is_archive(path: str | Path) -> bool:
    """Whether a file begins like a ZIP archive; pipes are not opened, as they can be read only once."""
    try:
        if not os.path.isfile(path):
            return False
        with open(path, "rb") as stream:
            return stream.read(4) in (b"PK\x03\x04", b"PK\x05\x06")
    except (OSError, ValueError):
        return False


class ArchiveMembers(Mapping[str, bytes]):
    """The files of a folder or ZIP archive by their relative path with forward slashes, sorted by name.

    Subfolders are searched `max_depth` levels down. Files are read on access only, and nothing is written. Raises
    FieldError for an archive that cannot be opened, contains paths outside itself, or exceeds 256 MB unpacked.
    """

    def __init__(self, path: str | Path, max_depth: int = 4) -> None:
        self.path = Path(path)
        self._archive = None if self.path.is_dir() else _open_archive(self.path)
        self._unpacked_bytes = 0
        self._names = (
            _list_folder_members(self.path, max_depth)
            if self._archive is None
            else _list_archive_members(self._archive, self.path)
        )

    def __getitem__(self, name: str) -> bytes:
        if name not in self._names:
            raise KeyError(name)
        try:
            if self._archive is None:
                return _read_limited(self.path / name)
            with self._archive.open(self._names[name]) as stream:
                content = stream.read(min(MAX_BYTES - self._unpacked_bytes, MAX_BYTES) + 1)
        except (OSError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error, EOFError) as error:
            raise FieldError(
                f"{name} in {quote_path(self.path)} cannot be read ({explain_error(error)}); create the folder or "
                "archive again."
            ) from None
        self._unpacked_bytes += len(content)
        if self._unpacked_bytes > MAX_BYTES:
            raise FieldError(_explain_too_large(self.path))
        return content

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def find_paths_by_name(self, name: str) -> list[str]:
        """The paths of all files with this name in any folder; case is ignored."""
        lower_name = name.lower()
        return [one for one in self if PurePosixPath(one).name.lower() == lower_name]

    def read_member_beside(self, path: str, name: str) -> bytes | None:
        """The content of a file in the same folder as another, None without it; case is ignored."""
        folder, lower_name = PurePosixPath(path).parent, name.lower()
        for member in self:
            member_path = PurePosixPath(member)
            if member_path.parent == folder and member_path.name.lower() == lower_name:
                return self[member]
        return None


def open_folder_or_archive(path: str | Path) -> ArchiveMembers:
    """The files of a folder or ZIP archive; for any other file those of its folder."""
    if os.path.isdir(path) or is_archive(path):
        return ArchiveMembers(path)
    return ArchiveMembers(Path(path).parent, 0)


def list_names(path: str | Path) -> frozenset[str]:
    """Names of the files in a folder or archive, lower case, without folders; empty for any other file."""
    if not (os.path.isdir(path) or is_archive(path)):
        return frozenset()
    return frozenset(PurePosixPath(name).name.lower() for name in ArchiveMembers(path))


def _open_archive(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise FieldError(
            f"The archive {quote_path(path)} cannot be opened ({explain_error(error)}); pack it again."
        ) from None


def _list_archive_members(archive: zipfile.ZipFile, path: Path) -> dict[str, str]:
    """Members by normalised name; refuses archives that are too large and names outside the archive."""
    files = [entry for entry in archive.infolist() if not entry.is_dir()]
    if len(files) > MAX_FILES:
        raise FieldError(f"{quote_path(path)} contains {len(files)} files; at most {MAX_FILES} are allowed.")
    if sum(entry.file_size for entry in files) > MAX_BYTES:
        raise FieldError(_explain_too_large(path))
    names = {}
    for entry in files:
        parts = PurePosixPath(entry.filename.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or PureWindowsPath(entry.filename).drive:
            raise FieldError(
                f"{quote_path(path)} contains {quote_path(entry.filename)}, a path outside the archive; pack it again "
                "with relative paths."
            )
        if not _is_system_artefact(parts):
            names[str(parts)] = entry.filename
    return dict(sorted(names.items()))


def _explain_too_large(path: Path) -> str:
    return f"{quote_path(path)} unpacks to more than {MAX_BYTES >> 20} MB; give an archive with less in it."


def _list_folder_members(folder: Path, max_depth: int) -> dict[str, str]:
    """Regular files of a folder and its subfolders, without hidden files and links to folders."""
    files_by_path: dict[str, str] = {}
    for base, folders, files in os.walk(folder):
        relative_folder = PurePosixPath(Path(base).relative_to(folder).as_posix())
        folders[:] = [] if len(relative_folder.parts) >= max_depth else sorted(folders)
        for name in sorted(files):
            if not _is_system_artefact(relative_folder / name) and os.path.isfile(os.path.join(base, name)):
                files_by_path[str(relative_folder / name)] = name
        if len(files_by_path) > MAX_FILES:
            raise FieldError(
                f"{quote_path(folder)} contains more than {MAX_FILES} files; name the folder of the field itself."
            )
    return dict(sorted(files_by_path.items()))


def _is_system_artefact(path: PurePosixPath) -> bool:
    """Whether a file, or a folder it is in, is an artefact of the system: .name or __MACOSX."""
    return any(part.startswith(".") or part == "__MACOSX" for part in path.parts)


def _read_limited(path: Path) -> bytes:
    with open(path, "rb") as stream:
        content = stream.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise OSError(f"it is larger than {MAX_BYTES >> 20} MB")
    return content
