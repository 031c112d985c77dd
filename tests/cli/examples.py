"""The commands of the README, and running one as it is written."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

README = Path(__file__).parents[2] / "README.md"
EXPERIMENTS = "headland validate"


def commands() -> list[str]:
    """Lines of the README's shell blocks that begin with the command, without their comments."""
    blocks = re.findall(r"```sh\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)
    lines = [line.split("  #")[0].strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("headland ")]


def run_as_written(line: str, folder: Path, headland: Callable[..., Any]) -> None:
    """Run a line in the folder that is the current one: it succeeds, prints, and writes the files it names."""
    words: list[str] = []
    for word in line.split()[1:]:
        words += sorted(str(path.relative_to(folder)) for path in folder.glob(word)) if "*" in word else [word]
    done = headland(*words)
    assert done.status == 0, done.err
    assert done.out.strip()
    for option in ("--html", "--png", "--save"):
        if option in words:
            assert (folder / words[words.index(option) + 1]).stat().st_size > 1000
