"""The `headland` command: collects the commands and turns errors into one sentence and an exit status.

Two commands are here: `headland guide` (prints a page of the guide) and `headland setup` (compiles all beforehand).

Exit status: 0 done, 1 disk full, out of memory or a fault of Headland, 2 bad input or usage, 3 no feasible plan
or a tractor file that is not worth saving, 4 a worker of another version than the service, 130 interrupted.
"""

from __future__ import annotations

import contextlib
import difflib
import errno
import io
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Annotated, Any, NoReturn, Optional

import typer
from typer.core import TyperGroup

from fields.errors import make_one_line, shorten_middle
from planner.cli.common.language_options import (
    LANGUAGE_HELP,
    UNITS_HELP,
    choose_reader,
    get_english_help,
    translate_help,
)
from planner.cli.common.terminal import LOADING, compile_missing, print_renderable, print_sentence
from planner.cli.comparisons import compare_bearings, compare_headlands
from planner.cli.day import day
from planner.cli.diagnosis import diagnose, replay
from planner.cli.experiments import design, drive, study, validate
from planner.cli.field import FieldCommand, field
from planner.cli.machines import farm, gnss, tractor
from planner.cli.plan import plan
from planner.cli.robots import demo, robot
from planner.cli.saved_plan import export, show
from planner.cli.server import backup, restore, serve, token, worker
from planner.cli.sweep import sweep
from planner.cli.task_logs import compare, learn, logs
from planner.pipeline.interrupts import is_interrupt, repeat_interrupts
from planner.request.option_texts import suggest_number
from reports.common.language import FILES, set_reader, translate, translate_sentence, use_reader

FAULT_STATUS, BAD_INPUT_STATUS, INTERRUPTED_STATUS = 1, 2, 130
HELP_SHOWN_ERROR = "NoArgsIsHelpError"  # raised by typer after printing the help
_NOT_A_NUMBER = re.compile(
    r"Invalid value for '(?P<option>--[\w-]+)': Input should be a valid (?P<kind>integer|number), unable to parse.*"
)
_NUMBERS = re.compile(r"\d[\d.,:-]*")  # one, several, or a range
DEBUG_VARIABLE = "HEADLAND_DEBUG"  # set to 1, a fault of Headland prints its traceback


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


_COMMANDS: dict[str, Callable[..., None]] = {
    "plan": plan, "sweep": sweep, "compare-headlands": compare_headlands, "compare-bearings": compare_bearings,
    "show": show, "export": export, "field": field, "study": study, "diagnose": diagnose, "replay": replay,
    "compare": compare, "learn": learn, "validate": validate, "drive": drive, "design": design, "serve": serve,
    "worker": worker,
    "robot": robot, "backup": backup, "restore": restore, "guide": guide, "setup": setup,
}  # fmt: skip
"""Commands in the order of the help; the groups of commands follow."""
_GROUPS = {"gnss": gnss, "tractor": tractor, "farm": farm, "logs": logs, "day": day, "token": token, "demo": demo}


class MisuseError(Exception):
    """Unusable arguments of the command line, in one sentence."""


class CommandGroup(TyperGroup):
    """All commands; usage errors of typer become one sentence, like every other refusal."""

    def make_context(self, info_name: str | None, args: list[str], *others: Any, **options: Any) -> Any:
        """As typer does, with usage errors converted and help in the language of the reader."""
        set_reader(FILES)
        set_reader(choose_reader(args, os.environ))
        with use_reader(), _convert_usage_errors(self):
            refuse_spaced_lists(args)
            translate_help(self)
            return super().make_context(info_name, args, *others, **options)

    def invoke(self, ctx: Any) -> Any:
        """As typer does, with usage errors converted."""
        with _convert_usage_errors(self):
            return super().invoke(ctx)


@contextlib.contextmanager
def _convert_usage_errors(group: CommandGroup) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        if not hasattr(error, "format_message") or type(error).__name__ == HELP_SHOWN_ERROR:
            raise
        raise MisuseError(_describe_misuse(error, group)) from None


app = typer.Typer(
    name="headland",
    cls=CommandGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=True,
    rich_markup_mode="markdown",
)


def print_version(wanted: bool) -> None:
    """Print the installed version and exit, if it is wanted."""
    if wanted:
        from importlib.metadata import version

        typer.echo(f"headland {version('headland')}")
        raise typer.Exit()


