"""Read text files that a user named, with one clear sentence for every failure, and check the header of CSV tables."""

from __future__ import annotations

import csv
import errno
import io
import os
from pathlib import Path

from fields.errors import HeadlandError

MAX_COLUMNS = 200
MAX_HEADER_CHARS = 20_000  # of the first line


def check_header(text: str, label: str, error_type: type[HeadlandError], delimiter: str = ",") -> None:
    """Refuse a CSV table with an implausibly long or wide first line, before the rest is parsed for minutes.

    Args:
        text: the table, or at least its first `MAX_HEADER_CHARS` + 1 characters.
        label: name of the file in messages.
        error_type: class of the exception.
        delimiter: between columns.

    Raises:
        error_type: the line is too long, or has too many columns.
    """
    start = io.StringIO(text[: MAX_HEADER_CHARS + 1], newline="")
    try:
        columns = next(csv.reader(start, delimiter=delimiter), [])
    except csv.Error as error:
        raise error_type(f"{label} is not a CSV file ({error}); save it as comma-separated text.") from None
    if len(columns) > MAX_COLUMNS:
        raise error_type(f"{label} has more than {MAX_COLUMNS} columns; save only the columns that are needed.")
    if start.tell() > MAX_HEADER_CHARS:
        raise error_type(
            f"The first line of {label} has more than {MAX_HEADER_CHARS} characters; it should name at most "
            f"{MAX_COLUMNS} columns."
        )


MAX_BYTES = 256 * 2**20  # far more than any field, tractor or table of fixes
MAX_SHOWN_CHARS = 80


def read_text(path: str | Path, kind: str, error_type: type[HeadlandError]) -> str:
    """The text of a file in UTF-8, with or without a byte order mark.

    Args:
        path: as the user gave it; "" is refused.
        kind: what the file should be, with an article: "a TOML file".
        error_type: class of the exception.

    Raises:
        error_type: the file does not exist, is a folder, cannot be read, is too large or is not text.
    """
    content = read_bytes(path, kind, error_type)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise error_type(f"{quote_path(path)} is not a text file in UTF-8; give {kind}.") from None


def read_bytes(path: str | Path, kind: str, error_type: type[HeadlandError]) -> bytes:
    """The bytes of a file; raises as `read_text`, but for text."""
    content = read_start(path, MAX_BYTES + 1, kind, error_type)
    if len(content) > MAX_BYTES:
        raise error_type(f"{quote_path(path)} is larger than {MAX_BYTES >> 20} MB; give {kind} with less in it.")
    return content


def read_start(path: str | Path, count: int, kind: str, error_type: type[HeadlandError]) -> bytes:
    """At most `count` bytes from the beginning of a file; raises as `read_text`, but for text."""
    name = quote_path(path)
    if not os.fspath(path):
        raise error_type(f"The file name is empty; give the name of {kind}.")
    try:
        with open(path, "rb") as stream:
            return stream.read(count)
    except IsADirectoryError:
        raise error_type(f"{name} is a folder; name {kind} in it.") from None
    except FileNotFoundError:
        raise error_type(f"There is no file {name}; check its name and its folder.") from None
    except (OSError, ValueError) as error:
        raise error_type(f"{name} cannot be read ({explain_error(error)}); give {kind} that can be opened.") from None


def explain_error(error: BaseException) -> str:
    """The system's reason for a failure, in a few words without the file's name."""
    if not isinstance(error, OSError):
        return str(error) or type(error).__name__
    reasons = {
        errno.ELOOP: "its symbolic links form a loop",
        errno.ENAMETOOLONG: "its name is too long (more than 255 bytes)",
        errno.ENOSPC: "the disk is full",
        getattr(errno, "EDQUOT", -1): "the disk quota is used up",
        errno.EACCES: "no permission",
        errno.EROFS: "the disk is read-only",
    }
    return reasons.get(error.errno or 0) or error.strerror or type(error).__name__


def quote_path(path: str | Path) -> str:
    """A path in quotes for a sentence; of a very long path only the end."""
    text = os.fspath(path)
    return f"'{text if len(text) <= MAX_SHOWN_CHARS else '...' + text[3 - MAX_SHOWN_CHARS :]}'"


def shorten_value(value: object, max_chars: int = 40) -> str:
    """Any value from a file as short text for a sentence."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested too deeply, or an integer with more digits than Python prints
        return f"a {type(value).__name__} too large to show"
    return text if len(text) <= max_chars else text[: max_chars - 3] + "..."


def count_noun(count: int, noun: str) -> str:
    """A count with its noun: 1 ring, 2 rings."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def explain_parse_error(error: BaseException) -> str:
    """Why a text is not JSON or TOML, in a few words: the parser's message, too deep nesting or too many digits."""
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if "integer string conversion" in str(error):
        return "it contains an integer with thousands of digits"
    return str(error)
