"""Names that terminals take: short, in plain letters, and no two alike."""

from __future__ import annotations

import re
import unicodedata

DESIGNATOR_BYTES = 32
"""The longest designator of ISO 11783-10."""
FOLDER_LETTERS = 60
_LETTERS = str.maketrans({
    "ß": "ss", "ø": "o", "Ø": "O", "æ": "ae", "Æ": "AE", "œ": "oe", "Œ": "OE", "ł": "l", "Ł": "L", "đ": "d", "Đ": "D",
    "þ": "th", "Þ": "Th",
    "\N{LATIN SMALL LETTER DOTLESS I}": "i",
})  # fmt: skip
_NO_FOLDER = re.compile(r"[<>:\"/\\|?*]+")
_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\.|$)", re.IGNORECASE)
"""Names that Windows keeps for devices."""


def plain(name: str) -> str:
    """A name in letters of ASCII as far as it has any like that, without line breaks; "" for one that has none."""
    letters = unicodedata.normalize("NFKD", name.translate(_LETTERS)).encode("ascii", "ignore").decode("ascii")
    return " ".join("".join(letter if letter.isprintable() else " " for letter in letters).split())


def designator(name: str, other: str) -> str:
    """A name of at most `DESIGNATOR_BYTES` bytes, cut where it is longer; `other` where nothing is left."""
    return plain(name)[:DESIGNATOR_BYTES].strip() or other


def folder_name(name: str, other: str) -> str:
    """A name that every file system takes for a folder; `other` where nothing is left."""
    found = _NO_FOLDER.sub(" ", plain(name))
    found = " ".join(found.split())[:FOLDER_LETTERS].strip(" .")
    return f"{other} {found}".strip() if not found or _DEVICES.match(found) else found
