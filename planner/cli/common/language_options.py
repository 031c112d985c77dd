"""Language and units of the command line, from its options, the environment or the locale, and help texts in them.

The options stand before the command, and are read before any other, as help must be in the language as well.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import FunctionType
from typing import Any

import typer

from planner.errors import RequestError
from reports.common.language import (
    ENGLISH,
    LANGUAGE_NAMES,
    LANGUAGE_VARIABLE,
    METRIC,
    UNIT_SYSTEMS,
    UNITS_VARIABLE,
    Reader,
    choose_language,
    get_language,
    get_tag_language,
    mark_text,
    translate,
)
from strategies.names import STRATEGY_NAMES

LANGUAGE_OPTION, UNITS_OPTION = "--language", "--units"
EXAMPLE = "Example: "
_STRATEGIES = ", ".join(STRATEGY_NAMES)
LANGUAGE_HELP = (
    "Language of texts and help: en, de, es, fr, ja; else HEADLAND_LANGUAGE, else that of the system. JSON, CSV and "
    "files are in English."
)
UNITS_HELP = "Units on screens: metric or us (ft, acres, mph, gallons). Inputs, JSON and CSV are always metric."
HELP_TITLES = {
    "ARGUMENTS_PANEL_TITLE": mark_text("Arguments"),
    "OPTIONS_PANEL_TITLE": mark_text("Options"),
    "COMMANDS_PANEL_TITLE": mark_text("Commands"),
    "DEFAULT_STRING": mark_text("[default: {}]"),
    "REQUIRED_LONG_STRING": mark_text("[required]"),
}
"""Texts that typer has for itself, by their names in `typer.rich_utils`."""
HELP_HELP = mark_text("Show this message and exit.")
MISUSES = (
    mark_text("{fault}; {command} --help lists the options."),
    mark_text("No such option: {option}"),
    mark_text("No such option: {option} (did you mean {other}?)"),
    mark_text("No such command '{command}'"),
    mark_text("No such command '{command}' (did you mean '{other}'?)"),
    mark_text("Missing argument '{argument}'"),
    mark_text("Missing option '{option}'"),
    mark_text("Missing command"),
    mark_text("Option '{option}' requires an argument"),
    mark_text("Invalid value for '{option}': {reason}"),
    mark_text("'{value}' is not a whole number"),
    mark_text("'{value}' is not a number"),
    mark_text("'{value}' is not a number (write {number})"),
    mark_text("'{value}' is not a number (write it in {unit}: {number})"),
    mark_text("metres"),
    mark_text("degrees"),
    mark_text("percent"),
    mark_text("seconds"),
    mark_text("Got unexpected extra argument ({argument})"),
)
"""Sentences of typer on arguments that it cannot use, for the catalogues."""
SETTINGS = (
    mark_text("tractor file {label}"), mark_text("farm file {label}"), mark_text("day file {label}"),
    mark_text("{fault}, in line {line}: {text}"), mark_text("{fault}, at its end"),
)  # fmt: skip
"""What files of settings are called in refusals, and where something is wrong in them, for the catalogues."""
RANGES = (
    mark_text("The {label} ({option}) is {value}; use {low} to {high}."),
    mark_text("The {label} ({option}) is {value}; use more than {low} and at most {high}."),
    mark_text("{option} is {value}; use {low} to {high}."),
    mark_text("{option} is {value}; use more than {low} and at most {high}."),
)
"""How a refusal of a number reads, assembled elsewhere from parts, for the catalogues."""


def choose_reader(arguments: Sequence[str], environment: Mapping[str, str]) -> Reader:
    """The reader that options before the command ask for, else the environment; RequestError for what is unknown."""
    options: dict[str, str] = {}
    words = iter(arguments)
    for word in words:
        name, equals, value = word.partition("=")
        if not word.startswith("-"):
            break
        if name in (LANGUAGE_OPTION, UNITS_OPTION):
            options[name] = value if equals else next(words, "")
    name = LANGUAGE_OPTION if LANGUAGE_OPTION in options else LANGUAGE_VARIABLE
    tag = options.get(LANGUAGE_OPTION, environment.get(LANGUAGE_VARIABLE) or None)
    if tag is not None and get_tag_language(tag) not in LANGUAGE_NAMES:
        raise RequestError(f"{name} {tag[:40]!r} has no catalogue; use one of {', '.join(LANGUAGE_NAMES)}.")
    language = choose_language(environment) if tag is None else get_tag_language(tag)
    name = UNITS_OPTION if UNITS_OPTION in options else UNITS_VARIABLE
    units = options.get(UNITS_OPTION, environment.get(UNITS_VARIABLE) or METRIC)
    if units.lower() not in UNIT_SYSTEMS:
        raise RequestError(f"{name} {units[:40]!r} is unknown; use {' or '.join(UNIT_SYSTEMS)}.")
    return Reader(language, units.lower())


def translate_help(command: Any) -> None:
    """Put the texts of a command, its options and its subcommands in the language in use.

    Headings of the help are kept by typer for all commands of a process.
    """
    if get_language() != ENGLISH or "typer.rich_utils" in sys.modules:
        from typer import rich_utils

        for name, text in HELP_TITLES.items():
            setattr(rich_utils, name, translate(text))
        if isinstance(getattr(rich_utils, "_make_rich_text", None), FunctionType):
            folded: Any = partial(FoldedText, rich_utils._make_rich_text)
            rich_utils._make_rich_text = folded
    if get_language() != ENGLISH or hasattr(command, "english_texts"):
        _translate_command(command)


class FoldedText:
    """A help text as typer makes it, but wrapped where it has no spaces, such as Japanese, instead of cut off.

    It is broken between letters where a word is longer than the line.
    """

    def __init__(self, make_text: Callable[..., Any], **options: Any) -> None:
        self.text = make_text(**options)

    def __rich_console__(self, console: Any, options: Any) -> Any:
        yield from console.render(self.text, options.update(overflow="fold"))

    def __rich_measure__(self, console: Any, options: Any) -> Any:
        from rich.measure import Measurement

        return Measurement.get(console, options, self.text)


def _translate_command(command: Any) -> None:
    """Translate from the English texts, which are kept beside: a process may show help in several languages."""
    for described in (command, *command.params, command.get_help_option(typer.Context(command))):
        if not hasattr(described, "english_texts"):
            described.english_texts = described.__dict__.get("help"), described.__dict__.get("rich_help_panel")
        help_text, panel = described.english_texts
        if help_text:
            described.help = "\n\n".join(translate_paragraph(each) for each in split_paragraphs(help_text))
        if panel:
            described.rich_help_panel = translate(panel)
    for subcommand in getattr(command, "commands", {}).values():
        _translate_command(subcommand)


def get_english_help(described: Any) -> str:
    """The help of an option as the code has it."""
    return str(getattr(described, "english_texts", (described.help,))[0] or "")


def split_paragraphs(text: str) -> list[str]:
    """The paragraphs of a help text, each in one line."""
    return [" ".join(paragraph.split()) for paragraph in inspect.cleandoc(text).split("\n\n")]


def find_help_key(paragraph: str) -> str:
    """The key of a paragraph in the catalogues: the names of the strategies have no translation."""
    return paragraph.replace(_STRATEGIES, "{strategies}")


def translate_paragraph(paragraph: str) -> str:
    """A paragraph in the language in use; the command of an example and names of strategies stay."""
    word, colon, command = paragraph.partition(EXAMPLE)
    if colon and not word:
        return f"{translate(EXAMPLE)}{command}"
    key = find_help_key(paragraph)
    return translate(paragraph) if key == paragraph else translate(key, strategies=_STRATEGIES)
