"""Collects the texts that people read, in English, and adds those that a catalogue lacks to its PO file."""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from typing import Any

from babel.messages.catalog import Catalog
from babel.messages.pofile import read_po, write_po

from planner.farm.random_inputs import RANDOM_INPUTS
from planner.request.parameter_names import LABELS, STRATEGY_LABELS
from reports.plan.figures import COUNT_DROPS, FIGURES, SCREEN_DROPS, TABLE_DROPS
from tests.reports.sentence_texts import build_key, iter_sentences, parse_module
from tests.test_structure import ROOT

CATALOGUES = ROOT / "reports" / "languages"
SCRIPTS = ROOT / "planner" / "service" / "pages" / "static" / "js"
SHELL = SCRIPTS.parent / "index.html"
STYLES = SCRIPTS.parent / "css"
NO_TEXT = re.compile(
    r".*(system-ui|sans-serif).*|\(prefers-.*|[A-Z]{3,6}|Bearer|Content-Type|[a-z]+(, [a-z]+)+|[MLmlHhVv]\d.*"
)
"""Strings of scripts that name fonts, media, methods, headers, selectors or drawings."""
OWN_NAMES = frozenset(
    (
        '# A day for Headland\nfarm = "example"\nstart = "07:00"\n',
        "Accept", "AgOpenGPS", "Deutsch",
         "EPSG:25832", "English", "Español", "Feature", "FeatureCollection",
        "Français", "GeoJSON", "ISOXML 3 (TASKDATA)", "ISOXML 4 (TASKDATA)", "LineString", "Point",
        "Polygon", "Shapefile", "headland token new --scope planner --scope operator",
        "unknown ground", "unread obstacle",
    )
)  # fmt: skip
"""Names that are the same in every language."""

VALUE = re.compile(r"\$\{[^{}]*(?:\{[^{}]*\}[^{}]*)*\}")
"""A value in a template of a script."""
_TOKEN = r"""
    (?P<blank>\s+|//[^\n]*|/\*.*?\*/)
    |(?P<string>"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*')
    |(?P<template_string>`(?:[^`\\]|\\.)*`)
    |(?P<name>[\w$]+)
    {regexp}
    |(?P<sign>.)
"""
TOKEN = re.compile(_TOKEN.format(regexp=""), re.DOTALL | re.VERBOSE)
VALUE_TOKEN = re.compile(
    _TOKEN.format(regexp=r"|(?P<regexp>/(?:[^/\\\n\[]|\\.|\[(?:[^\]\\\n]|\\.)*\])+/\w*)"), re.DOTALL | re.VERBOSE
)
"""A piece of a script, and one where a value may begin: there a slash begins an expression."""
OPERATORS = frozenset(("return", "typeof", "case", "in", "of"))
_PAGE_WORDS = """
    accept; accepted; admin; after; ahead; alarm; all; any; area; asphalt; auto; automatic; back; before; behind;
    boundary; broken; by hand; cancelled; cheapest; connecting; dark; difference; distance; ditch; done; drive;
    driving; entrance; estimated; fail; failed; fastest; fence; first; forwards; guidance line; harvest; headland;
    hole; implement; its place among other fleets is unknown; its reports contradict each other; kept; last; lease;
    left; light; line; manual; mow; none; not linked; now; observe; obstacle; obstacles; offline; online; operate;
    operate, plan, read; over; pause; paused; plan; pole; queued; read; ready; recover; refill; remote control; resume;
    right; round; round, quicker; running; sample; seen; show; soil; sow; spray; square; start; stop; stopped; stopped
    by stop-all; supervised; surest; the service began anew; till; tractor; turning; waiting; waits for another by the
    plan; worked; working; yard
"""
PAGE_WORDS = frozenset(" ".join(words.split()) for words in _PAGE_WORDS.split(";"))
"""Words in lower case that the page shows, of its own or as data of the service."""
_FACT_LABELS = """
    Area; Area (ha); Aspect; Aspect share; Bearing; Bypassed; Cells; Corners; Covered; Crs; Cut off; Edge; Estimated;
    Fence; Headland; Headlands; Heights; Highest; Holes; Inside; Interrupted swaths; Kind; Largest; Lat; Length; Lines;
    Lon; Longest swath; Lowest; Margin; Max tractors; Max width; Median slope; Min width; Name; Not usable; Number;
    Obstacles; Over swaths; P90 slope; Pieces; Radius; Reason; Rings; Shortest swath; Source; Steepest at;
    Steepest slope; Swath length; Swaths; Takes; Turning radius; Turns; Typical width; Width; Headland passes; degrees;
    local metres
"""
FACT_LABELS = frozenset(" ".join(words.split()) for words in _FACT_LABELS.split(";"))
"""Labels that `headland field` makes of the keys of its facts, with their words."""

