"""The `headland` command: gathers the commands and turns refusals into one sentence and an exit status.

Exit status: 0 done, 1 a fault of Headland itself, 2 bad input or usage, 3 no plan is feasible, 130 interrupted.
"""

from __future__ import annotations

import os
import sys

import typer

from planner.commands.design import design
from planner.commands.diagnose import diagnose
from planner.commands.drive import drive
from planner.commands.field import field
from planner.commands.gnss import gnss
from planner.commands.plan import plan
from planner.commands.replay import replay
from planner.commands.study import study
from planner.commands.validate import validate

INTERRUPTED = "Interrupted; nothing was written."
BAD_INPUT_STATUS, INTERRUPTED_STATUS = 2, 130

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
app.command()(diagnose)
app.command()(replay)
app.command()(validate)
app.command()(drive)
app.command()(design)
app.add_typer(gnss, name="gnss")


def main() -> None:
    """Run the command line; the only place where errors become exit statuses."""
    try:
        app()
    except KeyboardInterrupt:
        _fail(INTERRUPTED, INTERRUPTED_STATUS)
    except SystemExit as end:
        # typer answers Ctrl-C and a closed pipe itself: without a word, and as a fault.
        if end.code == INTERRUPTED_STATUS:
            _fail(INTERRUPTED, INTERRUPTED_STATUS)
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except ValueError as error:
        from planner.errors import HeadlandError

        if not isinstance(error, HeadlandError):
            raise
        from planner.commands.options import option_of

        _fail(error.spoken(option_of), BAD_INPUT_STATUS)


def _fail(sentence: str, status: int) -> None:
    print(f"Error: {sentence}", file=sys.stderr)
    sys.exit(status)
