"""Read the text of a file that somebody named: whatever keeps it from being read is one sentence."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from fields.errors import HeadlandError

MOST_BYTES = 256 * 2**20  # far more than any field, tractor or table of fixes
SHOWN = 80


def read_text(path: str | Path, kind: str, refusal: type[HeadlandError]) -> str:
    """The text of a file in UTF-8, with or without a byte order mark.

    Args:
        path: as somebody gave it; "" is refused, as it stands for no file.
        kind: what it should be, with an article: "a TOML file".
        refusal: the class of what is raised.

    Raises:
        refusal: the file does not exist, is a folder, cannot be read, is too large or is not text.
    """
    content = read_bytes(path, kind, refusal)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise refusal(f"{shown(path)} is not a text file in UTF-8; give {kind}.") from None


def read_bytes(path: str | Path, kind: str, refusal: type[HeadlandError]) -> bytes:
    """What a file holds, refused as `read_text` refuses, whatever its bytes mean."""
    name = shown(path)
    if not os.fspath(path):
        raise refusal(f"An empty name is no file; give the name of {kind}.")
    try:
        with open(path, "rb") as stream:
            content = stream.read(MOST_BYTES + 1)
    except IsADirectoryError:
        raise refusal(f"{name} is a folder; name {kind} in it.") from None
    except FileNotFoundError:
        raise refusal(f"There is no file {name}; check its name and its folder.") from None
    except (OSError, ValueError) as error:
        raise refusal(f"{name} cannot be read ({reason(error)}); give {kind} that can be opened.") from None
    if len(content) > MOST_BYTES:
        raise refusal(f"{name} is larger than {MOST_BYTES >> 20} MB; give {kind} with less in it.")
    return content


def reason(error: BaseException) -> str:
    """Why the system refused a file, in a few words without the file's name."""
    if not isinstance(error, OSError):
        return str(error) or type(error).__name__
    words = {
        errno.ELOOP: "symbolic links that lead round in a circle",
        errno.ENAMETOOLONG: "its name is too long; 255 bytes are the most",
        errno.ENOSPC: "the disk is full",
        getattr(errno, "EDQUOT", -1): "the disk quota is used up",
        errno.EACCES: "no permission",
        errno.EROFS: "the disk is read-only",
    }
    return words.get(error.errno or 0) or error.strerror or type(error).__name__


def shown(path: str | Path) -> str:
    """A path in quotes for a sentence, a very long one by its end."""
    text = os.fspath(path)
    return f"'{text if len(text) <= SHOWN else '...' + text[3 - SHOWN :]}'"


def brief(value: object, most: int = 40) -> str:
    """A value out of a file as short text for a sentence, whatever it is."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested too deep, or a whole number of more digits than Python writes
        return f"a {type(value).__name__} too large to show"
    return text if len(text) <= most else text[: most - 3] + "..."


def some(count: int, word: str) -> str:
    """A number of things in words: 1 ring, 2 rings."""
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def parse_fault(error: BaseException) -> str:
    """Why a text is not JSON or TOML, in a few words: a parser's complaint, its depth or its digits."""
    if isinstance(error, RecursionError):
        return "it is nested too deep"
    if "integer string conversion" in str(error):
        return "it holds a whole number of thousands of digits"
    return str(error)
