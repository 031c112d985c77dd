"""A catalogue that puts every known text into ⟦brackets⟧, in the place of the German one."""

from collections.abc import Iterator

import pytest

from reports.common import language as languages
from tests.reports.catalogues import collect_texts


class Brackets:
    """A catalogue that puts every known text into ⟦brackets⟧."""

    def __init__(self) -> None:
        self.texts = {form for text in collect_texts() for form in ((text,) if isinstance(text, str) else text)}

    def gettext(self, text: str) -> str:
        return f"⟦{text}⟧" if text in self.texts else text

    def ngettext(self, one: str, many: str, count: int) -> str:
        return self.gettext(one if count == 1 else many)

    def list_messages(self) -> dict[str, str]:
        return {text: f"⟦{text}⟧" for text in self.texts}


@pytest.fixture
def brackets(monkeypatch: pytest.MonkeyPatch) -> Iterator[Brackets]:
    """German with every text in brackets."""
    catalogue = Brackets()
    languages._list_patterns.cache_clear()
    monkeypatch.setattr(languages, "load_catalogue", lambda language: catalogue)
    monkeypatch.setattr(languages, "get_messages", lambda language: catalogue.list_messages())
    yield catalogue
    languages._list_patterns.cache_clear()
