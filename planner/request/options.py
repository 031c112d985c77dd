"""How the parameters of a request are written on the command line, in the API and in a farm file."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache, partial
from operator import mul
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from planner.errors import strip_unit

_OPTION_REFERENCE = re.compile(r"\{(\w+)\}")
Part = TypeVar("Part")


@dataclass(frozen=True)
class OptionHelp:
    """Help and panel of one parameter of a request; stands in its annotation.

    `help` refers to other options as {name}, and `api_help` replaces it where the API takes something else. An option
    has the name of its parameter without the unit, unless `name` is given. `declaration` is what the command line calls
    a yes-or-no option with an opposite. With `from_farm` a farm file may set the parameter. `flags` are yes-or-no
    options that set it together: for each its value and its help, by name. Where an option does not take what its
    parameter holds, `parse` reads what it takes, of the type `kind` and by default `written`.
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
    kind: Any = str
    written: Any = None


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
class RequestOption:
    """One option as it is asked for: its type without None, its default, and the parameter it sets.

    A flag has the `value` that it gives its parameter.
    """

    name: str
    parameter: str
    type: Any
    default: Any
    help: str
    rules: OptionHelp
    parse: Callable[[Any], Any] | None = None
    limits: NumberLimits | None = None
    value: str | None = None

    def format_help(self, name_option: Callable[[str], str], *, for_api: bool = False) -> str:
        """The help text, with other options under the names they have for the reader."""
        text = self.rules.api_help if for_api and self.rules.api_help else self.help
        return _OPTION_REFERENCE.sub(lambda match: name_option(match[1]), text)


@cache
def list_options(model: type) -> tuple[RequestOption, ...]:
    """The options of a model, in the order of its parameters."""
    options: list[RequestOption] = []
    annotations = get_type_hints(model, include_extras=True)
    for parameter in fields(model):
        annotation, default = annotations[parameter.name], parameter.default
        rules = find_annotation_metadata(annotation, OptionHelp)
        limits = find_annotation_metadata(annotation, NumberLimits)
        assert rules is not None, f"{parameter.name} has no option"
        for name, (value, help_text) in (rules.flags or {}).items():
            options.append(RequestOption(name, parameter.name, bool, False, help_text, rules, value=value))
        if rules.flags is None:
            name, kind, parse = rules.name or strip_unit(parameter.name), get_plain_type(annotation), rules.parse
            if parse is not None:
                kind, default = rules.kind, rules.written
            elif limits is not None and limits.scale != 1.0:
                kind, parse = float, partial(mul, limits.scale)
                default = None if default is None else float(cast(Any, default)) / limits.scale
            options.append(RequestOption(name, parameter.name, kind, default, rules.help, rules, parse, limits))
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
