"""The files a command reads and writes: compared before any work, written whole or not at all after it."""

from __future__ import annotations

import os
import secrets
import stat
import sys
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NoReturn

from fields.reading import reason, shown
from fields.source import field_files
from planner.errors import HeadlandError, ScenarioError
from vehicle.tractor import tractor_names

Output = tuple[Path | None, str]
"""A file that was asked for or None, and the ending it must have ("" for any)."""
Content = str | bytes


class WriteError(HeadlandError):
    """A result that could not be written though its place looked good; the sentence says what was."""

    status = 1


def inputs(
    *, field: str | None = None, tractor: str | None = None, gnss_table: str | None = None, logs: Sequence[str] = (),
    farm: str | None = None, rain: str | None = None,
) -> dict[str | Path, str]:  # fmt: skip
    """The files that a command reads, by what was given on the command line, as `check_outputs` takes them."""
    files: dict[str | Path, str] = {}
    if logs:
        from vehicle.measured.logs.reading import log_files

        files |= {path: f"the log {path}" for path in log_files(logs)}
    if rain is not None and rain.strip().lower().endswith(".csv"):
        files[rain.strip()] = "the file of rain"
    if gnss_table is not None:
        files[gnss_table] = "the table of GNSS errors"
    if farm is not None:
        from planner.farm import load_farm

        files |= {each.file: "a tractor file of the farm" for each in load_farm(farm).tractors if each.file is not None}
        files[farm] = "the farm file"
    if tractor is not None and tractor not in tractor_names():
        files[tractor] = "the tractor file"
    if field is not None:
        files |= dict.fromkeys(field_files(field), "the field")
    return files


def check_outputs(*outputs: Output, reads: Mapping[str | Path, str] | None = None) -> None:
    """Raise ScenarioError for an output that could not be written later; leaves the file system as it was.

    An output must be a regular file or none yet, in a folder that takes files. It must not be one of the files that
    the command reads (`reads`: path, and what it is in words) nor another output, under whatever name: symbolic and
    hard links and file systems that do not tell capitals apart are seen through.
    """
    wanted = [(path, kind) for path, kind in outputs if path is not None]
    for path, kind in wanted:
        _check_kind(path, kind)
    capitals_alike = {path: _check_place(path) for path, _ in wanted}
    taken = [(Path(path), what) for path, what in (reads or {}).items() if os.path.exists(path)]
    for path, _ in wanted:
        for other, what in taken:
            if _same(path, other, capitals_alike[path]):
                _refuse(f"{path} would overwrite {what}; choose another file.")
        taken.append((path, "another result"))


def _check_kind(path: Path, kind: str) -> None:
    if os.path.isdir(path):
        _refuse(f"{path} is a folder; give the name of a file in it.")
    if kind and path.suffix.lower() != kind:
        _refuse(f"{_named(path)} does not end in {kind}; name the file {_named(path.with_suffix(kind))}.")


def _check_place(path: Path) -> bool:
    """Refuse a place that takes no file; True when its folder takes names that differ in capitals for one."""
    real = _real(path)
    if not os.path.isdir(real.parent):
        parent = real.parent if os.path.islink(path) else path.parent
        _refuse(f"{_named(path)} cannot be written: the folder {parent} does not exist; make it first.")
    try:
        now = os.stat(real)
    except FileNotFoundError:
        now = None
    except OSError as error:
        _refuse(f"{shown(path)} cannot be written: {reason(error)}; choose another name.")
    if now is not None:
        _check_present(path, now)
    if not os.access(real if now else real.parent, os.W_OK):
        _refuse(f"{path} cannot be written: no permission; choose another place.")
    draft = _draft(real)
    try:
        draft.touch(exist_ok=False)
        alike = draft.with_name(draft.name.upper()).exists()
        draft.unlink()
    except OSError as error:
        _refuse(f"{path} cannot be written: {reason(error)}; choose another place.")
    return alike


def _check_present(path: Path, now: os.stat_result) -> None:
    if not stat.S_ISREG(now.st_mode):
        _refuse(f"{path} is a device or a pipe, not a file; give the name of a file.")
    if any(os.path.samestat(now, printed) for printed in _printed()):
        _refuse(f"{path} is where this command prints to; choose another file.")


