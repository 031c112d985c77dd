"""Types of parameters of requests, and what pydantic finds wrong, as sentences with value, rule and fix."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from numbers import Integral, Rational, Real
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast, get_type_hints

from pydantic import BeforeValidator, ConfigDict, ValidationError, ValidationInfo

from fields.raw_document import GeoShape, convert_crs_to_text, is_shape_text, name_field, write_shape_text
from planner.errors import HeadlandError, RequestError, mark_parameter, shorten_value, suggest_name
from planner.request.option_texts import convert_clock_to_seconds, convert_time_to_text
from planner.request.options import get_plain_type, list_options

MAX_NUMBER = 10**18
STRICT = ConfigDict(strict=True, extra="forbid")
Model = TypeVar("Model")
TimeText = Annotated[str, BeforeValidator(convert_time_to_text)]
_TYPE_TEXTS: dict[Any, str] = {
    str: "a text",
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    tuple[int, ...]: "whole numbers in a tuple",
    tuple[str, ...]: "names in a tuple",
    tuple[float, float]: "two numbers in a tuple",
    tuple[tuple[int, float], ...]: "pairs of a cell's number and degrees in a tuple",
}
"""What to give for a parameter of a type."""
DOCS_HINT = "the API is documented at /api/v1/docs"
RULE_TEXTS = {
    "greater_than": "above {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "below {lt}",
    "less_than_equal": "at most {le}",
    "multiple_of": "a multiple of {multiple_of}",
    "finite_number": "a finite number",
    "literal_error": "{expected}",
    "enum": "{expected}",
}
TYPE_TEXTS = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "string": "text in quotes",
    "list": "a list",
    "tuple": "a list",
    "dict": "an object in braces",
    "model": "an object in braces",
    "datetime": "a time with its zone, such as 2026-05-04T08:00:00Z",
    "timezone": "a time with its zone, such as 2026-05-04T08:00:00Z",
}
COUNTED_UNITS = {
    "string_too_short": "letters",
    "string_too_long": "letters",
    "too_short": "entries",
    "too_long": "entries",
}
TAG_KEY, LONGEST_SHOWN_CHARS = "kind", 40


def _convert_to_number(value: Any, info: ValidationInfo) -> Any:
    """Numbers of other libraries as Python's."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return value
    _check_digits(value, str(info.field_name))
    return int(value) if isinstance(value, Integral) else float(value)


def _check_digits(value: Any, parameter: str) -> None:
    """Refuse whole numbers and fractions that a float may not hold."""
    if isinstance(value, Rational) and abs(int(cast(Any, value))) > MAX_NUMBER:
        mark = mark_parameter(parameter)
        raise RequestError(f"{mark} has too many digits; use {MAX_NUMBER:.0e} at most.")


def _convert_to_tuple(value: Any, info: ValidationInfo) -> Any:
    """Lists and ranges as tuples, with their entries."""
    if isinstance(value, tuple | list | range):
        return tuple(_convert_to_tuple(entry, info) for entry in value)
    return _convert_to_number(value, info)


def _convert_to_text(value: Any) -> Any:
    """The path of a file, or a coordinate system of pyproj, as a text."""
    return str(value) if isinstance(value, Path) else convert_crs_to_text(value)


def _convert_field_to_text(value: Any) -> Any:
    """A shape as GeoJSON, or the path of a file, as a text."""
    return write_shape_text(value) if isinstance(value, GeoShape) else _convert_to_text(value)


def _convert_clock(value: Any, info: ValidationInfo) -> Any:
    """A time of day as seconds of the day."""
    return _convert_to_number(convert_clock_to_seconds(value, str(info.field_name)), info)