PRINTING = {
    "translate": 1, "mark_text": 1, "create_progress_callback": 1, "format_title": 1, "format_sentence": 1,
    "print_sentence": 1, "open_stage_bar": 1, "TableColumn": 2, "NumberLimits": 1,
}  # fmt: skip
"""Functions whose first arguments are texts, and how many."""
CALLS = re.compile(rf"\b(translate_count|build_plain_table|{'|'.join(PRINTING)})\(")

Text = str | tuple[str, str]
"""A text, or its forms for one and for many."""


@cache
def collect_texts() -> frozenset[Text]:
    """All texts of the command line and of the page."""
    texts = {
        *PAGE_WORDS, *FACT_LABELS, *RANDOM_INPUTS, *LABELS.values(), *STRATEGY_LABELS.values(),
        *_iter_marked_texts(), *_iter_figure_texts(), *_iter_help_texts(), *_iter_page_texts(), *_iter_shell_texts(),
        *iter_sentences(),
    }  # fmt: skip
    singulars = {text[0] for text in texts if isinstance(text, tuple)}  # a catalogue holds a key once
    return frozenset(texts - singulars)


def read_catalogue(language: str) -> Catalog:
    """The PO file of a language."""
    return read_po(BytesIO((CATALOGUES / f"{language}.po").read_bytes()), locale=language)


def find_untranslated(language: str) -> list[Text]:
    """Texts that a catalogue lacks or leaves empty."""
    catalogue = read_catalogue(language)
    messages = {message.id: message.string for message in catalogue}
    empty = ("", ("",), ("", ""))
    return sorted((text for text in collect_texts() if messages.get(text, "") in empty), key=str)


def write_catalogue(language: str) -> None:
    """Add the missing texts to a PO file, untranslated, and remove those that nobody reads any more."""
    before, after = read_catalogue(language), Catalog(locale=language)
    after.mime_headers = before.mime_headers  # the number of plurals that the file has, not that of the locale
    for text in sorted(collect_texts(), key=str):
        known = before.get(text[0] if isinstance(text, tuple) else text)
        after.add(text, known.string if known is not None and known.id == text else "")
    buffer = BytesIO()
    write_po(buffer, after, width=0, omit_header=False, include_previous=False)
    # What tools need is in the header, and no dates, which change at every run.
    forms = {"ja": "nplurals=1; plural=0;", "fr": "nplurals=2; plural=(n > 1);"}
    plural = forms.get(language, "nplurals=2; plural=(n != 1);")
    head = (
        'msgid ""\nmsgstr ""\n"Content-Type: text/plain; charset=UTF-8\\n"\n'
        f'"Language: {language}\\n"\n"Plural-Forms: {plural}\\n"\n'
    )
    (CATALOGUES / f"{language}.po").write_bytes((head + "\n" + buffer.getvalue().decode().split("\n\n", 1)[1]).encode())


def _iter_marked_texts() -> Iterator[Text]:
    """Literals that the code gives to functions that translate or print."""
    for package in ("planner", "reports"):
        for path in (ROOT / package).rglob("*.py"):
            if CALLS.search(path.read_text(encoding="utf-8")):
                yield from (text for node in ast.walk(parse_module(path)) for text in _read_call(node))


def _iter_figure_texts() -> Iterator[str]:
    """Headings and notes of figures of plans that a terminal shows."""
    for key in {*SCREEN_DROPS, *TABLE_DROPS, *COUNT_DROPS}:
        texts = (FIGURES[key].heading, FIGURES[key].short_heading, FIGURES[key].note)
        yield from (text for text in texts if re.search(r"[A-Za-z]{2}", text) and key not in ("fuel_l", "energy_kwh"))


def _read_call(node: ast.AST) -> Iterator[Text]:
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name):
        return
    if node.func.id == "build_plain_table" and isinstance(node.args[0], ast.Tuple):
        keys = [key for key in map(build_key, node.args[0].elts) if key]
        yield from (key for key in keys if re.search(r"[A-Za-z]{2}", key))
    if node.func.id not in ("translate_count", *PRINTING):
        return
    keys = [key for key in map(build_key, node.args[:2]) if key]
    if node.func.id == "translate_count" and len(keys) == 2:
        yield (keys[0], keys[1])
    elif node.func.id in PRINTING and keys:
        yield from (key for key in keys[: PRINTING[node.func.id]] if re.search(r"[A-Za-z]{2}", key))


