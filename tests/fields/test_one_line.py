"""Text from outside in one line, and short."""

import pytest

from fields.errors import (
    MAX_SENTENCE_CHARS,
    MAX_VALUE_CHARS,
    HeadlandError,
    escape_controls,
    make_one_line,
    mark_parameter,
    shorten_middle,
)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("north\nfield", "north\\nfield"),
        ("\x1b[2Jgone\x07", "\\x1b[2Jgone\\x07"),
        ("a\u2028b\x85c\u202ed", "a\\u2028b\\x85c\\u202ed"),
        ("Großer Acker 畑 'Øst' \u00a0", "Großer Acker 畑 'Øst' \u00a0"),
    ],
)
def test_controls_are_shown(text: str, shown: str) -> None:
    assert escape_controls(text) == shown
    assert len(escape_controls(text).splitlines()) == 1


def test_a_value_keeps_both_ends() -> None:
    assert shorten_middle("x" * MAX_VALUE_CHARS) == "x" * MAX_VALUE_CHARS
    short = shorten_middle("/begin" + "x" * 10_000 + "/end.csv")
    assert (
        len(short) == MAX_VALUE_CHARS and short.startswith("/begin") and "..." in short and short.endswith("/end.csv")
    )


@pytest.mark.parametrize("value", ["9" * 10_000, "a b " * 5000, "it's " * 5000, 'say "it" ' * 3000, "\\" * 9999])
def test_long_values_are_short_in_a_sentence(value: str) -> None:
    line = make_one_line(f"--width {value!r} is no width; write for instance '3'.")
    assert len(line) <= 2 * MAX_VALUE_CHARS and line.startswith("--width ") and line.endswith("write for instance '3'.")
    assert make_one_line(line) == line


@pytest.mark.parametrize(
    "sentence",
    [
        "The plan's field 'north' isn't one of: 'south', 'west', and nothing of the farmer's is 'as wide as that'.",
        "'a.' is unknown; " + "use one of these many words, " * 5 + "such as 'b'.",
        "No strategy 'x' (did you mean 'y'?); " + ", ".join(f"strategy-{number}" for number in range(100)) + ".",
    ],
)
def test_what_is_short_stays(sentence: str) -> None:
    assert make_one_line(sentence) == sentence


def test_no_sentence_is_endless() -> None:
    assert len(make_one_line("word " * 100_000)) == MAX_SENTENCE_CHARS


def test_every_refusal_is_one_line() -> None:
    refusal = HeadlandError(f"{mark_parameter('width_m')} is {'7' * 5000}\n; give less.")
    assert str(refusal).startswith("width_m is 777") and len(str(refusal)) < 2 * MAX_VALUE_CHARS
    assert refusal.render_sentence(lambda name: f"--{name}").startswith("--width_m is 777")
    assert len(str(refusal).splitlines()) == 1 and refusal.parameter == "width_m"