Text = Annotated[str, BeforeValidator(_convert_to_text)]
FieldText = Annotated[str, BeforeValidator(_convert_field_to_text)]
Count = Annotated[int, BeforeValidator(_convert_to_number)]
ClockTime = Annotated[int, BeforeValidator(_convert_clock)]
Number = Annotated[float, BeforeValidator(_convert_to_number)]
Counts = Annotated[tuple[int, ...], BeforeValidator(_convert_to_tuple)]
Names = Annotated[tuple[str, ...], BeforeValidator(_convert_to_tuple)]
Place = Annotated[tuple[float, float], BeforeValidator(_convert_to_tuple)]
CellBearings = Annotated[tuple[tuple[int, float], ...], BeforeValidator(_convert_to_tuple)]


def raise_request_errors(model: type[Model]) -> type[Model]:
    """Let a pydantic dataclass raise RequestError instead of ValidationError; a decorator.

    A parameter may be given in the unit of its option as well: `speed_kmh` for `speed_mps`.
    """
    initialise: Any = model.__init__

    @functools.wraps(initialise)
    def initialise_or_refuse(self: Any, *values: Any, **named_values: Any) -> None:
        positional = dict(zip(model.__annotations__, values, strict=False))
        named_values = _convert_option_units(model, named_values, positional)
        try:
            initialise(self, *values, **named_values)
        except ValidationError as error:
            raise _build_request_error(model, error, positional | named_values) from None

    model.__init__ = initialise_or_refuse  # type: ignore[method-assign]
    return model


def _list_scaled_options(model: type) -> dict[str, tuple[str, float]]:
    """Parameter and scale of options in another unit than their parameter, such as speed_kmh, by name."""
    limited = [(one, one.limits) for one in list_options(model) if one.limits is not None]
    return {one.name: (one.parameter, limits.scale) for one, limits in limited if limits.scale != 1.0}


def _convert_option_units(model: type, named: Mapping[str, Any], positional: Mapping[str, Any]) -> dict[str, Any]:
    """The named values with those of options in the units of their parameters; raises RequestError."""
    converted = dict(named)
    scaled = _list_scaled_options(model)
    for name in filter(scaled.__contains__, named):
        value, (parameter, scale) = converted.pop(name), scaled[name]
        if parameter in named or parameter in positional:
            marks = f"{mark_parameter(name)} and {mark_parameter(parameter)}"
            raise RequestError(f"{marks} are the same in two units; leave out one of them.")
        if value is not None:
            if isinstance(value, bool) or not isinstance(value, Real):
                raise RequestError(f"{mark_parameter(name)} is {shorten_value(value)}; give a number.")
            _check_digits(value, name)
            value = float(value) * scale
        converted[parameter] = value
    return converted


def _build_request_error(model: type, error: ValidationError, given: Mapping[str, Any]) -> Exception:
    """The first fault that pydantic found, as a sentence about the whole value of its parameter."""
    fault = error.errors(include_url=False)[0]
    cause, name = fault.get("ctx", {}).get("error"), str(fault["loc"][0]) if fault["loc"] else ""
    if isinstance(cause, HeadlandError):
        return cause
    annotations = get_type_hints(model, include_extras=True)
    if name not in annotations:
        close = suggest_name(name, (*annotations, *_list_scaled_options(model)))
        return RequestError(
            f"{model.__name__} has no parameter {shorten_value(name)}{close}; headland guide options lists them.",
            parameter=name,
        )
    type_text = _TYPE_TEXTS[get_plain_type(annotations[name])]
    return RequestError(f"{mark_parameter(name)} is {shorten_value(given[name])}; give {type_text}.")


def format_given_values(request: Any) -> str:
    """A request with the values that differ from its defaults, as Python would write it; of a shape only a name."""
    values = [(each.name, getattr(request, each.name)) for each in fields(request)]
    defaults = {each.name: each.default for each in fields(request)}
    given = (
        f"{name}=<{name_field(value)}>" if isinstance(value, str) and is_shape_text(value) else f"{name}={value!r}"
        for name, value in values
        if value != defaults[name]
    )
    return f"{type(request).__name__}({', '.join(given)})"


