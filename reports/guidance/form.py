"""What a form is that guidance is written in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from reports.guidance.lines import Guidance

Files = Mapping[str, bytes]
"""Contents by path inside the folder that is written, with ``/`` between folders."""


@dataclass(frozen=True)
class Form:
    """A form of guidance.

    Attributes:
        name: what it is asked for by.
        words: what people call it.
        write: the files of a guidance; where `apart`, of one with one tractor.
        ending: of the one file it is, "" for a folder of several.
        media: type of that file; of a folder that of its archive.
        apart: it has no notion of a tractor, so each gets files of its own.
        named: their paths say whose they are; otherwise each tractor has a folder T1, T2, ...
        curves: whether terminals take curves, so that they are written unasked.
        lacks: parts of a guidance that it has no place for.
    """

    name: str
    words: str
    write: Callable[[Guidance], Files]
    ending: str = ""
    media: str = "application/zip"
    apart: bool = False
    named: bool = False
    curves: bool = True
    lacks: tuple[str, ...] = ()
