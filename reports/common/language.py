"""Texts for people in their language: English is written in the code and is the key of every catalogue.

Catalogues are PO files in `reports/languages`. A text that a catalogue lacks stays English.
"""

from __future__ import annotations

import gettext
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib.resources import files

ENGLISH = "en"
LANGUAGE_NAMES = {ENGLISH: "English", "de": "Deutsch", "es": "Español", "fr": "Français", "ja": "日本語"}
LANGUAGE_VARIABLE = "HEADLAND_LANGUAGE"
LOCALE_VARIABLES = ("LC_ALL", "LC_MESSAGES", "LANG")
_language: ContextVar[str] = ContextVar("language", default=ENGLISH)


def choose_language(environment: Mapping[str, str]) -> str:
    """The language of HEADLAND_LANGUAGE or else of the locale; English if there is no catalogue for it."""
    for name in (LANGUAGE_VARIABLE, *LOCALE_VARIABLES):
        if environment.get(name):
            return find_language(environment[name])
    return ENGLISH


def find_language(tag: str) -> str:
    """The language with a catalogue that a tag such as ``de_DE.UTF-8`` or ``fr-CA`` names, or English."""
    language = tag.replace("-", "_").split("_")[0].split(".")[0].lower()
    return language if language in LANGUAGE_NAMES else ENGLISH


def set_language(language: str) -> None:
    """Print texts in this language from here on, in this context."""
    _language.set(language)


def get_language() -> str:
    """The code of the language in use."""
    return _language.get()


@contextmanager
def use_language(language: str) -> Iterator[None]:
    """Print texts in a language within a block."""
    token = _language.set(language)
    try:
        yield
    finally:
        _language.reset(token)


def translate(text: str, /, **values: object) -> str:
    """The text in the language in use, with values in the place of its ``{names}``."""
    translated = text if get_language() == ENGLISH else load_catalogue(get_language()).gettext(text)
    return translated.format(**values) if values else translated


def translate_count(one: str, many: str, count: int, /, **values: object) -> str:
    """The form of a text that fits a count, in the language in use; ``{count}`` is the count."""
    catalogue = gettext.NullTranslations() if get_language() == ENGLISH else load_catalogue(get_language())
    return catalogue.ngettext(one, many, count).format(count=count, **values)


@cache
def load_catalogue(language: str) -> gettext.GNUTranslations:
    """The catalogue of a language other than English."""
    from io import BytesIO

    from babel.messages.mofile import write_mo
    from babel.messages.pofile import read_po

    text = files("reports.languages").joinpath(f"{language}.po").read_bytes()
    compiled = BytesIO()
    write_mo(compiled, read_po(BytesIO(text), locale=language))
    compiled.seek(0)
    return gettext.GNUTranslations(compiled)


def get_messages(language: str) -> dict[str, str]:
    """All texts of a catalogue without plural forms, by their English; none for English."""
    if language == ENGLISH:
        return {}
    from io import BytesIO

    from babel.messages.pofile import read_po

    catalogue = read_po(BytesIO(files("reports.languages").joinpath(f"{language}.po").read_bytes()), locale=language)
    return {str(one.id): str(one.string) for one in catalogue if isinstance(one.id, str) and one.id and one.string}
