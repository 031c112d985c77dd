"""Files of parameters (TOML) as models, refused in one sentence that names every missing and every wrong key."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, TypeVar, get_args

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from fields.errors import MAX_FAULTS, MAX_LISTED, MAX_NAMED, HeadlandError, join_first, shorten_value, suggest_name
from fields.nested_text import parse_toml

Model = type[BaseModel]
Settings = TypeVar("Settings", bound=BaseModel)
Place = tuple[str | int, ...]
_LIST_ENTRY = re.compile(r"\b(\w+)\.(\d+)(?=[.:]| =)")


def parse_settings(
    text: str, model: type[Settings], name: str, error_type: type[HeadlandError], parameter: str | None = None
) -> Settings:
    """The settings of a text (TOML); the title of their model says what it is ("farm file"), `name` how it is called.

    Raises `error_type` with all faults in one sentence, which calls entries of lists by their names if they have any;
    a text of which most keys are unknown and like none of the model is of another kind.
    """
    subject = f"{model.model_config['title']} {name}"
    try:
        values = parse_toml(text)
    except ValueError as error:
        raise error_type(f"The {subject} is not TOML: {error}.", parameter=parameter) from None
    try:
        return model.model_validate(values)
    except ValidationError as error:
        places = [fault["loc"] for fault in error.errors() if fault["type"] == "extra_forbidden"]
        foreign = [str(place[0]) for place in places if len(place) == 1 and not _suggest_fix(place, model)]
        if 2 * len(foreign) > len(values):
            raise error_type(
                f"The {subject} is of another kind: it holds {join_first(foreign)}, but may hold "
                f"{join_first(list(model.model_fields), MAX_LISTED)}; name another file.",
                parameter=parameter,
            ) from None
        faults = describe_validation_errors(error, model, MAX_FAULTS)
        faults = _LIST_ENTRY.sub(lambda match: _name_entry(values, match), faults)
        raise error_type(f"The {subject} cannot be used: {faults}.", parameter=parameter) from None


def _name_entry(values: Mapping[str, Any], match: re.Match[str]) -> str:
    """An entry of a list by its name, or by its number from 1."""
    kind, number = match[1], int(match[2])
    if not isinstance(values.get(kind), list):
        return match[0]
    entry = values[kind][number]
    name = entry.get("name") if isinstance(entry, Mapping) else None
    return f"{kind}.{name}" if isinstance(name, str) and name else f"{kind} no. {number + 1}"


def describe_validation_errors(error: ValidationError, model: Model, max_count: int = MAX_NAMED) -> str:
    """Clauses for all complaints of pydantic: missing keys, unknown keys, and wrong values with their rule.

    `model` is the class that was validated; at most `max_count` wrong values are listed.
    """
    missing = [_describe_missing(fault["loc"], model) for fault in error.errors() if _is_missing(fault)]
    clauses_of_values = [_describe_fault(fault, model) for fault in error.errors() if not _is_missing(fault)]
    clauses = [f"it lacks {', '.join(missing[:MAX_LISTED])}"] if missing else []
    clauses += clauses_of_values[:max_count]
    omitted = max(len(missing) - MAX_LISTED, 0) + max(len(clauses_of_values) - max_count, 0)
    clauses += [f"and {omitted} more"] if omitted else []
    return "; ".join(clauses)


def _is_missing(fault: Any) -> bool:
    """Whether a key is missing; a missing number of a pair is reported with the pair."""
    return fault["type"] == "missing" and not isinstance(fault["loc"][-1], int)


def _describe_missing(place: Place, model: Model) -> str:
    info = _find_field(place, model)
    words = f" ({info.description})" if info is not None and info.description else ""
    return f"{_join_keys(place)}{words}"


def _describe_fault(fault: Any, model: Model) -> str:
    """Key, value and rule of one complaint."""
    place, kind, value = fault["loc"], fault["type"], fault["input"]
    if kind == "value_error":
        text = str(fault["ctx"]["error"]).rstrip(".")
        return f"{_join_keys(place)}: {text}" if place else text
    if kind == "extra_forbidden":
        return f"{_join_keys(place)} is not known{_suggest_fix(place, model)}"
    if kind == "missing":
        return f"{_join_keys(place[:-1])} = {shorten_value(value)}: give two numbers"
    info = _find_field(place, model)
    annotation = None if info is None else info.annotation
    is_list = kind == "tuple_type" and Ellipsis in get_args(annotation)
    if kind in ("model_type", "model_attributes_type", "dict_type") or (is_list and _unwrap_model(annotation)):
        is_entry = isinstance(place[-1], int)
        keys = _join_keys(place[:-1] if is_entry else place)
        rule = f"write its keys under the heading {f'[[{keys}]]' if is_entry or is_list else f'[{keys}]'}"
    elif is_list:
        rule = "give a list in brackets"
    elif kind in ("too_long", "too_short", "tuple_type"):
        rule = "give two numbers"
    else:
        rule = _describe_rule(fault, info)
    return f"{_join_keys(place)} = {shorten_value(value)}: {rule}"


def _describe_rule(fault: Any, info: FieldInfo | None) -> str:
    """What a value must be, from the limits of its field if it has any."""
    if info is None or not any(isinstance(limit, Ge | Gt | Le | Lt) for limit in info.metadata):
        if fault["type"] == "literal_error":
            return f"use {fault['ctx']['expected']}"
        texts = {
            "bool_type": "give true or false",
            "string_type": "give a text in quotes",
            "string_too_short": "give a text that is not empty",
            "string_too_long": f"give a text of at most {fault.get('ctx', {}).get('max_length')} characters",
        }
        return texts.get(fault["type"], "give a number" if "float" in fault["type"] else str(fault["msg"]))
    limits = [
        f"{word} {float(getattr(limit, kind.__name__.lower())):g}"
        for kind, word in ((Gt, "above"), (Ge, "from"), (Lt, "below"), (Le, "to"))
        for limit in info.metadata
        if isinstance(limit, kind)
    ]
    words = f" ({info.description})" if info.description else ""
    return f"give a number {' '.join(limits)}{words}"


def _suggest_fix(place: Place, model: Model) -> str:
    """The section where an unknown key belongs, or the known key it resembles."""
    key = str(place[-1])
    for section, info in model.model_fields.items():  # sections that every file may have, such as [steering]
        if not get_args(info.annotation) and _has_key(info, key):
            return f" here; it belongs under [{section}]"
    home = _find_model(place[:-1], model)
    for section, info in home.model_fields.items() if home is not None else ():
        if _has_key(info, key):
            return f" here; it belongs under {section}"
    return suggest_name(key, home.model_fields) if home is not None else ""


def _has_key(section: FieldInfo, key: str) -> bool:
    """Whether a section has a key."""
    part = _unwrap_model(section.annotation)
    return part is not None and key in part.model_fields


def _find_field(place: Place, model: Model) -> FieldInfo | None:
    """The field of a key, or of the pair that holds a number."""
    names = place[:-1] if isinstance(place[-1], int) else place
    home = _find_model(names[:-1], model)
    info = home.model_fields.get(str(names[-1])) if home is not None else None
    if info is None or names is place:
        return info
    parts = [part for part in get_args(info.annotation) if get_args(part) or part is float]
    return FieldInfo.from_annotation(parts[int(place[-1])]) if len(parts) > int(place[-1]) else None


def _find_model(names: Place, model: Model) -> Model | None:
    """The class of a section. In a table of sections the keys are names of grounds or effects, in a list numbers."""
    current: Model | None = model
    is_keyed = False
    for name in names:
        if current is None:
            return None
        if is_keyed:
            is_keyed = False
            continue
        info = current.model_fields.get(str(name))
        if info is None:
            return None
        is_keyed = any(kind in str(info.annotation) for kind in ("dict", "tuple"))
        current = _unwrap_model(info.annotation)
    return current


def _unwrap_model(annotation: Any) -> Model | None:
    """The model in an annotation such as SteeringParameters, DiscrepancyModel | None or dict[str, PowerLaw]."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((inner for part in get_args(annotation) if (inner := _unwrap_model(part)) is not None), None)


def _join_keys(place: Place) -> str:
    return ".".join(str(part)[:40] for part in place)
