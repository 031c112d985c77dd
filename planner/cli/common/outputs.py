"""Files that a command reads and writes: checked before any work, written whole or not at all, and named when written.

One rule for the outputs of all commands: what is there already is replaced if it is empty or a page, picture or plan
that Headland wrote; anything else, tables and settings too, only with --force, as somebody may need it.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
import sys
import unicodedata
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from fields.errors import join_first
from fields.text_files import explain_error, quote_path, read_start
from planner.cli.common.terminal import print_sentence
from planner.errors import HeadlandError, RequestError
from reports.common.language import translate, use_reader

Output = tuple[Path | None, str]
"""A file to write or None, and its required ending ("" for any)."""
OutputContent = str | bytes
Result = tuple[Path | None, OutputContent | Callable[[], OutputContent]]
"""A file to write or None, and its content or what makes it."""
_OWN_BEGINNINGS = {
    ".html": re.compile(rb'<!doctype html>.{0,200}<meta name="generator" content="Headland">', re.DOTALL),
    ".png": re.compile(rb"\x89PNG.{0,200}Software\0Headland", re.DOTALL),
    ".json": re.compile(rb'\s*\{\s*"format_version"'),
}
"""How pages, pictures and saved plans of Headland begin, by their ending."""
MAX_BEGINNING_BYTES = 1000
_PLAIN_INPUTS = {
    "gnss_table": "the table of GNSS errors",
    "mapping": "the mapping of columns",
    "elevation": "the file of heights",
}
"""Options that are names of files and nothing else, and what the files are."""


class WriteError(HeadlandError):
    """A result could not be written although the check passed; the sentence says what was written."""

    status = 1


def list_input_files(
    options: Mapping[str, Any], *, logs: Sequence[str] = (), runs: Sequence[Path] = ()
) -> dict[str | Path, str]:
    """The files that options by name, logs and imported runs have a command read, and what they are.

    For `check_output_paths`.
    """
    from fields.documents.sources import list_field_files
    from vehicle.model.tractor import list_tractor_names

    files: dict[str | Path, str] = {}
    if logs:
        from vehicle.identification.logs.reader import find_log_files

        files |= {path: f"the log {path}" for path in find_log_files(logs)}
    if runs:
        from planner.task_logs.runs.run_files import list_run_files

        files |= {path: f"the log {path}" for path in list_run_files(runs)}
    given = {name: text for name, text in options.items() if text is not None}
    for text in (given[name].strip() for name in ("rain", "rain_mm") if name in given):
        files |= {text: "the file of rain"} if text.lower().endswith(".csv") else {}
    files |= {given[name]: description for name, description in _PLAIN_INPUTS.items() if name in given}
    if "soil" in given:
        from planner.evaluation.field_physics import split_soil_name

        table = split_soil_name(given["soil"])[1]
        files |= {} if table is None else {table: "the table of soils"}
    if "farm" in given:
        from planner.farm.inventory import load_farm

        tractors = load_farm(given["farm"]).tractors
        files |= {each.file: "a tractor file of the farm" for each in tractors if each.file is not None}
        files[given["farm"]] = "the farm file"
    if "tractor" in given and given["tractor"] not in list_tractor_names():
        files[given["tractor"]] = "the tractor file"
    if "field" in given:
        files |= dict.fromkeys(list_field_files(given["field"]), "the field")
    return files


def check_output_paths(
    *outputs: Output,
    input_files: Mapping[str | Path, str] | None = None,
    force: bool = False,
    updated: Collection[Path | None] = (),
) -> None:
    """Raise RequestError for an output that could not be written later; the file system stays unchanged.

    An output must be a regular file or not exist yet, in a writable folder; what exists must be a result of Headland,
    unless `force` allows any or it is among the `updated`, of which everything stays. It must be neither an input file
    (path and what it is) nor another output, also through links and on file systems that ignore case.
    """
    requested = [(path, suffix) for path, suffix in outputs if path is not None]
    for path, _ in requested:
        if os.path.isdir(path):
            raise RequestError(f"{path} is a folder; give the name of a file in it.")
    ignores_case = {path: _check_writable_place(path) for path, _ in requested}
    occupied = [(Path(path), description) for path, description in (input_files or {}).items() if os.path.exists(path)]
    for path, suffix in requested:
        for occupied_path, description in occupied:
            if _is_same_file(path, occupied_path, ignores_case[path]):
                raise RequestError(f"{path} would overwrite {description}; choose another file.")
        if suffix and path.suffix.lower() != suffix:
            named = _format_path(path.with_suffix(suffix))
            raise RequestError(f"{_format_path(path)} does not end in {suffix}; name the file {named}.")
        occupied.append((path, "another result"))
        refuse_overwrite(path, force or path in updated)


def check_cache_folder(cache: Path | None) -> None:
    """Raise RequestError for a folder of --cache that is a file."""
    if cache is not None and cache.exists() and not cache.is_dir():
        raise RequestError(f"--cache {cache} is a file; give the name of a folder.")


def _check_writable_place(path: Path) -> bool:
    """Refuse a place where no file can be written; True if its folder ignores case."""
    target = _resolve_links(path)
    if not os.path.isdir(target.parent):
        parent = target.parent if os.path.islink(path) else path.parent
        raise RequestError(
            f"{_format_path(path)} cannot be written: the folder {parent} does not exist; make it first."
        )
    try:
        status = os.stat(target)
    except FileNotFoundError:
        status = None
    except OSError as error:
        raise RequestError(
            f"{quote_path(path)} cannot be written: {explain_error(error)}; choose another name."
        ) from None
    if status is not None:
        if not stat.S_ISREG(status.st_mode):
            raise RequestError(f"{path} is a device or a pipe, not a file; give the name of a file.")
        for stream in filter(None, (sys.__stdout__, sys.__stderr__)):
            is_same = False
            with suppress(OSError, ValueError):
                is_same = os.path.samestat(status, os.fstat(stream.fileno()))
            if is_same:
                raise RequestError(f"{path} is where this command prints to; choose another file.")
    if not os.access(target if status else target.parent, os.W_OK):
        raise RequestError(f"{path} cannot be written: no permission; choose another place.")
    draft = _build_draft_path(target)
    try:
        draft.touch(exist_ok=False)
        ignores_case = draft.with_name(draft.name.upper()).exists()
        draft.unlink()
    except OSError as error:
        raise RequestError(f"{path} cannot be written: {explain_error(error)}; choose another place.") from None
    return ignores_case


def _is_same_file(path: Path, other_path: Path, ignores_case: bool) -> bool:
    """Whether two paths are the same file, or will be once it is written."""
    with suppress(OSError):
        if os.path.samefile(path, other_path):
            return True
    first, second = (os.path.normcase(_resolve_links(each)) for each in (path, other_path))
    if ignores_case:
        first, second = (unicodedata.normalize("NFC", each).casefold() for each in (first, second))
    return first == second


def refuse_overwrite(path: Path, force: bool) -> None:
    """Raise RequestError for a file that exists and is no result of Headland, unless `force` allows overwriting it."""
    if force or not os.path.exists(path):
        return
    beginning = read_start(path, MAX_BEGINNING_BYTES, "a file", RequestError)
    own = _OWN_BEGINNINGS.get(path.suffix.lower())
    if own is not None and beginning and not own.match(beginning):
        raise RequestError(
            f"{_format_path(path)} exists already, and not as a result of Headland; choose another name, or add "
            "--force to overwrite it."
        )
    if own is None and beginning:
        raise RequestError(f"{_format_path(path)} exists already; choose another name, or add --force to overwrite it.")


@contextmanager
def make_folders(*folders: Path) -> Iterator[None]:
    """Folders, the outer ones first, made if missing, and removed again if the body fails; raises WriteError."""
    made: list[Path] = []
    try:
        for folder in folders:
            if not os.path.lexists(folder):
                try:
                    os.makedirs(folder)
                except OSError as error:
                    raise WriteError(
                        f"The folder {folder} could not be made: {error.strerror}; choose another place."
                    ) from None
                made.append(folder)
            if not os.path.isdir(folder):
                raise RequestError(f"{quote_path(folder)} is a file; name a folder.")
        yield
    except BaseException:
        for folder in reversed(made):
            with suppress(OSError):
                os.rmdir(folder)
        raise


def write_into_folder(
    folder: Path,
    contents: Mapping[str, OutputContent],
    *,
    force: bool,
    input_files: Mapping[str | Path, str] | None = None,
) -> None:
    """Write files by name into a folder, which is made if missing, and say so.

    Raises RequestError, also for files that exist as `check_output_paths` has it, and WriteError.
    """
    results = [(folder / name, content) for name, content in contents.items()]
    for path, _ in results:  # before the folder is made
        refuse_overwrite(path, force)
    with make_folders(folder):
        check_output_paths(*((path, "") for path, _ in results), input_files=input_files, force=force)
        print_written([path for path, _ in results], write_results(results))


def write_results(results: Sequence[tuple[Path, OutputContent]]) -> list[Path]:
    """Write all results or none: existing files are replaced only when all new ones are complete.

    The target of a symbolic link is written, the link stays. Returns those that replaced a file. Raises WriteError,
    whose sentence says what was written.
    """
    drafts: list[tuple[Path, Path]] = []
    replaced: list[Path] = []
    existing = [path for path, _ in results if os.path.exists(path)]
    path = Path()
    try:
        for path, content in results:
            target = _resolve_links(path)
            drafts.append((_build_draft_path(target), target))
            with open(drafts[-1][0], "xb") as stream:
                stream.write(content.encode("utf-8", "replace") if isinstance(content, str) else content)
                stream.flush()
                os.fsync(stream.fileno())
            with suppress(OSError):  # the permissions of the file that it will replace
                os.chmod(drafts[-1][0], stat.S_IMODE(os.stat(target).st_mode))
        for (path, _), (draft, target) in zip(results, drafts, strict=True):
            draft.replace(target)
            replaced.append(path)
    except OSError as error:
        raise WriteError(
            f"{_format_path(path)} could not be written: {explain_error(error)}; {_describe_written(replaced)}, "
            "make room or choose another place."
        ) from None
    finally:
        for draft, _ in drafts[len(replaced) :]:
            draft.unlink(missing_ok=True)
    return existing


@contextmanager
def write_before_printing(*results: Result) -> Iterator[None]:
    """Make and write the results that a path was given for, run the body, and name on standard error what was written.

    An exception of the body gets a note on that instead.
    """
    made = [(path, content() if callable(content) else content) for path, content in results if path is not None]
    replaced = write_results(made)
    try:
        yield
    except BaseException as error:
        if made:
            error.add_note(_describe_written([path for path, _ in made]))
        raise
    print_written([path for path, _ in made], replaced)


def print_written(paths: Sequence[Path], replaced: Collection[Path]) -> None:
    """Name files that were written on standard error, and apart from them those that replaced another."""
    new, old = ([path for path in paths if (path in replaced) == is_old] for is_old in (False, True))
    with use_reader():
        sentences = [
            translate("Wrote {files}.", files=join_first(list(map(_format_path, new)))) if new else "",
            translate("Replaced {files}.", files=join_first(list(map(_format_path, old)))) if old else "",
        ]
    for sentence in filter(None, sentences):
        print_sentence(sentence, err=True)


def _describe_written(paths: Sequence[Path]) -> str:
    if not paths:
        return "nothing was written"
    return f"{', '.join(map(_format_path, paths))} {'was' if len(paths) == 1 else 'were'} written"


def _resolve_links(path: Path) -> Path:
    """The path with symbolic links resolved; a circle of links is returned unchanged."""
    return Path(os.path.realpath(path))


def _build_draft_path(target: Path) -> Path:
    """A short hidden name in the folder of a file."""
    return target.with_name(f".headland-{secrets.token_hex(4)}")


def _format_path(path: Path) -> str:
    """A path for a sentence, without quotes."""
    return quote_path(path)[1:-1]
