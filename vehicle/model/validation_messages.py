"""Error messages for parameter files: one sentence that names every missing and every wrong key."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from fields.errors import shorten_value, suggest_name

MAX_FAULTS, MAX_MISSING = 6, 16
Model = type[BaseModel]


def describe_validation_errors(error: ValidationError, model: Model, max_count: int = MAX_FAULTS) -> str:
    """Clauses for all complaints of pydantic: missing keys, unknown keys, and wrong values with their rule.

    `model` is the class that was validated; at most `max_count` wrong values are listed.
    """
    missing = [_describe_missing(fault["loc"], model) for fault in error.errors() if _is_missing(fault)]
    clauses_of_values = [_describe_fault(fault, model) for fault in error.errors() if not _is_missing(fault)]
    clauses = [f"it lacks {', '.join(missing[:MAX_MISSING])}"] if missing else []
    clauses += clauses_of_values[:max_count]
    omitted = max(len(missing) - MAX_MISSING, 0) + max(len(clauses_of_values) - max_count, 0)
    clauses += [f"and {omitted} more"] if omitted else []
    return "; ".join(clauses)


def _is_missing(fault: Any) -> bool:
    """Whether a key is missing; a missing number of a pair is reported with the pair."""
    return fault["type"] == "missing" and not isinstance(fault["loc"][-1], int)


def _describe_missing(place: tuple[str | int, ...], model: Model) -> str:
    info = _find_field(place, model)
    words = info.description if info is not None else None
    return f"{_join_keys(place)} ({words})" if words else _join_keys(place)


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
    if kind == "tuple_type" and _is_list(_find_field(place, model)):
        return f"{_join_keys(place)} = {shorten_value(value)}: give a list in brackets"
    if kind in ("too_long", "too_short", "tuple_type"):
        return f"{_join_keys(place)} = {shorten_value(value)}: give two numbers"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        keys = _join_keys(place)
        return f"{keys} = {shorten_value(value)}: make it a section, [{keys}], with its own keys"
    return f"{_join_keys(place)} = {shorten_value(value)}: {_describe_rule(fault, _find_field(place, model))}"


def _describe_rule(fault: Any, info: FieldInfo | None) -> str:
    """What a value must be, from the limits of its field if it has any."""
    if info is None or not any(isinstance(limit, Ge | Gt | Le | Lt) for limit in info.metadata):
        if fault["type"] == "literal_error":
            return f"use {fault['ctx']['expected']}"
        texts = {
            "bool_type": "give true or false",
            "string_type": "give a text in quotes",
            "string_too_short": "give a text that is not empty",
            "string_too_long": _describe_max_length(fault),
        }
        return texts.get(fault["type"], "give a number" if "float" in fault["type"] else str(fault["msg"]))
    above = [
        f"{'above ' if isinstance(limit, Gt) else 'from '}{_get_limit(limit):g}"
        for limit in info.metadata
        if _is_lower_limit(limit)
    ]
    below = [
        f"{'below ' if isinstance(limit, Lt) else 'to '}{_get_limit(limit):g}"
        for limit in info.metadata
        if _is_upper_limit(limit)
    ]
    words = f" ({info.description})" if info.description else ""
    return f"give a number {' '.join(above + below)}{words}"


def _describe_max_length(fault: Any) -> str:
    return f"give a text of at most {fault.get('ctx', {}).get('max_length')} characters"


def _is_lower_limit(limit: Any) -> bool:
    return isinstance(limit, Ge | Gt)


def _is_upper_limit(limit: Any) -> bool:
    return isinstance(limit, Le | Lt)


def _get_limit(limit: Any) -> float:
    return float(next(getattr(limit, name) for name in ("ge", "gt", "le", "lt") if hasattr(limit, name)))


def _suggest_fix(place: tuple[str | int, ...], model: Model) -> str:
    """The section where an unknown key belongs, or the known key it resembles."""
    key = str(place[-1])
    for section, inner in _iterate_sections(model):
        if key in inner.model_fields:
            return f" here; it belongs under [{section}]"
    home = _find_model(place[:-1], model)
    for section, info in home.model_fields.items() if home is not None else ():
        part: Model | None = _unwrap_model(info.annotation)
        if part is not None and key in part.model_fields:
            return f" here; it belongs under {section}"
    return suggest_name(key, home.model_fields) if home is not None else ""


def _iterate_sections(model: Model) -> Iterator[tuple[str, Model]]:
    """Sections that every file may have, such as [steering]."""
    for name, info in model.model_fields.items():
        inner: Model | None = _unwrap_model(info.annotation)
        if inner is not None and not get_args(info.annotation):
            yield name, inner


def _is_list(info: FieldInfo | None) -> bool:
    """Whether a key takes a list of any length."""
    return info is not None and Ellipsis in get_args(info.annotation)


def _find_field(place: tuple[str | int, ...], model: Model) -> FieldInfo | None:
    """The field of a key, or of the pair that holds a number."""
    names = place[:-1] if isinstance(place[-1], int) else place
    home = _find_model(names[:-1], model)
    info = home.model_fields.get(str(names[-1])) if home is not None else None
    if info is None or names is place:
        return info
    parts = [part for part in get_args(info.annotation) if get_args(part) or part is float]
    return FieldInfo.from_annotation(parts[int(place[-1])]) if len(parts) > int(place[-1]) else None


def _find_model(names: tuple[str | int, ...], model: Model) -> Model | None:
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


def _join_keys(place: tuple[str | int, ...]) -> str:
    return ".".join(str(part)[:40] for part in place)
