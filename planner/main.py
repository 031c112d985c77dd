"""The `headland` command: gathers the commands and turns refusals into one sentence and an exit status.

Exit status: 0 done, 1 a fault of Headland itself, 2 bad input or usage, 130 interrupted.
"""

from __future__ import annotations

import os
import sys

import typer

from planner.commands.field import field
from planner.commands.plan import plan
from planner.commands.study import study

FAULT_STATUS, BAD_INPUT_STATUS, INTERRUPTED_STATUS = 1, 2, 130

app = typer.Typer(
    name="headland",
    help="Plan field work for a fleet of robot tractors: simulate every plan, rank by time and tractor count.\n\n"
    "Example: headland plan myfarm.geojson --width 3 --tractors 1-6 --start 13:00 --before 17:00",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=True,
    rich_markup_mode="markdown",
)
app.command()(plan)
app.command()(field)
app.command()(study)


def main() -> None:
    """Run the command line; the only place where errors become exit statuses."""
    try:
        app()
    except KeyboardInterrupt:
        _fail("Interrupted; nothing was written.", INTERRUPTED_STATUS)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except ValueError as error:
        from planner.errors import REFUSALS

        if not isinstance(error, REFUSALS):
            raise
        _fail(str(error), BAD_INPUT_STATUS)


def _fail(sentence: str, status: int) -> None:
    print(f"Error: {sentence}", file=sys.stderr)
    sys.exit(status)
