"""What a terminal shows, and screens that are compared with stored ones."""

import io
import os
from pathlib import Path

from rich.console import Console, RenderableType

GOLDEN = Path(__file__).parent / "reports" / "screens"
WRITE = os.environ.get("HEADLAND_GOLDEN") == "write"


def print_text(what: RenderableType, width: int = 80) -> str:
    """What a pipe of so many columns gets, without colours and blanks at the ends of lines."""
    stream = io.StringIO()
    Console(width=width, file=stream, force_terminal=False, color_system=None).print(what)
    return "".join(f"{line.rstrip()}\n" for line in stream.getvalue().splitlines())


def assert_as_stored(name: str, what: RenderableType, width: int) -> None:
    """A screen fits its width and is the stored one, which HEADLAND_GOLDEN=write renews."""
    text, stored = print_text(what, width), GOLDEN / f"{name}-{width}.txt"
    if WRITE:
        stored.write_text(text, encoding="utf-8")
    assert text == stored.read_text(encoding="utf-8")
    assert max(map(len, text.splitlines())) <= width
