"""The `headland` command: gathers the commands and turns refusals into one sentence and an exit status.

Exit status: 0 done, 1 no room on the disk, no memory or a fault of Headland itself, 2 bad input or usage, 3 no plan is
feasible, 130 interrupted.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import re
import sys
import traceback
from collections.abc import Iterator
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

from planner.commands.backup import backup, restore
from planner.commands.compare import compare
from planner.commands.day import day
from planner.commands.demo import demo
from planner.commands.design import design
from planner.commands.diagnose import diagnose
from planner.commands.drive import drive
from planner.commands.export import export
from planner.commands.farm import farm
from planner.commands.field import field
from planner.commands.gnss import gnss
from planner.commands.learn import learn
from planner.commands.logs import logs
from planner.commands.plan import plan
from planner.commands.replay import replay
from planner.commands.robot import robot
from planner.commands.saved import show
from planner.commands.serve import serve
from planner.commands.study import study
from planner.commands.token import token
from planner.commands.tractor import tractor
from planner.commands.validate import validate
from planner.interrupts import heard, was_interrupt

FAULT_STATUS, BAD_INPUT_STATUS, INTERRUPTED_STATUS = 1, 2, 130
HELP_SHOWN = "NoArgsIsHelpError"  # what typer raises where it has printed the help
DEBUG = "HEADLAND_DEBUG"  # set to 1, a fault of Headland prints where it happened


class MisuseError(Exception):
    """Words of the command line that it cannot use, in one sentence."""


class Commands(TyperGroup):
    """All commands; what typer says of words it cannot use becomes one sentence, as every other refusal is."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """As typer does."""
        with _in_a_sentence():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        """As typer does."""
        with _in_a_sentence():
            return super().invoke(ctx)


@contextlib.contextmanager
def _in_a_sentence() -> Iterator[None]:
    try:
        yield
    except Exception as error:
        if not hasattr(error, "format_message") or type(error).__name__ == HELP_SHOWN:
            raise
        raise MisuseError(_misuse(error)) from None


app = typer.Typer(
    name="headland",
    cls=Commands,
    help="Plan field work for a fleet of robot tractors: simulate every plan, rank by time and tractor count.\n\n"
    "Example: headland plan myfarm.geojson --width 3 --tractors 1-6 --start 13:00 --before 17:00",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=True,
    rich_markup_mode="markdown",
)
app.command()(plan)
app.command()(show)
app.command()(export)
app.command()(field)
app.command()(study)
app.command()(diagnose)
app.command()(replay)
app.command()(compare)
app.command()(learn)
app.command()(validate)
app.command()(drive)
app.command()(design)
app.command()(serve)
app.command()(robot)
app.command()(backup)
app.command()(restore)
app.add_typer(gnss, name="gnss")
app.add_typer(tractor, name="tractor")
app.add_typer(farm, name="farm")
app.add_typer(logs, name="logs")
app.add_typer(day, name="day")
app.add_typer(token, name="token")
app.add_typer(demo, name="demo")


def main() -> None:
    """Run the command line; the only place where errors become exit statuses."""
    _print_any_character()
    try:
        with heard():
            app()
    except KeyboardInterrupt as interrupt:
        _interrupted(interrupt)
    except SystemExit as end:
        # typer answers Ctrl-C and a closed pipe itself: without a word, and as a fault.
        if end.code == INTERRUPTED_STATUS:
            _interrupted(end)
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        _drop_output()
        sys.exit(0)
    except Exception as error:
        if was_interrupt(error):
            _interrupted(error)
        _fail(*_told(error))


def _told(error: Exception) -> tuple[str, int]:
    """The sentence and the exit status of an error. Imports nothing heavy: that may be what failed."""
    refusals = sys.modules.get("fields.errors")
    if refusals is not None and isinstance(error, refusals.HeadlandError):
        from planner.commands.options import option_of

        return error.spoken(option_of), getattr(error, "status", BAD_INPUT_STATUS)
    if isinstance(error, MisuseError):
        return str(error), BAD_INPUT_STATUS
    debug, done = os.environ.get(DEBUG) == "1", _written_before(error)
    if debug:
        traceback.print_exception(error)
    if _lacks_memory(error):
        return (
            f"There is not enough memory; {done}, try one process (--processes 1), fewer tractors or a smaller field, "
            "or allow more memory."
        ), FAULT_STATUS
    if isinstance(error, OSError) and isinstance(error.filename, str | bytes):
        return f"'{os.fsdecode(error.filename)[-80:]}' cannot be used: {error.strerror}; {done}.", BAD_INPUT_STATUS
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EIO, errno.EBADF):
        return f"Standard output cannot be used: {error.strerror}; {done}, print to another place.", FAULT_STATUS
    words = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    again = "" if debug else f"; {DEBUG}=1 shows where it happened, please report it"
    return f"A fault of Headland ({words}); {done}{again}.", FAULT_STATUS


def _misuse(error: Any) -> str:
    """The sentence of words of the command line that typer cannot use."""
    words = " ".join(str(error.format_message()).split()).rstrip(".")
    words = re.sub(r"[.;]? Did you mean (.+)\?$", r" (did you mean \1?)", words)
    context = getattr(error, "ctx", None)
    command = getattr(context, "command_path", None) or "headland"
    return f"{words}; {command} --help shows what there is."


def _lacks_memory(error: BaseException) -> bool:
    """Whether memory ran out, which a library that cannot be loaded says its way."""
    if isinstance(error, ImportError):
        return any(words in str(error) for words in ("failed to map segment", "allocate memory"))
    return isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM)


def _interrupted(error: BaseException) -> None:
    _fail(f"Interrupted; {_written_before(error)}.", INTERRUPTED_STATUS)


def _written_before(error: BaseException | None) -> str:
    """What was written before an error, in words: the note of planner.commands.outputs on it or on what led to it."""
    while error is not None:
        for note in getattr(error, "__notes__", ()):
            if str(note).endswith(" written"):
                return str(note)
        error = error.__cause__ or error.__context__
    return "nothing was written"


def _print_any_character() -> None:
    """A terminal that lacks a character shows a question mark for it."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="replace")


def _drop_output() -> None:
    """Let what is still to be printed go nowhere, so that nothing complains at the end of the process."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(sentence: str, status: int) -> NoReturn:
    print(f"Error: {sentence}", file=sys.stderr)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError):
        _drop_output()
    sys.exit(status)