def check_option_limits(request: Any) -> None:
    """Raise RequestError for a number beyond the limits of its option, or a word that is none of its choices."""
    for option in list_options(type(request)):  # type: ignore[arg-type]
        name, limits, choices = option.parameter, option.limits, option.choices
        value = getattr(request, name)
        if value is None:
            continue
        if limits is not None:
            written = value if limits.scale == 1.0 else value / limits.scale
            if not limits.contains(written):
                subject = f"The {limits.label} ({mark_parameter(name)})" if limits.label else mark_parameter(name)
                number = str(written) if isinstance(written, int) else f"{written:g}"
                unit = f" {limits.unit}" if limits.unit else ""
                raise RequestError(f"{subject} is {number}{unit}; {limits.describe_range()}.")
        if choices and value not in choices:
            close = option.suggest_choice(value)
            raise RequestError(
                f"{mark_parameter(name)} {value!r} is unknown{close}; use {', '.join(choices)}.", parameter=name
            )


def describe_fault(fault: Mapping[str, Any], location: str) -> str:
    """One fault that pydantic found, as a sentence; `location` is in the names that the sender knows.

    The value is shortened, and left out where it is too long or has too many entries.
    """
    kind, context = str(fault["type"]), fault.get("ctx", {})
    if kind == "json_invalid":
        return f"{location} is not JSON: {context.get('error', 'it cannot be read')}."
    if kind == "missing":
        return f"{location} is missing; give it."
    if kind == "extra_forbidden":
        return f"{location} is unknown; {DOCS_HINT}."
    if kind == "union_tag_not_found":
        return f"{TAG_KEY} is missing; give the kind of this object."
    if kind == "union_tag_invalid":
        *first, last = context["expected_tags"].split(", ")
        alternatives = f"{', '.join(first)} or {last}" if first else last
        return f"{TAG_KEY} is {_shorten_value(context['tag'])}; use {alternatives}."
    if kind in COUNTED_UNITS:  # too few or too many letters or entries, with their number where it can be counted
        rule = f"at least {context['min_length']}" if "min_length" in context else f"at most {context['max_length']}"
        value, unit = fault["input"], COUNTED_UNITS[kind]
        count = len(value) if isinstance(value, str | list | tuple | dict) else "other"
        return f"{location} has {count} {unit}; give {rule}."
    if kind == "string_pattern_mismatch":
        return f"{location} is {_shorten_value(fault['input'])}, with characters that are not allowed; leave them out."
    if kind == "value_error":
        return f"{location} is {_shorten_value(fault['input'])}: {str(context['error']).rstrip('.')}."
    expected_type = TYPE_TEXTS.get(kind.partition("_")[0])
    words = " ".join(str(fault["msg"]).split()).rstrip(".")
    broken_rule = f"give {expected_type}" if expected_type else words[:1].lower() + words[1:]
    if kind in RULE_TEXTS:
        limits = {
            name: int(value) if isinstance(value, float) and value.is_integer() else value
            for name, value in context.items()
        }
        broken_rule = f"use {RULE_TEXTS[kind].format(**limits)}"
    return f"{location} is {_shorten_value(fault['input'])}; {broken_rule}."


def format_location(parts: Sequence[Any]) -> str:
    """Where a fault is: keys and numbers of entries, joined by dots; keys are shortened and made printable."""
    return ".".join(json.dumps(str(part))[1:-1][:LONGEST_SHOWN_CHARS] for part in parts)


def _shorten_value(value: Any) -> str:
    """A value as it was sent, shortened."""
    text = ""
    try:
        value = value[: LONGEST_SHOWN_CHARS + 1] if isinstance(value, str) else value
        for part in json.JSONEncoder(default=str).iterencode(value):  # only as much as is shown
            text += part
            if len(text) > LONGEST_SHOWN_CHARS:
                return f"{text[: LONGEST_SHOWN_CHARS - 3]}..."
    except (RecursionError, ValueError):  # nested too deep, or a whole number of more digits than Python writes
        return "too large to show"
    return text