def _iter_help_texts() -> Iterator[str]:
    """Help of all commands and options."""
    import typer.main

    from planner.cli import main
    from planner.cli.common.language_options import EXAMPLE, find_help_key, split_paragraphs

    app: Any = main.app  # a command already where tests prepared it
    waiting: list[Any] = [typer.main.get_command(app) if isinstance(app, typer.Typer) else app]
    while waiting:
        command = waiting.pop()
        waiting.extend(getattr(command, "commands", {}).values())
        for described in (command, *command.params):
            if getattr(described, "rich_help_panel", None):
                yield described.rich_help_panel
            if getattr(described, "help", None):
                paragraphs = split_paragraphs(described.help)
                yield from (EXAMPLE if each.startswith(EXAMPLE) else find_help_key(each) for each in paragraphs)


def _iter_page_texts() -> Iterator[str]:
    """Strings of the scripts that look like texts, and templates marked with t."""
    for path in sorted(SCRIPTS.rglob("*.js")):
        yield from read_script(path.read_text(encoding="utf-8"))


def read_script(script: str) -> Iterator[str]:
    """Texts of one script: strings with a capital letter or a space, and templates marked with t."""
    tokens = list(_iter_tokens(script))
    for place, (before, token) in enumerate(zip([None, *tokens], tokens, strict=False)):
        if token.type == "template_string":
            yield from (text for value in VALUE.findall(token.value) for text in read_script(value[2:-1]))
        if token.type == "template_string" and before is not None and before.value == "t":
            parts = VALUE.split(_unescape(token.value[1:-1]))
            yield "".join(f"{part}{{{index}}}" for index, part in enumerate(parts[:-1])) + parts[-1]
        elif token.value == "plural":
            yield from _read_plural([each.value for each in tokens[place + 1 : place + 40]])
        elif token.type == "string" and not _is_class(tokens, place) and (before is None or before.value != "from"):
            text = _unescape(token.value[1:-1])
            if is_text(text):
                yield text


@dataclass(frozen=True)
class _Token:
    """A piece of a script: a name, number, string, template_string, regexp or sign."""

    type: str
    value: str


def _iter_tokens(script: str) -> Iterator[_Token]:
    """The pieces of a script without comments and blanks; a slash begins an expression where no value can end."""
    place, before = 0, _Token("sign", "(")
    while place < len(script):
        ends_value = before.value in ")]}" if before.type == "sign" else before.value not in OPERATORS
        found = (TOKEN if ends_value else VALUE_TOKEN).match(script, place)
        assert found.lastgroup is not None
        place = found.end()
        if found.lastgroup != "blank":
            before = _Token(found.lastgroup, found[0])
            yield before


def _is_class(tokens: list[_Token], place: int) -> bool:
    """Whether a string follows ``class:``."""
    return place >= 2 and [each.value for each in tokens[place - 2 : place]] == ["class", ":"]


def _read_plural(tokens: list[str]) -> Iterator[str]:
    """The texts of plural(count, "entry", "entries"), given what follows the word."""
    depth, parts = 0, [list[str]()]
    for token in tokens:
        depth += {"(": 1, ")": -1, "[": 1, "]": -1}.get(token, 0)
        if depth == 0:
            break
        if token == "," and depth == 1:
            parts.append([])
        else:
            parts[-1].append(token)
    nouns = [part[0][1:-1] for part in parts[1:] if part[0][0] == '"']
    if nouns:
        yield from (f"{{0}} {noun}" for noun in (nouns[0], nouns[1] if len(nouns) > 1 else f"{nouns[0]}s"))


def is_text(string: str) -> bool:
    """Whether a string of a script is read by people."""
    if not re.search(r"[A-Za-z]{2}", string) or string in OWN_NAMES or NO_TEXT.fullmatch(string):
        return False
    return string[0].isupper() or (" " in string and not set(string.split()) <= read_class_names())


@cache
def read_class_names() -> frozenset[str]:
    """Names of classes in the style sheets and of kinds of elements."""
    sheets = " ".join(path.read_text(encoding="utf-8") for path in sorted(STYLES.glob("*.css")))
    return frozenset(re.findall(r"\.([a-z][a-z0-9-]*)", sheets)) | {"button"}


def _unescape(string: str) -> str:
    """A string as the script means it."""
    return (
        re.sub(r"\\u([0-9A-Fa-f]{4})", lambda found: chr(int(found[1], 16)), string)
        .replace('\\"', '"')
        .replace("\\n", "\n")
    )


def _iter_shell_texts() -> Iterator[str]:
    """Texts and labels of the page around all others."""
    shell = SHELL.read_text(encoding="utf-8")
    yield from (text.strip() for text in re.findall(r">([^<>]*[A-Za-z]{2}[^<>]*)<", shell))
    yield from re.findall(r'(?:aria-label|alt|title)="([^"]+)"', shell)
