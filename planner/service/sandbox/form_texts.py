"""Day and farm files as forms: their text with changes made, its values, and what is wrong with which of them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from pydantic import BaseModel, ValidationError

from fields.nested_text import parse_toml
from fields.text_files import explain_parse_error
from planner.errors import HeadlandError, RequestError, render_refusal
from planner.request.option_texts import convert_time_to_text

ValuePath = list[str | int]
FormFault = dict[str, Any]
"""`path` of the value, empty for the whole file, and a `sentence`."""
MOST_FAULTS = 50


def read_day_form(text: str, changes: Sequence[Mapping[str, Any]], farm_path: str | None = None) -> dict[str, Any]:
    """Text, values, faults and choices of a day; `farm_path` is the file of the farm that it names, if there is one.

    Raises RequestError for changes that cannot be made.
    """
    from planner.day.input_file import EXAMPLE, DayFile, parse_day
    from planner.farm.inventory import load_example_farm, load_farm

    form = _read_form(text, changes, DayFile)
    choices: dict[str, list[str]] = {}
    with suppress(HeadlandError):
        is_example = form["values"].get("farm") == EXAMPLE
        farm = load_example_farm() if is_example else load_farm(farm_path) if farm_path else None
        if farm is not None:
            choices["tractor"] = [each.name for each in farm.tractors]
            choices["implement"] = [each.name for each in farm.implements]
    has_farm = form["values"].get("farm") is None or bool(choices)
    if not form["faults"] and has_farm:
        parse = partial(parse_day, form["text"], "day", farm=farm_path)
        form["contradictions"] = _list_contradictions(parse, form["values"])
    return form | {"choices": choices}


def read_farm_form(text: str, changes: Sequence[Mapping[str, Any]], farm_path: str | None = None) -> dict[str, Any]:
    """Text, values, faults and choices of a farm; `farm_path` is where it lies beside its tractors.

    Raises RequestError for changes that cannot be made.
    """
    from planner.farm.inventory import FarmFile, parse_farm

    form = _read_form(text, changes, FarmFile)
    folder = Path(farm_path).parent if farm_path else Path()
    if not form["faults"]:
        parse = partial(parse_farm, form["text"], "farm", folder)
        form["contradictions"] = _list_contradictions(parse, form["values"])
    tractors = form["values"].get("tractors")
    names = [each.get("name") for each in tractors if isinstance(each, dict)] if isinstance(tractors, list) else []
    return form | {"choices": {"tractor": [name for name in names if isinstance(name, str)]}}


FORMS = {"day": read_day_form, "farm": read_farm_form}
"""Forms by kind of file."""


def _read_form(text: str, changes: Sequence[Mapping[str, Any]], model: type[BaseModel]) -> dict[str, Any]:
    """Text, values and faults of a file, after changes."""
    try:
        parse_toml(text)
    except (ValueError, RecursionError) as error:
        sentence = f"This is not TOML: {explain_parse_error(error)}."
        if changes:
            raise RequestError(f"{sentence} Correct the text first.", parameter="text") from None
        return {"text": text, "values": {}, "faults": [{"path": [], "sentence": sentence}], "contradictions": []}
    text = _change_text(text, changes) if changes else text
    values = parse_toml(text)
    faults = list(_list_faults(values, model))
    return {"text": text, "values": _make_plain(values), "faults": faults, "contradictions": []}


def _make_plain(value: Any) -> Any:
    """A value as JSON can hold it: times, dates and numbers without end as texts, as files have them in quotes."""
    value = convert_time_to_text(value)
    if isinstance(value, dict):
        return {key: _make_plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_make_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if isinstance(value, str | int | float) else str(value)


def _list_faults(values: Mapping[str, Any], model: type[BaseModel]) -> Iterator[FormFault]:
    """Each wrong or missing value with its place."""
    from vehicle.model.validation_messages import describe_validation_errors

    try:
        model.model_validate(values)
    except ValidationError as error:
        for fault in error.errors()[:MOST_FAULTS]:
            alone = SimpleNamespace(errors=lambda fault=fault: [fault])
            clause = describe_validation_errors(cast(ValidationError, alone), model)
            yield {"path": list(fault["loc"]), "sentence": _format_sentence(clause, fault["loc"])}


def _format_sentence(clause: str, place: Sequence[str | int]) -> str:
    """A clause about a key of a file as a sentence beside its control, where the key need not be named."""
    key = ".".join(str(part) for part in place)
    clause = clause.removeprefix(f"it lacks {key}").removeprefix(key).removeprefix(" = ").removeprefix(": ").strip()
    clause = re.sub(r",? in quotes\b", "", clause)
    if clause.startswith("("):
        clause = f"give {clause.strip('()')}"
    return f"{clause[:1].upper()}{clause[1:]}." if clause else "This is missing."


def _list_contradictions(read: Any, values: Mapping[str, Any]) -> list[FormFault]:
    """What contradicts what, as one fault at the first value that it names."""
    try:
        read()
    except HeadlandError as refusal:
        sentence = render_refusal(refusal).partition(" cannot be used: ")
        words = sentence[2] or sentence[0]
        quoted = [text for pair in re.findall(r"'([^']+)'|\"([^\"]+)\"", words) for text in pair if text]
        places = (place for text in quoted for place in _find_text(values, text))
        return [{"path": next(places, []), "sentence": f"{words[:1].upper()}{words[1:]}"}]
    return []


def _find_text(value: Any, text: str, place: ValuePath | None = None) -> Iterator[ValuePath]:
    """The places of a text among values."""
    place = place or []
    if value == text:
        yield place
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in pairs:
        yield from _find_text(each, text, [*place, key])


def _change_text(text: str, changes: Sequence[Mapping[str, Any]]) -> str:
    """The text with values set, added or removed; comments and order stay."""
    import tomlkit

    try:
        document: Any = tomlkit.parse(text)
        for change in changes:
            _apply_change(document, list(change["path"]), change["value"])
        changed_text = tomlkit.dumps(document)
        parse_toml(changed_text)
        return changed_text
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
        raise RequestError(
            "The text has no place for this value; correct it as text, or begin with the example.", parameter="changes"
        ) from None


def _apply_change(document: Any, path: ValuePath, value: Any) -> None:
    """Set the value at a path; None removes it, and a table at the end of a list is added."""
    import tomlkit

    if isinstance(value, dict):
        new_table = tomlkit.table()
        for key, each in value.items():
            new_table[key] = each
        value = new_table
    home, (*sections, last) = document, path
    for place, following in zip(sections, path[1:], strict=True):
        if isinstance(place, str) and place not in home:
            home[place] = tomlkit.aot() if isinstance(following, int) else tomlkit.table()
        home = home[place]
    if value is None:
        if isinstance(last, int) or last in home:
            del home[last]
    elif isinstance(last, int) and last == len(home):
        home.append(value)
    else:
        home[last] = value
