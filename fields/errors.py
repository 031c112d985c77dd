"""The base of every refusal of Headland, and the refusals of this room.

    HeadlandError(ValueError)            one sentence: the value, the rule, the fix
    ├── fields.errors.FieldError         a field, a field file or a layout request that cannot be used
    ├── vehicle.errors.VehicleError      a tractor, implement, ground or log that cannot be
    ├── strategies.errors.StrategyError  a strategy that cannot work this field with this fleet
    ├── reports.errors.ReportError       a result that cannot be drawn or written
    └── planner.errors.ScenarioError     a request that asks for the impossible

It stands here because this room is the lowest of the house: every other one may know it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

_ALIKE, _SLIP = 0.4, 0.7  # shares of letters in common: "best" and "surest" have 0.6, and are two words
_BEGINNING = 3
_OPEN, _CLOSE = "\ue000", "\ue001"  # private characters of Unicode: no sentence of a person holds them
_NAMED = re.compile(f"{_OPEN}([^{_OPEN}{_CLOSE}]*){_CLOSE}")


def named(parameter: str) -> str:
    """A parameter inside the sentence of a refusal; whoever shows it may call it by a name of its own."""
    return f"{_OPEN}{parameter}{_CLOSE}"


def nearest(name: str, known: Iterable[str]) -> str:
    """ " (did you mean ...?)" when a known name is a slip of the fingers away or longer or shorter, else nothing."""
    spelt = {one.lower(): one for one in known}
    close = difflib.get_close_matches(name.lower(), list(spelt), n=3, cutoff=_ALIKE)
    found = [one for one in close if _same(name, one) or _slipped(name.lower(), one)]
    return f" (did you mean {spelt[found[0]]!r}?)" if found else ""


def _slipped(name: str, other: str) -> bool:
    """Whether most letters are the same, or all but one of a short word."""
    one_off = len(name) == len(other) >= _BEGINNING and sum(a != b for a, b in zip(name, other, strict=True)) == 1
    return one_off or bool(difflib.get_close_matches(name, [other], cutoff=_SLIP))


def _same(name: str, other: str) -> bool:
    """Whether one begins as the other, or is a whole word of it."""
    short, long = sorted((name.lower(), other.lower()), key=len)
    return len(short) >= _BEGINNING and (long.startswith(short) or short in re.split(r"[-_ ]", long))


class HeadlandError(ValueError):
    """A refusal: one sentence that names the value, the rule it breaks and the way to put it right.

    `parameter` is the name of the parameter at fault where one is; by default the first that the sentence names with
    `named`. `spoken` gives the sentence with other names for its parameters, as the options of the command line.
    """

    def __init__(self, sentence: str, *, parameter: str | None = None) -> None:
        super().__init__(sentence)
        first = _NAMED.search(sentence)
        self.parameter = parameter or (first[1] if first else None)

    def spoken(self, name: Callable[[str], str]) -> str:
        """The sentence, every parameter in it called by `name` of it."""
        return _NAMED.sub(lambda match: name(match[1]), str(self.args[0]))

    def __str__(self) -> str:
        return self.spoken(lambda parameter: parameter)


@contextmanager
def about(parameter: str) -> Iterator[None]:
    """Refusals of the body that name no parameter are about this one."""
    try:
        yield
    except HeadlandError as refusal:
        refusal.parameter = refusal.parameter or parameter
        raise


class FieldError(HeadlandError):
    """A field, a field file or a layout request that cannot be used."""