def _printed() -> Iterator[os.stat_result]:
    """What standard output and standard error lead to, as far as they lead anywhere."""
    for stream in (sys.__stdout__, sys.__stderr__):
        with suppress(OSError, ValueError):
            if stream is not None:
                yield os.fstat(stream.fileno())


def _same(path: Path, other: Path, capitals_alike: bool) -> bool:
    """Whether two names lead to one file, or would once it is written."""
    with suppress(OSError):
        if os.path.samefile(path, other):
            return True
    one, two = (os.path.normcase(_real(each)) for each in (path, other))
    if capitals_alike:
        one, two = (unicodedata.normalize("NFC", each).casefold() for each in (one, two))
    return one == two


def spare(path: Path, force: bool) -> None:
    """Raise ScenarioError for a file that is there and may hold somebody's work; with `force` it may go."""
    if not force and os.path.lexists(path):
        _refuse(f"{_named(path)} is there already; choose another name, or add --force to write over it.")


@contextmanager
def folder_for(folder: Path) -> Iterator[None]:
    """A folder for results, made where there is none and removed again where the body fails; raises ScenarioError."""
    made = not os.path.lexists(folder)
    try:
        if made:
            os.makedirs(folder)
    except OSError as error:
        _refuse(f"The folder {shown(folder)} cannot be made: {reason(error)}; choose another place.")
    if not os.path.isdir(folder):
        _refuse(f"{shown(folder)} is a file; name a folder.")
    try:
        yield
    except BaseException:
        if made:
            with suppress(OSError):
                os.rmdir(folder)
        raise


def write_results(results: Sequence[tuple[Path, Content]]) -> None:
    """Write every result whole, or none: earlier files are replaced only when all the new ones are complete.

    A symbolic link stays, and the file it leads to is written. Raises WriteError, whose sentence says what was
    written where not all could be.
    """
    drafts: list[tuple[Path, Path]] = []
    done: list[Path] = []
    path = Path()
    try:
        for path, content in results:
            real = _real(path)
            drafts.append((_draft(real), real))
            _fill(drafts[-1][0], content, real)
        for (path, _), (draft, real) in zip(results, drafts, strict=True):
            draft.replace(real)
            done.append(path)
    except OSError as error:
        raise WriteError(
            f"{_named(path)} could not be written: {reason(error)}; {_told(done)}, make room or choose another place."
        ) from None
    finally:
        for draft, _ in drafts[len(done) :]:
            draft.unlink(missing_ok=True)


@contextmanager
def written(results: Sequence[tuple[Path, Content]]) -> Iterator[None]:
    """Write the results, then let the body print; whatever interrupts that carries a note of what was written."""
    write_results(results)
    try:
        yield
    except BaseException as error:
        if results:
            error.add_note(_told([path for path, _ in results]))
        raise


def _told(done: Sequence[Path]) -> str:
    if not done:
        return "nothing was written"
    return f"{', '.join(map(_named, done))} {'was' if len(done) == 1 else 'were'} written"


def _fill(draft: Path, content: Content, real: Path) -> None:
    """A new file with this content and the permissions of the file it will replace."""
    with open(draft, "xb") as stream:
        stream.write(content.encode("utf-8", "replace") if isinstance(content, str) else content)
        stream.flush()
        os.fsync(stream.fileno())
    with suppress(OSError):
        os.chmod(draft, stat.S_IMODE(os.stat(real).st_mode))


def _real(path: Path) -> Path:
    """The file itself behind symbolic links; an unfinished circle of links stays as it is."""
    return Path(os.path.realpath(path))


def _draft(real: Path) -> Path:
    """A short hidden name beside a file, however long its own is."""
    return real.with_name(f".headland-{secrets.token_hex(4)}")


def _named(path: Path) -> str:
    """The name of a file for a sentence."""
    return shown(path)[1:-1]


def _refuse(sentence: str) -> NoReturn:
    raise ScenarioError(sentence)
