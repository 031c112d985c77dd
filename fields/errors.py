"""The base of every refusal of Headland, and text from outside shortened to one readable line.

    HeadlandError(ValueError)                          one sentence: the value, the rule, the fix
    ├── fields.errors.FieldError                       a field, field file or layout request that cannot be used
    ├── vehicle.errors.VehicleError                    a tractor, implement, ground or log that cannot be used
    ├── strategies.path_planning.errors.StrategyError  a strategy that cannot work this field with this fleet
    ├── reports.common.rendering.ReportError           a result that cannot be drawn or written
    └── planner.errors.RequestError                    a request that cannot be fulfilled

More special ones derive from it, or from these, where they are raised. It is in `fields` because this is the lowest
package: every other one may import it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager

MAX_VALUE_CHARS, VALUE_TAIL_CHARS = 100, 27
"""Characters of one value shown in a sentence, and how many of these are the end of the value."""
MAX_NAMED, MAX_LISTED, MAX_FAULTS = 5, 12, 30
"""Names in a sentence, choices that are offered and faults of a file; how many more there are is counted."""
MAX_SENTENCE_CHARS = 4000  # the longest sentences of Headland list MAX_FAULTS faults of a file
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
_QUOTED = re.compile(r"""(?<!\w)(['"])((?:\\.|(?!\1)[^\\])*)\1(?!\w)""")
_UNBROKEN = re.compile(rf"\S{{{MAX_VALUE_CHARS + 1},}}")
_MIN_SIMILARITY, _MIN_TYPO_SIMILARITY = 0.4, 0.7
"""Share of common letters of similar names, and of a name with a typo: "best" and "surest" (0.6) are two words."""
_MIN_PREFIX_LETTERS = 3
_MARK_OPEN, _MARK_CLOSE = "\ue000", "\ue001"  # private-use characters of Unicode, which no text contains
_MARKED = re.compile(f"{_MARK_OPEN}([^{_MARK_OPEN}{_MARK_CLOSE}]*){_MARK_CLOSE}")


def escape_controls(text: str) -> str:
    """The text with line breaks, other control characters and direction marks escaped as in Python: `\\n`."""
    return _CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), text)


def shorten_middle(text: str, max_chars: int = MAX_VALUE_CHARS, tail_chars: int = VALUE_TAIL_CHARS) -> str:
    """The text in at most `max_chars` characters; a longer one loses its middle, as the ends of a path say most."""
    return (
        text if len(text) <= max_chars else f"{text[: max_chars - tail_chars - 3]}...{text[len(text) - tail_chars :]}"
    )


def shorten_value(value: object, max_chars: int = 40) -> str:
    """Any value from a file as short text for a sentence."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested too deeply, or an integer with more digits than Python prints
        return f"a {type(value).__name__} too large to show"
    return text if len(text) <= max_chars else text[: max_chars - 3] + "..."


def join_first(names: Sequence[str], most: int = MAX_NAMED) -> str:
    """The first names, and how many more there are: "a, b and 3 more"."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def make_one_line(sentence: str) -> str:
    """The sentence in one line: control characters escaped, long values shortened."""
    line = _QUOTED.sub(lambda match: match[1] + shorten_middle(match[2]) + match[1], escape_controls(sentence))
    line = _UNBROKEN.sub(lambda match: shorten_middle(match[0]), line)
    return shorten_middle(line, MAX_SENTENCE_CHARS, MAX_SENTENCE_CHARS // 2)


def mark_parameter(parameter: str) -> str:
    """Mark a parameter inside a refusal, so that `HeadlandError.render_sentence` can replace its name."""
    return f"{_MARK_OPEN}{parameter}{_MARK_CLOSE}"


def suggest_name(name: str, known_names: Iterable[str]) -> str:
    """ " (did you mean ...?)" when the name looks like a typo or a part of a known name, otherwise ""."""
    spellings = {known_name.lower(): known_name for known_name in known_names}
    close = difflib.get_close_matches(name.lower(), list(spellings), n=3, cutoff=_MIN_SIMILARITY)
    suggestions = [
        candidate for candidate in close if _is_shared_beginning(name, candidate) or _is_typo(name.lower(), candidate)
    ]
    return f" (did you mean {spellings[suggestions[0]]!r}?)" if suggestions else ""


def measure_likeness(name: str, other: str) -> float:
    """How much of two names is the same, 0 to 1; capitals do not count."""
    return difflib.SequenceMatcher(None, name.lower(), other.lower()).ratio()


def _is_typo(name: str, known_name: str) -> bool:
    """Whether most letters are the same, or all but one letter of a short word."""
    differs_by_one = (
        len(name) == len(known_name) >= _MIN_PREFIX_LETTERS
        and sum(a != b for a, b in zip(name, known_name, strict=True)) == 1
    )
    return differs_by_one or bool(difflib.get_close_matches(name, [known_name], cutoff=_MIN_TYPO_SIMILARITY))


def _is_shared_beginning(name: str, known_name: str) -> bool:
    """Whether one name begins with the other, or contains it as a whole word."""
    short, long = sorted((name.lower(), known_name.lower()), key=len)
    return len(short) >= _MIN_PREFIX_LETTERS and (long.startswith(short) or short in re.split(r"[-_ ]", long))


class HeadlandError(ValueError):
    """A refusal: one sentence that names the value, the rule it breaks and the fix.

    `parameter` is the name of the parameter at fault, if there is one; by default the first that the sentence marks
    with `mark_parameter`. `render` gives the sentence with other names for parameters, such as command-line options.
    """

    def __init__(self, sentence: str, *, parameter: str | None = None) -> None:
        super().__init__(sentence)
        first_marked = _MARKED.search(sentence)
        self.parameter = parameter or (first_marked[1] if first_marked else None)

    def render_sentence(self, rename_parameter: Callable[[str], str]) -> str:
        """The sentence in one line with its marked parameters renamed and long values shortened."""
        return make_one_line(_MARKED.sub(lambda match: rename_parameter(match[1]), str(self.args[0])))

    def __str__(self) -> str:
        return self.render_sentence(lambda parameter: parameter)


@contextmanager
def attach_parameter(parameter: str) -> Iterator[None]:
    """Set this parameter on refusals of the body that name none."""
    try:
        yield
    except HeadlandError as refusal:
        refusal.parameter = refusal.parameter or parameter
        raise


@contextmanager
def rename_parameters(rename: Callable[[str], str]) -> Iterator[None]:
    """Call the parameters that refusals of the body mark by other names, such as those of the keys of a file."""
    try:
        yield
    except HeadlandError as refusal:
        refusal.args = (_MARKED.sub(lambda match: rename(match[1]), str(refusal.args[0])),)
        raise


class StopError(Exception):
    """Planning must stop: nothing is wrong with a plan, so nobody takes this for a fault of one."""


class FieldError(HeadlandError):
    """A field, a field file or a layout request that cannot be used."""
