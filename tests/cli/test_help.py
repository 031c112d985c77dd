"""Help is quick and shows how to use each command."""

import subprocess
import sys
from typing import Any

import pytest

from tests.cli.conftest import Run

# The second module is that of the process that stops tractors.
DRAWING = ("matplotlib", "pandas", "ortools", "jinja2")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("planner.cli.main", ("numba", "numpy", "pymunk", "shapely", "pyproj", *DRAWING)),
        ("planner.service.api.apps", ("scipy.linalg", "scipy.optimize", "alembic", *DRAWING)),
    ],
)
def test_nothing_heavy_is_loaded_that_is_not_needed(module: str, heavy: tuple[str, ...]) -> None:
    code = f"import {module}, sys; print([m for m in {heavy!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=240)
    assert done.stdout.strip() == "[]"


def commands() -> list[tuple[str, ...]]:
    """The words of all commands, of groups of them and of those in groups."""
    from planner.cli.main import app

    def named(one: Any) -> str:
        return str(one.name or getattr(one.callback, "__name__", ""))

    found = [(named(command),) for command in app.registered_commands]
    for group in app.registered_groups:
        name = str(group.name)
        inner = group.typer_instance.registered_commands if group.typer_instance else []
        found += [(name,), *((name, named(command)) for command in inner)]
    return found


@pytest.mark.parametrize("words", [(), *commands()])
def test_help_shows_an_example(headland: Run, words: tuple[str, ...]) -> None:
    outcome = headland(*words, "--help")
    assert outcome.status == 0 and outcome.err == ""
    text = " ".join(outcome.out.replace("│", " ").split())
    assert f"Example: headland {' '.join(words)}".strip() in text


def test_every_option_of_plan_is_explained(headland: Run) -> None:
    text = headland("plan", "--help").out
    for option in ("--width", "--tractors", "--strategies", "--turn", "--start", "--deadline", "--price-per-hour",
                   "--html", "--png", "--save", "--json", "--csv", "--seed", "--processes", "--local", "--operation",
                   "--headland-first", "--headland-last", "--corners", "--no-headland"):  # fmt: skip
        assert option in text


def test_the_strategies_to_choose_from_are_those_of_the_registry(headland: Run) -> None:
    from strategies.registry import STRATEGIES

    text = " ".join(headland("plan", "--help").out.replace("│", " ").split())
    assert f"commas: {', '.join(STRATEGIES)}; or all." in text


def test_no_words_at_all_show_the_help(headland: Run) -> None:
    outcome = headland()
    assert "plan" in outcome.out + outcome.err and "study" in outcome.out + outcome.err
    assert outcome.status in (0, 2)


def test_the_module_of_the_command_line_runs_it() -> None:
    words = [sys.executable, "-m", "planner.cli.main", "--help"]
    said = subprocess.run(words, capture_output=True, text=True, check=True, timeout=240)
    assert "diagnose" in said.stdout and said.stderr == ""
