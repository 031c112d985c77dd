"""How the parameters of a request are written on the command line, in the API and in a farm file."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from operator import mul
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from planner.errors import strip_unit, suggest_name

_OPTION_REFERENCE = re.compile(r"\{(\w+)\}")
Part = TypeVar("Part")


@dataclass(frozen=True)
class NumberLimits:
    """What a number may be, in `unit` as its option is written: above `above` or at least `low`, and at most `high`.

    The parameter is `scale` times the option. Refusals call it `label`.
    """

    label: str = ""
    unit: str = ""
    low: float = 0.0
    high: float = float("inf")
    above: bool = False
    scale: float = 1.0

    def contains(self, value: float) -> bool:
        """Whether a number, as written, is within the limits, but for the rounding of a conversion."""
        if self.above and not value > self.low:
            return False
        return self.low - 1e-9 * abs(self.low) <= value <= self.high + 1e-9 * abs(self.high)

    def describe_range(self) -> str:
        """What to use."""
        unit = f" {self.unit}" if self.unit else ""
        low, high = (f"{limit:g}" if abs(limit) < 1e6 else f"{limit:,.0f}" for limit in (self.low, self.high))
        return f"use more than {low} and at most {high}{unit}" if self.above else f"use {low} to {high}{unit}"


@dataclass(frozen=True)
class PlanOption:
    """One option as it is asked for: in the annotation of its parameter what is said of it there, in `list_options`
    with all the rest.

    `help` refers to other options as {name}, and `api_help` replaces it where the API takes something else. An option
    has the name of its parameter without the unit, unless `name` is given. `declaration` is what the command line calls
    a yes-or-no option with an opposite. With `from_farm` a farm file may set the parameter. `flags` are yes-or-no
    options that set it together: for each its value and its help, by name; such a flag has the `value` that it gives
    its parameter. `other_words` begin what people say for a choice. `type` (without None) and `default` are those of
    the parameter; where the option does not take what its parameter holds, they are of what it takes, and `parse` reads
    that.
    """

    help: str
    panel: str
    name: str = ""
    api_help: str = ""
    choices: tuple[str, ...] = ()
    declaration: str = ""
    from_farm: bool = False
    flags: Mapping[str, tuple[str, str]] | None = None
    parse: Callable[[Any], Any] | None = None
    type: Any = str
    default: Any = None
    parameter: str = ""
    limits: NumberLimits | None = None
    value: str | None = None
    other_words: Mapping[str, str] | None = None

    def suggest_choice(self, text: str) -> str:
        """ " (did you mean ...?)" where a text looks like one of the choices, or begins with another word for one."""
        said = (choice for word, choice in (self.other_words or {}).items() if text.lower().startswith(word))
        return suggest_name(next(said, text), self.choices)

    def format_help(self, name_option: Callable[[str], str], *, for_api: bool = False) -> str:
        """The help text, with other options under the names they have for the reader."""
        text = self.api_help if for_api and self.api_help else self.help
        return _OPTION_REFERENCE.sub(lambda match: name_option(match[1]), text)


@cache
def list_options(model: type) -> tuple[PlanOption, ...]:
    """The options of a model, in the order of its parameters."""
    options: list[PlanOption] = []
    annotations = get_type_hints(model, include_extras=True)
    for parameter in fields(model):
        annotation, default = annotations[parameter.name], cast(Any, parameter.default)
        said = find_annotation_metadata(annotation, PlanOption)
        limits = find_annotation_metadata(annotation, NumberLimits)
        assert said is not None, f"{parameter.name} has no option"
        option = replace(said, name=said.name or strip_unit(parameter.name), parameter=parameter.name, limits=limits)
        if option.parse is None and limits is not None and limits.scale != 1.0:
            written = None if default is None else float(default) / limits.scale
            option = replace(option, type=float, parse=partial(mul, limits.scale), default=written)
        elif option.parse is None:
            option = replace(option, type=get_plain_type(annotation), default=default)
        flags = (option.flags or {}).items()
        options += [
            replace(option, name=name, type=bool, default=False, help=text, limits=None, value=value)
            for name, (value, text) in flags
        ] or [option]
    return tuple(options)


def find_annotation_metadata(annotation: Any, kind: type[Part]) -> Part | None:
    """What the annotation of a parameter says of a kind."""
    return next((part for part in annotation.__metadata__ if isinstance(part, kind)), None)


def convert_options_to_parameters(model: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters from options by name; None and the options of other models are skipped. Raises RequestError."""
    parameters: dict[str, Any] = {}
    for option in list_options(model):
        given = values.get(option.name)
        if option.value is not None:
            parameters |= {option.parameter: option.value} if given else {}
        elif given is not None:
            parameters[option.parameter] = given if option.parse is None else option.parse(given)
    return parameters


def get_plain_type(annotation: Any) -> Any:
    """The type of an annotation, without what is said about it and without None."""
    if get_origin(annotation) is Annotated:
        return get_plain_type(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return get_plain_type(next(part for part in get_args(annotation) if part is not type(None)))
    return annotation
