"""`headland guide` (prints a page of the guide) and `headland setup` (compiles everything beforehand)."""

from __future__ import annotations

import sys
from typing import Annotated, Optional

import typer

from planner.cli.common.terminal import LOADING, compile_missing, print_renderable, print_sentence


def guide(
    topic: Annotated[Optional[str], typer.Argument(help="A topic; without one, all topics are listed.")] = None,
    search: Annotated[Optional[str], typer.Option(help="Show the lines that contain all these words.")] = None,
) -> None:
    """Print the guide: a topic, the list of topics, or what a search finds.

    Example: headland guide obstacles
    """
    from rich.markdown import Markdown

    from planner.guide.guide_pages import list_pages, read_page, search_pages

    if search is not None:
        lines = [f"- `{match.topic}`, {match.heading}: {match.line}" for match in search_pages(search)]
        text = "\n".join(lines or ["No page of the guide contains all these words."])
    elif topic is None:
        lines = [f"| `{page.topic}` | {page.title} |" for page in list_pages()]
        text = "\n".join(["| topic | page |", "|---|---|", *lines, "", "`headland guide TOPIC` prints a page."])
    else:
        text = read_page(topic).text
    if sys.stdout.isatty():
        print_renderable(Markdown(text))
    else:
        typer.echo(text)


def setup() -> None:
    """Compile everything for this machine now, on all cores, so that no command waits for it later.

    Example: headland setup
    """
    from planner.cli.common.progress import open_stage_bar

    with open_stage_bar(LOADING) as bar:
        from planner.pipeline.kernels import MORE, PLAN, list_missing_kernels

        missing_count = compile_missing(bar, (PLAN, MORE))
        count = missing_count - len(list_missing_kernels((PLAN, MORE)))
    print_sentence(
        f"Compiled {count} functions for this machine." if missing_count else "Everything is compiled already."
    )
