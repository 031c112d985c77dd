"""Texts for people in their language: English is written in the code and is the key of every catalogue.

Catalogues are PO files in `reports/languages`. A text that a catalogue lacks stays English. What programs read (JSON,
CSV, files, logs) is English too: texts are in the language of the reader only within `use_reader`, where a screen is
printed. A sentence that was made elsewhere, in a worker or in a saved result, is found again by its key
(`translate_sentence`).
"""

from __future__ import annotations

import gettext
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

ENGLISH = "en"
LANGUAGE_NAMES = {ENGLISH: "English", "de": "Deutsch", "es": "Español", "fr": "Français", "ja": "日本語"}
METRIC, US = "metric", "us"
UNIT_SYSTEMS = (METRIC, US)
LANGUAGE_VARIABLE = "HEADLAND_LANGUAGE"
UNITS_VARIABLE = "HEADLAND_UNITS"
LOCALE_VARIABLES = ("LC_ALL", "LC_MESSAGES", "LANG")
LEAST_KEY_LETTERS = 6  # of a key around its values, for a sentence to be known by it
MOST_SENTENCE_CHARS = 2000  # comparing a longer text with all keys would take seconds
TYPED_VALUES = frozenset(("argument", "command", "file", "name", "option", "options", "other", "path"))
"""Values of sentences that are commands or names, which no language changes."""
_PLACEHOLDER = re.compile(r"\{(\w+)\}")


@dataclass(frozen=True)
class Reader:
    """Who reads a text: the code of the language, and "metric" or "us" units."""

    language: str = ENGLISH
    units: str = METRIC


FILES = Reader()  # what programs read
_reader: ContextVar[Reader] = ContextVar("reader", default=FILES)
_in_use: ContextVar[Reader] = ContextVar("reader in use", default=FILES)


def choose_language(environment: Mapping[str, str]) -> str:
    """The language of HEADLAND_LANGUAGE or else of the locale; English if there is no catalogue for it."""
    for name in (LANGUAGE_VARIABLE, *LOCALE_VARIABLES):
        if environment.get(name):
            return find_language(environment[name])
    return ENGLISH


def find_language(tag: str) -> str:
    """The language with a catalogue that a tag such as ``de_DE.UTF-8`` or ``fr-CA`` names, or English."""
    language = get_tag_language(tag)
    return language if language in LANGUAGE_NAMES else ENGLISH


def get_tag_language(tag: str) -> str:
    """The code of the language of a tag, whether there is a catalogue or not."""
    return tag.replace("-", "_").split("_")[0].split(".")[0].lower()


def set_reader(reader: Reader) -> None:
    """Print screens for this reader from here on, in this context."""
    _reader.set(reader)


@contextmanager
def use_reader(reader: Reader | None = None) -> Iterator[None]:
    """Make texts for a reader within a block, by default for the one that was set."""
    token = _in_use.set(_reader.get() if reader is None else reader)
    try:
        yield
    finally:
        _in_use.reset(token)


def get_language() -> str:
    """The code of the language in use."""
    return _in_use.get().language


def get_units() -> str:
    """The units in use: "metric" or "us"."""
    return _in_use.get().units


def mark_text(text: str) -> str:
    """The text as it is: it is translated where it is printed, and this call puts it into the catalogues."""
    return text


def translate(text: str, /, **values: object) -> str:
    """The text in the language in use, with values in the place of its ``{names}``."""
    translated = text if get_language() == ENGLISH else load_catalogue(get_language()).gettext(text)
    return translated.format(**values) if values else translated


def translate_count(one: str, many: str, count: int, /, **values: object) -> str:
    """The form of a text that fits a count, in the language in use; ``{count}`` is the count."""
    catalogue = gettext.NullTranslations() if get_language() == ENGLISH else load_catalogue(get_language())
    return catalogue.ngettext(one, many, count).format(count=count, **values)


