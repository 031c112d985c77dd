"""Commands of the README and the guide, and running one as it is written."""

import re
from pathlib import Path

from planner.guide.guide_pages import list_pages
from tests.cli.conftest import Run

README = Path(__file__).parents[2] / "README.md"
EXPERIMENTS = "headland validate"
SERVING = ("headland serve", "headland demo", "headland robot")
"""Commands that run until they are ended; tests of the service start them."""
OF_A_SERVER = ("operations", "workers", "proxy")
"""Pages whose commands are for a server of their own."""


def list_commands(text: str) -> list[str]:
    """Lines of a text's shell blocks that begin with the command, without their comments."""
    blocks = re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)
    lines = [line.split("  #")[0].strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("headland ")]


def list_readme_commands() -> list[str]:
    """Commands of the README."""
    return list_commands(README.read_text(encoding="utf-8"))


def list_guide_commands() -> list[str]:
    """Commands of the guide that the README has not, each once, in the order of the topics."""
    lines = [line for page in list_pages() if page.topic not in OF_A_SERVER for line in list_commands(page.text)]
    return [line for line in dict.fromkeys(lines) if line not in list_readme_commands()]


def run_as_written(line: str, folder: Path, headland: Run) -> str:
    """Run a line in the folder that is the current one: it succeeds, prints what is returned, and writes the files it
    names."""
    words: list[str] = []
    for word in line.split()[1:]:
        words += sorted(str(path.relative_to(folder)) for path in folder.glob(word)) if "*" in word else [word]
    done = headland(*words)
    assert done.status == 0, done.err
    assert done.out.strip()
    for option in ("--html", "--png", "--save"):
        if option in words:
            assert (folder / words[words.index(option) + 1]).stat().st_size > 1000
    return str(done.out)
