"""How deep TOML and JSON are nested, and how wide a table is, is looked at before anything is parsed."""

import json
import re
import time
import tomllib
from collections.abc import Callable

import pytest

from fields.errors import FieldError
from fields.nested_text import MAX_JSON_LEVELS, MAX_TOML_LEVELS, parse_json, parse_toml
from fields.text_files import MAX_COLUMNS, MAX_HEADER_CHARS, check_header

AT_ONCE_S = 5.0  # of a hundred thousand characters; what was parsed first took 37 s and more


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (".".join(["a"] * 50_000) + " = 1", "50000 parts"),
        ("[" + " . ".join(["a"] * 30_000) + "]", "30000 parts"),
        ("x = 1\n" + ".".join(['"a.\\""'] * 20_000) + " = 1", "20000 parts"),
        ("x = {" + ".".join(["'#'"] * 20_000) + " = 1}", "20000 parts"),
        ('x = """\n"" \\""" #\n"""\n' + ".".join(["a"] * 20_000) + " = 1", "20000 parts"),
        ("a = " + "[" * 50_000, "50000 levels"),
        ("a = " + "{a = " * 20_000, "20000 levels"),
    ],
)
def test_toml_that_is_nested_too_deep_is_refused_at_once(text: str, words: str) -> None:
    begin = time.process_time()
    with pytest.raises(ValueError, match=words) as refusal:
        parse_toml(text)
    assert time.process_time() - begin < AT_ONCE_S and "are allowed" in str(refusal.value)


@pytest.mark.parametrize("quotes", ['"\\"', '"', "'", '"""\\"', "'''\"", "\\"])
def test_strings_without_an_end_are_no_way_to_take_long(quotes: str) -> None:
    begin = time.process_time()
    for text in (f"a = {quotes * 50_000}", f"a = {quotes[0]}{quotes[1:] * 50_000}"):
        with pytest.raises(ValueError, match=r"in line 1: |at its end"):
            parse_toml(text)
    assert time.process_time() - begin < AT_ONCE_S


@pytest.mark.parametrize(
    "text",
    [
        ".".join(["a"] * MAX_TOML_LEVELS) + " = 1", "a = " + "[" * MAX_TOML_LEVELS + "]" * MAX_TOML_LEVELS, "",
        'a = "' + "." * 100 + "[" * 100 + '"', "a = '''\n" + "." * 100 + "[" * 100 + "'''", "# " + ".[" * 100,
        'a = """\n' + ". ' [" * 100 + '"""', '"' + "." * 100 + '" = 1.5', "a = [" + "1.5, " * 100 + "]",
        "\n".join(f"a.b{number} = 1.5" for number in range(100)),
    ],
)  # fmt: skip
def test_toml_that_people_write_is_read_as_ever(text: str) -> None:
    assert parse_toml(text) == tomllib.loads(text)


def test_json_has_an_end_of_its_levels() -> None:
    deepest = "[" * MAX_JSON_LEVELS + "]" * MAX_JSON_LEVELS
    assert parse_json(deepest) == json.loads(deepest)
    brackets = json.dumps(["[" * 1000, '\\"' + "{" * 1000])
    assert parse_json(brackets) == json.loads(brackets)
    for text in (f"[{deepest}]", '{"a":' * 600, '["[",' + "[" * 100_000):
        with pytest.raises(ValueError, match=f"levels deep; at most {MAX_JSON_LEVELS} are allowed"):
            parse_json(text)


@pytest.mark.parametrize(
    ("parse", "text", "words"),
    [
        (parse_toml, "a = 1\nwidht 3\n", "a key is not followed by = or : and its value, in line 2: 'widht 3'"),
        (
            parse_toml,
            "name = Fendt 724",
            "no number, true, false, list or text in quotes, in line 1: 'name",
        ),
        (parse_toml, "a = 4,5", "a value goes on after its end: write texts in quotes, and decimals with a point, in"),
        (parse_toml, "a = 1\na = 2\n", "a second time, in line 2: 'a = 2'"),
        (parse_toml, "a = [1", "a comma or a closing bracket is missing, at its end"),
        (parse_toml, 'a = "b\nc = 1', "a text has no closing quote, in line 1: "),
        (parse_json, "{'a': 1}", "there is no name in double quotes, in line 1: "),
        (parse_json, '{"a": 1} {}', "there is more after the end, in line 1: "),
        (parse_json, '{"a": 1,\n"b" 2}', "a key is not followed by = or : and its value, in line 2: '\"b\" 2}'"),
        (parse_json, '{"a": 1\n"b": 2}', "a comma or a closing bracket is missing, in line 2"),
        (parse_json, '{"a": [1, 2\n', "a comma or a closing bracket is missing, at its end"),
        (parse_json, "[" + "1, " * 900 + "x]", "in line 1: ', 1, 1, 1, 1, 1, x]'"),
    ],
)
def test_what_is_wrong_is_said_in_plain_words(parse: Callable[[str], object], text: str, words: str) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        parse(text)


@pytest.mark.parametrize("ending", ["\n1,2\n", "\r1,2\r", "\r\n", ""])
def test_a_table_has_an_end_of_its_columns(ending: str) -> None:
    check_header("," * (MAX_COLUMNS - 1) + ending, "a.csv", FieldError)
    check_header('"' + "," * 1000 + '\n"' + ending, "a.csv", FieldError)
    for header in ("," * MAX_COLUMNS, "," * 1_000_000, '"\n"' + "," * 1_000_000, '"\n",a"' + "," * 1_000_000 + '"'):
        with pytest.raises(FieldError, match=rf"^a\.csv has more than {MAX_COLUMNS} columns; "):
            check_header(header + ending, "a.csv", FieldError)


def test_a_table_has_an_end_of_its_first_line() -> None:
    check_header("a" * (MAX_HEADER_CHARS - 1) + "\n" + "1\n" * MAX_HEADER_CHARS, "a.csv", FieldError)
    for text in ("a" * 1_000_000, '"' + "\n" * 1_000_000):
        with pytest.raises(FieldError, match=f"has more than {MAX_HEADER_CHARS} characters"):
            check_header(text, "a.csv", FieldError)