def translate_sentence(sentence: str) -> str:
    """A finished English sentence in the language in use, found by the key that it was made from; else unchanged."""
    language = get_language()
    if language == ENGLISH or not sentence:
        return sentence
    if exact := get_messages(language).get(sentence):
        return exact
    may_have_values = " " in sentence and len(sentence) <= MOST_SENTENCE_CHARS
    patterns = _list_patterns(language) if may_have_values else []
    matches = ((pattern.fullmatch(sentence), translated) for pattern, translated in patterns)
    match, translated = next((pair for pair in matches if pair[0]), (None, sentence))
    if match is None:
        return sentence
    values = {name: _translate_value(name, value) for name, value in match.groupdict().items()}
    return _PLACEHOLDER.sub(lambda found: values.get(f"v_{found[1]}", found[0]), translated)


def _translate_value(name: str, value: str) -> str:
    """What stands in a sentence; what is typed stays as it is typed.

    It may be a sentence itself, or a list that is translated item by item (``late start (90 %), stops (8 %)``, ``fuel
    and people``) if all are known texts.
    """
    if name.removeprefix("v_") in TYPED_VALUES:
        return value
    whole = translate_sentence(value)
    if whole != value:
        return whole
    first, conjunction, last = value.rpartition(" and ")
    items = [*(first.split(", ") if conjunction else ()), *((last,) if conjunction else last.split(", "))]
    parts = (item.partition(" (") for item in items)  # figures in brackets after an item stay
    translated = [f"{translate_sentence(text)}{bracket}{figures}" for text, bracket, figures in parts]
    if any(one == item and re.search("[A-Za-z]", item) for item, one in zip(items, translated, strict=True)):
        return value
    if not conjunction:
        return ", ".join(translated)
    return translate("{items} and {last}", items=", ".join(translated[:-1]), last=translated[-1])


@cache
def _list_patterns(language: str) -> list[tuple[re.Pattern[str], str]]:
    """Keys with values as patterns, those with most text first, and their translations.

    A name that stands twice in a key has the same value twice.
    """
    patterns = []
    for key, translated in get_messages(language).items():
        letters = len(re.findall(r"[A-Za-z]", _PLACEHOLDER.sub("", key)))
        if not _PLACEHOLDER.search(key) or letters < LEAST_KEY_LETTERS:
            continue
        parts, known = [], set[str]()
        for place, part in enumerate(_PLACEHOLDER.split(key)):
            if place % 2 == 0:
                parts.append(re.escape(part))
            else:
                parts.append(f"(?P=v_{part})" if part in known else f"(?P<v_{part}>.*?)")
                known.add(part)
        patterns.append((letters, re.compile("".join(parts), re.DOTALL), translated))
    patterns.sort(key=lambda entry: -entry[0])
    return [(pattern, translated) for _, pattern, translated in patterns]


@cache
def load_catalogue(language: str) -> gettext.GNUTranslations:
    """The catalogue of a language other than English, without texts that are not translated yet."""
    from io import BytesIO

    from babel.messages.mofile import write_mo

    compiled = BytesIO()
    write_mo(compiled, _read_catalogue(language))
    compiled.seek(0)
    return gettext.GNUTranslations(compiled)


@cache
def get_messages(language: str) -> Mapping[str, str]:
    """All translated texts of a catalogue by their English, each form of a count on its own; none for English."""
    messages: dict[str, str] = {}
    for one in () if language == ENGLISH else _read_catalogue(language):
        if one.id:
            keys, texts = ((one.id,), (one.string,)) if isinstance(one.id, str) else (one.id, one.string)
            messages |= {keys[0]: texts[0], keys[-1]: texts[-1]}
    return messages


@cache
def _read_catalogue(language: str) -> Any:
    """The PO file of a language other than English, without texts that are not translated yet."""
    from io import BytesIO

    from babel.messages.pofile import read_po

    content = files("reports.languages").joinpath(f"{language}.po").read_bytes()
    catalogue = read_po(BytesIO(content), locale=language)
    for one in list(catalogue):
        if one.id and not all(one.string if isinstance(one.string, list | tuple) else [one.string]):
            catalogue.delete(one.id)
    return catalogue
