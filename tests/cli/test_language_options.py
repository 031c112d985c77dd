"""Language and units on the command line: what programs read, and the exit status, are the same for every reader."""

from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.reports.brackets import Brackets, brackets

pytestmark = pytest.mark.usefixtures("first_layout")

__all__ = ["brackets"]
READERS = [("--language", "de"), ("--units", "us"), ("--language=de", "--units=us")]


@pytest.mark.parametrize(("words", "reader"), [
    (("field", "netherlands", "--json"), READERS[-1]),
    *(((command, "example"), reader) for command in ("farm", "day") for reader in READERS),
])  # fmt: skip
def test_programs_read_the_same_bytes(
    headland: Run, brackets: Brackets, words: tuple[str, ...], reader: tuple[str, ...]
) -> None:
    english, other = headland(*words), headland(*reader, *words)
    assert (other.status, other.out) == (english.status, english.out)
    assert "⟦" not in other.out and other.status == 0


@pytest.mark.slow
@pytest.mark.parametrize("form", ["--json", pytest.param("--csv", marks=pytest.mark.matrix)])
def test_a_plan_is_the_same_for_programs(headland: Run, brackets: Brackets, small: Path, form: str) -> None:
    words = ("plan", small, "--local", "--tractors", "1", "--strategies", "split-field", form)
    english, other = headland(*words), headland("--language", "de", "--units", "us", *words)
    assert (other.status, other.out) == (english.status, english.out)


def test_a_refusal_is_in_the_language_of_the_reader(headland: Run, brackets: Brackets) -> None:
    for words in [("plan", "--tractors", "x"), ("plan", "--widht", "3"), ("plna",), ("day", "none.toml")]:
        english, other = headland(*words), headland("--language", "de", *words)
        assert english.status == other.status == 2 and "⟦" not in english.err
        assert other.err.startswith("⟦Error: ⟦"), other.err
        assert other.err.replace("⟦", "").replace("⟧", "") == english.err


def test_help_is_in_the_language_of_the_reader(headland: Run, brackets: Brackets) -> None:
    outcome = headland("--language", "de", "plan", "--help")
    text = " ".join(outcome.out.replace("│", " ").split())
    for part in ("⟦Options⟧", "⟦Write the map of the best plan.⟧", "⟦Show this message and exit.⟧", "⟦Field⟧"):
        assert part in text
    assert "⟦" not in headland("plan", "--help").out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--language", "ennui", "plan"), "Error: --language 'ennui' has no catalogue; use one of en, de, es, fr, ja."),
        (("--units", "yards", "plan"), "Error: --units 'yards' is unknown; use metric or us."),
        (("--units=", "plan"), "Error: --units '' is unknown; use metric or us."),
        (("--language",), None),
    ],
)
def test_an_unknown_reader_is_refused(headland: Run, words: tuple[str, ...], sentence: str | None) -> None:
    outcome = headland(*words)
    assert outcome.status == 2 and len(outcome.sentences) == 1
    assert sentence is None or outcome.sentences == [sentence]
