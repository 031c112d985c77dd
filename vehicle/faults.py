"""What is wrong with the values of a parameter file, in one sentence that names every missing and every wrong key."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from fields.errors import nearest
from fields.reading import brief

MOST_TOLD, MOST_MISSING = 6, 16
Model = type[BaseModel]


def faults_of(error: ValidationError, model: Model, most: int = MOST_TOLD) -> str:
    """Clauses for all that pydantic complains of: what is missing, what is unknown, and wrong values with their rule.

    `model` is the class that was to be made; at most `most` wrong values are told.
    """
    missing = [_missing(fault["loc"], model) for fault in error.errors() if _lacks(fault)]
    others = [_clause(fault, model) for fault in error.errors() if not _lacks(fault)]
    clauses = [f"it lacks {', '.join(missing[:MOST_MISSING])}"] if missing else []
    clauses += others[:most]
    rest = max(len(missing) - MOST_MISSING, 0) + max(len(others) - most, 0)
    clauses += [f"and {rest} more"] if rest else []
    return "; ".join(clauses)


def _lacks(fault: Any) -> bool:
    """Whether a key is missing; a number that a pair lacks is told with the pair."""
    return fault["type"] == "missing" and not isinstance(fault["loc"][-1], int)


def _missing(place: tuple[str | int, ...], model: Model) -> str:
    info = _field(place, model)
    words = info.description if info is not None else None
    return f"{_dotted(place)} ({words})" if words else _dotted(place)


def _clause(fault: Any, model: Model) -> str:
    """Key, value and rule of one complaint."""
    place, kind, value = fault["loc"], fault["type"], fault["input"]
    if kind == "value_error":
        text = str(fault["ctx"]["error"]).rstrip(".")
        return f"{_dotted(place)}: {text}" if place else text
    if kind == "extra_forbidden":
        return f"{_dotted(place)} is not known{_hint(place, model)}"
    if kind == "missing":
        return f"{_dotted(place[:-1])} = {brief(value)}: give two numbers"
    if kind == "tuple_type" and _many(_field(place, model)):
        return f"{_dotted(place)} = {brief(value)}: give a list in brackets"
    if kind in ("too_long", "too_short", "tuple_type"):
        return f"{_dotted(place)} = {brief(value)}: give two numbers"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"{_dotted(place)} = {brief(value)}: make it a section, [{_dotted(place)}], with keys of its own"
    return f"{_dotted(place)} = {brief(value)}: {_rule(fault, _field(place, model))}"


def _rule(fault: Any, info: FieldInfo | None) -> str:
    """What a value must be, from the field's own limits where it has any."""
    if info is None or not any(isinstance(limit, Ge | Gt | Le | Lt) for limit in info.metadata):
        if fault["type"] == "literal_error":
            return f"use {fault['ctx']['expected']}"
        texts = {
            "bool_type": "give true or false", "string_type": "give a text in quotes",
            "string_too_short": "give a text that is not empty", "string_too_long": _at_most(fault),
        }  # fmt: skip
        return texts.get(fault["type"], "give a number" if "float" in fault["type"] else str(fault["msg"]))
    above = [f"{'above ' if isinstance(one, Gt) else 'from '}{_edge(one):g}" for one in info.metadata if _low(one)]
    below = [f"{'below ' if isinstance(one, Lt) else 'to '}{_edge(one):g}" for one in info.metadata if _high(one)]
    words = f" ({info.description})" if info.description else ""
    return f"give a number {' '.join(above + below)}{words}"


def _at_most(fault: Any) -> str:
    return f"give a text of at most {fault.get('ctx', {}).get('max_length')} letters"


def _low(limit: Any) -> bool:
    return isinstance(limit, Ge | Gt)


def _high(limit: Any) -> bool:
    return isinstance(limit, Le | Lt)


def _edge(limit: Any) -> float:
    return float(next(getattr(limit, name) for name in ("ge", "gt", "le", "lt") if hasattr(limit, name)))


def _hint(place: tuple[str | int, ...], model: Model) -> str:
    """Where an unknown key belongs: to another section, or it is a known one misspelt."""
    key = str(place[-1])
    for section, inner in _sections(model):
        if key in inner.model_fields:
            return f" here; it belongs under [{section}]"
    home = _model_of(place[:-1], model)
    for section, info in home.model_fields.items() if home is not None else ():
        part: Model | None = _inner(info.annotation)
        if part is not None and key in part.model_fields:
            return f" here; it belongs under {section}"
    return nearest(key, home.model_fields) if home is not None else ""


def _sections(model: Model) -> Iterator[tuple[str, Model]]:
    """Sections that every file may have, such as [steering]."""
    for name, info in model.model_fields.items():
        inner: Model | None = _inner(info.annotation)
        if inner is not None and not get_args(info.annotation):
            yield name, inner


def _many(info: FieldInfo | None) -> bool:
    """Whether a key takes a list of any length."""
    return info is not None and Ellipsis in get_args(info.annotation)


def _field(place: tuple[str | int, ...], model: Model) -> FieldInfo | None:
    """The field of a key, or of the pair that a number stands in."""
    names = place[:-1] if isinstance(place[-1], int) else place
    home = _model_of(names[:-1], model)
    info = home.model_fields.get(str(names[-1])) if home is not None else None
    if info is None or names is place:
        return info
    parts = [part for part in get_args(info.annotation) if get_args(part) or part is float]
    return FieldInfo.from_annotation(parts[int(place[-1])]) if len(parts) > int(place[-1]) else None


def _model_of(names: tuple[str | int, ...], model: Model) -> Model | None:
    """The class that a section is read as; the keys of a table of sections are names of grounds or effects,
    those of a list of sections their numbers.
    """
    now: Model | None = model
    named = False
    for name in names:
        if now is None:
            return None
        if named:
            named = False
            continue
        info = now.model_fields.get(str(name))
        if info is None:
            return None
        named = any(kind in str(info.annotation) for kind in ("dict", "tuple"))
        now = _inner(info.annotation)
    return now


def _inner(annotation: Any) -> Model | None:
    """The model in an annotation such as Steering, Rest | None or dict[str, PowerLaw]."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((inner for part in get_args(annotation) if (inner := _inner(part)) is not None), None)


def _dotted(place: tuple[str | int, ...]) -> str:
    return ".".join(str(part)[:40] for part in place)