@app.callback()
def describe_headland(
    version: Annotated[
        bool, typer.Option("--version", callback=print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    language: Annotated[Optional[str], typer.Option(metavar="LANGUAGE", is_eager=True, help=LANGUAGE_HELP)] = None,
    units: Annotated[Optional[str], typer.Option(metavar="UNITS", is_eager=True, help=UNITS_HELP)] = None,
) -> None:
    """Plan field work for a fleet of robot tractors: simulate every plan, rank by time and tractor count.

    Example: headland plan myfarm.geojson --width 3 --tractors 1-6 --start 13:00 --deadline 17:00
    """


for _name, _command in _COMMANDS.items():
    app.command(_name, cls=FieldCommand if _command is field else None)(_command)
for _name, _group in _GROUPS.items():
    app.add_typer(_group, name=_name)


def main() -> None:
    """Run the command line; errors become exit statuses only here."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="replace")
    try:
        with repeat_interrupts():
            app(prog_name="headland")
    except KeyboardInterrupt as interrupt:
        _exit_interrupted(interrupt)
    except SystemExit as end:
        # typer handles Ctrl-C and a closed pipe itself: silently, and as a fault.
        if end.code == INTERRUPTED_STATUS:
            _exit_interrupted(end)
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        _discard_output()
        sys.exit(0)
    except Exception as error:
        if is_interrupt(error):
            _exit_interrupted(error)
        _fail(*_describe_error(error))


def _describe_error(error: Exception) -> tuple[str, int]:
    """The sentence and the exit status of an error. Imports nothing heavy, as an import may have failed."""
    refusals = sys.modules.get("fields.errors")
    if refusals is not None and isinstance(error, refusals.HeadlandError):
        from planner.cli.common.options import get_option_name

        return error.render_sentence(get_option_name), getattr(error, "status", BAD_INPUT_STATUS)
    if isinstance(error, MisuseError):
        return str(error), BAD_INPUT_STATUS
    is_debugging, written_note = os.environ.get(DEBUG_VARIABLE) == "1", _find_written_note(error)
    if is_debugging:
        traceback.print_exception(error)
    is_full = isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM)
    if isinstance(error, ImportError):  # also while a library was loaded
        is_full = any(text in str(error) for text in ("failed to map segment", "allocate memory"))
    if is_full:
        return (
            f"There is not enough memory; {written_note}. Use one process (--processes 1), fewer tractors, a smaller "
            "field or more memory."
        ), FAULT_STATUS
    if isinstance(error, OSError) and isinstance(error.filename, str | bytes):
        return (
            f"'{os.fsdecode(error.filename)[-80:]}' cannot be used: {error.strerror}; {written_note}.",
            BAD_INPUT_STATUS,
        )
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EIO, errno.EBADF):
        return (
            f"Standard output cannot be used: {error.strerror}; {written_note}. Print to another place.",
            FAULT_STATUS,
        )
    fault = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    debug_hint = "" if is_debugging else f"; set {DEBUG_VARIABLE}=1 to see where, and please report it"
    return f"A fault of Headland ({fault}); {written_note}{debug_hint}.", FAULT_STATUS


def _describe_misuse(error: Any, group: CommandGroup) -> str:
    """The sentence for arguments that typer cannot use."""

    def name_bad_number(found: re.Match[str]) -> str:
        """The beginning of a refusal of an option that is no number, with its value, which typer leaves out."""
        option, kind = found["option"], "whole number" if found["kind"] == "integer" else "number"
        words = [word.removeprefix(f"{option}=") for word in sys.argv]
        values = [after if word == option else word for word, after in zip(words, [*words[1:], ""], strict=True)]
        value = next((each for word, each in zip(sys.argv, values, strict=True) if word.split("=")[0] == option), "")
        hint = suggest_number(value, get_english_help(error.param)) if kind == "number" else ""
        return f"Invalid value for '{option}': '{value}' is not a {kind}{hint}"

    sentence = _NOT_A_NUMBER.sub(name_bad_number, " ".join(str(error.format_message()).split())).rstrip(".")
    sentence = re.sub(r"[.;]? Did you mean (.+)\?$", r" (did you mean \1?)", sentence)
    if several := re.fullmatch(r"(No such option: (\S+)) \(Possible options: (.+)\)", sentence):
        (nearest,) = difflib.get_close_matches(several[2], several[3].split(", "), n=1, cutoff=0.0)
        sentence = f"{several[1]} (did you mean {nearest}?)"
    command = getattr(getattr(error, "ctx", None), "command_path", None) or find_command_path(group, sys.argv[1:])
    return f"{sentence}; {command} --help lists the options."


def find_command_path(group: Any, words: Sequence[str]) -> str:
    """The command that words name, with its groups: "headland farm new"."""
    path = ["headland"]
    for word in words:
        if word in getattr(group, "commands", {}):
            group = group.commands[word]
            path.append(word)
    return " ".join(path)


def refuse_spaced_lists(words: Sequence[str]) -> None:
    """Raise MisuseError for a number after the value of an option, which would be read as the name of a field."""
    for option, value, extra in zip(words, words[1:], words[2:], strict=False):
        numbers = (_NUMBERS.fullmatch(value), _NUMBERS.fullmatch(extra))
        if option.startswith("--") and all(numbers) and not os.path.lexists(extra):
            raise MisuseError(
                f"'{extra}' stands alone after {option} {value}; leave it out, or, where {option} takes a list, write "
                f"that without spaces: {value.rstrip(',')},{extra}."
            )


def _exit_interrupted(error: BaseException) -> None:
    _fail(f"Interrupted; {_find_written_note(error)}.", INTERRUPTED_STATUS)


def _find_written_note(error: BaseException | None) -> str:
    """What was written before an error: the note of `write_before_printing` on it or on its causes."""
    while error is not None:
        for note in getattr(error, "__notes__", ()):
            if str(note).endswith(" written"):
                return str(note)
        error = error.__cause__ or error.__context__
    return "nothing was written"


def _discard_output() -> None:
    """Discard pending output, so that the process ends without a complaint."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(sentence: str, status: int) -> NoReturn:
    text = f"Error: {sentence}"
    with contextlib.suppress(Exception), use_reader():  # a catalogue may be what cannot be read
        text = translate("Error: {sentence}", sentence=translate_sentence(sentence))
    for word in sys.argv[1:]:  # long arguments of the command line are shortened
        for long_text in (word, " ".join(word.split()).rstrip(".")):
            text = text.replace(long_text, shorten_middle(long_text)) if long_text else text
    print(make_one_line(text), file=sys.stderr)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError):
        _discard_output()
    sys.exit(status)


if __name__ == "__main__":
    main()
